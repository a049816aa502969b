"""Pixels of point spread functions by float64 quadrature that shares no code with the product."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.special import erf, j1

import warpsim as ws


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
        return sum(part * airy_fraction(radius, x, y) for radius, part in zip(psf.radii_px, psf.parts, strict=True))
    a = np.array([x - 0.5, x + 0.5, y - 0.5, y + 0.5]) / (psf.sigma_px * np.sqrt(2))
    return float((erf(a[1]) - erf(a[0])) * (erf(a[3]) - erf(a[2])) / 4)


def airy_fraction(radius_px: float, x: float, y: float) -> float:
    """Fraction of a unit Airy pattern of one wavelength in the pixel at offset (x, y)."""
    node, weight = np.polynomial.legendre.leggauss(16)
    # Panels no longer than the core is wide, bounded at the source, where the pattern bends most.
    panels = [
        np.unique(np.concatenate([np.linspace(c - 0.5, c + 0.5, 1 + int(np.ceil(4 / radius_px))), _inside(c)]))
        for c in (x, y)
    ]
    axes = []
    for edges in panels:
        half = np.diff(edges) / 2
        axes.append(((edges[:-1] + half)[:, None] + half[:, None] * node, half[:, None] * weight))
    (xs, wx), (ys, wy) = ((p.ravel(), w.ravel()) for p, w in axes)
    v = np.maximum(np.hypot(xs[None, :], ys[:, None]) * np.pi * 1.2196698912665045 / radius_px, 1e-12)
    lambda_f = radius_px / 1.2196698912665045
    brightness = np.pi / 4 / lambda_f**2 * (2 * j1(v) / v) ** 2
    return float(wy @ brightness @ wx)


def _inside(centre: float) -> list[float]:
    return [0.0] if abs(centre) < 0.5 else []
