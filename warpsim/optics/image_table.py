"""Patterns given as images: cubic splines through their samples, integrated over pixels in closed form.

Between samples the pattern is the cubic spline sum_kl C_kl B(u - l) B(v - k) (Unser 1999, "Splines: a perfect fit for
signal and image processing"), u and v counted in samples; beyond the image it is zero. B integrates to a piecewise
quartic in closed form, so the pixel fraction is a^T C b with no error but the spline's own, and a blur by a Gaussian
acts on B alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.optics.airy import N_REFINE, goal_of_interpolation, nodes_per_px, stated_error
from warpsim.optics.epsf_table import N_MARGIN, EpsfTable, Wing, check_size, envelope, lagrange_weights, table_fraction
from warpsim.optics.flow import chunks

N_RINGING = 12
"""Samples kept beyond the image, where a spline through a cut-off pattern swings out: 0.27 per sample."""
BLUR_REACH = 7.0
N_FINE = 64
"""Steps per sample of the tabulated blurred spline."""


@dataclass(frozen=True, slots=True)
class SplineImage:
    """A pattern of unit flux as a spline, and its integrals over pixels."""

    coefficient: F64
    """C, shape (n_row + 24, n_col + 24), of unit sum."""

    oversample: float
    """Samples per pixel width."""

    smear_px: float
    """Standard deviation of a Gaussian blur on each axis [px]."""

    pixel_aspect: float
    """Height of a pixel over its width."""

    blurred: tuple[F64, F64] | None
    """Integrals of a blurred B over a pixel along rows and columns, 64 per sample of its distance from the pixel."""

    @property
    def half_size_px(self) -> tuple[float, float]:
        """Offsets along rows [pixel heights] and columns [px] beyond which a pixel collects nothing."""
        beyond = 2.0 / self.oversample + BLUR_REACH * self.smear_px
        n_row, n_col = self.coefficient.shape
        height_px = 0.5 * (n_row - 1) / self.oversample + beyond
        return height_px / self.pixel_aspect + 0.5, 0.5 * (n_col - 1) / self.oversample + beyond + 0.5

    def fractions(self, dx_px: F64, dy_px: F64) -> F64:
        """Return the pixel fractions at offsets along columns [px] and rows [pixel heights], shape (n,) each."""
        first_row, down = self._band(0, dy_px)
        first_col, across = self._band(1, dx_px)
        padded = np.pad(self.coefficient, ((down.shape[1],) * 2, (across.shape[1],) * 2))
        total: F64 = np.empty(len(dx_px))
        rows, cols = np.arange(down.shape[1]), np.arange(across.shape[1])
        for here in chunks(len(dx_px), len(rows) * len(cols)):
            row = np.clip(first_row[here, None] + len(rows) + rows, 0, padded.shape[0] - 1)
            col = np.clip(first_col[here, None] + len(cols) + cols, 0, padded.shape[1] - 1)
            block = padded[row[:, :, None], col[:, None, :]]
            total[here] = np.einsum("nrc,nr,nc->n", block, down[here], across[here], optimize=True)
        return total

    def fractions_on_grid(self, dx_px: F64, dy_px: F64) -> F64:
        """Return the pixel fractions at all pairs of offsets, shape (len(dy_px), len(dx_px))."""
        down, across = self._matrix(0, dy_px), self._matrix(1, dx_px)
        return np.asarray(down @ self.coefficient @ across.T)

    def _band(self, axis: int, offset_px: F64) -> tuple[NDArray[np.int64], F64]:
        """Return the first coefficient that matters to each pixel, and the integrals over the pixel of all that do."""
        box = self.oversample * (self.pixel_aspect if axis == 0 else 1.0)  # length of a pixel [samples]
        position = offset_px * box + 0.5 * (self.coefficient.shape[axis] - 1)  # in numbers of coefficients
        half = half_band(box, self.smear_px * self.oversample)
        first = np.ceil(position - half).astype(np.int64)
        number = np.arange(int(2.0 * half) + 1)
        distance = position[:, None] - first[:, None] - number
        if self.blurred is None:
            return first, _box_integral(distance, box)
        return first, _cubic_through(self.blurred[axis], np.abs(distance) * N_FINE)

    def _matrix(self, axis: int, offset_px: F64) -> F64:
        """Return the integrals over each pixel of each coefficient's spline, shape (n, n_coefficient)."""
        first, band = self._band(axis, offset_px)
        matrix = np.zeros((len(offset_px), self.coefficient.shape[axis]))
        column = first[:, None] + np.arange(band.shape[1])
        row = np.broadcast_to(np.arange(len(offset_px))[:, None], column.shape)
        inside = (column >= 0) & (column < matrix.shape[1])
        matrix[row[inside], column[inside]] = band[inside]
        return matrix


