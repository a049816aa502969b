"""Tracks (states at uniform nodes, by `sampling.py`), and polynomials through tabulated states.

Tracks have cubic Hermite interpolation between nodes. Tables have Lagrange's and Hermite's in sliding windows: one of k
nodes lies around the interval that holds the time, as evenly as the table's ends allow, so that the motion passes
through every node and its windows change at nodes. Coefficients are Newton's divided differences, of times about the
window's middle in units of its half length and of values less that of its middle node: of order one or small, whatever
the size of the orbit. Measured at 500 km in steps of 60 s against the true orbit: degree 7 Hermite 2e-7 m inside and
8e-7 m in the first and last intervals; degree 7 Lagrange 5e-6 m and 7e-5 m, degree 5 3e-3 m and 0.015 m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64, I64
from warpsim.errors import InputError

PositionFunction = Callable[[F64], F64]
"""time_s (n_time,) -> geocentric position, GCRS axes [m], (n_time, 3). `Track.position_at_m` is one."""

# Nodes may be asked for at a span's very end after a round trip through decimal text.
_SPAN_SLACK_S = 1e-9


Method = Literal["linear", "lagrange", "hermite"]


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
            raise InputError("must have shape (n_node >= 2, 3)", "position_m", shape).of(self.name)
        if np.shape(self.velocity_m_s) != shape:
            raise InputError(f"must have shape {shape}", "velocity_m_s", np.shape(self.velocity_m_s)).of(self.name)
        if not (math.isfinite(self.start_s) and math.isfinite(self.step_s) and self.step_s > 0):
            raise InputError(f"start_s must be finite and step_s > 0, got {self.start_s}, {self.step_s}").of(self.name)
        bad = ~(np.isfinite(self.position_m).all(axis=1) & np.isfinite(self.velocity_m_s).all(axis=1))
        if bad.any():
            raise InputError(f"node {int(np.argmax(bad))} must be finite, got NaN or inf").of(self.name)

    @property
    def n_node(self) -> int:
        """Number of nodes."""
        return len(self.position_m)

    @cached_property
    def end_s(self) -> float:
        """Time of the last node [s since the scene's epoch]."""
        return self.start_s + (self.n_node - 1) * self.step_s

    @property
    def node_s(self) -> F64:
        """Times of the nodes [s since the scene's epoch], shape (n_node,)."""
        return np.asarray(self.start_s + self.step_s * np.arange(self.n_node))

    def at_nodes_of(self, other: Track) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s] at the nodes of another track, each (n_node, 3).

        Where that begins before this one, or ends after it, they are those of this one's ends.
        """
        if (self.start_s, self.step_s, self.n_node) == (other.start_s, other.step_s, other.n_node):
            return self.position_m, self.velocity_m_s
        return self.state(np.clip(other.node_s, self.start_s, self.end_s))

    def state(self, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s], each of the shape of time_s plus (3,).

        The velocity is the derivative of the position's interpolant (third order in the step). InputError: A time is
        NaN or outside the nodes' span.
        """
        time = np.asarray(time_s, np.float64)
        interval, s = self._locate(time)
        s = s[..., None]
        p0, m0, c2, c3 = _cubic(self.position_m, self.velocity_m_s, interval, self.step_s)
        return p0 + s * (m0 + s * (c2 + s * c3)), (m0 + s * (2.0 * c2 + 3.0 * s * c3)) / self.step_s

    def position_at_m(self, time_s: ArrayLike) -> F64:
        """Return the position [m], of the shape of time_s plus (3,)."""
        return self.state(time_s)[0]

    def _locate(self, time: F64) -> tuple[I64, F64]:
        bad = ~((time >= self.start_s - _SPAN_SLACK_S) & (time <= self.end_s + _SPAN_SLACK_S))  # NaN is bad too
        if bad.any():
            worst = float(time[bad].flat[0]) if time.ndim else float(time)
            raise InputError(
                f"must be in the track's span [{self.start_s:g}, {self.end_s:g}] s", "time_s", worst, "g"
            ).of(self.name)
        phase = (time - self.start_s) / self.step_s
        interval = np.clip(np.floor(phase).astype(np.int64), 0, self.n_node - 2)
        return interval, phase - interval


