"""Tables of text with names of columns: CSV and its kin, tab-separated text of VizieR, ECSV, IPAC; read by astropy."""

from __future__ import annotations

import csv
import functools
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.tables.by_astropy import cds_unit, quietly
from warpsim.tables.columns import ColumnTable, Part, is_number

_DELIMITERS = ("\t", ",", ";", "|")
_BLANKS_AT_TAB = re.compile(r" *\t *")
_DASHES = re.compile(r"[\s-]*-[\s-]*")
_NULLS = [(text, "0") for text in ("null", "NULL", "")]
"""What stands for a missing value in ECSV: "null" in Gaia's bulk files."""

_RAGGED = re.compile(r"Number of header columns \((?P<n>\d+)\).* data line (?P<row>\d+)")
_NO_NUMBER = re.compile(r"[Cc]olumn '?(?P<name>.+?)'? failed to convert: .*: '(?P<value>.*)'$")
"""What astropy says of a row with more or fewer cells than there are columns, and of a cell that is no number."""


@dataclass(frozen=True)
class Lines:
    """Lines of a text that hold data, without their line breaks."""

    text: Sequence[bytes]
    number: NDArray[np.int64]
    """Line number of each in the file, counted from 1, shape (n,)."""

    ends_with_break: bool
    """Whether the last of them is closed by a line break."""

    def __len__(self) -> int:
        return len(self.text)

    def after(self, n_line: int) -> Lines:
        """Lines behind the first n_line of the file."""
        first = int((self.number <= n_line).sum())
        return Lines(self.text[first:], self.number[first:], self.ends_with_break)

    def until(self, n_line: int) -> Lines:
        """Lines among the first n_line of the file; if others follow, the last is closed."""
        stop = int((self.number <= n_line).sum())
        return Lines(self.text[:stop], self.number[:stop], self.ends_with_break or stop < len(self))

    def open_end(self) -> InputError | None:
        """The error of a last line that no line break closes: a number cut short would read as another number."""
        if not len(self) or self.ends_with_break:
            return None
        shown = decoded(self.text[-1]).strip()[-30:]
        error = InputError("must end with a line break, or the file may be cut off", value=shown)
        return error.of(f"line {self.number[-1]}")

    def check_end(self) -> None:
        """Raise unless the last line is closed by a line break."""
        if error := self.open_end():
            raise error


def lines_of(data: bytes, skip: tuple[bytes, ...] = ()) -> Lines:
    """Lines of a file that are neither blank nor begin with one of `skip`."""
    rows = data.split(b"\n")
    kept, numbers = [], []
    for number, row in enumerate(rows, start=1):
        line = row.removesuffix(b"\r")
        if line.strip() and not line.startswith(skip):
            kept.append(line)
            numbers.append(number)
    ends_with_break = not numbers or numbers[-1] < len(rows)
    return Lines(kept, np.array(numbers, dtype=np.int64), ends_with_break)


