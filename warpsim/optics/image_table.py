"""Effective PSF tables of patterns that are given as images."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.optics.airy import N_REFINE, goal_of_interpolation, stated_error
from warpsim.optics.epsf_table import N_MARGIN, EpsfTable, Wing, check_size, envelope, lagrange_weights, table_fraction
from warpsim.optics.spline_image import SplineImage

F64 = NDArray[np.float64]

N_SAMPLE = 80
"""Offsets along each axis, in all pairs, on which a table's error is measured."""
N_PROBE = 24
"""The same to find the distance of its nodes."""


def image_table(pattern: SplineImage, error: float, n_point: int, real: type = np.float32) -> EpsfTable:
    """Build the table of an image.

    Args:
        pattern: The spline through the image.
        error: Largest error per pixel and unit flux, against the spline.
        n_point: Points per axis of the interpolation.
        real: Of the weights and sums with which the table is read, np.float32 or np.float64.

    Raises:
        InputError: The table would be too large, or the error is too small for float32.
    """
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
    per_px = 2 * math.ceil(0.5 * pattern.pixel_aspect / step_px), 2 * math.ceil(0.5 / step_px)
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
