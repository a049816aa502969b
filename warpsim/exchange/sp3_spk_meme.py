"""Orbits in SP3, MEME text and SPICE kernels, as segments.

SP3-a to d are precise orbits of navigation satellites, MEME an operator's ephemerides with covariances. Of kernels
(SPK) states about the Earth (types 8, 9, 12, 13) and Chebyshev series (types 2, 3) are read.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval

from warpsim.arrays import F64
from warpsim.constants import DAY_S
from warpsim.errors import InputError, one_line
from warpsim.exchange.instants import FileInstants, instants_of_time
from warpsim.exchange.segments import LARGEST_DEGREE, EphemerisSegment, Frame, Interpolation
from warpsim.exchange.source import Rows, SourceFile, dates_of, number_of

_SP3_SYSTEMS = {"GPS": "GPS", "GAL": "GPS", "QZS": "GPS", "UTC": "UTC", "GLO": "UTC", "TAI": "TAI", "ccc": "GPS"}
"""Time systems of SP3 and what they are read as; Galileo's and QZSS's agree with GPS's within 50 ns."""

_MEME_ROW = re.compile(r"(\d{4})(\d{3})(\d\d)(\d\d)(\d\d(?:\.\d*)?)")

_EARTH = 399
_FRAMES: dict[int, Frame] = {1: "GCRF", 13000: "ITRF"}
"""Numbers of SPICE's frames: its J2000 is ICRF; and ITRF93."""

_STATES: dict[int, Interpolation] = {8: "lagrange", 9: "lagrange", 12: "hermite", 13: "hermite"}


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
    rows, dates = Rows(source), []
    for number, line in source.lines():
        cells = line.split()
        match = _MEME_ROW.fullmatch(cells[0])
        if match is not None and len(cells) == 7:
            year, day, hour, minute, second = match.groups()
            dates.append(f"{year}-{day}T{hour}:{minute}:{second}")
            rows.add(number, cells)
    if not dates:
        raise source.error(0, "must hold states, got none")
    values = 1e3 * rows.numbers(1, 6)
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


def is_spk(source: SourceFile) -> bool:
    """Return whether a file is an SPK kernel."""
    return source.data.startswith(b"DAF/SPK")


def read_spk(source: SourceFile) -> list[EphemerisSegment]:
    """Segments of the bodies about the Earth, called by their numbers, as in `-48`.

    Raises:
        InputError: jplephem is missing, the file is damaged, or no body about the Earth is of a type that is read.
    """
    try:
        from jplephem.daf import DAF
        from jplephem.spk import SPK
    except ImportError:
        raise InputError("needs the package jplephem").of(source.file) from None
    try:
        kernel: Any = SPK(DAF(io.BytesIO(source.data)))
        about = [segment for segment in kernel.segments if segment.center == _EARTH]
        found = [_segment(source, segment) for segment in about if segment.data_type in (2, 3, *_STATES)]
    except InputError:
        raise
    except Exception as error:  # of bytes that are no kernel
        raise source.error(0, f"must be a whole SPK kernel: {one_line(error)}") from None
    if not found:
        types = ", ".join(sorted({f"{one.data_type} about {one.center}" for one in kernel.segments})) or "none"
        raise source.error(0, f"must hold segments about the Earth of type 2, 3, 8, 9, 12 or 13, got {types}")
    return found


def _segment(source: SourceFile, segment: Any) -> EphemerisSegment:
    if segment.frame not in _FRAMES:
        raise source.error(0, "must be 1 (J2000) or 13000 (ITRF93)", "frame", segment.frame)
    read = _stored_states if segment.data_type in _STATES else _sampled_states
    second, state, degree = read(segment)
    return EphemerisSegment(
        object_name=str(segment.target),
        object_id=str(segment.target),
        frame=_FRAMES[segment.frame],
        instants=_instants(second),
        position_m=1e3 * state[:, :3],
        velocity_m_s=1e3 * state[:, 3:],
        interpolation=_STATES.get(segment.data_type, "hermite"),
        degree=min(degree, LARGEST_DEGREE),
        useable=_instants(np.clip([segment.start_second, segment.end_second], second[0], second[-1])),
        time_system="TDB",
        file=source.file,
    )


def _stored_states(segment: Any) -> tuple[F64, F64, int]:
    """Seconds (TDB after J2000), states [km, km/s] and degree of types 8, 9, 12 and 13."""
    tail = segment.daf.read_array(segment.end_i - 3, segment.end_i)
    n = int(tail[3])
    values = np.asarray(segment.daf.read_array(segment.start_i, segment.end_i), np.float64)
    if not 1 <= n <= len(values) // 6:
        raise InputError(f"must hold as many states as it says ({n})")
    state = values[: 6 * n].reshape(n, 6)
    size, even = int(tail[2]), tail[0] + tail[1] * np.arange(n)
    second = values[6 * n : 7 * n] if segment.data_type in (9, 13) else even
    # The number before the last is the degree of types 8 and 9; of 12 and 13 the nodes of a window less one.
    return second, state, 2 * size + 1 if segment.data_type in (12, 13) else size


def _sampled_states(segment: Any) -> tuple[F64, F64, int]:
    """The same of Chebyshev series: as many samples in each record as it has coefficients."""
    n_part = 3 if segment.data_type == 2 else 6
    *_, size, n = (int(number) for number in segment.daf.read_array(segment.end_i - 3, segment.end_i))
    records = np.asarray(segment.daf.read_array(segment.start_i, segment.end_i - 4), np.float64).reshape(n, size)
    middle, radius, series = records[:, 0], records[:, 1], records[:, 2:].reshape(n, n_part, -1)
    part = np.linspace(-1.0, 1.0, series.shape[2] + 1)
    polynomial = np.moveaxis(series, 2, 0)  # (n_coefficient, n, n_part)
    position = chebval(part, polynomial[:, :, :3])  # (n, 3, n_sample)
    rates = chebder(polynomial) / radius[:, None] if n_part == 3 else polynomial[:, :, 3:]
    state = np.concatenate([position, chebval(part, rates)], axis=1)
    second = (middle[:, None] + radius[:, None] * part).ravel()
    kept = np.append(np.diff(second) > 1e-6, True)  # records share their ends
    return second[kept], np.moveaxis(state, 1, 2).reshape(-1, 6)[kept], 9


def _instants(second_tdb: F64) -> FileInstants:
    """Instants of seconds after J2000, TDB."""
    from astropy.time import Time

    day = np.floor(np.asarray(second_tdb) / DAY_S)
    return instants_of_time(Time(2451545.0 + day, np.asarray(second_tdb) / DAY_S - day, format="jd", scale="tdb"))
