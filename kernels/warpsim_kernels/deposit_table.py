"""Stage deposit for tabulated images; threads and order as in deposit_gaussian."""

import functools
from typing import Any

import warp as wp

from warpsim_kernels.canvas import canvas_functions
from warpsim_kernels.psf import TABLE_SIMD_WIDTH, TablePsf, table_reach_px, table_wing
from warpsim_kernels.psf_cells import layout_functions
from warpsim_kernels.records import Sources
from warpsim_kernels.stamps import (
    Stamp,
    StampRule,
    Window,
    block_window,
    columns_of_row,
    part_near,
    stamp_around,
    stamp_cut,
)
from warpsim_kernels.streaks import (
    NO_LIMIT,
    Blur,
    Paths,
    Source,
    Streak,
    StreakRules,
    is_streak_near,
    moment_of,
    panel_edge_px,
    source_of,
    streak_of,
    with_rule,
)
from warpsim_kernels.table_layout import TableLayout

WIDE_PX = wp.constant(48.0)
"""Streaks of sources that reach farther are drawn in two parts: near the path, and the smooth light farther away."""

PANEL_PX = wp.constant(8.0)
"""Longest part of such a streak that is drawn at a time, and the least distance at which light is taken as smooth."""

N_SMOOTH = wp.constant(4)
"""Nodes that serve a panel farther away. Light falls as 1 / r^3 there: at twice the panel's half length they are within
1e-5 of it, which is 1e-9 of the source."""

N_AROUND = wp.constant(4)
"""Parts of a stamp about a hole."""


@wp.func
def smooth_from_px(psf: TablePsf) -> wp.vec2d:
    """Distance from a panel, along columns and rows, beyond which light is smooth."""
    return wp.vec2d(
        wp.float64(wp.max(psf.reach_column_px, PANEL_PX)),
        wp.float64(wp.max(psf.reach_row_px, PANEL_PX / psf.pixel_aspect)),
    )


@functools.cache
def table_stamp_function(layout: TableLayout) -> Any:
    """The function that adds a source to the pixels of its stamp, by tables of a layout."""
    draw, read = canvas_functions(TABLE_SIMD_WIDTH), layout_functions(layout)
    Nodes, Canvas, add_light, flag_strips = read.Nodes, draw.Canvas, draw.add_light, draw.flag_strips
    Offset, offset_in, row_in, pixel_fractions = read.Offset, read.offset_in, read.row_in, read.fractions

    @wp.func
    def add_wing(
        canvas: Canvas, row: int, first: int, end: int, own: int, strength: float, psf: TablePsf, dx: float, dy: float
    ):
        """Pixels of a row beyond the table; dx is that of the source's own column [pixel widths]."""
        for column in range(first, end):
            pixel = canvas.first + row * canvas.n_col + column
            fraction = table_wing(psf, dx + float(column - own), dy)
            canvas.pixels[pixel] = canvas.pixels[pixel] + strength * fraction
        flag_strips(canvas, row, first, end)

    @wp.func
    def add_wings(canvas: Canvas, strength: float, psf: TablePsf, offset: Offset, stamp: Stamp, served: Window):
        """All pixels of a stamp beyond what the table serves."""
        dx = offset.dx_px
        for row in range(stamp.window.first_row, stamp.window.end_row):
            columns = columns_of_row(stamp, row)
            left = columns[0]
            right = columns[0]
            if row >= served.first_row and row < served.end_row:
                left = wp.clamp(served.first_column, columns[0], columns[1])
                right = wp.clamp(served.end_column, left, columns[1])
            dy = offset.dy_px + float(row - stamp.row) * psf.pixel_aspect
            add_wing(canvas, row, columns[0], left, stamp.column, strength, psf, dx, dy)
            add_wing(canvas, row, right, columns[1], stamp.column, strength, psf, dx, dy)

    @wp.func
    def add(
        canvas: Canvas,
        xy_px: wp.vec2d,
        strength: float,
        psf: TablePsf,
        nodes: wp.array[Nodes],
        stamp: Stamp,
    ):
        """All pixels of a stamp; rows have as many blocks as the widest, so that loops are as long for each of them."""
        if stamp.window.first_row < stamp.window.end_row:
            offset = offset_in(wp.float64(stamp.column) - xy_px[0], wp.float64(stamp.row) - xy_px[1], psf)
            served = Window()
            served.first_column = stamp.column + offset.first_step
            served.end_column = stamp.column + offset.end_step
            served.first_row = stamp.row + offset.first_row_step
            served.end_row = stamp.row + offset.end_row_step
            widest = columns_of_row(stamp, stamp.row)
            zero = stamp.column - psf.zero_pixel  # first pixel of the first block
            first_block = (wp.max(widest[0], served.first_column) - zero) // psf.block_px
            end_vector = wp.min(widest[1], served.end_column)
            window = stamp.window
            for row in range(wp.max(window.first_row, served.first_row), wp.min(window.end_row, served.end_row)):
                columns = columns_of_row(stamp, row)
                left = wp.max(columns[0], served.first_column)
                right = wp.min(columns[1], served.end_column)
                in_row = row_in(offset, row - stamp.row, psf)
                block = first_block
                vector = zero + block * psf.block_px
                while vector < end_vector:
                    first = wp.clamp(left - vector, 0, TABLE_SIMD_WIDTH)
                    end = wp.clamp(right - vector, 0, TABLE_SIMD_WIDTH)
                    light = strength * pixel_fractions(nodes, psf, offset, in_row, block)
                    for i in range(TABLE_SIMD_WIDTH):  # the others have numbers without meaning
                        light[i] = wp.where(i >= first and i < end, light[i], 0.0)
                    add_light(canvas, row, vector, light, first, end)
                    block += TABLE_SIMD_WIDTH // psf.block_px
                    vector += TABLE_SIMD_WIDTH
                flag_strips(canvas, row, left, right)
            within = widest[0] >= served.first_column and widest[1] <= served.end_column
            if not (within and window.first_row >= served.first_row and window.end_row <= served.end_row):
                add_wings(canvas, strength, psf, offset, stamp, served)

    return add


