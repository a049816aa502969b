"""Motion of satellites and targets: two-body in closed form, or with zonal harmonics of the Earth's field.

Forces are the Earth's central term and its zonal harmonics about one fixed pole, the pole of date at the scene's epoch
(its motion, 20 arcsec a year, is left out, and so are tesseral harmonics, drag, Sun and Moon): J2 for "j2", J2 to J4
for "j4". J3 and J4 move a satellite by 0.2 to 2 km in a day, most along its orbit.

r'' = a(r) is integrated by Chebyshev-Picard iteration, whole spans of many paths at a time: over a segment, a guess of
the path at Chebyshev nodes is put into the force and integrated twice, as polynomials, until it stays the same (C. W.
Clenshaw and H. J. Norton, Computer Journal 6, 1963; X. Bai and J. L. Junkins, J. Astronaut. Sci. 58, 2011). Nodes and
paths are one array, so that NumPy does few, long operations, and the polynomials give the path at any time in between.
A segment is right when its last Chebyshev coefficients vanish in rounding; where they do not, it is halved.
"""

from __future__ import annotations

import functools
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.polynomial.chebyshev import chebint
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2, EARTH_J2, EARTH_J3, EARTH_J4
from warpsim.errors import InputError
from warpsim.orbit.two_body import propagate_two_body

Gravity = Literal["two_body", "j2", "j4"]

_ZONAL = {"two_body": (), "j2": (EARTH_J2,), "j4": (EARTH_J2, EARTH_J3, EARTH_J4)}

_LOWEST_RADIUS_M = 0.5 * EARTH_EQUATORIAL_RADIUS_M

_PATHS_PER_CHUNK = 256  # integrated side by side: their nodes stay in the processor's cache

DEGREE = 20
"""Of the polynomials: one more than this many nodes per segment."""

_FIRST_ANGLE = 1.5  # rad of the fastest path's motion about the centre: 20 coefficients fall to 1e-16 well before
_GROWTH, _GENEROUS = 1.3, 1e-3  # a segment with such a tail is followed by one this much longer
_TAIL = 1e-15  # of the distance from the centre: what the last coefficients may amount to
_STILL = 4e-16  # of the distance: iterations end when nothing moves by more
_N_ITERATION = 40
_SHORTEST_S = 1e-3


@functools.cache
def _matrices() -> tuple[F64, F64, F64]:
    """Chebyshev nodes in [-1, 1] ascending; values at nodes -> coefficients; values -> integral from -1, at nodes."""
    k = np.arange(DEGREE + 1)
    node = -np.cos(np.pi * k / DEGREE)
    values = np.cos(np.outer(np.pi - np.pi * k / DEGREE, k))  # T_k at the nodes
    weight = np.where((k == 0) | (k == DEGREE), 0.5, 1.0)
    to_coefficients = (2.0 / DEGREE) * weight[:, None] * values.T * weight[None, :]
    higher = np.cos(np.outer(np.pi - np.pi * k / DEGREE, np.arange(DEGREE + 2)))
    from_start = higher - higher[0]
    return node, to_coefficients, from_start @ chebint(np.eye(DEGREE + 1)) @ to_coefficients


def _integrate(
    position_m: F64, velocity_m_s: F64, time_s: F64, zonal: tuple[float, ...], state_time_s: float
) -> tuple[F64, F64]:
    """Integrate paths (3, n) in axes whose z is the pole from time 0 to times (m,) of one sign, ascending in magnitude.

    Each (m, 3, n). At any time the result is the same whatever others are asked for, but for rounding.
    """
    positions, velocities = np.empty((len(time_s), *position_m.shape)), np.empty((len(time_s), *position_m.shape))
    distance, speed = np.linalg.norm(position_m, axis=0), np.linalg.norm(velocity_m_s, axis=0)
    rate_rad_s = float(np.max(np.maximum(speed / distance, np.sqrt(EARTH_GM_M3_S2 / distance**3))))  # of the fastest
    end_s = float(time_s[-1])
    step_s = float(np.copysign(_FIRST_ANGLE / rate_rad_s, end_s))
    start_s, row = 0.0, int(np.searchsorted(np.abs(time_s), 0.0, side="right"))
    positions[:row], velocities[:row] = position_m, velocity_m_s
    while row < len(time_s):
        stop_s = end_s if abs(step_s) >= abs(end_s - start_s) else start_s + step_s
        span_s = stop_s - start_s
        segment = _segment(position_m, velocity_m_s, span_s, zonal)
        if segment is None:
            step_s = 0.5 * span_s
            if not abs(step_s) >= _SHORTEST_S:  # NaN is too short too
                raise _no_path(state_time_s + start_s)
            continue
        low = ~(np.linalg.norm(segment.position_m, axis=1).min(axis=1) >= _LOWEST_RADIUS_M)  # NaN is low too
        if low.any():
            raise _no_path(state_time_s + (start_s + span_s * float(np.argmax(low)) / DEGREE))
        # A time at the segment's end is its own: where the sum above rounds to the last time, nothing is left over.
        stop = int(np.searchsorted(np.abs(time_s), abs(stop_s), side="right"))
        if stop > row:
            at = np.clip(2.0 * (time_s[row:stop] - start_s) / span_s - 1.0, -1.0, 1.0)
            positions[row:stop], velocities[row:stop] = _values(segment, at)
        position_m, velocity_m_s = segment.position_m[-1], segment.velocity_m_s[-1]
        start_s, row = stop_s, stop
        if segment.tail < _GENEROUS * _TAIL:
            step_s *= _GROWTH
    return positions, velocities


