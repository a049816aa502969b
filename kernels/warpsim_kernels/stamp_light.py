"""Fraction of a source's light within its stamp, from which truth reports left-out light."""

import functools
import math
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.deposit_gaussian import GaussianTables, gaussian_blur
from warpsim_kernels.deposit_table import pattern_tables
from warpsim_kernels.psf import (
    TABLE_SIMD_WIDTH,
    TablePsf,
    fraction_between,
    gaussian_edge,
    gaussian_pixel_fraction,
    gaussian_reach_px,
    table_reach_px,
    table_wing,
)
from warpsim_kernels.psf_cells import layout_functions
from warpsim_kernels.stamps import (
    Stamp,
    StampRule,
    Window,
    columns_of_row,
    nearest_pixel,
    stamp_around,
    stamp_cut,
    whole_plane,
)
from warpsim_kernels.streaks import NO_LIMIT, Blur, Paths, StreakRules, moment_of, source_of, streak_of
from warpsim_kernels.table_layout import TableLayout

N_CORE = wp.constant(32)
"""Pixels to each side of a source, at least, that are summed one by one; farther out light is smooth."""

N_ROW = wp.constant(1024.0)
"""Reach up to which a stamp is summed by rows; farther out it is as good as a disc [px]."""

GAUSS_NODE = wp.constant(wp.vec4(0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263))
GAUSS_WEIGHT = wp.constant(wp.vec4(0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693))
"""Gauss-Legendre rule on [0, 1]."""


class LightFunctions(NamedTuple):
    """Functions that sum the light of sources of one family of point spread functions."""

    Tables: Any
    """Struct: the functions of all bands."""

    reach_of: Any
    """(tables, band: int, cut: float) -> reach of the stamp [px]."""

    aspect_of: Any
    """(tables, band: int) -> reach along columns over that along rows."""

    blur_of: Any
    """(tables, band: int) -> Blur."""

    pixel_fraction: Any
    """(tables, band: int, xy_px, column: int, row: int) -> fraction of a pixel of a source."""

    stamp_fraction: Any
    """(tables, band: int, xy_px, reach_px: float) -> fraction of a source's light in its stamp."""


@functools.cache
def gaussian_light() -> LightFunctions:
    """Functions of Gaussians."""

    @wp.func
    def reach_of(tables: GaussianTables, band: int, cut: float) -> float:
        return gaussian_reach_px(tables.psfs[band].sigma_px, cut)

    @wp.func
    def aspect_of(tables: GaussianTables, band: int) -> float:
        return tables.psfs[band].sigma_px[0] / tables.psfs[band].sigma_px[1]

    @wp.func
    def blur_of(tables: GaussianTables, band: int) -> Blur:
        return gaussian_blur(tables.psfs[band].sigma_px)

    @wp.func
    def pixel_fraction(tables: GaussianTables, band: int, xy_px: wp.vec2d, column: int, row: int) -> wp.float64:
        sigma_px = tables.psfs[band].sigma_px
        across = gaussian_pixel_fraction(wp.float64(column) - xy_px[0], sigma_px[0])
        return wp.float64(across) * wp.float64(gaussian_pixel_fraction(wp.float64(row) - xy_px[1], sigma_px[1]))

    @wp.func
    def stamp_fraction(tables: GaussianTables, band: int, xy_px: wp.vec2d, reach_px: float) -> wp.float64:
        """Row by row."""
        half = wp.float64(0.5)
        sigma_px = tables.psfs[band].sigma_px
        stamp = stamp_around(xy_px, reach_px, aspect_of(tables, band), whole_plane())
        total = wp.float64(0.0)
        for row in range(stamp.window.first_row, stamp.window.end_row):
            columns = columns_of_row(stamp, row)
            left = gaussian_edge(wp.float64(columns[0]) - half - xy_px[0], sigma_px[0])
            right = gaussian_edge(wp.float64(columns[1]) - half - xy_px[0], sigma_px[0])
            row_fraction = gaussian_pixel_fraction(wp.float64(row) - xy_px[1], sigma_px[1])
            total += wp.float64(row_fraction) * wp.float64(fraction_between(left, right))
        return total

    return LightFunctions(GaussianTables, reach_of, aspect_of, blur_of, pixel_fraction, stamp_fraction)


