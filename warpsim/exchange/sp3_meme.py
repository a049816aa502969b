"""Precise orbits of navigation satellites (SP3-a to d), and an operator's ephemerides with covariances (MEME text)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.exchange.segments import EphemerisSegment
from warpsim.exchange.source import Rows, SourceFile, dates_of, number_of, numbers_of

F64 = NDArray[np.float64]

_SP3_SYSTEMS = {"GPS": "GPS", "GAL": "GPS", "QZS": "GPS", "UTC": "UTC", "GLO": "UTC", "TAI": "TAI", "ccc": "GPS"}
"""Time systems of SP3 and what they are read as; Galileo's and QZSS's agree with GPS's within 50 ns."""

_MEME_ROW = re.compile(r"(\d{4})(\d{3})(\d\d)(\d\d)(\d\d(?:\.\d*)?)")


def is_sp3(source: SourceFile) -> bool:
    """Return whether a file looks like SP3."""
    return re.match(r"#[a-d][PV ]\d{4}", source.head) is not None


def read_sp3(source: SourceFile) -> list[EphemerisSegment]:
    """A segment for each satellite, in the Earth's axes; epochs at which its position is not known are left out."""
    lines = source.lines()
    codes = [line[9:12] for _, line in lines if line.startswith("%c ")][:1]
    system = _SP3_SYSTEMS.get(codes[0] if codes else "GPS", "")
    if not system:
        raise source.error(0, f"must be one of {', '.join(list(_SP3_SYSTEMS)[:-1])}", "time system", codes[0])
    epoch, epoch_line = "", 0
    rows: dict[str, list[tuple[str, int, list[float]]]] = {}
    for number, line in lines:
        if line.startswith("*"):
            year, month, day, hour, minute, second = (line[1:].split() + [""] * 6)[:6]
            epoch, epoch_line = f"{year}-{month:0>2}-{day:0>2}T{hour:0>2}:{minute:0>2}:{second:0>2}", number
        elif line[0] in "PV" and len(line) > 45:
            if not epoch:
                raise source.error(number, "must come after an epoch")
            cells = [number_of(source, number, line[4 + 14 * k : 18 + 14 * k].strip()) for k in range(3)]
            own = rows.setdefault(line[1:4].replace(" ", "0"), [])
            if line[0] == "P" and any(cells):
                own.append((epoch, epoch_line, cells))
            elif line[0] == "V" and own and own[-1][0] == epoch and len(own[-1][2]) == 3:
                own[-1][2].extend(1e-4 * cell for cell in cells)  # dm/s as km/s
    if lines[-1][1] != "EOF":
        raise source.error(lines[-1][0], "ends early: EOF must be the last line")
    segments = []
    for name, own in rows.items():
        if not own:
            continue
        values = 1e3 * np.array([cells[:3] for _, _, cells in own])
        moving = all(len(cells) == 6 and any(cells[3:]) for _, _, cells in own)
        line_numbers = [line for _, line, _ in own]
        segments.append(
            EphemerisSegment(
                object_name=name,
                object_id="",
                frame="ITRF",
                instants=dates_of(source, [date for date, _, _ in own], line_numbers, system),
                position_m=values,
                velocity_m_s=1e3 * np.array([cells[3:] for _, _, cells in own]) if moving else None,
                interpolation="hermite" if moving else "lagrange",
                degree=9,
                time_system=system,
                file=source.file,
                line=line_numbers[0],
                lines=np.array(line_numbers, np.int64),
            )
        )
    if not segments:
        raise source.error(0, "must hold positions, got none")
    return segments


def is_meme(source: SourceFile) -> bool:
    """Return whether a file looks like an operator's ephemeris of mean equator and equinox, with covariances."""
    return re.match(r"created:[^\n]*\n\s*ephemeris_start:", source.head) is not None


def read_meme(source: SourceFile) -> list[EphemerisSegment]:
    """The segment of an ephemeris: states in EME2000 at dates in UTC; covariances are passed over.

    The object is called by the name of the file, MEME_47798_STARLINK-2379_...: STARLINK-2379, 47798.
    """
    rows, dates = Rows([], []), []
    for number, line in source.lines():
        cells = line.split()
        match = _MEME_ROW.fullmatch(cells[0])
        if match is not None and len(cells) == 7:
            year, day, hour, minute, second = match.groups()
            dates.append(f"{year}-{day}T{hour}:{minute}:{second}")
            rows.add(number, cells)
    if not dates:
        raise source.error(0, "must hold states, got none")
    values = 1e3 * numbers_of(source, rows, 1, 6)
    named = re.match(r"MEME_(\d+)_([^_]+)", Path(source.file).name)
    return [
        EphemerisSegment(
            object_name=Path(source.file).stem if named is None else named[2],
            object_id="" if named is None else named[1],
            frame="EME2000",
            instants=dates_of(source, dates, rows.lines, "UTC"),
            position_m=values[:, :3],
            velocity_m_s=values[:, 3:],
            file=source.file,
            line=rows.lines[0],
            lines=np.array(rows.lines, np.int64),
        )
    ]
