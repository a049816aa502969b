"""Tables whose columns are bytes of a line: layouts, which layout a file follows, and fast parsing.

A layout says what stands in which bytes, counted from 1 as the CDS does. Layouts come from the caller, or are read from
the description that the CDS and the AAS journals put beside a table ("Byte-by-byte ...").
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.tables.by_astropy import cds_unit
from warpsim.tables.columns import ColumnTable, is_number
from warpsim.tables.text import Lines

_BLANK = 32
_NUMBER_BYTES = np.zeros(256, dtype=bool)
_NUMBER_BYTES[list(b" 0123456789+-.eE")] = True
"""Bytes a number may hold; float() alone also takes "nan", "inf" and "1_0"."""

_UNSIGNED = frozenset({"RAh", "RAm", "RAs", "RAds", "DEd", "DEm", "DEs"})
"""Parts of an angle, whose sign stands in a byte of its own; the names say the units."""

_TITLE = re.compile(r"^\s*Byte-(?:by|per)-byte Description of file:(?P<files>.*)$", re.IGNORECASE)
_ROW = re.compile(
    r"^\s*(?:(?P<first>\d+)\s*-)?\s*(?P<last>\d+)\s+(?P<format>[AIFEDL])\d+(?:\.\d+)?\s+(?P<unit>\S+)"
    r"\s+(?P<name>\S+)(?P<null>\s+\*?\s*(?:[\[\]]\S*[\[\]])?\s*\?(?:=(?P<null_value>\S+))?)?"
)
_RULE = re.compile(r"^[-=]{20,}\s*$")
_LONGEST_LINE = 100_000

N_SAMPLE = 50
"""Lines looked at to recognise a layout."""


@dataclass(frozen=True)
class ByteField:
    """One column: its bytes and their type."""

    name: str
    first_byte: int
    """First byte, counted from 1."""

    last_byte: int
    """Last byte, included."""

    kind: Literal["number", "whole", "text", "sign"] = "number"
    """"whole" is a whole number, "sign" is +, - or blank."""

    unit: str = ""
    null: float | None = None
    """A number that stands for a missing one; a blank always does."""

    largest: float = np.inf
    """No number is larger in size; parts of an angle (_UNSIGNED) are not negative either."""

    @property
    def label(self) -> str:
        """Label for messages: "column RAs (bytes 26-31)"."""
        first, last = self.first_byte, self.last_byte
        return f"column {self.name} ({f'byte {first}' if first == last else f'bytes {first}-{last}'})"


@dataclass(frozen=True)
class Layout:
    """Byte layout of a line."""

    fields: tuple[ByteField, ...]

    shortest: int
    """Bytes that every line has."""

    length: int
    """Bytes of a complete line: a last line without a line break must have them."""

    longest: int = 10**6
    marks: tuple[tuple[int, str], ...] = ()
    """Bytes that must hold a given character; they distinguish the layout."""

    name: str | None = None
    """What it is the layout of."""


def recognised(lines: Lines, layouts: Sequence[Layout]) -> Layout | None:
    """The layout that most of the first lines follow, at least half of them; None if there is none."""
    sample = lines.text[:N_SAMPLE]
    best, most = None, 0.0
    for layout in layouts:
        fraction = sum(_follows(line, layout) for line in sample) / max(len(sample), 1)
        if fraction >= 0.5 and fraction > most:
            best, most = layout, fraction
    return best


def read_fixed_width(lines: Lines, layout: Layout) -> ColumnTable:
    """Table of the layout's columns, with their units; blanks and nulls are NaN or masked.

    Errors name line, column and bytes.
    """
    from astropy.table import MaskedColumn, Table

    _check_lengths(lines, layout)
    chars = _characters(lines, layout)
    table = Table()
    for field in layout.fields:
        values = _values(chars, field, lines)
        if field.kind == "whole":
            missing = np.isnan(values)
            whole = np.where(missing, 0.0, values).astype(np.int64)
            table[field.name] = MaskedColumn(whole, mask=missing) if missing.any() else whole
        else:
            table[field.name] = values
        if field.unit:
            table[field.name].unit = cds_unit(field.unit)
    return ColumnTable(table, lines.number, layout.name)


def layout_from_readme(text: str, file_name: str) -> Layout:
    """Layout of a file as the text of a CDS ReadMe describes it; columns without a name are not read."""
    sections: list[tuple[list[str], list[re.Match[str]]]] = []
    for line in text.splitlines():
        if title := _TITLE.match(line):
            sections.append((title["files"].replace(",", " ").split(), []))
        elif (row := _ROW.match(line)) and sections:
            sections[-1][1].append(row)
    sections = [section for section in sections if section[1]]
    if not sections:
        raise InputError("must hold a byte-by-byte description")
    described = [name for names, _ in sections for name in names]
    fitting = [rows for names, rows in sections if any(fnmatch.fnmatch(file_name, name) for name in names)]
    if not fitting and len(sections) > 1:
        raise InputError(f"must describe {file_name}", value=", ".join(described), form="s")
    rows = [row for row in (fitting or [sections[0][1]])[0] if row["name"] != "---"]
    fields = tuple(map(_described_field, rows))
    # Texts, and numbers that may be blank, may be missing at the end of a line.
    needed = [
        field.last_byte for field, row in zip(fields, rows, strict=True) if field.kind != "text" and not row["null"]
    ]
    return Layout(fields, shortest=max(needed, default=1), length=max(field.last_byte for field in fields))


def n_description(text: str) -> int | None:
    """Number of lines before the data of a table that holds its own description; None if it holds none."""
    lines = text.split("\n")
    if not any(_TITLE.match(line) for line in lines[:2000]):
        return None
    return max((number for number, line in enumerate(lines, start=1) if _RULE.match(line)), default=None)


def _described_field(row: re.Match[str]) -> ByteField:
    """Column of a line of a ReadMe."""
    kinds: dict[str, Literal["number", "whole", "text"]] = {"A": "text", "L": "text", "I": "whole"}
    kind = kinds.get(row["format"], "number")
    unit = "" if row["unit"] == "---" or row["name"] in _UNSIGNED or kind == "text" else row["unit"]
    null = row["null_value"] or ""
    last = int(row["last"])
    first = int(row["first"] or last)
    if not 1 <= first <= last <= _LONGEST_LINE:
        rule = f"bytes must grow from 1 to at most {_LONGEST_LINE}, got {first}-{last}"
        raise InputError(rule).of(f"column {row['name']}")
    # A null may also be written in dashes, or as a text.
    return ByteField(row["name"], first, last, kind, unit, float(null) if is_number(null) else None)


def _follows(line: bytes, layout: Layout) -> bool:
    """Return whether a line has the layout's length, marks and numbers, a number in at least half of its columns."""
    if not layout.shortest <= len(line) <= layout.longest:
        return False
    if any(chr(line[byte - 1]) != mark for byte, mark in layout.marks):
        return False
    one = Lines([line], np.ones(1, dtype=np.int64), True)
    chars = _characters(one, layout)
    try:
        columns = [_values(chars, field, one) for field in layout.fields if field.kind != "text"]
    except InputError:
        return False
    numbers = [values for values in columns if values.dtype.kind == "f"]
    return 2 * sum(bool(np.isfinite(values[0])) for values in numbers) >= len(numbers)


