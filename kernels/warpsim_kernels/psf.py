"""Fractions of a point source's light that single pixels collect (pixel fractions), and how wide a stamp has to be.

A pixel integrates the point spread function over its area; sampling at the pixel centre would be wrong by factors
where the blur is smaller than a pixel.
"""

import functools
import math
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.shared_memory import load
from warpsim_kernels.stamps import FAR_PX
from warpsim_kernels.table_layout import TABLE_SIMD_WIDTH

ENVELOPE_STEP_PX = wp.constant(0.25)
"""Step of the radius in TablePsf.envelope, in pixel widths."""

TABLE_POINTS = (2, 4, 6, 8)
"""Points per axis that an interpolation in a table of pixel fractions may use."""

_SQRT_HALF = wp.constant(0.7071067811865476)
_LN2 = wp.constant(0.6931471805599453)
_SQRT_HALF_BITS = wp.constant(wp.uint32(0x3F3504F3))  # float32 bits of sqrt(1/2)
_ONE_MINUS_SQRT_HALF_BITS = wp.constant(wp.uint32(0x004AFB0D))  # bits of 1.0 minus the line above
_MANTISSA_BITS = wp.constant(wp.uint32(0x007FFFFF))


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
def fraction_between(left: wp.vec2, right: wp.vec2) -> float:
    """Fraction of a unit one-dimensional Gaussian between two edges (the paper's Eq. 7, integrated over the pixel)."""
    return 0.5 * ((right[0] - left[0]) + (right[1] - left[1]))


@wp.func
def gaussian_pixel_fraction(offset_px: wp.float64, sigma_px: float) -> float:
    """Fraction of a unit one-dimensional Gaussian inside the pixel whose centre is offset_px from the source."""
    half = wp.float64(0.5)
    return fraction_between(gaussian_edge(offset_px - half, sigma_px), gaussian_edge(offset_px + half, sigma_px))


@wp.func
def natural_log(x: float) -> float:
    """Logarithm of a positive number that is not denormal, to 1e-7; for `wp.log` the CPU calls a library.

    x = 2^e m with m in [sqrt(1/2), sqrt(2)), found by shifting the float's bits; ln m = 2 artanh((m - 1) / (m + 1)).
    """
    bits = wp.cast(x, wp.uint32) + _ONE_MINUS_SQRT_HALF_BITS
    e = float(wp.int32(bits >> wp.uint32(23)) - 127)
    m = wp.cast((bits & _MANTISSA_BITS) + _SQRT_HALF_BITS, wp.float32)
    s = (m - 1.0) / (m + 1.0)
    s2 = s * s
    return e * _LN2 + s * (2.0 + s2 * (0.66666816 + s2 * (0.39974788 + s2 * 0.29925896)))


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
    return sigma_px[0] * wp.sqrt(wp.max(-2.0 * natural_log(cut / highest), 0.0))


@wp.struct
class TablePsf:
    """A point spread function as a table of pixel fractions over the offset (dy, dx), and what lies beyond it.

    The flat array of all bands holds, for each, its fractions and its envelope. All that an interpolation takes for
    TABLE_SIMD_WIDTH pixels next to each other stands together: the table is (n_row, n_block, n_phase,
    TABLE_SIMD_WIDTH), rows being nodes along dy, phases those along dx within a pixel (and some to either side), and
    pixels whole steps of dx.
    """

    start: int  # index of the first fraction in the flat array
    n_row: int
    n_block: int
    block_px: int  # pixels from a block to the next; TABLE_SIMD_WIDTH, or half of it where blocks overlap
    n_phase: int
    column_per_px: int  # nodes per pixel along columns
    row_per_px: int
    zero_row: int  # node of dy = 0
    zero_phase: int  # first node of the interpolation for dx = 0
    zero_pixel: int  # the source's own pixel, counted from the first one of the first block
    mirrored: int  # 1: the pattern is even in dy, and the table holds dy >= 0 only
    reach_column_px: float  # offsets up to here lie inside the table
    reach_row_px: float  # in pixel heights
    pixel_aspect: float  # height of a pixel over its width
    wing_px3: (
        float  # beyond, fraction = wing / r^3 * (1 + (next + aspect * dx^2 / r^2 + last / r^2) / r^2), r in widths
    )
    wing_next_px2: float
    wing_aspect_px2: float
    wing_last_px4: float
    envelope: int  # index of the envelope: largest fraction that a disc of radius 0, 1/4, 1/2 ... does not touch
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
    """Fraction of a pixel beyond the table, at a distance from the source in pixel widths along both axes."""
    x2 = x_px * x_px
    inverse2 = 1.0 / (x2 + y_px * y_px)
    more = (psf.wing_next_px2 + (psf.wing_aspect_px2 * x2 + psf.wing_last_px4) * inverse2) * inverse2
    return psf.wing_px3 * inverse2 * wp.sqrt(inverse2) * (1.0 + more)


