"""Numbers by the name of a band, as fields of descriptions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from math import inf
from typing import Annotated, Any, TypeVar

from pydantic import PlainSerializer, PlainValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from warpsim.config.fields import MOST_LETTERS, number_within, rule_error
from warpsim.errors import InputError

V = TypeVar("V")

BAND_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9_.-]{{0,{MOST_LETTERS - 1}}}")
"""Names of bands; they are parts of file names too."""


class FixedMapping(Mapping[str, V]):
    """A mapping that does not change, in the order given."""

    def __init__(self, values: Mapping[str, V]) -> None:
        self._values = dict(values)

    def __getitem__(self, name: str) -> V:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        return repr(self._values)


class ByBand(FixedMapping[V]):
    """Numbers (or files) by the name of a band."""


def band_table(value: Any, info: ValidationInfo, low: float, high: float, open_low: bool = False) -> ByBand[float]:
    """A table of numbers by band, each from low to high, as pydantic's validators give it."""
    if not isinstance(value, Mapping):
        raise rule_error("must be a table of numbers by band")
    if not are_names(value):
        raise rule_error("must be a table of numbers by names of bands")
    numbers = {}
    for band, given in value.items():
        try:
            numbers[band] = number_within(given, info, low, high, open_low)
        except PydanticCustomError as error:
            raise InputError(error.message(), value=given).of(band) from None
    return ByBand(numbers)


def are_names(bands: Iterable[Any]) -> bool:
    """Return whether all can be names of bands; a scene checks that it has such bands."""
    return all(isinstance(band, str) and BAND_NAME.fullmatch(band) for band in bands)


def named_bands(*values: Any) -> list[str]:
    """Return the bands that some numbers or tables by band name, each once."""
    return list(dict.fromkeys(band for value in values if isinstance(value, Mapping) for band in value))


def within(low: float, high: float) -> PlainValidator:
    """Rule of a field: a table of numbers by band from low to high."""
    return PlainValidator(lambda value, info: band_table(value, info, low, high))


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value


AS_DICT = PlainSerializer(_plain)
"""How such a field is written: a dict, or the value that stands for all bands."""


def _number_or_table(low: float, high: float, open_low: bool = False) -> PlainValidator:
    """Rule of a field: one number for all bands from low to high, or a table of them that is not empty."""

    def check(value: Any, info: ValidationInfo) -> float | ByBand[float]:
        if not isinstance(value, Mapping):
            return number_within(value, info, low, high, open_low)
        if not value:
            raise rule_error("must be a number or a table that names a band")
        return band_table(value, info, low, high, open_low)

    return PlainValidator(check)


PositiveByBand = Annotated[float | Mapping[str, float], _number_or_table(0.0, inf, open_low=True), AS_DICT]
"""A number > 0 for all bands, or a table of them."""
NonNegativeByBand = Annotated[float | Mapping[str, float], _number_or_table(0.0, inf), AS_DICT]
"""A number >= 0 for all bands, or a table of them."""
FractionByBand = Annotated[float | Mapping[str, float], _number_or_table(0.0, 1.0, open_low=True), AS_DICT]
"""A fraction, > 0 and <= 1, for all bands, or a table of them."""


def in_band(value: float | Mapping[str, float], band: str) -> float | None:
    """The number of a band, None where a table does not name it."""
    return value.get(band) if isinstance(value, Mapping) else value
