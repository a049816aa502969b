"""How well targets can be told apart, for truth: neighbours, clumps, blended light."""

import functools

import warp as wp

from warpsim_kernels.stamp_light import LightFunctions
from warpsim_kernels.stamps import (
    StampRule,
    Window,
    columns_of_row,
    nearest_pixel,
    stamp_around,
    stamp_cut,
    whole_plane,
)
from warpsim_kernels.streaks import (
    NO_LIMIT,
    Paths,
    StreakRules,
    is_streak_near,
    moment_of,
    source_of,
    streak_of,
)


@wp.struct
class TargetImages:
    """Targets as they are drawn."""

    xy_px: wp.array2d[wp.vec2d]  # (n_view, n_target)
    irradiance_w_cm2: wp.array3d[float]  # (n_view, n_band, n_target); 0 without light or behind the camera
    order: wp.array2d[wp.int32]  # (n_view, n_target) targets from left to right
    rank: wp.array2d[wp.int32]  # (n_view, n_target) index of each in order
    background_w_cm2: wp.array3d[float]  # (n_view, n_band, n_target) in its pixel; empty where there is none
    paths: Paths


@wp.func
def root_of(parent: wp.array3d[wp.int32], view: int, band: int, target: int) -> int:
    """First of the targets that a target is linked with; the way to it is shortened."""
    root = target
    while parent[view, band, root] != root:
        parent[view, band, root] = parent[view, band, parent[view, band, root]]
        root = parent[view, band, root]
    return root


@wp.kernel(enable_backward=False)
def find_clumps_kernel(
    # in
    targets: TargetImages,
    merge_px: wp.array[wp.vec2d],  # (n_band,) distance within which targets merge, along columns and rows
    # out
    parent: wp.array3d[wp.int32],  # (n_view, n_band, n_target) for this kernel alone
    n_member: wp.array3d[wp.int32],  # (n_view, n_band, n_target) of the target's clump; 0 without light
    clump: wp.array3d[wp.int32],  # (n_view, n_band, n_target) its number in the image; -1 without light
):
    """Link targets that lie near enough to each other, from left to right, and number what hangs together."""
    view, band = wp.tid()
    n_target = targets.xy_px.shape[1]
    reach_px = merge_px[band]
    for target in range(n_target):
        parent[view, band, target] = target
        n_member[view, band, target] = 0
    for i in range(n_target):
        target = targets.order[view, i]
        xy_px = targets.xy_px[view, target]
        j = i - 1
        if targets.irradiance_w_cm2[view, band, target] == 0.0:
            j = -1
        while j >= 0:
            other = targets.order[view, j]
            apart = wp.cw_div(xy_px - targets.xy_px[view, other], reach_px)
            j -= 1
            if apart[0] > wp.float64(1.0):
                j = -1
            elif targets.irradiance_w_cm2[view, band, other] > 0.0 and wp.length(apart) <= wp.float64(1.0):
                a = root_of(parent, view, band, target)
                b = root_of(parent, view, band, other)
                parent[view, band, wp.max(a, b)] = wp.min(a, b)
    n_clump = int(0)
    for target in range(n_target):  # the first of a clump comes before its others
        clump[view, band, target] = -1
        if targets.irradiance_w_cm2[view, band, target] > 0.0:
            root = root_of(parent, view, band, target)
            if root == target:
                clump[view, band, target] = n_clump
                n_clump += 1
            clump[view, band, target] = clump[view, band, root]
            n_member[view, band, root] += 1
    for target in range(n_target):
        root = root_of(parent, view, band, target)
        n_member[view, band, target] = n_member[view, band, root]


@wp.func
def neighbour_px(targets: TargetImages, view: int, band: int, target: int) -> wp.float64:
    """Distance to the nearest other target with light; infinite without one."""
    xy_px = targets.xy_px[view, target]
    nearest_px = wp.float64(wp.inf)
    for side in range(2):
        step = 2 * side - 1
        i = targets.rank[view, target] + step
        while i >= 0 and i < targets.order.shape[1]:
            other = targets.order[view, i]
            apart_px = targets.xy_px[view, other] - xy_px
            i += step
            if wp.abs(apart_px[0]) > nearest_px:
                i = -1
            elif targets.irradiance_w_cm2[view, band, other] > 0.0:
                nearest_px = wp.min(nearest_px, wp.length(apart_px))
    return nearest_px


