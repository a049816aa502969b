"""Areas of the Earth's light with what they change by, float64: derivatives of `earth_infrared` and `earth_albedo`.

They are those of the same tables, which are linear between nodes: that of infrared jumps where a normal passes a node.
"""

import functools
import math

import warp as wp

from warpsim_kernels.area_slopes import (
    BASE,
    RADIUS,
    SIDE,
    TOP,
    AreaSlopes,
    level_of,
    with_direction,
    with_side,
)
from warpsim_kernels.earth import height_position
from warpsim_kernels.earth_albedo import albedo_series_of, damping, kept_harmonics, sample_weights, step
from warpsim_kernels.earth_infrared import COSINES, ELEMENT, N_SAMPLE, SPHERE, WAVES, Samples
from warpsim_kernels.shapes import Body, Facets, lit_half_arc

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_HALF = wp.constant(wp.float64(0.5))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_LEAST = wp.constant(wp.float64(1.0e-30))


@functools.cache
def moment_slopes_of(n_order: int) -> wp.Function:
    """The function (a, b): what `positive_moments` change by with a, and with b; rows of a matrix."""
    Slopes = wp.types.matrix(shape=(2, n_order), dtype=wp.float64)
    Moments = wp.types.vector(length=n_order, dtype=wp.float64)
    inverse = wp.constant(Moments(*(1.0 / (m + 1.0) for m in range(n_order))))

    @wp.func
    def moment_slopes(a: wp.float64, b: wp.float64) -> Slopes:
        slopes = Slopes()
        if a <= -b:
            return slopes
        now = lit_half_arc(a, b)
        if a >= b:
            slopes[0, 0] = _TWO * now
            slopes[1, 1] = now
            return slopes
        this = wp.sqrt((b - a) * (b + a)) / b
        before = this
        last = _ZERO
        turning = -_TWO * a / b
        for m in range(n_order):
            following = this * inverse[m]  # sin((m + 1) half) / (m + 1)
            slopes[0, m] = _TWO * now
            slopes[1, m] = before + following
            before = now
            now = following
            after = turning * this - last
            last = this
            this = after
        return slopes

    return moment_slopes


@wp.func
def received_slopes(table: wp.array3d[wp.vec4d], part: int, height: wp.float64, cosine: wp.float64) -> wp.vec2d:
    """As `received`, and its change with the cosine."""
    per_cosine = _HALF * wp.float64(table.shape[2])
    position = (_ONE + cosine) * per_cosine
    row = wp.clamp(int(height), 0, table.shape[1] - 1)
    column = wp.clamp(int(position), 0, table.shape[2] - 1)
    cell = table[part, row, column]
    v = position - wp.float64(column)
    u = height - wp.float64(row)
    return wp.vec2d(cell[0] + cell[1] * v + (cell[2] + cell[3] * v) * u, (cell[1] + cell[3] * u) * per_cosine)


_infrared_moments = moment_slopes_of(N_SAMPLE)


@wp.func
def _infrared_side(
    slopes: AreaSlopes, table: wp.array3d[wp.vec4d], height: wp.float64, body: Body, view: wp.vec3d, nadir: wp.vec3d
) -> AreaSlopes:
    """Add the side, by the waves of what it receives around it."""
    seen = level_of(view)
    below = level_of(nadir)
    apart = wp.dot(seen.ahead, below.ahead)
    a = body.side_along * view[2]
    b = body.side_across * seen.length
    moments = _infrared_moments(a, b)
    cosine = body.side_along * nadir[2]
    swing = body.side_across * below.length
    light = Samples()
    rise = Samples()
    for j in range(wp.static(N_SAMPLE)):
        sample = received_slopes(table, ELEMENT, height, cosine + swing * COSINES[j])
        light[j] = sample[0]
        rise[j] = sample[1]
    light = WAVES * light
    swings = WAVES * wp.cw_mul(rise, COSINES)
    rise = WAVES * rise
    by_a = _ZERO
    by_b = _ZERO
    by_apart = _ZERO
    by_cosine = _ZERO
    by_swing = _ZERO
    wave = _ONE  # cos(m apart)
    last = apart
    turning = _ZERO  # its change with the cosine of apart
    before = _ZERO
    for m in range(wp.static(N_SAMPLE)):
        moment = a * moments[0, m] + b * moments[1, m]
        by_a += moments[0, m] * wave * light[m]
        by_b += moments[1, m] * wave * light[m]
        by_apart += moment * turning * light[m]
        by_cosine += moment * wave * rise[m]
        by_swing += moment * wave * swings[m]
        following = _TWO * apart * wave - last
        turned = _TWO * wave + _TWO * apart * turning - before
        if wp.static(m == 0):
            following = apart
            turned = _ONE
        last = wave
        wave = following
        before = turning
        turning = turned
    result = slopes
    total = a * by_a + b * by_b
    result.shape[SIDE] = total / _TWO_PI
    result.area_m2 = slopes.area_m2 + body.side_m2 / _TWO_PI * total
    per_side = body.side_m2 / _TWO_PI
    # The cosine between the azimuths changes with what is across each of them.
    by_view = seen.ahead * by_b + (below.ahead - seen.ahead * apart) * (by_apart / wp.max(b, _LEAST))
    by_nadir = below.ahead * by_swing + (seen.ahead - below.ahead * apart) * (by_apart / wp.max(swing, _LEAST))
    by_view = by_view + wp.vec3d(_ZERO, _ZERO, by_a)
    by_nadir = by_nadir + wp.vec3d(_ZERO, _ZERO, by_cosine)
    return with_side(with_side(result, body, view, by_view * per_side), body, nadir, by_nadir * per_side)


