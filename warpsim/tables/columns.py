"""Columns of a table by forgiving names, as numbers in a unit or as text."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]


class ColumnTable:
    """A table whose columns are found by any of several names, whatever their case and punctuation.

    Archives rename columns as they export them: B-V, B_V and b_v are one name here.
    """

    def __init__(self, table: Table) -> None:
        self.table = table
        self._names: Mapping[str, str] = {plain_name(name): name for name in reversed(table.colnames)}

    def __len__(self) -> int:
        return len(self.table)

    def find(self, *names: str) -> str | None:
        """The table's own name of the first of these columns that it has; one spelled just so goes first."""
        for name in names:
            if name in self.table.colnames:
                return name
            if plain_name(name) in self._names:
                return self._names[plain_name(name)]
        return None

    def number(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> Array:
        """A column of numbers in a unit, shape (n,); NaN where masked, one of `null`, or where there is no such column.

        A column that states another unit is converted; one that states none is taken to be in `unit`.

        Raises:
            InputError: It holds no numbers, or is in a unit that does not convert.
        """
        name = self.find(*names)
        if name is None:
            return np.full(len(self), np.nan)
        values = number_column(self.table, name, unit)
        return np.where(np.isin(values, null), np.nan, values) if null else values

    def needed(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> Array:
        """Like number(), of a column that must be there."""
        if self.find(*names) is None:
            found = ", ".join(self.table.colnames)
            raise InputError(f"must have the column {' or '.join(names)}", value=found, form="s")
        return self.number(*names, unit=unit, null=null)

    def text(self, *names: str) -> NDArray[np.str_]:
        """A column as text without blanks at the ends, shape (n,); "" where masked or where there is no such column."""
        name = self.find(*names)
        if name is None:
            return np.full(len(self), "")
        column: Any = self.table[name]
        if column.ndim != 1:
            raise InputError(f"must hold one value a row, got shape {column.shape}", name)
        texts = np.char.strip(np.asarray(getattr(column, "unmasked", column)).astype(np.str_))
        mask = getattr(column, "mask", None)
        return texts if mask is None else np.where(np.asarray(mask), "", texts)


def plain_name(name: str) -> str:
    """A column name without case and punctuation; the name itself where nothing else is in it."""
    return re.sub(r"[\W_]", "", name.casefold()) or name


def number_column(table: Table, key: str, unit: str) -> Array:
    """Return a numeric column in a unit, NaN where masked.

    Raises:
        InputError: It holds no numbers, or is in a unit that does not convert.
    """
    column: Any = table[key]
    if column.ndim != 1 or column.dtype.kind == "c":
        what = "complex numbers" if column.dtype.kind == "c" else f"shape {column.shape}"
        raise InputError("must hold one real number a row", key, what, "s")
    try:
        values = np.array(getattr(column, "unmasked", column), dtype=np.float64)
        if column.unit is not None and unit:
            from astropy.units import Unit

            values = values * Unit(column.unit).to(unit)
    except (TypeError, ValueError):  # UnitConversionError is a TypeError
        text = f"numbers in {unit}" if unit else "numbers"
        raise InputError(f"must be {text}, got {column.dtype.name} in {column.unit or 'no unit'}", key) from None
    mask = getattr(column, "mask", None)
    return values if mask is None else np.where(np.asarray(mask), np.nan, values)
