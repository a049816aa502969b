"""CCSDS OEM (orbits) and AEM (attitudes) as segments: 502.0-B-2/3 and 504.0-B-1/2."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.exchange.ccsds_message import KeywordValue, MessageSegment, read_message
from warpsim.exchange.instants import FileInstants, check_time_system
from warpsim.exchange.segments import (
    AttitudeSegment,
    EphemerisSegment,
    Frame,
    Interpolation,
    ccsds_frame,
    known_ccsds_frame,
)
from warpsim.exchange.source import SourceFile, check_cells, dates_of, numbers_of, whole_number_of
from warpsim.quaternion import conjugate

F64 = NDArray[np.float64]

_COMMON = {
    "OBJECT_NAME": True,
    "OBJECT_ID": True,
    "TIME_SYSTEM": True,
    "START_TIME": True,
    "USEABLE_START_TIME": False,
    "USEABLE_STOP_TIME": False,
    "STOP_TIME": True,
    "INTERPOLATION_DEGREE": False,
}
_OEM = {**_COMMON, "CENTER_NAME": True, "REF_FRAME": True, "REF_FRAME_EPOCH": False, "INTERPOLATION": False}
_AEM = {
    **_COMMON,
    "CENTER_NAME": False,
    "REF_FRAME_A": True,
    "REF_FRAME_B": True,
    "ATTITUDE_DIR": False,
    "ATTITUDE_TYPE": True,
    "QUATERNION_TYPE": False,
    "EULER_ROT_SEQ": False,
    "RATE_FRAME": False,
    "ANGVEL_FRAME": False,
    "INTERPOLATION_METHOD": False,
}
_METHODS: dict[str, Interpolation] = {"LINEAR": "linear", "LAGRANGE": "lagrange", "HERMITE": "hermite"}
_N_QUATERNION_CELLS = {"QUATERNION": 5, "QUATERNION/DERIVATIVE": 9, "QUATERNION/RATE": 8, "QUATERNION/ANGVEL": 8}
_SPAN_SLACK_S = 1.0
"""How far the data may miss START_TIME and STOP_TIME, which some programs round."""


def read_oem(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of an OEM."""
    return [_ephemeris(source, segment) for segment in read_message(source, "OEM", _OEM).segments]


def read_aem(source: SourceFile) -> list[AttitudeSegment]:
    """Segments of an AEM."""
    message = read_message(source, "AEM", _AEM)
    return [_attitude(source, segment, message.version) for segment in message.segments]


def _ephemeris(source: SourceFile, segment: MessageSegment) -> EphemerisSegment:
    meta, rows = segment.meta, segment.rows
    _check_center(source, meta["CENTER_NAME"])
    with source.at(meta["REF_FRAME"].line, "REF_FRAME"):
        frame = known_ccsds_frame(meta["REF_FRAME"].text)
    if "REF_FRAME_EPOCH" in meta and frame not in ("GCRF", "EME2000"):
        line = meta["REF_FRAME_EPOCH"].line
        raise source.error(line, f"must not be given, {frame} is read as of date", "REF_FRAME_EPOCH")
    check_cells(source, rows, (7, 10), "a date, position, velocity, and acceleration or none")
    common = _common_fields(source, segment, "INTERPOLATION")
    values = 1e3 * numbers_of(source, rows, 1, len(rows.cells[0]) - 1)
    return EphemerisSegment(frame=frame, position_m=values[:, :3], velocity_m_s=values[:, 3:6], **common)


def _attitude(source: SourceFile, segment: MessageSegment, version: float) -> AttitudeSegment:
    meta = segment.meta
    if "CENTER_NAME" in meta:
        _check_center(source, meta["CENTER_NAME"])
    frame, body_frame, a_is_body = _attitude_frames(source, meta)
    common = _common_fields(source, segment, "INTERPOLATION_METHOD")
    kind = meta["ATTITUDE_TYPE"].text.upper().replace(" ", "_").replace("EULER_ANGLES", "EULER_ANGLE")
    if kind in _N_QUATERNION_CELLS:
        quaternion = _quaternions(source, segment, kind, version)
    elif kind == "EULER_ANGLE":
        quaternion = _from_euler_angles(source, segment)
    else:
        known = ", ".join((*_N_QUATERNION_CELLS, "EULER_ANGLE"))
        raise source.error(meta["ATTITUDE_TYPE"].line, f"must be one of {known}", "ATTITUDE_TYPE", kind)
    # A quaternion of A to B turns components in B into those in A (it is the turn that carries A's axes to B's).
    if a_is_body != _goes_backwards(source, meta, segment, version):
        quaternion = conjugate(quaternion)
    return AttitudeSegment(frame=frame, body_frame=body_frame, quaternion=quaternion, **common)


def _check_center(source: SourceFile, center: KeywordValue) -> None:
    if center.text.upper() != "EARTH":
        raise source.error(center.line, "must be EARTH", "CENTER_NAME", center.text)


def _common_fields(source: SourceFile, segment: MessageSegment, method_keyword: str) -> dict[str, Any]:
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


def _attitude_frames(source: SourceFile, meta: dict[str, KeywordValue]) -> tuple[Frame, str, bool]:
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


def _goes_backwards(source: SourceFile, meta: dict[str, KeywordValue], segment: MessageSegment, version: float) -> bool:
    """Return whether the data lead from frame B to frame A."""
    direction = meta.get("ATTITUDE_DIR")
    if direction is None:
        if version < 2.0:
            raise source.error(segment.line, "must have ATTITUDE_DIR", "metadata")
        return False
    if direction.text.upper() not in ("A2B", "B2A"):
        raise source.error(direction.line, "must be A2B or B2A", "ATTITUDE_DIR", direction.text)
    return direction.text.upper() == "B2A"


def _quaternions(source: SourceFile, segment: MessageSegment, kind: str, version: float) -> F64:
    """Quaternions of the rows, scalar last; rates beside them are checked and left out."""
    rows, order = segment.rows, segment.meta.get("QUATERNION_TYPE")
    n_cell = 5 if source.is_xml else _N_QUATERNION_CELLS[kind]
    check_cells(source, rows, (n_cell,), "a date, a quaternion, and its rate where ATTITUDE_TYPE says so")
    values = numbers_of(source, rows, 1, n_cell - 1)
    if order is None:
        if version < 2.0 and not source.is_xml:
            raise source.error(segment.line, "must have QUATERNION_TYPE", "metadata")
        return values[:, :4]
    if order.text.upper() not in ("FIRST", "LAST"):
        raise source.error(order.line, "must be FIRST or LAST", "QUATERNION_TYPE", order.text)
    # In XML the components have names, so their order says nothing.
    first = order.text.upper() == "FIRST" and not source.is_xml
    return values[:, [1, 2, 3, 0]] if first else values[:, :4]


def _from_euler_angles(source: SourceFile, segment: MessageSegment) -> F64:
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
