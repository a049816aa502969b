"""CCSDS messages of orbits (502.0-B-2/3) and attitudes (504.0-B-1/2) as keywords and rows.

OEM and AEM come in two notations, keyword = value text and NDM/XML: both become the same segments, so that one piece of
code gives them a meaning.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from warpsim.errors import InputError, errors_at
from warpsim.exchange.instants import TIME_SYSTEMS, FileInstants
from warpsim.exchange.segments import Interpolation
from warpsim.exchange.source import Element, Keywords, Rows, SourceFile, read_xml

_NEEDED = ("OBJECT_NAME", "OBJECT_ID", "TIME_SYSTEM", "START_TIME", "STOP_TIME")
_OPTIONAL = ("USEABLE_START_TIME", "USEABLE_STOP_TIME", "INTERPOLATION_DEGREE")

_METHODS: dict[str, Interpolation] = {"LINEAR": "linear", "LAGRANGE": "lagrange", "HERMITE": "hermite"}
_SPAN_SLACK_S = 1.0
"""How far the data may miss START_TIME and STOP_TIME, which some programs round."""

_ASSIGNMENT = re.compile(r"([A-Za-z_0-9]+)\s*=\s*(.*)")
_VERSION = re.compile(r"CCSDS_([A-Z]+)_VERS")
_HEADER = ("CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
_OEM_COLUMNS = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")

Lines = Iterator[tuple[int, str]]
"""Line numbers and lines, comments left out."""


class MessageSegment(NamedTuple):
    """Metadata and rows."""

    meta: Keywords
    rows: Rows


def message_kind(source: SourceFile) -> str:
    """Return the kind of a CCSDS message, as in "OEM", or "XML"; "" where it is none."""
    match = re.match(r"(\s*COMMENT[^\n]*\n)*\s*CCSDS_([A-Z]+)_VERS", source.head)
    return match[2] if match else "XML" if source.is_xml else ""


def read_message(
    source: SourceFile, kind: str, needed: Sequence[str], optional: Sequence[str]
) -> tuple[float, list[MessageSegment]]:
    """Read version and segments of an "OEM" or "AEM", whose metadata must have, and may have, these keywords too."""
    version, segments = (_read_xml if source.is_xml else _read_kvn)(source, kind)
    if not segments:
        raise source.error(0, f"ends early: an {kind} must have a segment")
    for meta, rows in segments:
        for keyword in meta:
            if keyword not in (*_NEEDED, *_OPTIONAL, *needed, *optional):
                raise meta.error(keyword, "is not a known keyword of the metadata")
            if not meta.text(keyword):
                raise meta.error(keyword, "must have a value")
        meta.need(*_NEEDED, *needed, part="metadata")
        if not rows.cells:
            raise source.error(meta.line, "must hold data, got none", "segment")
    return version, segments


def _checked_version(source: SourceFile, line: int, found: str, version: str, kind: str) -> float:
    if found != kind:
        raise source.error(line, f"must be an {kind}, got an {found}")
    if not re.fullmatch(r"[0-9]\.[0-9]+", version.strip(), re.ASCII) or not 1.0 <= float(version) < 4.0:
        raise source.error(line, "must be 1.0 to 3.0", f"CCSDS_{kind}_VERS", version.strip()[:20])
    return float(version)


def _read_kvn(source: SourceFile, kind: str) -> tuple[float, list[MessageSegment]]:
    """Read the keyword = value notation: a header, and segments of metadata, rows and covariances."""
    lines = iter([(number, line) for number, line in source.lines() if not re.match(r"COMMENT(\s|$)", line)])
    number, line = next(lines, (0, ""))
    if not line:
        raise source.error(0, "must hold a message, got comments only")
    match = _ASSIGNMENT.fullmatch(line)
    begin = _VERSION.fullmatch(match[1]) if match else None
    if match is None or begin is None:
        raise source.error(number, f"must begin with CCSDS_{kind}_VERS = ...", value=line[:40])
    version = _checked_version(source, number, begin[1], match[2], kind)
    segments: list[MessageSegment] = []
    open_rows = False  # whether rows of an OEM may follow
    for number, line in lines:
        if line == "META_START":
            segments.append(MessageSegment(_read_metadata(source, number, lines), Rows(source)))
            open_rows = kind == "OEM"
            if kind == "AEM":
                _read_attitude_rows(source, segments[-1].rows, lines)
        elif not segments:
            match = _ASSIGNMENT.fullmatch(line)
            if match is None or match[1] not in _HEADER:
                raise source.error(number, "must be a keyword of the header or META_START", value=line[:40])
        elif line == "COVARIANCE_START" and kind == "OEM":
            for inner_number, inner in _until(source, "COVARIANCE_STOP", number, lines):
                if inner == "META_START":
                    raise source.error(inner_number, "must come after COVARIANCE_STOP, got META_START")
            open_rows = False
        elif open_rows:
            _add_row(segments[-1].rows, number, line)
        else:
            raise source.error(number, "must be META_START", value=line[:40])
    return version, segments


def _until(source: SourceFile, stop: str, opened: int, lines: Lines) -> Lines:
    """Lines before the one that closes a block."""
    for number, line in lines:
        if line == stop:
            return
        yield number, line
    raise source.error(opened, f"ends early: {stop} must close what begins here")


def _read_metadata(source: SourceFile, opened: int, lines: Lines) -> Keywords:
    meta = Keywords(source, opened)
    for number, line in _until(source, "META_STOP", opened, lines):
        match = _ASSIGNMENT.fullmatch(line)
        if match is None:
            raise source.error(number, "must be KEYWORD = value or META_STOP", value=line[:40])
        meta.add(match[1], match[2].strip(), number)
    return meta


def _read_attitude_rows(source: SourceFile, rows: Rows, lines: Lines) -> None:
    opened, line = next(lines, (0, ""))
    if opened and line != "DATA_START":
        raise source.error(opened, "must be DATA_START", value=line[:40])
    if opened:
        for number, row in _until(source, "DATA_STOP", opened, lines):
            _add_row(rows, number, row)


def _add_row(rows: Rows, number: int, line: str) -> None:
    if not line[0].isdecimal() or "=" in line:
        raise rows.source.error(number, "must be a date and numbers", value=line[:40])
    rows.add(number, line.split())


def _read_xml(source: SourceFile, kind: str) -> tuple[float, list[MessageSegment]]:
    """Read NDM/XML: one message, or several of a kind in an <ndm>."""
    with errors_at("", source.file):
        root = read_xml(source.data.lstrip())
    tops = [child for child in root.children if child.tag in ("oem", "aem")] if root.tag == "ndm" else [root]
    if not tops or tops[0].tag not in ("oem", "aem"):
        raise _xml_error(source, root.line, f"must be an {kind}, got <{root.tag}>")
    versions = [
        _checked_version(source, top.line, top.tag.upper(), top.attributes.get("version", ""), kind) for top in tops
    ]
    segments = [segment for top in tops for body in top.find("body") for segment in body.find("segment")]
    return versions[0], [_xml_segment(source, kind, segment) for segment in segments]


def _xml_error(source: SourceFile, line: int, rule: str) -> InputError:
    return source.located(InputError(rule).of("XML"), line)


def _xml_segment(source: SourceFile, kind: str, element: Element) -> MessageSegment:
    meta, rows = Keywords(source, element.line), Rows(source)
    for item in (item for metadata in element.find("metadata") for item in metadata.children):
        if item.tag != "COMMENT":
            meta.add(item.tag, item.text.strip(), item.line)
    for item in (item for data in element.find("data") for item in data.children):
        if item.tag in ("COMMENT", "covarianceMatrix"):
            continue
        if kind == "OEM":
            if item.tag != "stateVector":
                raise _xml_error(source, item.line, f"must be a <stateVector>, got <{item.tag}>")
            cells = _xml_row(source, item, _OEM_COLUMNS, 7, ("km", "km/s", "km/s**2"))
        else:
            if item.tag != "attitudeState" or "Q1" not in [leaf.tag for leaf in item.leaves()]:
                rule = "must be an <attitudeState> with a quaternion Q1, Q2, Q3, QC, got ATTITUDE_TYPE "
                raise _xml_error(source, item.line, rule + meta.text("ATTITUDE_TYPE", item.text.strip())[:30])
            cells = _xml_row(source, item, ("EPOCH", "Q1", "Q2", "Q3", "QC"), 5, ())
        rows.add(item.line, cells)
    return MessageSegment(meta, rows)


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


def time_system(meta: Keywords) -> str:
    """Time system of the dates; UTC where it is not given."""
    return meta.one_of("TIME_SYSTEM", TIME_SYSTEMS, "UTC")


def check_center(meta: Keywords) -> None:
    """Check that the data are about the Earth."""
    meta.one_of("CENTER_NAME", ("EARTH",))


def interpolation(meta: Keywords, method_keyword: str) -> dict[str, Any]:
    """Fields of a segment: the method and the degree that are asked for."""
    method = _METHODS.get(meta.one_of(method_keyword, list(_METHODS)))
    return {"interpolation": method, "degree": meta.whole_number("INTERPOLATION_DEGREE")}


def common_fields(segment: MessageSegment, method_keyword: str) -> dict[str, Any]:
    """Fields that segments of OEM and AEM have; the rows must fill START_TIME to STOP_TIME."""
    meta, rows = segment
    system = time_system(meta)
    instants = rows.dates(system)
    for keyword, end in (("START_TIME", 0), ("STOP_TIME", -1)):
        off_s = float(instants[end].since_instant(meta.date(keyword, system))[0])
        if abs(off_s) > _SPAN_SLACK_S:
            row, side = ("first" if end == 0 else "last"), ("after" if off_s > 0 else "before")
            rule = f"must be the time of the {row} row, which is {abs(off_s):g} s {side} it (a file cut off?)"
            raise meta.error(keyword, rule)
    useable, keywords = None, ("USEABLE_START_TIME", "USEABLE_STOP_TIME")
    if any(keyword in meta for keyword in keywords):
        pairs = zip(keywords, (0, -1), strict=True)
        ends = [meta.date(keyword, system) if keyword in meta else instants[end] for keyword, end in pairs]
        day, second = (np.concatenate([getattr(end, part) for end in ends]) for part in ("day", "second"))
        useable = FileInstants(day, second)
    return {
        "object_name": meta.text("OBJECT_NAME"),
        "object_id": meta.text("OBJECT_ID"),
        "instants": instants,
        **interpolation(meta, method_keyword),
        "useable": useable,
        "time_system": system,
        "file": rows.source.file,
        "line": meta.line,
        "lines": np.array(rows.lines, np.int64),
    }