def half_band(box: float, blur: float) -> float:
    """Return the distance from which a blurred B has no part in a pixel [samples]."""
    return 0.5 * box + 2.0 + BLUR_REACH * blur


def spline_of(image: F64, oversample: float, smear_px: float, pixel_aspect: float) -> SplineImage:
    """Return the spline through an image of positive sum, scaled to unit flux."""
    pad = 24  # the coefficients fall by 0.27 per sample
    coefficient = np.pad(image / image.sum(), pad)
    for _ in range(2):
        coefficient = _prefiltered(coefficient).T
    keep = pad - N_RINGING
    coefficient = coefficient[keep:-keep, keep:-keep]
    blur = smear_px * oversample
    blurred = None
    if blur > 0.0:
        blurred = _blurred_integrals(oversample * pixel_aspect, blur), _blurred_integrals(oversample, blur)
    return SplineImage(coefficient / coefficient.sum(), oversample, smear_px, pixel_aspect, blurred)


def _blurred_integrals(box: float, blur: float) -> F64:
    """Return the integral of the blurred B over a box, at the distances (k - 3) / N_FINE for k = 0, 1 ..."""
    distance = np.arange(-3, math.ceil(half_band(box, blur) * N_FINE) + 6) / N_FINE
    # Panels of half a sample, or of the blur where that is wider: B is a cubic between its knots.
    n_panel = max(math.ceil(2.0 * BLUR_REACH * min(blur, 8.0)) + 1, 5)  # fewer do not even hold the Gaussian
    node, weight = np.polynomial.legendre.leggauss(8)
    left = -BLUR_REACH + 2.0 * BLUR_REACH / n_panel * np.arange(n_panel)
    shift = (left[:, None] + BLUR_REACH / n_panel * (1.0 + node)).ravel()
    gauss = np.exp(-0.5 * shift**2) / math.sqrt(2.0 * math.pi) * np.tile(BLUR_REACH / n_panel * weight, n_panel)
    total = np.zeros_like(distance)
    for t, w in zip(shift, gauss, strict=True):
        total += w * _box_integral(distance - blur * t, box)
    return total


def _prefiltered(sample: F64) -> F64:
    """Return the coefficients of the cubic splines through the samples along axis 0; zero beyond."""
    pole = math.sqrt(3.0) - 2.0
    value = sample.copy()
    for k in range(1, len(value)):
        value[k] += pole * value[k - 1]
    value[-1] *= pole / (pole * pole - 1.0)
    for k in range(len(value) - 2, -1, -1):
        value[k] = pole * (value[k + 1] - value[k])
    return 6.0 * value


def _box_integral(distance: F64, box: float) -> F64:
    """Return the integral of the cubic B-spline over [distance - box / 2, distance + box / 2]."""
    return _spline_primitive(distance + 0.5 * box) - _spline_primitive(distance - 0.5 * box)


def _spline_primitive(x: F64) -> F64:
    """Return the integral of the cubic B-spline from 0 to x, an odd function."""
    u = np.minimum(np.abs(x), 2.0)
    inner = u * (2.0 / 3.0 + u * u * (u / 8.0 - 1.0 / 3.0))
    outer = 0.5 - (2.0 - u) ** 4 / 24.0
    return np.sign(x) * np.where(u < 1.0, inner, outer)