class TrackStack:
    """Several tracks in arrays of all their nodes, one track after the other, evaluated side by side."""

    def __init__(self, tracks: Sequence[Track]) -> None:
        """Stack copies of the nodes."""
        self._tracks = tracks
        self.n_node = np.array([track.n_node for track in tracks], dtype=np.int64)
        """Nodes of each track, (n_track,)."""
        self.first = np.cumsum(self.n_node) - self.n_node
        """Index of each track's first node, (n_track,)."""
        self.start_s = np.array([track.start_s for track in tracks], dtype=np.float64)
        self.step_s = np.array([track.step_s for track in tracks], dtype=np.float64)
        self.node_m = np.concatenate([track.position_m for track in tracks])
        """Node positions [m], shape (n, 3)."""
        self.node_m_s = np.concatenate([track.velocity_m_s for track in tracks])
        """Node velocities [m/s], shape (n, 3)."""
        self._span_s = float(self.start_s.max()), min(track.end_s for track in tracks)

    def positions_m(self, time_s: F64) -> F64:
        """Return the positions of all tracks at times (n,) [m], (n_track, n, 3)."""
        return self.position_m(np.arange(len(self._tracks))[:, None], time_s)

    def position_m(self, track: I64, time_s: F64) -> F64:
        """Return the positions of tracks at times, of shapes that broadcast: those of Track.position_at_m, (..., 3)."""
        if not ((time_s >= self._span_s[0]) & (time_s <= self._span_s[1])).all():
            tracks, times = np.broadcast_arrays(track, time_s)
            for number in np.unique(tracks).tolist():
                self._tracks[number]._locate(times[tracks == number])
        step_s = self.step_s[track]
        phase = (time_s - self.start_s[track]) / step_s
        interval = np.clip(np.floor(phase).astype(np.int64), 0, self.n_node[track] - 2)
        s, node = (phase - interval)[..., None], self.first[track] + interval
        p0, m0, c2, c3 = _cubic(self.node_m, self.node_m_s, node, step_s[..., None])
        return np.asarray(p0 + s * (m0 + s * (c2 + s * c3)))


def _cubic(position_m: F64, velocity_m_s: F64, node: I64, step_s: F64 | float) -> tuple[F64, F64, F64, F64]:
    """Coefficients of Hermite's cubic from a node to the next one, in the part of the step."""
    p0, m0, m1 = position_m[node], velocity_m_s[node] * step_s, velocity_m_s[node + 1] * step_s
    rise = position_m[node + 1] - p0  # differences only, so that large radii do not cancel
    return p0, m0, 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise


