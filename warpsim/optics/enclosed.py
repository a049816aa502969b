"""Size of the image of a point: the box about it that encloses a given fraction of the light, pixels included."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from warpsim.optics.epsf_table import EpsfTable
from warpsim.optics.psf import Psf, PsfGaussian
from warpsim.optics.tables import TableAccuracy, epsf_table

_SQUARE_TAIL = 8.0 * math.sin(0.25 * math.pi)
"""Integral of 1 / r^3 outside a square, times half its side."""

STEP_PX = 1e-3
"""Half-widths are rounded up to it, so that they do not depend on the last bits of sums."""


@lru_cache(maxsize=64)
def box_half_width_px(
    psf: Psf, fraction: float, pixel_aspect: float = 1.0, accuracy: TableAccuracy | None = None
) -> float:
    """Half the width of the box about a point that holds a fraction of its light, as pixels collect it.

    The pattern is blurred by the pixel: the mean over all positions that a point may have in its pixel. The box is as
    high as it is wide, in widths of a pixel; even of a point without any blur it is about a pixel wide.

    Args:
        psf: Point spread function, lengths in pixel widths.
        fraction: Fraction of the light, in (0, 1).
        pixel_aspect: Height of a pixel over its width.
        accuracy: Of the table of an Airy pattern or an image: best that with which it is drawn, which then is at hand.

    Returns:
        Half-width [pixel widths], a multiple of 0.001.
    """
    if isinstance(psf, PsfGaussian):
        half_px = _of_gaussian(psf.sigma_px, fraction, pixel_aspect)
    else:
        accuracy = accuracy or TableAccuracy()
        half_px = _of_table(epsf_table(psf, pixel_aspect, accuracy.error, accuracy.n_point), fraction)
    return math.ceil(half_px / STEP_PX - 1e-6) * STEP_PX


def _of_gaussian(sigma_px: float, fraction: float, pixel_aspect: float) -> float:
    low, high = 0.0, 10.0 * sigma_px + max(pixel_aspect, 1.0)
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        enclosed = _within(middle, sigma_px, 1.0) * _within(middle, sigma_px, pixel_aspect)
        low, high = (middle, high) if enclosed < fraction else (low, middle)
    return high


def _within(half_px: float, sigma_px: float, pixel_px: float) -> float:
    """Part of a Gaussian blurred by a pixel of some width that lies within half_px of its centre, along one axis."""
    inner, outer = ((half_px + side * 0.5 * pixel_px) / sigma_px for side in (-1, 1))
    return 2.0 * sigma_px / pixel_px * (_integrated(outer) - _integrated(inner)) - 1.0


def _integrated(z: float) -> float:
    """Integral of the unit Gaussian's distribution function up to z."""
    below = 0.5 * math.erfc(-z * math.sqrt(0.5))
    return z * below + math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


def _of_table(table: EpsfTable, fraction: float) -> float:
    """Sum the nodes of a table of pixel fractions, each for its cell; beyond the table integrate its wing."""
    aspect = table.pixel_aspect
    axes = zip(table.fraction.shape, table.zero, table.per_px, strict=True)
    offset_px = [(np.arange(n_node) - zero) / per_px for n_node, zero, per_px in axes]
    inside = [np.abs(offset) < reach + 1e-9 for offset, reach in zip(offset_px, table.reach_px, strict=True)]
    if table.mirrored:
        inside = [kept & (offset >= 0) for kept, offset in zip(inside, offset_px, strict=True)]
    rows, columns = (offset[kept] for offset, kept in zip(offset_px, inside, strict=True))
    light = table.fraction[np.ix_(*inside)].astype(np.float64) / (table.per_px[0] * table.per_px[1])
    if table.mirrored:
        light *= np.where(rows > 0, 2.0, 1.0)[:, None] * np.where(columns > 0, 2.0, 1.0)
    # Distance of a cell's far side, as the box grows.
    down = (np.abs(rows) + 0.5 / table.per_px[0]) * aspect
    across = np.abs(columns) + 0.5 / table.per_px[1]
    distance = np.maximum(down[:, None], across).ravel()
    order = np.argsort(distance, kind="stable")
    enclosed = np.cumsum(light.ravel()[order])
    distance = distance[order]
    last = np.flatnonzero(np.diff(distance, append=np.inf) > 1e-12)  # cells of one distance come together
    enclosed, distance = np.maximum.accumulate(enclosed[last]), distance[last]
    if enclosed[-1] < fraction:
        return max(float(distance[-1]), _SQUARE_TAIL * table.wing.px3 / aspect / (1.0 - fraction))
    return float(np.interp(fraction, np.concatenate([[0.0], enclosed]), np.concatenate([[0.0], distance])))
