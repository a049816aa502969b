"""Orbits in SPICE kernels (SPK): states about the Earth (types 8, 9, 12, 13) and Chebyshev series (types 2, 3)."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval
from numpy.typing import NDArray

from warpsim.errors import InputError, one_line
from warpsim.exchange.instants import FileInstants, instants_of_time
from warpsim.exchange.segments import LARGEST_DEGREE, EphemerisSegment, Frame, Interpolation
from warpsim.exchange.source import SourceFile

F64 = NDArray[np.float64]

_EARTH = 399
_FRAMES: dict[int, Frame] = {1: "GCRF", 13000: "ITRF"}
"""Numbers of SPICE's frames: its J2000 is ICRF; and ITRF93."""

_STATES = {8: "lagrange", 9: "lagrange", 12: "hermite", 13: "hermite"}


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
    """One segment of a kernel."""
    if segment.frame not in _FRAMES:
        raise source.error(0, "must be 1 (J2000) or 13000 (ITRF93)", "frame", segment.frame)
    method: Interpolation = "hermite"
    if segment.data_type in _STATES:
        second, state, degree = _stored_states(segment)
        method = "hermite" if segment.data_type in (12, 13) else "lagrange"
    else:
        second, state, degree = _sampled_states(segment)
    return EphemerisSegment(
        object_name=str(segment.target),
        object_id=str(segment.target),
        frame=_FRAMES[segment.frame],
        instants=_instants(second),
        position_m=1e3 * state[:, :3],
        velocity_m_s=1e3 * state[:, 3:],
        interpolation=method,
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


def _instants(second_tdb: NDArray[np.float64]) -> FileInstants:
    """Instants of seconds after J2000, TDB."""
    from astropy.time import Time

    day = np.floor(np.asarray(second_tdb) / 86400.0)
    return instants_of_time(Time(2451545.0 + day, np.asarray(second_tdb) / 86400.0 - day, format="jd", scale="tdb"))
