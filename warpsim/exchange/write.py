"""Writers: CCSDS OEM and AEM (text notation), STK .e and .a; nothing is lost beyond 1e-9 m and 1e-9 s."""

from __future__ import annotations

import contextlib
import datetime
import os
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.exchange.instants import MONTHS, FileInstants, parse_dates
from warpsim.exchange.segments import CCSDS_NAME, DEFAULT_DEGREE, STK_NAME, AttitudeSegment, EphemerisSegment, Segment
from warpsim.files import check_new_file, whole_file

_S = TypeVar("_S", EphemerisSegment, AttitudeSegment)
_PRINTABLE = re.compile(r"[ -~]+")


def write_oem(
    path: str | os.PathLike[str],
    segments: EphemerisSegment | Sequence[EphemerisSegment],
    originator: str = "WARPSIM",
    creation_date: str | None = None,
    overwrite: bool = False,
) -> None:
    """Write orbits as a CCSDS OEM 2.0.

    Args:
        path: The file; it appears whole or not at all.
        segments: One or more, with velocities.
        originator: Who made it.
        creation_date: UTC; now, where left out.
        overwrite: Whether an existing file is replaced.

    Raises:
        InputError: A segment has no velocities, counts from a scene's epoch, or the file is there or cannot be written.
    """
    runs = _checked_runs(path, segments, overwrite)
    write_lines({path: oem_lines(path, runs, ccsds_header("OEM", originator, creation_date))})


def oem_lines(path: str | os.PathLike[str], segments: Sequence[EphemerisSegment], header: list[str]) -> list[str]:
    """Return the lines of an OEM; InputError, which names the path, where a segment has no velocities."""
    lines = list(header)
    for segment in segments:
        if segment.velocity_m_s is None:
            raise InputError("must have velocities to be written as an OEM").of(segment.object_name).of(path)
        meta = {"CENTER_NAME": "EARTH", "REF_FRAME": CCSDS_NAME[segment.frame]}
        lines += _ccsds_meta(segment, meta, "INTERPOLATION")
        dates = segment.instants.dates(segment.time_system)
        for date, r, v in zip(dates, segment.position_m / 1e3, segment.velocity_m_s / 1e3, strict=True):
            lines.append(f"{date} {r[0]:.12f} {r[1]:.12f} {r[2]:.12f} {v[0]:.15f} {v[1]:.15f} {v[2]:.15f}")
        lines.append("")
    return lines


def write_aem(
    path: str | os.PathLike[str],
    segments: AttitudeSegment | Sequence[AttitudeSegment],
    originator: str = "WARPSIM",
    creation_date: str | None = None,
    overwrite: bool = False,
) -> None:
    """Write attitudes as a CCSDS AEM 2.0, from the reference axes (A) to the body's (B).

    Raises:
        InputError: See write_oem().
    """
    runs = _checked_runs(path, segments, overwrite)
    lines = ccsds_header("AEM", originator, creation_date)
    for segment in runs:
        body = plain_text(segment.body_frame) if segment.body_frame.isupper() else "SC_BODY_1"
        frames = {"REF_FRAME_A": CCSDS_NAME[segment.frame], "REF_FRAME_B": body}
        lines += _ccsds_meta(segment, {"CENTER_NAME": "EARTH", **frames}, "INTERPOLATION_METHOD")
        lines.append("DATA_START")
        dates = segment.instants.dates(segment.time_system)
        for date, q in zip(dates, segment.quaternion, strict=True):
            lines.append(f"{date} {q[0]:.16f} {q[1]:.16f} {q[2]:.16f} {q[3]:.16f}")
        lines += ["DATA_STOP", ""]
    write_lines({path: lines})


def write_stk_ephemeris(
    path: str | os.PathLike[str], segments: EphemerisSegment | Sequence[EphemerisSegment], overwrite: bool = False
) -> None:
    """Write one object's orbit as an STK ephemeris (.e), in metres.

    Args:
        path: The file; it appears whole or not at all.
        segments: One, or several of one object in one frame, in time order: boundaries lie between them.
        overwrite: Whether an existing file is replaced.

    Raises:
        InputError: They differ in object or frame, overlap, count from a scene's epoch, or the file is there or cannot
            be written.
    """
    runs = _checked_runs(path, segments, overwrite)
    first = runs[0]
    for what, values in (
        ("object", {run.object_name for run in runs}),
        ("frame", {run.frame for run in runs}),
        ("velocities", {run.velocity_m_s is None for run in runs}),
    ):
        if len(values) > 1:
            raise InputError("must be the same in all segments of an STK ephemeris", what).of(path)
    epoch_text, epoch = _stk_epoch(first)
    time_s = [run.instants.since_instant(epoch) for run in runs]
    if any(b[0] < a[-1] for a, b in pairwise(time_s)):
        raise InputError("must follow each other in time", "segments").of(path)
    lines = ["stk.v.11.0", "", "# WrittenBy    warpsim", "", "BEGIN Ephemeris", ""]
    lines += [f"NumberOfEphemerisPoints {sum(map(len, time_s))}", f"ScenarioEpoch           {epoch_text}"]
    lines += [*_stk_interpolation(first), "DistanceUnit            Meters", "CentralBody             Earth"]
    lines += [f"CoordinateSystem        {STK_NAME[first.frame]}", ""]
    if len(runs) > 1:
        starts = [f"    {times[0]:.9f}" for times in time_s[1:]]
        lines += ["BEGIN SegmentBoundaryTimes", *starts, "END SegmentBoundaryTimes", ""]
    lines += ["EphemerisTimePos" if first.velocity_m_s is None else "EphemerisTimePosVel", ""]
    for run, times in zip(runs, time_s, strict=True):
        parts = [run.position_m] if run.velocity_m_s is None else [run.position_m, run.velocity_m_s]
        form = "%.9f %.9f %.9f %.12f %.12f %.12f"
        lines += [_stk_row(t, row, form) for t, row in zip(times, np.hstack(parts), strict=True)]
    write_lines({path: [*lines, "", "END Ephemeris"]})


