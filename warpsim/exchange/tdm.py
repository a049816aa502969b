"""Writer of CCSDS tracking data messages, 503.0-B-2 in text notation: angles of detections, and where from."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arguments import above_zero
from warpsim.errors import InputError
from warpsim.exchange.instants import FileInstants, parse_dates
from warpsim.exchange.segments import EphemerisSegment
from warpsim.exchange.write import ccsds_header, oem_lines, plain_text, write_lines
from warpsim.files import check_new_file

if TYPE_CHECKING:
    from astropy.table import Table

UNKNOWN = "UNKNOWN"
"""Participant of detections that no target is known of."""

SUFFIXES = (".tdm", ".txt")

_LONGEST_COMMENT = 240
"""Lines of the standard have 254 letters at most."""

_STATE = ("sensor_x_m", "sensor_y_m", "sensor_z_m", "sensor_vx_m_s", "sensor_vy_m_s", "sensor_vz_m_s")
_NEEDED = ("date_obs", "sensor", "band", "ra_deg", "dec_deg", "irradiance_w_cm2", "target", *_STATE)
_COMMENT = (
    "Right ascension and declination of the geometric direction from the sensor when light came in,",
    "ICRF axes, geocentric: aberration by the sensor's motion is taken out, light time is not.",
)


def write_tdm(
    detections: Table,
    path: str | os.PathLike[str],
    zero_mag_w_cm2: Mapping[str, float] | None = None,
    originator: str = "WARPSIM",
    creation_date: str | None = None,
    overwrite: bool = False,
) -> None:
    """Write detections as a CCSDS tracking data message (TDM 2.0), and the sensors' states as an OEM beside it.

    One segment for each sensor, band and target (`ANGLE_TYPE = RADEC`, `REFERENCE_FRAME = ICRF`): PARTICIPANT_1 is the
    sensor, PARTICIPANT_2 the target or UNKNOWN, EPHEMERIS_NAME_1 the OEM, of the same name with the suffix .oem. A
    segment holds a keyword once at a time, so that of several unknown detections of an image each has a segment. The
    standard has no keyword for errors: they stay in the table. Its meta (scene, epoch, seeds, version) becomes comments
    of both files.

    Args:
        detections: As `detections` returns it.
        path: The file, .tdm or .txt; both files appear whole, or none at all.
        zero_mag_w_cm2: In-band irradiance of magnitude 0 by band: MAG is then written for these [W/cm2].
        originator: Who made it.
        creation_date: UTC; now, where left out.
        overwrite: Whether existing files are replaced.

    Raises:
        InputError: There are no detections, a column is missing, a band is none of theirs, a number or a name cannot be
            written, or a file has another suffix, is there or cannot be written.
    """
    tdm_path, oem_path = Path(path), Path(path).with_suffix(".oem")
    check_new_file(tdm_path, SUFFIXES, overwrite)
    check_new_file(oem_path, None, overwrite)
    columns = _checked(detections, path)
    instants = parse_dates(columns["date_obs"].tolist(), "UTC")
    zeros = _zeros(zero_mag_w_cm2, np.unique(columns["band"]).tolist())
    header = originator, creation_date, _provenance(detections)
    lines = ccsds_header("TDM", *header)
    for rows in _segments(columns):
        lines += _segment(columns, instants, rows, oem_path.name, zeros)
    states = oem_lines(oem_path, _states(columns, instants), ccsds_header("OEM", *header))
    write_lines({tdm_path: lines, oem_path: states})


def _provenance(detections: Table) -> list[str]:
    """Words of the table's meta for comments; letters beyond ASCII as escapes."""
    words = [f"{name} = {value}" for name, value in detections.meta.items() if isinstance(value, str | int | float)]
    return [ascii(word)[1:-1][:_LONGEST_COMMENT] for word in words]