@wp.func
def scaled_slopes(slopes: AreaSlopes, factor: wp.float64) -> AreaSlopes:
    """An area times a number."""
    result = AreaSlopes()
    result.area_m2 = slopes.area_m2 * factor
    result.torque = slopes.torque * factor
    result.shape = slopes.shape * factor
    return result


@wp.func
def infrared_slopes(
    table: wp.array3d[wp.vec4d], body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64
) -> AreaSlopes:
    """As `earth_area_m2`."""
    height = height_position(limb_sine, table.shape[1] + 1)
    slopes = AreaSlopes()
    if body.radius_m > _ZERO:
        light = received_slopes(table, SPHERE, height, wp.dot(view, nadir))
        slopes.area_m2 = body.radius_m * body.radius_m * light[0]
        slopes.shape[RADIUS] = _TWO * body.radius_m * light[0]
    elif body.n_facet > 0:
        by_view = wp.vec3d()
        by_nadir = wp.vec3d()
        for i in range(body.first_facet, body.first_facet + body.n_facet):
            seen = wp.dot(facets.normal[i], view)
            if seen > _ZERO:
                light = received_slopes(table, ELEMENT, height, wp.dot(facets.normal[i], nadir))
                slopes.area_m2 += facets.area_m2[i] * seen * light[0]
                by_view += facets.normal[i] * (facets.area_m2[i] * light[0])
                by_nadir += facets.normal[i] * (facets.area_m2[i] * seen * light[1])
        slopes = with_direction(with_direction(slopes, view, by_view), nadir, by_nadir)
    else:
        up = wp.where(view[2] > _ZERO, _ONE, -_ONE)
        end_m2 = wp.where(view[2] > _ZERO, body.top_m2, body.base_m2)
        light = received_slopes(table, ELEMENT, height, up * nadir[2])
        slopes.area_m2 = end_m2 * up * view[2] * light[0]
        slopes = with_direction(slopes, view, wp.vec3d(_ZERO, _ZERO, end_m2 * up * light[0]))
        slopes = with_direction(slopes, nadir, wp.vec3d(_ZERO, _ZERO, end_m2 * view[2] * light[1]))
        if body.side_m2 > _ZERO:
            slopes = _infrared_side(slopes, table, height, body, view, nadir)
        slopes.shape[TOP] = wp.where(view[2] > _ZERO, view[2] * light[0], _ZERO)
        slopes.shape[BASE] = wp.where(view[2] > _ZERO, _ZERO, -view[2] * light[0])
    if slopes.area_m2 <= _ZERO:
        return AreaSlopes()
    return scaled_slopes(slopes, limb_sine * limb_sine)


