"""STK files: ephemerides (.e) and attitudes (.a) of versions 4 to 12, as segments."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.exchange.geodetic import geodetic_to_itrs_m, great_arcs
from warpsim.exchange.instants import FileInstants, later
from warpsim.exchange.segments import (
    NORM_SLACK,
    STK_NAME,
    AttitudeSegment,
    EphemerisSegment,
    Frame,
    Interpolation,
)
from warpsim.exchange.source import Keywords, Rows, SourceFile, dates_of, number_of

_VERSION = re.compile(r"stk\.v\.(\d+)(\.\d+)*", re.ASCII | re.IGNORECASE)
_UNITS = {"meters": 1.0, "meter": 1.0, "m": 1.0, "kilometers": 1e3, "kilometer": 1e3, "km": 1e3}
_DEFAULT_SAMPLES_M1 = 5
"""STK's own, for files that name none."""

_COMMON = ("ScenarioEpoch", "CentralBody", "InterpolationMethod", "InterpolationOrder", "InterpolationSamplesM1",
           "BlockingFactor", "TimeFormat", "MessageLevel")  # fmt: skip
_EPHEMERIS_KEYWORDS = (*_COMMON, "NumberOfEphemerisPoints", "CoordinateSystem", "CoordinateSystemEpoch",
                       "DistanceUnit", "EphemerisName", "NumberOfCovariancePoints", "CovarianceFormat")  # fmt: skip
_ATTITUDE_KEYWORDS = (*_COMMON, "NumberOfAttitudePoints", "CoordinateAxes", "CoordinateAxesEpoch", "Sequence",
                      "AttitudeDeviations")  # fmt: skip
_EPHEMERIS_DATA = {"EphemerisTimePos": 4, "EphemerisTimePosVel": 7, "EphemerisTimePosVelAcc": 10,
                   "EphemerisLLATimePos": 4, "EphemerisLLATimePosVel": 7}  # fmt: skip
_ATTITUDE_DATA = {"AttitudeTimeQuaternions": 5, "AttitudeTimeQuatScalarFirst": 5, "AttitudeTimeQuatAngVels": 8,
                  "AttitudeTimeEulerAngles": 4, "AttitudeTimeYPRAngles": 4, "AttitudeTimeDCM": 10,
                  "AttitudeTimeDCMAngVels": 13}  # fmt: skip

_SAME_S = 1e-6
"""Times closer than this are the same where a boundary is looked for."""


class _Block:
    """Content between BEGIN and END."""

    def __init__(self, source: SourceFile, line: int) -> None:
        self.given = Keywords(source, line)
        self.boundary_s: list[float] = []
        self.data = ""  # keyword that began the data
        self.rows = Rows(source)


def is_stk(source: SourceFile) -> bool:
    """Return whether a file looks like one of STK's."""
    return re.match(r"(\s*#[^\n]*\n)*\s*stk\.v\.", source.head, re.IGNORECASE) is not None


