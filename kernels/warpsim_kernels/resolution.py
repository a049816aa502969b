"""How well targets can be told apart and measured: neighbours, clumps, blended light and Cramer-Rao bounds, for truth.

The bounds are those of an unbiased fit of position and irradiance to one image, in which all else is known. With S the
noiseless light of the target and V the variance of the noise, both of a pixel p, the Fisher information of parameters
a and b is the sum over p of dS/da dS/db / V; bounds are the diagonal of its inverse (Winick 1986, J. Opt. Soc. Am. A 3,
1809; Kay 1993, Estimation Theory, chapter 3).
"""

import functools

import warp as wp

from warpsim_kernels.stamp_light import LightFunctions
from warpsim_kernels.stamps import StampRule, columns_of_row, nearest_pixel, stamp_around, stamp_cut, whole_plane
from warpsim_kernels.streaks import NO_LIMIT, Paths, StreakRules, moment_of, source_of, streak_of

WINDOW = wp.constant(1.5)
"""Pixels within so many merging distances of a target are fitted: what lies farther out makes bounds a few percent
smaller."""

STEP_PX = wp.constant(wp.float64(0.005))
"""Of central differences: their error is step^2 / 6 of the third derivative."""


@wp.struct
class TargetImages:
    """Targets as they are drawn."""

    xy_px: wp.array2d[wp.vec2d]  # (n_view, n_target)
    irradiance_w_cm2: wp.array3d[float]  # (n_view, n_band, n_target); 0 without light or behind the camera
    order: wp.array2d[wp.int32]  # (n_view, n_target) targets from left to right
    rank: wp.array2d[wp.int32]  # (n_view, n_target) index of each in order
    background_w_cm2: wp.array3d[float]  # (n_view, n_band, n_target) in its pixel; empty where there is none
    paths: Paths


@wp.struct
class PixelNoise:
    """Noise of the pixels; arrays are (n_band,)."""

    variance_w2_cm4: wp.array[wp.float64]  # on blank sky
    shot_w_cm2: wp.array[wp.float64]  # variance over the light that makes it
    sei_w_cm2: wp.array[wp.float64]  # light from which on a pixel is saturated
    n_row: int
    n_col: int


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
def is_drawn(xy_px: wp.vec2d, reach_px: float, aspect: float, column: int, row: int) -> bool:
    """Whether a pixel belongs to the stamp of a source."""
    stamp = stamp_around(xy_px, reach_px, aspect, whole_plane())
    columns = columns_of_row(stamp, row)
    in_row = row >= stamp.window.first_row and row < stamp.window.end_row
    return in_row and column >= columns[0] and column < columns[1]