def _no_path(time_s: float) -> InputError:
    rule = f"the path must stay above half the Earth's radius, but falls through it at {time_s:g} s"
    return InputError(rule, "position_m")


class _Segment(NamedTuple):
    """Paths over a span, at its nodes."""

    position_m: F64
    """Shape (node, 3, n)."""
    velocity_m_s: F64
    tail: float
    """Largest of the last two coefficients over the distance from the centre."""


def _segment(position_m: F64, velocity_m_s: F64, span_s: float, zonal: tuple[float, ...]) -> _Segment | None:
    """Solve over a span; None when the iteration does not settle or the degree is too low."""
    node, to_coefficients, integral = _matrices()
    half = 0.5 * span_s
    n_node, shape = len(node), position_m.shape
    distance = np.linalg.norm(position_m, axis=0)

    def integrated(values: F64) -> F64:
        result: F64 = half * (integral @ values.reshape(n_node, -1)).reshape(n_node, *shape)
        return result

    # First guess: the circle with the acceleration of the start, good for satellites and better than a line for all.
    t = (half * (node + 1.0))[:, None, None]
    pull = np.linalg.norm(zonal_acceleration_m_s2(position_m, zonal), axis=0)
    rate = np.sqrt(pull / distance)
    position = position_m * np.cos(rate * t) + velocity_m_s / rate * np.sin(rate * t)
    before = np.inf
    with np.errstate(all="ignore"):  # a guess that runs away is seen below
        for _ in range(_N_ITERATION):
            velocity = velocity_m_s + integrated(zonal_acceleration_m_s2(position, zonal))
            better = position_m + integrated(velocity)
            moved = float(np.max(np.abs(better - position) / distance))
            position = better
            if not moved < 1e3:
                return None
            if moved <= _STILL or (moved < 1e-13 and moved >= before):  # rounding may keep it from standing still
                break
            before = moved
        else:
            return None
        velocity = velocity_m_s + integrated(zonal_acceleration_m_s2(position, zonal))
    tail = (np.abs(to_coefficients[-2:] @ position.reshape(n_node, -1)).reshape(2, *shape) / distance).max()
    return _Segment(position, velocity, float(tail)) if tail <= _TAIL and np.isfinite(velocity).all() else None


def _values(segment: _Segment, at: F64) -> tuple[F64, F64]:
    """The polynomials through the nodes at arguments in [-1, 1]."""
    to_coefficients = _matrices()[1]
    basis = np.cos(np.arccos(at)[:, None] * np.arange(DEGREE + 1)) @ to_coefficients
    shape = (len(at), *segment.position_m.shape[1:])
    nodes = segment.position_m, segment.velocity_m_s
    position, velocity = ((basis @ values.reshape(len(values), -1)).reshape(shape) for values in nodes)
    return position, velocity


