"""Arrays that users give to functions: plain numbers, or astropy quantities converted to the unit asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError


def plain_array(value: Any, unit: str, where: str) -> npt.NDArray[np.float64]:
    """Numbers in a unit, any shape, NaN included.

    Args:
        value: Numbers, taken to be in the unit, or a Quantity.
        unit: Of the result.
        where: Name of the argument, for messages.

    Raises:
        InputError: They are no numbers, or cannot be converted to the unit.
    """
    if hasattr(value, "unit") and hasattr(value, "to_value"):
        try:
            value = value.to_value(unit)
        except Exception:
            raise InputError(f"{where}: must be convertible to {unit}, got {value.unit}") from None
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{where}: must be numbers, got {type(value).__name__}") from None


def times_s(value: Any) -> npt.NDArray[np.float64]:
    """Times after the epoch [s] as an array of one axis or more."""
    return np.atleast_1d(plain_array(value, "s", "time_s"))
