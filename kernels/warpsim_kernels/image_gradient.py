"""Kernels of gradients of images: the adjoint of `deposit`, and its Jacobian source by source.

Derivatives by a source's position, its light, and a Gaussian's sigma; where sources move, by the coefficients of their
paths. Streaks are differentiated node by node: the count of nodes, and the stamp's ends, are those that the image was
drawn with, and stay.
"""

import functools
from typing import Any, NamedTuple

import warp as wp

from warpsim_kernels.deposit_table import (
    N_AROUND,
    N_SMOOTH,
    PANEL_PX,
    WIDE_PX,
    part_around,
    smooth_from_px,
)
from warpsim_kernels.records import Sources
from warpsim_kernels.stamp_gradient import Images, StampFunctions, canvas_of
from warpsim_kernels.stamp_light import LightFunctions
from warpsim_kernels.stamps import (
    Stamp,
    StampRule,
    Window,
    columns_of_row,
    part_near,
    stamp_around,
    stamp_cut,
    whole_image,
)
from warpsim_kernels.streaks import (
    NO_LIMIT,
    Paths,
    Source,
    Streak,
    StreakRules,
    is_streak_near,
    moment_of,
    n_profile,
    next_legendre,
    panel_edge_px,
    source_of,
    streak_of,
    with_rule,
)


@wp.func
def node_time(streak: Streak, panel: int, node: int, rules: StreakRules) -> wp.float64:
    """Time of a node in [-1, 1], as `moment_of` has it."""
    width = wp.float64(1.0) / wp.float64(streak.n_panel)
    return (wp.float64(2 * panel - streak.n_panel + 1) + rules.node[streak.first + node]) * width


@wp.func
def add_path_gradient(
    gradient: wp.array[wp.vec2d],  # (n_path,)
    paths: Paths,
    source: Source,
    streak: Streak,
    t: wp.float64,
    by_xy: wp.vec2d,
):
    """Add the gradient by a node's position to that by the coefficients of the path."""
    is_centre = streak.n_panel * streak.count == 1
    before = wp.float64(0.0)
    legendre = wp.float64(1.0)
    for k in range(gradient.shape[0]):
        weight = legendre
        if is_centre and k > 0:  # at the centre of light
            weight = wp.float64(0.0)
            if k < n_profile(paths, source):
                weight = wp.float64(paths.brightness[source.view, source.band, source.slot, k]) / wp.float64(2 * k + 1)
        gradient[k] = gradient[k] + weight * by_xy
        after = next_legendre(k, t, legendre, before)
        before = legendre
        legendre = after


@wp.struct
class Strokes:
    """A source's streak as `deposit` draws it: panels, in each of them the nodes near the path, then the far light."""

    streak: Streak
    smooth: Streak  # nodes of the far light
    n_draw: int  # stamps of a panel
    is_wide: bool
    reach_px: float
    aspect: float


@wp.struct
class Stroke:
    """One of its stamps, for a source of unit light."""

    xy_px: wp.vec2d
    weight: wp.float64
    stamp: Stamp
    used: Streak
    t: wp.float64  # time of the node in [-1, 1]


class StrokeFunctions(NamedTuple):
    """Functions of streaks of one family of point spread functions."""

    strokes_of: Any
    """(tables, rule, paths, rules, source) -> strokes."""

    near_of: Any
    """(tables, strokes, paths, source, panel: int, window) -> the pixels that a panel's nodes near the path draw on."""

    stroke_of: Any
    """(strokes, paths, rules, source, panel: int, draw: int, near, window) -> stroke."""


