"""Cramer-Rao bounds of targets, for truth: how well an unbiased fit to one image measures them.

It fits position and irradiance, and all else is known. With S the noiseless light of the target and V the variance of
the noise, both of a pixel p, the Fisher information of parameters a and b is the sum over p of dS/da dS/db / V; bounds
are the diagonal of its inverse (Winick 1986, J. Opt. Soc. Am. A 3, 1809; Kay 1993, Estimation Theory, chapter 3).
Derivatives are those of the image that is drawn, as gradients of images have them.
"""

import functools

import warp as wp

from warpsim_kernels.image_gradient import stroke_functions
from warpsim_kernels.resolution import TargetImages
from warpsim_kernels.stamp_gradient import StampFunctions
from warpsim_kernels.stamp_light import LightFunctions
from warpsim_kernels.stamps import (
    Stamp,
    StampRule,
    Window,
    columns_of_row,
    stamp_around,
    stamp_cut,
    whole_plane,
)
from warpsim_kernels.streaks import Source, StreakRules, source_of


@wp.struct
class PixelNoise:
    """Noise of the pixels; arrays are (n_band,)."""

    variance_w2_cm4: wp.array[wp.float64]  # on blank sky
    shot_w_cm2: wp.array[wp.float64]  # variance over the light that makes it
    sei_w_cm2: wp.array[wp.float64]  # light from which on a pixel is saturated


@wp.func
def bounds(fisher: wp.mat33d) -> wp.vec3d:
    """Roots of the diagonal of the inverse of Fisher information; infinite where a parameter has no effect."""
    size = wp.vec3d(wp.sqrt(fisher[0, 0]), wp.sqrt(fisher[1, 1]), wp.sqrt(fisher[2, 2]))
    sigma = wp.vec3d(wp.float64(wp.inf), wp.float64(wp.inf), wp.float64(wp.inf))
    if size[0] > wp.float64(0.0) and size[1] > wp.float64(0.0) and size[2] > wp.float64(0.0):
        one = wp.float64(1.0)
        xy = fisher[0, 1] / (size[0] * size[1])
        xs = fisher[0, 2] / (size[0] * size[2])
        ys = fisher[1, 2] / (size[1] * size[2])
        whole = one - xy * xy - xs * xs - ys * ys + wp.float64(2.0) * xy * xs * ys
        if whole > wp.float64(1e-12):
            sigma[0] = wp.sqrt((one - ys * ys) / whole) / size[0]
            sigma[1] = wp.sqrt((one - xs * xs) / whole) / size[1]
            sigma[2] = wp.sqrt((one - xy * xy) / whole) / size[2]
    return sigma


@wp.func
def window_at(window: wp.vec4i) -> Window:
    """A window by its first column, end column, first row and end row."""
    result = Window()
    result.first_column = window[0]
    result.end_column = window[1]
    result.first_row = window[2]
    result.end_row = window[3]
    return result


@functools.cache
def make_bounds_kernel(light: LightFunctions, stamps: StampFunctions, streaks: bool, wide: bool) -> wp.Kernel:
    """Kernel of Cramer-Rao bounds, for one family of point spread functions.

    Args:
        light: How stamps are sized.
        stamps: Their derivatives.
        streaks: Whether targets move; then their light is added up in memory, node by node.
        wide: As in stroke_functions.
    """
    Tables, reach_of, aspect_of = light[:3]
    grid_of, pixel_slopes = stamps.grid_of, stamps.pixel_slopes
    strokes_of, near_of, stroke_of = stroke_functions(light, wide)

    @wp.func
    def add_streak(
        targets: TargetImages, tables: Tables, rule: StampRule, rules: StreakRules, source: Source, window: Window,
        values: wp.array[wp.vec4d], first: int,
    ):  # fmt: skip
        """Add the pixels of a streak, within a window, to values that begin at `first`."""
        n_col = window.end_column - window.first_column
        for i in range(n_col * (window.end_row - window.first_row)):
            values[first + i] = wp.vec4d()
        strokes = strokes_of(tables, rule, targets.paths, rules, source)
        for panel in range(strokes.streak.n_panel):
            near = near_of(tables, strokes, targets.paths, source, panel, whole_plane())
            for draw in range(strokes.n_draw):
                stroke = stroke_of(strokes, targets.paths, rules, source, panel, draw, near, whole_plane())
                rows = stroke.stamp.window
                grid = grid_of(tables, source.band, stroke.xy_px)
                for row in range(wp.max(rows.first_row, window.first_row), wp.min(rows.end_row, window.end_row)):
                    columns = columns_of_row(stroke.stamp, row)
                    at = first + (row - window.first_row) * n_col - window.first_column
                    for column in range(wp.max(columns[0], window.first_column), wp.min(columns[1], window.end_column)):
                        slopes = pixel_slopes(tables, source.band, grid, column, row)
                        values[at + column] = values[at + column] + stroke.weight * slopes

    @wp.kernel(module="unique", enable_backward=False)
    def bounds_kernel(
        # in
        targets: TargetImages,
        tables: Tables,
        rule: StampRule,
        rules: StreakRules,
        noise: PixelNoise,
        item: wp.array[wp.vec3i],  # (n_item,) view, band and number of a target with light
        windows: wp.array[wp.vec4i],  # (n_item,) first column, end column, first row, end row
        first: wp.array[wp.int32],  # (n_item,) of a target's values; where they move
        # out
        sigma: wp.array[wp.vec3d],  # (n_item,) of x, y, and of the light over itself
        values: wp.array[wp.vec4d],  # fractions of pixels and their derivatives, for this kernel alone
    ):
        i = wp.tid()
        view = item[i][0]
        band = item[i][1]
        number = item[i][2]
        irradiance = targets.irradiance_w_cm2[view, band, number]
        xy_px = targets.xy_px[view, number]
        background = wp.float64(0.0)
        if targets.background_w_cm2.shape[0] > 0:
            background = wp.max(wp.float64(targets.background_w_cm2[view, band, number]), wp.float64(0.0))
        window = window_at(windows[i])
        at = int(0)
        stamp = Stamp()
        if wp.static(streaks):
            at = first[i]
            source = source_of(view, band, number, xy_px, irradiance)
            add_streak(targets, tables, rule, rules, source, window, values, at)
        else:
            reach_px = reach_of(tables, band, stamp_cut(irradiance, band, rule))
            stamp = stamp_around(xy_px, reach_px, aspect_of(tables, band), window)
        grid = grid_of(tables, band, xy_px)
        fisher = wp.mat33d()
        for row in range(window.first_row, window.end_row):
            columns = wp.vec2i(window.first_column, window.end_column)
            if wp.static(not streaks):
                columns = columns_of_row(stamp, row)
                if row < stamp.window.first_row or row >= stamp.window.end_row:
                    columns = wp.vec2i(0, 0)
            for column in range(columns[0], columns[1]):
                value = wp.vec4d()
                if wp.static(streaks):
                    n_col = window.end_column - window.first_column
                    value = values[at + (row - window.first_row) * n_col + column - window.first_column]
                else:
                    value = pixel_slopes(tables, band, grid, column, row)
                value *= wp.float64(irradiance)
                if value[0] > wp.float64(0.0) and value[0] + background < noise.sei_w_cm2[band]:
                    slope = wp.vec3d(value[1], value[2], value[0])
                    variance = noise.variance_w2_cm4[band] + noise.shot_w_cm2[band] * (value[0] + background)
                    fisher += wp.outer(slope, slope) / variance
        sigma[i] = bounds(fisher)

    return bounds_kernel
