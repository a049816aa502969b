"""Shares of a point source's light that single pixels collect, and how wide a stamp has to be.

A pixel integrates the point spread function over its area; sampling at the pixel centre would be wrong by factors
where the blur is smaller than a pixel.
"""

import functools
import math
from typing import Any, NamedTuple

import warp as wp

MAX_HALF_WIDTH_PX = wp.constant(511)
"""Widest stamp: 511 pixels to each side of the source's own pixel."""

TABLE_POINTS = (2, 4, 6, 8)
"""Points per axis that an interpolation in a table of shares may use."""

_SQRT_HALF = wp.constant(0.7071067811865476)


@wp.func
def gaussian_pixel_share(offset_px: wp.float64, sigma_px: float) -> float:
    """Part of a unit one-dimensional Gaussian inside the pixel whose centre is offset_px from the source.

    Both edges are measured from the source in float64 first; on the far side the complementary error function keeps
    the tail's leading digits (the paper's Eq. 7, integrated over the pixel).
    """
    centre = wp.abs(offset_px)
    scale = _SQRT_HALF / sigma_px
    near = float(centre - wp.float64(0.5)) * scale
    far = float(centre + wp.float64(0.5)) * scale
    if near > 0.5:
        return 0.5 * (wp.erfc(near) - wp.erfc(far))
    return 0.5 * (wp.erf(far) - wp.erf(near))


@wp.func
def gaussian_half_width_px(sigma_px: float, cut: float) -> int:
    """Stamp half-width beyond which no pixel holds more than the fraction `cut` of the flux.

    A pixel left out begins at least half_width from the source, so it holds less than exp(-half_width^2/2 sigma^2)/2.
    """
    if cut >= 0.5:
        return 0
    return wp.min(int(wp.ceil(sigma_px * wp.sqrt(-2.0 * wp.log(2.0 * cut)))), MAX_HALF_WIDTH_PX)


@wp.struct
class TablePsf:
    """A point spread function as a table of pixel shares over the offset (dy, dx), and what lies beyond it.

    The flat array of all bands holds, for each, its shares (rows of n_column nodes) and its envelope.
    """

    start: int  # where the shares begin in the flat array
    n_column: int  # nodes per row of the table
    n_row: int
    column_per_px: int  # nodes per pixel along columns
    row_per_px: int
    zero_column: int  # node of the offset 0
    zero_row: int
    mirrored: int  # 1: the table is even in both offsets and holds those >= 0 only
    reach_column_px: float  # offsets up to here lie inside the table
    reach_row_px: float  # in pixel heights
    pixel_aspect: float  # height of a pixel over its width
    wing_px3: float  # beyond, share = wing / r^3 * (1 + (next + aspect * dx^2 / r^2) / r^2), r in pixel widths
    wing_next_px2: float
    wing_aspect_px2: float
    envelope: int  # where the envelope begins: largest share of a pixel outside a disc of radius 0, 1/2, 1, 3/2 ...
    n_envelope: int
    tail_px3: float  # farther out no pixel holds more than tail / r^3, r = distance of its centre; 0: nothing


@wp.func
def table_reach_px(table: wp.array[float], psf: TablePsf, cut: float) -> float:
    """Radius of the disc about a source without which no pixel holds more than the fraction `cut` of the flux.

    In pixel widths. A pixel belongs to the disc if any part of it does.
    """
    if table[psf.envelope + psf.n_envelope - 1] > cut:
        beyond = wp.pow(psf.tail_px3 / cut, wp.static(1.0 / 3.0)) - 0.5 * wp.min(psf.pixel_aspect, 1.0)
        return wp.max(beyond, 0.5 * float(psf.n_envelope))
    k = int(0)
    while table[psf.envelope + k] > cut:
        k += 1
    return 0.5 * float(k)


@wp.func
def table_half_width_px(table: wp.array[float], psf: TablePsf, cut: float) -> int:
    """Stamp half-width, in columns as in rows, beyond which no pixel holds more than the fraction `cut` of the flux."""
    reach_px = table_reach_px(table, psf, cut) / wp.min(psf.pixel_aspect, 1.0)
    return int(wp.ceil(wp.min(reach_px, float(MAX_HALF_WIDTH_PX))))


