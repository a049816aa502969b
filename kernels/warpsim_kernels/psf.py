"""Shares of a point source's light that single pixels collect, and how wide a stamp has to be.

A pixel integrates the point spread function over its area; sampling at the pixel centre would be wrong by factors
where the blur is smaller than a pixel.
"""

import functools
import math
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.stamps import FAR_PX

ENVELOPE_STEP_PX = wp.constant(0.25)
"""Step of the radius in TablePsf.envelope, in pixel widths."""

TABLE_POINTS = (2, 4, 6, 8)
"""Points per axis that an interpolation in a table of shares may use."""

_SQRT_HALF = wp.constant(0.7071067811865476)


@wp.func
def gaussian_edge(offset_px: wp.float64, sigma_px: float) -> wp.vec2:
    """Error function of a pixel edge offset_px from the source, as a whole number and a rest that keeps its digits.

    Away from the source the rest is the complementary error function, so that tails do not cancel.
    """
    z = float(offset_px) * (_SQRT_HALF / sigma_px)
    if wp.abs(z) <= 0.5:
        return wp.vec2(0.0, wp.erf(z))
    rest = wp.erfc(wp.abs(z))
    if z > 0.0:
        return wp.vec2(1.0, -rest)
    return wp.vec2(-1.0, rest)


@wp.func
def share_between(left: wp.vec2, right: wp.vec2) -> float:
    """Part of a unit one-dimensional Gaussian between two edges (the paper's Eq. 7, integrated over the pixel)."""
    return 0.5 * ((right[0] - left[0]) + (right[1] - left[1]))


@wp.func
def gaussian_pixel_share(offset_px: wp.float64, sigma_px: float) -> float:
    """Part of a unit one-dimensional Gaussian inside the pixel whose centre is offset_px from the source."""
    half = wp.float64(0.5)
    return share_between(gaussian_edge(offset_px - half, sigma_px), gaussian_edge(offset_px + half, sigma_px))


@wp.func
def gaussian_reach_px(sigma_px: wp.vec2, cut: float) -> float:
    """Radius of the disc about a source without which no pixel holds more than the fraction `cut` of the flux.

    A pixel that begins at a distance d holds less than exp(-d^2 / 2 sigma^2) times 1/2, and times the peak.

    Args:
        sigma_px: Along columns [pixel widths] and along rows [pixel heights].
        cut: Fraction of the flux.
    """
    highest = wp.min(0.5, wp.static(0.5 / math.pi) / (sigma_px[0] * sigma_px[1]))
    if cut >= highest:
        return 0.0
    return sigma_px[0] * wp.sqrt(-2.0 * wp.log(cut / highest))


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
    wing_px3: float  # beyond, share = wing / r^3 * (1 + (next + aspect * dx^2 / r^2 + last / r^2) / r^2), r in widths
    wing_next_px2: float
    wing_aspect_px2: float
    wing_last_px4: float
    envelope: int  # where the envelope begins: largest share that a disc of radius 0, 1/4, 1/2 ... does not touch
    n_envelope: int
    tail_px3: float  # farther out no pixel holds more than tail / r^3, r = distance of its centre; 0: nothing


@wp.func
def table_reach_px(table: wp.array[float], psf: TablePsf, cut: float) -> float:
    """Radius of the disc about a source without which no pixel holds more than the fraction `cut` of the flux.

    In pixel widths. A pixel belongs to the disc if any part of it does.
    """
    last = psf.n_envelope - 1
    if table[psf.envelope + last] > cut:
        # The centre of a pixel that the disc does not touch is half its shorter side farther away, at least.
        reach = wp.pow(psf.tail_px3 / cut, wp.static(1.0 / 3.0)) - 0.5 * wp.min(psf.pixel_aspect, 1.0)
        return wp.clamp(reach, float(last) * ENVELOPE_STEP_PX, FAR_PX)
    low = int(-1)
    high = last
    while high - low > 1:
        middle = (low + high) // 2
        if table[psf.envelope + middle] > cut:
            low = middle
        else:
            high = middle
    return float(high) * ENVELOPE_STEP_PX


@wp.func
def table_wing(psf: TablePsf, x_px: float, y_px: float) -> float:
    """Share of a pixel beyond the table, at a distance from the source in pixel widths along both axes."""
    x2 = x_px * x_px
    inverse2 = 1.0 / (x2 + y_px * y_px)
    more = (psf.wing_next_px2 + (psf.wing_aspect_px2 * x2 + psf.wing_last_px4) * inverse2) * inverse2
    return psf.wing_px3 * inverse2 * wp.sqrt(inverse2) * (1.0 + more)