@wp.func
def part_around(stamp: Stamp, hole: Window, number: int) -> Stamp:
    """The part of a stamp above a hole (number 0), below, left or right of it (3)."""
    part = stamp
    if number == 0:
        part.window.end_row = wp.min(stamp.window.end_row, hole.first_row)
    elif number == 1:
        part.window.first_row = wp.max(stamp.window.first_row, hole.end_row)
    else:
        part.window.first_row = wp.max(stamp.window.first_row, hole.first_row)
        part.window.end_row = wp.min(stamp.window.end_row, hole.end_row)
        if number == 2:
            part.window.end_column = wp.min(stamp.window.end_column, hole.first_column)
        else:
            part.window.first_column = wp.max(stamp.window.first_column, hole.end_column)
    return part


@functools.cache
def pattern_tables(layout: TableLayout) -> Any:
    """The struct of the patterns of all bands, with tables of a layout."""
    Nodes = layout_functions(layout).Nodes

    class PatternTables:
        psfs: wp.array[TablePsf]  # (n_band,)
        blurs: wp.array[Blur]  # (n_band,)
        table: wp.array[float]  # pixel fractions and envelopes of all bands, flat
        nodes: wp.array[Nodes]  # the same, with a vector from every float on

    return wp.struct(PatternTables)


@functools.cache
def make_deposit_table_kernel(layout: TableLayout, streaks: bool) -> wp.Kernel:
    """Kernel of the stage; without streaks it looks at no paths."""
    draw = canvas_functions(TABLE_SIMD_WIDTH)
    Images, Canvas, canvas_of = draw.Images, draw.Canvas, draw.canvas_of
    Nodes, Tables = layout_functions(layout).Nodes, pattern_tables(layout)
    add_stamp = table_stamp_function(layout)

    @wp.func
    def add_streak(
        canvas: Canvas,
        source: Source,
        reach_px: float,
        streak: Streak,
        psf: TablePsf,
        nodes: wp.array[Nodes],
        paths: Paths,
        rules: StreakRules,
        window: Window,
    ):
        """Add a source at every node of its streak; few serve the far light of a source that reaches far."""
        is_wide = reach_px > WIDE_PX
        smooth = with_rule(streak, wp.min(N_SMOOTH + streak.extra, streak.count), rules)
        for panel in range(streak.n_panel):
            near = window
            n_far = int(0)
            if is_wide:
                start_px = panel_edge_px(paths, source, streak, panel)
                end_px = panel_edge_px(paths, source, streak, panel + 1)
                near = part_near(window, start_px, end_px, smooth_from_px(psf))
                n_far = N_AROUND * smooth.count
            draw = int(0)
            while draw < streak.count + n_far:  # one loop for both, so that the drawing is compiled once
                far = draw - streak.count
                if far < 0:
                    moment = moment_of(paths, source, streak, panel, draw, rules)
                    stamp = stamp_around(moment.xy_px, reach_px, psf.pixel_aspect, near)
                else:
                    moment = moment_of(paths, source, smooth, panel, far // N_AROUND, rules)
                    stamp = stamp_around(moment.xy_px, reach_px, psf.pixel_aspect, window)
                    stamp = part_around(stamp, near, far % N_AROUND)
                add_stamp(canvas, moment.xy_px, moment.irradiance_w_cm2, psf, nodes, stamp)
                draw += 1

    @wp.kernel(module="unique", enable_backward=False)
    def deposit_table_kernel(
        # in
        sources: Sources,  # n_source, xy_px, irradiance_w_cm2
        tables: Tables,
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
        nodes = tables.nodes
        for slot in range(sources.n_source[view]):
            irradiance = sources.irradiance_w_cm2[view, band, slot]
            if irradiance == 0.0:
                continue
            xy_px = sources.xy_px[view, slot]
            cut = stamp_cut(irradiance, band, rule)
            reach_px = table_reach_px(tables.table, psf, cut)
            if wp.static(streaks):
                source = source_of(view, band, slot, xy_px, irradiance)
                if is_streak_near(paths, source, reach_px, psf.pixel_aspect, window):
                    longest_px = NO_LIMIT
                    if reach_px > WIDE_PX:
                        longest_px = PANEL_PX
                    streak = streak_of(
                        paths, source, wp.max(cut, rule.streak_error), longest_px, tables.blurs[band], rules
                    )
                    add_streak(canvas, source, reach_px, streak, psf, nodes, paths, rules, window)
            else:
                stamp = stamp_around(xy_px, reach_px, psf.pixel_aspect, window)
                add_stamp(canvas, xy_px, irradiance, psf, nodes, stamp)

    return deposit_table_kernel
