"""Counts as grey for people: linear about the noise, logarithmic above, large images reduced by the brightest pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from warpsim.detector.levels import Levels

CEILING_NEI = 60.0
"""Drawn white."""
MARGIN_PX = 8.0
"""Of sky about targets, where only a part of an image is shown."""
SOFTENING_NEI = 2.0
"""The grey scale is linear below, logarithmic above: asinh(x / softening)."""


def grey(
    counts: npt.NDArray[np.uint16], levels: Levels, most_px: int, ceiling_nei: float = CEILING_NEI
) -> npt.NDArray[np.uint8]:
    """An image in grey: black is blank sky, white ceiling_nei.

    Args:
        counts: Shape (row, column).
        levels: What the counts mean.
        most_px: A larger image is reduced to at most so many pixels a side, by the brightest of each block of pixels,
            so that no point source is lost.
        ceiling_nei: Light that is drawn white.
    """
    level = (counts.astype(np.float32) - levels.blank_counts) / levels.counts_per_nei
    block = -(-max(level.shape) // most_px)
    if block > 1:
        rows, columns = (n * block for n in grey_shape(level.shape, most_px))
        padded = np.full((rows, columns), -np.inf, dtype=np.float32)
        padded[: level.shape[0], : level.shape[1]] = level
        level = padded.reshape(rows // block, block, columns // block, block).max(axis=(1, 3))
    shade = np.arcsinh(np.maximum(level, 0) / SOFTENING_NEI) / np.arcsinh(ceiling_nei / SOFTENING_NEI)
    return np.asarray(np.minimum(shade, 1) * 255, dtype=np.uint8)


def window_about(xy_px: npt.ArrayLike, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the square part of an image that holds some points and sky about them; all for none.

    Args:
        xy_px: Columns and rows, shape (n, 2); those outside the image do not count.
        shape: Rows and columns of the image.
    """
    points = np.asarray(xy_px, dtype=np.float64).reshape(-1, 2)
    points = points[((points > -0.5) & (points < np.array(shape[::-1]) - 0.5)).all(axis=1)]
    if not len(points):
        return slice(0, shape[0]), slice(0, shape[1])
    low, high = points.min(axis=0), points.max(axis=0)
    half = (high - low).max() / 2 + MARGIN_PX
    first = np.maximum(np.floor((low + high) / 2 - half).astype(int), 0)
    end = np.minimum(np.ceil((low + high) / 2 + half).astype(int) + 1, shape[::-1])
    return slice(int(first[1]), int(end[1])), slice(int(first[0]), int(end[0]))


def grey_shape(shape: tuple[int, ...], most_px: int) -> tuple[int, int]:
    """Rows and columns of an image in grey."""
    block = -(-max(shape) // most_px)
    n_row, n_col = (-(-n // block) for n in shape)
    return n_row, n_col