def _checked(detections: Table, path: Any) -> dict[str, NDArray[Any]]:
    if not hasattr(detections, "colnames"):
        raise InputError(f"must be an astropy table, got {type(detections).__name__}", "detections")
    if missing := [name for name in _NEEDED if name not in detections.colnames]:
        raise InputError(f"must be a table of detections, got none of {', '.join(missing)}", "detections")
    if not len(detections):
        raise InputError("must be one at least, got none", "detections").of(path)
    columns = {name: np.asarray(detections[name]) for name in _NEEDED}
    for name, values in columns.items():
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            raise InputError("must be finite", f"detections.{name}", row=int(np.flatnonzero(~np.isfinite(values))[0]))
    return columns


def _zeros(zero_mag_w_cm2: Mapping[str, float] | None, bands: list[str]) -> dict[str, float]:
    zeros = dict(zero_mag_w_cm2 or {})
    for band in zeros:
        if band not in bands:
            raise InputError(f"must be among {', '.join(bands)}, the bands of the detections", "zero_mag_w_cm2", band)
    return {band: above_zero(f"zero_mag_w_cm2.{band}", value) for band, value in zeros.items()}


def _segments(columns: dict[str, NDArray[Any]]) -> list[NDArray[np.int64]]:
    """Rows of each segment in time order: of one sensor, band and target, one a time."""
    date = columns["date_obs"]
    order = np.argsort(date, kind="stable")
    seen: dict[tuple[str, ...], int] = {}
    segments: dict[tuple[Any, ...], list[int]] = {}
    for row in order.tolist():
        key = tuple(str(columns[name][row]) for name in ("sensor", "band", "target"))
        number = seen[(*key, str(date[row]))] = seen.get((*key, str(date[row])), 0) + 1
        segments.setdefault((*key, number), []).append(row)
    return [np.array(segments[key]) for key in sorted(segments)]


def _segment(
    columns: dict[str, NDArray[Any]], instants: FileInstants, rows: NDArray[np.int64], oem: str, zeros: dict[str, float]
) -> list[str]:
    first = rows[0]
    band, dates = str(columns["band"][first]), instants[rows].dates("UTC")
    meta = {
        "TIME_SYSTEM": "UTC",
        "START_TIME": dates[0],
        "STOP_TIME": dates[-1],
        "PARTICIPANT_1": plain_text(str(columns["sensor"][first])),
        "PARTICIPANT_2": plain_text(str(columns["target"][first]) or UNKNOWN),
        "MODE": "SEQUENTIAL",
        "PATH": "2,1",
        "EPHEMERIS_NAME_1": plain_text(oem),
        "RECEIVE_BAND": plain_text(band),
        "TIMETAG_REF": "RECEIVE",
        "ANGLE_TYPE": "RADEC",
        "REFERENCE_FRAME": "ICRF",
    }
    lines = ["META_START", *(f"COMMENT {text}" for text in _COMMENT)]
    lines += [*(f"{keyword} = {value}" for keyword, value in meta.items()), "META_STOP", "DATA_START"]
    for row, date in zip(rows.tolist(), dates, strict=True):
        lines.append(f"ANGLE_1 = {date} {columns['ra_deg'][row]:.12f}")
        lines.append(f"ANGLE_2 = {date} {columns['dec_deg'][row]:.12f}")
        light = float(columns["irradiance_w_cm2"][row])
        if band in zeros and light > 0.0:
            lines.append(f"MAG = {date} {-2.5 * np.log10(light / zeros[band]):.6f}")
    return [*lines, "DATA_STOP", ""]


def _states(columns: dict[str, NDArray[Any]], instants: FileInstants) -> list[EphemerisSegment]:
    """States of each sensor at the times of its detections."""
    state = np.stack([columns[name] for name in _STATE], axis=1).astype(np.float64)
    segments = []
    for sensor in np.unique(columns["sensor"]).tolist():
        rows = np.flatnonzero(columns["sensor"] == sensor)
        _, first = np.unique(columns["date_obs"][rows], return_index=True)
        rows = rows[first]
        segments.append(EphemerisSegment(sensor, "", "GCRF", instants[rows], state[rows, :3], state[rows, 3:]))
    return segments
