"""Columns of a table by forgiving names, as numbers in a unit or as text; tables of a file that holds several."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError

if TYPE_CHECKING:
    from astropy.table import Table


MISSING = ("", "nan", "null", "none", "-", "--", "---", "~", "n/a")
"""Texts, in small letters, that stand for a missing number."""


class ColumnTable:
    """A table whose columns are found by any of several names, whatever their case and punctuation.

    Archives rename columns as they export them: B-V, B_V and b_v are one name here.
    """

    def __init__(
        self,
        table: Table,
        line_of_row: NDArray[np.int64] | None = None,
        layout: str | None = None,
        header: str = "",
        all_names: Sequence[str] | None = None,
    ) -> None:
        from astropy.table import Table

        self.table = Table(table, copy=False)
        for name in table.colnames:
            kind = getattr(getattr(table[name], "dtype", None), "kind", "")
            if kind and kind in "SUO":
                self.table.replace_column(name, Table.Column(_plain_texts(table[name]), unit=table[name].unit))
        self._names: Mapping[str, str] = {plain_name(name): name for name in reversed(table.colnames)}
        self.line_of_row = line_of_row
        """Line of each row in a text file, counted from 1; None where rows have none."""

        self.layout = layout
        """Name of the byte layout that the file follows, if any."""

        self.open_end: InputError | None = None
        """The error of a last line that no line break closes; None where it is closed, or known to be whole."""

        self.header = header or "\n".join(map(str, table.meta.values()))
        """What the file says of the table besides its rows: comments, cards, elements of XML."""

        self.all_names = tuple(table.colnames) if all_names is None else tuple(all_names)
        """Columns of the file, also those that were not read."""

        self.asked: set[str] = set()
        """Plain names of the columns looked for so far."""

        self.found: set[str] = set()
        """The file's names of the columns found so far."""

        self.position: tuple[str, str] | None = None
        """The file's names of right ascension and declination, where these are plain degrees of ICRS or J2000."""

        self._given_name: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self.table)

    @property
    def names(self) -> str:
        """Names of all columns, for messages."""
        return ", ".join(self.table.colnames)

    def find(self, *names: str) -> str | None:
        """The table's own name of the first of these columns that it has; one spelled just so goes first."""
        self.asked.update(map(plain_name, names))
        for name in names:
            own_name = name if name in self.table.colnames else self._names.get(plain_name(name))
            if own_name is not None:
                self.found.add(self._given_name.get(own_name, own_name))
                return own_name
        return None

    def rename(self, old: str, new: str) -> None:
        """Give a column another name, by which it is found from now on; one that bears it already gives it up."""
        if new in self.table.colnames and new != old:
            self.rename(new, f"{new} (the file's)")
        self.table.rename_column(old, new)
        self._given_name[new] = self._given_name.pop(old, old)
        self._names = {plain_name(name): name for name in reversed(self.table.colnames)}

    def need(self, *names: str) -> str:
        """Like find(), of a column that must be there."""
        name = self.find(*names)
        if name is None:
            raise InputError(f"must have the column {' or '.join(names)}", value=self.names, form="s")
        return name

    def number(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> F64:
        """A column of numbers in a unit, shape (n,); NaN where masked, one of `null`, or where there is no such column.

        A column that states another unit is converted; one that states none is taken to be in `unit`. Numbers that
        stand as text are read.

        Raises:
            InputError: A value is no number, or the column is in a unit that does not convert.
        """
        name = self.find(*names)
        if name is None:
            return np.full(len(self), np.nan)
        column = self.table[name]
        if column.dtype.kind == "U":
            self.table.replace_column(name, self.table.Column(self._numbers_of_text(name), unit=column.unit))
        values = number_column(self.table, name, unit)
        return np.where(np.isin(values, null), np.nan, values) if null else values

    def needed(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> F64:
        """Like number(), of a column that must be there."""
        return self.number(self.need(*names), unit=unit, null=null)

    def text(self, *names: str) -> NDArray[np.str_]:
        """A column as text without blanks at the ends, shape (n,); "" where masked or where there is no such column."""
        name = self.find(*names)
        if name is None:
            return np.full(len(self), "")
        column: Any = self.table[name]
        if column.ndim != 1:
            raise InputError(f"must hold one value a row, got shape {column.shape}", name)
        return np.char.strip(_plain_texts(column))

    def where(self, row: int) -> str:
        """Location of a row: "line 3", or "row 2" of a file without lines (counted from 0)."""
        known = self.line_of_row is not None and row < len(self.line_of_row)
        return f"line {self.line_of_row[row]}" if known and self.line_of_row is not None else f"row {row}"

    def located(self, error: InputError) -> InputError:
        """The error of a check of columns, with the line of its row in the file if it has one."""
        return error if error.row is None else error.at_row(self.where(error.row))

    def _numbers_of_text(self, name: str) -> F64:
        """Numbers of a column of text, NaN where a text stands for a missing value."""
        texts = self.text(name)
        values = np.full(len(texts), np.nan)
        given = ~np.isin(np.char.lower(texts), MISSING)
        try:
            values[given] = texts[given].astype(np.float64)
        except ValueError:
            row = next(row for row in np.flatnonzero(given).tolist() if not is_number(str(texts[row])))
            error = InputError("must be a number", value=str(texts[row])).of(f"column {name}")
            raise error.of(self.where(row)) from None
        return values


def plain_name(name: str) -> str:
    """A column name without case and punctuation; the name itself where nothing else is in it."""
    return re.sub(r"[\W_]", "", name.casefold()) or name


def is_number(text: str | bytes) -> bool:
    """Return whether a text is a number; Python's 1_0 is none."""
    try:
        float(text)
    except ValueError:
        return False
    return ("_" if isinstance(text, str) else b"_") not in text  # type: ignore[operator]


def number_column(table: Table, key: str, unit: str) -> F64:
    """Return a numeric column in a unit, NaN where masked; InputError for no numbers or another kind of unit."""
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


def _plain_texts(column: Any) -> NDArray[np.str_]:
    """Texts of a column, "" where masked: formats give bytes, objects or masked texts."""
    values = np.asarray(getattr(column, "unmasked", column))
    if values.dtype.kind == "O":
        plain = [value.decode("latin-1") if isinstance(value, bytes) else value for value in values.tolist()]
        texts = np.array(["" if value is None else str(value) for value in plain], dtype=np.str_)
    else:
        texts = np.char.decode(values, "latin-1") if values.dtype.kind == "S" else values.astype(np.str_)
    mask = getattr(column, "mask", None)
    return texts if mask is None else np.where(np.asarray(mask), "", texts)


@dataclass(frozen=True)
class Part:
    """One of the tables of a file."""

    name: str
    """Blank where the file gives none."""

    columns: tuple[str, ...]
    read: Callable[[], ColumnTable]

    def header(self) -> ColumnTable:
        """Return a table of the columns, without rows."""
        from astropy.table import Table

        return ColumnTable(Table({name: [] for name in self.columns}))


def read_part(
    parts: Sequence[Part], kind: str, table: str | int | None, wanted: Callable[[ColumnTable], bool] | None
) -> ColumnTable:
    """Read one of the tables of a file; of several, say that others are left out.

    It is that of a name or number, counted from 1; else the first that is wanted (by its columns, without rows), or
    else the first. `kind` is what the file is, for messages: "FITS file".
    """
    if table is not None:
        return parts[_number_of(parts, table)].read()
    if len(parts) == 1:
        return parts[0].read()
    fitting = [number for number, part in enumerate(parts) if wanted is not None and wanted(part.header())]
    chosen = fitting[0] if fitting else 0
    name = f", {parts[chosen].name}," if parts[chosen].name else ""
    others = f"; {len(fitting)} of them would do" if len(fitting) > 1 else ""
    warnings.warn(
        f"the {kind} holds {len(parts)} tables, and only number {chosen + 1}{name} is read{others}; "
        "the argument table, a name or number, takes another",
        stacklevel=2,
    )
    return parts[chosen].read()


def _number_of(parts: Sequence[Part], table: str | int) -> int:
    names = [part.name for part in parts]
    if isinstance(table, int) and not isinstance(table, bool) and 1 <= table <= len(parts):
        return table - 1
    if isinstance(table, str):
        same = [number for number, name in enumerate(names) if name.casefold() == table.strip().casefold()]
        if len(same) == 1:
            return same[0]
        if not same and table.strip().isdecimal():
            return _number_of(parts, int(table))
    known = ", ".join(name for name in names[:20] if name) + (", ..." if len(names) > 20 else "")
    rule = f"must be a number from 1 to {len(parts)}" + (f", or of {known}" if known else "")
    raise InputError(rule, "table", table)
