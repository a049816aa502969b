"""Gradients of images by their sources: sums over a source's stamp of a cotangent image times derivatives.

What `deposit` adds to the pixels of a stamp, a gather reads there: the same stamps, tables and nodes of streaks, and
the derivatives of the same interpolation, so that a gradient is that of the image that was drawn. Each thread owns a
source; nothing is added to memory that another one writes.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.canvas import canvas_functions
from warpsim_kernels.deposit_gaussian import (
    GAUSSIAN_SIMD_WIDTH,
    EdgeTable,
    GaussianTables,
    edge_offset,
)
from warpsim_kernels.deposit_table import pattern_tables
from warpsim_kernels.psf import TABLE_SIMD_WIDTH, TablePsf
from warpsim_kernels.psf_cells import layout_functions
from warpsim_kernels.psf_slopes import RowSpan, Wide, slope_functions, wing_slopes
from warpsim_kernels.stamps import ROUND_FROM_PX, Stamp, Window, columns_of_row, nearest_pixel
from warpsim_kernels.table_layout import TableLayout

AxisWeights = wp.types.matrix(shape=(2, 4), dtype=wp.float64)
Fractions = wp.types.vector(length=GAUSSIAN_SIMD_WIDTH, dtype=wp.float32)

_DENSITY = wp.constant(wp.float64(0.3989422804014327))  # of a unit Gaussian at its middle


class StampFunctions(NamedTuple):
    """Functions of the stamps of one family of point spread functions."""

    Tables: Any
    """Struct: the functions of all bands."""

    gather: Any
    """(canvas, tables, band: int, xy_px, stamp) -> vec4d: the cotangent times pixel fractions, and times their
    derivatives by x, y and the Gaussian's sigma (0 for patterns), summed over a stamp."""

    grid_of: Any
    """(tables, band: int, xy_px) -> how a source lies on the grid of pixels, for all pixels of its stamp."""

    pixel_slopes: Any
    """(tables, band: int, grid, column: int, row: int) -> vec4d: of one pixel, the fraction and its derivatives."""


draw = canvas_functions(TABLE_SIMD_WIDTH)
Images, Canvas, canvas_of = draw.Images, draw.Canvas, draw.canvas_of


@wp.func
def masked(canvas: Canvas, row: int, vector: int, first: int, end: int) -> Wide:
    """The cotangent of pixels of a row from the column `vector` on, 0 but in the elements from first up to end."""
    pixel = canvas.first + row * canvas.n_col + vector
    values = Wide()
    if vector >= 0 and vector + TABLE_SIMD_WIDTH <= canvas.n_col:
        given = canvas.vectors[pixel]
        if first > 0 or end < TABLE_SIMD_WIDTH:
            for i in range(TABLE_SIMD_WIDTH):
                given[i] = wp.where(i >= first and i < end, given[i], 0.0)
        values = Wide(given)
    else:
        for i in range(TABLE_SIMD_WIDTH):
            if i >= first and i < end:
                values[i] = wp.float64(canvas.pixels[pixel + i])
    return values


