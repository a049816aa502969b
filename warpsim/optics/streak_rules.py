"""Quadrature rules for streaks: how long a streak each can serve, by the sharpness of the image of a point."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.streaks import NO_LIMIT, StreakRules

from warpsim.arrays import F64
from warpsim.legendre import gauss_legendre
from warpsim.optics.image_table import spline_of
from warpsim.optics.pattern import FIRST_DARK_RING, annular_transfer
from warpsim.optics.psf import PsfAiry, PsfTable

INF = float("inf")

STREAK_ERROR = 1e-6
"""Error of a streak's quadrature in time, per pixel, as a fraction of the source's light."""

# fmt: off
LONGEST_STREAK = {
    1: (12, 3.6, 1.8, 1, 0.56, 0.31, 0.17, 0.099, 0.055, 0.031, 0.017, 0.0099, 0.0055, 0.0031, 0.0017, 0.00099),
    2: (INF, 9.1, 4.88, 3.29, 2.35, 1.72, 1.27, 0.949, 0.708, 0.53, 0.397, 0.297, 0.223, 0.167, 0.125, 0.094),
    3: (INF, 16.1, 7.97, 5.58, 4.25, 3.35, 2.69, 2.18, 1.77, 1.45, 1.19, 0.984, 0.81, 0.668, 0.55, 0.454),
    4: (INF, 30.6, 11.4, 7.9, 6.14, 4.99, 4.15, 3.49, 2.96, 2.53, 2.17, 1.86, 1.6, 1.38, 1.19, 1.03),
    6: (INF, 136, 19.6, 12.7, 9.93, 8.24, 7.04, 6.13, 5.39, 4.78, 4.26, 3.81, 3.42, 3.08, 2.78, 2.51),
    8: (INF, INF, 30.5, 18, 13.8, 11.5, 9.92, 8.74, 7.8, 7.03, 6.38, 5.81, 5.32, 4.88, 4.49, 4.13),
    12: (INF, INF, 66, 30, 22, 18.1, 15.6, 13.9, 12.5, 11.4, 10.5, 9.77, 9.09, 8.48, 7.94, 7.45),
    16: (INF, INF, 144, 44.3, 30.9, 25.1, 21.5, 19.1, 17.3, 15.8, 14.6, 13.6, 12.8, 12, 11.3, 10.7),
    24: (INF, INF, INF, 81.7, 50.7, 39.8, 33.7, 29.8, 26.9, 24.7, 22.9, 21.4, 20.1, 19, 18, 17.2),
    32: (INF, INF, INF, 136, 73, 55.5, 46.5, 40.7, 36.7, 33.6, 31.1, 29.1, 27.4, 26, 24.7, 23.6),
    48: (INF, INF, INF, 357, 126, 89.7, 73.4, 63.5, 56.8, 51.8, 47.9, 44.8, 42.2, 39.9, 38, 36.3),
    64: (INF, INF, INF, 1190, 192, 127, 101, 87.3, 77.6, 70.5, 65.1, 60.7, 57.1, 54, 51.4, 49.1),
    96: (INF, INF, INF, INF, 381, 212, 163, 137, 120, 109, 100, 93.1, 87.4, 82.6, 78.5, 74.9),
    128: (INF, INF, INF, INF, 701, 311, 229, 189, 165, 148, 136, 126, 118, 111, 105, 101),
    192: (INF, INF, INF, INF, 2730, 556, 375, 301, 259, 230, 210, 194, 181, 170, 161, 154),
    256: (INF, INF, INF, INF, INF, 883, 537, 420, 357, 315, 286, 263, 245, 230, 218, 207),
}
# fmt: on
"""Nodes of a Gauss-Legendre rule: longest streak, in sigmas of a Gaussian image, that it serves within an error of
10^-0.5, 10^-1 ... 10^-8. The mean over a straight streak of the light on one side of an edge is compared with the
integral, wherever the edge lies; tests/test_streaks.py does it again."""


def streak_rules(device: wp.Device | str) -> Any:
    """Return the kernels' StreakRules on a device; made once."""
    return _rules_on(str(device))


@cache
def _rules_on(device: str) -> Any:
    counts = list(LONGEST_STREAK)
    node, weight = (np.concatenate(parts) for parts in zip(*map(gauss_legendre, counts), strict=True))
    longest = np.array([(np.inf, *LONGEST_STREAK[count]) for count in counts]).T
    rules: Any = StreakRules()
    rules.count = wp.array(counts, dtype=wp.int32, device=device)
    rules.first = wp.array(np.cumsum([0, *counts[:-1]]), dtype=wp.int32, device=device)
    rules.node = wp.array(node, dtype=wp.float64, device=device)
    rules.weight = wp.array(weight, dtype=wp.float64, device=device)
    rules.longest = wp.array(np.minimum(longest, NO_LIMIT).copy(), dtype=wp.float32, device=device)
    return rules


LEAST_TRANSFER = 2e-6
"""Frequencies of which less passes pattern and pixel do not show."""
MARGIN = 0.98
"""For what lies between the frequencies looked at."""


def sharpness(psf: PsfAiry | PsfTable) -> tuple[float, float]:
    """Sigma [px] of the widest Gaussian whose transfer function is nowhere below the pattern's; band limit [1/px].

    A streak of that Gaussian has all the detail that the pattern's has, so that rules which serve it serve the pattern.
    """
    if isinstance(psf, PsfTable):
        return _bounding_sigma_px(*_image_transfer(psf)), float(NO_LIMIT)
    lamf_px = [radius / FIRST_DARK_RING for radius in psf.radii_px]
    frequency = np.linspace(0.001, 1.0, 1000, endpoint=False) / min(lamf_px)
    transfer = sum(
        part * annular_transfer(lamf * frequency, psf.obscuration)
        for part, lamf in zip(psf.parts, lamf_px, strict=True)
    )
    blur = np.exp(-2.0 * (np.pi * psf.blur_px * frequency) ** 2)
    return _bounding_sigma_px(frequency, transfer * blur), 1.0 / min(lamf_px)


def _bounding_sigma_px(frequency_per_px: F64, transfer: F64) -> float:
    found = np.abs(transfer)
    pixel = np.minimum(0.45 / np.maximum(frequency_per_px, 1e-300), 1.0)  # in any direction
    shows = (found * pixel > LEAST_TRANSFER) & (frequency_per_px > 0.0)
    if not shows.any():
        return math.inf
    # A pattern with negative parts may let some frequencies through whole; nothing bounds it but sampling itself.
    depth = np.maximum(-2.0 * np.log(np.minimum(found[shows], 1.0)), 0.02)
    return float(MARGIN * np.min(np.sqrt(depth) / (2.0 * np.pi * frequency_per_px[shows])))


def _image_transfer(psf: PsfTable) -> tuple[F64, F64]:
    """Frequencies [1/px] up to twice those that the samples resolve, and the spline's transfer function."""
    spline = spline_of(psf.image, psf.oversample, psf.smear_px, 1.0)
    whole = np.abs(np.fft.fft2(spline.coefficient))
    rows, cols = (np.arange(n) / n for n in whole.shape)  # the spectrum of samples repeats: 0 to 1 covers it
    transfer = whole * np.sinc(rows[:, None]) ** 4 * np.sinc(cols) ** 4
    mirrored = np.roll(whole[::-1], 1, axis=0) * np.sinc(rows[:, None]) ** 4 * np.sinc(cols) ** 4
    frequency = psf.oversample * np.hypot(rows[:, None], cols)
    blur = np.exp(-2.0 * (np.pi * psf.smear_px * frequency) ** 2)
    return frequency, np.maximum(transfer, mirrored) * blur
