"""Triangulation: position, and velocity, of a body from lines of sight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from warpsim.arrays import F64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.directions import normalised, perpendicular
from warpsim.errors import InputError
from warpsim.orbit.gravity import propagate
from warpsim.render.line_of_sight import LineOfSight

Motion = Literal["still", "linear", "free_flight"]

_TOL = 1e-13
"""Relative changes of state and residuals at which the fit ends."""

_SMALL_M, _SMALL_M_S = 1.0, 1e-3
"""Steps of derivatives: straight lines are linear in both far beyond."""

MOST_CONDITION = 1e12
"""Of the normal equations, scaled to unit diagonal, above which the problem has no one answer."""


@dataclass(frozen=True)
class Triangulation:
    """A body's state where lines of sight come nearest to each other, geocentric, GCRS axes."""

    time_s: float
    """When the state holds, after the scene's epoch: the mean time of emission [s]."""
    position_m: F64
    velocity_m_s: F64 | None
    """None where the body was taken to be still."""
    covariance: F64
    """Of position, and velocity behind it [m, m/s]; (3, 3) or (6, 6). For the errors of lines that were stated."""
    residual_rad: F64
    """How far each line misses the body, in two directions across it, (n, 2)."""

    n_freedom: int
    """Numbers measured less numbers found."""
    chi_square: float
    """Sum of squared residuals over their stated errors; about n_freedom where these are right."""


def triangulate(
    lines: Sequence[LineOfSight],
    sigma_rad: float | Sequence[float],
    motion: Motion = "still",
    time_s: float | None = None,
) -> Triangulation:
    """Find where a body was from lines of sight of several sensors, or times.

    Least squares over the angles across each line. Light left the body one range / c before it came in, at other times
    for other sensors: a body at 7 km/s moves 23 m in the light time of 1000 km. With "linear" or "free_flight" its
    velocity is found too, and each line is held to where the body was then; lines of one time know the velocity from
    these few milliseconds only. With "still" its motion meanwhile is an error of so many metres.

    Args:
        lines: One line of sight each, of one direction, in GCRS axes; of at least two.
        sigma_rad: Standard deviation of each line in both directions across it, one number or one each [rad].
        motion: "still"; "linear" motion; "free_flight", under gravity with J2.
        time_s: When the state is asked for, after the epoch [s]; the mean time of emission when left out.

    Raises:
        InputError: Too few lines, a line of several directions or in other axes, an error that is not above 0, lines
            that leave a direction undetermined, that go apart, or that do not meet in one state by the motion.
    """
    from scipy.optimize import least_squares

    origin_m, direction, came_s = _checked(lines)
    sigma = _sigmas(sigma_rad, len(lines))
    if motion not in get_args(Motion):
        raise InputError(f"must be one of {', '.join(get_args(Motion))}", "motion", motion)
    n_state = 3 if motion == "still" else 6
    if 2 * len(lines) < n_state:
        raise InputError(f"must be at least {n_state // 2} for {motion!r}", "lines", len(lines))
    start = _nearest_point(origin_m, direction)
    if time_s is not None and not np.isfinite(time_s):
        raise InputError("must be finite", "time_s", time_s)
    left_s = came_s - np.linalg.norm(start - origin_m, axis=1) / SPEED_OF_LIGHT_M_S
    when_s = float(left_s.mean()) if time_s is None else float(time_s)
    across, pole = _across(direction), lines[0].pole_icrs
    begin = np.concatenate([start, np.zeros(n_state - 3)])
    scale = np.array([_SMALL_M] * 3 + [_SMALL_M_S] * (n_state - 3))

    def missed(values: F64) -> F64:
        """Angles by which lines miss a body of a state, over their errors, (2 n,)."""
        away = _seen_from(values, origin_m, came_s, when_s, motion, pole) - origin_m
        return np.asarray((np.einsum("nij,nj->ni", across, normalised(away)) / sigma[:, None]).ravel())

    def derivatives(values: F64) -> F64:
        """Central differences, (2 n, n_state)."""
        steps = [(missed(values + step) - missed(values - step)) / (2 * step.max()) for step in np.diag(scale)]
        return np.stack(steps, axis=1)

    _checked_normal(derivatives(begin), lines)
    fit = least_squares(missed, begin, derivatives, method="lm", x_scale="jac", xtol=_TOL, ftol=_TOL, gtol=_TOL)
    if not fit.success:
        raise InputError("do not meet in one state by this motion: the steps do not end", "lines")
    state: F64 = fit.x
    _check_in_front(_seen_from(state, origin_m, came_s, when_s, motion, pole) - origin_m, direction, lines)
    covariance = np.asarray(np.linalg.inv(_checked_normal(fit.jac, lines)), dtype=np.float64)
    residual = fit.fun.reshape(-1, 2) * sigma[:, None]
    velocity = None if motion == "still" else state[3:]
    chi_square = float(fit.fun @ fit.fun)
    return Triangulation(when_s, state[:3], velocity, covariance, residual, 2 * len(lines) - n_state, chi_square)


