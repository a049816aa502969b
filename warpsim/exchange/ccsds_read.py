"""CCSDS OEM (orbits) and AEM (attitudes) as segments: 502.0-B-2/3 and 504.0-B-1/2.

Both notations, keyword = value text and XML, become one `Message`, so that one piece of code gives it a meaning.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.exchange.instants import FileInstants, check_time_system
from warpsim.exchange.segments import (
    AttitudeSegment,
    EphemerisSegment,
    Frame,
    Interpolation,
    ccsds_frame,
    known_ccsds_frame,
)
from warpsim.exchange.source import (
    Element,
    Rows,
    SourceFile,
    check_cells,
    dates_of,
    numbers_of,
    read_xml,
    whole_number_of,
)
from warpsim.quaternion import conjugate, product, rotated

F64 = NDArray[np.float64]

_NEEDED = dict.fromkeys(("OBJECT_NAME", "OBJECT_ID", "TIME_SYSTEM", "START_TIME", "STOP_TIME"), True)
_COMMON = _NEEDED | dict.fromkeys(("USEABLE_START_TIME", "USEABLE_STOP_TIME", "INTERPOLATION_DEGREE"), False)
_OEM = {**_COMMON, "CENTER_NAME": True, "REF_FRAME": True, "REF_FRAME_EPOCH": False, "INTERPOLATION": False}
_AEM = {**_COMMON, "REF_FRAME_A": True, "REF_FRAME_B": True, "ATTITUDE_TYPE": True, "INTERPOLATION_METHOD": False}
_AEM |= dict.fromkeys(("CENTER_NAME", "ATTITUDE_DIR", "QUATERNION_TYPE", "EULER_ROT_SEQ"), False)
_AEM |= dict.fromkeys(("RATE_FRAME", "ANGVEL_FRAME"), False)
"""Keywords of the metadata, and whether each must be there."""

_METHODS: dict[str, Interpolation] = {"LINEAR": "linear", "LAGRANGE": "lagrange", "HERMITE": "hermite"}
_N_QUATERNION_CELLS = {"QUATERNION": 5, "QUATERNION/DERIVATIVE": 9, "QUATERNION/RATE": 8, "QUATERNION/ANGVEL": 8}
_SPAN_SLACK_S = 1.0
"""How far the data may miss START_TIME and STOP_TIME, which some programs round."""

_ASSIGNMENT = re.compile(r"([A-Za-z_0-9]+)\s*=\s*(.*)")
_VERSION = re.compile(r"CCSDS_([A-Z]+)_VERS")
_HEADER = ("CLASSIFICATION", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
_OEM_COLUMNS = ("EPOCH", "X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")

Lines = Iterator[tuple[int, str]]
"""Line numbers and lines, comments left out."""


class _KeywordValue(NamedTuple):
    """A value with its line number."""

    text: str
    line: int


@dataclass
class _MessageSegment:
    """Metadata by keyword, and rows."""

    line: int
    meta: dict[str, _KeywordValue] = field(default_factory=dict)
    rows: Rows = field(default_factory=lambda: Rows([], []))


class _Message(NamedTuple):
    """A whole message."""

    version: float
    segments: list[_MessageSegment]


def is_ccsds(source: SourceFile) -> bool:
    """Return whether a file looks like a CCSDS message, in either notation."""
    return source.is_xml or re.match(r"(\s*COMMENT[^\n]*\n)*\s*CCSDS_[A-Z]+_VERS", source.head) is not None


def read_message(source: SourceFile, kind: str, known: Mapping[str, bool]) -> _Message:
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


def _read_kvn(source: SourceFile, kind: str) -> _Message:
    """Read the keyword = value notation: a header, and segments of metadata, rows and covariances."""
    lines = iter([(number, line) for number, line in source.lines() if not re.match(r"COMMENT(\s|$)", line)])
    number, line = next(lines, (0, ""))
    if not line:
        raise source.error(0, "must hold a message, got comments only")
    match = _ASSIGNMENT.fullmatch(line)
    begin = _VERSION.fullmatch(match[1]) if match else None
    if match is None or begin is None:
        raise source.error(number, f"must begin with CCSDS_{kind}_VERS = ...", value=line[:40])
    message = _Message(_checked_version(source, number, begin[1], match[2], kind), [])
    open_rows = False  # whether rows of an OEM may follow
    for number, line in lines:
        if line == "META_START":
            segment = _MessageSegment(number)
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


def _read_metadata(source: SourceFile, segment: _MessageSegment, lines: Lines) -> None:
    for number, line in _until(source, "META_STOP", segment.line, lines):
        match = _ASSIGNMENT.fullmatch(line)
        if match is None:
            raise source.error(number, "must be KEYWORD = value or META_STOP", value=line[:40])
        if match[1] in segment.meta:
            raise source.error(number, "must stand once in the metadata, got it a second time", match[1])
        segment.meta[match[1]] = _KeywordValue(match[2].strip(), number)


def _read_attitude_rows(source: SourceFile, segment: _MessageSegment, lines: Lines) -> None:
    opened, line = next(lines, (0, ""))
    if opened and line != "DATA_START":
        raise source.error(opened, "must be DATA_START", value=line[:40])
    if opened:
        for number, row in _until(source, "DATA_STOP", opened, lines):
            _add_row(source, segment, number, row)


def _add_row(source: SourceFile, segment: _MessageSegment, number: int, line: str) -> None:
    if not line[0].isdecimal() or "=" in line:
        raise source.error(number, "must be a date and numbers", value=line[:40])
    segment.rows.add(number, line.split())


def _read_xml(source: SourceFile, kind: str) -> _Message:
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
    return _Message(versions[0], [_xml_segment(source, kind, segment) for segment in segments])


def _xml_error(source: SourceFile, line: int, rule: str) -> InputError:
    return source.located(InputError(rule).of("XML"), line)


def _xml_segment(source: SourceFile, kind: str, element: Element) -> _MessageSegment:
    segment = _MessageSegment(element.line)
    for item in (item for metadata in element.find("metadata") for item in metadata.children):
        if item.tag == "COMMENT":
            continue
        if item.tag in segment.meta:
            raise source.error(item.line, "must stand once in the metadata", item.tag)
        segment.meta[item.tag] = _KeywordValue(item.text.strip(), item.line)
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
                raise _xml_error(source, item.line, rule + segment.meta.get("ATTITUDE_TYPE", item).text.strip()[:30])
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


def read_oem(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of an OEM."""
    return [_ephemeris(source, segment) for segment in read_message(source, "OEM", _OEM).segments]


