"""CCSDS messages, OEM and AEM: segments of metadata and rows, from keyword = value text or from XML.

Both notations become one `Message`, so that one piece of code gives it a meaning (`ccsds_read`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from warpsim.errors import InputError
from warpsim.exchange.source import Rows, SourceFile
from warpsim.exchange.xml_elements import Element, read_xml

_ASSIGNMENT = re.compile(r"([A-Za-z_0-9]+)\s*=\s*(.*)")
_VERSION = re.compile(r"CCSDS_([A-Z]+)_VERS")
_HEADER = ("CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
_OEM_COLUMNS = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")

Lines = Iterator[tuple[int, str]]
"""Line numbers and lines, comments left out."""


class KeywordValue(NamedTuple):
    """A value with its line number."""

    text: str
    line: int


@dataclass
class MessageSegment:
    """Metadata by keyword, and rows."""

    line: int
    meta: dict[str, KeywordValue] = field(default_factory=dict)
    rows: Rows = field(default_factory=lambda: Rows([], []))


class Message(NamedTuple):
    """A whole message."""

    version: float
    segments: list[MessageSegment]


def is_ccsds(source: SourceFile) -> bool:
    """Return whether a file looks like a CCSDS message, in either notation."""
    head = source.data[:4096].lstrip(b"\xef\xbb\xbf \t\r\n")
    return source.is_xml or re.match(rb"(COMMENT[^\n]*\n\s*)*CCSDS_[A-Z]+_VERS", head) is not None


def read_message(source: SourceFile, kind: str, known: Mapping[str, bool]) -> Message:
    """Read the metadata and rows of an "OEM" or "AEM"; `known` are keywords, and whether each must be there."""
    message = (_read_xml if source.is_xml else _read_kvn)(source, kind)
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


def _checked_version(source: SourceFile, line: int, found: str, version: str, kind: str) -> float:
    if found != kind:
        raise source.error(line, f"must be an {kind}, got an {found}")
    if not re.fullmatch(r"[0-9]\.[0-9]+", version.strip(), re.ASCII) or not 1.0 <= float(version) < 4.0:
        raise source.error(line, "must be 1.0 to 3.0", f"CCSDS_{kind}_VERS", version.strip()[:20])
    return float(version)


def _read_kvn(source: SourceFile, kind: str) -> Message:
    """Read the keyword = value notation: a header, and segments of metadata, rows and covariances."""
    lines = iter([(number, line) for number, line in source.lines() if not re.match(r"COMMENT(\s|$)", line)])
    number, line = next(lines, (0, ""))
    if not line:
        raise source.error(0, "must hold a message, got comments only")
    match = _ASSIGNMENT.fullmatch(line)
    begin = _VERSION.fullmatch(match[1]) if match else None
    if match is None or begin is None:
        raise source.error(number, f"must begin with CCSDS_{kind}_VERS = ...", value=line[:40])
    message = Message(_checked_version(source, number, begin[1], match[2], kind), [])
    open_rows = False  # whether rows of an OEM may follow
    for number, line in lines:
        if line == "META_START":
            segment = MessageSegment(number)
            message.segments.append(segment)
            _read_metadata(source, segment, lines)
            open_rows = kind == "OEM"
            if kind == "AEM":
                _read_attitude_rows(source, segment, lines)
        elif not message.segments:
            match = _ASSIGNMENT.fullmatch(line)
            if match is None or match[1] not in _HEADER:
                raise source.error(number, "must be a keyword of the header or META_START", value=line[:40])
        elif line == "COVARIANCE_START" and kind == "OEM":
            for inner_number, inner in _until(source, "COVARIANCE_STOP", number, lines):
                if inner == "META_START":
                    raise source.error(inner_number, "must come after COVARIANCE_STOP, got META_START")
            open_rows = False
        elif open_rows:
            _add_row(source, message.segments[-1], number, line)
        else:
            raise source.error(number, "must be META_START", value=line[:40])
    return message


def _until(source: SourceFile, stop: str, opened: int, lines: Lines) -> Lines:
    """Lines before the one that closes a block."""
    for number, line in lines:
        if line == stop:
            return
        yield number, line
    raise source.error(opened, f"ends early: {stop} must close what begins here")


def _read_metadata(source: SourceFile, segment: MessageSegment, lines: Lines) -> None:
    for number, line in _until(source, "META_STOP", segment.line, lines):
        match = _ASSIGNMENT.fullmatch(line)
        if match is None:
            raise source.error(number, "must be KEYWORD = value or META_STOP", value=line[:40])
        if match[1] in segment.meta:
            raise source.error(number, "must stand once in the metadata, got it a second time", match[1])
        segment.meta[match[1]] = KeywordValue(match[2].strip(), number)


def _read_attitude_rows(source: SourceFile, segment: MessageSegment, lines: Lines) -> None:
    opened, line = next(lines, (0, ""))
    if opened and line != "DATA_START":
        raise source.error(opened, "must be DATA_START", value=line[:40])
    if opened:
        for number, row in _until(source, "DATA_STOP", opened, lines):
            _add_row(source, segment, number, row)


def _add_row(source: SourceFile, segment: MessageSegment, number: int, line: str) -> None:
    if not line[0].isdigit() or "=" in line:
        raise source.error(number, "must be a date and numbers", value=line[:40])
    segment.rows.add(number, line.split())


def _read_xml(source: SourceFile, kind: str) -> Message:
    """Read NDM/XML: one message, or several of a kind in an <ndm>."""
    try:
        root = read_xml(source.data.lstrip())
    except InputError as error:
        raise error.of(source.file) from None
    tops = [child for child in root.children if child.tag in ("oem", "aem")] if root.tag == "ndm" else [root]
    if not tops or tops[0].tag not in ("oem", "aem"):
        raise _xml_error(source, root.line, f"must be an {kind}, got <{root.tag}>")
    versions = [
        _checked_version(source, top.line, top.tag.upper(), top.attributes.get("version", ""), kind) for top in tops
    ]
    segments = [segment for top in tops for body in top.find("body") for segment in body.find("segment")]
    return Message(versions[0], [_xml_segment(source, kind, segment) for segment in segments])


def _xml_error(source: SourceFile, line: int, rule: str) -> InputError:
    return source.located(InputError(rule).of("XML"), line)


def _xml_segment(source: SourceFile, kind: str, element: Element) -> MessageSegment:
    segment = MessageSegment(element.line)
    for item in (item for metadata in element.find("metadata") for item in metadata.children):
        if item.tag == "COMMENT":
            continue
        if item.tag in segment.meta:
            raise source.error(item.line, "must stand once in the metadata", item.tag)
        segment.meta[item.tag] = KeywordValue(item.text.strip(), item.line)
    for item in (item for data in element.find("data") for item in data.children):
        if item.tag in ("COMMENT", "covarianceMatrix"):
            continue
        if kind == "OEM":
            if item.tag != "stateVector":
                raise _xml_error(source, item.line, f"must be a <stateVector>, got <{item.tag}>")
            cells = _xml_row(source, item, _OEM_COLUMNS, 7, ("km", "km/s", "km/s**2"))
        else:
            if item.tag != "attitudeState" or "Q1" not in [leaf.tag for leaf in item.leaves()]:
                rule = "must be an <attitudeState> with a quaternion Q1, Q2, Q3, QC"
                raise _xml_error(source, item.line, rule)
            cells = _xml_row(source, item, ("EPOCH", "Q1", "Q2", "Q3", "QC"), 5, ())
        segment.rows.add(item.line, cells)
    return segment


def _xml_row(
    source: SourceFile, item: Element, columns: tuple[str, ...], n_least: int, units: tuple[str, ...]
) -> list[str]:
    """Texts of the columns, in order, as far as they are there."""
    found = {leaf.tag: leaf for leaf in item.leaves()}
    for column in columns[:n_least]:
        if column not in found:
            raise _xml_error(source, item.line, f"must have <{column}>")
    for leaf in found.values():
        unit = leaf.attributes.get("units")
        if leaf.tag in columns and unit is not None and unit.lower() not in units:
            raise source.error(leaf.line, f"must be in {' or '.join(units)}", leaf.tag, unit)
    return [found[column].text.strip() for column in columns if column in found]