@wp.func
def smooth_fraction(psf: TablePsf, near_px: float, far_px: float, down_px: float) -> wp.float64:
    """Sum of the fractions of a row's pixels from one distance along it to another, both edges of pixels on one side.

    Beyond the table the sum is the integral, which is taken over stretches that grow with the distance.
    """
    total = float(0.0)
    start = near_px
    while start < far_px:
        width = wp.min(wp.max(start, wp.abs(down_px)), far_px - start)
        part = float(0.0)
        for k in range(4):
            part += GAUSS_WEIGHT[k] * table_wing(psf, start + width * GAUSS_NODE[k], down_px)
        total += width * part
        start += wp.max(width, 1.0e-3)
    return wp.float64(total)


@wp.func
def core_of(psf: TablePsf, stamp: Stamp) -> Window:
    """The pixels about a source that the table serves, and some more."""
    n_column = wp.max(int(psf.reach_column_px) + 2, N_CORE)
    n_row = wp.max(int(psf.reach_row_px) + 2, N_CORE)
    core = Window()
    core.first_column = stamp.column - n_column
    core.end_column = stamp.column + n_column + 1
    core.first_row = stamp.row - n_row
    core.end_row = stamp.row + n_row + 1
    return core


@functools.cache
def table_light(layout: TableLayout) -> LightFunctions:
    """Functions of patterns, by tables of a layout."""
    read, Tables = layout_functions(layout), pattern_tables(layout)
    Nodes, offset_in, row_in, pixel_fractions = read.Nodes, read.offset_in, read.row_in, read.fractions

    @wp.func
    def reach_of(tables: Tables, band: int, cut: float) -> float:
        return table_reach_px(tables.table, tables.psfs[band], cut)

    @wp.func
    def aspect_of(tables: Tables, band: int) -> float:
        return tables.psfs[band].pixel_aspect

    @wp.func
    def blur_of(tables: Tables, band: int) -> Blur:
        return tables.blurs[band]

    @wp.func
    def pixel_fraction(tables: Tables, band: int, xy_px: wp.vec2d, column: int, row: int) -> wp.float64:
        psf = tables.psfs[band]
        own_column = nearest_pixel(xy_px[0])
        own_row = nearest_pixel(xy_px[1])
        offset = offset_in(wp.float64(own_column) - xy_px[0], wp.float64(own_row) - xy_px[1], psf)
        in_row = row_in(offset, row - own_row, psf)
        step = column - own_column
        if in_row.first < 0 or step < offset.first_step or step >= offset.end_step:
            return wp.float64(table_wing(psf, offset.dx_px + float(step), in_row.distance_px))
        block = (psf.zero_pixel + step) // psf.block_px
        found = pixel_fractions(tables.nodes, psf, offset, in_row, block)
        return wp.float64(found[psf.zero_pixel + step - block * psf.block_px])

    @wp.func
    def core_fraction(nodes: wp.array[Nodes], psf: TablePsf, xy_px: wp.vec2d, stamp: Stamp, core: Window) -> wp.float64:
        """Fraction of a source's light in the pixels of its stamp within a window, one by one."""
        offset = offset_in(wp.float64(stamp.column) - xy_px[0], wp.float64(stamp.row) - xy_px[1], psf)
        zero = stamp.column - psf.zero_pixel
        total = wp.float64(0.0)
        for row in range(wp.max(stamp.window.first_row, core.first_row), wp.min(stamp.window.end_row, core.end_row)):
            in_row = row_in(offset, row - stamp.row, psf)
            columns = columns_of_row(stamp, row)
            column = wp.max(columns[0], core.first_column)
            end = wp.min(columns[1], core.end_column)
            while column < end:
                step = column - stamp.column
                if in_row.first < 0 or step < offset.first_step or step >= offset.end_step:
                    total += wp.float64(table_wing(psf, offset.dx_px + float(step), in_row.distance_px))
                    column += 1
                else:
                    block = (column - zero) // psf.block_px
                    found = pixel_fractions(nodes, psf, offset, in_row, block)
                    vector = zero + block * psf.block_px
                    last = wp.min(wp.min(vector + TABLE_SIMD_WIDTH, stamp.column + offset.end_step), end)
                    while column < last:
                        total += wp.float64(found[column - vector])
                        column += 1
        return total

    @wp.func
    def stamp_fraction(tables: Tables, band: int, xy_px: wp.vec2d, reach_px: float) -> wp.float64:
        """Pixel by pixel within the table, then by rows, then as a ring."""
        psf = tables.psfs[band]
        stamp = stamp_around(xy_px, wp.min(reach_px, N_ROW), psf.pixel_aspect, whole_plane())
        core = core_of(psf, stamp)
        total = core_fraction(tables.nodes, psf, xy_px, stamp, core)
        if psf.wing_px3 == 0.0:
            return total
        for row in range(stamp.window.first_row, stamp.window.end_row):
            columns = columns_of_row(stamp, row)
            left_px = float(xy_px[0] - wp.float64(columns[0])) + 0.5
            right_px = float(wp.float64(columns[1]) - xy_px[0]) - 0.5
            from_left_px = float(0.0)
            from_right_px = float(0.0)
            if row >= core.first_row and row < core.end_row:
                from_left_px = float(xy_px[0] - wp.float64(core.first_column)) + 0.5
                from_right_px = float(wp.float64(core.end_column) - xy_px[0]) - 0.5
            down_px = float(wp.float64(row) - xy_px[1]) * psf.pixel_aspect
            total += smooth_fraction(psf, from_left_px, left_px, down_px)
            total += smooth_fraction(psf, from_right_px, right_px, down_px)
        if reach_px > N_ROW:
            ring = psf.wing_px3 / psf.pixel_aspect * wp.static(2.0 * math.pi) * (1.0 / N_ROW - 1.0 / reach_px)
            total += wp.float64(ring)
        return total

    return LightFunctions(Tables, reach_of, aspect_of, blur_of, pixel_fraction, stamp_fraction)


