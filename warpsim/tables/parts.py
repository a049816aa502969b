"""The tables of a file that holds several: their names and columns, none of them read but the one that is wanted."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from warpsim.errors import InputError
from warpsim.tables.columns import ColumnTable


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

    Args:
        parts: One or more.
        kind: What the file is, for messages: "FITS file".
        table: Name or number, counted from 1, of the one to read; None for the first that is wanted, or else the first.
        wanted: Whether a table of such columns, given without rows, is one to read.

    Raises:
        InputError: There is no table of that name or number, or it cannot be read.
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
