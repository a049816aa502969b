"""Numbers of stars: by magnitude, by in-band irradiance where a band has no zero point, and at most in a cone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64, I64
from warpsim.radiometry.band import Band
from warpsim.sky.catalog import StarCatalog

Counts = tuple[I64, I64]

# A magnitude of 3 exactly belongs to 3, and 1e-16 W/cm2 to its own decade, whatever the rounding of a flux.
_ROUNDING = 1e-9

_FINEST_DEX = 0.05
"""Narrowest bins of irradiance in which counts of stars are compared."""

CELLS_OF_RADIUS = 6
"""Cells along the radius of a cone; more of them come closer to the true number."""

MOST_ZONES = 540
"""Declination zones at most, of 1/3 degree: 0.6 million cells, which takes 0.05 s."""

_EQUATORIAL_RAD = 0.616
"""Above arcsin(3**-0.5): the smallest component of a unit vector is no larger than 3**-0.5."""

_SLACK_RAD = 1e-6
"""More than the rounding of directions and of cell borders."""


def magnitude_counts(catalog: StarCatalog, band: Band | str) -> Counts:
    """Return whole magnitudes without gaps, and the number of stars with light from each to below the next."""
    return _counts(catalog.magnitude(band))


def irradiance_counts(catalog: StarCatalog, band: Band | str) -> Counts:
    """Return decades k of in-band irradiance without gaps, and the number of stars from 10^k up to 10^(k+1) W/cm2."""
    with np.errstate(divide="ignore"):
        return _counts(np.log10(catalog.irradiance_w_cm2(band)))


def complete_to(irradiance: F64) -> float:
    """Return the irradiance down to which stars are complete: that of the faintest in the fullest bin of its logarithm.

    Stars become ever more numerous as they fade; where a catalog's do not, it misses some. Bins follow Freedman and
    Diaconis (1981), and are no narrower than 0.05 dex. NaN where no star has light.
    """
    light = irradiance[irradiance > 0.0]
    if not light.size:
        return math.nan
    dex = np.log10(light)
    quartile = np.percentile(dex, [25.0, 75.0])
    width = max(_FINEST_DEX, 2.0 * float(quartile[1] - quartile[0]) / len(dex) ** (1 / 3))
    number = np.floor(dex / width + _ROUNDING)
    bins, counts = np.unique(number, return_counts=True)
    return float(light[number == bins[np.argmax(counts)]].min())


def _counts(values: F64) -> Counts:
    whole = np.floor(values[np.isfinite(values)] + _ROUNDING).astype(np.int64)
    if not len(whole):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    return np.arange(whole.min(), whole.max() + 1), np.bincount(whole - whole.min())


def most_stars_in_cone(direction_icrs: NDArray[np.floating], radius_rad: float) -> int:
    """Return an upper bound of the stars in any cone of a radius, of directions (n_star, 3) of any length.

    The sky is cut into declination zones and columns of right ascension. A cone about a point of a cell lies within the
    zones and columns about that cell that are counted together, and the bound is the largest of these counts. As they
    are far too wide near poles, each of the three axes serves as the pole in turn, for the cells about its equator:
    every point is there for one of them. The bound is about twice the largest number that there is, and at most four
    times.
    """
    n_star, radius = len(direction_icrs), radius_rad + _SLACK_RAD
    if n_star == 0 or radius >= np.pi / 2:
        return n_star
    direction = np.asarray(direction_icrs, dtype=np.float64)
    return max(_most_near_equator(np.roll(direction, axis, axis=1), radius) for axis in range(3))


def _most_near_equator(direction: F64, radius: float) -> int:
    """The bound for cones about points from which the equator is no farther than _EQUATORIAL_RAD."""
    n_zone = min(int(np.ceil(CELLS_OF_RADIUS * np.pi / radius)), MOST_ZONES)
    n_column, step = 2 * n_zone, np.pi / n_zone  # a column is as wide as a zone is high, at the equator
    counts = _cell_counts(direction, n_zone, n_column)
    edges = np.abs(np.arange(n_zone + 1) * step - np.pi / 2)
    (zone,) = np.nonzero(np.minimum(edges[1:], edges[:-1]) <= _EQUATORIAL_RAD)
    reach = int(np.ceil(radius / step))
    below = np.concatenate([np.zeros((1, n_column), dtype=np.int64), np.cumsum(counts, axis=0)])
    about = below[np.minimum(zone + reach + 1, n_zone)] - below[np.maximum(zone - reach, 0)]
    half_width = _half_width_rad(np.maximum(edges[1:], edges[:-1])[zone], radius)
    n_wide = np.minimum(2 * np.ceil(half_width / step).astype(np.int64) + 1, n_column)
    return max(_most_in_window(row, int(n)) for row, n in zip(about, n_wide, strict=True))


def _cell_counts(direction: F64, n_zone: int, n_column: int) -> I64:
    """Stars of each cell, shape (n_zone, n_column)."""
    declination = np.arctan2(direction[:, 2], np.hypot(direction[:, 0], direction[:, 1]))
    right_ascension = np.arctan2(direction[:, 1], direction[:, 0]) % (2 * np.pi)
    zone = np.clip((declination / np.pi + 0.5) * n_zone, 0, n_zone - 1).astype(np.int64)
    column = (right_ascension * (n_column / (2 * np.pi))).astype(np.int64) % n_column
    return np.bincount(zone * n_column + column, minlength=n_zone * n_column).reshape(n_zone, n_column)


def _half_width_rad(declination: F64, radius: float) -> F64:
    """Half-width in right ascension of a cone about a declination from 0 to pi / 2; pi where a pole is in it."""
    has_pole = declination + radius >= np.pi / 2
    cosine = np.where(has_pole, 1.0, np.cos(declination))
    return np.where(has_pole, np.pi, np.arcsin(np.minimum(np.sin(radius) / cosine, 1.0)))


def _most_in_window(row: I64, n_wide: int) -> int:
    """Largest sum of neighbours of a ring."""
    before = np.concatenate([[0], np.cumsum(np.concatenate([row, row[: n_wide - 1]]))])
    return int((before[n_wide:] - before[:-n_wide]).max())
