"""Point spread functions on the host: pixel fractions, and their slopes by the position of the source."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from warpsim.arrays import F64
from warpsim.optics.enclosed import box_half_width_px
from warpsim.optics.epsf_table import table_fraction
from warpsim.optics.psf import Psf, PsfGaussian
from warpsim.optics.tables import TableAccuracy, epsf_table

ENCLOSED = 0.9
"""Fraction of the light within the window that sources are fitted in."""

MOST_HALF_PX, MOST_WING_PX = 12, 200
"""Half-width of that window, and of what is drawn of bright sources, at most."""

GRID_PX, N_GRID = 1.0, 41
"""Positions that a fit may begin at lie that far from a pixel's centre at most; how many along each axis."""

TABLE_ERROR = 1e-5
"""Of a source's light in a pixel: below the noise of all but the very brightest sources."""

_STEP_PX = 0.01
"""Step of slopes: far below the scale of a pixel, far above float32 tables' rounding."""


class PixelPsf:
    """Fractions of a source's light in pixels.

    Args:
        psf: Point spread function, lengths in pixel widths.
        pixel_aspect: Height of a pixel over its width.
    """

    def __init__(self, psf: Psf, pixel_aspect: float = 1.0) -> None:
        self._sigma_px = (psf.sigma_px, psf.sigma_px / pixel_aspect) if isinstance(psf, PsfGaussian) else None
        if not isinstance(psf, PsfGaussian):
            self._table = epsf_table(psf, pixel_aspect, TABLE_ERROR)
        width_px = box_half_width_px(psf, ENCLOSED, pixel_aspect, TableAccuracy(TABLE_ERROR))
        self.half_px = tuple(min(max(2, math.ceil(width_px / unit)), MOST_HALF_PX) for unit in (1.0, pixel_aspect))
        """Half-width of the window of fits, along columns and along rows."""
        core_px = box_half_width_px(psf, 0.5, pixel_aspect, TableAccuracy(TABLE_ERROR))
        self.fwhm_px = 2.0 * core_px
        """Width of the box that holds half the light, pixels included [pixel widths]."""

    @cached_property
    def window(self) -> tuple[F64, F64]:
        """Columns and rows of the window's pixels from its middle, (pixel,) each."""
        half_x, half_y = self.half_px
        rows, columns = np.mgrid[-half_y : half_y + 1, -half_x : half_x + 1].reshape(2, -1).astype(np.float64)
        return columns, rows

    @cached_property
    def grid(self) -> tuple[F64, F64]:
        """Positions about the window's middle, (m, 2), and the fractions of sources there, (m, pixel)."""
        steps = np.linspace(-GRID_PX, GRID_PX, N_GRID)
        at = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        return at, self.fractions(self.window[0] - at[:, :1], self.window[1] - at[:, 1:])

    def fractions(self, dx_px: F64, dy_px: F64) -> F64:
        """Return fractions at pixel centres less the source's position, in widths and heights of a pixel."""
        if self._sigma_px is None:
            return np.asarray(table_fraction(self._table, dx_px, dy_px), dtype=np.float64)
        return _integrated(dx_px, self._sigma_px[0]) * _integrated(dy_px, self._sigma_px[1])

    def with_slopes(self, dx_px: F64, dy_px: F64) -> tuple[F64, F64, F64]:
        """Return fractions, and their derivatives by the source's column and row [1/px]."""
        h = _STEP_PX
        shifts = np.array([[0, 0], [-h, 0], [h, 0], [0, -h], [0, h]]).reshape(5, 2, *(1,) * np.ndim(dx_px))
        at, right, left, down, up = self.fractions(dx_px + shifts[:, 0], dy_px + shifts[:, 1])
        return at, (right - left) / (2 * h), (down - up) / (2 * h)

    def reach_px(self, flux: float, least: float) -> int:
        """Return the distance beyond which no pixel holds `least` of a source's light, about, and at most 200."""
        nearest = max(self.half_px)
        if self._sigma_px is not None:
            return max(nearest, min(MOST_WING_PX, math.ceil(6.0 * max(self._sigma_px)) + 1))
        return int(np.clip(np.cbrt(self._table.tail_px3 * flux / least), nearest, MOST_WING_PX))


def _integrated(offset_px: F64, sigma_px: float) -> F64:
    """Part of a unit Gaussian within a pixel whose centre is offset_px away, along one axis."""
    from scipy.special import erf

    scale = 1.0 / (math.sqrt(2.0) * sigma_px)
    return np.asarray(0.5 * (erf((offset_px + 0.5) * scale) - erf((offset_px - 0.5) * scale)))
