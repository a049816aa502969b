"""Stage deposit for Gaussian images.

One thread owns a block of rows of one image and adds, in the order of the source list, every source whose stamp reaches
them. No two threads touch a pixel and the order of additions never changes, so images are bit-identical on any thread
count; the CPU uses one block per image, CUDA a block per few rows.
"""

import functools

import warp as wp

from warpsim_kernels.canvas import canvas_functions
from warpsim_kernels.psf import gaussian_reach_px
from warpsim_kernels.records import Sources
from warpsim_kernels.stamps import (
    ROUND_FROM_PX,
    Stamp,
    StampRule,
    block_window,
    columns_of_row,
    stamp_around,
    stamp_cut,
)
from warpsim_kernels.streaks import NO_LIMIT, Blur, Paths, StreakRules, is_streak_near, moment_of, source_of, streak_of

GAUSSIAN_SIMD_WIDTH = 16
"""Pixels that are drawn at a time."""

PixelVector, Images, Canvas, canvas_of, mask_between, add_light, flag_strips = canvas_functions(GAUSSIAN_SIMD_WIDTH)


@wp.struct
class EdgeTable:
    """Pixel fractions next to each other along one axis, over the offset of the pixel edge nearest to the source.

    Rows of n_pixel fractions, one for every 1 / per_px of offset; beyond n_step of them on either side they stay the
    same.
    """

    start: int  # of the row of offset 0, at the pixel after that edge, in the flat array
    n_pixel: int
    n_step: int
    per_px: float


@wp.struct
class GaussianPsf:
    """A Gaussian: its width and its tables."""

    sigma_px: wp.vec2  # along columns [pixel widths] and along rows [pixel heights]
    columns: EdgeTable
    rows: EdgeTable


@wp.struct
class GaussianTables:
    """The Gaussians of all bands."""

    psfs: wp.array[GaussianPsf]  # (n_band,)
    fractions: wp.array[PixelVector]  # mask_table and the tables of all bands, flat, with a vector from every float on


@wp.func
def gaussian_blur(sigma_px: wp.vec2) -> Blur:
    """Width and shape that decide the count of a streak's nodes."""
    blur = Blur()
    blur.width_px = sigma_px[0]
    blur.band_limit_per_px = NO_LIMIT
    blur.aspect = sigma_px[0] / sigma_px[1]
    return blur


@wp.struct
class EdgeOffset:
    """Offset of a source between the rows of an edge table."""

    start: int  # of the row before it in the flat array, for pixel 0 of the image
    u: float  # part of the way to the next row


@wp.func
def edge_offset(table: EdgeTable, source_px: wp.float64) -> EdgeOffset:
    """Return the offset of a source along one axis."""
    pixel = wp.floor(source_px + wp.float64(1.0))
    offset_px = pixel - wp.float64(0.5) - source_px
    position = offset_px * wp.float64(table.per_px)
    position = wp.clamp(position, -wp.float64(table.n_step), wp.float64(table.n_step))
    node = wp.floor(position)
    offset = EdgeOffset()
    offset.u = float(position - node)
    offset.start = table.start + int(node) * table.n_pixel - int(pixel)
    return offset


@wp.func
def axis_fractions(fractions: wp.array[PixelVector], table: EdgeTable, offset: EdgeOffset, first: int) -> PixelVector:
    """Pixel fractions from the first on, along one axis: cubic interpolation between four rows of the table."""
    at = offset.start + first
    u = offset.u
    # Newton's form: differences of neighbouring rows are small and hardly add rounding.
    here = fractions[at]
    after = fractions[at + table.n_pixel]
    step = after - here
    bend = step - (here - fractions[at - table.n_pixel])
    twist = (fractions[at + 2 * table.n_pixel] - after) - step - bend
    return here + u * (step + (0.5 * (u - 1.0)) * (bend + ((u + 1.0) * wp.static(1.0 / 3.0)) * twist))


