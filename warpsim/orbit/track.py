"""Tracks: states at uniform nodes with cubic Hermite interpolation between them; `orbit/sampling.py` makes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError

F64 = NDArray[np.float64]

PositionFunction = Callable[[F64], F64]
"""time_s (n_time,) -> geocentric position, GCRS axes [m], (n_time, 3). `Track.position_at_m` is one."""

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
                f"must be in the track's span [{self.start_s:g}, {self.end_s:g}] s", "time_s", worst, "g"
            ).of(self.name)
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
            raise InputError("must share one node grid", "tracks", len(grids))
        self._first = tracks[0]
        self._position_m = np.stack([track.position_m for track in tracks])
        self._velocity_m_s = np.stack([track.velocity_m_s for track in tracks])

    def position_m(self, track: NDArray[np.int64], time_s: F64) -> F64:
        """Return the positions of pairs of track and time, both (n,): those of Track.position_at_m [m], (n, 3)."""
        return self._between_m(track, time_s)

    def positions_m(self, time_s: F64) -> F64:
        """Return the positions of all tracks at times (n,) [m], (n_track, n, 3)."""
        return self._between_m(slice(None), time_s)

    def _between_m(self, track: NDArray[np.int64] | slice, time_s: F64) -> F64:
        interval, s = self._first._locate(time_s)
        p0, p1 = self._position_m[track, interval], self._position_m[track, interval + 1]
        m0, m1 = self._velocity_m_s[track, interval], self._velocity_m_s[track, interval + 1]
        m0, m1 = m0 * self._first.step_s, m1 * self._first.step_s
        rise = p1 - p0  # as in Track.state
        c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        return np.asarray(p0 + s[:, None] * (m0 + s[:, None] * (c2 + s[:, None] * c3)))
