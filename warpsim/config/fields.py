"""Fields of config models: their types carry the rules.

Numbers may be given as astropy Quantity: the unit to convert to is read from the end of the field's name
(`altitude_km`, `fov_deg`, `nei_w_cm2`), once, at this boundary.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from warpsim.files import absolute_path

LARGEST_SIZE = 1e60
"""Of a number with a unit; one over it is the least: products of some of them are numbers still."""

# Longest suffix first, so that `_m_s` is not read as `_s`.
_UNIT_OF_SUFFIX = {
    "nei_per_um": "1 / um",
    "e_per_um": "electron / um",
    "_w_cm2_sr": "W / (cm2 sr)",
    "_j_kg_k": "J / (kg K)",
    "_mjy_sr": "MJy / sr",
    "_w_cm2": "W / cm2",
    "_w_m2": "W / m2",
    "_rev_s": "1 / s",
    "_urad_s": "urad / s",
    "_deg_s2": "deg / s2",
    "_cm2_s": "1 / (cm2 s)",
    "_deg_s": "deg / s",
    "_m_s": "m / s",
    "_e_s": "electron / s",
    "_deg": "deg",
    "_rad": "rad",
    "_urad": "urad",
    "_km": "km",
    "_um": "um",
    "_hz": "Hz",
    "_jy": "Jy",
    "_px": "pix",
    "_kg": "kg",
    "_m": "m",
    "_e": "electron",
    "_s": "s",
    "_k": "K",
}


def unit_of(name: str) -> str:
    """Return the unit that the end of a field's name says, as astropy reads it; empty for plain numbers."""
    return next((unit for suffix, unit in _UNIT_OF_SUFFIX.items() if name.endswith(suffix)), "")


def rule_error(rule: str) -> PydanticCustomError:
    """Return the error to raise from a field's validator: field path and value are added to the rule."""
    return PydanticCustomError("rule", "{rule}", {"rule": rule})


def _plain_number(value: Any, info: ValidationInfo) -> float:
    """Return value as a Python float, converting a Quantity to the unit its field is named after."""
    if hasattr(value, "unit") and hasattr(value, "to_value"):
        unit = unit_of(info.field_name or "")
        try:
            value = value.to_value(unit)
        except Exception:
            raise rule_error(f"must be convertible to {unit or 'a plain number'}") from None
    if (isinstance(value, np.ndarray) and value.ndim == 0) or isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise rule_error("must be a number")
    try:
        number = float(value)
    except OverflowError:  # a whole number
        number = math.inf
    if not math.isfinite(number):
        raise rule_error("must be finite")
    if unit_of(info.field_name or ""):
        if abs(number) > LARGEST_SIZE:
            raise rule_error(f"must be in [{-LARGEST_SIZE:g}, {LARGEST_SIZE:g}]")
        if 0.0 < abs(number) < 1 / LARGEST_SIZE:
            raise rule_error(f"must be 0, or at least {1 / LARGEST_SIZE:g} in size")
    return number


@dataclass(frozen=True)
class Interval:
    """Rule of a number: from low to high, either end included or not."""

    low: float
    high: float = math.inf
    open_low: bool = False
    open_high: bool = False

    def __str__(self) -> str:
        if math.isinf(self.high):
            return f"{'>' if self.open_low else '>='} {self.low:g}"
        low, high = (str(end) if isinstance(end, int) else f"{end:g}" for end in (self.low, self.high))
        return f"in {'(' if self.open_low else '['}{low}, {high}{')' if self.open_high else ']'}"

    def __call__(self, value: float) -> float:
        """Return value; rule_error where it is outside."""
        above = value > self.low if self.open_low else value >= self.low
        below = value < self.high if self.open_high else value <= self.high
        if not (above and below):
            raise rule_error(f"must be {self}")
        return value


def number_within(value: Any, info: ValidationInfo, low: float, high: float, open_low: bool = False) -> float:
    """Return a number from low to high, in the unit of its field's name, for validators that decide by hand."""
    return Interval(low, high, open_low)(_plain_number(value, info))


