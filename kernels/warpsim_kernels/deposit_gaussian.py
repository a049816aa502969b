"""Stage deposit for Gaussian images.

One thread owns a block of rows of one image and adds, in the order of the source list, every source whose stamp reaches
them. No two threads touch a pixel and the order of additions never changes, so images are bit-identical on any thread
count; the CPU uses one block per image, CUDA a block per few rows.
"""

import functools

import warp as wp

from warpsim_kernels.paths import Paths
from warpsim_kernels.psf import gaussian_edge, gaussian_reach_px, share_between
from warpsim_kernels.stamps import (
    Stamp,
    StampRule,
    block_window,
    columns_of_row,
    stamp_around,
    stamp_cut,
)
from warpsim_kernels.streaks import NO_LIMIT, Blur, StreakRules, is_streak_near, moment_of, source_of, streak_of

N_COLUMN = 32
"""Columns that are drawn at a time."""

Columns = wp.types.vector(length=N_COLUMN, dtype=wp.float32)


@wp.func
def gaussian_blur(sigma_px: wp.vec2) -> Blur:
    """What the count of a streak's nodes follows from."""
    blur = Blur()
    blur.width_px = sigma_px[0]
    blur.band_limit_per_px = NO_LIMIT
    blur.aspect = sigma_px[0] / sigma_px[1]
    return blur


@wp.func
def add_gaussian_stamp(image: wp.array2d[float], xy_px: wp.vec2d, strength: float, sigma_px: wp.vec2, stamp: Stamp):
    """Add a source to the pixels of its stamp.

    The Gaussian separates: a stamp of n x n pixels costs 2 (n + 1) error functions, and n more for each further
    N_COLUMN columns.
    """
    half = wp.float64(0.5)
    share = Columns()
    widest = columns_of_row(stamp, stamp.row)
    first = widest[0]
    while first < widest[1] and stamp.window.first_row < stamp.window.end_row:
        end = wp.min(first + N_COLUMN, widest[1])
        left = gaussian_edge(wp.float64(first) - half - xy_px[0], sigma_px[0])
        for column in range(first, end):
            right = gaussian_edge(wp.float64(column) + half - xy_px[0], sigma_px[0])
            share[column - first] = share_between(left, right)
            left = right
        above = gaussian_edge(wp.float64(stamp.window.first_row) - half - xy_px[1], sigma_px[1])
        for row in range(stamp.window.first_row, stamp.window.end_row):
            below = gaussian_edge(wp.float64(row) + half - xy_px[1], sigma_px[1])
            row_strength = strength * share_between(above, below)
            above = below
            columns = columns_of_row(stamp, row)
            for column in range(wp.max(columns[0], first), wp.min(columns[1], end)):
                image[row, column] += row_strength * share[column - first]
        first = end


@functools.cache
def make_deposit_gaussian_kernel(streaks: bool) -> wp.Kernel:
    """Kernel of the stage; without streaks it looks at no paths."""

    @wp.kernel(module="unique", enable_backward=False)
    def deposit_gaussian_kernel(
        # in
        n_source: wp.array[wp.int32],  # (n_view,)
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot)
        source_irradiance_w_cm2: wp.array3d[float],  # (n_view, n_band, n_slot)
        sigma_px: wp.array[wp.vec2],  # (n_band,) along columns [pixel widths] and along rows [pixel heights]
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
        sigma = sigma_px[band]
        aspect = sigma[0] / sigma[1]
        for slot in range(n_source[view]):
            irradiance = source_irradiance_w_cm2[view, band, slot]
            if irradiance == 0.0:
                continue
            xy_px = source_xy_px[view, slot]
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
                            add_gaussian_stamp(image, moment.xy_px, moment.irradiance_w_cm2, sigma, stamp)
            else:
                stamp = stamp_around(xy_px, reach_px, aspect, window)
                add_gaussian_stamp(image, xy_px, irradiance, sigma, stamp)

    return deposit_gaussian_kernel
