"""Two-body motion: states along any conic at any time, and Lambert's problem.

Universal variables: Bate, Mueller and White, Fundamentals of Astrodynamics, sections 4.3 to 4.5 and 5.3; the root
finder is Conway's (1986).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.constants import EARTH_GM_M3_S2
from warpsim.errors import InputError

_SERIES_BELOW = 1.0
_PAIRS_PER_CHUNK = 50_000  # (time, object) pairs solved at once: they stay in the processor's cache
_N_SERIES = 12  # the first term left out is below 1e-25 for |z| < 1
# 0.02 arcsec, 0.7 m on the ground: nearer to 0 or 180 degrees the plane hangs on details of the end points.
_SMALLEST_SINE = 1e-7
_WORST_TIME = 0.1  # of the duration: rounding, much less but for ends some metres apart at some km/s


def stumpff(z: ArrayLike) -> tuple[F64, F64]:
    """Return the Stumpff functions C(z) = (1 - cos sqrt z) / z and S(z) = (sqrt z - sin sqrt z) / sqrt z^3.

    Both continue analytically through z = 0 to hyperbolic motion (z < 0). Relative error below 1e-14.
    """
    z = np.asarray(z, np.float64)
    c, s = np.zeros_like(z), np.zeros_like(z)
    for k in reversed(range(_N_SERIES)):  # Horner form of sum (-z)^k / (2k+2)! and / (2k+3)!
        c = (1.0 - z * c) / ((2 * k + 1) * (2 * k + 2))
        s = (1.0 - z * s) / ((2 * k + 2) * (2 * k + 3))
    root = np.sqrt(np.maximum(np.abs(z), _SERIES_BELOW))
    elliptic, hyperbolic = z > _SERIES_BELOW, z < -_SERIES_BELOW
    c = np.where(elliptic, 2.0 * (np.sin(0.5 * root) / root) ** 2, c)
    s = np.where(elliptic, (root - np.sin(root)) / root**3, s)
    if hyperbolic.any():
        grow = np.where(hyperbolic, root, 0.0)
        c = np.where(hyperbolic, 2.0 * (np.sinh(0.5 * grow) / root) ** 2, c)
        s = np.where(hyperbolic, (np.sinh(grow) - root) / root**3, s)
    return c, s


def propagate_two_body(position_m: ArrayLike, velocity_m_s: ArrayLike, time_s: ArrayLike) -> tuple[F64, F64]:
    """Move states (n, 3) [m], [m/s] along their conics to times (m,) of either sign; each (m, n, 3)."""
    r0, v0 = np.asarray(position_m, np.float64), np.asarray(velocity_m_s, np.float64)
    times = np.asarray(time_s, np.float64)
    position, velocity = np.empty((len(times), *r0.shape)), np.empty((len(times), *r0.shape))
    rows = max(1, _PAIRS_PER_CHUNK // max(1, len(r0)))
    for start in range(0, len(times), rows):
        part = slice(start, start + rows)
        position[part], velocity[part] = _two_body_block(r0, v0, times[part])
    return position, velocity


def _two_body_block(r0: F64, v0: F64, times: F64) -> tuple[F64, F64]:
    mu = EARTH_GM_M3_S2
    radius = np.asarray(np.linalg.norm(r0, axis=-1))
    alpha = 2.0 / radius - np.sum(v0 * v0, axis=-1) / mu  # 1 / semi-major axis
    sigma = np.sum(r0 * v0, axis=-1) / np.sqrt(mu)
    t = np.broadcast_to(times[:, None], (len(times), len(radius)))
    closed = alpha > 1e-6 / radius  # periods of near-parabolas are too long to take off
    period = 2.0 * np.pi / np.sqrt(mu * np.where(closed, alpha, 1.0) ** 3)
    t = np.where(closed, t - period * np.round(t / period), t)

    chi = _universal_anomaly(t, radius, alpha, sigma)
    c, s = stumpff(alpha * chi * chi)
    f = 1.0 - chi * chi * c / radius
    g = t - chi * chi * chi * s / np.sqrt(mu)
    position = f[..., None] * r0 + g[..., None] * v0
    new_radius = np.linalg.norm(position, axis=-1)
    f_dot = np.sqrt(mu) / (new_radius * radius) * chi * (alpha * chi * chi * s - 1.0)
    g_dot = 1.0 - chi * chi * c / new_radius
    return position, f_dot[..., None] * r0 + g_dot[..., None] * v0


def _universal_anomaly(t: F64, radius: F64, alpha: F64, sigma: F64) -> F64:
    """Solve Kepler's equation in chi [m^0.5] by Laguerre's method of order 5, which converges from any start here."""
    root_mu = np.sqrt(EARTH_GM_M3_S2)
    # Start on the circular rate for closed orbits, on the local rate for open ones, capped where t would overflow.
    chi: F64 = np.where(alpha > 0, root_mu * t * alpha, root_mu * t / radius)
    open_cap = 5.0 / np.sqrt(np.maximum(-alpha, 1e-300))
    chi = np.where(alpha < 0, np.clip(chi, -open_cap, open_cap), chi)
    for _ in range(60):
        z = alpha * chi * chi
        c, s = stumpff(z)
        value = sigma * chi * chi * c + (1.0 - alpha * radius) * chi * chi * chi * s + radius * chi - root_mu * t
        slope = sigma * chi * (1.0 - z * s) + (1.0 - alpha * radius) * chi * chi * c + radius
        curve = sigma * (1.0 - z * c) + (1.0 - alpha * radius) * chi * (1.0 - z * s)
        root = np.sqrt(np.abs(16.0 * slope**2 - 20.0 * value * curve))
        step = 5.0 * value / (slope + np.copysign(root, slope))
        chi = chi - step
        # One step after 1e-9 is far below rounding, as the convergence is cubic.
        if np.all(np.abs(step) <= 1e-9 * (np.abs(chi) + 1.0)):
            return chi
    raise InputError("the two-body equation did not converge; positions, velocities and times must be finite", "time_s")


def lambert(start_m: ArrayLike, end_m: ArrayLike, duration_s: float) -> tuple[F64, F64]:
    """Return the velocities at both ends of the two-body arc the short way about the centre [m/s], each of shape (3,).

    With x^2 = z and k = sqrt(r1 r2 (1 + cos theta)) the auxiliary y(z) = r1 + r2 - sqrt(2) k cos(x / 2) has no
    cancellation, and the time of flight grows with z over all of (lowest z, 4 pi^2), so bisection always converges.

    Raises:
        InputError: On NaN, a duration <= 0, positions at the centre, ends in line with the centre (within 1e-7 rad of 0
            or 180 degrees apart, where the plane is undefined), or a time too short for any conic in float64.
    """
    r1, r2 = np.asarray(start_m, np.float64), np.asarray(end_m, np.float64)
    if r1.shape != (3,) or r2.shape != (3,) or not (np.isfinite(r1).all() and np.isfinite(r2).all()):
        raise InputError(f"must be finite 3-vectors, got {r1.tolist()} and {r2.tolist()}", "start_m, end_m")
    if not (math.isfinite(duration_s) and duration_s > 0):
        raise InputError("must be > 0", "duration_s", duration_s)
    d1, d2 = float(np.linalg.norm(r1)), float(np.linalg.norm(r2))
    normal = np.cross(r1, r2)
    area = float(np.linalg.norm(normal))
    if not area > _SMALLEST_SINE * d1 * d2:
        raise InputError("must not be 0 or 180 degrees apart about the centre (plane undefined)", "start_m, end_m")
    normal *= 1.0 / area
    cosine, sine = float(r1 @ r2) / (d1 * d2), area / (d1 * d2)

    # 1 + cos and 1 - cos from the sine where the direct sum would cancel.
    one_plus = 1.0 + cosine if cosine > 0 else sine * sine / (1.0 - cosine)
    one_minus = 1.0 - cosine if cosine < 0 else sine * sine / (1.0 + cosine)
    chord_term = math.sqrt(d1 * d2 * one_plus)  # k, Bate's A
    z = _solve_z(d1 + d2, chord_term, duration_s)
    y = _auxiliary(z, d1 + d2, chord_term)
    off_s = _time_of_flight_s(z, d1 + d2, chord_term) - duration_s
    if not (y > 0.0 and abs(off_s) < _WORST_TIME * duration_s):  # else y is rounding of the lengths that it is made of
        raise InputError("is too short for a conic", "duration_s", duration_s, "g")

    # Radial and transverse parts with the sine divided out, so they stay exact up to 180 degrees. They follow from
    # Lagrange's f = 1 - y/r1, g = A sqrt(y/mu), g' = 1 - y/r2 and y - r1 - r2 = -sqrt(2) A cos(x/2).
    rate = math.sqrt(EARTH_GM_M3_S2 / y)
    turn = math.sqrt(one_minus / (d1 * d2))
    bow = math.sqrt(2.0) * _half_cosine(z)
    swing = math.sqrt(one_plus / (d1 * d2))
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
    high = 4.0 * math.pi**2
    low = -((2.0 * math.acosh(max(sum_m / (math.sqrt(2.0) * chord_term), 1.0))) ** 2)  # y = 0, time 0
    middle = 0.5 * (low + high)
    while high - low > 2e-16 * max(1.0, abs(middle)) and low < middle < high:
        if _time_of_flight_s(middle, sum_m, chord_term) < duration_s:
            low = middle
        else:
            high = middle
        middle = 0.5 * (low + high)
    return middle
