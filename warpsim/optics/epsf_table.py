"""Effective PSF tables: the fraction of a point source's flux that a pixel collects, over its offset from the source.

A pixel centred (dx, dy) from the source collects P(dx, dy), the integral over that pixel of the pattern. P is smooth
on the scale of the pattern however small that is compared with the pixel, so a grid of a few nodes per scale and
Lagrange's interpolation of n x n points reproduce it. Nodes per pixel are even, so that the pixel's edges, where P is
steepest for a sharp pattern, fall on nodes. Beyond the table's reach P follows a power law, or is zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError

Floats = NDArray[np.floating]

POINTS = (2, 4, 6, 8)
"""Points per axis that an interpolation may use."""

N_MARGIN = 4
"""Nodes stored before zero of a mirrored table and beyond the reach, for the ends of the widest interpolation."""

ENVELOPE_PER_PX = 4
"""Discs per pixel of radius in EpsfTable.envelope; the kernels' own number."""

LARGEST_N_NODE = 12_000_000
"""Nodes of the largest table (48 MB)."""


class Wing(NamedTuple):
    """P = px3 / r^3 * (1 + (next_px2 + aspect_px2 dx^2 / r^2 + last_px4 / r^2) / r^2), r in pixel widths."""

    px3: float = 0.0
    next_px2: float = 0.0
    aspect_px2: float = 0.0
    last_px4: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class EpsfTable:
    """Pixel fractions of a unit-flux pattern on a uniform grid of pixel offsets, and what lies beyond it.

    Pairs are in the order of array axes: rows, columns.
    """

    fraction: NDArray[np.float32]
    """Pixel fractions at dy = (row - zero[0]) / per_px[0], dx = (col - zero[1]) / per_px[1], shape (n_row, n_col);
    read-only."""

    n_point: int
    """Points per axis of the interpolation."""

    per_px: tuple[int, int]
    """Nodes per pixel; even."""

    zero: tuple[int, int]
    """Node of the offset 0."""

    mirrored: bool
    """Whether the table is even in dx and in dy, and holds what is >= 0 only."""

    reach_px: tuple[float, float]
    """The |dy| [pixel heights] and |dx| [px] below which the table serves; multiples of 1/2, so exact in float32."""

    pixel_aspect: float
    """Height of a pixel over its width."""

    wing: Wing
    """Power law of P beyond the reach."""

    envelope: NDArray[np.float32]
    """Largest fraction of a pixel wholly outside a disc about the source of radius 0, 1/4, 1/2 ... pixel widths."""

    tail_px3: float
    """Beyond the envelope no pixel holds more than tail / r^3, r = distance of its centre [px3]."""

    error: float
    """Bound of the absolute error of `table_fraction()` per unit flux: the largest found on sampled offsets, and a
    margin."""

    @property
    def n_byte(self) -> int:
        """Bytes of the fractions."""
        return self.fraction.nbytes


def table_fraction(table: EpsfTable, dx_px: ArrayLike, dy_px: ArrayLike) -> Floats:
    """Return pixel fractions: the readable twin of the device function.

    Nodes are counted in float64. Weights and sums are float32, as on the device, if both offsets are; else float64.

    Args:
        table: The pattern.
        dx_px: Pixel centre minus source along columns [px].
        dy_px: Pixel centre minus source along rows [pixel heights]; same shape as dx_px.

    Returns:
        Fractions of the unit flux.
    """
    x, y = np.asarray(dx_px), np.asarray(dy_px)
    real = np.float32 if x.dtype == y.dtype == np.float32 else np.float64
    x, y = np.broadcast_arrays(x.astype(np.float64), y.astype(np.float64))
    inside = (np.abs(x) < table.reach_px[1]) & (np.abs(y) < table.reach_px[0])
    value = np.empty(x.shape, dtype=real)
    value[inside] = _interpolated(table, x[inside], y[inside], real)
    value[~inside] = _beyond(table, x[~inside], y[~inside])
    return value


def _interpolated(table: EpsfTable, dx_px: F64, dy_px: F64, real: type) -> Floats:
    row, down = _cell_and_weights(table, 0, dy_px, real)
    col, across = _cell_and_weights(table, 1, dx_px, real)
    total: Floats = np.zeros(dx_px.shape, dtype=real)
    for j in range(table.n_point):
        line: Floats = np.zeros(dx_px.shape, dtype=real)
        for i in range(table.n_point):
            line += across[i] * table.fraction[row + j, col + i]
        total += down[j] * line
    return total