@wp.func
def is_drawn(xy_px: wp.vec2d, reach_px: float, aspect: float, column: int, row: int) -> bool:
    """Whether a pixel belongs to the stamp of a source."""
    stamp = stamp_around(xy_px, reach_px, aspect, whole_plane())
    columns = columns_of_row(stamp, row)
    in_row = row >= stamp.window.first_row and row < stamp.window.end_row
    return in_row and column >= columns[0] and column < columns[1]


@functools.cache
def make_blend_kernel(light: LightFunctions, streaks: bool) -> wp.Kernel:
    """Kernel for one family of point spread functions; without streaks it looks at no paths."""
    Tables, reach_of, aspect_of, blur_of, pixel_fraction = light[:5]

    @wp.func
    def pixel_light(
        targets: TargetImages, tables: Tables, rule: StampRule, rules: StreakRules, view: int, band: int, number: int,
        column: int, row: int,
    ) -> wp.float64:  # fmt: skip
        """Light of a target in a pixel [W/cm2]; mean over the exposure."""
        xy_px = targets.xy_px[view, number]
        irradiance = targets.irradiance_w_cm2[view, band, number]
        cut = stamp_cut(irradiance, band, rule)
        reach_px = reach_of(tables, band, cut)
        aspect = aspect_of(tables, band)
        total = wp.float64(0.0)
        if wp.static(streaks):
            source = source_of(view, band, number, xy_px, irradiance)
            pixel = Window()
            pixel.first_column = column
            pixel.end_column = column + 1
            pixel.first_row = row
            pixel.end_row = row + 1
            if is_streak_near(targets.paths, source, reach_px, aspect, pixel):
                error = wp.max(cut, rule.streak_error)
                streak = streak_of(targets.paths, source, error, NO_LIMIT, blur_of(tables, band), rules)
                for panel in range(streak.n_panel):
                    for node in range(streak.count):
                        moment = moment_of(targets.paths, source, streak, panel, node, rules)
                        if is_drawn(moment.xy_px, reach_px, aspect, column, row):
                            fraction = pixel_fraction(tables, band, moment.xy_px, column, row)
                            total += wp.float64(moment.irradiance_w_cm2) * fraction
        elif is_drawn(xy_px, reach_px, aspect, column, row):
            total = wp.float64(irradiance) * pixel_fraction(tables, band, xy_px, column, row)
        return total

    @wp.kernel(module="unique", enable_backward=False)
    def blend_kernel(
        # in
        targets: TargetImages,
        tables: Tables,
        rule: StampRule,
        rules: StreakRules,
        # out
        nearest_px: wp.array3d[wp.float64],  # (n_view, n_band, n_target) to the nearest other with light
        own_w_cm2: wp.array3d[wp.float64],  # (n_view, n_band, n_target) light of a target in its own pixel
        others_w_cm2: wp.array3d[wp.float64],  # (n_view, n_band, n_target) light of others there
    ):
        view, band, number = wp.tid()
        if targets.irradiance_w_cm2[view, band, number] == 0.0:
            return
        nearest_px[view, band, number] = neighbour_px(targets, view, band, number)
        column = nearest_pixel(targets.xy_px[view, number][0])
        row = nearest_pixel(targets.xy_px[view, number][1])
        others = wp.float64(0.0)
        for i in range(targets.xy_px.shape[1]):
            if targets.irradiance_w_cm2[view, band, i] > 0.0:
                light = pixel_light(targets, tables, rule, rules, view, band, i, column, row)
                if i == number:
                    own_w_cm2[view, band, number] = light
                else:
                    others += light
        others_w_cm2[view, band, number] = others

    return blend_kernel