class TableFunctions(NamedTuple):
    """What a kernel needs to read tables by an interpolation of n_point x n_point nodes."""

    n_lane: int
    """Numbers that one load takes from a row of the table; n_point, or some that have the weight 0 besides.

    The table comes as an array of vectors of n_lane floats that overlap: one begins at every float.
    """

    column_axis: Any
    """(dx_px: float64, psf: TablePsf) -> axis; dx_px = centre of the source's own pixel minus the source, columns."""

    row_axis: Any
    """(dy_px: float64, psf: TablePsf) -> axis; the same along rows [pixel heights]."""

    column_nodes: Any
    """(axis, step: int, psf: TablePsf) -> nodes of the column that is step pixels from the source's own."""

    row_nodes: Any
    """(axis, step: int, psf: TablePsf) -> nodes of the row that is step pixels from the source's own."""

    share: Any
    """(table, psf: TablePsf, row: nodes, column: nodes) -> share of the pixel in that row and column."""


@functools.cache
def table_functions(n_point: int) -> TableFunctions:
    """The functions that interpolate tables by Lagrange's polynomials through n_point nodes per axis.

    All pixels of a stamp lie alike between the nodes, since there is a whole number of nodes per pixel: the weights are
    those of the source's own pixel, or in a mirrored table, on its other side, the same in reverse.

    Args:
        n_point: 2, 4, 6 or 8, as the tables were built.
    """
    if n_point not in TABLE_POINTS:
        raise ValueError(f"n_point: must be one of {TABLE_POINTS}, got {n_point}")
    n_before = n_point // 2 - 1  # nodes before the cell that holds the point
    n_lane = 8 if n_point == 6 else n_point  # a power of 2 loads as one vector
    Lanes = wp.types.vector(length=n_lane, dtype=wp.float32)
    places = range(-n_before, n_point - n_before)
    scale = Lanes(*(1.0 / math.prod(k - j for j in places if j != k) for k in places), *[0.0] * (n_lane - n_point))

    @wp.func
    def lagrange_weights(u: float) -> Lanes:
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
        offset_px: float  # of the source's own pixel [pixel widths]
        node: int  # the one before that offset, counted from offset zero
        weights: Lanes
        mirror: int  # the offset's mirror image comes after the node mirror - node
        mirror_weights: Lanes

    class TableNodes:
        distance_px: float  # from the source, in pixel widths
        first: int  # first of the nodes; -1 beyond the table
        weights: Lanes

    axis_type = wp.struct(TableAxis)
    nodes_type = wp.struct(TableNodes)

    @wp.func
    def axis(offset_px: wp.float64, per_px: int) -> axis_type:
        # In float64 up to the fraction of a cell: P is steep where the source crosses the pixel's edge.
        position = offset_px * wp.float64(per_px)
        node = wp.floor(position)
        result = axis_type()
        result.node = int(node)
        result.weights = lagrange_weights(float(position - node))
        result.mirror_weights = result.weights
        if position > node:  # else on the node, as its mirror image is
            result.mirror = -1
            for k in range(wp.static(n_point)):
                result.mirror_weights[k] = result.weights[wp.static(n_point - 1) - k]
        return result

    @wp.func
    def column_axis(dx_px: wp.float64, psf: TablePsf) -> axis_type:
        result = axis(dx_px, psf.column_per_px)
        result.offset_px = float(dx_px)
        return result

    @wp.func
    def row_axis(dy_px: wp.float64, psf: TablePsf) -> axis_type:
        result = axis(dy_px, psf.row_per_px)
        result.offset_px = float(dy_px) * psf.pixel_aspect
        return result

    @wp.func
    def nodes(axis: axis_type, steps: int, mirrored: int, zero: int, n_reach: int) -> nodes_type:
        result = nodes_type()
        result.weights = axis.weights
        node = axis.node + steps
        if mirrored != 0 and node < 0:
            node = axis.mirror - node
            result.weights = axis.mirror_weights
        result.first = node + zero - wp.static(n_before)
        if node >= n_reach or node < -n_reach:
            result.first = -1
        return result

    @wp.func
    def column_nodes(axis: axis_type, step: int, psf: TablePsf) -> nodes_type:
        n_reach = int(psf.reach_column_px * float(psf.column_per_px))
        result = nodes(axis, step * psf.column_per_px, psf.mirrored, psf.zero_column, n_reach)
        result.distance_px = axis.offset_px + float(step)
        return result

    @wp.func
    def row_nodes(axis: axis_type, step: int, psf: TablePsf) -> nodes_type:
        n_reach = int(psf.reach_row_px * float(psf.row_per_px))
        result = nodes(axis, step * psf.row_per_px, psf.mirrored, psf.zero_row, n_reach)
        result.distance_px = axis.offset_px + float(step) * psf.pixel_aspect
        return result

    @wp.func
    def share(table: wp.array[Lanes], psf: TablePsf, row: nodes_type, column: nodes_type) -> float:
        if wp.min(row.first, column.first) < 0:
            return table_wing(psf, column.distance_px, row.distance_px)
        begin = psf.start + row.first * psf.n_column + column.first
        line = row.weights[0] * table[begin]
        for j in range(1, wp.static(n_point)):
            line += row.weights[j] * table[begin + j * psf.n_column]
        part = wp.cw_mul(line, column.weights)
        total = part[0] + part[1]
        for k in range(1, wp.static(n_point // 2)):
            total += part[2 * k] + part[2 * k + 1]
        return total

    return TableFunctions(n_lane, column_axis, row_axis, column_nodes, row_nodes, share)
