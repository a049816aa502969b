"""Text tables whose first line names the columns: CSV and its kin, and the tab-separated text of VizieR."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.tables.astropy_calls import cds_unit, quietly
from warpsim.tables.cells import cells_of, decoded, is_number
from warpsim.tables.lines import Lines, lines_of

if TYPE_CHECKING:
    from astropy.table import Table

_DELIMITERS = ("\t", ",", ";", "|")
_BLANKS_AT_TAB = re.compile(r" *\t *")
_DASHES = re.compile(r"^[\s-]*-[\s-]*$")


def read_delimited(data: bytes, delimiter: str | None = None) -> tuple[Table, NDArray[np.int64]]:
    """Table of delimited text; lines that begin with # are comments, a line of units and one of dashes may follow.

    Args:
        data: The file's content.
        delimiter: Delimiter of the columns; None guesses by the header.

    Returns:
        The table, and the line of each row, counted from 1.

    Raises:
        InputError: The first line names no columns, or a line has more or fewer cells than it.
    """
    lines = lines_of(data.removeprefix(b"\xef\xbb\xbf"), skip=(b"#",))
    header = decoded(lines.text[0]) if len(lines) else ""
    parted_by = delimiter or _delimiter_of(header)
    if not len(lines) or parted_by is None or not names_columns(header, parted_by):
        shown = header.strip()[:40]
        raise InputError(f"cannot be read as a table: no line names its columns, the first is {shown!r}")
    first = 1
    units: tuple[str, ...] = ()
    for number in (1, 2):
        if number < len(lines) and _DASHES.match(decoded(lines.text[number]).replace(parted_by, " ")):
            units = tuple(cells_of(decoded(lines.text[1]), parted_by)) if number == 2 else ()
            first = number + 1
            break
    names = cells_of(header, parted_by)
    rows = [decoded(line) for line in lines.text[first:]]
    line_of_row = lines.number[first:]
    check_cells(rows, line_of_row, parted_by, len(names))
    table = _table_of(header, rows, parted_by)
    comments = [decoded(line) for line in data.split(b"\n", 200)[:200] if line.startswith(b"#")]
    if comments:
        table.meta["comments"] = comments
    _check_hidden_rows(data, lines, parted_by, len(names))
    for name, unit in zip(table.colnames, units, strict=False):
        if unit.strip():
            table[name].unit = cds_unit(unit)
    return table, line_of_row


def names_columns(line: str, delimiter: str | None = None) -> bool:
    """Return whether a line looks like the names of two columns or more: cells that are neither blank nor numbers."""
    parted_by = delimiter or _delimiter_of(line)
    cells = [cell.strip() for cell in cells_of(line, parted_by)] if parted_by else []
    return len(cells) >= 2 and all(cell and not is_number(cell) for cell in cells)


def _check_hidden_rows(data: bytes, lines: Lines, delimiter: str, n_cell: int) -> None:
    """Warn about lines behind the header that begin with # and have a row's cells: comments, or rows by mistake."""
    found = [
        number
        for number, line in enumerate(data.split(b"\n"), start=1)
        if line.startswith(b"#") and number > lines.number[0] and len(cells_of(decoded(line), delimiter)) == n_cell
    ]
    if found and n_cell > 1:
        shown = ", ".join(map(str, found[:5])) + (", ..." if len(found) > 5 else "")
        warnings.warn(
            f"{len(found)} lines that look like rows begin with # and are left out (lines {shown})", stacklevel=2
        )


def check_cells(rows: Sequence[str], line_of_row: NDArray[np.int64], delimiter: str, n_cell: int) -> None:
    """Raise for the first row that has more or fewer cells than n_cell, or that begins a second table."""
    for row, line in enumerate(rows):
        n_found = len(cells_of(line, delimiter)) if '"' in line or delimiter == " " else line.count(delimiter) + 1
        if n_found != n_cell:
            raise InputError(f"must have {n_cell} columns", value=n_found).of(f"line {line_of_row[row]}")
        if line.startswith("-") and _DASHES.match(line.replace(delimiter, " ")):
            raise InputError("must be a row, got a line of dashes (a second table?)").of(f"line {line_of_row[row]}")


def _delimiter_of(header: str) -> str | None:
    """Delimiter of a header: the most frequent delimiter, blanks if there is none."""
    counts = [header.count(delimiter) for delimiter in _DELIMITERS]
    if any(counts):
        return _DELIMITERS[int(np.argmax(counts))]
    return " " if len(header.split()) > 1 else None


def _table_of(header: str, rows: Sequence[str], delimiter: str) -> Table:
    from astropy.io import ascii

    names = [cell.strip() for cell in cells_of(header, delimiter)]
    doubled = {name for name in names if names.count(name) > 1}
    if doubled:
        raise InputError(f"must have columns of different names, got {', '.join(sorted(doubled))} twice")
    if delimiter == "\t":
        # To astropy's reader of CSV a tab is a blank: it passes over a cell of blanks, and the next cells move up.
        lines = [line if '"' in line else _BLANKS_AT_TAB.sub("\t", line.strip(" ")) for line in (header, *rows)]
        return quietly(lambda: ascii.read(lines, format="tab", guess=False), "text")
    style = "basic" if delimiter == " " else "csv"
    return quietly(lambda: ascii.read([header, *rows], format=style, delimiter=delimiter, guess=False), "text")
