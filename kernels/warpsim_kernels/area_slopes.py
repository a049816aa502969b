"""Projected and reflected areas with what they change by: with a turn of the body, and with its shape; float64.

The side of a turned body has the normals D n, n = (cos x, sin x, 1), D = diag(across, across, along). Its areas are
integrals over x of a product that is 0 at both ends of the arc, so that the arc's ends do not count in a derivative.
With D taken into the directions, v = D view and s = D sun, they are integrals of n.v and of n.v n.s = v' M s, where M
has the moments of the arc: what they change by with v and s follows at once.
"""

import warp as wp

from warpsim_kernels.angles import angle_from_x
from warpsim_kernels.shapes import Body, Facets, lit_half_arc

_PI = wp.constant(wp.float64(3.141592653589793))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_HALF = wp.constant(wp.float64(0.5))

RADIUS, TOP, BASE, SIDE, ACROSS, ALONG = (wp.constant(number) for number in range(6))
"""Columns of `ShapeVector`, the members of a Body."""

ShapeVector = wp.types.vector(length=6, dtype=wp.float64)


@wp.struct
class AreaSlopes:
    """An area and what it changes by."""

    area_m2: wp.float64
    torque: wp.vec3d  # with a small turn of the body [m2/rad], body axes
    shape: ShapeVector  # with the members of its Body


@wp.struct
class Level:
    """The part of a direction across a body's axis."""

    length: wp.float64
    ahead: wp.vec3d  # unit; body axis x where the length is 0
    beside: wp.vec3d  # z x ahead


@wp.func
def level_of(direction: wp.vec3d) -> Level:
    """Part of a direction across the z axis."""
    level = Level()
    level.length = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    level.ahead = wp.vec3d(_ONE, _ZERO, _ZERO)
    if level.length > _ZERO:
        level.ahead = wp.vec3d(direction[0] / level.length, direction[1] / level.length, _ZERO)
    level.beside = wp.vec3d(-level.ahead[1], level.ahead[0], _ZERO)
    return level


@wp.func
def with_direction(slopes: AreaSlopes, direction: wp.vec3d, slope: wp.vec3d) -> AreaSlopes:
    """Add what a direction does to a turn: `slope` is the area's change with it; body axes."""
    result = slopes
    result.torque = slopes.torque + wp.cross(slope, direction)
    return result


@wp.func
def with_side(slopes: AreaSlopes, body: Body, direction: wp.vec3d, slope: wp.vec3d) -> AreaSlopes:
    """Add what a direction does by the side: `slope` is the area's change with D direction; body axes."""
    across = body.side_across
    result = with_direction(
        slopes, direction, wp.vec3d(across * slope[0], across * slope[1], body.side_along * slope[2])
    )
    result.shape[ACROSS] = slopes.shape[ACROSS] + slope[0] * direction[0] + slope[1] * direction[1]
    result.shape[ALONG] = slopes.shape[ALONG] + slope[2] * direction[2]
    return result


@wp.func
def projected_slopes(body: Body, facets: Facets, view: wp.vec3d) -> AreaSlopes:
    """Projected area of a body of any kind; view: unit, body axes."""
    slopes = AreaSlopes()
    if body.n_facet > 0:
        slope = wp.vec3d()
        for i in range(body.first_facet, body.first_facet + body.n_facet):
            seen = wp.dot(facets.normal[i], view)
            if seen > _ZERO:
                slopes.area_m2 += facets.area_m2[i] * seen
                slope += facets.normal[i] * facets.area_m2[i]
        return with_direction(slopes, view, slope)
    if body.radius_m > _ZERO:
        slopes.area_m2 = _PI * body.radius_m * body.radius_m
        slopes.shape[RADIUS] = _TWO_PI * body.radius_m
        return slopes
    level = level_of(view)
    a = body.side_along * view[2]
    b = body.side_across * level.length
    half = lit_half_arc(a, b)
    sine = _ZERO  # of half the arc
    if b > wp.abs(a):
        sine = wp.sqrt((b - a) * (b + a)) / b
    side = (a * half + b * sine) / _PI
    slopes.shape[TOP] = wp.max(view[2], _ZERO)
    slopes.shape[BASE] = wp.max(-view[2], _ZERO)
    slopes.shape[SIDE] = side
    slopes.area_m2 = body.top_m2 * slopes.shape[TOP] + body.base_m2 * slopes.shape[BASE] + body.side_m2 * side
    ends = wp.where(view[2] > _ZERO, body.top_m2, -body.base_m2)
    slopes = with_direction(slopes, view, wp.vec3d(_ZERO, _ZERO, ends))
    per_side = body.side_m2 / _PI
    return with_side(slopes, body, view, level.ahead * (per_side * sine) + wp.vec3d(_ZERO, _ZERO, per_side * half))