class TableFunctions(NamedTuple):
    """Functions that read tables: by an interpolation of n_point x n_point nodes, or by polynomials in cells."""

    Nodes: Any
    """Vector of the floats that TABLE_SIMD_WIDTH pixels take at a time: n_point * TABLE_SIMD_WIDTH of a node row."""

    Offset: Any
    """Struct: offset of a source in its pixel, and its interpolation in a table."""

    Row: Any
    """Struct: a row of its pixels."""

    offset_in: Any
    """(dx_px: float64, dy_px: float64, psf: TablePsf) -> offset; the centre of the source's own pixel minus the source,
    along columns and along rows [pixel heights]. The table serves columns from offset.first_step up to offset.end_step
    pixels from the source's own, rows from offset.first_row_step up to offset.end_row_step."""

    row_in: Any
    """(offset, step: int, psf: TablePsf) -> row that is step pixels from the source's own; row.first is -1 where the
    table does not serve it, row.distance_px the distance of its centre in pixel widths."""

    fractions: Any
    """(nodes, psf: TablePsf, offset, row, block: int) -> fractions of a block's pixels in that row; numbers without
    meaning where the table does not serve. The nodes are the flat array as overlapping vectors, of
    n_point * TABLE_SIMD_WIDTH floats, one from every float on."""

    fraction: Any
    """(table: array of float, psf: TablePsf, offset, row, pixel: int) -> fraction of one pixel, counted from the first
    one of the first block; from the flat array itself."""


