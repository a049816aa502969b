"""Quadrature in time: a source that moves or changes during the exposure is drawn as a few still ones.

A pixel's light is the mean over the exposure of brightness times the pixel fraction at the source's position. Gauss-
Legendre nodes take that mean; how many it takes follows from the length of the streak against the width of the image,
and from the error allowed.

Over the exposure, time runs as t in [-1, 1]. Position and brightness are series of Legendre polynomials in t; a source
that stands still at constant light has none of them.
"""

import warp as wp

from warpsim_kernels.stamps import Window, touches

STEPS_PER_DECADE = wp.constant(2.0)
"""Steps of the error allowed in StreakRules.longest."""

SAFETY = wp.constant(2.0)
"""Errors allowed are divided by it: the thresholds are those of one edge of a pixel, which has four."""

BAND_SLOPE = wp.constant(0.592)
BAND_MARGIN = wp.constant(2.5)
"""n nodes see every frequency of a streak that is up to BAND_SLOPE n - BAND_MARGIN waves long. Theory: n > pi / 2 for
each wave, and a margin that grows as the cube root; measured for errors down to 1e-7."""

FEW_TERMS = wp.constant(4)
"""Paths of so many terms are bounded term by term; those of more, as of jitter, are far from all steepest at once."""

EHLICH_ZELLER = wp.constant(1.0824)
"""1 / cos(pi / 8), for four points to a degree."""

MOST_PANELS = wp.constant(1_000_000)
NO_LIMIT = wp.constant(1.0e30)


@wp.struct
class Paths:
    """Movement and change of brightness of a chunk's sources over the exposure; empty arrays where nothing moves."""

    offset_px: wp.array3d[wp.vec2]  # (n_view, n_slot, n_path) position minus the source's xy_px: coefficients
    brightness: wp.array4d[float]  # (n_view, n_band, n_target, n_profile) over the mean (first is 1); stars: constant
    n_target: int  # slots before stars begin


@wp.struct
class StreakRules:
    """Gauss-Legendre rules of several counts, and how long a streak each can serve."""

    count: wp.array[wp.int32]  # (n_rule,) nodes, growing
    first: wp.array[wp.int32]  # (n_rule,) index of its first node in node and weight
    node: wp.array[wp.float64]  # in (-1, 1)
    weight: wp.array[wp.float64]  # the weights of a rule sum to 1
    longest: wp.array2d[float]  # (n_level, n_rule) streak over blur width, for an error of 10^(-level / 2)


@wp.struct
class Blur:
    """Sharpness of a point's image, for the count of nodes."""

    width_px: float  # sigma of a Gaussian whose transfer function is nowhere below the image's [pixel widths]
    band_limit_per_px: float  # highest spatial frequency of the image; NO_LIMIT where there is none
    aspect: float  # height of a pixel over its width


@wp.struct
class Source:
    """A source of a view in one band."""

    view: int
    band: int
    slot: int
    xy_px: wp.vec2d  # in the middle of the exposure
    irradiance_w_cm2: float


@wp.func
def source_of(view: int, band: int, slot: int, xy_px: wp.vec2d, irradiance_w_cm2: float) -> Source:
    """A source as one value."""
    source = Source()
    source.view = view
    source.band = band
    source.slot = slot
    source.xy_px = xy_px
    source.irradiance_w_cm2 = irradiance_w_cm2
    return source


@wp.struct
class Streak:
    """Nodes for one source: n_panel parts of the exposure, all alike, each with a rule of `count` nodes."""

    n_panel: int
    count: int
    first: int  # of the rule in StreakRules.node
    extra: int  # nodes among them that serve the bend of the path and the change of brightness


@wp.struct
class Moment:
    """One node: where the source is, and the light that it gives there."""

    xy_px: wp.vec2d
    irradiance_w_cm2: float


@wp.func
def next_legendre(k: int, t: wp.float64, legendre: wp.float64, before: wp.float64) -> wp.float64:
    """Legendre polynomial of degree k + 1 from those of k and k - 1."""
    n = wp.float64(k)
    return ((n + n + wp.float64(1.0)) * t * legendre - n * before) / (n + wp.float64(1.0))


@wp.func
def position_px(paths: Paths, source: Source, t: wp.float64) -> wp.vec2d:
    """Position at the time t in [-1, 1] of the exposure."""
    position = source.xy_px
    before = wp.float64(0.0)
    legendre = wp.float64(1.0)
    for k in range(paths.offset_px.shape[2]):
        term = paths.offset_px[source.view, source.slot, k]
        position += legendre * wp.vec2d(wp.float64(term[0]), wp.float64(term[1]))
        after = next_legendre(k, t, legendre, before)
        before = legendre
        legendre = after
    return position