@functools.cache
def make_light_kernel(light: LightFunctions, streaks: bool) -> wp.Kernel:
    """Kernel for one family; without streaks it looks at no paths."""
    Tables, reach_of, _, blur_of, pixel_fraction, stamp_fraction = light

    @wp.kernel(module="unique", enable_backward=False)
    def light_kernel(
        # in
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
        source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
        tables: Tables,
        rule: StampRule,
        paths: Paths,
        rules: StreakRules,
        # out
        peak_fraction: wp.array3d[float],  # (n_view, n_band, n_source) fraction of the pixel that xy_px lies in
        total_fraction: wp.array3d[float],  # (n_view, n_band, n_source) fraction inside the whole stamp
    ):
        view, band, slot = wp.tid()
        xy_px = source_xy_px[view, slot]
        cut = stamp_cut(source_irradiance_w_cm2[view, band, slot], band, rule)
        reach_px = reach_of(tables, band, cut)
        column = nearest_pixel(xy_px[0])
        row = nearest_pixel(xy_px[1])
        peak = wp.float64(0.0)
        total = wp.float64(0.0)
        if wp.static(streaks):
            source = source_of(view, band, slot, xy_px, 1.0)
            error = wp.max(cut, rule.streak_error)
            streak = streak_of(paths, source, error, NO_LIMIT, blur_of(tables, band), rules)
            for panel in range(streak.n_panel):
                for node in range(streak.count):
                    moment = moment_of(paths, source, streak, panel, node, rules)
                    weight = wp.float64(moment.irradiance_w_cm2)
                    peak += weight * pixel_fraction(tables, band, moment.xy_px, column, row)
                    total += weight * stamp_fraction(tables, band, moment.xy_px, reach_px)
        else:
            peak = pixel_fraction(tables, band, xy_px, column, row)
            total = stamp_fraction(tables, band, xy_px, reach_px)
        peak_fraction[view, band, slot] = float(peak)
        total_fraction[view, band, slot] = float(total)

    return light_kernel
