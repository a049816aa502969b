"""Tracks: states at uniform nodes with cubic Hermite interpolation between them, and the error of that measured.

The interpolation error of a cubic Hermite interval is `step^4 / 384 * |d4r/dt4|`, largest at its middle, so comparing
with the propagator at the midpoints measures the worst error. On a circular orbit it is `a (n step)^4 / 384`: for
1 mm, about 14 s in low orbit and 17 s at 1,600 km.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError

F64 = NDArray[np.float64]

StateFunction = Callable[[F64], tuple[F64, F64]]
"""time_s (n_time,) -> position_m, velocity_m_s, both (n_time, 3) or (n_time, n_object, 3)."""

PositionFunction = Callable[[F64], F64]
"""time_s (n_time,) -> geocentric position, GCRS axes [m], (n_time, 3). `Track.position_at_m` is one."""

TRACK_ERROR_M = 1e-3
"""Default bound of the interpolation error [m]."""

WORST_TRACK_ERROR_M = 1.0
"""What is taken of motion that is not smooth."""

SHORTEST_STEP_S = 0.01
"""Shortest node step [s]."""

MOST_NODES = 30_000_000
"""Nodes of all objects together: 1.4 GB."""

MOST_ROUGH_NODES = 5_000_000
"""Nodes of all objects together to which steps are shortened for motion that is not smooth."""

_N_TRIAL = 96
_BEND = 3.0**0.5 / 18.0  # largest u (1 - u) (1 - 2 u)
_INCONSISTENT_M_S = 1e-4
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)

# Nodes may be asked for at a span's very end after a round trip through decimal text.
_SPAN_SLACK_S = 1e-9


@dataclass(frozen=True, eq=False)
class Track:
    """States of one object on a uniform node grid; GCRS axes, geocentric."""

    name: str
    start_s: float
    """Time of the first node [s since the scene's epoch]."""
    step_s: float
    """Node spacing [s]."""
    position_m: F64
    """Node positions [m], shape (n_node, 3)."""
    velocity_m_s: F64
    """Node velocities [m/s], shape (n_node, 3)."""
    error_m: float = math.nan
    """Largest measured interpolation error [m]; NaN when nobody measured."""
    error_at_s: float = math.nan
    """Middle of the interval in which that was found [s since the scene's epoch]."""

    def __post_init__(self) -> None:
        shape = np.shape(self.position_m)
        if len(shape) != 2 or shape[1] != 3 or shape[0] < 2:
            raise InputError(f"{self.name}: position_m must have shape (n_node >= 2, 3), got {shape}")
        if np.shape(self.velocity_m_s) != shape:
            raise InputError(f"{self.name}: velocity_m_s must have shape {shape}, got {np.shape(self.velocity_m_s)}")
        if not (math.isfinite(self.start_s) and math.isfinite(self.step_s) and self.step_s > 0):
            raise InputError(f"{self.name}: start_s must be finite and step_s > 0, got {self.start_s}, {self.step_s}")
        bad = ~(np.isfinite(self.position_m).all(axis=1) & np.isfinite(self.velocity_m_s).all(axis=1))
        if bad.any():
            raise InputError(f"{self.name}: node {int(np.argmax(bad))} must be finite, got NaN or inf")

    @property
    def n_node(self) -> int:
        """Number of nodes."""
        return len(self.position_m)

    @cached_property
    def end_s(self) -> float:
        """Time of the last node [s since the scene's epoch]."""
        return self.start_s + (self.n_node - 1) * self.step_s

    def state(self, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s], each of the shape of time_s plus (3,).

        The velocity is the derivative of the position's interpolant (third order in the step).

        Raises:
            InputError: When a time is NaN or outside the nodes' span.
        """
        time = np.asarray(time_s, np.float64)
        interval, s = self._locate(time)
        s = s[..., None]
        p0, p1 = self.position_m[interval], self.position_m[interval + 1]
        m0, m1 = self.velocity_m_s[interval] * self.step_s, self.velocity_m_s[interval + 1] * self.step_s
        # Written about p0 with the difference p1 - p0, so that large radii do not cancel.
        rise = p1 - p0
        c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        position = p0 + s * (m0 + s * (c2 + s * c3))
        velocity = (m0 + s * (2.0 * c2 + 3.0 * s * c3)) / self.step_s
        return position, velocity

    def position_at_m(self, time_s: ArrayLike) -> F64:
        """Return the position [m], of the shape of time_s plus (3,)."""
        return self.state(time_s)[0]

    def _locate(self, time: F64) -> tuple[NDArray[np.int64], F64]:
        bad = ~((time >= self.start_s - _SPAN_SLACK_S) & (time <= self.end_s + _SPAN_SLACK_S))  # NaN is bad too
        if bad.any():
            worst = float(time[bad].flat[0]) if time.ndim else float(time)
            raise InputError(
                f"{self.name}: time_s must be in the track's span [{self.start_s:g}, {self.end_s:g}] s, got {worst:g}"
            )
        phase = (time - self.start_s) / self.step_s
        interval = np.clip(np.floor(phase).astype(np.int64), 0, self.n_node - 2)
        return interval, phase - interval


class TrackStack:
    """Several tracks of one node grid, evaluated side by side."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        """Stack the nodes; they are copied.

        Raises:
            InputError: The tracks do not share their nodes' times.
        """
        grids = {(track.start_s, track.step_s, track.n_node) for track in tracks}
        if len(grids) != 1:
            raise InputError(f"tracks: must share one node grid, got {len(grids)}")
        self._first = tracks[0]
        self._position_m = np.stack([track.position_m for track in tracks])
        self._velocity_m_s = np.stack([track.velocity_m_s for track in tracks])

    def position_m(self, track: NDArray[np.int64], time_s: F64) -> F64:
        """Return the positions of pairs of track and time, both (n,): those of Track.position_at_m [m], (n, 3)."""
        interval, s = self._first._locate(time_s)
        p0, p1 = self._position_m[track, interval], self._position_m[track, interval + 1]
        m0, m1 = self._velocity_m_s[track, interval], self._velocity_m_s[track, interval + 1]
        return _hermite_m(p0, p1, m0 * self._first.step_s, m1 * self._first.step_s, s[:, None])

    def positions_m(self, time_s: F64) -> F64:
        """Return the positions of all tracks at times (n,) [m], (n_track, n, 3)."""
        interval, s = self._first._locate(time_s)
        p0, p1 = self._position_m[:, interval], self._position_m[:, interval + 1]
        m0, m1 = self._velocity_m_s[:, interval], self._velocity_m_s[:, interval + 1]
        return _hermite_m(p0, p1, m0 * self._first.step_s, m1 * self._first.step_s, s[:, None])


def _hermite_m(p0: F64, p1: F64, m0: F64, m1: F64, s: F64) -> F64:
    """Positions between nodes p0 and p1 with slopes m0 and m1, as Track.state has them."""
    rise = p1 - p0
    return p0 + s * (m0 + s * (3.0 * rise - 2.0 * m0 - m1 + s * (m0 + m1 - 2.0 * rise)))


def node_grid(duration_s: float, step_s: float) -> tuple[float, int]:
    """Return start_s and n_node of the grid shared by all tracks of a scene.

    It covers [-step_s, duration_s + step_s]: one step of room for light time and exposure halves at either end.
    """
    if not (math.isfinite(duration_s) and duration_s >= 0):
        raise InputError(f"duration_s: must be >= 0, got {duration_s}")
    if not (math.isfinite(step_s) and step_s > 0):
        raise InputError(f"step_s: must be > 0, got {step_s}")
    n_step = math.ceil(round(duration_s / step_s, 9))  # rounded: 1614 / 0.1 is 16140 steps, not 16141
    return -step_s, n_step + 3


def sample_tracks(
    names: Sequence[str],
    state: StateFunction,
    start_s: float,
    step_s: float,
    n_node: int,
    first_s: ArrayLike = -math.inf,
) -> list[Track]:
    """Sample the objects of one propagator on a node grid and measure each one's interpolation error.

    Args:
        names: One name per object.
        state: Propagator; called once, with nodes and interval midpoints together.
        start_s: Time of the first node [s].
        step_s: Node spacing [s].
        n_node: Number of nodes, at least 2.
        first_s: From when on each object's track matters, one for all or one each [s]; the error of intervals that end
            before is not counted.
    """
    time_s: F64 = start_s + 0.5 * step_s * np.arange(2 * n_node - 1, dtype=np.float64)
    position_m, velocity_m_s = (np.asarray(x, np.float64).reshape(len(time_s), -1, 3) for x in state(time_s))
    if position_m.shape[1] != len(names):
        raise InputError(f"names: must be {position_m.shape[1]}, one per object, got {len(names)}")
    firsts = np.broadcast_to(first_s, len(names))
    return [
        _one_track(name, start_s, step_s, position_m[:, i], velocity_m_s[::2, i], firsts[i])
        for i, name in enumerate(names)
    ]


def _one_track(name: str, start_s: float, step_s: float, dense_m: F64, velocity_m_s: F64, first_s: float) -> Track:
    """Track of positions at nodes and middles, (2 n - 1, 3), and velocities at nodes, (n, 3).

    A velocity that is not the derivative of the positions, SGP4's is off by some cm/s, bends the interpolant by up to
    0.096 step times the difference, and not at the middles: it is counted apart, and where all velocities of an object
    are so, those of the positions take their place.
    """
    slope_m_s = _slopes(dense_m, 0.5 * step_s) if len(velocity_m_s) > 2 else velocity_m_s
    differ_m_s = np.linalg.norm(slope_m_s - velocity_m_s, axis=-1)
    if np.median(differ_m_s) > _INCONSISTENT_M_S:
        velocity_m_s, differ_m_s = slope_m_s, np.zeros(len(velocity_m_s))
    p, v = np.ascontiguousarray(dense_m[::2]), np.ascontiguousarray(velocity_m_s)
    missed_m = np.linalg.norm(_middle_m(p[:-1], p[1:], v[:-1], v[1:], step_s) - dense_m[1::2], axis=-1)
    missed_m += _BEND * step_s * 0.5 * (differ_m_s[:-1] + differ_m_s[1:])
    missed_m[start_s + step_s * np.arange(1, len(p)) <= first_s] = 0.0
    worst = int(np.argmax(missed_m))
    return Track(name, start_s, step_s, p, v, float(missed_m[worst]), start_s + (worst + 0.5) * step_s)


def _slopes(dense_m: F64, h: float) -> F64:
    """Derivatives at every second of equidistant positions, h apart, to fourth order; (2 n - 1, 3) to (n, 3), n > 2."""
    slope = np.empty(((len(dense_m) + 1) // 2, 3))
    far, near = dense_m[4::2] - dense_m[:-4:2], dense_m[3:-1:2] - dense_m[1:-3:2]
    slope[1:-1] = (8.0 * near - far) / (12.0 * h)
    one_sided = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12.0 * h)
    slope[0], slope[-1] = one_sided @ dense_m[:5], -one_sided @ dense_m[:-6:-1]
    return slope


def _middle_m(p0: F64, p1: F64, v0: F64, v1: F64, step_s: float) -> F64:
    """The interpolant half-way between nodes."""
    return 0.5 * (p0 + p1) + 0.125 * step_s * (v0 - v1)


def choose_step_s(
    state: StateFunction,
    duration_s: float,
    error_m: float = TRACK_ERROR_M,
    first_s: ArrayLike = -math.inf,
    longest_s: float = 3600.0,
    shortest_s: float = SHORTEST_STEP_S,
) -> float:
    """Return a node step [s] whose measured interpolation error over [0, duration_s] stays below error_m.

    The error of smooth motion scales with the fourth power of the step; trials at places spread over the scene give the
    step. It has two significant digits (rounded down), and aims at 80 % of the bound to leave room for what lies
    between the places. Motion that is not smooth, as that of a table with few digits, may never come below error_m:
    then the step is taken from where shorter ones stop to help. Meant for satellites and targets: the Sun's distance in
    float64 is itself rounded to 0.03 mm, so its track takes the step of the others.

    Args:
        state: Propagator.
        duration_s: Length of the scene [s].
        error_m: Bound [m].
        first_s: As for sample_tracks.
        longest_s: Longest step [s].
        shortest_s: Shortest step [s].
    """
    step_s = max(min(30.0, longest_s), shortest_s)
    before = math.inf, step_s  # error and step of the last shorter trial
    for _ in range(24):
        worst_m = _trial_error_m(state, duration_s, step_s, first_s)
        ratio = (0.8 * error_m / max(worst_m, 1e-300)) ** 0.25
        if 1.0 <= ratio < 1.3 or (ratio >= 1.0 and step_s >= longest_s):
            return step_s
        if ratio < 1.0 and step_s < before[1]:
            gain = math.log(before[0] / worst_m) / math.log(before[1] / step_s) if before[0] < math.inf else 4.0
            if gain < 0.5 or step_s <= shortest_s:
                return step_s
            before = worst_m, step_s
        step_s = _round_down(min(step_s * min(max(ratio * 0.999, 0.1), 8.0), longest_s))
        step_s = max(step_s, shortest_s)
    return step_s


def _trial_error_m(state: StateFunction, duration_s: float, step_s: float, first_s: ArrayLike) -> float:
    """Largest error at the middles of intervals: all of a short scene, or at places spread evenly over a long one."""
    n_interval = math.ceil(duration_s / step_s)
    if n_interval <= _N_TRIAL:
        begin = step_s * np.arange(-1.0, n_interval + 1.0)
    else:
        begin = (duration_s - step_s) * np.mod(_GOLDEN * np.arange(_N_TRIAL), 1.0)
    n = len(begin)
    time_s = np.concatenate([begin, begin + 0.5 * step_s, begin + step_s])
    p, v = (np.asarray(x, np.float64).reshape(3 * n, -1, 3) for x in state(time_s))
    missed = _middle_m(p[:n], p[2 * n :], v[:n], v[2 * n :], step_s) - p[n : 2 * n]
    counts = (begin + step_s)[:, None] > np.broadcast_to(first_s, missed.shape[1:2])
    return float(np.linalg.norm(missed, axis=-1)[counts].max(initial=0.0))


def make_tracks(
    names: Sequence[str],
    state: StateFunction,
    duration_s: float,
    error_m: float = TRACK_ERROR_M,
    first_s: ArrayLike = -math.inf,
    longest_s: float = 3600.0,
) -> list[Track]:
    """Sample objects with one node step for all, chosen so that the measured error stays below error_m.

    Args:
        names: One name per object.
        state: Propagator of all of them.
        duration_s: Length of the scene [s].
        error_m: Bound [m]; smooth motion keeps it, other motion is told by `Track.error_m`.
        first_s: As for sample_tracks.
        longest_s: Longest step [s].

    Raises:
        InputError: When the motion is so rough that no step keeps the error below 1 m.
    """
    shortest_s = max(SHORTEST_STEP_S, duration_s * len(names) / MOST_NODES)
    step_s = choose_step_s(state, duration_s, error_m, first_s, longest_s, shortest_s)
    shortest_s = max(shortest_s, min(0.5 * step_s, duration_s * len(names) / MOST_ROUGH_NODES))
    first: tuple[float, float] | None = None  # error and step of the first sampling
    while True:
        tracks = sample_tracks(names, state, *_grid(duration_s, step_s), first_s)
        worst_m = max(track.error_m for track in tracks)
        if worst_m <= error_m or step_s <= shortest_s:
            break
        order = 4.0 if first is None else math.log(first[0] / worst_m) / math.log(first[1] / step_s)
        if order < 0.5:  # of the error in the step: shorter ones do not help
            break
        # The worst place lay between the trials: a perigee, or a manoeuvre, where the velocity jumps.
        first = first or (worst_m, step_s)
        step_s = max(shortest_s, _round_down(step_s * max(0.25, 0.95 * (error_m / worst_m) ** (1 / min(order, 4.0)))))
    if worst_m > WORST_TRACK_ERROR_M:
        rough = max(tracks, key=lambda track: track.error_m)
        raise InputError(
            f"{rough.name}: the motion must be smooth, but near {rough.error_at_s:.6g} s it is {rough.error_m:.3g} m "
            f"off between nodes {step_s:g} s apart"
        )
    return tracks


def _grid(duration_s: float, step_s: float) -> tuple[float, float, int]:
    """Start, step and number of nodes."""
    start_s, n_node = node_grid(duration_s, step_s)
    return start_s, step_s, n_node


def _round_down(value: float) -> float:
    """Value with two significant digits, rounded down."""
    scale = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / scale) * scale:.12g}")
