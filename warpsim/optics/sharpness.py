"""Sharpness of the images of points, which decides the count of nodes along a streak."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from warpsim_kernels.streaks import NO_LIMIT

from warpsim.optics.pattern import FIRST_DARK_RING, annular_transfer
from warpsim.optics.psf import PsfAiry, PsfTable
from warpsim.optics.spline_image import spline_of

F64 = npt.NDArray[np.float64]

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