def _check_lengths(lines: Lines, layout: Layout) -> None:
    length = np.array([len(line) for line in lines.text], dtype=np.int64)
    short = np.flatnonzero(length < layout.shortest)
    if short.size:
        row = int(short[0])
        raise InputError(f"must have {layout.shortest} bytes", value=length[row]).of(f"line {lines.number[row]}")
    for n_byte in np.unique(length[length < layout.length]).tolist():
        for field in layout.fields:
            if field.first_byte <= n_byte < field.last_byte and field.kind in ("number", "whole"):
                line = lines.number[int(np.flatnonzero(length == n_byte)[0])]
                raise InputError(f"must be complete, got {n_byte} bytes").of(field.label).of(f"line {line}")
    if len(lines) and not lines.ends_with_break:
        # Without a line break the file may have been cut anywhere; other lines may give the length of one.
        complete = min([layout.length, *length[:-1].tolist()])
        if length[-1] < complete:
            raise InputError(f"the file ends in the middle of a line, at {length[-1]} of {complete} bytes").of(
                f"line {lines.number[-1]}"
            )


def _characters(lines: Lines, layout: Layout) -> NDArray[np.uint8]:
    """Bytes of the lines, shape (n, width), padded with blanks to the layout's width."""
    width = max(field.last_byte for field in layout.fields)
    packed = np.array([line[:width] for line in lines.text] or [b""], dtype=f"S{width}")[: len(lines)]
    chars = packed.view(np.uint8).reshape(len(lines), width)
    return np.where(chars == 0, _BLANK, chars).astype(np.uint8)  # numpy pads with zeros


def _values(chars: NDArray[np.uint8], field: ByteField, lines: Lines) -> NDArray[Any]:
    """One column, shape (n,): float64 with NaN for missing, or text without blanks at the ends."""
    block = np.ascontiguousarray(chars[:, field.first_byte - 1 : field.last_byte])
    text = block.view(f"S{block.shape[1]}")[:, 0]

    def check(good: NDArray[np.bool_], rule: str) -> None:
        if not good.all():
            row = int(np.argmin(good))
            error = InputError(f"must be {rule}", value=text[row].decode("latin-1").strip())
            raise error.of(field.label).of(f"line {lines.number[row]}")

    if field.kind in ("text", "sign"):
        if field.kind == "sign":
            check(np.isin(text, (b"+", b"-", b" ", b"")), "+ or -")
        return np.char.strip(np.char.decode(text, "latin-1"))
    values = np.full(len(text), np.nan)
    given = ~(block == _BLANK).all(axis=1)
    check(np.asarray(_NUMBER_BYTES[block].all(axis=1)), "a number")
    try:
        values[given] = text[given].astype(np.float64)
    except ValueError:
        check(np.array([is_number(cell) for cell in text.tolist()]) | ~given, "a number")
        raise
    if field.null is not None:
        values[values == field.null] = np.nan
    smallest = 0.0 if field.name in _UNSIGNED else -field.largest
    check(~((values > field.largest) | (values < smallest)), f"in [{smallest:g}, {field.largest:g}]")
    if field.kind == "whole":
        check(np.asarray(np.isnan(values) | (values == np.round(values))), "a whole number")
    return values
