"""Intervals in which a signed margin is >= 0, for many objects at once: a scan, a search of extrema, bisection.

A scan has a grid of times for all objects, and individual times between. Windows and gaps shorter than a step of it are
found where the shape of the margin shows them: local extrema that could cross zero between scan points are searched
out. What no scan point shows is for the scan to have points at: jumps (`break_times_s`) and close passes
(`pass_times_s`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64, I64
from warpsim.errors import InputError

Mask = NDArray[np.bool_]

PairFunction = Callable[[I64, F64], F64]
"""object (n,), time_s (n,) -> margin (n,)."""
PointFunction = Callable[[I64], F64]
"""number of the scan point (n,) -> margin (n,)."""

_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

RESOLUTION_S = 1e-3
"""Ends of intervals are good to this. Scan times no farther apart are the two sides of a jump."""

MOST_SCAN_TIMES = 5_000_000
"""Times of a scan."""

REACH = 0.25
"""Most that the way between two bodies changes from one scan time to the next, over their distance."""

NEAREST_M = 0.01
"""Bodies nearer than that count as this far apart: tracks are good to millimetres, nearer they have no direction."""

_MOST_ROUNDS = 20


def scan_times_s(duration_s: float, step_s: float) -> F64:
    """Return uniform times from 0 to duration_s [s], at least three, no farther apart than step_s."""
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
        """Points within intervals, and of two grid steps around; which are the first and last of an unbroken run."""
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

    The new motion holds from a breakpoint on. Between two breakpoints, and between them and the ends, there are three
    points at least: enough to show an extremum.
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


def pass_times_s(row: I64, time_s: F64, sight_m: F64, sight_at_m: Callable[[I64, F64], F64]) -> tuple[I64, F64]:
    """Return further scan times about close passes, each with the point that it follows; by point, then time.

    Two bodies that pass each other at 7 km/s and 1 km see each other's direction turn by half a circle within a second:
    between the points of a scan at 10 s a window opens and closes, and no margin shows it. Here steps are divided until
    the way between the bodies is a fraction of their distance in each. Along a straight pass at a distance b that means
    points even in asinh(s / b), s counted from the closest approach [m], no more than REACH apart: about the approach
    the direction turns by REACH [rad] at most from one to the next, farther out the points spread geometrically.
    """
    point = _near(row, time_s, sight_m)
    ends_s = np.stack([time_s[point], time_s[point + 1]], axis=1)
    ends_m = np.stack([sight_m[point], sight_m[point + 1]], axis=1)
    points, times = [np.empty(0, np.int64)], [np.empty(0)]
    # A step is taken for straight; its curvature shows in its parts, which are divided further.
    for _ in range(_MOST_ROUNDS):
        step, part, n_part, corner_s = _parts(ends_s, ends_m)
        inner = (part > 0) & (part < n_part)
        if not inner.any():
            break
        points.append(point[step[inner]])
        times.append(corner_s[inner])
        corner_m = ends_m[step, (part > 0).astype(np.int64)]
        corner_m[inner] = sight_at_m(row[points[-1]], times[-1])
        start = np.flatnonzero(part < n_part)
        point = point[step[start]]
        ends_s = np.stack([corner_s[start], corner_s[start + 1]], axis=1)
        ends_m = np.stack([corner_m[start], corner_m[start + 1]], axis=1)
    found, found_s = np.concatenate(points), np.concatenate(times)
    order = np.lexsort((found_s, found))
    return found[order], found_s[order]


def _near(row: I64, time_s: F64, sight_m: F64) -> I64:
    """Points before steps that may be long for the distance, (n,): nothing is lost where the way is straight."""
    square = np.einsum("ij,ij->i", sight_m, sight_m)
    way = np.diff(sight_m, axis=0)
    ratio = REACH / (1.0 + 0.5 * REACH)  # the way's middle is nearer than its ends by half of it at most
    near = np.einsum("ij,ij->i", way, way) > ratio**2 * np.minimum(square[1:], square[:-1])
    point = np.flatnonzero(near)
    return np.asarray(point[(row[point] == row[point + 1]) & (time_s[point + 1] - time_s[point] > RESOLUTION_S)])


def _parts(ends_s: F64, ends_m: F64) -> tuple[I64, I64, I64, F64]:
    """Corners of the parts of straight steps, (n_corner,) each: number of the step and of the corner, parts, time [s].

    Steps in one part are left out, and so are the shortest.
    """
    way_m = ends_m[:, 1] - ends_m[:, 0]
    length_m, length_s = np.linalg.norm(way_m, axis=1), ends_s[:, 1] - ends_s[:, 0]
    step = np.flatnonzero((length_m > 0.0) & (length_s > RESOLUTION_S))
    way_m, length_m, length_s, start_m = way_m[step], length_m[step], length_s[step], ends_m[step, 0]
    first_m = np.einsum("ij,ij->i", start_m, way_m) / length_m  # along the way, from the closest approach
    closest_m = np.linalg.norm(start_m - (first_m / length_m)[:, None] * way_m, axis=1)
    closest_m = np.maximum(closest_m, np.maximum(RESOLUTION_S * length_m / length_s, NEAREST_M))
    first, last = np.arcsinh(first_m / closest_m), np.arcsinh((first_m + length_m) / closest_m)
    n_part = np.ceil((last - first) / REACH - 1e-9).astype(np.int64)
    kept = n_part > 1
    step, n_part = step[kept], n_part[kept]
    count = n_part + 1
    of = np.repeat(np.flatnonzero(kept), count)
    part = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    step, n_part = np.repeat(step, count), np.repeat(n_part, count)
    along_m = closest_m[of] * np.sinh(first[of] + (last - first)[of] * part / n_part) - first_m[of]
    corner_s = ends_s[step, 0] + length_s[of] * along_m / length_m[of]
    corner_s = np.where(part == 0, ends_s[step, 0], np.where(part == n_part, ends_s[step, 1], corner_s))
    return step, part, n_part, corner_s


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
    row = np.concatenate([np.empty(0, np.int64), *(one.row for one in some)] * 2)
    time_s = np.concatenate([np.empty(0), *(one.start_s for one in some), *(one.end_s for one in some)])
    step = np.repeat([1, -1], len(row) // 2)
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