def write_stk_attitude(path: str | os.PathLike[str], segment: AttitudeSegment, overwrite: bool = False) -> None:
    """Write an attitude as an STK attitude file (.a), from the reference axes to the body's, scalar last.

    Raises:
        InputError: It counts from a scene's epoch, or the file is there (and overwrite not set) or cannot be written.
    """
    _checked_runs(path, segment, overwrite)
    epoch_text, epoch = _stk_epoch(segment)
    lines = ["stk.v.11.0", "", "# WrittenBy    warpsim", "", "BEGIN Attitude", ""]
    lines += [f"NumberOfAttitudePoints  {len(segment.instants)}", f"ScenarioEpoch           {epoch_text}"]
    lines += ["CentralBody             Earth", f"CoordinateAxes          {STK_NAME[segment.frame]}", ""]
    lines += ["AttitudeTimeQuaternions", ""]
    times = segment.instants.since_instant(epoch)
    lines += [_stk_row(t, q, "%.16f %.16f %.16f %.16f") for t, q in zip(times, segment.quaternion, strict=True)]
    write_lines({path: [*lines, "", "END Attitude"]})


def _stk_row(time_s: float, values: F64, form: str) -> str:
    return f"{time_s:.9f} " + " ".join(f % v for f, v in zip(form.split(), values.tolist(), strict=False))


def _stk_epoch(segment: Segment) -> tuple[str, FileInstants]:
    """The first instant as a scenario epoch, as text and as that text reads."""
    date, clock = segment.instants[0].dates("UTC")[0].split("T")
    year, month, day = date.split("-")
    text = f"{int(day)} {MONTHS[int(month) - 1]} {year} {clock}"
    return text, parse_dates([text], "UTC")


def _stk_interpolation(segment: EphemerisSegment) -> list[str]:
    """Lines of method and samples, so that readers do as warpsim does."""
    has_velocity = segment.velocity_m_s is not None
    method = segment.interpolation or ("hermite" if has_velocity else "lagrange")
    degree = 1 if method == "linear" else segment.degree or DEFAULT_DEGREE
    samples_m1 = (degree + 1) // 2 - 1 if method == "hermite" else degree
    name = "Hermite" if method == "hermite" else "Lagrange"
    return [f"InterpolationMethod     {name}", f"InterpolationSamplesM1  {max(samples_m1, 1)}"]


def ccsds_header(kind: str, originator: str, creation_date: str | None, comments: Sequence[str] = ()) -> list[str]:
    """Return the header of a message, version 2.0; made now where no date is given."""
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S")
    made = now if creation_date is None else creation_date
    begin = [f"CCSDS_{kind}_VERS = 2.0", *(f"COMMENT {text}" for text in comments)]
    return [*begin, f"CREATION_DATE = {made}", f"ORIGINATOR = {plain_text(originator)}", ""]


def _ccsds_meta(segment: Segment, more: dict[str, str], method_keyword: str) -> list[str]:
    """The metadata of a segment, in the order of the standards."""
    start, stop = segment.instants[[0, -1]].dates(segment.time_system)
    name, number = plain_text(segment.object_name), plain_text(segment.object_id or "UNKNOWN")
    meta = {"OBJECT_NAME": name, "OBJECT_ID": number, **more}
    meta |= {"TIME_SYSTEM": segment.time_system, "START_TIME": start}
    if segment.useable is not None:
        first, last = segment.useable.dates(segment.time_system)
        meta |= {"USEABLE_START_TIME": first, "USEABLE_STOP_TIME": last}
    meta["STOP_TIME"] = stop
    if isinstance(segment, AttitudeSegment):
        meta["ATTITUDE_TYPE"] = "QUATERNION"
    if segment.interpolation is not None:
        degree = 1 if segment.interpolation == "linear" else segment.degree or DEFAULT_DEGREE
        meta |= {method_keyword: segment.interpolation.upper(), "INTERPOLATION_DEGREE": str(degree)}
    return ["META_START", *(f"{keyword} = {value}" for keyword, value in meta.items()), "META_STOP"]


def plain_text(text: str) -> str:
    """Text that may stand in a message."""
    if not _PRINTABLE.fullmatch(text.strip()):
        raise InputError("must be printable ASCII text", "names", text)
    return text.strip()


def _checked_runs(path: str | os.PathLike[str], segments: _S | Sequence[_S], overwrite: bool) -> list[_S]:
    """The segments, one at least, for a path that is writable."""
    check_new_file(Path(path), None, overwrite)
    runs = list(segments) if isinstance(segments, Sequence) else [segments]
    if not runs:
        raise InputError("must be one at least, got none", "segments").of(path)
    return runs


def write_lines(files: Mapping[str | os.PathLike[str], list[str]]) -> None:
    """Write lines as ASCII text, all files whole or none at all; InputError where that fails."""
    path: str | os.PathLike[str] = ""
    try:
        with contextlib.ExitStack() as stack:
            for path, lines in files.items():
                partial = stack.enter_context(whole_file(Path(path)))
                partial.write_text("\n".join(lines).rstrip("\n") + "\n", encoding="ascii", newline="\n")
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}").of(path) from None
