"""Numbers by the name of a band, as fields of descriptions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from pydantic import PlainSerializer, PlainValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from warpsim.describe import number_within, part_error, rule_error
from warpsim.sky.bands import BANDS

V = TypeVar("V")


class ByBand(Mapping[str, V]):
    """Numbers (or files) by the name of a band, in the order given; does not change."""

    def __init__(self, values: Mapping[str, V]) -> None:
        self._values = dict(values)

    def __getitem__(self, band: str) -> V:
        return self._values[band]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        return repr(self._values)


def band_table(value: Any, info: ValidationInfo, low: float, high: float) -> ByBand[float]:
    """A table of numbers by band, each from low to high, as pydantic's validators give it."""
    if not isinstance(value, Mapping):
        raise rule_error("must be a table of numbers by band")
    for band in value:
        if band not in BANDS:
            raise rule_error(f"must name bands among {', '.join(BANDS)}")
    numbers = {}
    for band, given in value.items():
        try:
            numbers[band] = number_within(given, info, low, high)
        except PydanticCustomError as error:
            raise part_error(f"{band}: {error.message()}, got {given!r}") from None
    return ByBand(numbers)


def within(low: float, high: float) -> PlainValidator:
    """Rule of a field: a table of numbers by band from low to high."""
    return PlainValidator(lambda value, info: band_table(value, info, low, high))


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value


AS_DICT = PlainSerializer(_plain)
"""How such a field is written: a dict, or the value that stands for all bands."""