def rows_in(unit: str) -> BeforeValidator:
    """Rule: a list; arrays become lists, quantities numbers in a unit."""

    def check(value: Any) -> Any:
        if hasattr(value, "unit") and hasattr(value, "to_value"):
            try:
                value = value.to_value(unit)
            except Exception:
                raise rule_error(f"must be convertible to {unit or 'plain numbers'}") from None
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if not isinstance(value, list | tuple):
            raise rule_error("must be a list")
        return tuple(value)

    return BeforeValidator(check)


def _whole_number(value: Any) -> Any:
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise rule_error("must be a whole number")
    if abs(value) >= 2**64:
        raise rule_error("must be below 2**64")
    return value


def _true_or_false(value: Any) -> Any:
    if not isinstance(value, bool | np.bool_):
        raise rule_error("must be true or false")
    return bool(value)


def open_interval(low: float, high: float) -> AfterValidator:
    """Rule: low < value < high."""
    return AfterValidator(Interval(low, high, True, True))


def closed_interval(low: float, high: float) -> AfterValidator:
    """Rule: low <= value <= high."""
    return AfterValidator(Interval(low, high))


Number = Annotated[float, BeforeValidator(_plain_number)]
"""Any finite number."""
Positive = Annotated[Number, AfterValidator(Interval(0, open_low=True))]
NonNegative = Annotated[Number, AfterValidator(Interval(0))]
Length = Annotated[Positive, closed_interval(0, 1e5)]
"""A body's dimension [m]; far larger ones would overflow float32 irradiances."""
Integer = Annotated[int, BeforeValidator(_whole_number)]
Count = Annotated[Integer, AfterValidator(Interval(1)), closed_interval(1, 10**9)]
Group = Annotated[Count, closed_interval(1, 100_000)]
"""A number of satellites or targets."""
Switch = Annotated[bool, BeforeValidator(_true_or_false)]
Vector = tuple[Number, Number, Number]


MOST_LETTERS = 100
"""Of a name: file systems take 255 for two or three of them and endings."""


def _file_name(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", value):
        raise rule_error("must be letters, digits, '_', '.' or '-'")
    if len(value) > MOST_LETTERS:
        raise rule_error(f"must have at most {MOST_LETTERS} letters")
    return value


Name = Annotated[str, AfterValidator(_file_name)]
"""A name that can also be a file name."""


def whole_path(value: Any, rule: str = "must be the path of a file") -> str:
    """The path of a file, absolute from here on: the current directory may change before the file is read.

    Raises:
        PydanticCustomError: It is no path.
    """
    try:
        path = os.fspath(value)
        if isinstance(path, str) and path and b"\0" not in os.fsencode(path):
            return absolute_path(path)
    except (TypeError, ValueError, OSError):  # no path, no name of this system, or the current directory is gone
        pass
    raise rule_error(rule)


FileName = Annotated[str, BeforeValidator(whole_path)]
"""Path of a file, as text or os.PathLike; becomes absolute, counted from the current directory."""


FUNCTION = "python:"
"""What a function's name begins with where a file's could stand."""


def file_or_function(value: Any) -> str:
    """The absolute path of a file, or "python:module:function" of a function or its name."""
    if isinstance(value, str) and value.startswith(FUNCTION):
        if len([part for part in value.split(":") if part]) != 3:
            raise rule_error('must be a file, or a function such as "python:module:function"')
        return value
    if callable(value):
        name = getattr(value, "__qualname__", "<")
        if "<" in name:
            raise rule_error("must be a function of a module, that workers can import: no lambda, and none in another")
        return f"{FUNCTION}{value.__module__}:{name}"
    return whole_path(value)


def as_tuple(value: Any) -> Any:
    """Lists of scene files become tuples; a single name is a list of one."""
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, list | tuple):
        raise rule_error("must be a list")
    return tuple(value)
