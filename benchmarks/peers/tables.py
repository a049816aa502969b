"""Tables of what falls into each pixel of a stamp, by the position of the source within its pixel."""

from __future__ import annotations

import functools

import numpy as np
from scipy.special import j1, ndtr

from benchmarks.peers.work import AIRY_RADIUS_PX, SIGMA_PX

GAUSSIAN_HALF_PX = 4
"""Stamps of 9 x 9 pixels hold what lies within 5 sigma."""
AIRY_HALF_PX = 15
"""Stamps of 31 x 31 pixels leave out 1.5 % of the light."""

_FIRST_DARK_RING = 1.2196698912665045


@functools.cache
def gaussian_table(n_phase: int = 1024, half_px: int = GAUSSIAN_HALF_PX) -> np.ndarray:
    """Pixel fractions of an axis, (n_phase + 1, 2 half_px + 1), for sources from -0.5 to 0.5 px off centre."""
    offset = np.linspace(-0.5, 0.5, n_phase + 1)[:, None]
    edges = np.arange(-half_px, half_px + 2) - 0.5
    return np.ascontiguousarray(np.diff(ndtr((edges - offset) / SIGMA_PX), axis=1), dtype=np.float32)


@functools.cache
def airy_table(n_phase: int = 32, half_px: int = AIRY_HALF_PX, n_node: int = 3) -> np.ndarray:
    """Pixel fractions of a stamp, (n_phase + 1, n_phase + 1, side, side): y and x offset, row, column.

    Cells of 1 / n_phase px, by Gauss-Legendre rules of n_node^2 points, summed to pixels that begin at any cell.
    """
    n_cell = (2 * half_px + 2) * n_phase
    node, weight = np.polynomial.legendre.leggauss(n_node)
    centre = (np.arange(n_cell) + 0.5) / n_phase - (half_px + 1)
    x = centre + 0.5 / n_phase * node[:, None]
    cells = sum(
        0.25 / n_phase**2 * weight[a] * weight[b] * airy_brightness(np.hypot(x[a][:, None], x[b][None, :]))
        for a in range(n_node)
        for b in range(n_node)
    )
    sums = np.pad(cells.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    columns = sums[:, n_phase:] - sums[:, :-n_phase]
    pixels = columns[n_phase:] - columns[:-n_phase]
    side = 2 * half_px + 1
    table = np.empty((n_phase + 1, n_phase + 1, side, side), np.float32)
    for y_phase in range(n_phase + 1):
        for x_phase in range(n_phase + 1):
            # A source further right has its pixels begin further left of it.
            table[y_phase, x_phase] = pixels[n_phase - y_phase :: n_phase, n_phase - x_phase :: n_phase][:side, :side]
    return table


def airy_brightness(radius_px: np.ndarray) -> np.ndarray:
    """Brightness of an Airy pattern of unit light [1/px2]."""
    lambda_f_px = AIRY_RADIUS_PX / _FIRST_DARK_RING
    v = np.maximum(np.pi * radius_px / lambda_f_px, 1e-9)
    return np.pi / 4 / lambda_f_px**2 * (2 * j1(v) / v) ** 2