def read_stk_ephemeris(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of an ephemeris file, cut at its segment boundaries. The object is called as the file is."""
    block = _read_block(source, "Ephemeris", _EPHEMERIS_KEYWORDS, _EPHEMERIS_DATA)
    frame, epoch = _frame_and_epoch(source, block, "CoordinateSystem")
    unit = block.given.text("DistanceUnit", "meters")
    if unit.lower() not in _UNITS:
        raise block.given.error("DistanceUnit", "must be Meters or Kilometers", unit)
    unit_m = _UNITS[unit.lower()]
    values = _checked_values(block, _EPHEMERIS_DATA[block.data], "NumberOfEphemerisPoints")
    arcs, method, degree = _interpolation(block)
    velocity_m_s: F64 | None = None
    if block.data.startswith("EphemerisLLA"):
        _check_geodetic(source, block, frame, values)
        position_m = geodetic_to_itrs_m(values[:, 2], values[:, 1], unit_m * values[:, 3])
    else:
        position_m = unit_m * values[:, 1:4]
        velocity_m_s = unit_m * values[:, 4:7] if values.shape[1] >= 7 else None
    if block.data.startswith("EphemerisLLA") and not arcs:
        method = "lagrange"  # of the positions alone
    segments = []
    for rows in _pieces(values[:, 0], block.boundary_s):
        states = values[rows, 0], position_m[rows], None if velocity_m_s is None else velocity_m_s[rows]
        if arcs:
            states, degree = great_arcs(*states[:2]), 3
        segments.append(
            EphemerisSegment(
                object_name=Path(source.file).stem,
                object_id="",
                frame=frame,
                instants=later(epoch, states[0]),
                position_m=states[1],
                velocity_m_s=states[2],
                interpolation=method,
                degree=degree,
                sampled=arcs,
                file=source.file,
                line=block.rows.lines[rows.start],
                lines=None if arcs else np.array(block.rows.lines[rows], np.int64),
            )
        )
    return segments


def _check_geodetic(source: SourceFile, block: _Block, frame: Frame, values: F64) -> None:
    """Check that geodetic positions are in the Earth's axes, and latitudes."""
    if frame != "ITRF":
        raise block.given.error("CoordinateSystem", "must be Fixed for geodetic positions")
    bad = np.abs(values[:, 1]) > 90.0
    if bad.any():
        row = int(np.argmax(bad))
        raise source.error(block.rows.lines[row], "must be in [-90, 90] deg", "latitude", values[row, 1], "g")


def read_stk_attitude(source: SourceFile) -> list[AttitudeSegment]:
    """The segment of an attitude file."""
    block = _read_block(source, "Attitude", _ATTITUDE_KEYWORDS, _ATTITUDE_DATA)
    frame, epoch = _frame_and_epoch(source, block, "CoordinateAxes")
    values = _checked_values(block, _ATTITUDE_DATA[block.data], "NumberOfAttitudePoints")
    return [
        AttitudeSegment(
            object_name=Path(source.file).stem,
            object_id="",
            frame=frame,
            body_frame="body",
            instants=later(epoch, values[:, 0]),
            quaternion=_quaternions(source, block, values),
            rate_rad_s=np.radians(values[:, -3:]) if block.data.endswith("AngVels") else None,  # in its axes
            file=source.file,
            line=block.given.line,
            lines=np.array(block.rows.lines, np.int64),
        )
    ]


def _quaternions(source: SourceFile, block: _Block, values: F64) -> F64:
    """Quaternions, scalar last, of the turns that carry the reference axes to the body's."""
    from scipy.spatial.transform import Rotation

    if "Quat" in block.data:
        return values[:, [2, 3, 4, 1] if block.data == "AttitudeTimeQuatScalarFirst" else [1, 2, 3, 4]]
    if "DCM" in block.data:
        rows = values[:, 1:10].reshape(-1, 3, 3)  # the body's axes
        with np.errstate(over="ignore", invalid="ignore"):
            off = np.abs(rows @ np.swapaxes(rows, 1, 2) - np.eye(3)).max(axis=(1, 2))
            good = (off <= NORM_SLACK) & (np.linalg.det(rows) > 0)
        if not good.all():
            raise source.error(block.rows.lines[int(np.argmin(good))], "must be the matrix of a rotation", block.data)
        return np.asarray(Rotation.from_matrix(np.swapaxes(rows, 1, 2)).as_quat(), np.float64)
    about_body = block.data == "AttitudeTimeEulerAngles"  # the axes as turned so far; otherwise those of the reference
    text = block.given.text("Sequence", "313" if about_body else "321")
    if not re.fullmatch(r"(?!(.)\1)(?!.(.)\2)[123]{3}" if about_body else r"(?!.*(.).*\1)[123]{3}", text):
        rule = f"must be three axes like {'313 or ' if about_body else ''}321"
        raise block.given.error("Sequence", rule, text[:20])
    # Yaw, pitch and roll, about axes 3, 2 and 1, stand in this order whatever the sequence.
    angles = values[:, 1:4] if about_body else values[:, [4 - int(axis) for axis in text]]
    axes = text.translate(str.maketrans("123", "XYZ" if about_body else "xyz"))
    return np.asarray(Rotation.from_euler(axes, angles, degrees=True).as_quat(), np.float64)


def _read_block(source: SourceFile, name: str, keywords: tuple[str, ...], data: dict[str, int]) -> _Block:
    """Keywords and rows of the block BEGIN name ... END name."""
    lines = [(number, line) for number, line in source.lines() if not line.startswith("#")]
    if not lines or not _VERSION.fullmatch(lines[0][1]):
        raise source.error(lines[0][0] if lines else 0, "must begin with stk.v. and a version")
    begin = next((i for i, (_, line) in enumerate(lines) if _words(line) == ["begin", name.lower()]), None)
    if begin is None:
        raise source.error(0, f"must have the line BEGIN {name}, got none")
    block = _Block(source, lines[begin][0])
    known = {word.lower(): word for word in (*keywords, *data)}
    inside = ""  # "covariance", which is passed over, or "boundary"
    for number, line in lines[begin + 1 :]:
        words = _words(line)
        if words == ["end", name.lower()] and inside != "boundary":
            break
        if inside == "covariance":
            continue
        if words == ["end", "segmentboundarytimes"] and inside:
            inside = ""
        elif inside:
            block.boundary_s += [number_of(source, number, word, "SegmentBoundaryTimes") for word in line.split()]
        elif words == ["begin", "segmentboundarytimes"]:
            inside = "boundary"
        elif words[0] == "begin":
            raise source.error(number, "must be a block that is read", value=line[:40])
        elif words[0].startswith("covariancetime"):
            inside = "covariance"
        elif block.data and words[0][0] in "+-.0123456789":
            block.rows.add(number, line.split())
        else:
            _read_keyword(source, block, known, data, number, line)
    else:
        raise source.error(block.given.line, f"ends early: END {name} must close what begins here")
    if not block.data:
        raise source.error(block.given.line, f"must hold data: one of {', '.join(data)}")
    if not block.rows.cells:
        raise source.error(block.given.line, f"must hold data, got none after {block.data}")
    return block


def _read_keyword(
    source: SourceFile, block: _Block, known: dict[str, str], data: dict[str, int], number: int, line: str
) -> None:
    word, _, value = line.replace("\t", " ").partition(" ")
    keyword = known.get(word.lower())
    if keyword is None:
        is_data = re.match(r"(Ephemeris|Attitude)\w*Time", word, re.IGNORECASE)
        rule = f"must be one of {', '.join(data)}" if is_data else "is not a known keyword"
        raise source.error(number, rule, word[:40])
    if block.data:
        raise source.error(number, "must come before the data", keyword)
    if keyword in data:
        block.data = keyword
    elif not value.strip() and keyword not in block.given:
        raise source.error(number, "must have a value", keyword)
    else:
        block.given.add(keyword, value.strip(), number)


def _words(line: str) -> list[str]:
    return line.lower().split()


def _frame_and_epoch(source: SourceFile, block: _Block, name: str) -> tuple[Frame, FileInstants]:
    """Frame and scenario epoch, after a look at the keywords that only one value is read of.

    An epoch of the axes says nothing: those that depend on one are not read.
    """
    given = block.given
    given.one_of("CentralBody", ("Earth",))
    given.one_of("TimeFormat", ("EpSec",))
    given.need(name, "ScenarioEpoch")
    frames = {stk: frame for frame, stk in STK_NAME.items()}
    frame = frames[given.one_of(name, list(frames))]
    text, line = given.text("ScenarioEpoch").strip("\"'"), given.line_of("ScenarioEpoch")
    try:
        return frame, dates_of(source, [text], [line], "UTC", "ScenarioEpoch")
    except InputError as error:
        if error.rule.startswith("must be a date like"):
            raise given.error("ScenarioEpoch", "must be a date like 20 Mar 2025 12:00:00.0", text[:40]) from None
        raise


def _checked_values(block: _Block, n_column: int, keyword: str) -> F64:
    """Numbers of the rows, of which there must be as many as a keyword states."""
    block.rows.check(n_column, block.data)
    stated, found = block.given.whole_number(keyword), len(block.rows.cells)
    if stated not in (None, found):
        raise block.given.error(keyword, f"must be the number of rows, {found}, got {stated}")
    return block.rows.numbers(0, n_column)


def _interpolation(block: _Block) -> tuple[bool, Interpolation, int]:
    """Whether the path is of great arcs, method and degree; STK counts samples less one, under two names."""
    given = block.given
    name = given.text("InterpolationMethod", "Lagrange")
    if name.lower() not in ("lagrange", "hermite", "greatarc"):
        raise given.error("InterpolationMethod", "must be Lagrange, Hermite or GreatArc", name)
    method: Interpolation = "lagrange" if name.lower() == "lagrange" else "hermite"
    samples_m1 = _DEFAULT_SAMPLES_M1
    most = 13 if method == "hermite" else 27
    for keyword in ("InterpolationOrder", "InterpolationSamplesM1"):
        stated = given.whole_number(keyword)
        if stated is not None:
            samples_m1 = stated
            if not 1 <= samples_m1 <= most:
                raise given.error(keyword, f"must be 1 to {most}, got {given.text(keyword)}")
    return name.lower() == "greatarc", method, 2 * samples_m1 + 1 if method == "hermite" else samples_m1


def _pieces(time_s: F64, boundary_s: list[float]) -> list[slice]:
    """Rows of each segment: of two rows at a boundary each side has one, a single row begins the next segment."""
    cuts = {0, len(time_s)}
    for boundary in boundary_s:
        at = np.flatnonzero(np.abs(time_s - boundary) <= _SAME_S)
        cuts.add(int(at[-1]) if len(at) else int(np.sum(time_s < boundary)))
    # Files list the end of the last segment as well; its row is no segment of its own.
    if len(time_s) > 1 and len(time_s) - 1 in cuts and time_s[-1] - time_s[-2] > _SAME_S:
        cuts.remove(len(time_s) - 1)
    edges = sorted(cuts)
    return [slice(a, b) for a, b in pairwise(edges)]