@functools.cache
def table_stamps(layout: TableLayout) -> StampFunctions:
    """Functions of patterns, by tables of a layout."""
    read, slope, Tables = layout_functions(layout), slope_functions(layout), pattern_tables(layout)
    offset_in, row_in = read.offset_in, read.row_in
    Sums, slopes_in, add_row, totals, slopes_of_pixel = (
        slope.Sums, slope.slopes_in, slope.add_row, slope.totals, slope.pixel,
    )  # fmt: skip

    @wp.func
    def gather_wings(canvas: Canvas, xy_px: wp.vec2d, psf: TablePsf, stamp: Stamp, served: Window) -> wp.vec3d:
        """Pixels of a stamp beyond what the table serves."""
        total = wp.vec3d()
        for row in range(stamp.window.first_row, stamp.window.end_row):
            columns = columns_of_row(stamp, row)
            left = columns[0]
            right = columns[0]
            if row >= served.first_row and row < served.end_row:
                left = wp.clamp(served.first_column, columns[0], columns[1])
                right = wp.clamp(served.end_column, left, columns[1])
            dy = (wp.float64(row) - xy_px[1]) * wp.float64(psf.pixel_aspect)
            column = columns[0]
            while column < columns[1]:
                if column == left:
                    column = right
                if column < columns[1]:
                    pixel = canvas.first + row * canvas.n_col + column
                    slopes = wing_slopes(psf, wp.float64(column) - xy_px[0], dy)
                    total += wp.float64(canvas.pixels[pixel]) * slopes
                column += 1
        return total

    @wp.func
    def gather(canvas: Canvas, tables: Tables, band: int, xy_px: wp.vec2d, stamp: Stamp) -> wp.vec4d:
        total = wp.vec3d()
        if stamp.window.first_row < stamp.window.end_row:
            psf = tables.psfs[band]
            dx_px = wp.float64(stamp.column) - xy_px[0]
            dy_px = wp.float64(stamp.row) - xy_px[1]
            offset = offset_in(dx_px, dy_px, psf)
            slopes = slopes_in(dx_px, dy_px, psf)
            served = Window()
            served.first_column = stamp.column + offset.first_step
            served.end_column = stamp.column + offset.end_step
            served.first_row = stamp.row + offset.first_row_step
            served.end_row = stamp.row + offset.end_row_step
            widest = columns_of_row(stamp, stamp.row)
            zero = stamp.column - psf.zero_pixel
            first_block = (wp.max(widest[0], served.first_column) - zero) // psf.block_px
            window = stamp.window
            sums = Sums()
            for row in range(wp.max(window.first_row, served.first_row), wp.min(window.end_row, served.end_row)):
                columns = columns_of_row(stamp, row)
                left = wp.max(columns[0], served.first_column)
                right = wp.min(columns[1], served.end_column)
                in_row = row_in(offset, row - stamp.row, psf)
                span = RowSpan()
                vector = zero + first_block * psf.block_px
                span.pixel = canvas.first + row * canvas.n_col + vector
                span.first = left - vector
                span.end = right - vector
                step = row - stamp.row
                sums = add_row(sums, canvas.pixels, tables.table, psf, slopes, in_row, step, first_block, span)
            total = totals(sums, slopes)
            within = widest[0] >= served.first_column and widest[1] <= served.end_column
            if not (within and window.first_row >= served.first_row and window.end_row <= served.end_row):
                total += gather_wings(canvas, xy_px, psf, stamp, served)
        return wp.vec4d(total[0], total[1], total[2], wp.float64(0.0))

    @wp.struct
    class Grid:
        xy_px: wp.vec2d
        column: int  # of the pixel that holds the source
        row: int
        offset: read.Offset
        slopes: slope.Slopes

    @wp.func
    def grid_of(tables: Tables, band: int, xy_px: wp.vec2d) -> Grid:
        grid = Grid()
        grid.xy_px = xy_px
        grid.column = nearest_pixel(xy_px[0])
        grid.row = nearest_pixel(xy_px[1])
        dx_px = wp.float64(grid.column) - xy_px[0]
        dy_px = wp.float64(grid.row) - xy_px[1]
        grid.offset = offset_in(dx_px, dy_px, tables.psfs[band])
        grid.slopes = slopes_in(dx_px, dy_px, tables.psfs[band])
        return grid

    @wp.func
    def pixel_slopes(tables: Tables, band: int, grid: Grid, column: int, row: int) -> wp.vec4d:
        psf = tables.psfs[band]
        row_step = row - grid.row
        in_row = row_in(grid.offset, row_step, psf)
        step = column - grid.column
        found = wp.vec3d()
        if in_row.first < 0 or step < grid.offset.first_step or step >= grid.offset.end_step:
            dx, dy = wp.float64(column) - grid.xy_px[0], wp.float64(row) - grid.xy_px[1]
            found = wing_slopes(psf, dx, dy * wp.float64(psf.pixel_aspect))
        else:
            found = slopes_of_pixel(tables.table, psf, grid.slopes, in_row, row_step, psf.zero_pixel + step)
        return wp.vec4d(found[0], found[1], found[2], wp.float64(0.0))

    return StampFunctions(Tables, gather, grid_of, pixel_slopes)