@functools.cache
def stroke_functions(light: LightFunctions, wide: bool) -> StrokeFunctions:
    """Return the functions; wide: the far light of sources that reach far is drawn apart, as that of patterns is."""
    Tables, reach_of, aspect_of, blur_of = light[:4]

    @wp.func
    def strokes_of(tables: Tables, rule: StampRule, paths: Paths, rules: StreakRules, source: Source) -> Strokes:
        strokes = Strokes()
        cut = stamp_cut(source.irradiance_w_cm2, source.band, rule)
        strokes.reach_px = reach_of(tables, source.band, cut)
        strokes.aspect = aspect_of(tables, source.band)
        strokes.is_wide = wp.static(wide) and strokes.reach_px > WIDE_PX
        longest_px = NO_LIMIT
        if strokes.is_wide:
            longest_px = PANEL_PX
        error = wp.max(cut, rule.streak_error)
        strokes.streak = streak_of(paths, source, error, longest_px, blur_of(tables, source.band), rules)
        strokes.smooth = with_rule(strokes.streak, wp.min(N_SMOOTH + strokes.streak.extra, strokes.streak.count), rules)
        strokes.n_draw = strokes.streak.count
        if strokes.is_wide:
            strokes.n_draw += N_AROUND * strokes.smooth.count
        return strokes

    @wp.func
    def near_of(tables: Tables, strokes: Strokes, paths: Paths, source: Source, panel: int, window: Window) -> Window:
        near = window
        if wp.static(wide):
            if strokes.is_wide:
                start_px = panel_edge_px(paths, source, strokes.streak, panel)
                end_px = panel_edge_px(paths, source, strokes.streak, panel + 1)
                near = part_near(window, start_px, end_px, smooth_from_px(tables.psfs[source.band]))
        return near

    @wp.func
    def stroke_of(
        strokes: Strokes, paths: Paths, rules: StreakRules, source: Source, panel: int, draw: int, near: Window,
        window: Window,
    ) -> Stroke:  # fmt: skip
        stroke = Stroke()
        stroke.used = strokes.streak
        node = draw
        far = draw - strokes.streak.count
        if far >= 0:
            stroke.used = strokes.smooth
            node = far // N_AROUND
        unit = source_of(source.view, source.band, source.slot, source.xy_px, 1.0)
        moment = moment_of(paths, unit, stroke.used, panel, node, rules)
        stroke.xy_px = moment.xy_px
        stroke.weight = wp.float64(moment.irradiance_w_cm2)
        stroke.t = node_time(stroke.used, panel, node, rules)
        stroke.stamp = stamp_around(moment.xy_px, strokes.reach_px, strokes.aspect, near)
        if far >= 0:
            stroke.stamp = stamp_around(moment.xy_px, strokes.reach_px, strokes.aspect, window)
            stroke.stamp = part_around(stroke.stamp, near, far % N_AROUND)
        return stroke

    return StrokeFunctions(strokes_of, near_of, stroke_of)


@functools.cache
def make_gather_kernel(light: LightFunctions, stamps: StampFunctions, streaks: bool, wide: bool) -> wp.Kernel:
    """Kernel of the adjoint, for one family of point spread functions.

    Args:
        light: How stamps are sized.
        stamps: How they are summed over.
        streaks: Whether sources move; else no paths are looked at.
        wide: As in stroke_functions.
    """
    Tables, reach_of, aspect_of = light[:3]
    gather = stamps.gather
    strokes_of, near_of, stroke_of = stroke_functions(light, wide)

    @wp.func
    def gather_streak(
        images: Images, tables: Tables, rule: StampRule, paths: Paths, rules: StreakRules, source: Source,
        by_path: wp.array[wp.vec2d],
    ) -> wp.vec4d:  # fmt: skip
        """Sum over the stamps of a streak."""
        canvas = canvas_of(images, source.view * tables.psfs.shape[0] + source.band)
        window = whole_image(images.n_row, images.n_col)
        strokes = strokes_of(tables, rule, paths, rules, source)
        total = wp.vec4d()
        n_panel = strokes.streak.n_panel
        if not is_streak_near(paths, source, strokes.reach_px, strokes.aspect, window):
            n_panel = int(0)
        for panel in range(n_panel):
            near = near_of(tables, strokes, paths, source, panel, window)
            for draw in range(strokes.n_draw):
                stroke = stroke_of(strokes, paths, rules, source, panel, draw, near, window)
                part = stroke.weight * gather(canvas, tables, source.band, stroke.xy_px, stroke.stamp)
                by_xy = wp.float64(source.irradiance_w_cm2) * wp.vec2d(part[1], part[2])
                add_path_gradient(by_path, paths, source, stroke.used, stroke.t, by_xy)
                total += part
        return total

    @wp.kernel(module="unique", enable_backward=False)
    def gather_kernel(
        # in
        sources: Sources,  # n_source, xy_px, irradiance_w_cm2
        tables: Tables,
        rule: StampRule,
        paths: Paths,
        rules: StreakRules,
        cotangent: Images,  # of all views and bands
        # out
        gradient: wp.array3d[wp.vec4d],  # (n_view, n_band, n_slot) by light, x, y and sigma
        by_path: wp.array4d[wp.vec2d],  # (n_view, n_band, n_slot, n_path) by the coefficients of paths; 0 before
    ):
        view, band, slot = wp.tid()
        total = wp.vec4d()
        if slot < sources.n_source[view]:
            irradiance = sources.irradiance_w_cm2[view, band, slot]
            xy_px = sources.xy_px[view, slot]
            if wp.static(streaks):
                source = source_of(view, band, slot, xy_px, irradiance)
                total = gather_streak(cotangent, tables, rule, paths, rules, source, by_path[view, band, slot])
            else:
                canvas = canvas_of(cotangent, view * tables.psfs.shape[0] + band)
                reach_px = reach_of(tables, band, stamp_cut(irradiance, band, rule))
                window = whole_image(cotangent.n_row, cotangent.n_col)
                stamp = stamp_around(xy_px, reach_px, aspect_of(tables, band), window)
                total = gather(canvas, tables, band, xy_px, stamp)
            for k in range(1, 4):
                total[k] *= wp.float64(irradiance)
        gradient[view, band, slot] = total

    return gather_kernel


