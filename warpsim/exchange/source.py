"""A text file on the way in: its bytes, its lines with their numbers, XML, and errors that name file and line."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn
from xml.parsers import expat

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import NO_VALUE, InputError, errors_at
from warpsim.exchange.instants import FileInstants, parse_dates
from warpsim.tables.file_bytes import N_HEAD, known_kind, read_bytes, unpacked

_TABLES = {b"SIMPLE  =": "a FITS file", b"PAR1": "a Parquet file"}
"""First bytes of binary tables, which hold neither orbits nor attitudes."""

LARGEST_BYTES = 2**31
"""Bytes of a file, also once it is no longer compressed."""

_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""Marks at the beginning of such text."""

_LINES_ALIKE = 4
"""Lines whose last numbers have as many digits: fewer in the last line of a file are a sign of its being cut off."""

_DEEPEST = 50


@dataclass(frozen=True)
class SourceFile:
    """A file's name and content."""

    file: str
    data: bytes

    @property
    def text(self) -> str:
        """Content as text: UTF-8, UTF-16 with its mark, or Latin-1 in older files."""
        data = self.data.removeprefix(b"\xef\xbb\xbf")
        try:
            return data.decode("utf-16" if data.startswith(_UTF_16) else "utf-8")
        except UnicodeDecodeError:
            return data.decode("latin-1")

    def check_kind(self) -> None:
        """Check that the content is text.

        Raises:
            InputError: It is another kind of file.
        """
        kind = known_kind(self.data)
        kind = kind or next((table for start, table in _TABLES.items() if self.data.startswith(start)), None)
        if kind is None and b"\0" in self.data[:N_HEAD] and not self.data.startswith(_UTF_16):
            kind = "binary data"
        if kind is not None:
            raise self.error(0, f"must be text, got {kind}")

    @property
    def head(self) -> str:
        """The beginning of the text."""
        return SourceFile(self.file, self.data[:N_HEAD]).text

    @property
    def is_xml(self) -> bool:
        """Whether the content begins as XML does."""
        return self.head.lstrip().startswith("<")

    def lines(self) -> list[tuple[int, str]]:
        """Lines that are not blank, stripped, each with its number counted from 1.

        Raises:
            InputError: The last line has no line break, and fewer digits than those before it: a number cut short reads
                as another.
        """
        text = self.text
        found = [(number, line.strip()) for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
        if found and not text.rstrip(" \t\r").endswith("\n"):
            (number, line), before = found[-1], {_digits(line) for _, line in found[-1 - _LINES_ALIKE : -1]}
            if len(found) > _LINES_ALIKE and len(before) == 1 and -1 < _digits(line) < max(before):
                rule = "must have as many digits as the lines before, or a line break: the file may be cut off"
                raise self.error(number, rule, value=line[-30:])
        return found

    def error(self, line: int, rule: str, field: str = "", value: Any = NO_VALUE, form: str = "") -> InputError:
        """The error to raise about a line, or a field on it; line 0 means the file as a whole."""
        return self.located(InputError(rule, field, value, form), line)

    def located(self, error: InputError, line: int) -> InputError:
        """Return the error with a line of this file; line 0 means the file as a whole."""
        return error.of(f"line {line}" if line else "").of(self.file)

    @contextlib.contextmanager
    def at(self, line: int, field: str = "") -> Iterator[None]:
        """Put file, line and a field's name before the errors raised inside."""
        with errors_at("", self.file), errors_at("", f"line {line}" if line else ""), errors_at(field):
            yield


def _digits(line: str) -> int:
    """Digits behind the point of the number that ends a line; -1 where none does."""
    match = re.search(r"(?<![^\s,;])[-+]?\d*(?:\.(\d*))?$", line)
    return -1 if match is None or not match[0] else len(match[1] or "")


def read_source(path: str | os.PathLike[str]) -> SourceFile:
    """Read a file, which must not be empty."""
    file = os.fspath(path)
    with errors_at("", file):
        data = unpacked(read_bytes(Path(file)), LARGEST_BYTES)
        if not data.strip():
            raise InputError("must hold data, got an empty file")
    return SourceFile(file, data)


@dataclass
class Rows:
    """Rows of a table of numbers: cells and line numbers."""

    source: SourceFile
    cells: list[list[str]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def add(self, line: int, cells: list[str]) -> None:
        """Add a row."""
        self.cells.append(cells)
        self.lines.append(line)

    def check(self, count: int, what: str) -> None:
        """Raise unless every row has so many cells."""
        for row, line in zip(self.cells, self.lines, strict=True):
            if len(row) != count:
                before = "" if row is self.cells[0] else " as the line before"
                raise self.source.error(line, f"must have {count} values ({what}){before}", value=len(row))

    def numbers(self, first: int, count: int) -> F64:
        """Numbers in columns first to first + count, (n, count); all must be finite."""
        try:
            values = np.array([[float(cell) for cell in row[first : first + count]] for row in self.cells], np.float64)
            good = np.isfinite(values).all() and not any("_" in cell for row in self.cells for cell in row[first:])
        except ValueError:
            good = False
        if good:
            return values.reshape(len(self.cells), count)
        for row, line in zip(self.cells, self.lines, strict=True):
            for cell in row[first : first + count]:
                number_of(self.source, line, cell)
        raise self.source.error(self.lines[0] if self.lines else 0, "must hold numbers")

    def dates(self, system: str) -> FileInstants:
        """The instants of the dates that begin the rows."""
        return dates_of(self.source, [row[0] if row else "" for row in self.cells], self.lines, system)


def number_of(source: SourceFile, line: int, text: str, field: str = "") -> float:
    """One finite number."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or "_" in text:
        raise source.error(line, "must be a finite number", field, text[:40])
    return value


def dates_of(
    source: SourceFile, texts: Sequence[str], lines: Sequence[int], system: str, field: str = ""
) -> FileInstants:
    """Instants of dates that stand on these lines."""
    try:
        return parse_dates(texts, system)
    except InputError as error:
        raise error.within(field).at_row(f"line {lines[error.row or 0]}").of(source.file) from None


class Keywords:
    """Values by keyword, with their lines, of a part of a file that begins at `line`."""

    def __init__(self, source: SourceFile, line: int = 0) -> None:
        self.source, self.line = source, line
        self._given: dict[str, tuple[str, int]] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(self._given)

    def add(self, keyword: str, text: str, line: int) -> None:
        """Add a keyword that is not there yet."""
        if keyword in self._given:
            raise self.source.error(line, "must stand once, got it a second time", keyword)
        self._given[keyword] = text, line

    def need(self, *keywords: str, part: str = "") -> None:
        """Raise unless the part of the file has these."""
        if missing := [keyword for keyword in keywords if keyword not in self._given]:
            raise self.source.error(self.line, f"must have {', '.join(missing)}", part)

    def text(self, keyword: str, otherwise: str = "") -> str:
        """The value of a keyword; `otherwise` where it is not given."""
        return self._given.get(keyword, (otherwise, 0))[0]

    def line_of(self, keyword: str) -> int:
        """The line of a keyword; 0 where it is not given."""
        return self._given.get(keyword, ("", 0))[1]

    def error(self, keyword: str, rule: str, value: Any = NO_VALUE, field: str = "") -> InputError:
        """The error to raise about the line of a keyword, which the message may call `field`."""
        return self.source.error(self.line_of(keyword), rule, field or keyword, value)

    def one_of(self, keyword: str, known: Sequence[str], otherwise: str = "") -> str:
        """The value of a keyword, which must be a known one in any case; `otherwise` where it is not given."""
        if keyword not in self._given:
            return otherwise
        text = self.text(keyword)
        for one in known:
            if text.upper() == one.upper():
                return one
        allowed = " or ".join(known) if len(known) < 3 else f"one of {', '.join(known)}"
        raise self.error(keyword, f"must be {allowed}", text)

    def whole_number(self, keyword: str) -> int | None:
        """A whole number; None where it is not given."""
        if keyword not in self._given:
            return None
        text = self.text(keyword)
        if not (text.isascii() and text.isdigit() and len(text) < 12):
            raise self.error(keyword, "must be a whole number", text[:40])
        return int(text)

    def date(self, keyword: str, system: str) -> FileInstants:
        """The instant of a date."""
        return dates_of(self.source, [self.text(keyword)], [self.line_of(keyword)], system, keyword)


@dataclass
class Element:
    """An element, with the line it begins on; names are without their namespace."""

    tag: str
    line: int
    attributes: dict[str, str]
    text: str = ""
    children: list[Element] = field(default_factory=list)

    def find(self, tag: str) -> list[Element]:
        """Children of that name."""
        return [child for child in self.children if child.tag == tag]

    def leaves(self) -> list[Element]:
        """Elements without children, in order."""
        if not self.children:
            return [self]
        return [leaf for child in self.children for leaf in child.leaves()]


def read_xml(data: bytes | str) -> Element:
    """The root element of a document; errors of what is not valid, or not plain, know the line."""
    parser = expat.ParserCreate()
    open_elements = [Element("", 1, {})]

    def fail(line: int, rule: str) -> NoReturn:
        raise InputError(rule).of("XML").of(f"line {line}")

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > _DEEPEST:
            fail(parser.CurrentLineNumber, "must not be nested so deeply")
        element = Element(tag.rpartition(":")[2], parser.CurrentLineNumber, attributes)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def characters(text: str) -> None:
        open_elements[-1].text += text

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = lambda *_: fail(parser.CurrentLineNumber, "must have no document type of its own")
    try:
        parser.Parse(data, True)
    except InputError:  # of a handler
        raise
    except expat.ExpatError as error:
        fail(error.lineno, f"{expat.errors.messages[error.code]} (the file may be cut off)")
    except (LookupError, ValueError) as error:  # an unknown encoding
        fail(1, str(error))
    return open_elements[0].children[0]