@wp.func
def n_profile(paths: Paths, source: Source) -> int:
    """Terms of a source's brightness; none for stars, which do not change."""
    if source.slot < paths.n_target:
        return paths.brightness.shape[3]
    return 0


@wp.func
def brightness_at(paths: Paths, source: Source, t: wp.float64) -> wp.float64:
    """Brightness at the time t over its mean."""
    n_term = n_profile(paths, source)
    if n_term == 0:
        return wp.float64(1.0)
    brightness = wp.float64(0.0)
    before = wp.float64(0.0)
    legendre = wp.float64(1.0)
    for k in range(n_term):
        brightness += legendre * wp.float64(paths.brightness[source.view, source.band, source.slot, k])
        after = next_legendre(k, t, legendre, before)
        before = legendre
        legendre = after
    return brightness


@wp.func
def highest_brightness(paths: Paths, source: Source) -> float:
    """Largest brightness over its mean, or somewhat more."""
    highest = float(0.0)
    for k in range(n_profile(paths, source)):
        highest += wp.abs(paths.brightness[source.view, source.band, source.slot, k])
    return wp.max(highest, 1.0)


@wp.func
def light_centre_px(paths: Paths, source: Source) -> wp.vec2d:
    """Mean position over the exposure, weighted with brightness."""
    n_term = n_profile(paths, source)
    centre = source.xy_px
    for k in range(paths.offset_px.shape[2]):
        weight = wp.float64(0.0)
        if k == 0:
            weight = wp.float64(1.0)
        elif k < n_term:
            weight = wp.float64(paths.brightness[source.view, source.band, source.slot, k]) / wp.float64(2 * k + 1)
        term = paths.offset_px[source.view, source.slot, k]
        centre += weight * wp.vec2d(wp.float64(term[0]), wp.float64(term[1]))
    return centre


@wp.func
def is_streak_near(paths: Paths, source: Source, reach_px: float, aspect: float, window: Window) -> bool:
    """Return whether a disc that follows the path may touch the window; a row more, as in stamp_around."""
    box_px = wp.vec2d(wp.float64(reach_px + 1.0), wp.float64(reach_px / aspect + 1.0))
    for k in range(paths.offset_px.shape[2]):
        term = paths.offset_px[source.view, source.slot, k]
        box_px += wp.vec2d(wp.float64(wp.abs(term[0])), wp.float64(wp.abs(term[1])))
    return touches(window, source.xy_px, box_px)


@wp.func
def highest_speed_px(paths: Paths, source: Source, aspect: float) -> float:
    """Largest speed over the exposure, or 8 % more [px in half an exposure]; of paths of many terms.

    A polynomial of degree d is nowhere beyond 1 / cos(pi d / 2 m) of its largest value at m Chebyshev points (Ehlich
    and Zeller 1964, Math. Z. 86, 41), and so is a vector of them; here m is 4 d.
    """
    n_point = 4 * (paths.offset_px.shape[2] - 2)
    fastest = wp.float64(0.0)
    for j in range(n_point):
        t = wp.cos(wp.float64(wp.PI) * (wp.float64(j) + wp.float64(0.5)) / wp.float64(n_point))
        speed = wp.vec2d()
        before = wp.float64(0.0)
        legendre = wp.float64(1.0)
        slope_before = wp.float64(0.0)
        slope = wp.float64(0.0)
        for k in range(paths.offset_px.shape[2]):
            term = paths.offset_px[source.view, source.slot, k]
            speed += slope * wp.vec2d(wp.float64(term[0]), wp.float64(term[1] * aspect))
            after = next_legendre(k, t, legendre, before)
            slope_after = slope_before + wp.float64(2 * k + 1) * legendre
            before = legendre
            legendre = after
            slope_before = slope
            slope = slope_after
        fastest = wp.max(fastest, wp.length(speed))
    return EHLICH_ZELLER * float(fastest)


@wp.func
def streak_length_px(paths: Paths, source: Source, aspect: float) -> float:
    """Largest speed times the exposure, or somewhat more [pixel widths]; the length of a straight, even streak."""
    if paths.offset_px.shape[2] > FEW_TERMS:
        return 2.0 * highest_speed_px(paths, source, aspect)
    speed = wp.vec2()
    for k in range(1, paths.offset_px.shape[2]):
        term = paths.offset_px[source.view, source.slot, k]
        steepest = float(k * (k + 1)) * 0.5  # of a Legendre polynomial, at the ends
        speed += steepest * wp.vec2(wp.abs(term[0]), wp.abs(term[1]) * aspect)
    return 2.0 * wp.length(speed)