@wp.func
def axis_weights(u: wp.float64) -> AxisWeights:
    """Weights of the four rows of an edge table, as `axis_fractions` has them, and their derivatives by u."""
    sixth = wp.float64(1.0) / wp.float64(6.0)
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    three = wp.float64(3.0)
    u2 = u * u
    weights = AxisWeights()
    weights[0, 0] = -u * (u - one) * (u - two) * sixth
    weights[0, 1] = (u + one) * (u - one) * (u - two) * half
    weights[0, 2] = -(u + one) * u * (u - two) * half
    weights[0, 3] = (u + one) * u * (u - one) * sixth
    weights[1, 0] = -(three * u2 - wp.float64(6.0) * u + two) * sixth
    weights[1, 1] = (three * u2 - two * two * u - one) * half
    weights[1, 2] = -(three * u2 - two * u - two) * half
    weights[1, 3] = (three * u2 - one) * sixth
    return weights


@wp.struct
class EdgeSlopes:
    """A source between the rows of an edge table, in float64."""

    start: int  # as of EdgeOffset
    weights: AxisWeights  # of the rows about it, and their derivatives by its position


@wp.func
def edge_slopes(table: EdgeTable, source_px: wp.float64) -> EdgeSlopes:
    """Return where a source stands along one axis."""
    slopes = EdgeSlopes()
    slopes.start = edge_offset(table, source_px).start
    per_px = wp.float64(table.per_px)
    position = (wp.floor(source_px + wp.float64(1.0)) - wp.float64(0.5) - source_px) * per_px
    clamped = wp.clamp(position, -wp.float64(table.n_step), wp.float64(table.n_step))
    slopes.weights = axis_weights(clamped - wp.floor(clamped))
    for k in range(4):
        if clamped != position:  # beyond the table fractions stay the same
            slopes.weights[1, k] = wp.float64(0.0)
        else:
            slopes.weights[1, k] = -per_px * slopes.weights[1, k]
    return slopes


@wp.struct
class AxisValues:
    """Pixel fractions next to each other along one axis, and their derivatives by the source's position."""

    value: Wide
    slope: Wide


@wp.func
def axis_values(fractions: wp.array[Fractions], table: EdgeTable, slopes: EdgeSlopes, first: int) -> AxisValues:
    """Return those from the first on."""
    at = slopes.start + first
    result = AxisValues()
    for k in range(4):
        near = fractions[at + (k - 1) * table.n_pixel]
        row = Wide(near[0:TABLE_SIMD_WIDTH])
        result.value = result.value + slopes.weights[0, k] * row
        result.slope = result.slope + slopes.weights[1, k] * row
    return result


@wp.func
def density_slope(z: wp.float64) -> wp.float64:
    """The density of a unit Gaussian at z, times z: by how much less than z lies as sigma grows, times sigma."""
    return z * _DENSITY * wp.exp(-wp.float64(0.5) * z * z)


@wp.func
def by_sigma(sigma_px: float, source_px: wp.float64, first: int) -> Wide:
    """Derivatives of pixel fractions by the logarithm of sigma, in closed form; tables are of one sigma."""
    values = Wide()
    sigma = wp.float64(sigma_px)
    before = density_slope((wp.float64(first) - wp.float64(0.5) - source_px) / sigma)
    for i in range(TABLE_SIMD_WIDTH):
        after = density_slope((wp.float64(first + i) + wp.float64(0.5) - source_px) / sigma)
        values[i] = before - after
        before = after
    return values


@wp.struct
class GaussianGrid:
    """How a source lies on the grid of pixels."""

    xy_px: wp.vec2d
    across: EdgeSlopes
    down: EdgeSlopes


