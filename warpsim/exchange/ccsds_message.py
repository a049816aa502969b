"""CCSDS messages, OEM and AEM: header, and segments of metadata and rows, from keyword = value text or from XML.

Both notations become one `Message`, so that one piece of code gives it a meaning (`ccsds_read`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

from warpsim.errors import InputError
from warpsim.exchange.source import Rows, SourceFile

_ASSIGNMENT = re.compile(r"([A-Za-z_0-9]+)\s*=\s*(.*)")
_VERSION = re.compile(r"CCSDS_([A-Z]+)_VERS")
_HEADER = ("COMMENT", "CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
_OEM_COLUMNS = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")


@dataclass(frozen=True)
class KeywordValue:
    """A value with its line number."""

    text: str
    line: int


@dataclass
class MessageSegment:
    """Metadata by keyword, and rows."""

    line: int
    meta: dict[str, KeywordValue] = field(default_factory=dict)
    rows: Rows = field(default_factory=lambda: Rows([], []))


@dataclass
class Message:
    """A whole message."""

    kind: str
    """"OEM" or "AEM"."""

    version: float
    segments: list[MessageSegment] = field(default_factory=list)


def is_ccsds(source: SourceFile) -> bool:
    """Return whether a file looks like a CCSDS message, in either notation."""
    head = source.data[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    return head.startswith(b"<") or re.match(rb"(COMMENT[^\n]*\n\s*)*CCSDS_[A-Z]+_VERS", head) is not None


def read_message(source: SourceFile, kind: str, known: Mapping[str, bool]) -> Message:
    """Header, metadata and rows of a message.

    Args:
        source: The file.
        kind: "OEM" or "AEM"; another kind is refused.
        known: Keywords of the metadata, and whether each must be there.

    Raises:
        InputError: It is no such message; file, line and rule.
    """
    xml = source.data[:4096].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")
    message = _XmlReader(source, kind).read() if xml else _KvnReader(source, kind, known).read()
    if not message.segments:
        raise source.error(0, f"ends early: an {kind} must have a segment")
    for segment in message.segments:
        for keyword, value in segment.meta.items():
            if keyword not in known:
                raise source.error(value.line, "is not a known keyword of the metadata", keyword)
            if not value.text:
                raise source.error(value.line, "must have a value", keyword)
        missing = [keyword for keyword, needed in known.items() if needed and keyword not in segment.meta]
        if missing:
            raise source.error(segment.line, f"must have {', '.join(missing)}", "metadata")
        if not segment.rows.cells:
            raise source.error(segment.line, "must hold data, got none", "segment")
    return message


class _KvnReader:
    """Reads the keyword = value notation line by line."""

    def __init__(self, source: SourceFile, kind: str, known: Mapping[str, bool]) -> None:
        self.source, self.kind, self.known = source, kind, known
        self.section = "header"
        """"header", "meta", "before data", "data", "covariance" or "after data"."""

        self.opened = 0
        """Line that began the block now open."""

    def read(self) -> Message:
        lines = [(n, line) for n, line in self.source.lines() if not re.match(r"COMMENT(\s|$)", line)]
        message = self._begin(*lines[0]) if lines else None
        if message is None:
            raise self.source.error(0, "must hold a message, got comments only")
        for number, line in lines[1:]:
            getattr(self, "_" + self.section.replace(" ", "_"))(message, number, line)
        if self.section in ("meta", "covariance") or (self.section == "data" and self.kind == "AEM"):
            stop = {"meta": "META_STOP", "covariance": "COVARIANCE_STOP", "data": "DATA_STOP"}[self.section]
            raise self.source.error(self.opened, f"ends early: {stop} must close what begins here")
        return message

    def _begin(self, number: int, line: str) -> Message:
        match = _ASSIGNMENT.fullmatch(line)
        version = _VERSION.fullmatch(match[1]) if match else None
        if match is None or version is None:
            raise self.source.error(number, f"must begin with CCSDS_{self.kind}_VERS = ...", value=line[:40])
        return _new_message(self.source, number, version[1], match[2], self.kind)

    def _header(self, message: Message, number: int, line: str) -> None:
        match = _ASSIGNMENT.fullmatch(line)
        if line == "META_START":
            self._open(message, number)
        elif match is None or match[1] not in _HEADER:
            raise self.source.error(number, "must be a keyword of the header or META_START", value=line[:40])

    def _open(self, message: Message, number: int) -> None:
        message.segments.append(MessageSegment(number))
        self.section, self.opened = "meta", number

    def _meta(self, message: Message, number: int, line: str) -> None:
        if line == "META_STOP":
            self.section = "before data" if self.kind == "AEM" else "data"
            return
        match = _ASSIGNMENT.fullmatch(line)
        if match is None:
            raise self.source.error(number, "must be KEYWORD = value or META_STOP", value=line[:40])
        meta = message.segments[-1].meta
        if match[1] in meta:
            raise self.source.error(number, "must stand once in the metadata, got it a second time", match[1])
        meta[match[1]] = KeywordValue(match[2].strip(), number)

    def _before_data(self, message: Message, number: int, line: str) -> None:
        if line != "DATA_START":
            raise self.source.error(number, "must be DATA_START", value=line[:40])
        self.section, self.opened = "data", number

    def _data(self, message: Message, number: int, line: str) -> None:
        rows = message.segments[-1].rows
        if self.kind == "AEM" and line == "DATA_STOP":
            self.section = "after data"
        elif self.kind == "OEM" and line == "META_START":
            self._open(message, number)
        elif self.kind == "OEM" and line == "COVARIANCE_START":
            self.section, self.opened = "covariance", number
        elif not line[0].isdigit() or "=" in line:
            raise self.source.error(number, "must be a date and numbers", value=line[:40])
        else:
            rows.cells.append(line.split())
            rows.lines.append(number)

    def _covariance(self, message: Message, number: int, line: str) -> None:
        if line == "COVARIANCE_STOP":
            self.section = "after data"
        elif line == "META_START":
            raise self.source.error(number, "must come after COVARIANCE_STOP, got META_START")

    def _after_data(self, message: Message, number: int, line: str) -> None:
        if line == "META_START":
            self._open(message, number)
        elif line == "COVARIANCE_START" and self.kind == "OEM":
            self.section, self.opened = "covariance", number
        else:
            raise self.source.error(number, "must be META_START", value=line[:40])


def _new_message(source: SourceFile, line: int, found: str, version: str, kind: str) -> Message:
    if found != kind:
        raise source.error(line, f"must be an {kind}, got an {found}")
    if not re.fullmatch(r"[0-9]\.[0-9]+", version.strip(), re.ASCII) or not 1.0 <= float(version) < 4.0:
        raise source.error(line, "must be 1.0 to 3.0", f"CCSDS_{kind}_VERS", version.strip()[:20])
    return Message(kind, float(version))


@dataclass
class _Element:
    """An element of XML, with the line it begins on."""

    tag: str
    line: int
    attributes: dict[str, str]
    text: str = ""
    children: list[_Element] = field(default_factory=list)

    def find(self, tag: str) -> list[_Element]:
        """Children of that name."""
        return [child for child in self.children if child.tag == tag]

    def leaves(self) -> list[_Element]:
        """Elements without children, in order."""
        if not self.children:
            return [self]
        return [leaf for child in self.children for leaf in child.leaves()]


class _XmlReader:
    """Reads NDM/XML: expat rather than ElementTree, since it knows the lines."""

    def __init__(self, source: SourceFile, kind: str) -> None:
        self.source, self.kind = source, kind
        self.open: list[_Element] = [_Element("", 1, {})]
        self.parser: Any = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.StartDoctypeDeclHandler = self._doctype

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if len(self.open) > 50:
            raise self._error(self.parser.CurrentLineNumber, "must not be nested so deeply")
        element = _Element(tag.rpartition(":")[2], self.parser.CurrentLineNumber, attributes)
        self.open[-1].children.append(element)
        self.open.append(element)

    def _end(self, tag: str) -> None:
        self.open.pop()

    def _characters(self, text: str) -> None:
        self.open[-1].text += text

    def _doctype(self, *_: object) -> None:
        raise self._error(self.parser.CurrentLineNumber, "must have no document type of its own")

    def _error(self, line: int, rule: str) -> InputError:
        """The error to raise about the XML on a line."""
        return self.source.located(InputError(rule).of("XML"), line)

    def read(self) -> Message:
        try:
            self.parser.Parse(self.source.data.lstrip(), True)
        except InputError:  # of a handler
            raise
        except expat.ExpatError as error:
            reason = expat.errors.messages[error.code]
            raise self._error(error.lineno, f"{reason} (the file may be cut off)") from None
        except (LookupError, ValueError) as error:  # an unknown encoding
            raise self._error(1, str(error)) from None
        root = self.open[0].children[0]
        inner = [child for child in root.children if child.tag in ("oem", "aem")] if root.tag == "ndm" else [root]
        if not inner or inner[0].tag not in ("oem", "aem"):
            raise self._error(root.line, f"must be an {self.kind}, got <{root.tag}>")
        message = None
        for top in inner:
            version = top.attributes.get("version", "")
            part = _new_message(self.source, top.line, top.tag.upper(), version, self.kind)
            part.segments = [self._segment(s) for body in top.find("body") for s in body.find("segment")]
            message = part if message is None else message
            if part is not message:
                message.segments += part.segments
        assert message is not None
        return message

    def _segment(self, element: _Element) -> MessageSegment:
        segment = MessageSegment(element.line)
        for metadata in element.find("metadata"):
            for item in metadata.children:
                if item.tag == "COMMENT":
                    continue
                if item.tag in segment.meta:
                    raise self.source.error(item.line, "must stand once in the metadata", item.tag)
                segment.meta[item.tag] = KeywordValue(item.text.strip(), item.line)
        for data in element.find("data"):
            for item in data.children:
                if item.tag in ("COMMENT", "covarianceMatrix"):
                    continue
                cells = self._state_vector(item) if self.kind == "OEM" else self._attitude(item)
                segment.rows.cells.append(cells)
                segment.rows.lines.append(item.line)
        return segment

    def _state_vector(self, item: _Element) -> list[str]:
        if item.tag != "stateVector":
            raise self._error(item.line, f"must be a <stateVector>, got <{item.tag}>")
        return self._row(item, _OEM_COLUMNS, 7, ("km", "km/s", "km/s**2"))

    def _attitude(self, item: _Element) -> list[str]:
        tags = [leaf.tag for leaf in item.leaves()]
        if item.tag != "attitudeState" or "Q1" not in tags:
            raise self._error(item.line, "must be an <attitudeState> with a quaternion Q1, Q2, Q3, QC")
        return self._row(item, ("EPOCH", "Q1", "Q2", "Q3", "QC"), 5, ())

    def _row(self, item: _Element, columns: tuple[str, ...], n_least: int, units: tuple[str, ...]) -> list[str]:
        found = {leaf.tag: leaf for leaf in item.leaves()}
        for column in columns[:n_least]:
            if column not in found:
                raise self._error(item.line, f"must have <{column}>")
        for leaf in found.values():
            unit = leaf.attributes.get("units")
            if leaf.tag in columns and unit is not None and unit.lower() not in units:
                raise self.source.error(leaf.line, f"must be in {' or '.join(units)}", leaf.tag, unit)
        return [found[column].text.strip() for column in columns if column in found]
