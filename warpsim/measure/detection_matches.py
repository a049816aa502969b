"""What detections may be assigned to: targets, clumps of targets, and what does not count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.measure.matching import F64, I64, Pairs, assign, near_pairs
from warpsim.measure.rows import column, flags, has_column, numbers

Flags = npt.NDArray[np.bool_]
Images = dict[tuple[Any, ...], int]
"""Numbers of images, by frame, sensor and band."""


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