def read_aem(source: SourceFile) -> list[AttitudeSegment]:
    """Segments of an AEM."""
    message = read_message(source, "AEM", _AEM)
    return [_attitude(source, segment, message.version) for segment in message.segments]


def _ephemeris(source: SourceFile, segment: _MessageSegment) -> EphemerisSegment:
    meta, rows = segment.meta, segment.rows
    _check_center(source, meta["CENTER_NAME"])
    with source.at(meta["REF_FRAME"].line, "REF_FRAME"):
        frame = known_ccsds_frame(meta["REF_FRAME"].text)
    if "REF_FRAME_EPOCH" in meta and frame not in ("GCRF", "EME2000", "ITRF"):  # which do not depend on it
        line = meta["REF_FRAME_EPOCH"].line
        raise source.error(line, f"must not be given, {frame} is read as of date", "REF_FRAME_EPOCH")
    for row, line in zip(rows.cells, rows.lines, strict=True):
        if len(row) not in (7, 10):
            rule = "must have 7 or 10 values (a date, position, velocity, and acceleration or none)"
            raise source.error(line, rule, value=len(row))
    common = _common_fields(source, segment, "INTERPOLATION")
    values = 1e3 * numbers_of(source, rows, 1, 6)
    _ = numbers_of(source, Rows([row[7:] or ["0"] * 3 for row in rows.cells], rows.lines), 0, 3)  # accelerations
    return EphemerisSegment(frame=frame, position_m=values[:, :3], velocity_m_s=values[:, 3:6], **common)