def zonal_acceleration_m_s2(position_m: F64, zonal: tuple[float, ...]) -> F64:
    """Return the acceleration of the central term and of J2, J3, ... [m/s2], in axes whose z is the pole, (..., 3, n).

    The gradient of mu/r (1 - sum of J_n (R/r)^n P_n(s)), s = z/r: with u = r/|r|, each harmonic adds
    mu J_n R^n / r^(n+2) [((n + 1) P_n + s P_n') u - P_n' pole].
    """
    square = np.einsum("...in,...in->...n", position_m, position_m)
    inverse = 1.0 / np.sqrt(square)
    central = EARTH_GM_M3_S2 * inverse * inverse
    sine = position_m[..., 2, :] * inverse
    radial, polar = -central, np.zeros_like(central)
    reach = EARTH_EQUATORIAL_RADIUS_M * inverse
    strength = central * reach
    lower, legendre, slope = np.ones_like(sine), sine, np.ones_like(sine)  # P_{n-1}, P_n, P_n' for n = 1
    for n, harmonic in enumerate(zonal, start=2):
        slope = n * legendre + sine * slope  # P_n' = n P_{n-1} + s P_{n-1}'
        lower, legendre = legendre, ((2 * n - 1) * sine * legendre - (n - 1) * lower) / n
        strength = strength * reach
        radial = radial + harmonic * strength * ((n + 1) * legendre + sine * slope)
        polar = polar + harmonic * strength * slope
    acceleration: F64 = (radial * inverse)[..., None, :] * position_m
    if zonal:
        acceleration[..., 2, :] -= polar
    return acceleration


def propagate(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    time_s: ArrayLike,
    gravity: Gravity,
    pole_icrs: ArrayLike,
    state_time_s: float = 0.0,
) -> tuple[F64, F64]:
    """Propagate states (n, 3) [m], [m/s] from time 0 to times (m,) of either sign, in any order; each (m, n, 3).

    `state_time_s` is when the states hold after the scene's epoch, for the times in error texts.

    Raises:
        InputError: On wrong shapes, NaN, or (but for "two_body") a path that falls through half the Earth's radius.
    """
    r0, v0 = np.asarray(position_m, np.float64), np.asarray(velocity_m_s, np.float64)
    times, pole = np.asarray(time_s, np.float64), np.asarray(pole_icrs, np.float64)
    _check(r0, v0, times, pole)
    if gravity == "two_body":
        return _finite(*propagate_two_body(r0, v0, times), times, state_time_s)
    if gravity not in _ZONAL:
        raise InputError(f"must be one of {', '.join(get_args(Gravity))}", "gravity", gravity)
    position, velocity = np.empty((len(times), *r0.shape)), np.empty((len(times), *r0.shape))
    axes = _pole_axes(pole)
    for side in (times >= 0, times < 0):
        order = np.flatnonzero(side)[np.argsort(np.abs(times[side]), kind="stable")]
        if not len(order):
            continue
        for first in range(0, len(r0), _PATHS_PER_CHUNK):
            paths = slice(first, first + _PATHS_PER_CHUNK)
            states = _integrate(axes @ r0[paths].T, axes @ v0[paths].T, times[order], _ZONAL[gravity], state_time_s)
            for result, state in zip((position, velocity), states, strict=True):
                result[order, paths] = np.swapaxes(state, 1, 2) @ axes
    now = times == 0.0  # to the last bit, which turning to the pole and back would lose
    position[now], velocity[now] = r0, v0
    return _finite(position, velocity, times, state_time_s)


def _finite(position_m: F64, velocity_m_s: F64, times: F64, state_time_s: float) -> tuple[F64, F64]:
    """The states, none of which may be NaN or infinite."""
    for state in (position_m, velocity_m_s):
        good = np.isfinite(state).all(axis=(1, 2))
        if not good.all():
            bad_s = state_time_s + times[int(np.argmin(good))]
            raise InputError(f"must give finite states, but do not at {bad_s:g} s", "position_m, velocity_m_s")
    return position_m, velocity_m_s


def _pole_axes(pole: F64) -> F64:
    """Rows of axes whose z is the pole; a right-handed orthonormal frame."""
    fallback = np.eye(3)[np.argmin(np.abs(pole))]
    x = np.cross(fallback, pole)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(pole, x), pole])


def _check(r0: F64, v0: F64, times: F64, pole: F64) -> None:
    if r0.ndim != 2 or r0.shape[1] != 3 or v0.shape != r0.shape:
        raise InputError(f"must both have shape (n, 3), got {r0.shape} and {v0.shape}", "position_m, velocity_m_s")
    if times.ndim != 1 or pole.shape != (3,):
        raise InputError(f"must have shapes (m,) and (3,), got {times.shape} and {pole.shape}", "time_s, pole_icrs")
    for name, value in (("position_m", r0), ("velocity_m_s", v0), ("time_s", times), ("pole_icrs", pole)):
        if not np.isfinite(value).all():
            raise InputError("must be finite, got NaN or inf", name)
    if r0.size and np.linalg.norm(r0, axis=1).min() < _LOWEST_RADIUS_M:
        lowest_m = np.linalg.norm(r0, axis=1).min()
        raise InputError("must be metres from the Earth's centre, above half its radius", "position_m", lowest_m, "g")