def decoded(line: bytes) -> str:
    """Text of a line: UTF-8, or Latin-1 in older files."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


_TABLE = re.compile(rb"^#Table[ \t]+([^\s:]+):?[ \t]*\r?$")
"""The line with which VizieR begins each of several tables."""


def delimited_tables(data: bytes, delimiter: str | None = None, *, equal_names: bool = True) -> list[Part]:
    """The tables of a text: comments begin with #, a line of units and one of dashes may follow that of names.

    There are several where VizieR gives them one below the other.
    """
    lines = lines_of(data.removeprefix(b"\xef\xbb\xbf"), skip=(b"#",))
    comments = [(n, line) for n, line in enumerate(data.split(b"\n"), start=1) if line.startswith(b"#")]
    starts = [(n, match[1].decode("latin-1")) for n, line in comments if (match := _TABLE.match(line))]
    ends = [n - 1 for n, _ in starts[1:]] + [max(len(data), 1)]
    found: list[tuple[str, Lines, list[tuple[int, bytes]]]] = []
    for (start, name), end in zip(starts, ends, strict=False):
        rows = lines.after(start).until(end)
        if len(rows):
            found.append((name, rows, [(n, line) for n, line in comments if n < starts[0][0] or start <= n <= end]))
    if len(found) < 2 or len(lines.until(starts[0][0])):
        found = [("", lines, comments)]
    parts = []
    for name, rows, header in found:
        names: list[str] = []
        if len(found) > 1:  # of one table alone they are not asked for, and it may have no line of names
            line = decoded(rows.text[0])
            names = unlike(cell.strip() for cell in _cells_of(line, delimiter or _delimiter_of(line) or " "))
        read = functools.partial(_read_delimited, rows, header, delimiter, equal_names)
        parts.append(Part(name, tuple(names), read))
    return parts


def read_delimited(data: bytes) -> ColumnTable:
    """Read the table of a text that holds one, or the first of several; columns of equal names are an error."""
    return delimited_tables(data, equal_names=False)[0].read()


def _read_delimited(
    lines: Lines, comments: list[tuple[int, bytes]], delimiter: str | None, equal_names: bool
) -> ColumnTable:
    header = decoded(lines.text[0]) if len(lines) else ""
    delimiter = delimiter or _delimiter_of(header)
    if delimiter is None or not names_columns(header, delimiter):
        shown = header.strip()[:40]
        raise InputError(f"cannot be read as a table: no line names its columns, the first is {shown!r}")
    given = [cell.strip() for cell in _cells_of(header, delimiter)]
    names = unlike(given)
    if names != given:
        if not equal_names:
            doubled = sorted({name for name in given if given.count(name) > 1})
            raise InputError(f"must have columns of different names, got {', '.join(doubled)} twice")
        text = ", ".join(f"{name} is {new}" for name, new in zip(given, names, strict=True) if name != new)
        warnings.warn(f"columns of equal names: the first keeps it, the next {text}", stacklevel=2)
        header = delimiter.join(f'"{name}"' if delimiter in name else name for name in names)
    head = [decoded(line).replace(delimiter, " ") for line in lines.text[:3]]
    n_head = next((row + 1 for row in range(1, len(head)) if _DASHES.fullmatch(head[row])), 1)
    body = lines.after(int(lines.number[n_head - 1]))
    table = _read_rows(lambda rows: _by_astropy([header, *rows], delimiter), "text", body, delimiter)
    if comments:
        table.table.meta["comments"] = [decoded(line) for _, line in comments]
        table.header = "\n".join(table.table.meta["comments"])
    _warn_of_hidden_rows(comments, lines, delimiter, len(names))
    units = _cells_of(decoded(lines.text[1]), delimiter) if n_head == 3 else []
    for name, unit in zip(names, units, strict=False):
        if unit.strip():
            table.table[name].unit = cds_unit(unit)
    table.open_end = lines.open_end()
    return table


def unlike(names: Iterable[str]) -> list[str]:
    """Return names with a number behind all but the first of equal ones: ra, dec, ra_2."""
    found: list[str] = []
    for name in names:
        number, new = 2, name
        while name and new in found:
            new, number = f"{name}_{number}", number + 1
        found.append(new)
    return found


def read_ecsv(data: bytes) -> ColumnTable:
    """Table of an ECSV file."""
    from astropy.table import Table

    lines = lines_of(data, skip=(b"#",))
    lines.check_end()
    if not len(lines):
        raise InputError("ends early: the ECSV header names columns, but no line with their names follows")
    text = data.decode("utf-8", errors="replace").split("\n")
    delimiter = "," if re.search(rb"^#\s*delimiter:\s*'?,", data[:100_000], re.MULTILINE) else " "
    body = lines.after(int(lines.number[0]))
    return _read_rows(lambda _: Table.read(text, format="ascii.ecsv", fill_values=_NULLS), "ECSV", body, delimiter)


def read_ipac(data: bytes) -> ColumnTable:
    """Table of an IPAC file."""
    from astropy.table import Table

    body = lines_of(data, skip=(b"\\", b"|"))
    header = [line for line in lines_of(data, skip=(b"\\",)).text if line.startswith(b"|")]
    if len(header) < 2 or header[0].count(b"|") < 3:
        rule = "two lines of names and types between bars must begin it"
        raise InputError(f"cannot be read as a table: IPAC table: {rule}")
    (body if len(body) else lines_of(data)).check_end()
    last_bar = header[0].rfind(b"|", 0, header[0].rfind(b"|"))
    for number, row in zip(body.number.tolist(), body.text, strict=True):
        if len(row) <= last_bar:  # a stripped last column may be shorter than its title
            text = f"must reach the last column, which begins at byte {last_bar + 2}, got {len(row)} bytes"
            raise InputError(text).of(f"line {number}")
    whole = data.decode("utf-8", errors="replace").split("\n")
    return _read_rows(lambda _: Table.read(whole, format="ascii.ipac"), "IPAC table", body, "|")


def names_columns(line: str, delimiter: str | None = None) -> bool:
    """Return whether a line looks like the names of two columns or more: cells that are neither blank nor numbers."""
    delimiter = delimiter or _delimiter_of(line)
    cells = [cell.strip() for cell in _cells_of(line, delimiter)] if delimiter else []
    return len(cells) >= 2 and all(cell and not is_number(cell) for cell in cells)


def _read_rows(read: Callable[[list[str]], Any], what: str, body: Lines, delimiter: str) -> ColumnTable:
    """Table that astropy reads; what it says of a row is said of the line in the file."""
    rows = [decoded(line) for line in body.text]
    for text, number in zip(rows, body.number, strict=True):
        if "\r" in text.rstrip("\r"):  # where astropy would begin another row
            raise InputError("must not hold a carriage return but at its end").of(f"line {number}")
    try:
        return ColumnTable(quietly(lambda: read(rows), what), body.number)
    except InputError as error:
        if found := _RAGGED.search(error.rule):
            row = int(found["row"])
            ragged = InputError(f"must have {found['n']} columns", value=len(_cells_of(rows[row], delimiter)))
            raise ragged.of(f"line {body.number[row]}") from None
        if found := _NO_NUMBER.search(error.rule):
            no_number = InputError("must be a number", value=found["value"]).of(f"column {found['name']}")
            lines = [number for number, row in zip(body.number, rows, strict=True) if found["value"] in row]
            raise (no_number.of(f"line {lines[0]}") if len(lines) == 1 else no_number) from None
        raise


def _by_astropy(lines: list[str], delimiter: str) -> Any:
    from astropy.io import ascii

    if delimiter != "\t":
        return ascii.read(lines, format="basic", delimiter=delimiter, guess=False)
    # A tab is a blank to astropy's other readers: they pass over a cell of blanks, and the next cells move up.
    stripped = [line if '"' in line else _BLANKS_AT_TAB.sub("\t", line.strip(" ")) for line in lines]
    return ascii.read(stripped, format="tab", guess=False)


def _cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line; quoted cells may hold the delimiter."""
    if '"' not in line:
        return line.split() if delimiter == " " else line.split(delimiter)
    text = line.strip() if delimiter == " " else line
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=delimiter != "\t"))
    except (csv.Error, StopIteration):  # control characters: no row of a table
        return [text]


def _delimiter_of(header: str) -> str | None:
    """Delimiter of a header: the most frequent delimiter, blanks if there is none."""
    counts = [header.count(delimiter) for delimiter in _DELIMITERS]
    if any(counts):
        return _DELIMITERS[int(np.argmax(counts))]
    return " " if len(header.split()) > 1 else None


def _warn_of_hidden_rows(comments: list[tuple[int, bytes]], lines: Lines, delimiter: str, n_cell: int) -> None:
    """Warn about comments behind the header that have a row's cells: rows by mistake, maybe."""
    found = [
        number
        for number, line in comments
        if number > lines.number[0] and len(_cells_of(decoded(line), delimiter)) == n_cell
    ]
    if found:
        shown = ", ".join(map(str, found[:5])) + (", ..." if len(found) > 5 else "")
        warnings.warn(
            f"{len(found)} lines that look like rows begin with # and are left out (lines {shown})", stacklevel=2
        )
