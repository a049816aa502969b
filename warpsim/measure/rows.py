"""Columns of tables that users hand over, of whatever library: astropy, pandas, NumPy, dicts."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.errors import InputError

_ZONE = re.compile("[Zz+]|[T ].*-")
"""Of a date with a zone: behind a time, a sign too."""


def column(table: Any, name: str, where: str) -> npt.NDArray[Any]:
    """A column as an array, texts as texts of NumPy; masked numbers are NaN, masked texts empty.

    Raises:
        InputError: The table, which is the argument `where`, has no such column.
    """
    try:
        values = table[name]
    except (KeyError, ValueError, IndexError, TypeError):
        raise InputError(f"must have the column {name}", where) from None
    if np.ma.isMaskedArray(values):
        if values.dtype.kind in "fiu" and np.ma.is_masked(values):
            values = values.astype(np.float64)
        fill: Any = {"f": np.nan, "U": ""}.get(values.dtype.kind)
        values = np.ma.filled(values, fill)
    array = np.asarray(values)
    if array.dtype.kind == "S":
        return np.char.decode(array, "utf-8")
    return array.astype(str) if array.dtype.kind == "O" and isinstance(next(iter(array), ""), str) else array


def column_names(table: Any) -> list[str]:
    """Names of the columns of a table."""
    names = getattr(table, "colnames", None)  # of astropy
    if names is None:
        names = getattr(getattr(table, "dtype", None), "names", None) or table
    return list(names)


def has_column(table: Any, name: str) -> bool:
    """Whether a table has a column."""
    return name in column_names(table)


def flags(table: Any, name: str, where: str) -> npt.NDArray[np.bool_]:
    """A column of yes and no, also as the texts that files of text have, in any case.

    Raises:
        InputError: The column is missing, or a text is neither true nor false.
    """
    values = column(table, name, where)
    if values.dtype.kind != "U":
        return values.astype(bool)
    lower = np.char.lower(values)
    if (wrong := np.flatnonzero((lower != "true") & (lower != "false"))).size:
        raise InputError("must be true or false", f"{where}.{name}", str(values[wrong[0]]), row=int(wrong[0]))
    return np.asarray(lower == "true")


def numbers(table: Any, names: Sequence[str], where: str) -> F64:
    """Columns of finite numbers side by side, (n_row, n_name).

    Raises:
        InputError: A column is missing, or holds what is no finite number.
    """
    columns = []
    for name in names:
        found = column(table, name, where)
        try:
            values = found.astype(np.float64)
        except (TypeError, ValueError):
            raise InputError("must be numbers", f"{where}.{name}") from None
        if (wrong := np.flatnonzero(~np.isfinite(values))).size:
            first = int(wrong[0])
            raise InputError("must be finite", f"{where}.{name}", float(values[first]), row=first, n_row=wrong.size)
        columns.append(values)
    return np.stack(columns, axis=1)


def dates(table: Any, name: str, where: str) -> npt.NDArray[np.datetime64]:
    """A column of UTC dates, ISO 8601 without a zone or of NumPy's kind, to the microsecond, (n_row,).

    Raises:
        InputError: The column is missing, or holds no such dates.
    """
    values = column(table, name, where)
    if values.dtype.kind == "U":
        zoned = any(map(_ZONE.search, values.tolist()))
    else:
        zoned = any(getattr(value, "tzinfo", None) for value in values if values.dtype.kind == "O")
    try:
        if zoned or values.dtype.kind not in "UMO":
            raise ValueError
        found = np.asarray(values, dtype="datetime64[us]")
    except (TypeError, ValueError):
        rule = "must be UTC dates, ISO 8601 without a zone, as in 2025-01-01T14:10:00.000000"
        raise InputError(rule, f"{where}.{name}", values[0] if len(values) else "", "s") from None
    if np.isnat(found).any():
        raise InputError("must not be empty", f"{where}.{name}", row=int(np.flatnonzero(np.isnat(found))[0]))
    return found


def naive_utc(when: npt.NDArray[np.datetime64]) -> list[datetime]:
    """Dates as Stone Soup has them: naive datetimes of UTC."""
    return list(when.astype("datetime64[us]").tolist())


def check_stonesoup() -> None:
    """Raise InputError, which names the extra, where Stone Soup is not installed."""
    if importlib.util.find_spec("stonesoup") is None:
        raise InputError("needs Stone Soup, which the extra `stonesoup` brings: pip install 'warpsim[stonesoup]'")