@functools.cache
def make_jacobian_kernel(light: LightFunctions, stamps: StampFunctions, streaks: bool, wide: bool) -> wp.Kernel:
    """Kernel of the Jacobian: images of fractions and their derivatives, a window for each source."""
    Tables, reach_of, aspect_of = light[:3]
    grid_of, pixel_slopes = stamps.grid_of, stamps.pixel_slopes
    strokes_of, near_of, stroke_of = stroke_functions(light, wide)

    @wp.func
    def add_stamp(
        values: wp.array[wp.vec4d], tables: Tables, band: int, xy_px: wp.vec2d, weight: wp.float64, stamp: Stamp,
        window: Window, first: int,
    ):  # fmt: skip
        """Add a stamp to the values of a window, which begin at `first`."""
        n_col = window.end_column - window.first_column
        grid = grid_of(tables, band, xy_px)
        for row in range(stamp.window.first_row, stamp.window.end_row):
            columns = columns_of_row(stamp, row)
            for column in range(columns[0], columns[1]):
                at = first + (row - window.first_row) * n_col + column - window.first_column
                values[at] = values[at] + weight * pixel_slopes(tables, band, grid, column, row)

    @wp.kernel(module="unique", enable_backward=False)
    def jacobian_kernel(
        # in
        sources: Sources,  # xy_px, irradiance_w_cm2
        tables: Tables,
        rule: StampRule,
        paths: Paths,
        rules: StreakRules,
        item: wp.array[wp.vec3i],  # (n_item,) view, band and slot
        windows: wp.array[wp.vec4i],  # (n_item,) first column, end column, first row, end row; within the image
        first: wp.array[wp.int64],  # (n_item,) index of a window's first value
        size: wp.vec2i,  # columns and rows of the image
        # out
        values: wp.array[wp.vec4d],  # pixels of all windows: by light, x, y and sigma; 0 before
    ):
        number = wp.tid()
        view = item[number][0]
        band = item[number][1]
        slot = item[number][2]
        image = whole_image(size[1], size[0])
        window = Window()
        window.first_column = windows[number][0]
        window.end_column = windows[number][1]
        window.first_row = windows[number][2]
        window.end_row = windows[number][3]
        at = int(first[number])
        xy_px = sources.xy_px[view, slot]
        irradiance = sources.irradiance_w_cm2[view, band, slot]
        if wp.static(streaks):
            source = source_of(view, band, slot, xy_px, irradiance)
            strokes = strokes_of(tables, rule, paths, rules, source)
            for panel in range(strokes.streak.n_panel):
                near = near_of(tables, strokes, paths, source, panel, image)
                for draw in range(strokes.n_draw):
                    stroke = stroke_of(strokes, paths, rules, source, panel, draw, near, image)
                    add_stamp(values, tables, band, stroke.xy_px, stroke.weight, stroke.stamp, window, at)
        else:
            reach_px = reach_of(tables, band, stamp_cut(irradiance, band, rule))
            stamp = stamp_around(xy_px, reach_px, aspect_of(tables, band), image)
            add_stamp(values, tables, band, xy_px, wp.float64(1.0), stamp, window, at)
        for i in range((window.end_column - window.first_column) * (window.end_row - window.first_row)):
            value = values[at + i]
            for k in range(1, 4):
                value[k] *= wp.float64(irradiance)
            values[at + i] = value

    return jacobian_kernel
