"""Close passes: scan times about them, dense enough that no direction turns far between two.

Two bodies that pass each other at 7 km/s and 1 km see each other's direction turn by half a circle within a second:
between the points of a scan at 10 s a window opens and closes, and no margin shows it. Here steps are divided until the
way between the bodies is a fraction of their distance in each. Along a straight pass at a distance b that means points
even in asinh(s / b), s counted from the closest approach [m], no more than REACH apart: about the approach the
direction turns by REACH [rad] at most from one to the next, farther out the points spread geometrically.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from warpsim.orbit.scan import RESOLUTION_S

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

REACH = 0.25
"""Most that the way between two bodies changes from one scan time to the next, over their distance."""

NEAREST_M = 0.01
"""Bodies nearer than that count as this far apart: tracks are good to millimetres, nearer they have no direction."""

_MOST_ROUNDS = 20


def pass_times_s(row: I64, time_s: F64, sight_m: F64, sight_at_m: Callable[[I64, F64], F64]) -> tuple[I64, F64]:
    """Return further scan times about close passes, each with the point that it follows; by point, then time.

    Args:
        row: Objects of the scan points, (n_point,).
        time_s: Times of the points, ascending for each object [s], (n_point,).
        sight_m: Vectors from the object to what it passes [m], (n_point, 3).
        sight_at_m: The same for pairs of object and time, (n,) and (n,) -> (n, 3).
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
