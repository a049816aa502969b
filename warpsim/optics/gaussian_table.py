"""Pixel fractions along one axis of a Gaussian, as tables over the offset of a pixel edge from the source.

Pixels next to each other stand next to each other, so that one vector load brings those of a whole stamp. Where the
Gaussian is much sharper than a pixel, fractions change only while an edge passes the source, and the table ends there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.canvas import mask_table
from warpsim_kernels.deposit_gaussian import GAUSSIAN_SIMD_WIDTH, EdgeTable, GaussianPsf

F64 = npt.NDArray[np.float64]

STEPS_PER_SIGMA = 64
"""Cubic interpolation errs by 0.013 / 64^4 = 8e-10 of the light, and far out, at z sigma, by 0.023 (z / 64)^4 of what
is there: 6e-6 at z = 8.2."""
MOST_SIGMA = 8.5
"""Stamps end before: 1e-15 of the light lies beyond 8 sigma."""
LEAST_FRACTION = 1e-25
"""Smaller ones are zero: products of such numbers are slow on CPUs."""
LEAST_STEPS = 4
"""Per pixel, for the widest Gaussians."""


@lru_cache(maxsize=64)
def axis_table(sigma_px: float) -> tuple[npt.NDArray[np.float32], int, int, int]:
    """Pixel fractions, by offset of the edge nearest to the source, and how to read them.

    Args:
        sigma_px: Standard deviation [px].

    Returns:
        Fractions (2 n_step + 4, n_pixel), read-only; the row of the offset k / per_px is n_step + 1 + k, and the pixel
        after the edge is n_pixel / 2. Then n_step, per_px, n_pixel.
    """
    per_px = max(math.ceil(STEPS_PER_SIGMA / sigma_px), LEAST_STEPS)
    n_step = math.ceil(min(0.5, (MOST_SIGMA + 0.5) * sigma_px) * per_px)
    half = math.ceil(MOST_SIGMA * sigma_px) + 2
    offset_px = np.arange(-n_step - 1, n_step + 3) / per_px
    edge = (offset_px[:, None] + np.arange(-half, half + 1)) / sigma_px
    tail = _tail(np.abs(edge))
    low, high = edge[:, :-1], edge[:, 1:]
    between = np.where(low * high > 0.0, np.abs(tail[:, 1:] - tail[:, :-1]), 1.0 - tail[:, 1:] - tail[:, :-1])
    fraction = np.where(between < LEAST_FRACTION, 0.0, between).astype(np.float32)
    fraction.setflags(write=False)
    return fraction, n_step, per_px, 2 * half


def _tail(z: F64) -> F64:
    """Part of a unit Gaussian beyond z standard deviations."""
    tail = np.zeros_like(z)
    near = z < 12.0
    tail[near] = [0.5 * math.erfc(value) for value in z[near] * math.sqrt(0.5)]
    return tail


def upload_gaussians(sigmas_px: Sequence[tuple[float, float]], device: Any) -> tuple[wp.array, wp.array]:
    """Put tables on a device.

    Args:
        sigmas_px: Of each band, along columns [pixel widths] and along rows [pixel heights].
        device: Where they are put.

    Returns:
        The bands' structs (GaussianPsf), shape (n_band,), and the flat array of mask_table and fractions, float32.
    """
    # The mask is a margin, too: vectors may begin before a table and end behind it.
    mask = np.array(mask_table(GAUSSIAN_SIMD_WIDTH), dtype=np.float32)
    starts, parts, n = {}, [mask], len(mask)
    for sigma_px in sorted({sigma for pair in sigmas_px for sigma in pair}):
        fraction = axis_table(sigma_px)[0]
        starts[sigma_px] = n
        parts.append(fraction.ravel())
        n += fraction.size
    flat = wp.array(np.concatenate([*parts, mask]), dtype=wp.float32, device=device)
    structs = []
    for pair in sigmas_px:
        psf: Any = GaussianPsf()
        psf.sigma_px = wp.vec2(*pair)
        psf.columns, psf.rows = (_edge_table(sigma_px, starts[sigma_px]) for sigma_px in pair)
        structs.append(psf)
    return wp.array(structs, dtype=GaussianPsf, device=device), flat


def _edge_table(sigma_px: float, start: int) -> Any:
    _, n_step, per_px, n_pixel = axis_table(sigma_px)
    table: Any = EdgeTable()
    table.start = start + (n_step + 1) * n_pixel + n_pixel // 2
    table.n_pixel = n_pixel
    table.n_step = n_step
    table.per_px = per_px
    return table
