"""How sharp a point's image is, for the count of nodes along a streak."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from warpsim.optics.pattern import FIRST_DARK_RING
from warpsim.optics.psf import PsfAiry, PsfTable
from warpsim.optics.transfer import annular_transfer

_UNSEEN = 1e-7
"""Parts of a transfer function below this do not count."""


@dataclass(frozen=True, slots=True)
class Sharpness:
    """Bounds of the transfer function of an image."""

    width_px: float
    """Sigma of a Gaussian whose transfer function is nowhere below the image's [px]."""
    band_limit_per_px: float
    """Highest spatial frequency of the image [1/px]; infinite where there is none."""


def sharpness_of(psf: PsfAiry | PsfTable) -> Sharpness:
    """Sharpness of a tabulated point spread function; that of its sharpest wavelength."""
    if isinstance(psf, PsfAiry):
        lamf_px = min(psf.radii_px) / FIRST_DARK_RING
        width_px = math.hypot(airy_blur_lamf(psf.obscuration) * lamf_px, psf.smear_px)
        return Sharpness(width_px, 1.0 / lamf_px)
    return Sharpness(math.hypot(_image_blur_px(psf), psf.smear_px), math.inf)


@lru_cache(maxsize=64)
def airy_blur_lamf(obscuration: float) -> float:
    """Sigma [lambda F] of the widest Gaussian whose transfer function is nowhere below that of an Airy pattern."""
    frequency = np.linspace(0.002, 0.998, 499)
    transfer = annular_transfer(frequency, obscuration)
    return float(np.min(np.sqrt(-2.0 * np.log(transfer)) / (2.0 * np.pi * frequency)))


def _image_blur_px(psf: PsfTable) -> float:
    """The same of an image [px]; that of its samples where it is sharper, as the spline between them is."""
    shape = tuple(2 * n for n in psf.image.shape)
    transfer = np.abs(np.fft.rfft2(psf.image, shape)) / abs(psf.image.sum())
    frequency = psf.oversample * np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]))
    seen = (transfer > _UNSEEN) & (frequency > 0.0)
    narrowest_px = 0.3 / psf.oversample
    if not seen.any():
        return narrowest_px
    ratio = np.sqrt(-2.0 * np.log(np.minimum(transfer[seen], 1.0))) / (2.0 * np.pi * frequency[seen])
    return max(float(np.min(ratio)), narrowest_px)
