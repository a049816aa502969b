"""The table of a file: columns found by forgiving names, and errors that say on which line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.tables.cells import MISSING, is_number
from warpsim.tables.columns import ColumnTable

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]


class FileTable(ColumnTable):
    """A table from a file: like ColumnTable, and its errors name the line."""

    def __init__(self, table: Table, line_of_row: NDArray[np.int64] | None = None, layout: str | None = None) -> None:
        super().__init__(_with_plain_columns(table))
        self.line_of_row = line_of_row
        """Line of each row in a text file, counted from 1; None where rows have none."""

        self.layout = layout
        """Name of the byte layout that the file follows, if any."""

        self.open_end: InputError | None = None
        """The error of a last line that no line break closes; None where it is closed, or known to be whole."""

    def where(self, row: int) -> str:
        """Location of a row: "line 3", or "row 2" of a file without lines (counted from 0)."""
        return f"row {row}" if self.line_of_row is None else f"line {self.line_of_row[row]}"

    def number(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> Array:
        """Like ColumnTable.number(); numbers that stand as text are read, and the first that is none is named.

        Raises:
            InputError: A value is no number, or the column is in a unit that does not convert.
        """
        name = self.find(*names)
        if name is not None and self.table[name].dtype.kind == "U":
            numbers = self._numbers_of_text(name)
            stated = self.table[name].unit
            self.table.replace_column(name, self.table.Column(numbers, unit=stated))
        return super().number(*names, unit=unit, null=null)

    def located(self, error: InputError, rows: NDArray[np.int64] | None = None) -> InputError:
        """The error of a check of whole columns, with the line of the row in the file if it is about one.

        Args:
            error: What the check raised.
            rows: Rows of this table that the columns were made of; all of them if left out.
        """
        if error.row is None:
            return error
        return error.at_row(self.where(error.row if rows is None else int(rows[error.row])))

    def _numbers_of_text(self, name: str) -> Array:
        """Numbers of a column of text, NaN where a text stands for a missing value."""
        texts = np.char.strip(np.asarray(self.table[name]).astype(np.str_))
        values = np.full(len(texts), np.nan)
        given = ~np.isin(np.char.lower(texts), MISSING)
        try:
            values[given] = texts[given].astype(np.float64)
        except ValueError:
            row = next(row for row in np.flatnonzero(given).tolist() if not is_number(str(texts[row])))
            error = InputError("must be a number", value=str(texts[row])).of(f"column {name}")
            raise error.of(self.where(row)) from None
        return values


def _with_plain_columns(table: Table) -> Table:
    """The table with its texts as plain columns, "" where masked: formats give bytes, objects or masked texts."""
    for name in table.colnames:
        column: Any = table[name]
        if getattr(column, "dtype", None) is None or column.dtype.kind not in "SUO":
            continue
        masked = np.zeros(len(column), dtype=bool) if getattr(column, "mask", None) is None else np.asarray(column.mask)
        if column.dtype.kind == "O":
            texts = np.array(["" if gone or value is None else str(value)
                              for value, gone in zip(column, masked, strict=True)], dtype=np.str_)  # fmt: skip
        else:
            plain = np.asarray(getattr(column, "unmasked", column))
            texts = np.char.decode(plain, "latin-1") if column.dtype.kind == "S" else plain.astype(np.str_)
            texts = np.where(masked, "", texts)
        table.replace_column(name, table.Column(texts, unit=column.unit))
    return table
