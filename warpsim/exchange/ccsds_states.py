"""CCSDS OPM (one state) and OCM (trajectories) in text, 502.0-B-2/3, as segments."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpsim.exchange.instants import FileInstants, check_time_system, later
from warpsim.exchange.segments import EphemerisSegment, Frame, Interpolation, known_ccsds_frame
from warpsim.exchange.source import Rows, SourceFile, check_cells, dates_of, number_of, numbers_of, whole_number_of

F64 = NDArray[np.float64]

_METHODS: dict[str, Interpolation] = {"LINEAR": "linear", "LAGRANGE": "lagrange", "HERMITE": "hermite"}
_N_CELLS = {"CARTP": 4, "CARTPV": 7, "CARTPVA": 10}
_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")


class _Value(NamedTuple):
    """A value without its unit, and its line."""

    text: str
    line: int


def message_kind(source: SourceFile) -> str:
    """Return the kind of a CCSDS message in text, as in "OEM"; "" where it is none."""
    match = re.match(r"(\s*COMMENT[^\n]*\n)*\s*CCSDS_([A-Z]+)_VERS", source.head)
    return "" if match is None else match[2]


def read_opm(source: SourceFile) -> list[EphemerisSegment]:
    """The segment of an OPM, of its one state; maneuvers, covariances and elements are passed over."""
    known, _ = _assignments(source.lines())
    state = [
        number_of(source, item.line, item.text, name) for name in _STATE for item in [_needed(source, known, name)]
    ]
    epoch = _needed(source, known, "EPOCH")
    system = _system(source, known)
    if "MAN_EPOCH_IGNITION" in known:
        line = known["MAN_EPOCH_IGNITION"].line
        raise source.error(line, "must not be given, maneuvers are not flown", "MAN_EPOCH_IGNITION")
    values = 1e3 * np.array([state])
    return [
        EphemerisSegment(
            object_name=_needed(source, known, "OBJECT_NAME").text,
            object_id=known.get("OBJECT_ID", _Value("", 0)).text,
            frame=_frame(source, known, "REF_FRAME"),
            instants=dates_of(source, [epoch.text], [epoch.line], system, "EPOCH"),
            position_m=values[:, :3],
            velocity_m_s=values[:, 3:],
            time_system=system,
            file=source.file,
            line=epoch.line,
        )
    ]


def read_ocm(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of an OCM, one for each trajectory of positions, or positions and velocities."""
    lines = source.lines()
    start, stop = _block(lines, "META")
    if start is None or stop is None:
        raise source.error(0, "must have META_START and META_STOP")
    meta, _ = _assignments(lines[start + 1 : stop])
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


def _trajectory(
    source: SourceFile, meta: dict[str, _Value], lines: list[tuple[int, str]], line: int
) -> EphemerisSegment:
    known, rows = _assignments(lines)
    kind = known.get("TRAJ_TYPE", _Value("CARTPV", line))
    if kind.text.upper() not in _N_CELLS:
        raise source.error(kind.line, f"must be one of {', '.join(_N_CELLS)}", "TRAJ_TYPE", kind.text)
    units = known.get("TRAJ_UNITS")
    if units is not None and not set(re.findall(r"[\w/*]+", units.text.lower())) <= {"km", "km/s", "km/s**2"}:
        raise source.error(units.line, "must be km and km/s", "TRAJ_UNITS", units.text)
    if not rows.cells:
        raise source.error(line, "must hold data, got none", "trajectory")
    n_cell = _N_CELLS[kind.text.upper()]
    check_cells(source, rows, (n_cell,), "a time, and what TRAJ_TYPE says")
    values = 1e3 * numbers_of(source, rows, 1, n_cell - 1)
    method = known.get("INTERPOLATION")
    if method is not None and method.text.upper() not in _METHODS:
        raise source.error(method.line, f"must be one of {', '.join(_METHODS)}", "INTERPOLATION", method.text)
    degree = known.get("INTERPOLATION_DEGREE")
    system = _system(source, meta)
    return EphemerisSegment(
        object_name=meta.get("OBJECT_NAME", _Value("object", 0)).text,
        object_id=meta.get("INTERNATIONAL_DESIGNATOR", _Value("", 0)).text,
        frame=_frame(source, known, "TRAJ_REF_FRAME"),
        instants=_instants(source, meta, rows, system),
        position_m=values[:, :3],
        velocity_m_s=values[:, 3:6] if n_cell > 4 else None,
        interpolation=None if method is None else _METHODS[method.text.upper()],
        degree=None if degree is None else whole_number_of(source, degree.line, degree.text, "INTERPOLATION_DEGREE"),
        time_system=system,
        file=source.file,
        line=line,
        lines=np.array(rows.lines, np.int64),
    )


def _instants(source: SourceFile, meta: dict[str, _Value], rows: Rows, system: str) -> FileInstants:
    """Times of rows: dates, or seconds after EPOCH_TZERO."""
    texts = [row[0] for row in rows.cells]
    if ":" in texts[0]:
        return dates_of(source, texts, rows.lines, system)
    zero = _needed(source, meta, "EPOCH_TZERO")
    return later(
        dates_of(source, [zero.text], [zero.line], system, "EPOCH_TZERO"), numbers_of(source, rows, 0, 1)[:, 0]
    )


def _block(lines: list[tuple[int, str]], name: str) -> tuple[int | None, int | None]:
    """Indices of the lines that open and close a block."""
    found = [
        next((i for i, (_, line) in enumerate(lines) if line == f"{name}_{end}"), None) for end in ("START", "STOP")
    ]
    return found[0], found[1]


def _assignments(lines: Iterable[tuple[int, str]]) -> tuple[dict[str, _Value], Rows]:
    """Values by keyword, the first of each, without units in brackets; and lines that are rows."""
    found: dict[str, _Value] = {}
    rows = Rows([], [])
    for number, line in lines:
        match = re.fullmatch(r"([A-Z_0-9]+)\s*=\s*(.*?)\s*(\[[^\]]*\])?", line)
        if match is not None:
            found.setdefault(match[1], _Value(match[2], number))
        elif line[0] in "+-.0123456789":
            rows.add(number, line.split())
    return found, rows


def _needed(source: SourceFile, known: dict[str, _Value], keyword: str) -> _Value:
    if keyword not in known:
        raise source.error(0, "is required", keyword)
    return known[keyword]


def _system(source: SourceFile, known: dict[str, _Value]) -> str:
    system = known.get("TIME_SYSTEM", _Value("UTC", 0))
    with source.at(system.line, "TIME_SYSTEM"):
        return check_time_system(system.text)


def _frame(source: SourceFile, known: dict[str, _Value], keyword: str) -> Frame:
    center = known.get("CENTER_NAME", _Value("EARTH", 0))
    if center.text.upper() != "EARTH":
        raise source.error(center.line, "must be EARTH", "CENTER_NAME", center.text)
    frame = known.get(keyword, _Value("ICRF", 0))
    with source.at(frame.line, keyword):
        if frame.text.upper().startswith("ICRF3"):
            return "GCRF"
        return known_ccsds_frame(frame.text)
