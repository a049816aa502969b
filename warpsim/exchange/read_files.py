"""Files of orbits, attitudes and temperatures: their format by the content, and tables of one row a time."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError, errors_at, one_line
from warpsim.exchange.ccsds_attitudes import read_aem
from warpsim.exchange.ccsds_message import message_kind
from warpsim.exchange.ccsds_orbits import read_ocm, read_oem, read_opm
from warpsim.exchange.instants import FileInstants, parse_dates
from warpsim.exchange.segments import AttitudeSegment, EphemerisSegment, Frame, known_ccsds_frame, plain_name
from warpsim.exchange.source import SourceFile, read_source
from warpsim.exchange.sp3_spk_meme import is_meme, is_sp3, is_spk, read_meme, read_sp3, read_spk
from warpsim.exchange.stk_read import is_stk, read_stk_attitude, read_stk_ephemeris
from warpsim.tables.columns import ColumnTable
from warpsim.tables.text import read_delimited, read_ecsv

_TLE = re.compile(r"^1 ([A-Z\d ][\d ]{4})[ A-Z] .{50,}\n2 \1 .{50,}$", re.MULTILINE)


_FRAME_NOTE = re.compile(r"#\s*frame\s*[:=]\s*(\S+)\s*", re.IGNORECASE)


def read_ephemeris_table(source: SourceFile) -> list[EphemerisSegment]:
    """One segment for each object of a table.

    Columns: `time_s` (since the scene's epoch) or `time_utc`; `x_m`, `y_m`, `z_m` or `x_km`, ...; if there are
    velocities `vx_m_s`, ... or `vx_km_s`, ...; if there are several objects `name`. The frame is GCRF, or that of a
    comment `# frame = ITRF`, or of `frame` in the metadata of an ECSV file.
    """
    table = _read(source)
    with source.at(0):
        _check_columns(table, "position", "x_m, y_m, z_m or x_km, y_km, z_km", ("x_m", "x_km"))
        instants, frame = _instants(table), _frame(table)
        position_m, velocity_m_s = _vector(table, "", "m"), _vector(table, "v", "m/s")
        names = table.text("name")
    assert position_m is not None
    lines = _lines(table)
    segments = []
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        if not name and table.find("name") is not None:
            raise source.error(int(lines[rows[0]]), "must not be empty", "name")
        segments.append(
            EphemerisSegment(
                object_name=name or Path(source.file).stem,
                object_id="",
                frame=frame,
                instants=instants[rows],
                position_m=position_m[rows],
                velocity_m_s=None if velocity_m_s is None else velocity_m_s[rows],
                file=source.file,
                line=int(lines[rows[0]]),
                lines=lines[rows],
            )
        )
    return segments


def read_attitude_table(source: SourceFile) -> list[AttitudeSegment]:
    """The segment of a table with `time_s` or `time_utc` and `qx`, `qy`, `qz`, `qw` (body to the frame's axes)."""
    table = _read(source)
    with source.at(0):
        _check_columns(table, "attitude", "qx, qy, qz, qw", ("qx",))
        instants, frame = _instants(table), _frame(table)
        quaternion = np.stack([table.needed(name) for name in ("qx", "qy", "qz", "qw")], axis=1)
    lines = _lines(table)
    return [
        AttitudeSegment(
            object_name=Path(source.file).stem,
            object_id="",
            frame=frame,
            body_frame="body",
            instants=instants,
            quaternion=quaternion,
            file=source.file,
            line=int(lines[0]),
            lines=lines,
        )
    ]


def read_temperature_table(source: SourceFile) -> tuple[FileInstants, F64, list[str]]:
    """Times, temperatures [K] and locations ("line 3") of a table with `time_s` or `time_utc` and `temperature_k`."""
    table = _read(source)
    with source.at(0):
        _check_columns(table, "temperature", "temperature_k", ("temperature_k",))
        locations = [table.where(row) for row in range(len(table))]
        temperature_k = table.needed("temperature_k", unit="K")
        gaps = np.flatnonzero(np.isnan(temperature_k))
        if len(gaps):
            raise InputError("must be given, a table must have no gap", "temperature_k").of(locations[gaps[0]])
        instants = _instants(table)
    return instants, temperature_k, locations


def _read(source: SourceFile) -> ColumnTable:
    """The table of a file, whose last line must be closed."""
    source.lines()
    with source.at(0):
        if "\0" in source.text:
            raise InputError("must be an OEM, AEM, STK or table of text, got binary data")
        if re.match(r"\s*#\s*%ECSV", source.text):
            table = read_ecsv(source.text.encode())
            if any(not hasattr(table.table[name], "dtype") for name in table.table.colnames):
                raise InputError("must have plain columns, got some of ECSV's own kinds (Time, SkyCoord, ...)")
        else:
            table = read_delimited(source.text.encode())
        if len(table) == 0:
            raise InputError("must hold at least one row, got none")
    return table


def _check_columns(table: ColumnTable, what: str, needed: str, one_of: tuple[str, ...]) -> None:
    if table.find(*one_of) is None:
        found = ", ".join(table.table.colnames)
        raise InputError(f"must have columns of {what} ({needed})", value=found, form="s")


def _instants(table: ColumnTable) -> FileInstants:
    """Times of the rows: seconds since the scene's epoch, or dates."""
    has_s, has_utc = table.find("time_s") is not None, table.find("time_utc") is not None
    if has_s == has_utc:
        got = "both" if has_s else ", ".join(table.table.colnames)
        rule = "must have one of the columns time_s (since the scene's epoch) and time_utc"
        raise InputError(rule, value=got, form="s")
    if has_s:
        time_s = table.number("time_s", unit="s")
        return FileInstants(np.zeros(len(time_s)), time_s, relative=True)
    texts = [text.replace(" ", "T") for text in table.text("time_utc").tolist()]
    try:
        return parse_dates(texts, "UTC")
    except InputError as error:
        raise table.located(error.within("time_utc")) from None


def _lines(table: ColumnTable) -> NDArray[np.int64]:
    return np.zeros(len(table), np.int64) if table.line_of_row is None else np.asarray(table.line_of_row, np.int64)


def _frame(table: ColumnTable) -> Frame:
    meta: dict[str, Any] = dict(table.table.meta)
    stated = [match[1] for line in meta.get("comments", []) if (match := _FRAME_NOTE.fullmatch(str(line).strip()))]
    if "frame" in meta:
        stated.append(str(meta["frame"]))
    if len(set(stated)) > 1:
        raise InputError(f"must be stated once, got {', '.join(stated)}", "frame")
    with errors_at("frame"):
        return known_ccsds_frame(stated[0]) if stated else "GCRF"


def _vector(table: ColumnTable, prefix: str, unit: str) -> F64 | None:
    """Three columns in metres (per second), given so or in kilometres; None where there are none."""
    names, names_km = ([f"{prefix}{axis}_{k}{unit.replace('/', '_')}" for axis in "xyz"] for k in ("", "k"))
    plain, kilo = ([table.find(name) for name in group] for group in (names, names_km))
    found = [name for name in (*plain, *kilo) if name is not None]
    if not found:
        return None
    if len(found) != 3 or (None in plain and None in kilo):
        raise InputError(f"must have all of {', '.join(names)} or all of {', '.join(names_km)}, got {', '.join(found)}")
    scale, kilo_unit = (1.0, unit) if None not in plain else (1e3, f"k{unit}")
    try:
        return scale * np.stack([table.number(name, unit=kilo_unit) for name in found], axis=1)
    except InputError:
        raise
    except Exception as error:  # columns of odd kinds of ECSV
        raise InputError(f"must hold numbers: {one_line(error)}", found[0]) from None


def read_ephemeris(path: str | os.PathLike[str], object: str | None = None) -> list[EphemerisSegment]:
    """Segments of an orbit file: CCSDS OEM (text or XML), OPM, OCM, STK .e, SP3, SPK, MEME, or a table (CSV, ECSV).

    Args:
        path: The file.
        object: Name or number of the object; None reads all.

    Raises:
        InputError: One line: file, line, rule, value.
    """
    return ephemeris_of(read_source(path), object)


def ephemeris_of(source: SourceFile, object: str | None = None) -> list[EphemerisSegment]:
    """Like read_ephemeris(), of a file that has been read."""
    if not is_spk(source):
        source.check_kind()
    kind = message_kind(source)
    with np.errstate(over="ignore"):  # infinity is refused with its line
        if is_spk(source):
            segments = read_spk(source)
        elif kind:
            segments = {"OPM": read_opm, "OCM": read_ocm}.get(kind, read_oem)(source)
        elif is_sp3(source):
            segments = read_sp3(source)
        elif is_meme(source):
            segments = read_meme(source)
        elif is_stk(source):
            segments = read_stk_ephemeris(source)
        else:
            with _hint_at_elements(source, "states"):
                segments = read_ephemeris_table(source)
    if object is None:
        return segments
    chosen = [s for s in segments if object in (s.object_name, s.object_id, plain_name(s.object_name))]
    if not chosen:
        known = ", ".join(dict.fromkeys(s.object_name for s in segments))
        raise InputError(f"must be one of {known}", "object", object).of(source.file)
    return chosen


def read_attitude(path: str | os.PathLike[str]) -> list[AttitudeSegment]:
    """Segments of an attitude file: CCSDS AEM (text or XML), STK .a, or a table (CSV, ECSV).

    Raises:
        InputError: One line: file, line, rule, value.
    """
    return attitude_of(read_source(path))


def attitude_of(source: SourceFile) -> list[AttitudeSegment]:
    """Like read_attitude(), of a file that has been read."""
    source.check_kind()
    with np.errstate(over="ignore"):
        if message_kind(source):
            return read_aem(source)
        if is_stk(source):
            return read_stk_attitude(source)
        with _hint_at_elements(source, "attitudes"):
            return read_attitude_table(source)


@contextlib.contextmanager
def _hint_at_elements(source: SourceFile, requested: str) -> Iterator[None]:
    """Explain that a file holds element sets, where it is no table."""
    try:
        yield
    except InputError:
        if _TLE.search(source.text) or "MEAN_MOTION" in source.text:
            text = f"must hold {requested}, got element sets, which TleOrbit and TleSatellites read"
            raise source.error(0, text) from None
        raise