def _cubic_through(value: F64, position: F64) -> F64:
    """Return four-point Lagrange interpolation of an even function; value[k] is at position k - 3; 0 beyond all."""
    cell = np.minimum(position.astype(np.int64), len(value) - 7)
    t = np.minimum(position - cell, 1.0)
    low, here, up, top = (value[cell + k] for k in (2, 3, 4, 5))
    return np.asarray(
        low * (-t * (t - 1.0) * (t - 2.0) / 6.0)
        + here * ((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
        + up * (-(t + 1.0) * t * (t - 2.0) / 2.0)
        + top * ((t + 1.0) * t * (t - 1.0) / 6.0)
    )


N_SAMPLE = 80
"""Offsets along each axis, in all pairs, on which a table's error is measured."""
N_PROBE = 24
"""The same to find the distance of its nodes."""


def image_table(pattern: SplineImage, error: float, n_point: int, real: type) -> EpsfTable:
    """Build the table of an image; its error, against the spline, is at most `error`."""
    step_px = _step_px(pattern, error, n_point)
    for _ in range(N_REFINE):
        table = _table(pattern, step_px, n_point)
        x, y = (axis.astype(np.float32) for axis in _samples(pattern, N_SAMPLE))
        exact = pattern.fractions_on_grid(x.astype(np.float64), y.astype(np.float64))
        found = float(np.max(np.abs(table_fraction(table, *np.meshgrid(x.astype(real), y.astype(real))) - exact)))
        if stated_error(found) <= error:
            return replace(table, error=stated_error(found))
        step_px *= 0.95 * min(1.0, (0.75 * error / found) ** (1.0 / min(n_point, 5)))
    rule = f"{error:g} is too small for float32, reached {stated_error(found):.2g}"
    raise InputError(rule, "error").of("psf table")


def image_table_shape(pattern: SplineImage, error: float, n_point: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return shape and nodes per pixel of the table of an order, without building it: a guess to choose by."""
    per_px, _, shape = _layout(pattern, _step_px(pattern, error, n_point))
    return shape, per_px


def _samples(pattern: SplineImage, n: int) -> tuple[F64, F64]:
    """Offsets dx and dy to try, in all pairs, shape (n,) each: most of them near the brightest pixels."""
    rng = np.random.default_rng(0)
    brightness = np.abs(pattern.coefficient)
    offsets = []
    for axis, half in enumerate(pattern.half_size_px):
        bright = np.argsort(brightness.sum(axis=1 - axis))[::-1][:8]
        position_px = (rng.choice(bright, n) - 0.5 * (brightness.shape[axis] - 1)) / pattern.oversample
        position_px += rng.choice([-0.5, 0.0, 0.5], n) + rng.normal(0.0, 1.0, n) / pattern.oversample
        position_px[: n // 4] = rng.uniform(-half, half, n // 4)
        offsets.append(np.clip(position_px / (pattern.pixel_aspect if axis == 0 else 1.0), -half, half))
    return offsets[1], offsets[0]


def _step_px(pattern: SplineImage, error: float, n_point: int) -> float:
    """Return the distance of nodes at which interpolation keeps the error on samples [px]."""
    goal = goal_of_interpolation(error, n_point)
    step_px = 1.0 / pattern.oversample
    dx_px, dy_px = _samples(pattern, N_PROBE)
    exact = pattern.fractions_on_grid(dx_px, dy_px)
    weight = np.array([w[0] for w in lagrange_weights(np.array([0.5]), n_point)])
    number = np.arange(n_point) - (0.5 * n_point - 0.5)
    for _ in range(8):
        x = (dx_px[:, None] + step_px * number).ravel()
        y = (dy_px[:, None] + step_px / pattern.pixel_aspect * number).ravel()
        nodes = pattern.fractions_on_grid(x, y).reshape(N_PROBE, n_point, N_PROBE, n_point)
        found = float(np.abs(np.einsum("ajbi,j,i->ab", nodes, weight, weight, optimize=True) - exact).max())
        factor = min(2.0, (goal / max(found, 1e-300)) ** (1.0 / min(n_point, 5)))
        step_px = min(step_px * factor, 1.0)
        if 0.95 < factor < 1.05:
            break
    return step_px


def _layout(pattern: SplineImage, step_px: float) -> tuple[tuple[int, int], tuple[float, float], tuple[int, int]]:
    """Return nodes per pixel, reach [px] and shape; rows, columns."""
    per_px = nodes_per_px(step_px, pattern.pixel_aspect)
    half_y, half_x = pattern.half_size_px
    reach_px = 0.5 * math.ceil(2.0 * half_y), 0.5 * math.ceil(2.0 * half_x)
    n_row, n_col = (2 * (round(reach * per) + N_MARGIN) + 1 for reach, per in zip(reach_px, per_px, strict=True))
    return per_px, reach_px, (n_row, n_col)


def _table(pattern: SplineImage, step_px: float, n_point: int) -> EpsfTable:
    """Fill a table; its error is yet to be measured."""
    per_px, reach_px, shape = _layout(pattern, step_px)
    check_size(*shape, "psf table")
    zero = shape[0] // 2, shape[1] // 2
    dy_px, dx_px = ((np.arange(shape[axis]) - zero[axis]) / per_px[axis] for axis in (0, 1))
    fraction64 = pattern.fractions_on_grid(dx_px, dy_px)
    fraction32 = fraction64.astype(np.float32)
    fraction32.flags.writeable = False
    corner_px = math.hypot(reach_px[0] * pattern.pixel_aspect, reach_px[1])
    return EpsfTable(
        fraction=fraction32,
        n_point=n_point,
        per_px=per_px,
        zero=zero,
        mirrored=False,
        reach_px=reach_px,
        pixel_aspect=pattern.pixel_aspect,
        wing=Wing(),
        envelope=envelope(fraction64, per_px, zero, pattern.pixel_aspect, corner_px + 2.0, 0.0),
        tail_px3=0.0,
        error=math.nan,
    )