@functools.cache
def make_resolution_kernel(light: LightFunctions, streaks: bool) -> wp.Kernel:
    """Kernel for one family of point spread functions; without streaks it looks at no paths."""
    Tables, reach_of, aspect_of, blur_of, pixel_fraction = light[:5]

    @wp.struct
    class Target:
        view: int
        band: int
        number: int
        xy_px: wp.vec2d
        irradiance_w_cm2: float
        cut: float
        reach_px: float
        way_px: wp.vec2  # largest distances from the middle of the exposure

    @wp.func
    def target_of(
        targets: TargetImages, tables: Tables, rule: StampRule, view: int, band: int, number: int
    ) -> Target:
        target = Target()
        target.view = view
        target.band = band
        target.number = number
        target.xy_px = targets.xy_px[view, number]
        target.irradiance_w_cm2 = targets.irradiance_w_cm2[view, band, number]
        cut = stamp_cut(target.irradiance_w_cm2, band, rule)
        target.reach_px = reach_of(tables, band, cut)
        target.cut = wp.max(cut, rule.streak_error)
        if wp.static(streaks):
            for k in range(targets.paths.offset_px.shape[2]):  # Legendre polynomials are at most 1
                offset_px = targets.paths.offset_px[view, number, k]
                target.way_px += wp.vec2(wp.abs(offset_px[0]), wp.abs(offset_px[1]))
        return target

    @wp.func
    def pixel_light(
        targets: TargetImages, tables: Tables, rules: StreakRules, target: Target, step_px: wp.vec2d, column: int,
        row: int,
    ) -> wp.float64:  # fmt: skip
        """Light of a target in a pixel, drawn a step away from where it is [W/cm2]; mean over the exposure."""
        band = target.band
        aspect = aspect_of(tables, band)
        total = wp.float64(0.0)
        if wp.static(streaks):
            source = source_of(target.view, band, target.number, target.xy_px, target.irradiance_w_cm2)
            streak = streak_of(targets.paths, source, target.cut, NO_LIMIT, blur_of(tables, band), rules)
            for panel in range(streak.n_panel):
                for node in range(streak.count):
                    moment = moment_of(targets.paths, source, streak, panel, node, rules)
                    if is_drawn(moment.xy_px, target.reach_px, aspect, column, row):
                        fraction = pixel_fraction(tables, band, moment.xy_px + step_px, column, row)
                        total += wp.float64(moment.irradiance_w_cm2) * fraction
        elif is_drawn(target.xy_px, target.reach_px, aspect, column, row):
            fraction = pixel_fraction(tables, band, target.xy_px + step_px, column, row)
            total = wp.float64(target.irradiance_w_cm2) * fraction
        return total

    @wp.kernel(module="unique", enable_backward=False)
    def resolution_kernel(
        # in
        targets: TargetImages,
        tables: Tables,
        rule: StampRule,
        rules: StreakRules,
        merge_px: wp.array[wp.vec2d],  # (n_band,)
        noise: PixelNoise,
        # out
        nearest_px: wp.array3d[wp.float64],  # (n_view, n_band, n_target) to the nearest other with light
        own_w_cm2: wp.array3d[wp.float64],  # (n_view, n_band, n_target) light of a target in its own pixel
        others_w_cm2: wp.array3d[wp.float64],  # (n_view, n_band, n_target) light of others there
        sigma: wp.array3d[wp.vec3d],  # (n_view, n_band, n_target) of x, y, and of the light over itself
    ):
        view, band, number = wp.tid()
        if targets.irradiance_w_cm2[view, band, number] == 0.0:
            return
        nearest_px[view, band, number] = neighbour_px(targets, view, band, number)
        own = target_of(targets, tables, rule, view, band, number)
        here = wp.vec2d()
        column = nearest_pixel(own.xy_px[0])
        row = nearest_pixel(own.xy_px[1])
        own_w_cm2[view, band, number] = pixel_light(targets, tables, rules, own, here, column, row)
        others = wp.float64(0.0)
        for i in range(targets.xy_px.shape[1]):
            if i != number and targets.irradiance_w_cm2[view, band, i] > 0.0:
                other = target_of(targets, tables, rule, view, band, i)
                far_px = wp.float64(other.reach_px + other.way_px[0] + 1.0)
                if wp.abs(other.xy_px[0] - wp.float64(column)) <= far_px:
                    others += pixel_light(targets, tables, rules, other, here, column, row)
        others_w_cm2[view, band, number] = others

        background = wp.float64(0.0)
        if targets.background_w_cm2.shape[0] > 0:
            background = wp.max(wp.float64(targets.background_w_cm2[view, band, number]), wp.float64(0.0))
        n_column = int(wp.ceil(WINDOW * float(merge_px[band][0]) + own.way_px[0]))
        n_row = int(wp.ceil(WINDOW * float(merge_px[band][1]) + own.way_px[1]))
        along = wp.vec2d(STEP_PX, wp.float64(0.0))
        down = wp.vec2d(wp.float64(0.0), STEP_PX)
        fisher = wp.mat33d()
        for y in range(wp.max(row - n_row, 0), wp.min(row + n_row + 1, noise.n_row)):
            for x in range(wp.max(column - n_column, 0), wp.min(column + n_column + 1, noise.n_col)):
                s = pixel_light(targets, tables, rules, own, here, x, y)
                if s > wp.float64(0.0) and s + background < noise.sei_w_cm2[band]:
                    by_x = pixel_light(targets, tables, rules, own, along, x, y)
                    by_x -= pixel_light(targets, tables, rules, own, -along, x, y)
                    by_y = pixel_light(targets, tables, rules, own, down, x, y)
                    by_y -= pixel_light(targets, tables, rules, own, -down, x, y)
                    double = wp.float64(2.0) * STEP_PX
                    slope = wp.vec3d(by_x / double, by_y / double, s)
                    variance = noise.variance_w2_cm4[band] + noise.shot_w_cm2[band] * (s + background)
                    fisher += wp.outer(slope, slope) / variance
        sigma[view, band, number] = bounds(fisher)

    return resolution_kernel
