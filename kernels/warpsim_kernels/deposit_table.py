"""Stage deposit for tabulated images; threads and order as in deposit_gaussian."""

import functools
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.paths import Paths
from warpsim_kernels.psf import TablePsf, table_functions, table_reach_px
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

WIDE_PX = wp.constant(48.0)
"""Streaks of sources that reach farther are drawn in two parts: near the path, and the smooth light farther away."""

PANEL_PX = wp.constant(8.0)
"""Longest part of such a streak that is drawn at a time, and the least distance at which light is taken as smooth."""

N_SMOOTH = wp.constant(4)
"""Nodes that serve a panel farther away. Light falls as 1 / r^3 there: at twice the panel's half length they are within
1e-5 of it, which is 1e-9 of the source."""


@wp.func
def smooth_from_px(psf: TablePsf) -> wp.vec2d:
    """Distance from a panel, along columns and rows, beyond which light is smooth."""
    return wp.vec2d(
        wp.float64(wp.max(psf.reach_column_px, PANEL_PX)),
        wp.float64(wp.max(psf.reach_row_px, PANEL_PX / psf.pixel_aspect)),
    )


class StampFunctions(NamedTuple):
    """How stamps are drawn from a table; each (image, xy_px, strength, psf, lanes, stamp[, hole]) adds to the image."""

    add: Any
    """All pixels of the stamp."""

    add_around: Any
    """Those outside a window."""


@functools.cache
def stamp_functions(n_point: int) -> StampFunctions:
    """The functions that draw stamps by an interpolation of n_point x n_point nodes."""
    read = table_functions(n_point)
    Lanes = wp.types.vector(length=read.n_lane, dtype=wp.float32)
    column_axis, row_axis = read.column_axis, read.row_axis
    column_nodes, row_nodes, pixel_share = read.column_nodes, read.row_nodes, read.share

    @wp.func
    def add(
        image: wp.array2d[float], xy_px: wp.vec2d, strength: float, psf: TablePsf, lanes: wp.array[Lanes], stamp: Stamp
    ):
        if stamp.window.first_row < stamp.window.end_row:
            across = column_axis(wp.float64(stamp.column) - xy_px[0], psf)
            down = row_axis(wp.float64(stamp.row) - xy_px[1], psf)
            for row in range(stamp.window.first_row, stamp.window.end_row):
                in_row = row_nodes(down, row - stamp.row, psf)
                columns = columns_of_row(stamp, row)
                for column in range(columns[0], columns[1]):
                    in_column = column_nodes(across, column - stamp.column, psf)
                    image[row, column] += strength * pixel_share(lanes, psf, in_row, in_column)

    @wp.func
    def add_around(
        image: wp.array2d[float],
        xy_px: wp.vec2d,
        strength: float,
        psf: TablePsf,
        lanes: wp.array[Lanes],
        stamp: Stamp,
        hole: Window,
    ):
        part = stamp
        part.window.end_row = wp.min(stamp.window.end_row, hole.first_row)
        add(image, xy_px, strength, psf, lanes, part)
        part.window.first_row = wp.max(stamp.window.first_row, hole.end_row)
        part.window.end_row = stamp.window.end_row
        add(image, xy_px, strength, psf, lanes, part)
        part.window.first_row = wp.max(stamp.window.first_row, hole.first_row)
        part.window.end_row = wp.min(stamp.window.end_row, hole.end_row)
        part.window.end_column = wp.min(stamp.window.end_column, hole.first_column)
        add(image, xy_px, strength, psf, lanes, part)
        part.window.first_column = wp.max(stamp.window.first_column, hole.end_column)
        part.window.end_column = stamp.window.end_column
        add(image, xy_px, strength, psf, lanes, part)

    return StampFunctions(add, add_around)


@functools.cache
def make_deposit_table_kernel(n_point: int, streaks: bool) -> wp.Kernel:
    """Kernel of the stage; without streaks it looks at no paths."""
    Lanes = wp.types.vector(length=table_functions(n_point).n_lane, dtype=wp.float32)
    add_stamp, add_stamp_around = stamp_functions(n_point)

    @wp.func
    def add_streak(
        image: wp.array2d[float],
        source: Source,
        reach_px: float,
        streak: Streak,
        psf: TablePsf,
        lanes: wp.array[Lanes],
        paths: Paths,
        rules: StreakRules,
        window: Window,
    ):
        """Add a source at every node of its streak; few serve the far light of a source that reaches far."""
        is_wide = reach_px > WIDE_PX
        smooth = with_rule(streak, wp.min(N_SMOOTH + streak.extra, streak.count), rules)
        for panel in range(streak.n_panel):
            near = window
            if is_wide:
                start_px = panel_edge_px(paths, source, streak, panel)
                end_px = panel_edge_px(paths, source, streak, panel + 1)
                near = part_near(window, start_px, end_px, smooth_from_px(psf))
            for node in range(streak.count):
                moment = moment_of(paths, source, streak, panel, node, rules)
                stamp = stamp_around(moment.xy_px, reach_px, psf.pixel_aspect, near)
                add_stamp(image, moment.xy_px, moment.irradiance_w_cm2, psf, lanes, stamp)
            if is_wide:
                for node in range(smooth.count):
                    moment = moment_of(paths, source, smooth, panel, node, rules)
                    stamp = stamp_around(moment.xy_px, reach_px, psf.pixel_aspect, window)
                    add_stamp_around(image, moment.xy_px, moment.irradiance_w_cm2, psf, lanes, stamp, near)

    @wp.kernel(module="unique", enable_backward=False)
    def deposit_table_kernel(
        # in
        n_source: wp.array[wp.int32],  # (n_view,)
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
        source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
        psfs: wp.array[TablePsf],  # (n_band,)
        blurs: wp.array[Blur],  # (n_band,)
        table: wp.array[float],  # pixel shares and envelopes of all bands, flat
        lanes: wp.array[Lanes],  # the same, with a vector from every float on
        rule: StampRule,
        paths: Paths,
        rules: StreakRules,
        n_row_per_block: int,
        # out (accumulated)
        signal_w_cm2: wp.array4d[float],  # (n_view, n_band, n_row, n_col)
    ):
        view, band, block = wp.tid()
        image = signal_w_cm2[view, band]
        window = block_window(image.shape[0], image.shape[1], block, n_row_per_block)
        psf = psfs[band]
        for slot in range(n_source[view]):
            irradiance = source_irradiance_w_cm2[view, band, slot]
            if irradiance == 0.0:
                continue
            xy_px = source_xy_px[view, slot]
            cut = stamp_cut(irradiance, band, rule)
            reach_px = table_reach_px(table, psf, cut)
            if wp.static(streaks):
                source = source_of(view, band, slot, xy_px, irradiance)
                if is_streak_near(paths, source, reach_px, psf.pixel_aspect, window):
                    longest_px = NO_LIMIT
                    if reach_px > WIDE_PX:
                        longest_px = PANEL_PX
                    streak = streak_of(paths, source, wp.max(cut, rule.streak_error), longest_px, blurs[band], rules)
                    add_streak(image, source, reach_px, streak, psf, lanes, paths, rules, window)
            else:
                stamp = stamp_around(xy_px, reach_px, psf.pixel_aspect, window)
                add_stamp(image, xy_px, irradiance, psf, lanes, stamp)

    return deposit_table_kernel
