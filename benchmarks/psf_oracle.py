"""Pixels of point spread functions by float64 quadrature that shares no code with the product."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.special import erf

import warpsim as ws
from tests.psf_oracles import converged_airy_fraction


def psf_error(psf: ws.PsfGaussian | ws.PsfAiry, device: str = "cpu") -> float:
    """Worst pixel of a unit source over a few phases, against float64 quadrature over 7 x 7 pixels."""
    worst = 0.0
    for dx, dy in [(0.0, 0.0), (0.31, -0.27), (0.5, 0.5), (-0.44, 0.12)]:
        image = ws.deposit([[8 + dx, 8 + dy]], [1.0], psf, (17, 17), device=device).astype(np.float64)
        for row, column in itertools.product(range(5, 12), repeat=2):
            exact = pixel_fraction(psf, column - 8 - dx, row - 8 - dy)
            worst = max(worst, abs(image[row, column] - exact))
    return worst


def pixel_fraction(psf: ws.PsfGaussian | ws.PsfAiry, x: float, y: float) -> float:
    """Fraction of a unit source in the pixel at offset (x, y)."""
    if isinstance(psf, ws.PsfAiry):
        return sum(
            part * converged_airy_fraction(x, y, radius_px, psf.obscuration)
            for radius_px, part in zip(psf.radii_px, psf.parts, strict=True)
        )
    a = np.array([x - 0.5, x + 0.5, y - 0.5, y + 0.5]) / (psf.sigma_px * np.sqrt(2))
    return float((erf(a[1]) - erf(a[0])) * (erf(a[3]) - erf(a[2])) / 4)
