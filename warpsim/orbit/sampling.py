"""Sampling of tracks: the node grid of a step, and the interpolation error. `node_steps.py` chooses the step.

The interpolation error of a cubic Hermite interval is `step^4 / 384 * |d4r/dt4|`, largest at its middle, so comparing
with the propagator at the midpoints measures the worst error. On a circular orbit it is `a (n step)^4 / 384`: for
1 mm, about 14 s in low orbit and 17 s at 1,600 km.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.orbit.track import Track

StateFunction = Callable[[F64], tuple[F64, F64]]
"""time_s (n_time,) -> position_m, velocity_m_s, both (n_time, 3) or (n_time, n_object, 3)."""

ROOM_S = 2.0
"""Room of the node grid before time 0, at least [s]: the light time of 600,000 km."""

ALWAYS_S = (-math.inf, math.inf)
"""Span of a track that matters throughout [s]."""

PAIRS_PER_PIECE = 4_000_000
"""States asked for at once: J2's take 0.6 GB, SGP4's 0.9 GB."""

INCONSISTENT_M_S = 1e-4
"""Velocities that are not the derivative of the positions by more than this are replaced."""

_BEND = 3.0**0.5 / 18.0  # largest u (1 - u) (1 - 2 u)


def node_grid(duration_s: float, step_s: float) -> tuple[float, int]:
    """Return start_s and n_node of the grid of the tracks with a step.

    Time 0 is a node. Before it there is room for light time, ROOM_S or a step, whichever is longer; behind duration_s
    there is a step.
    """
    if not (math.isfinite(duration_s) and duration_s >= 0):
        raise InputError("must be >= 0", "duration_s", duration_s)
    if not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", "step_s", step_s)
    n_before = max(1, math.ceil(round(ROOM_S / step_s, 9)))
    return -n_before * step_s, n_before + n_step(duration_s, step_s) + 2


def n_step(duration_s: float, step_s: float) -> int:
    """Steps that cover a time."""
    return math.ceil(round(duration_s / step_s, 9))  # rounded: 1614 / 0.1 is 16140 steps, not 16141


def even_step_s(duration_s: float, step_s: float) -> float:
    """The longest step up to step_s that divides the scene evenly: its end is a node, as its beginning is.

    So what the motion does outside the scene has no part in the tracks within.
    """
    return duration_s / max(1, n_step(duration_s, step_s)) if duration_s > 0 else step_s


def sample_tracks(
    names: Sequence[str],
    state: StateFunction,
    start_s: float,
    step_s: float,
    n_node: int,
    counted_s: ArrayLike = ALWAYS_S,
    ends: tuple[int, int] | None = None,
) -> list[Track]:
    """Sample the objects of one propagator on a node grid and measure each one's interpolation error.

    The propagator is called with nodes and interval midpoints together, once but for very many of them. From when to
    when each object's track matters is counted_s, a pair for all or one each [s], (n_object, 2); `ends` are the numbers
    of the nodes at which the scene begins and ends, where the acceleration may jump.
    """
    time_s: F64 = start_s + 0.5 * step_s * np.arange(2 * n_node - 1, dtype=np.float64)
    position_m, velocity_m_s = np.empty((len(time_s), len(names), 3)), np.empty((n_node, len(names), 3))
    rows = 2 * max(1, PAIRS_PER_PIECE // (2 * max(1, len(names))))
    for begin in range(0, len(time_s), rows):
        piece = slice(begin, begin + rows)
        some_m, some_m_s = finite_states(names, state, time_s[piece])
        if some_m.shape[1] != len(names):
            raise InputError(f"must be {some_m.shape[1]}, one per object", "names", len(names))
        position_m[piece], velocity_m_s[begin // 2 : (begin + rows) // 2] = some_m, some_m_s[::2]
    spans_s = np.broadcast_to(counted_s, (len(names), 2))
    return [
        _one_track(name, start_s, step_s, position_m[:, i], velocity_m_s[:, i], spans_s[i], ends)
        for i, name in enumerate(names)
    ]


def finite_states(names: Sequence[str], state: StateFunction, time_s: F64) -> tuple[F64, F64]:
    """Positions and velocities, each (n_time, n_object, 3), none of them NaN or infinite."""
    position_m, velocity_m_s = (np.asarray(x, np.float64).reshape(len(time_s), -1, 3) for x in state(time_s))
    good = np.isfinite(position_m).all(axis=-1) & np.isfinite(velocity_m_s).all(axis=-1)
    if not good.all():
        row, column = (int(index) for index in np.argwhere(~good)[0])
        name = names[column] if column < len(names) else f"object {column}"
        raise InputError(f"the state must be finite, but is not at {time_s[row]:.6g} s").of(name)
    return position_m, velocity_m_s


def _one_track(
    name: str,
    start_s: float,
    step_s: float,
    dense_m: F64,
    velocity_m_s: F64,
    counted_s: F64,
    ends: tuple[int, int] | None,
) -> Track:
    """Track of positions at nodes and middles, (2 n - 1, 3), and velocities at nodes, (n, 3)."""
    used_m_s, missed_m = assessed(dense_m, velocity_m_s, step_s, ends)
    p, v = np.ascontiguousarray(dense_m[::2]), np.ascontiguousarray(used_m_s)
    node_s = start_s + step_s * np.arange(len(p))
    missed_m[(node_s[1:] <= counted_s[0]) | (node_s[:-1] >= counted_s[1])] = 0.0
    worst = int(np.argmax(missed_m))
    return Track(name, start_s, step_s, p, v, float(missed_m[worst]), start_s + (worst + 0.5) * step_s)


def assessed(dense_m: F64, velocity_m_s: F64, step_s: float, ends: tuple[int, int] | None = None) -> tuple[F64, F64]:
    """Velocities used by the interpolant (n, ..., 3), and its error in each interval [m], (n - 1, ...).

    A velocity that is not the derivative of the positions shifts the interpolant by up to 0.096 step times the
    difference, and not at the middles: it is counted apart, and where all velocities of an object are so, those of the
    positions replace it. SGP4's are: by some cm/s on near-Earth orbits, by more than 1 m/s on Molniya's. At `ends`, and
    outside, positions of both sides do not determine single velocities.
    """
    differ_m_s = np.zeros(velocity_m_s.shape[:-1])
    if len(velocity_m_s) > 2:
        slope_m_s = _slopes(dense_m, 0.5 * step_s)
        differ_m_s = np.linalg.norm(slope_m_s - velocity_m_s, axis=-1)
        replaced = np.median(differ_m_s, axis=0) > INCONSISTENT_M_S
        velocity_m_s = np.where(replaced[..., None], slope_m_s, velocity_m_s)
        differ_m_s = np.where(replaced, 0.0, differ_m_s)
        if ends is not None:
            differ_m_s[: ends[0] + 1], differ_m_s[ends[1] :] = 0.0, 0.0
    middle_m = interpolated_middle_m(dense_m[:-1:2], dense_m[2::2], velocity_m_s[:-1], velocity_m_s[1:], step_s)
    missed_m = np.linalg.norm(middle_m - dense_m[1::2], axis=-1)
    missed_m += _BEND * step_s * 0.5 * (differ_m_s[:-1] + differ_m_s[1:])
    return velocity_m_s, missed_m


def _slopes(dense_m: F64, h: float) -> F64:
    """Derivatives at every second of equidistant positions, h apart, to fourth order; (2 n - 1, ...) to (n, ...)."""
    slope = np.empty(((len(dense_m) + 1) // 2, *dense_m.shape[1:]))
    slope[1:-1] = central(dense_m[:-4:2], dense_m[1:-3:2], dense_m[3:-1:2], dense_m[4::2], h)
    one_sided = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12.0 * h)
    slope[0], slope[-1] = np.tensordot(one_sided, dense_m[:5], 1), np.tensordot(-one_sided, dense_m[:-6:-1], 1)
    return slope


def central(before2: F64, before1: F64, after1: F64, after2: F64, h: float) -> F64:
    """Derivative from two neighbours on either side, to fourth order."""
    return (8.0 * (after1 - before1) - (after2 - before2)) / (12.0 * h)


def interpolated_middle_m(p0: F64, p1: F64, v0: F64, v1: F64, step_s: float) -> F64:
    """The interpolant half-way between nodes."""
    return 0.5 * (p0 + p1) + 0.125 * step_s * (v0 - v1)
