"""Time and error of orbits: Chebyshev-Picard iteration, SGP4, and scipy's DOP853 beside them.

    python -m pytest benchmarks/test_orbits.py --benchmark-json=benchmarks/results/orbits.json
    python benchmarks/report.py benchmarks/results/orbits.json

States every 30 s over a day. The error is that of one satellite at the day's end against DOP853 at its tightest, with
the forces written out a second time; SGP4 is a model of its own, and is compared with skyfield's use of it.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import warpsim as ws
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2, EARTH_J2, EARTH_J3, EARTH_J4
from warpsim.instant import utc_time
from warpsim.orbit.gravity import propagate

POLE = np.array([0.0, 0.0, 1.0])
DAY_S = 86400.0
TLE = (
    "1 25544U 98067A   25152.00000000  .00001764  00000-0  38792-4 0  9996",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)
HARMONICS = {"two_body": (), "j2": (EARTH_J2,), "j4": (EARTH_J2, EARTH_J3, EARTH_J4)}


@pytest.mark.parametrize("n_satellite", [1, 100, 1000])
@pytest.mark.parametrize("gravity", list(HARMONICS))
def test_propagate(benchmark, gravity, n_satellite):
    full = benchmark.enabled
    duration_s = DAY_S if full else 600.0
    start = starts(n_satellite if full else 2)
    time_s = np.arange(0.0, duration_s + 1.0, 30.0)
    states = benchmark.pedantic(propagate, args=(*start, time_s, gravity, POLE), rounds=5, warmup_rounds=1)
    error_m = float(np.linalg.norm(states[0][-1, 0] - reference(gravity, duration_s)))
    note(benchmark, f"Chebyshev-Picard, {gravity}" if HARMONICS[gravity] else "closed form", n_satellite, error_m)


@pytest.mark.parametrize("tolerance", [1e-9, 1e-12])
def test_dop853(benchmark, tolerance):
    duration_s = DAY_S if benchmark.enabled else 600.0
    end_m = benchmark.pedantic(by_dop853, args=("j2", duration_s, tolerance), rounds=5)
    error_m = float(np.linalg.norm(end_m - reference("j2", duration_s)))
    note(benchmark, f"scipy DOP853, j2, rtol {tolerance:g}", 1, error_m)


@pytest.mark.parametrize("n_satellite", [1, 1000])
def test_sgp4(benchmark, n_satellite):
    from skyfield.api import EarthSatellite, load

    duration_s, n = (DAY_S, n_satellite) if benchmark.enabled else (600.0, 2)
    satellites = ws.TleSatellites(lines=[line for k in range(n) for line in renumbered(k)])
    epoch, time_s = utc_time("2025-06-01T00:00:00"), np.arange(0.0, duration_s + 1.0, 30.0)
    states = benchmark.pedantic(satellites.states, args=(epoch, time_s), rounds=5, warmup_rounds=1)
    timescale = load.timescale(builtin=True)
    tt = timescale.tt_jd(epoch.tt.jd1, epoch.tt.jd2 + time_s[-1] / DAY_S)
    end_m = EarthSatellite(*TLE, ts=timescale).at(tt).position.m
    note(benchmark, "SGP4 and TEME", n_satellite, float(np.linalg.norm(states[0][-1, 0] - end_m)))


def note(benchmark, method: str, n_satellite: int, error_m: float) -> None:
    if benchmark.stats is not None:
        benchmark.extra_info.update(
            method=method, n_satellite=n_satellite, propagation_s=benchmark.stats.stats.median, error_m=error_m
        )


@functools.cache
def starts(n_satellite: int) -> tuple[np.ndarray, np.ndarray]:
    """Circular orbits at 1,000 km, evenly spread; the first is the same for any number."""
    return ws.Walker(n_satellite, 1, 0, altitude_km=1000, inclination_deg=65).state()


@functools.cache
def reference(gravity: str, duration_s: float) -> np.ndarray:
    return by_dop853(gravity, duration_s, 2.3e-14)


def by_dop853(gravity: str, duration_s: float, tolerance: float) -> np.ndarray:
    """End position of the first satellite."""

    def force(_, y: np.ndarray) -> np.ndarray:
        r = np.sqrt(y[:3] @ y[:3])
        s = y[2] / r
        legendre = 0.5 * (3 * s * s - 1), 0.5 * (5 * s**3 - 3 * s), 0.125 * (35 * s**4 - 30 * s * s + 3)
        slope = 3 * s, 0.5 * (15 * s * s - 3), 0.5 * (35 * s**3 - 15 * s)
        a = -EARTH_GM_M3_S2 * y[:3] / r**3
        for n, harmonic in enumerate(HARMONICS[gravity], start=2):
            k = EARTH_GM_M3_S2 * harmonic * EARTH_EQUATORIAL_RADIUS_M**n / r ** (n + 2)
            a = a + k * (((n + 1) * legendre[n - 2] + s * slope[n - 2]) * y[:3] / r - slope[n - 2] * POLE)
        return np.concatenate([y[3:], a])

    start = np.concatenate([part[0] for part in starts(1)])
    return solve_ivp(force, (0.0, duration_s), start, "DOP853", rtol=tolerance, atol=1e-9).y[:3, -1]


def renumbered(k: int) -> tuple[str, str]:
    """The element set under another catalog number, its checksums made good."""
    lines = (f"{line[:2]}{25544 + k:05d}{line[7:68]}" for line in TLE)
    return tuple(line + str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10) for line in lines)
