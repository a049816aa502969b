"""Lambert's problem, less than one revolution: the conic between two positions in a given time.

Universal variables (Bate, Mueller and White, section 5.3). With x^2 = z and k = sqrt(r1 r2 (1 + cos theta)), signed by
the direction, the auxiliary y(z) = r1 + r2 - sqrt(2) k cos(x / 2) has no cancellation, and the time of flight grows
with z over all of (lowest z, 4 pi^2), so bisection always converges.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.orbit.kepler import stumpff

F64 = NDArray[np.float64]

Direction = Literal["short", "long"]

# 0.02 arcsec, 0.7 m on the ground: nearer to 0 or 180 degrees the plane hangs on details of the end points.
_SMALLEST_SINE = 1e-7


def lambert(start_m: ArrayLike, end_m: ArrayLike, duration_s: float, direction: Direction = "short") -> tuple[F64, F64]:
    """Return the velocities at both ends of the two-body arc [m/s], each of shape (3,).

    Args:
        start_m: Geocentric start, inertial axes [m], shape (3,).
        end_m: Geocentric end, same axes [m], shape (3,).
        duration_s: Time of flight [s], > 0.
        direction: "short" sweeps less than 180 degrees about the centre, "long" the rest of the circle.

    Raises:
        InputError: On NaN, a duration <= 0, positions at the centre, ends in line with the centre (within 1e-7 rad of
            0 or 180 degrees apart, where the plane is undefined), or a time too short for any conic in float64.
    """
    r1, r2 = np.asarray(start_m, np.float64), np.asarray(end_m, np.float64)
    if r1.shape != (3,) or r2.shape != (3,) or not (np.isfinite(r1).all() and np.isfinite(r2).all()):
        raise InputError(f"must be finite 3-vectors, got {r1.tolist()} and {r2.tolist()}", "start_m, end_m")
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise InputError("must be > 0", "duration_s", duration_s)
    if direction not in ("short", "long"):
        raise InputError("must be 'short' or 'long'", "direction", direction)
    d1, d2 = float(np.linalg.norm(r1)), float(np.linalg.norm(r2))
    normal = np.cross(r1, r2)
    area = float(np.linalg.norm(normal))
    if not area > _SMALLEST_SINE * d1 * d2:
        raise InputError("must not be 0 or 180 degrees apart about the centre (plane undefined)", "start_m, end_m")
    way = 1.0 if direction == "short" else -1.0
    normal *= way / area
    cosine, sine = float(r1 @ r2) / (d1 * d2), way * area / (d1 * d2)

    # 1 + cos and 1 - cos from the sine where the direct sum would cancel.
    one_plus = 1.0 + cosine if cosine > 0 else sine * sine / (1.0 - cosine)
    one_minus = 1.0 - cosine if cosine < 0 else sine * sine / (1.0 + cosine)
    chord_term = way * math.sqrt(d1 * d2 * one_plus)  # k, Bate's A
    z = _solve_z(d1 + d2, chord_term, duration_s)
    y = _auxiliary(z, d1 + d2, chord_term)

    # Radial and transverse parts with the sine divided out, so they stay exact up to 180 degrees. They follow from
    # Lagrange's f = 1 - y/r1, g = A sqrt(y/mu), g' = 1 - y/r2 and y - r1 - r2 = -sqrt(2) A cos(x/2).
    rate = math.sqrt(EARTH_GM_M3_S2 / y)
    turn = math.sqrt(one_minus / (d1 * d2))
    bow = math.sqrt(2.0) * _half_cosine(z)
    swing = way * math.sqrt(one_plus / (d1 * d2))
    out1, in2 = rate * (d2 * swing - bow), rate * (bow - d1 * swing)
    u1, u2 = r1 / d1, r2 / d2
    start_velocity = out1 * u1 + rate * d2 * turn * np.cross(normal, u1)
    end_velocity = in2 * u2 + rate * d1 * turn * np.cross(normal, u2)
    return start_velocity, end_velocity


def _half_cosine(z: float) -> float:
    """cos(sqrt(z) / 2), continued to z < 0."""
    return math.cos(0.5 * math.sqrt(z)) if z >= 0 else math.cosh(0.5 * math.sqrt(-z))


def _auxiliary(z: float, sum_m: float, chord_term: float) -> float:
    return sum_m - math.sqrt(2.0) * chord_term * _half_cosine(z)


def _time_of_flight_s(z: float, sum_m: float, chord_term: float) -> float:
    y = max(_auxiliary(z, sum_m, chord_term), 0.0)
    c, s = (float(x) for x in stumpff(z))
    return float((y / c) ** 1.5 * s + chord_term * math.sqrt(y)) / math.sqrt(EARTH_GM_M3_S2)


def _solve_z(sum_m: float, chord_term: float, duration_s: float) -> float:
    """Bisect for the z whose time of flight is duration_s."""
    high = 4.0 * math.pi**2
    if chord_term > 0:  # y = 0, time 0
        low = -((2.0 * math.acosh(sum_m / (math.sqrt(2.0) * chord_term))) ** 2)
    else:
        low = -1.0
        while _time_of_flight_s(low, sum_m, chord_term) > duration_s:
            low *= 2.0
            if low < -2000.0:
                raise InputError("is too short for a conic the long way round", "duration_s", duration_s, "g")
    middle = 0.5 * (low + high)
    while high - low > 2e-16 * max(1.0, abs(middle)) and low < middle < high:
        if _time_of_flight_s(middle, sum_m, chord_term) < duration_s:
            low = middle
        else:
            high = middle
        middle = 0.5 * (low + high)
    return middle
