"""CCSDS OEM (states, in text or XML), OPM (one state) and OCM (trajectories), 502.0-B-2/3, as segments."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from warpsim.exchange.ccsds_message import (
    MessageSegment,
    check_center,
    common_fields,
    interpolation,
    read_message,
    time_system,
)
from warpsim.exchange.instants import FileInstants, later
from warpsim.exchange.segments import EphemerisSegment, Frame, known_ccsds_frame
from warpsim.exchange.source import Keywords, Rows, SourceFile, number_of

_N_CELLS = {"CARTP": 4, "CARTPV": 7, "CARTPVA": 10}
_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


def read_oem(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of an OEM."""
    optional = ("REF_FRAME_EPOCH", "INTERPOLATION")
    _, segments = read_message(source, "OEM", ("CENTER_NAME", "REF_FRAME"), optional)
    return [_ephemeris(segment) for segment in segments]


def _ephemeris(segment: MessageSegment) -> EphemerisSegment:
    meta, rows = segment
    frame = _frame(meta, "REF_FRAME")
    if "REF_FRAME_EPOCH" in meta and frame not in ("GCRF", "EME2000", "ITRF"):  # which do not depend on it
        raise meta.error("REF_FRAME_EPOCH", f"must not be given, {frame} is read as of date")
    for row, line in zip(rows.cells, rows.lines, strict=True):
        if len(row) not in (7, 10):
            rule = "must have 7 or 10 values (a date, position, velocity, and acceleration or none)"
            raise rows.source.error(line, rule, value=len(row))
    common = common_fields(segment, "INTERPOLATION")
    values = 1e3 * rows.numbers(1, 6)
    _ = Rows(rows.source, [row[7:] or ["0"] * 3 for row in rows.cells], rows.lines).numbers(0, 3)  # accelerations
    return EphemerisSegment(frame=frame, position_m=values[:, :3], velocity_m_s=values[:, 3:6], **common)


def read_opm(source: SourceFile) -> list[EphemerisSegment]:
    """The segment of an OPM, of its one state; maneuvers, covariances and elements are passed over."""
    known, _ = _assignments(source, source.lines())
    _need(known, *_STATE, "EPOCH")
    state = [number_of(source, known.line_of(name), known.text(name), name) for name in _STATE]
    system = time_system(known)
    if "MAN_EPOCH_IGNITION" in known:
        raise known.error("MAN_EPOCH_IGNITION", "must not be given, maneuvers are not flown")
    _need(known, "OBJECT_NAME")
    values = 1e3 * np.array([state])
    return [
        EphemerisSegment(
            object_name=known.text("OBJECT_NAME"),
            object_id=known.text("OBJECT_ID"),
            frame=_frame(known, "REF_FRAME"),
            instants=known.date("EPOCH", system),
            position_m=values[:, :3],
            velocity_m_s=values[:, 3:],
            time_system=system,
            file=source.file,
            line=known.line_of("EPOCH"),
        )
    ]


def read_ocm(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of an OCM, one for each trajectory of positions, or positions and velocities."""
    lines = source.lines()
    start, stop = _block(lines, "META")
    if start is None or stop is None:
        raise source.error(0, "must have META_START and META_STOP")
    meta, _ = _assignments(source, lines[start + 1 : stop])
    segments = []
    rest = lines[stop + 1 :]
    while True:
        start, stop = _block(rest, "TRAJ")
        if start is None:
            break
        if stop is None:
            raise source.error(rest[start][0], "ends early: TRAJ_STOP must close what begins here")
        segments.append(_trajectory(source, meta, rest[start + 1 : stop], rest[start][0]))
        rest = rest[stop + 1 :]
    if not segments:
        raise source.error(0, "must have a trajectory (TRAJ_START)")
    return segments


def _trajectory(source: SourceFile, meta: Keywords, lines: list[tuple[int, str]], line: int) -> EphemerisSegment:
    known, rows = _assignments(source, lines)
    n_cell = _N_CELLS[known.one_of("TRAJ_TYPE", list(_N_CELLS), "CARTPV")]
    units = known.text("TRAJ_UNITS")
    if not set(re.findall(r"[\w/*]+", units.lower())) <= {"km", "km/s", "km/s**2"}:
        raise known.error("TRAJ_UNITS", "must be km and km/s", units)
    if not rows.cells:
        raise source.error(line, "must hold data, got none", "trajectory")
    rows.check(n_cell, "a time, and what TRAJ_TYPE says")
    values = 1e3 * rows.numbers(1, n_cell - 1)
    system = time_system(meta)
    return EphemerisSegment(
        object_name=meta.text("OBJECT_NAME", "object"),
        object_id=meta.text("INTERNATIONAL_DESIGNATOR"),
        frame=_frame(known, "TRAJ_REF_FRAME"),
        instants=_instants(meta, rows, system),
        position_m=values[:, :3],
        velocity_m_s=values[:, 3:6] if n_cell > 4 else None,
        **interpolation(known, "INTERPOLATION"),
        time_system=system,
        file=source.file,
        line=line,
        lines=np.array(rows.lines, np.int64),
    )


def _instants(meta: Keywords, rows: Rows, system: str) -> FileInstants:
    """Times of rows: dates, or seconds after EPOCH_TZERO."""
    if ":" in rows.cells[0][0]:
        return rows.dates(system)
    _need(meta, "EPOCH_TZERO")
    return later(meta.date("EPOCH_TZERO", system), rows.numbers(0, 1)[:, 0])


def _block(lines: list[tuple[int, str]], name: str) -> tuple[int | None, int | None]:
    text = [line for _, line in lines]
    start, stop = (text.index(mark) if mark in text else None for mark in (f"{name}_START", f"{name}_STOP"))
    return start, stop


def _assignments(source: SourceFile, lines: Iterable[tuple[int, str]]) -> tuple[Keywords, Rows]:
    """Values by keyword, the first of each, without units in brackets; and lines that are rows."""
    found, rows = Keywords(source), Rows(source)
    for number, line in lines:
        match = re.fullmatch(r"([A-Z_0-9]+)\s*=\s*(.*?)\s*(\[[^\]]*\])?", line)
        if match is not None and match[1] not in found:
            found.add(match[1], match[2], number)
        elif match is None and line[0] in "+-.0123456789":
            rows.add(number, line.split())
    return found, rows


def _need(known: Keywords, *keywords: str) -> None:
    for keyword in keywords:
        if keyword not in known:
            raise known.error(keyword, "is required")


def _frame(known: Keywords, keyword: str) -> Frame:
    """The frame of states about the Earth; ICRF where it is not given."""
    check_center(known)
    with known.source.at(known.line_of(keyword), keyword):
        return known_ccsds_frame(known.text(keyword, "ICRF"))