@wp.func
def extra_nodes(paths: Paths, source: Source, length_px: float, error: float, blur: Blur) -> int:
    """Nodes that a bent path and a changing brightness take more than a straight, steady streak.

    A rule of n nodes is exact to degree 2 n - 1, and brightness has the degree of its series. A straight path makes a
    power series of the image one of time; a path of degree k makes its n-th power one of degree k n.
    """
    extra = n_profile(paths, source) // 2
    degree = paths.offset_px.shape[2] - 1
    bend = wp.vec2()
    for k in range(2, degree + 1):
        term = paths.offset_px[source.view, source.slot, k]
        bend += wp.vec2(wp.abs(term[0]), wp.abs(term[1]) * blur.aspect)
    bend_px = wp.length(bend)
    # The second term of the series in offset / width, of which the factor is at most 1/4, is the first to differ.
    if 0.25 * bend_px * (0.5 * length_px + bend_px) > error * blur.width_px * blur.width_px:
        extra += degree + 1
    return extra


@wp.func
def rule_reaches(rules: StreakRules, error: float, rule: int, length_px: float, blur: Blur) -> bool:
    """Return whether a rule serves a streak of this length."""
    step = int(wp.ceil(-wp.log10(wp.clamp(error, 1.0e-30, 1.0)) * STEPS_PER_DECADE))
    level = wp.min(step, rules.longest.shape[0] - 1)
    return length_px <= rules.longest[level, rule] * blur.width_px or (
        length_px * blur.band_limit_per_px <= BAND_SLOPE * float(rules.count[rule]) - BAND_MARGIN
    )


@wp.func
def with_rule(streak: Streak, n_node: int, rules: StreakRules) -> Streak:
    """Return the same panels with the smallest rule of n_node nodes or more."""
    rule = int(0)
    while rule < rules.count.shape[0] - 1 and rules.count[rule] < n_node:
        rule += 1
    result = streak
    result.count = rules.count[rule]
    result.first = rules.first[rule]
    return result


@wp.func
def streak_of(
    paths: Paths, source: Source, error: float, longest_panel_px: float, blur: Blur, rules: StreakRules
) -> Streak:
    """The fewest nodes that keep a source's pixels within `error` of its light.

    Where even the largest rule is too short, and where parts longer than longest_panel_px are not allowed, the exposure
    is cut into panels, which divide the light and the error.
    """
    streak = Streak()
    streak.n_panel = 1
    streak = with_rule(streak, 1, rules)
    allowed = error / (SAFETY * highest_brightness(paths, source))
    length_px = streak_length_px(paths, source, blur.aspect)
    if rule_reaches(rules, allowed, 0, length_px, blur):
        return streak
    streak.extra = extra_nodes(paths, source, length_px, allowed, blur)
    last = rules.count.shape[0] - 1
    largest = last
    while largest > 0 and rules.count[largest] + streak.extra > rules.count[last]:
        largest -= 1
    n = wp.max(int(wp.ceil(wp.min(length_px / longest_panel_px, float(MOST_PANELS)))), 1)
    while n < MOST_PANELS and not rule_reaches(rules, allowed * float(n), largest, length_px / float(n), blur):
        n += n // 8 + 1
    rule = int(0)
    while rule < largest and not rule_reaches(rules, allowed * float(n), rule, length_px / float(n), blur):
        rule += 1
    streak.n_panel = n
    return with_rule(streak, rules.count[rule] + streak.extra, rules)


@wp.func
def panel_edge_px(paths: Paths, source: Source, streak: Streak, panel: int) -> wp.vec2d:
    """Position at the start of a panel."""
    return position_px(paths, source, wp.float64(2 * panel - streak.n_panel) / wp.float64(streak.n_panel))


@wp.func
def moment_of(paths: Paths, source: Source, streak: Streak, panel: int, node: int, rules: StreakRules) -> Moment:
    """A node of a panel. A single one stands at the centre of light, which is exact to first order in the length."""
    moment = Moment()
    if streak.n_panel * streak.count == 1:
        moment.xy_px = light_centre_px(paths, source)
        moment.irradiance_w_cm2 = source.irradiance_w_cm2
        return moment
    width = wp.float64(1.0) / wp.float64(streak.n_panel)
    t = (wp.float64(2 * panel - streak.n_panel + 1) + rules.node[streak.first + node]) * width
    weight = rules.weight[streak.first + node] * width * brightness_at(paths, source, t)
    moment.xy_px = position_px(paths, source, t)
    moment.irradiance_w_cm2 = source.irradiance_w_cm2 * float(weight)
    return moment