@wp.func
def add_gaussian_stamp(
    canvas: Canvas, xy_px: wp.vec2d, strength: float, psf: GaussianPsf, fractions: wp.array[PixelVector], stamp: Stamp
):
    """The Gaussian separates: a row of the stamp is the fractions of its columns times that of the row."""
    widest = columns_of_row(stamp, stamp.row)
    across_offset = edge_offset(psf.columns, xy_px[0])
    down_offset = edge_offset(psf.rows, xy_px[1])
    is_round = stamp.reach_px > ROUND_FROM_PX
    first = widest[0]
    while first < widest[1] and stamp.window.first_row < stamp.window.end_row:
        vector = wp.min(first, canvas.n_col - GAUSSIAN_SIMD_WIDTH)  # not over the end of the row, if it is long enough
        end = wp.min(vector + GAUSSIAN_SIMD_WIDTH, widest[1])
        across = axis_fractions(fractions, psf.columns, across_offset, vector)
        across = strength * wp.cw_mul(across, mask_between(fractions, first - vector, end - vector))
        row = stamp.window.first_row
        while row < stamp.window.end_row:
            above = row
            down = axis_fractions(fractions, psf.rows, down_offset, above)
            while row < wp.min(above + GAUSSIAN_SIMD_WIDTH, stamp.window.end_row):
                light = down[row - above] * across
                if is_round:
                    columns = columns_of_row(stamp, row)
                    left = wp.max(columns[0], first)
                    right = wp.min(columns[1], end)
                    if left < right:
                        light = wp.cw_mul(light, mask_between(fractions, left - vector, right - vector))
                        add_light(canvas, row, vector, light, left - vector, right - vector)
                        flag_strips(canvas, row, left, right)
                else:
                    add_light(canvas, row, vector, light, first - vector, end - vector)
                    flag_strips(canvas, row, first, end)
                row += 1
        first = end


@functools.cache
def make_deposit_gaussian_kernel(streaks: bool) -> wp.Kernel:
    """Kernel of the stage; without streaks it looks at no paths."""

    @wp.kernel(module="unique", enable_backward=False)
    def deposit_gaussian_kernel(
        # in
        sources: Sources,  # n_source, xy_px, irradiance_w_cm2
        tables: GaussianTables,
        rule: StampRule,
        paths: Paths,
        rules: StreakRules,
        # out (accumulated)
        images: Images,  # of all views and bands
    ):
        view, band, block = wp.tid()
        canvas = canvas_of(images, view * tables.psfs.shape[0] + band)
        window = block_window(images.n_row, images.n_col, block, images.n_row_per_block)
        psf = tables.psfs[band]
        fractions = tables.fractions
        sigma = psf.sigma_px
        aspect = sigma[0] / sigma[1]
        for slot in range(sources.n_source[view]):
            irradiance = sources.irradiance_w_cm2[view, band, slot]
            if irradiance == 0.0:
                continue
            xy_px = sources.xy_px[view, slot]
            cut = stamp_cut(irradiance, band, rule)
            reach_px = gaussian_reach_px(sigma, cut)
            if wp.static(streaks):
                source = source_of(view, band, slot, xy_px, irradiance)
                if is_streak_near(paths, source, reach_px, aspect, window):
                    error = wp.max(cut, rule.streak_error)
                    streak = streak_of(paths, source, error, NO_LIMIT, gaussian_blur(sigma), rules)
                    for panel in range(streak.n_panel):
                        for node in range(streak.count):
                            moment = moment_of(paths, source, streak, panel, node, rules)
                            stamp = stamp_around(moment.xy_px, reach_px, aspect, window)
                            add_gaussian_stamp(canvas, moment.xy_px, moment.irradiance_w_cm2, psf, fractions, stamp)
            else:
                stamp = stamp_around(xy_px, reach_px, aspect, window)
                add_gaussian_stamp(canvas, xy_px, irradiance, psf, fractions, stamp)

    return deposit_gaussian_kernel
