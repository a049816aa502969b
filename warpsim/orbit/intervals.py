"""Intervals in which a signed margin is >= 0, for many objects at once: a scan, a search of extrema, bisection.

Windows and gaps shorter than a step of the scan are found where the margin's course shows them: local extrema that
could cross zero between scan points are searched out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

RESOLUTION_S = 1e-3
"""Ends are good to this, and lie inside."""

PairFunction = Callable[[I64, F64], F64]
"""object (n,), time_s (n,) -> margin (n,)."""
NodeFunction = Callable[[I64, I64], F64]
"""object (n,), number of the scan time (n,) -> margin (n,)."""

MOST_SCAN_TIMES = 5_000_000
"""Times of a scan."""

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

    def shared(self, other: Intervals) -> Intervals:
        """Where both hold."""
        n = len(self.row) + len(other.row)
        row = np.concatenate([self.row, other.row, self.row, other.row])
        time_s = np.concatenate([self.start_s, other.start_s, self.end_s, other.end_s])
        step = np.repeat([1, -1], n)
        order = np.lexsort((-step, time_s, row))  # at one time, beginnings before ends
        row, time_s, step = row[order], time_s[order], step[order]
        count = np.cumsum(step)
        begins = (count == 2) & (step == 1)
        ends = (count == 1) & (step == -1)
        return Intervals(row[begins], time_s[begins], time_s[ends])


def scan_times_s(duration_s: float, step_s: float) -> F64:
    """Return uniform times from 0 to duration_s [s], at least three, no farther apart than step_s.

    Raises:
        InputError: A length is not a number > 0, or there are more than MOST_SCAN_TIMES steps.
    """
    for name, value in (("duration_s", duration_s), ("step_s", step_s)):
        if not (isinstance(value, Real) and math.isfinite(value) and value > 0):
            raise InputError(f"{name}: must be a number > 0, got {value!r}")
    if duration_s / step_s > MOST_SCAN_TIMES:
        raise InputError(f"step_s: must be >= {duration_s / MOST_SCAN_TIMES:.2g} for {duration_s:g} s, got {step_s:g}")
    return np.linspace(0.0, duration_s, max(3, int(np.ceil(duration_s / step_s)) + 1))


def find_intervals(at: PairFunction, at_node: NodeFunction, time_s: F64, within: Intervals) -> Intervals:
    """Return where the margin is >= 0, as far as `within` reaches.

    Args:
        at: The margin; objects come in any order.
        at_node: The same at scan times, of which much may be known beforehand.
        time_s: Scan times, uniform and at least three, (n_time,).
        within: Where to look, inside the scan times: nothing else is evaluated, but for two steps around.
    """
    row, node, first, last = _scan_points(time_s, within)
    if len(row) == 0:
        return Intervals(row, np.empty(0), np.empty(0))
    margin = at_node(row, node)
    inside = margin >= 0.0
    change = np.flatnonzero((inside[1:] != inside[:-1]) & ~last[:-1])
    low, high, rises = time_s[node[change]], time_s[node[change + 1]], inside[change + 1]
    point, extreme_s, up = _extrema(margin, time_s, row, node, first, last, at)
    # An extremum beyond zero parts its cell of the scan in two, each with a change.
    left, right = time_s[node[point]], time_s[node[point + 1]]
    bracket_row = np.concatenate([row[change], row[point], row[point]])
    low, high = np.concatenate([low, left, extreme_s]), np.concatenate([high, extreme_s, right])
    rises = np.concatenate([rises, up, ~up])
    edge_s = _bisected(bracket_row, low, high, rises, at)
    begins, ends = first & inside, last & inside
    start_row = np.concatenate([row[begins], bracket_row[rises]])
    start_s = np.concatenate([time_s[node[begins]], edge_s[rises]])
    end_row = np.concatenate([row[ends], bracket_row[~rises]])
    end_s = np.concatenate([time_s[node[ends]], edge_s[~rises]])
    starts, stops = np.lexsort((start_s, start_row)), np.lexsort((end_s, end_row))
    return Intervals(start_row[starts], start_s[starts], end_s[stops]).shared(within)


def _scan_points(time_s: F64, within: Intervals) -> tuple[I64, I64, NDArray[np.bool_], NDArray[np.bool_]]:
    """Objects and numbers of scan times within or two steps around; which are the first and last of an unbroken run."""
    step_s, n_time = (time_s[-1] - time_s[0]) / (len(time_s) - 1), len(time_s)
    low = np.clip(np.floor((within.start_s - time_s[0]) / step_s).astype(np.int64) - 2, 0, n_time - 1)
    high = np.clip(np.ceil((within.end_s - time_s[0]) / step_s).astype(np.int64) + 2, 0, n_time - 1)
    apart = (within.row[1:] != within.row[:-1]) | (low[1:] > high[:-1] + 1)
    head = np.flatnonzero(np.concatenate([[True], apart])) if len(low) else np.empty(0, np.int64)
    tail = np.flatnonzero(np.concatenate([apart, [True]])) if len(low) else head
    low, high = low[head], high[tail]
    length = high - low + 1
    end = np.cumsum(length)
    n_point = int(end[-1]) if len(end) else 0
    row = np.repeat(within.row[head], length)
    node = np.arange(n_point) - np.repeat(end - length - low, length)
    first, last = np.zeros(n_point, bool), np.zeros(n_point, bool)
    first[end - length], last[end - 1] = True, True
    return row, node, first, last


def _bisected(row: I64, low: F64, high: F64, rises: NDArray[np.bool_], at: PairFunction) -> F64:
    """The times of the changes of sign, on the side inside: every instant reported keeps the rule."""
    while len(low) and np.max(high - low) > RESOLUTION_S:
        middle = 0.5 * (low + high)
        below = (at(row, middle) >= 0.0) == rises  # the change lies below the middle
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return np.where(rises, high, low)


def _extrema(
    margin: F64,
    time_s: F64,
    row: I64,
    node: I64,
    first: NDArray[np.bool_],
    last: NDArray[np.bool_],
    at: PairFunction,
) -> tuple[I64, F64, NDArray[np.bool_]]:
    """Search out extrema that cross zero between scan points: scan point before, time, and whether it is a maximum.

    Maxima below zero and minima above it are candidates when the margin, changing twice as fast as around them, could
    reach zero within a step.
    """
    before = np.concatenate([margin[:1], margin[:-1]])
    after = np.concatenate([margin[1:], margin[-1:]])
    before[first], after[last] = after[first], before[last]  # ends are mirrored
    sign = np.where(margin < 0.0, 1.0, -1.0)  # +1: looking for a maximum
    peak = (sign * margin >= sign * before) & (sign * margin >= sign * after)
    reach = 2.0 * np.maximum(np.abs(margin - before), np.abs(margin - after))
    point = np.flatnonzero(peak & (np.abs(margin) <= reach) & (reach > 0.0))
    low, high = time_s[node[point] - ~first[point]], time_s[node[point] + ~last[point]]
    crossed_s = _crossing(row[point], low, high, sign[point], at)
    found = np.isfinite(crossed_s)
    point, crossed_s = point[found], crossed_s[found]
    point = point - (crossed_s < time_s[node[point]])
    point, unique = np.unique(point, return_index=True)  # equal neighbours find the same extremum
    return point, crossed_s[unique], sign[point] > 0.0


def _crossing(row: I64, low: F64, high: F64, sign: F64, at: PairFunction) -> F64:
    """A time between low and high at which the margin is beyond zero; NaN where its extremum is not."""
    crossed_s = np.full(len(row), np.nan)
    if len(row) == 0:
        return crossed_s

    def beyond(t: F64) -> tuple[F64, NDArray[np.bool_]]:
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