def _seen_from(
    state: F64, origin_m: F64, came_s: F64, when_s: float, motion: str, pole_icrs: tuple[float, float, float]
) -> F64:
    """Where a body of a state was when its light left for each line, (n, 3)."""
    position = np.broadcast_to(state[:3], origin_m.shape)
    if motion == "still":
        return position
    velocity, known_s = state[3:], np.zeros(len(origin_m))
    if motion == "free_flight":
        known_s = came_s - np.linalg.norm(position - origin_m, axis=1) / SPEED_OF_LIGHT_M_S - when_s
        try:
            flown = propagate(state[None, :3], state[None, 3:], known_s, "j2", pole_icrs)
        except InputError:
            raise InputError("do not meet in a state of free flight", "lines") from None
        position, velocity = flown[0][:, 0], flown[1][:, 0]
    found = position
    for _ in range(3):  # each leaves v / c of the error; gravity changes nothing within some milliseconds
        since_s = came_s - np.linalg.norm(found - origin_m, axis=1) / SPEED_OF_LIGHT_M_S - when_s
        found = position + (since_s - known_s)[:, None] * velocity
    return np.asarray(found)


def _checked_normal(jacobian: F64, lines: Sequence[LineOfSight]) -> F64:
    """Normal equations that have one answer; InputError, which names the direction left open, otherwise."""
    normal = jacobian.T @ jacobian
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    if values[0] * MOST_CONDITION < values[-1]:
        names = ("x", "y", "z", "vx", "vy", "vz")
        open_one = names[int(np.argmax(np.abs(vectors[:, 0])))]
        rule = f"leave a direction undetermined, mostly along {open_one}"
        raise InputError(rule, "lines", ", ".join(dict.fromkeys(line.sensor for line in lines)))
    return np.asarray(normal)


def _check_in_front(away_m: F64, direction: F64, lines: Sequence[LineOfSight]) -> None:
    """Raise where a body lies behind a sensor: lines that go apart meet there."""
    behind = np.flatnonzero(np.einsum("ni,ni->n", away_m, direction) <= 0.0)
    if behind.size:
        number = int(behind[0])
        raise InputError(f"goes away from where the others meet, behind {lines[number].sensor}", f"lines[{number}]")


def _nearest_point(origin_m: F64, direction: F64) -> F64:
    """The point with the least sum of squared distances to lines."""
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    matrix = across.sum(axis=0)
    if np.linalg.cond(matrix) > MOST_CONDITION:
        raise InputError("must not all be parallel", "lines")
    return np.asarray(np.linalg.solve(matrix, np.einsum("nij,nj->i", across, origin_m)))


def _across(direction: F64) -> F64:
    """Two unit vectors across each direction, (n, 2, 3)."""
    first = normalised(perpendicular(direction))
    return np.stack([first, np.cross(direction, first)], axis=1)


def _checked(lines: Sequence[LineOfSight]) -> tuple[F64, F64, F64]:
    """Origins, directions and times of lines."""
    if not isinstance(lines, list | tuple) or not all(isinstance(line, LineOfSight) for line in lines):
        raise InputError("must be a list of lines of sight", "lines")
    if len(lines) < 2:
        raise InputError("must be at least 2", "lines", len(lines))
    for number, line in enumerate(lines):
        if len(line.direction) != 1 or line.axes != "gcrs":
            rule = f"must be of one direction, in GCRS axes, got {len(line.direction)} in {line.axes}"
            raise InputError(rule, f"lines[{number}]")
    origin, direction = (np.concatenate([getattr(line, name) for line in lines]) for name in ("origin_m", "direction"))
    return origin, direction, np.concatenate([line.time_s for line in lines])


def _sigmas(sigma_rad: Any, count: int) -> F64:
    """Errors of so many lines."""
    try:
        values = np.asarray(sigma_rad, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("must be numbers", "sigma_rad") from None
    if values.shape not in ((), (count,)) or not (np.isfinite(values) & (values > 0.0)).all():
        raise InputError(f"must be above 0, one number or {count} of them", "sigma_rad", sigma_rad)
    return np.broadcast_to(values, (count,))
