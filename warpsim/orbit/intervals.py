"""Intervals in which a signed margin is >= 0, for many objects at once: a scan, a search of extrema, bisection.

Windows and gaps shorter than a step of the scan are found where the shape of the margin shows them: local extrema that
could cross zero between scan points are searched out. What no scan point shows is for the scan to have points at:
jumps (`scan.break_times_s`) and close passes (`scan.pass_times_s`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpsim.orbit.scan import RESOLUTION_S, Scan

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Mask = NDArray[np.bool_]

PairFunction = Callable[[I64, F64], F64]
"""object (n,), time_s (n,) -> margin (n,)."""
PointFunction = Callable[[I64], F64]
"""number of the scan point (n,) -> margin (n,)."""

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True, eq=False)
class Intervals:
    """Closed intervals of time, those of each object apart from each other; by object, then time."""

    row: I64
    """Number of the object, (n,)."""
    start_s: F64
    end_s: F64

    @classmethod
    def whole(cls, n_row: int, start_s: float, end_s: float) -> Intervals:
        """One interval for each of n_row objects."""
        return cls(np.arange(n_row), np.full(n_row, float(start_s)), np.full(n_row, float(end_s)))

    def intersection(self, other: Intervals) -> Intervals:
        """Return the intersection with others."""
        return _where_many([self, other], 2)

    @classmethod
    def union(cls, some: Sequence[Intervals]) -> Intervals:
        """Return the union of some."""
        return _where_many(some, 1)


def _where_many(some: Sequence[Intervals], least: int) -> Intervals:
    """Intervals in which at least so many hold; those of each do not overlap."""
    start_row, end_row = (np.concatenate([np.empty(0, np.int64), *(one.row for one in some)]) for _ in range(2))
    start_s = np.concatenate([np.empty(0), *(one.start_s for one in some)])
    end_s = np.concatenate([np.empty(0), *(one.end_s for one in some)])
    row, time_s = np.concatenate([start_row, end_row]), np.concatenate([start_s, end_s])
    step = np.repeat([1, -1], len(start_row))
    order = np.lexsort((-step, time_s, row))  # at one time, beginnings before ends
    row, time_s, step = row[order], time_s[order], step[order]
    count = np.cumsum(step)
    begins = (count == least) & (step == 1)
    ends = (count == least - 1) & (step == -1)
    return Intervals(row[begins], time_s[begins], time_s[ends])


def find_intervals(at: PairFunction, at_point: PointFunction, scan: Scan, within: Intervals) -> Intervals:
    """Return the intervals in which the margin is >= 0; nothing but `within`, and two steps around, is evaluated."""
    point, first, last = scan.points_within(within.row, within.start_s, within.end_s)
    if len(point) == 0:
        return Intervals(point, np.empty(0), np.empty(0))
    row, time_s, margin = scan.row[point], scan.time_s[point], at_point(point)
    inside = margin >= 0.0
    change = np.flatnonzero((inside[1:] != inside[:-1]) & ~last[:-1])
    low, high, rises = time_s[change], time_s[change + 1], inside[change + 1]
    before, extreme_s, up = _extrema(margin, row, time_s, first, last, at)
    # An extremum beyond zero parts its cell of the scan in two, each with a change.
    bracket_row = np.concatenate([row[change], row[before], row[before]])
    low, high = np.concatenate([low, time_s[before], extreme_s]), np.concatenate([high, extreme_s, time_s[before + 1]])
    rises = np.concatenate([rises, up, ~up])
    edge_s = _bisected(bracket_row, low, high, rises, at)
    begins, ends = first & inside, last & inside
    start_row = np.concatenate([row[begins], bracket_row[rises]])
    start_s = np.concatenate([time_s[begins], edge_s[rises]])
    end_row = np.concatenate([row[ends], bracket_row[~rises]])
    end_s = np.concatenate([time_s[ends], edge_s[~rises]])
    starts, stops = np.lexsort((start_s, start_row)), np.lexsort((end_s, end_row))
    return Intervals(start_row[starts], start_s[starts], end_s[stops]).intersection(within)


def _bisected(row: I64, low: F64, high: F64, rises: Mask, at: PairFunction) -> F64:
    """The times of the changes of sign, on the side inside: every instant reported satisfies the constraint."""
    while len(low) and np.max(high - low) > RESOLUTION_S:
        middle = 0.5 * (low + high)
        below = (at(row, middle) >= 0.0) == rises  # the change lies below the middle
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return np.where(rises, high, low)


def _extrema(margin: F64, row: I64, time_s: F64, first: Mask, last: Mask, at: PairFunction) -> tuple[I64, F64, Mask]:
    """Search out extrema that cross zero between scan points: scan point before, time, and whether it is a maximum.

    Maxima below zero and minima above it are candidates when the margin, changing twice as fast as around them, could
    reach zero within a step. Runs of points end at jumps; at an end, the two steps before it are those around it.
    """
    step_s = np.diff(time_s)
    jump = step_s <= RESOLUTION_S
    first, last = first | np.append(False, jump), last | np.append(jump, False)
    number = np.arange(len(margin))
    left, right = number - ~first, number + ~last
    sign = np.where(margin < 0.0, 1.0, -1.0)  # +1: looking for a maximum
    peak = (sign * (margin - margin[left]) >= 0.0) & (sign * (margin - margin[right]) >= 0.0)
    point = np.flatnonzero(peak & ~(first & last))
    slope = np.where(last[:-1], 0.0, np.abs(np.diff(margin)) / np.maximum(step_s, RESOLUTION_S))
    slope = np.concatenate([[0.0], slope, [0.0, 0.0]])  # of the step before each point
    before, after = slope[point + 2 * first[point]], slope[point + 1 - 2 * last[point]]
    left, right, sign = left[point], right[point], sign[point]
    reach = 2.0 * np.maximum(before, after) * np.maximum(time_s[point] - time_s[left], time_s[right] - time_s[point])
    kept = (np.abs(margin[point]) <= reach) & (reach > 0.0)
    point, left, right, sign = point[kept], left[kept], right[kept], sign[kept]
    crossed_s = _crossing(row[point], time_s[left], time_s[right], sign, at)
    found = np.isfinite(crossed_s)
    point, crossed_s, sign = point[found], crossed_s[found], sign[found]
    point = point - (crossed_s < time_s[point])
    point, unique = np.unique(point, return_index=True)  # equal neighbours find the same extremum
    return point, crossed_s[unique], sign[unique] > 0.0


def _crossing(row: I64, low: F64, high: F64, sign: F64, at: PairFunction) -> F64:
    """A time between low and high at which the margin is beyond zero; NaN where its extremum is not."""
    crossed_s = np.full(len(row), np.nan)
    if len(row) == 0:
        return crossed_s

    def beyond(t: F64) -> tuple[F64, Mask]:
        value = at(row, t)
        return sign * value, np.where(sign > 0.0, value >= 0.0, value < 0.0)

    # Golden section, all candidates side by side; those that crossed, or never will, drop out.
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, hit_left = beyond(left)
    at_right, hit_right = beyond(right)
    active = np.arange(len(row))
    crossed_s[hit_right] = right[hit_right]
    crossed_s[hit_left] = left[hit_left]
    while True:
        keep = np.isnan(crossed_s[active]) & (high - low > 0.1 * RESOLUTION_S)
        active, row, sign = active[keep], row[keep], sign[keep]
        low, high, left, right = low[keep], high[keep], left[keep], right[keep]
        at_left, at_right = at_left[keep], at_right[keep]
        if len(active) == 0:
            return crossed_s
        go_left = at_left >= at_right
        low, high = np.where(go_left, low, left), np.where(go_left, right, high)
        probe = np.where(go_left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        value, hit = beyond(probe)
        crossed_s[active[hit]] = probe[hit]
        left, right = np.where(go_left, probe, right), np.where(go_left, left, probe)
        at_left, at_right = np.where(go_left, value, at_right), np.where(go_left, at_left, value)