@functools.cache
def albedo_slopes_of(degree: int) -> wp.Function:
    """The function of albedo's area with its changes, by the series up to an even degree."""
    n_order = degree + 1
    number = {key: k for k, key in enumerate(kept_harmonics(degree))}
    Harmonics = albedo_series_of(degree).Harmonics
    spread = wp.constant(Harmonics(*(damping(l) for l, _ in kept_harmonics(degree))))
    Moments = wp.types.vector(length=n_order, dtype=wp.float64)
    weights = [Moments(*sample_weights(degree, j)) for j in range(n_order)]
    moment_slopes = moment_slopes_of(n_order)

    def summer(m: int) -> wp.Function:
        @wp.func
        def order_slopes(light: Harmonics, cosine: wp.float64) -> wp.vec2d:
            """As `sum_order`, and its change with the cosine."""
            total = _ZERO
            slope = _ZERO
            q = _ONE
            q_last = _ZERO
            d = _ZERO
            d_last = _ZERO
            for l in range(m, n_order):
                if wp.static((l, m) in number):
                    total += light[wp.static(number.get((l, m), 0))] * q
                    slope += light[wp.static(number.get((l, m), 0))] * d
                b = wp.float64(wp.static(step(l, m)))
                d_next = q + cosine * d - b * d_last
                q_next = cosine * q - b * q_last
                q_last = q
                q = q_next
                d_last = d
                d = d_next
            return wp.vec2d(total, slope)

        return order_slopes

    summers = [summer(m) for m in range(n_order)]

    @wp.func
    def element_slopes(light: Harmonics, cosine: wp.float64, along: wp.float64) -> wp.vec3d:
        """As `element_sr`, and its changes with the normal's part along the nadir and along the Sun's level."""
        sine2 = (_ONE - cosine) * (_ONE + cosine)
        total = _ZERO
        by_cosine = _ZERO
        by_along = _ZERO
        turned = _ONE  # sin^m cos(m azimuth), and its changes
        turned_c = _ZERO
        turned_d = _ZERO
        last = along
        last_c = _ZERO
        last_d = _ONE
        for m in range(n_order):
            order = wp.static(summers[m])(light, cosine)
            total += turned * order[0]
            by_cosine += turned * order[1] + turned_c * order[0]
            by_along += turned_d * order[0]
            after = _TWO * along * turned - sine2 * last
            after_c = _TWO * along * turned_c - sine2 * last_c + _TWO * cosine * last
            after_d = _TWO * (turned + along * turned_d) - sine2 * last_d
            if wp.static(m == 0):
                after = along
                after_c = _ZERO
                after_d = _ONE
            last = turned
            last_c = turned_c
            last_d = turned_d
            turned = after
            turned_c = after_c
            turned_d = after_d
        return wp.vec3d(total, by_cosine, by_along)

    @wp.struct
    class AroundSide:
        """Sums over samples around the side."""

        by_a: wp.float64
        by_b: wp.float64
        by_nadir: wp.vec3d  # change with D nadir and D level; azimuth from the view's
        by_level: wp.vec3d

    @wp.func
    def side_slopes(
        slopes: AreaSlopes, light: Harmonics, body: Body, view: wp.vec3d, nadir: wp.vec3d, level: wp.vec3d
    ) -> AreaSlopes:
        """Add a turned body's side."""
        seen = level_of(view)
        a = body.side_along * view[2]
        b = body.side_across * seen.length
        moments = moment_slopes(a, b)
        c = wp.vec3d(wp.dot(seen.ahead, nadir), wp.dot(seen.beside, nadir), nadir[2])
        d = wp.vec3d(wp.dot(seen.ahead, level), wp.dot(seen.beside, level), level[2])
        across = body.side_across
        along = body.side_along
        sums = AroundSide()
        for j in range(n_order):
            by_a = wp.dot(moments[0], wp.static(weights[j]))
            by_b = wp.dot(moments[1], wp.static(weights[j]))
            share = a * by_a + b * by_b
            x = wp.float64(wp.static(math.cos(2.0 * math.pi * j / (2 * n_order - 1))))
            y = wp.float64(wp.static(math.sin(2.0 * math.pi * j / (2 * n_order - 1))))
            one = element_slopes(
                light, along * c[2] + across * (c[0] * x + c[1] * y), along * d[2] + across * (d[0] * x + d[1] * y)
            )
            both = one
            beside = one * y
            if wp.static(j > 0):
                other = element_slopes(
                    light, along * c[2] + across * (c[0] * x - c[1] * y), along * d[2] + across * (d[0] * x - d[1] * y)
                )
                both = one + other
                beside = (one - other) * y
            sums.by_a += by_a * both[0]
            sums.by_b += by_b * both[0]
            sums.by_nadir += wp.vec3d(both[1] * x, beside[1], both[1]) * share
            sums.by_level += wp.vec3d(both[2] * x, beside[2], both[2]) * share
        total = a * sums.by_a + b * sums.by_b
        result = slopes
        per_side = body.side_m2 / _TWO_PI
        result.shape[SIDE] = total / _TWO_PI
        result.area_m2 = slopes.area_m2 + per_side * total
        by_nadir = seen.ahead * sums.by_nadir[0] + seen.beside * sums.by_nadir[1]
        by_level = seen.ahead * sums.by_level[0] + seen.beside * sums.by_level[1]
        # A turn of the view about z is one of the others the other way.
        about = wp.cross(nadir, by_nadir)[2] + wp.cross(level, by_level)[2]
        by_view = seen.ahead * sums.by_b - seen.beside * (about / wp.max(seen.length, _LEAST))
        by_view = by_view + wp.vec3d(_ZERO, _ZERO, sums.by_a)
        by_nadir = by_nadir + wp.vec3d(_ZERO, _ZERO, sums.by_nadir[2])
        by_level = by_level + wp.vec3d(_ZERO, _ZERO, sums.by_level[2])
        result = with_side(result, body, view, by_view * per_side)
        result = with_side(result, body, nadir, by_nadir * per_side)
        return with_side(result, body, level, by_level * per_side)

    @wp.func
    def facet_slopes(
        light: Harmonics, body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, level: wp.vec3d
    ) -> AreaSlopes:
        """Area of a mesh."""
        slopes = AreaSlopes()
        by_view = wp.vec3d()
        by_nadir = wp.vec3d()
        by_level = wp.vec3d()
        for i in range(body.first_facet, body.first_facet + body.n_facet):
            normal = facets.normal[i]
            seen = wp.dot(normal, view)
            if seen > _ZERO:
                element = element_slopes(light, wp.dot(normal, nadir), wp.dot(normal, level)) * facets.area_m2[i]
                slopes.area_m2 += seen * element[0]
                by_view += normal * element[0]
                by_nadir += normal * (seen * element[1])
                by_level += normal * (seen * element[2])
        slopes = with_direction(with_direction(slopes, view, by_view), nadir, by_nadir)
        return with_direction(slopes, level, by_level)

    @wp.func
    def albedo_slopes(
        light: Harmonics, body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, level: wp.vec3d
    ) -> AreaSlopes:
        """As `area_m2_sr`; level: horizontal direction of the Sun, unit."""
        slopes = AreaSlopes()
        if body.radius_m > _ZERO:
            sphere = wp.cw_mul(light, spread)
            element = element_slopes(sphere, wp.dot(view, nadir), wp.dot(view, level))
            slopes.area_m2 = body.radius_m * body.radius_m * element[0]
            slopes.shape[RADIUS] = _TWO * body.radius_m * element[0]
        elif body.n_facet > 0:
            slopes = facet_slopes(light, body, facets, view, nadir, level)
        else:
            up = wp.where(view[2] > _ZERO, _ONE, -_ONE)
            end_m2 = wp.where(view[2] > _ZERO, body.top_m2, body.base_m2)
            element = wp.vec3d()
            if end_m2 > _ZERO:
                element = element_slopes(light, up * nadir[2], up * level[2])
            slopes.area_m2 = end_m2 * up * view[2] * element[0]
            slopes = with_direction(slopes, view, wp.vec3d(_ZERO, _ZERO, end_m2 * up * element[0]))
            slopes = with_direction(slopes, nadir, wp.vec3d(_ZERO, _ZERO, end_m2 * view[2] * element[1]))
            slopes = with_direction(slopes, level, wp.vec3d(_ZERO, _ZERO, end_m2 * view[2] * element[2]))
            if body.side_m2 > _ZERO:
                slopes = side_slopes(slopes, light, body, view, nadir, level)
            slopes.shape[TOP] = wp.where(view[2] > _ZERO, view[2] * element[0], _ZERO)
            slopes.shape[BASE] = wp.where(view[2] > _ZERO, _ZERO, -view[2] * element[0])
        if slopes.area_m2 <= _ZERO:
            return AreaSlopes()
        return slopes

    return albedo_slopes