def _attitude(source: SourceFile, segment: _MessageSegment, version: float) -> AttitudeSegment:
    meta = segment.meta
    if "CENTER_NAME" in meta:
        _check_center(source, meta["CENTER_NAME"])
    frame, body_frame, a_is_body = _attitude_frames(source, meta)
    common = _common_fields(source, segment, "INTERPOLATION_METHOD")
    kind = meta["ATTITUDE_TYPE"].text.upper().replace(" ", "_").replace("EULER_ANGLES", "EULER_ANGLE")
    rates = None
    if kind in _N_QUATERNION_CELLS:
        quaternion, rates = _quaternions(source, segment, kind, version)
    elif kind == "EULER_ANGLE":
        quaternion = _from_euler_angles(source, segment)
    else:
        known = ", ".join((*_N_QUATERNION_CELLS, "EULER_ANGLE"))
        raise source.error(meta["ATTITUDE_TYPE"].line, f"must be one of {known}", "ATTITUDE_TYPE", kind)
    # A quaternion of A to B turns components in B into those in A (it is the turn that carries A's axes to B's).
    backwards = a_is_body != _goes_backwards(source, segment, version)
    turned = conjugate(quaternion) if backwards else quaternion
    rate_rad_s = None
    if kind == "QUATERNION/DERIVATIVE" and rates is not None:
        rate_rad_s = 2.0 * product(conjugate(turned), conjugate(rates) if backwards else rates)[:, :3]
    elif rates is not None:
        rate_rad_s = _body_rates(source, meta, np.radians(rates), turned, a_is_body)
    return AttitudeSegment(frame=frame, body_frame=body_frame, quaternion=turned, rate_rad_s=rate_rad_s, **common)


def _body_rates(source: SourceFile, meta: dict[str, _KeywordValue], rate: F64, quaternion: F64, a_is_body: bool) -> F64:
    """Angular velocities of the body in its own axes, from those of frame B relative to A in the axes of either."""
    stated = meta.get("ANGVEL_FRAME", meta.get("RATE_FRAME"))
    in_body = True
    if stated is not None:
        names = {"REF_FRAME_A": "A", meta["REF_FRAME_A"].text.upper(): "A"}
        names |= {"REF_FRAME_B": "B", meta["REF_FRAME_B"].text.upper(): "B"}
        if stated.text.upper() not in names:
            raise source.error(stated.line, "must be REF_FRAME_A or REF_FRAME_B", "ANGVEL_FRAME", stated.text)
        in_body = (names[stated.text.upper()] == "A") == a_is_body
    rate = rate if in_body else rotated(conjugate(quaternion), rate)
    return -rate if a_is_body else rate


def _check_center(source: SourceFile, center: _KeywordValue) -> None:
    if center.text.upper() != "EARTH":
        raise source.error(center.line, "must be EARTH", "CENTER_NAME", center.text)


def _common_fields(source: SourceFile, segment: _MessageSegment, method_keyword: str) -> dict[str, Any]:
    """Fields that both kinds of segments have; the rows must fill START_TIME to STOP_TIME."""
    meta, rows = segment.meta, segment.rows
    with source.at(meta["TIME_SYSTEM"].line, "TIME_SYSTEM"):
        system = check_time_system(meta["TIME_SYSTEM"].text)

    def date(keyword: str) -> FileInstants:
        return dates_of(source, [meta[keyword].text], [meta[keyword].line], system, keyword)

    instants = dates_of(source, [row[0] if row else "" for row in rows.cells], rows.lines, system)
    for keyword, end in (("START_TIME", 0), ("STOP_TIME", -1)):
        off_s = float(instants[end].since_instant(date(keyword))[0])
        if abs(off_s) > _SPAN_SLACK_S:
            row, side = ("first" if end == 0 else "last"), ("after" if off_s > 0 else "before")
            rule = f"must be the time of the {row} row, which is {abs(off_s):g} s {side} it (a file cut off?)"
            raise source.error(meta[keyword].line, rule, keyword)
    useable, keywords = None, ("USEABLE_START_TIME", "USEABLE_STOP_TIME")
    if any(keyword in meta for keyword in keywords):
        pairs = zip(keywords, (0, -1), strict=True)
        ends = [date(keyword) if keyword in meta else instants[end] for keyword, end in pairs]
        day, second = (np.concatenate([getattr(end, part) for end in ends]) for part in ("day", "second"))
        useable = FileInstants(day, second)
    method, degree = meta.get(method_keyword), meta.get("INTERPOLATION_DEGREE")
    if method is not None and method.text.upper() not in _METHODS:
        raise source.error(method.line, f"must be one of {', '.join(_METHODS)}", method_keyword, method.text)
    return {
        "object_name": meta["OBJECT_NAME"].text,
        "object_id": meta["OBJECT_ID"].text,
        "instants": instants,
        "interpolation": None if method is None else _METHODS[method.text.upper()],
        "degree": degree and whole_number_of(source, degree.line, degree.text, "INTERPOLATION_DEGREE"),
        "useable": useable,
        "time_system": system,
        "file": source.file,
        "line": segment.line,
        "lines": np.array(rows.lines, np.int64),
    }


