"""Motion of satellites and targets: two-body in closed form, or with zonal harmonics of the Earth's field.

Forces are the Earth's central term and its zonal harmonics about one fixed pole, the pole of date at the scene's epoch
(its motion, 20 arcsec a year, is left out, and so are tesseral harmonics, drag, Sun and Moon): J2 for "j2", J2 to J4
for "j4". J3 and J4 move a satellite by 0.2 to 2 km in a day, most along its orbit.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2, EARTH_J2, EARTH_J3, EARTH_J4
from warpsim.errors import InputError
from warpsim.orbit.picard import NoPathError, integrate
from warpsim.orbit.two_body import propagate_two_body

F64 = NDArray[np.float64]

Gravity = Literal["two_body", "j2", "j4"]

_ZONAL = {"two_body": (), "j2": (EARTH_J2,), "j4": (EARTH_J2, EARTH_J3, EARTH_J4)}

_LOWEST_RADIUS_M = 0.5 * EARTH_EQUATORIAL_RADIUS_M

_PATHS_PER_CHUNK = 256  # integrated side by side: their nodes stay in the processor's cache


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
            states = _follow(axes @ r0[paths].T, axes @ v0[paths].T, times[order], _ZONAL[gravity], state_time_s)
            for result, state in zip((position, velocity), states, strict=True):
                result[order, paths] = np.swapaxes(state, 1, 2) @ axes
    now = times == 0.0  # to the last bit, which turning to the pole and back would lose
    position[now], velocity[now] = r0, v0
    return _finite(position, velocity, times, state_time_s)


def _follow(r0: F64, v0: F64, times: F64, zonal: tuple[float, ...], state_time_s: float) -> tuple[F64, F64]:
    """Paths in pole axes, (3, n) to (m, 3, n); times of one sign, ascending in magnitude."""

    def acceleration(position_m: F64) -> F64:
        return zonal_acceleration_m_s2(position_m, zonal)

    distance, speed = np.linalg.norm(r0, axis=0), np.linalg.norm(v0, axis=0)
    rate_rad_s = float(np.max(np.maximum(speed / distance, np.sqrt(EARTH_GM_M3_S2 / distance**3))))
    try:
        return integrate(acceleration, r0, v0, times, rate_rad_s, _LOWEST_RADIUS_M)
    except NoPathError as error:
        raise InputError(
            "the path must stay above half the Earth's radius, but falls through it at "
            f"{state_time_s + error.time_s:g} s",
            "position_m",
        ) from None


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