class TableFunctions(NamedTuple):
    """What a kernel needs to read tables by an interpolation of n_point x n_point nodes."""

    axis_type: Any
    """Struct: interpolation along one axis; it serves a whole column or row of a stamp."""

    column_axis: Any
    """(dx_px: float64, psf: TablePsf) -> axis; dx_px = pixel's column minus source's x."""

    row_axis: Any
    """(dy_px: float64, psf: TablePsf) -> axis; dy_px = pixel's row minus source's y [pixel heights]."""

    share: Any
    """(table: array[float], psf: TablePsf, row: axis, column: axis) -> share of the pixel at these offsets."""


@functools.cache
def table_functions(n_point: int) -> TableFunctions:
    """The functions that interpolate tables by Lagrange's polynomials through n_point nodes per axis.

    Args:
        n_point: 2, 4, 6 or 8, as the tables were built.
    """
    if n_point not in TABLE_POINTS:
        raise ValueError(f"n_point: must be one of {TABLE_POINTS}, got {n_point}")
    n_before = n_point // 2 - 1  # nodes before the cell that holds the point
    weights_type = wp.types.vector(length=n_point, dtype=wp.float32)
    nodes = range(-n_before, n_point - n_before)
    scale = weights_type(*(1.0 / math.prod(k - j for j in nodes if j != k) for k in nodes))

    @wp.func
    def lagrange_weights(u: float) -> weights_type:
        """Weights of the nodes -n_before ... n_before + 1 at the point u in [0, 1]."""
        weights = scale
        below = float(1.0)
        for k in range(wp.static(n_point)):
            weights[k] = weights[k] * below
            below = below * (u - float(k - wp.static(n_before)))
        above = float(1.0)
        for k in range(wp.static(n_point)):
            weights[wp.static(n_point - 1) - k] = weights[wp.static(n_point - 1) - k] * above
            above = above * (u - float(wp.static(n_point - 1 - n_before) - k))
        return weights

    class TableAxis:
        distance_px: float  # from the source, in pixel widths
        first: int  # first of the nodes; -1 beyond the table
        weights: weights_type

    axis_type = wp.struct(TableAxis)

    @wp.func
    def axis(offset_px: wp.float64, per_px: int, zero: int, n_node: int, mirrored: int) -> axis_type:
        place = offset_px
        if mirrored != 0:
            place = wp.abs(offset_px)
        # In float64 up to the fraction of a cell: P is steep where the source crosses the pixel's edge.
        position = place * wp.float64(per_px) + wp.float64(zero)
        node = wp.clamp(int(wp.floor(position)), wp.static(n_before), n_node - wp.static(n_point - n_before))
        result = axis_type()
        result.first = node - wp.static(n_before)
        result.weights = lagrange_weights(float(position - wp.float64(node)))
        return result

    @wp.func
    def column_axis(dx_px: wp.float64, psf: TablePsf) -> axis_type:
        result = axis(dx_px, psf.column_per_px, psf.zero_column, psf.n_column, psf.mirrored)
        result.distance_px = float(dx_px)
        if wp.abs(dx_px) > wp.float64(psf.reach_column_px):
            result.first = -1
        return result

    @wp.func
    def row_axis(dy_px: wp.float64, psf: TablePsf) -> axis_type:
        result = axis(dy_px, psf.row_per_px, psf.zero_row, psf.n_row, psf.mirrored)
        result.distance_px = float(dy_px) * psf.pixel_aspect
        if wp.abs(dy_px) > wp.float64(psf.reach_row_px):
            result.first = -1
        return result

    @wp.func
    def share(table: wp.array[float], psf: TablePsf, row: axis_type, column: axis_type) -> float:
        if wp.min(row.first, column.first) < 0:
            x2 = column.distance_px * column.distance_px
            inverse2 = 1.0 / (x2 + row.distance_px * row.distance_px)
            more = (psf.wing_next_px2 + psf.wing_aspect_px2 * x2 * inverse2) * inverse2
            return psf.wing_px3 * inverse2 * wp.sqrt(inverse2) * (1.0 + more)
        total = float(0.0)
        for j in range(wp.static(n_point)):
            begin = psf.start + (row.first + j) * psf.n_column + column.first
            line = float(0.0)
            for i in range(wp.static(n_point)):
                line += column.weights[i] * table[begin + i]
            total += row.weights[j] * line
        return total

    return TableFunctions(axis_type, column_axis, row_axis, share)
