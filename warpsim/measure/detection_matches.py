"""Assignment of detections to targets, clumps of targets, and what does not count, image by image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.measure.rows import column, flags, has_column, numbers

Flags = npt.NDArray[np.bool_]
Images = dict[tuple[Any, ...], int]
"""Numbers of images, by frame, sensor and band."""


class Pairs(NamedTuple):
    """Pairs of points of one image that lie within the radius of each other."""

    left: I64
    """Row of the first point of each pair, (n,)."""
    right: I64
    distance_px: F64

    def where(self, chosen: npt.NDArray[np.bool_ | np.signedinteger]) -> Pairs:
        """Some of the pairs, by flags or numbers."""
        return Pairs(self.left[chosen], self.right[chosen], self.distance_px[chosen])


@dataclass(frozen=True)
class Outcome:
    """What became of each detection and each row of the truth."""

    target: I64
    """Row of the truth of each detection, -1 for none."""
    clump: I64
    """Clump of each detection that is of one as a whole, -1 for none."""
    is_false: Flags
    """Detections of nothing."""
    found: I64
    """Detection of each row of the truth, -1 for none."""
    merged: Flags
    """Rows of the truth without a detection whose clump has one."""


class Truth(NamedTuple):
    """Rows of the truth, (n_row,) each."""

    image: I64
    xy_px: F64
    """(n_row, 2), NaN where not known."""
    light_w_cm2: F64
    bright: Flags
    """With light and a position."""
    counts: Flags
    """To be found."""
    clump: I64
    """Clump of each row, -1 for what is alone or without light."""


@dataclass(frozen=True)
class Matches:
    """All detections, and everything that they may be assigned to."""

    truth: Truth
    target: Pairs
    """Detections and rows of the truth that count."""
    clump: Pairs
    """Detections and the centroids of the light of clumps."""
    neutral: Flags
    """Detections near what does not count."""

    def outcome(self, used: Flags) -> Outcome:
        """Assign some of the detections."""
        counts, clump_of = self.truth.counts, self.truth.clump
        n_clump = int(clump_of.max(initial=-1)) + 1
        target = assign(self.target.where(used[self.target.left]), len(used), len(counts))
        found = np.full(len(counts), -1, dtype=np.int64)
        found[target[target >= 0]] = np.flatnonzero(target >= 0)
        seen = np.zeros(n_clump + 1, dtype=bool)  # the last stands for none
        seen[clump_of[found >= 0]] = True
        free = used & (target < 0)
        clump = assign(self.clump.where(free[self.clump.left] & ~seen[self.clump.right]), len(used), n_clump)
        seen[clump[clump >= 0]] = True
        seen[-1] = False
        merged = counts & (found < 0) & seen[clump_of]
        return Outcome(target, clump, free & (clump < 0) & ~self.neutral, found, merged)


def find_matches(
    found: Any, truth: Any, radius_px: float, least_snr: float, ignore: Any | None
) -> tuple[Matches, Images]:
    """Find what lies within a radius of what, in the same image, and number the images; InputError as `detections`."""
    images, rows = _truth(truth, least_snr)
    image = _numbers_of(images, found, "found")
    xy_px = numbers(found, ("x_px", "y_px"), "found")
    chosen, other = np.flatnonzero(rows.counts), rows.bright & ~rows.counts
    target = near_pairs(image, xy_px, rows.image[chosen], rows.xy_px[chosen], radius_px)
    neutral = np.zeros(len(xy_px), dtype=bool)
    neutral[near_pairs(image, xy_px, rows.image[other], rows.xy_px[other], radius_px).left] = True
    if ignore is not None:
        neutral |= _near_ignored(ignore, images, image, xy_px, radius_px)
    clump = near_pairs(image, xy_px, *_centroids(rows), radius_px)
    return Matches(rows, Pairs(target.left, chosen[target.right], target.distance_px), clump, neutral), images


def _truth(table: Any, least_snr: float) -> tuple[Images, Truth]:
    """Rows of the truth, and the numbers of the images."""
    keys = _keys(table, "truth", ("frame", "sensor", "band"))
    if not keys:
        raise InputError("must have rows: one per target of each image that was searched", "truth")
    if has_column(table, "target"):
        first: dict[tuple[Any, ...], int] = {}
        for row, key in enumerate(_keys(table, "truth", ("frame", "sensor", "band", "target"))):
            if first.setdefault(key, row) != row:
                rule = f"must have each target of an image once, got {key[3]!r} of rows {first[key]} and {row} twice"
                raise InputError(rule, "truth")
    images = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    image = np.array([images[key] for key in keys], dtype=np.int64)
    names = ("x_px", "y_px", "irradiance_w_cm2", "snr")
    x_px, y_px, light, snr = (column(table, name, "truth").astype(np.float64) for name in names)
    bright = np.isfinite(x_px) & np.isfinite(y_px) & (light > 0.0)
    counts = bright & flags(table, "in_fov", "truth") & (snr >= least_snr)
    return images, Truth(image, np.stack([x_px, y_px], axis=1), light, bright, counts, _clumps(table, image, bright))


def _keys(table: Any, where: str, names: tuple[str, ...]) -> list[tuple[Any, ...]]:
    return list(zip(*(column(table, name, where).tolist() for name in names), strict=True))


def _numbers_of(images: Images, found: Any, where: str) -> I64:
    """Numbers of the images of detections."""
    keys = _keys(found, where, ("frame", "sensor", "band"))
    for row, key in enumerate(keys):
        if key not in images:
            frame, sensor, band = key
            raise InputError(f"frame {frame} of {sensor!r} in band {band!r} is not in the truth", where, row=row)
    return np.array([images[key] for key in keys], dtype=np.int64)


def _clumps(table: Any, image: I64, bright: Flags) -> I64:
    """Number the clumps of two targets with light or more; -1 for all else."""
    clump = np.full(len(image), -1, dtype=np.int64)
    if not has_column(table, "clump_id"):
        return clump
    named = column(table, "clump_id", "truth").astype(np.int64)
    inside = np.flatnonzero(bright & (named >= 0))
    pairs = np.stack([image[inside], named[inside]], axis=1)
    _, number, size = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    several = size[number] > 1
    clump[inside[several]] = np.unique(number[several], return_inverse=True)[1]
    return clump


def _centroids(truth: Truth) -> tuple[I64, F64]:
    """Images of clumps, (n,), and centroids of their light, (n, 2)."""
    inside = truth.clump >= 0
    clump, light = truth.clump[inside], truth.light_w_cm2[inside]
    total = np.bincount(clump, light)
    image = np.zeros(len(total), dtype=np.int64)
    image[clump] = truth.image[inside]
    sums = [np.bincount(clump, light * truth.xy_px[inside, axis]) for axis in (0, 1)]
    return image, np.stack(sums, axis=1) / total[:, None]


def _near_ignored(ignore: Any, images: Images, image: I64, xy_px: F64, radius_px: float) -> Flags:
    """Whether detections are near positions to ignore; those without a band are of all."""
    names = ("frame", "sensor", "band")[: 3 if has_column(ignore, "band") else 2]
    positions = numbers(ignore, ("x_px", "y_px"), "ignore")
    views: dict[tuple[Any, ...], int] = {}
    view = [views.setdefault(key[: len(names)], len(views)) for key in images]
    of_position = np.array([views.get(key, -1) for key in _keys(ignore, "ignore", names)], dtype=np.int64)
    there = of_position >= 0
    pairs = near_pairs(np.array(view)[image], xy_px, of_position[there], positions[there], radius_px)
    near = np.zeros(len(xy_px), dtype=bool)
    near[pairs.left] = True
    return near


def near_pairs(left_image: I64, left_px: F64, right_image: I64, right_px: F64, radius_px: float) -> Pairs:
    """Find all pairs of points of the same image that are no farther apart than a radius.

    Args:
        left_image: Numbers of the images, (n,).
        left_px: Finite positions, (n, 2).
        right_image: As `left_image`, (m,).
        right_px: As `left_px`, (m, 2).
        radius_px: Largest distance, included.
    """
    from scipy.spatial import KDTree

    if not (len(left_px) and len(right_px)):
        nothing = np.zeros(0, dtype=np.int64)
        return Pairs(nothing, nothing, np.zeros(0))
    apart = 4.0 * radius_px  # images are planes of one space, none within reach of another
    trees = [KDTree(np.c_[px, apart * image]) for image, px in ((left_image, left_px), (right_image, right_px))]
    found = trees[0].sparse_distance_matrix(trees[1], radius_px, output_type="ndarray")
    order = np.lexsort((found["j"], found["i"]))
    return Pairs(found["i"][order].astype(np.int64), found["j"][order].astype(np.int64), found["v"][order])


def assign(pairs: Pairs, n_left: int, n_right: int) -> I64:
    """Assign points one to one: as many as can be, and of these ways the one with the least sum of distances.

    Returns:
        For each left point the row of its right one, -1 for none, (n_left,).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    partner = np.full(n_left, -1, dtype=np.int64)
    if not len(pairs.left):
        return partner
    size = n_left + n_right
    graph = coo_array((np.ones(len(pairs.left)), (pairs.left, n_left + pairs.right)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    group = label[pairs.left]
    single = np.bincount(group)[group] == 1
    partner[pairs.left[single]] = pairs.right[single]
    order = np.flatnonzero(~single)
    order = order[np.argsort(group[order], kind="stable")]
    for rows in np.split(order, np.flatnonzero(np.diff(group[order])) + 1):
        _assign_group(pairs.where(rows), partner)
    return partner


def _assign_group(pairs: Pairs, partner: I64) -> None:
    """Assign the points of pairs that hang together."""
    from scipy.optimize import linear_sum_assignment

    if not len(pairs.left):
        return
    left, row = np.unique(pairs.left, return_inverse=True)
    right, col = np.unique(pairs.right, return_inverse=True)
    none = 1.0 + 2.0 * pairs.distance_px.max() * min(len(left), len(right))  # more than any assignment costs
    cost = np.full((len(left), len(right)), none)
    cost[row, col] = pairs.distance_px
    rows, cols = linear_sum_assignment(cost)
    taken = cost[rows, cols] < none
    partner[left[rows[taken]]] = right[cols[taken]]