@wp.func
def _arc_moments(start: wp.float64, end: wp.float64) -> wp.mat33d:
    """Integral of n n', n = (cos x, sin x, 1), from start to end; 0 if they are in the wrong order."""
    if end <= start:
        return wp.mat33d()
    s0 = wp.sin(start)
    c0 = wp.cos(start)
    s1 = wp.sin(end)
    c1 = wp.cos(end)
    width = end - start
    cc = _HALF * (width + s1 * c1 - s0 * c0)
    sc = _HALF * (s1 - s0) * (s1 + s0)
    return wp.mat33d(cc, sc, s1 - s0, sc, width - cc, c0 - c1, s1 - s0, c0 - c1, width)


@wp.func
def _facets_reflected_slopes(body: Body, facets: Facets, view: wp.vec3d, sun: wp.vec3d) -> AreaSlopes:
    """Reflected area of a mesh."""
    slopes = AreaSlopes()
    by_view = wp.vec3d()
    by_sun = wp.vec3d()
    for i in range(body.first_facet, body.first_facet + body.n_facet):
        seen = wp.dot(facets.normal[i], view)
        lit = wp.dot(facets.normal[i], sun)
        if seen > _ZERO and lit > _ZERO:
            slopes.area_m2 += facets.area_m2[i] * seen * lit
            by_view += facets.normal[i] * (facets.area_m2[i] * lit)
            by_sun += facets.normal[i] * (facets.area_m2[i] * seen)
    return with_direction(with_direction(slopes, view, by_view), sun, by_sun)


@wp.func
def reflected_slopes(body: Body, facets: Facets, view: wp.vec3d, sun: wp.vec3d) -> AreaSlopes:
    """Reflected area of a body of any kind; unit vectors in body axes."""
    if body.n_facet > 0:
        return _facets_reflected_slopes(body, facets, view, sun)
    slopes = AreaSlopes()
    if body.radius_m > _ZERO:
        phase = angle_from_x(wp.length(wp.cross(view, sun)), wp.dot(view, sun))
        slopes.shape[RADIUS] = (
            body.radius_m * (wp.sin(phase) + (_PI - phase) * wp.cos(phase)) * wp.float64(4.0) / wp.float64(3.0)
        )
        slopes.area_m2 = _HALF * body.radius_m * slopes.shape[RADIUS]
        return slopes
    level = level_of(view)
    if level.length == _ZERO:
        level = level_of(sun)
        level.length = _ZERO
    sun_x = wp.dot(sun, level.ahead)
    sun_y = wp.dot(sun, level.beside)
    if sun_y < _ZERO:  # the Sun's azimuth in [0, pi]
        sun_y = -sun_y
        level.beside = -level.beside
    v = wp.vec3d(body.side_across * level.length, _ZERO, body.side_along * view[2])
    s = wp.vec3d(body.side_across * sun_x, body.side_across * sun_y, body.side_along * sun[2])
    apart = angle_from_x(sun_y, sun_x)
    seen = lit_half_arc(v[2], v[0])
    lit = lit_half_arc(s[2], wp.sqrt(s[0] * s[0] + s[1] * s[1]))
    # Two arcs longer than half a turn also overlap on the far side.
    moments = _arc_moments(wp.max(-seen, apart - lit), wp.min(seen, apart + lit))
    moments += _arc_moments(-seen, wp.min(seen, apart + lit - _TWO_PI))
    by_v = moments * s
    by_s = moments * v
    slopes.shape[TOP] = wp.max(view[2], _ZERO) * wp.max(sun[2], _ZERO)
    slopes.shape[BASE] = wp.max(-view[2], _ZERO) * wp.max(-sun[2], _ZERO)
    slopes.shape[SIDE] = wp.dot(v, by_v) / _TWO_PI
    ends = body.top_m2 * slopes.shape[TOP] + body.base_m2 * slopes.shape[BASE]
    slopes.area_m2 = ends + body.side_m2 * slopes.shape[SIDE]
    end_m2 = wp.where(view[2] > _ZERO, body.top_m2, body.base_m2)
    if view[2] * sun[2] > _ZERO:
        slopes = with_direction(slopes, view, wp.vec3d(_ZERO, _ZERO, end_m2 * sun[2]))
        slopes = with_direction(slopes, sun, wp.vec3d(_ZERO, _ZERO, end_m2 * view[2]))
    per_side = body.side_m2 / _TWO_PI
    by_view = (level.ahead * by_v[0] + level.beside * by_v[1]) * per_side + wp.vec3d(_ZERO, _ZERO, per_side * by_v[2])
    by_sun = (level.ahead * by_s[0] + level.beside * by_s[1]) * per_side + wp.vec3d(_ZERO, _ZERO, per_side * by_s[2])
    return with_side(with_side(slopes, body, view, by_view), body, sun, by_sun)