def _attitude_frames(source: SourceFile, meta: dict[str, _KeywordValue]) -> tuple[Frame, str, bool]:
    """Reference frame, the body's name for its own, and whether the body is frame A."""
    a, b = meta["REF_FRAME_A"], meta["REF_FRAME_B"]
    known = ccsds_frame(a.text), ccsds_frame(b.text)
    if (known[0] is None) == (known[1] is None):
        rule = f"must be a frame of the Earth or the sky and one of the body, got {a.text!r} and {b.text!r}"
        raise source.error(a.line, rule, "REF_FRAME_A, REF_FRAME_B")
    for name in (a, b):
        if name.text.upper().startswith(("LVLH", "RSW", "RTN", "TNW", "QSW", "NTW", "VNC", "PQW", "VVLH")):
            raise source.error(name.line, "must not be an orbit's frame", "REF_FRAME", name.text)
    if known[0] is not None:
        return known[0], b.text, False
    assert known[1] is not None
    return known[1], a.text, True


def _goes_backwards(source: SourceFile, segment: _MessageSegment, version: float) -> bool:
    """Return whether the data lead from frame B to frame A."""
    direction = segment.meta.get("ATTITUDE_DIR")
    if direction is None:
        if version < 2.0:
            raise source.error(segment.line, "must have ATTITUDE_DIR", "metadata")
        return False
    if direction.text.upper() not in ("A2B", "B2A"):
        raise source.error(direction.line, "must be A2B or B2A", "ATTITUDE_DIR", direction.text)
    return direction.text.upper() == "B2A"


def _quaternions(source: SourceFile, segment: _MessageSegment, kind: str, version: float) -> tuple[F64, F64 | None]:
    """Quaternions of the rows, scalar last, and what stands beside them: derivatives of these, or rates [deg/s]."""
    rows, order = segment.rows, segment.meta.get("QUATERNION_TYPE")
    n_cell = 5 if source.is_xml else _N_QUATERNION_CELLS[kind]
    check_cells(source, rows, (n_cell,), "a date, a quaternion, and its rate where ATTITUDE_TYPE says so")
    values = numbers_of(source, rows, 1, n_cell - 1)
    if order is None:
        if version < 2.0 and not source.is_xml:
            raise source.error(segment.line, "must have QUATERNION_TYPE", "metadata")
        return values[:, :4], values[:, 4:] if n_cell > 5 else None
    if order.text.upper() not in ("FIRST", "LAST"):
        raise source.error(order.line, "must be FIRST or LAST", "QUATERNION_TYPE", order.text)
    # In XML the components have names, so their order says nothing.
    first = order.text.upper() == "FIRST" and not source.is_xml
    if n_cell == 5:
        return (values[:, [1, 2, 3, 0]] if first else values), None
    if n_cell == 8:
        return values[:, [1, 2, 3, 0]] if first else values[:, :4], values[:, 4:]
    return values[:, [1, 2, 3, 0]] if first else values[:, :4], values[:, [5, 6, 7, 4]] if first else values[:, 4:]


def _from_euler_angles(source: SourceFile, segment: _MessageSegment) -> F64:
    """Quaternions of turns about three axes, one after the other, each about the axes as turned so far."""
    from scipy.spatial.transform import Rotation

    sequence = segment.meta.get("EULER_ROT_SEQ")
    if sequence is None:
        raise source.error(segment.line, "must have EULER_ROT_SEQ", "metadata")
    check_cells(source, segment.rows, (4,), "a date and three angles")
    angle_deg = numbers_of(source, segment.rows, 1, 3)
    axes = sequence.text.strip().upper().translate(str.maketrans("123", "XYZ"))
    if not re.fullmatch(r"(?!(.)\1)(?!.(.)\2)[XYZ]{3}", axes):
        rule = "must be three axes like ZXZ or 321"
        raise source.error(sequence.line, rule, "EULER_ROT_SEQ", sequence.text[:20])
    return np.asarray(Rotation.from_euler(axes, angle_deg, degrees=True).as_quat(), np.float64)
