"""Fields of config models: their types carry the rules.

Numbers may be given as astropy Quantity: the unit to convert to is read from the end of the field's name
(`altitude_km`, `fov_deg`, `nei_w_cm2`), once, at this boundary.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from warpsim.files import absolute_path

# Longest suffix first, so that `_m_s` is not read as `_s`.
_UNIT_OF_SUFFIX = {
    "_w_cm2_sr": "W / (cm2 sr)",
    "_j_kg_k": "J / (kg K)",
    "_mjy_sr": "MJy / sr",
    "_w_cm2": "W / cm2",
    "_w_m2": "W / m2",
    "_rev_s": "1 / s",
    "_urad_s": "urad / s",
    "_deg_s2": "deg / s2",
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


def rule_error(rule: str) -> PydanticCustomError:
    """Return the error to raise from a field's validator: field path and value are added to the rule."""
    return PydanticCustomError("rule", "{rule}", {"rule": rule})


def _plain_number(value: Any, info: ValidationInfo) -> float:
    """Return value as a Python float, converting a Quantity to the unit its field is named after."""
    if hasattr(value, "unit") and hasattr(value, "to_value"):
        name = info.field_name or ""
        suffix = next((s for s in _UNIT_OF_SUFFIX if name.endswith(s)), None)
        unit = _UNIT_OF_SUFFIX[suffix] if suffix else ""
        try:
            value = value.to_value(unit)
        except Exception:
            raise rule_error(f"must be convertible to {unit or 'a plain number'}") from None
    if (isinstance(value, np.ndarray) and value.ndim == 0) or isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise rule_error("must be a number")
    if not math.isfinite(value):
        raise rule_error("must be finite")
    return float(value)


def _in_interval(low: float, high: float, open_low: bool, open_high: bool) -> Callable[[float], float]:
    if math.isinf(high):
        rule = f"must be {'>' if open_low else '>='} {low:g}"
    else:
        rule = f"must be in {'(' if open_low else '['}{_plain(low)}, {_plain(high)}{')' if open_high else ']'}"

    def check(value: float) -> float:
        above = value > low if open_low else value >= low
        below = value < high if open_high else value <= high
        if not (above and below):
            raise rule_error(rule)
        return value

    return check


def _plain(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


def number_within(value: Any, info: ValidationInfo, low: float, high: float, open_low: bool = False) -> float:
    """A number from low to high, for validators that decide by hand; its unit by the field's name.

    Raises:
        PydanticCustomError: It is none.
    """
    return _in_interval(low, high, open_low, False)(_plain_number(value, info))


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
    return value


def _true_or_false(value: Any) -> Any:
    if not isinstance(value, bool | np.bool_):
        raise rule_error("must be true or false")
    return bool(value)


def open_interval(low: float, high: float) -> AfterValidator:
    """Rule: low < value < high."""
    return AfterValidator(_in_interval(low, high, True, True))


def closed_interval(low: float, high: float) -> AfterValidator:
    """Rule: low <= value <= high."""
    return AfterValidator(_in_interval(low, high, False, False))


Number = Annotated[float, BeforeValidator(_plain_number)]
"""Any finite number."""
Positive = Annotated[Number, AfterValidator(_in_interval(0, math.inf, True, True))]
NonNegative = Annotated[Number, AfterValidator(_in_interval(0, math.inf, False, True))]
Length = Annotated[Positive, closed_interval(0, 1e5)]
"""A body's dimension [m]; far larger ones would overflow float32 irradiances."""
Integer = Annotated[int, BeforeValidator(_whole_number)]
Count = Annotated[Integer, AfterValidator(_in_interval(1, math.inf, False, True)), closed_interval(1, 10**9)]
Group = Annotated[Count, closed_interval(1, 100_000)]
"""A number of satellites or targets."""
Switch = Annotated[bool, BeforeValidator(_true_or_false)]
Vector = tuple[Number, Number, Number]


def _file_name(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", value):
        raise rule_error("must be letters, digits, '_', '.' or '-'")
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


def as_tuple(value: Any) -> Any:
    """Lists of scene files become tuples; a single name is a list of one."""
    if isinstance(value, str):
        return (value,)
    if not isinstance(value, list | tuple):
        raise rule_error("must be a list")
    return tuple(value)