@functools.cache
def table_functions(n_point: int) -> TableFunctions:
    """Return the functions that interpolate tables by Lagrange's polynomials through n_point nodes per axis.

    All pixels of a stamp lie alike between the nodes, since there is a whole number of nodes per pixel: the weights are
    those of the source's own pixel, or along dy in a mirrored table, on its other side, the same in reverse.

    Args:
        n_point: 2, 4, 6 or 8, as the tables were built.
    """
    if n_point not in TABLE_POINTS:
        raise ValueError(f"n_point: must be one of {TABLE_POINTS}, got {n_point}")
    n_before = n_point // 2 - 1  # nodes before the cell that holds the point
    PixelVector = wp.types.vector(length=TABLE_SIMD_WIDTH, dtype=wp.float32)
    Nodes = wp.types.vector(length=n_point * TABLE_SIMD_WIDTH, dtype=wp.float32)
    Weights = wp.types.vector(length=n_point, dtype=wp.float32)
    node_numbers = range(-n_before, n_point - n_before)
    scale = Weights(*(1.0 / math.prod(k - j for j in node_numbers if j != k) for k in node_numbers))

    @wp.func
    def lagrange_weights(u: float) -> Weights:
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

    class TableOffset:
        dx_px: float  # of the source's own pixel [pixel widths]
        dy_px: float
        phase: int  # first node of the interpolation along dx
        first_step: int  # columns that the table serves, in pixels from the source's own
        end_step: int
        first_row_step: int  # rows likewise
        end_row_step: int
        across: Weights
        node: int  # the one before dy, counted from dy = 0
        down: Weights
        mirror: int  # the mirror image of dy comes after the node mirror - node
        mirror_down: Weights

    class TableRow:
        distance_px: float
        first: int  # index in the flat array of the interpolation's nodes for the first block
        down: Weights

    offset_type = wp.struct(TableOffset)
    row_type = wp.struct(TableRow)

    @wp.func
    def offset_in(dx_px: wp.float64, dy_px: wp.float64, psf: TablePsf) -> offset_type:
        # In float64 up to the fraction of a cell: P is steep where the source crosses the pixel's edge.
        offset = offset_type()
        offset.dx_px = float(dx_px)
        offset.dy_px = float(dy_px) * psf.pixel_aspect
        position = dx_px * wp.float64(psf.column_per_px)
        node = wp.floor(position)
        offset.across = lagrange_weights(float(position - node))
        offset.phase = psf.zero_phase + int(node)
        # An offset that equals the reach lies beyond it on either side.
        reach_px = wp.float64(psf.reach_column_px)
        offset.first_step = int(wp.floor(-reach_px - dx_px)) + 1
        offset.end_step = int(wp.ceil(reach_px - dx_px))
        reach_px = wp.float64(psf.reach_row_px)
        offset.first_row_step = int(wp.floor(-reach_px - dy_px)) + 1
        offset.end_row_step = int(wp.ceil(reach_px - dy_px))
        position = dy_px * wp.float64(psf.row_per_px)
        node = wp.floor(position)
        offset.node = int(node)
        offset.down = lagrange_weights(float(position - node))
        offset.mirror_down = offset.down
        if position > node:  # else on the node, as its mirror image is
            offset.mirror = -1
            for k in range(wp.static(n_point)):
                offset.mirror_down[k] = offset.down[wp.static(n_point - 1) - k]
        return offset

    @wp.func
    def row_in(offset: offset_type, step: int, psf: TablePsf) -> row_type:
        row = row_type()
        row.distance_px = offset.dy_px + float(step) * psf.pixel_aspect
        row.down = offset.down
        node = offset.node + step * psf.row_per_px
        if psf.mirrored != 0 and node < 0:
            node = offset.mirror - node
            row.down = offset.mirror_down
        n_reach = int(psf.reach_row_px * float(psf.row_per_px))
        row.first = -1
        if node < n_reach and node >= -n_reach:
            first = (node + psf.zero_row - wp.static(n_before)) * psf.n_block * psf.n_phase + offset.phase
            row.first = psf.start + first * TABLE_SIMD_WIDTH
        return row

    @wp.func
    def fractions(nodes: wp.array[Nodes], psf: TablePsf, offset: offset_type, row: row_type, block: int) -> PixelVector:
        at = row.first + block * psf.n_phase * TABLE_SIMD_WIDTH
        total = PixelVector()
        j = int(0)
        while j < wp.static(n_point):  # not unrolled, so that all stays in registers
            near = nodes[at]
            line = offset.across[0] * near[0:TABLE_SIMD_WIDTH]
            for k in range(1, wp.static(n_point)):
                line = (
                    line
                    + offset.across[k] * near[wp.static(TABLE_SIMD_WIDTH * k) : wp.static(TABLE_SIMD_WIDTH * (k + 1))]
                )
            total = total + row.down[j] * line
            at += psf.n_block * psf.n_phase * TABLE_SIMD_WIDTH
            j += 1
        return total

    @wp.func
    def fraction(table: wp.array[float], psf: TablePsf, offset: offset_type, row: row_type, pixel: int) -> float:
        block = pixel // TABLE_SIMD_WIDTH
        at = row.first + (block * psf.n_phase - block) * TABLE_SIMD_WIDTH + pixel
        total = float(0.0)
        for j in range(wp.static(n_point)):
            line = offset.across[0] * load(table, at)
            for k in range(1, wp.static(n_point)):
                line = line + offset.across[k] * load(table, at + TABLE_SIMD_WIDTH * k)
            total = total + row.down[j] * line
            at += psf.n_block * psf.n_phase * TABLE_SIMD_WIDTH
        return total

    return TableFunctions(Nodes, offset_type, row_type, offset_in, row_in, fractions, fraction)