def _cell_and_weights(
    table: EpsfTable, axis: int, offset_px: F64, real: type
) -> tuple[NDArray[np.int64], list[Floats]]:
    """Return the first of the nodes around an offset, and the weights of all."""
    folded_px = np.abs(offset_px) if table.mirrored else offset_px
    position = folded_px * table.per_px[axis] + table.zero[axis]
    before = table.n_point // 2 - 1
    node = np.clip(np.floor(position).astype(np.int64), before, table.fraction.shape[axis] - table.n_point + before)
    return node - before, lagrange_weights((position - node).astype(real), table.n_point)


def lagrange_weights(u: Floats, n_point: int) -> list[Floats]:
    """Return the weights of the nodes 1 - n/2 ... n/2 for the value at u in [0, 1]."""
    nodes = range(1 - n_point // 2, n_point // 2 + 1)
    weights = []
    for k in nodes:
        others = [j for j in nodes if j != k]
        weight = np.full_like(u, 1.0 / math.prod(k - j for j in others))
        for j in others:
            weight *= u - u.dtype.type(j)
        weights.append(weight)
    return weights


def _beyond(table: EpsfTable, dx_px: F64, dy_px: F64) -> F64:
    """Return the wing."""
    x2 = dx_px * dx_px
    inverse2 = 1.0 / (x2 + (table.pixel_aspect * dy_px) ** 2)
    wing = table.wing
    more = (wing.next_px2 + (wing.aspect_px2 * x2 + wing.last_px4) * inverse2) * inverse2
    return np.asarray(wing.px3 * inverse2 * np.sqrt(inverse2) * (1.0 + more))


def pixel_wing(wing_px3: float, smear_px: float, pixel_aspect: float) -> Wing:
    """Return the mean over a pixel of the irradiance w / r^3, blurred.

    A blur by s adds s^2 / 2 times the Laplacian, and s^4 / 8 times its square; n^2 r^(-n-2) is that of r^-n. The mean
    over a pixel of 1 x a adds (d2/dx2 + a^2 d2/dy2) / 24; of the blurred part it is taken for a square of equal area.
    """
    a2, s2 = pixel_aspect**2, smear_px**2
    last_px4 = 28.125 * s2 * s2 + 4.6875 * s2 * 0.5 * (1.0 + a2)
    return Wing(wing_px3 * pixel_aspect, 4.5 * s2 + 0.5 * a2 - 0.125, 0.625 * (1.0 - a2), last_px4)


def envelope(
    fraction64: F64, per_px: tuple[int, int], zero: tuple[int, int], pixel_aspect: float, reach_px: float, far: float
) -> NDArray[np.float32]:
    """Return EpsfTable.envelope, for discs up to a radius.

    Args:
        fraction64: Fractions on the nodes.
        per_px: Nodes per pixel.
        zero: Node of the offset 0.
        pixel_aspect: Height of a pixel over its width.
        reach_px: Radius of the last disc [px].
        far: Largest fraction beyond the table.
    """
    offset = [np.abs(np.arange(n) - zero[axis]) / per_px[axis] - 0.5 for axis, n in enumerate(fraction64.shape)]
    rows, cols = pixel_aspect * np.maximum(offset[0], 0.0), np.maximum(offset[1], 0.0)
    n_disc = int(ENVELOPE_PER_PX * reach_px) + 1
    largest = np.full(n_disc + 1, far)
    # A node stands for its surroundings: it counts as half a cell farther out than it is.
    half_cell = 0.5 * math.hypot(pixel_aspect / per_px[0], 1.0 / per_px[1])
    for row, line in zip(rows, np.abs(fraction64), strict=True):
        disc = np.minimum(ENVELOPE_PER_PX * (np.hypot(row, cols) + half_cell), n_disc).astype(np.int64)
        np.maximum.at(largest, disc, line)
    # The smallest disc touches the source's own pixel, whatever its offset in it.
    outside = (offset[0] > -0.75 / per_px[0])[:, None] | (offset[1] > -0.75 / per_px[1])
    largest[0] = np.max(np.abs(fraction64), where=outside, initial=far)
    largest = np.maximum.accumulate(largest[::-1])[::-1][:n_disc]
    return np.where(largest > 0.0, 1.02 * largest, 0.0).astype(np.float32)  # 2 %: maxima between the nodes


def check_size(n_row: int, n_col: int, what: str) -> None:
    """See that a table is not too large."""
    if n_row * n_col > LARGEST_N_NODE:
        raise InputError(
            f"needs a table of {n_row} x {n_col} nodes, more than {LARGEST_N_NODE}; a larger error makes it smaller"
        ).of(what)