@functools.cache
def gaussian_stamps(with_sigma: bool) -> StampFunctions:
    """Functions of Gaussians; derivatives by sigma are 0 unless asked for."""

    @wp.func
    def gather(canvas: Canvas, tables: GaussianTables, band: int, xy_px: wp.vec2d, stamp: Stamp) -> wp.vec4d:
        """Rows are summed first, each weighted: their columns have the same fractions."""
        psf = tables.psfs[band]
        fractions = tables.fractions
        widest = columns_of_row(stamp, stamp.row)
        across_at = edge_slopes(psf.columns, xy_px[0])
        down_at = edge_slopes(psf.rows, xy_px[1])
        is_round = stamp.reach_px > ROUND_FROM_PX
        total = wp.vec4d()
        first = widest[0]
        while first < widest[1] and stamp.window.first_row < stamp.window.end_row:
            vector = wp.min(first, canvas.n_col - TABLE_SIMD_WIDTH)  # not over the end of the row, if it is long enough
            end = wp.min(vector + TABLE_SIMD_WIDTH, widest[1])
            value = Wide()
            slope = Wide()
            wider = Wide()
            is_whole = not is_round and vector >= 0  # pixels beside the stamp are read, too, and left out at the end
            row = stamp.window.first_row
            while row < stamp.window.end_row:
                above = row
                down = axis_values(fractions, psf.rows, down_at, above)
                down_wider = Wide()
                if wp.static(with_sigma):
                    down_wider = by_sigma(psf.sigma_px[1], xy_px[1], above)
                while row < wp.min(above + TABLE_SIMD_WIDTH, stamp.window.end_row):
                    left = first
                    right = end
                    if is_round:
                        columns = columns_of_row(stamp, row)
                        left = wp.max(columns[0], first)
                        right = wp.min(columns[1], end)
                    if left < right:
                        cotangent = Wide()
                        if is_whole:
                            cotangent = Wide(canvas.vectors[canvas.first + row * canvas.n_col + vector])
                        else:
                            cotangent = masked(canvas, row, vector, left - vector, right - vector)
                        value = value + down.value[row - above] * cotangent
                        slope = slope + down.slope[row - above] * cotangent
                        if wp.static(with_sigma):
                            wider = wider + down_wider[row - above] * cotangent
                    row += 1
            across = axis_values(fractions, psf.columns, across_at, vector)
            for i in range(TABLE_SIMD_WIDTH):
                inside = i >= first - vector and i < end - vector
                value[i] = wp.where(inside, value[i], wp.float64(0.0))
                slope[i] = wp.where(inside, slope[i], wp.float64(0.0))
                if wp.static(with_sigma):
                    wider[i] = wp.where(inside, wider[i], wp.float64(0.0))
            total += wp.vec4d(
                wp.dot(value, across.value), wp.dot(value, across.slope), wp.dot(slope, across.value), wp.float64(0.0)
            )
            if wp.static(with_sigma):
                more = wp.dot(value, by_sigma(psf.sigma_px[0], xy_px[0], vector)) + wp.dot(wider, across.value)
                total[3] += more / wp.float64(psf.sigma_px[0])
            first = end
        return total

    @wp.func
    def grid_of(tables: GaussianTables, band: int, xy_px: wp.vec2d) -> GaussianGrid:
        psf = tables.psfs[band]
        grid = GaussianGrid()
        grid.xy_px = xy_px
        grid.across = edge_slopes(psf.columns, xy_px[0])
        grid.down = edge_slopes(psf.rows, xy_px[1])
        return grid

    @wp.func
    def pixel_slopes(tables: GaussianTables, band: int, grid: GaussianGrid, column: int, row: int) -> wp.vec4d:
        psf = tables.psfs[band]
        columns = axis_values(tables.fractions, psf.columns, grid.across, column)
        rows = axis_values(tables.fractions, psf.rows, grid.down, row)
        across = columns.value[0]
        down = rows.value[0]
        wider = wp.float64(0.0)
        if wp.static(with_sigma):
            wider = by_sigma(psf.sigma_px[0], grid.xy_px[0], column)[0] * down
            wider = (wider + across * by_sigma(psf.sigma_px[1], grid.xy_px[1], row)[0]) / wp.float64(psf.sigma_px[0])
        return wp.vec4d(columns.value[0] * down, columns.slope[0] * down, across * rows.slope[0], wider)

    return StampFunctions(GaussianTables, gather, grid_of, pixel_slopes)
