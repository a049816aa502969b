"""Scan times of access margins: a grid for all objects, and individual times between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]

RESOLUTION_S = 1e-3
"""Ends of intervals are good to this. Scan times no farther apart are the two sides of a jump."""

MOST_SCAN_TIMES = 5_000_000
"""Times of a scan."""


def scan_times_s(duration_s: float, step_s: float) -> F64:
    """Return uniform times from 0 to duration_s [s], at least three, no farther apart than step_s.

    Raises:
        InputError: A length is not a number > 0, or there are more than MOST_SCAN_TIMES steps.
    """
    for name, value in (("duration_s", duration_s), ("step_s", step_s)):
        if not (isinstance(value, Real) and math.isfinite(value) and value > 0):
            raise InputError("must be a number > 0", name, value)
    if duration_s / step_s > MOST_SCAN_TIMES:
        raise InputError(f"must be >= {duration_s / MOST_SCAN_TIMES:.2g} for {duration_s:g} s", "step_s", step_s, "g")
    return np.linspace(0.0, duration_s, max(3, int(np.ceil(duration_s / step_s)) + 1))


@dataclass(frozen=True, eq=False)
class Scan:
    """Scan points: pairs of object and time, by object, then time."""

    row: I64
    """Number of the object, (n_point,)."""
    time_s: F64
    """(n_point,)."""
    number: I64
    """When each point came: those of the grid first, then those inserted, in the order given, (n_point,)."""
    grid: I64
    """Which points are those of the uniform grid, (n_row, n_time)."""

    @classmethod
    def uniform(cls, n_row: int, time_s: F64) -> Scan:
        """Return a scan of the same uniform times, three or more, for each of n_row objects."""
        n_time = len(time_s)
        number = np.arange(n_row * n_time)
        grid = number.reshape(n_row, n_time)
        return cls(np.repeat(np.arange(n_row), n_time), np.tile(time_s, n_row), number, grid)

    def inserted(self, after: I64, time_s: F64) -> Scan:
        """Return the scan with further points, each after the given point (ascending) and before the next one."""
        return Scan(
            np.insert(self.row, after + 1, self.row[after]),
            np.insert(self.time_s, after + 1, time_s),
            np.insert(self.number, after + 1, len(self.number) + np.arange(len(after))),
            self.grid + np.searchsorted(after, self.grid),
        )

    def points_within(self, row: I64, start_s: F64, end_s: F64) -> tuple[I64, Mask, Mask]:
        """Points within intervals, and of two grid steps around; which are the first and last of an unbroken run.

        Args:
            row: Objects of the intervals, those of each apart from each other; by object, then time.
            start_s: Where they begin, inside the scan.
            end_s: Where they end.
        """
        if len(row) == 0:
            return np.empty(0, np.int64), np.empty(0, bool), np.empty(0, bool)
        n_time = self.grid.shape[1]
        first_s, last_s = self.time_s[self.grid[0, 0]], self.time_s[self.grid[0, -1]]
        step_s = (last_s - first_s) / (n_time - 1)
        low = np.clip(np.floor((start_s - first_s) / step_s).astype(np.int64) - 2, 0, n_time - 1)
        high = np.clip(np.ceil((end_s - first_s) / step_s).astype(np.int64) + 2, 0, n_time - 1)
        low, high = self.grid[row, low], self.grid[row, high]
        apart = (row[1:] != row[:-1]) | (low[1:] > high[:-1] + 1)
        low, high = low[np.concatenate([[True], apart])], high[np.concatenate([apart, [True]])]
        length = high - low + 1
        end = np.cumsum(length)
        point = np.arange(end[-1]) - np.repeat(end - length - low, length)
        first, last = np.zeros(len(point), bool), np.zeros(len(point), bool)
        first[end - length], last[end - 1] = True, True
        return point, first, last


def break_times_s(scan: Scan, breaks_s: Sequence[Sequence[float]]) -> tuple[I64, F64]:
    """Return both sides of each object's breakpoints as further times of a uniform scan, with the points before them.

    Between two breakpoints, and between them and the ends, there are three points at least: enough to show an extremum.

    Args:
        scan: A uniform scan.
        breaks_s: For each object, times of a jump or kink; the new motion holds from a breakpoint on.
    """
    grid_s = scan.time_s[scan.grid[0]]
    after, times = [np.empty(0, np.int64)], [np.empty(0)]
    for points, given_s in zip(scan.grid, breaks_s, strict=True):
        own_s = _sides_and_middles(np.unique(np.asarray(given_s, np.float64)), grid_s)
        after.append(points[0] + np.searchsorted(grid_s, own_s) - 1)
        times.append(own_s)
    return np.concatenate(after), np.concatenate(times)


def _sides_and_middles(break_s: F64, grid_s: F64) -> F64:
    """Times for one object's ascending breaks, those of the grid left out."""
    break_s = break_s[(break_s > grid_s[0]) & (break_s <= grid_s[-1])]
    if len(break_s) == 0:
        return break_s
    edge_s = np.concatenate([grid_s[:1], break_s, grid_s[-1:]])
    n_inside = np.searchsorted(grid_s, edge_s[1:] - RESOLUTION_S) - np.searchsorted(grid_s, edge_s[:-1] + RESOLUTION_S)
    bare = (n_inside <= 0) & (np.diff(edge_s) > 2.0 * RESOLUTION_S)
    middle_s = 0.5 * (edge_s[1:] + edge_s[:-1])[bare]
    own_s = np.unique(np.concatenate([np.nextafter(break_s, -np.inf), break_s, middle_s]))
    return own_s[~np.isin(own_s, grid_s)]