def window_size(method: Method, degree: int, n_node: int) -> int:
    """Nodes of a window: what the degree needs (Hermite's are odd), or all where these are fewer (the degree falls)."""
    required = {"linear": 2, "lagrange": degree + 1, "hermite": (degree + 1) // 2}[method]
    return min(max(required, 1), n_node)


def interpolate(
    node_s: ArrayLike, value: ArrayLike, rate: ArrayLike | None, method: Method, degree: int, time_s: ArrayLike
) -> tuple[F64, F64]:
    """Return values and their rates between (or a little beyond) the nodes of a table, both (n_time, n_column).

    Rates of the table are used, and needed, by "hermite" only.
    """
    node, y, t = np.asarray(node_s, np.float64), np.asarray(value, np.float64), np.asarray(time_s, np.float64)
    dy = None if rate is None else np.asarray(rate, np.float64)
    _check(node, y, dy, method, degree)
    size = window_size(method, degree, len(node))
    interval = np.clip(np.searchsorted(node, t, side="right") - 1, 0, max(len(node) - 2, 0))
    start = np.clip(interval - (size - 1) // 2, 0, len(node) - size)
    windows, which = np.unique(start, return_inverse=True)
    rows = windows[:, None] + np.arange(size)
    middle = rows[:, size // 2]
    least = float(np.diff(node).min()) if len(node) > 1 else 1.0  # of a window of one node, whose half length is 0
    scale = np.maximum(0.5 * (node[rows[:, -1]] - node[rows[:, 0]]), least)
    x = (node[rows] - node[middle][:, None]) / scale[:, None]
    offset = y[rows] - y[middle][:, None]
    slope = None if dy is None or method != "hermite" else dy[rows] * scale[:, None, None]
    knots, coefficient = _newton(x, offset, slope)
    s = (t - node[middle][which]) / scale[which]
    result, derivative = _evaluate(knots, coefficient, which, s)
    return y[middle][which] + result, derivative / scale[which][:, None]


def sampling_error(
    node_s: ArrayLike, value: ArrayLike, rate: ArrayLike | None, method: Method, degree: int, time_s: ArrayLike
) -> F64:
    """Return the error bound of interpolate() by the table's sparseness, (n_time,) in the unit of value.

    Windows of one and two nodes fewer differ from the full one by d1, and among each other by d2; were the differences
    to go on falling so, the next would be d1^2 / d2. An estimate, not a bound: some times too large or too small.
    """
    if method == "linear":
        method, rate, sizes = "lagrange", None, (2, 4, 3)
    else:
        size = window_size(method, degree, len(np.asarray(node_s)))
        sizes = (size, max(size - 1, 1), max(size - 2, 1))
        if method == "hermite" and size == 2:
            sizes = (2, 4, 3)  # one node alone knows too little

    def values(size: int) -> F64:
        required = 2 * size - 1 if method == "hermite" else max(size - 1, 1)
        return interpolate(node_s, value, rate, method, required, time_s)[0]

    full, less, least = (values(size) for size in sizes)
    d1, d2 = np.linalg.norm(full - less, axis=-1), np.linalg.norm(less - least, axis=-1)
    return np.asarray(d1 if len(set(sizes)) < 3 else d1 * np.minimum(d1 / np.maximum(d2, 1e-200), 1.0))


def _check(node: F64, y: F64, dy: F64 | None, method: str, degree: int) -> None:
    if node.ndim != 1 or len(node) == 0 or y.ndim != 2 or len(y) != len(node):
        raise InputError(f"must have shapes (n,) and (n, m), n >= 1, got {node.shape} and {y.shape}", "node_s, value")
    if not (np.diff(node) > 0).all():
        raise InputError("must ascend", "node_s")
    if method not in ("linear", "lagrange", "hermite"):
        raise InputError("must be 'linear', 'lagrange' or 'hermite'", "method", method)
    if degree < 1:
        raise InputError("must be >= 1", "degree", degree)
    if method == "hermite" and (dy is None or dy.shape != y.shape):
        raise InputError(f"must have shape {y.shape} for 'hermite', got {None if dy is None else dy.shape}", "rate")


def _newton(x: F64, y: F64, slope: F64 | None) -> tuple[F64, F64]:
    """Knots (n_window, m) and Newton's coefficients (n_window, m, n_column); with slopes every node counts twice."""
    middle = x.shape[1] // 2
    order = sorted(range(x.shape[1]), key=lambda i: (abs(i - middle), i))  # outwards: differences lose least so
    x, y = x[:, order], y[:, order]
    knots, table = x, (y[:, 1:] - y[:, :-1]) / (x[:, 1:] - x[:, :-1])[..., None]
    if slope is not None:
        knots, between = np.repeat(x, 2, axis=1), table
        table = np.empty((x.shape[0], 2 * x.shape[1] - 1, y.shape[2]))
        table[:, ::2], table[:, 1::2] = slope[:, order], between
    coefficient = [y[:, 0]]
    while table.shape[1]:
        coefficient.append(table[:, 0])
        gap = len(coefficient)
        table = (table[:, 1:] - table[:, :-1]) / (knots[:, gap:] - knots[:, :-gap])[..., None]
    return knots, np.stack(coefficient, axis=1)


def _evaluate(knots: F64, coefficient: F64, which: I64, s: F64) -> tuple[F64, F64]:
    """Values and derivatives of Newton's form at s, (n_time, n_column) each."""
    m = coefficient.shape[1]
    value: F64 = coefficient[which, m - 1]
    derivative: F64 = np.zeros_like(value)
    for j in range(m - 2, -1, -1):
        step = (s - knots[which, j])[:, None]
        derivative = value + step * derivative
        value = coefficient[which, j] + step * value
    return value, derivative
