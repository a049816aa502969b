"""A text file on the way in: its bytes, its lines with their numbers, XML, and errors that name file and line."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import NO_VALUE, InputError
from warpsim.exchange.instants import FileInstants, parse_dates

F64 = NDArray[np.float64]

_END_OF_BLOCK = re.compile(r"(?i:END\s+(Ephemeris|Attitude))|DATA_STOP|COVARIANCE_STOP")

_DEEPEST = 50


@dataclass(frozen=True)
class SourceFile:
    """A file's name and content."""

    file: str
    data: bytes

    @property
    def text(self) -> str:
        """Content as text: UTF-8, or Latin-1 in older files."""
        data = self.data.removeprefix(b"\xef\xbb\xbf")
        try:
            return data.decode("utf-8")
        except UnicodeDecodeError:
            return data.decode("latin-1")

    @property
    def is_xml(self) -> bool:
        """Whether the content begins as XML does."""
        return self.data[:4096].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")

    def lines(self) -> list[tuple[int, str]]:
        """Lines that are not blank, stripped, each with its number counted from 1.

        Raises:
            InputError: The last line has no line break and closes no block: a number cut short reads as another.
        """
        text = self.text
        found = [(number, line.strip()) for number, line in enumerate(text.split("\n"), start=1) if line.strip()]
        open_end = bool(found) and not text.rstrip(" \t\r").endswith("\n")
        if open_end and not _END_OF_BLOCK.fullmatch(found[-1][1]):
            number, line = found[-1]
            raise self.error(number, "must end with a line break, or the file may be cut off", value=line[-30:])
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
        try:
            yield
        except InputError as error:
            raise self.located(error.within(field), line) from None


def read_source(path: str | os.PathLike[str]) -> SourceFile:
    """Read a file, which must not be empty."""
    file = os.fspath(path)
    try:
        data = Path(file).read_bytes()
    except IsADirectoryError:
        raise InputError("must be a file, got a folder").of(file) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "is no name of a file"
        raise InputError(f"cannot be read: {reason}").of(file) from None
    if not data.strip():
        raise InputError("must hold data, got an empty file").of(file)
    return SourceFile(file, data)


class Rows(NamedTuple):
    """Rows of a table of numbers: cells and line numbers."""

    cells: list[list[str]]
    lines: list[int]

    def add(self, line: int, cells: list[str]) -> None:
        """Add a row."""
        self.cells.append(cells)
        self.lines.append(line)


def numbers_of(source: SourceFile, rows: Rows, first: int, count: int) -> F64:
    """Numbers in columns first to first + count of each row, (n, count); all must be finite."""
    try:
        values = np.array([[float(cell) for cell in row[first : first + count]] for row in rows.cells], np.float64)
        good = np.isfinite(values).all() and not any("_" in cell for row in rows.cells for cell in row[first:])
    except ValueError:
        good = False
    if good:
        return values.reshape(len(rows.cells), count)
    for row, line in zip(rows.cells, rows.lines, strict=True):
        for cell in row[first : first + count]:
            number_of(source, line, cell)
    raise source.error(rows.lines[0] if rows.lines else 0, "must hold numbers")


def number_of(source: SourceFile, line: int, text: str, field: str = "") -> float:
    """One finite number."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or "_" in text:
        raise source.error(line, "must be a finite number", field, text[:40])
    return value


def whole_number_of(source: SourceFile, line: int, text: str, field: str) -> int:
    """One whole number."""
    if not (text.isascii() and text.isdigit() and len(text) < 12):
        raise source.error(line, "must be a whole number", field, text[:40])
    return int(text)


def dates_of(
    source: SourceFile, texts: Sequence[str], lines: Sequence[int], system: str, field: str = ""
) -> FileInstants:
    """Instants of dates that stand on these lines."""
    try:
        return parse_dates(texts, system)
    except InputError as error:
        raise error.within(field).at_row(f"line {lines[error.row or 0]}").of(source.file) from None


def check_cells(source: SourceFile, rows: Rows, counts: tuple[int, ...], what: str) -> None:
    """Raise unless every row has the same number of cells, one of counts."""
    count = len(rows.cells[0])
    if count not in counts:
        allowed = " or ".join(map(str, counts))
        raise source.error(rows.lines[0], f"must have {allowed} values ({what})", value=count)
    for row, line in zip(rows.cells, rows.lines, strict=True):
        if len(row) != count:
            raise source.error(line, f"must have {count} values ({what}) as the line before", value=len(row))


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
