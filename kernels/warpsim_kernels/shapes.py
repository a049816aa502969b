"""Areas of opaque convex bodies, float64: as seen, and as lit from one side and seen from another.

A body is a sphere, or one turned about its z axis: flat ends and a side whose normals all make one angle with the axis.
Cylinder, cone and frustum are such bodies, and a plate is one without a side. Over the azimuth of the side's normals,
the share of a face towards a direction is a + b cos(azimuth); areas are integrals of its positive part, in closed form.

The functions take directions in body axes. What a face does not see counts 0, so they hold for convex bodies only.
"""

import functools

import warp as wp

from warpsim_kernels.angles import angle_from_x

_PI = wp.constant(wp.float64(3.141592653589793))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))


@wp.struct
class Body:
    """A sphere if radius_m > 0, a mesh if n_facet > 0, else two ends and a side turned about z."""

    radius_m: wp.float64
    top_m2: wp.float64  # flat face towards +z
    base_m2: wp.float64  # flat face towards -z
    side_m2: wp.float64  # its normals are (across cos, across sin, along) of all azimuths
    side_across: wp.float64
    side_along: wp.float64
    first_facet: int  # of a mesh, among the facets of all meshes
    n_facet: int


@wp.struct
class Facets:
    """Flat facets of all meshes of a scene, one mesh behind the other.

    Facets do not hide or shade each other, which is exact for convex bodies and too large for others.
    """

    normal: wp.array[wp.vec3d]  # (n_facet,) unit, outward, body axes
    area_m2: wp.array[wp.float64]  # (n_facet,)


@wp.func
def lit_half_arc(a: wp.float64, b: wp.float64) -> wp.float64:
    """Half the arc of azimuth on which a + b cos(azimuth) > 0, b >= 0 [rad]."""
    if a >= b:
        return _PI
    if a <= -b:
        return wp.float64(0.0)
    # atan2 of the root, not acos(-a / b): next to either end the digits of b - a and b + a count.
    return angle_from_x(wp.sqrt((b - a) * (b + a)), -a)


@wp.func
def positive_half(a: wp.float64, b: wp.float64) -> wp.float64:
    """Half the integral of max(0, a + b cos(azimuth)) over a turn, b >= 0."""
    if a >= b:
        return _PI * a
    if a <= -b:
        return wp.float64(0.0)
    root = wp.sqrt((b - a) * (b + a))  # b times the sine of half the arc
    return a * angle_from_x(root, -a) + root


@functools.cache
def positive_moments_of(n_order: int) -> wp.Function:
    """The function (a, b): integrals of max(0, a + b cos x) cos(m x) over a turn, b >= 0, for m < n_order."""
    Moments = wp.types.vector(length=n_order, dtype=wp.float64)
    # A constant, as with wp.static of a loop's variable Warp's hash of a function depends on whether it was compiled.
    inverse = wp.constant(Moments(*(1.0 / (m + 1.0) for m in range(n_order))))

    @wp.func
    def positive_moments(a: wp.float64, b: wp.float64) -> Moments:
        moments = Moments()
        if a >= b:
            moments[0] = _TWO_PI * a
            moments[1] = _PI * b
            return moments
        if a <= -b:
            return moments
        root = wp.sqrt((b - a) * (b + a))
        now = angle_from_x(root, -a)  # half the arc
        this = root / b
        before = this
        last = wp.float64(0.0)
        turning = wp.float64(-2.0) * a / b
        for m in range(n_order):
            following = this * inverse[m]  # sin((m + 1) half) / (m + 1)
            moments[m] = wp.float64(2.0) * a * now + b * (before + following)
            before = now
            now = following
            after = turning * this - last
            last = this
            this = after
        return moments

    return positive_moments


@wp.func
def projected_area_m2(body: Body, cosine: wp.float64, sine: wp.float64) -> wp.float64:
    """Area of the body's outline seen at the aspect whose cosine and (non-negative) sine are given [m2]."""
    zero = wp.float64(0.0)
    if body.radius_m > zero:
        return _PI * body.radius_m * body.radius_m
    a = body.side_along * cosine
    b = body.side_across * sine
    side = body.side_m2 / _PI * positive_half(a, b)
    return body.top_m2 * wp.max(cosine, zero) + body.base_m2 * wp.max(-cosine, zero) + side


@wp.func
def _lit_and_seen(
    a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64, apart: wp.float64, start: wp.float64, end: wp.float64
) -> wp.float64:
    """Integral of (a + b cos x) (c + d cos(x - apart)) from start to end, 0 if they are in the wrong order."""
    if end <= start:
        return wp.float64(0.0)
    half = wp.float64(0.5)
    width = end - start
    middle = half * (start + end)
    # Differences of sines as products: short arcs keep their digits.
    once = wp.float64(2.0) * wp.sin(half * width)
    twice = half * wp.sin(width) * wp.cos(wp.float64(2.0) * middle - apart)
    return (
        a * c * width
        + once * (b * c * wp.cos(middle) + a * d * wp.cos(middle - apart))
        + b * d * (half * width * wp.cos(apart) + twice)
    )


@wp.func
def _over_arc(p: wp.float64, q: wp.float64, r: wp.float64, t: wp.float64, half: wp.float64) -> wp.float64:
    """Integral of (p + q cos x) (r + t cos x) over the azimuths within half of 0."""
    sine = wp.sin(half)
    return wp.float64(2.0) * (p * r * half + (p * t + q * r) * sine) + q * t * (half + sine * wp.cos(half))


@wp.func
def product_over_arcs(
    a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64, apart: wp.float64, seen: wp.float64, lit: wp.float64
) -> wp.float64:
    """Integral of (a + b cos x) (c + d cos(x - apart)) over azimuths within seen of 0 and within lit of apart.

    All three angles are in [0, pi].
    """
    # One of them all round: what is odd about the other's middle drops out.
    if seen >= _PI:
        return _over_arc(c, d, a, b * wp.cos(apart), lit)
    if lit >= _PI:
        return _over_arc(a, b, c, d * wp.cos(apart), seen)
    # Two arcs longer than half a turn may also overlap on the far side.
    near = _lit_and_seen(a, b, c, d, apart, wp.max(-seen, apart - lit), wp.min(seen, apart + lit))
    return near + _lit_and_seen(a, b, c, d, apart, -seen, wp.min(seen, apart + lit - _TWO_PI))


@wp.func
def both_positive(a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64, apart: wp.float64) -> wp.float64:
    """Integral of max(0, a + b cos x) max(0, c + d cos(x - apart)) over a turn; b, d >= 0, apart in [0, pi]."""
    return product_over_arcs(a, b, c, d, apart, lit_half_arc(a, b), lit_half_arc(c, d))


@wp.func
def reflected_area_m2(body: Body, view: wp.vec3d, sun: wp.vec3d) -> wp.float64:
    """Integral of max(0, n.view) max(0, n.sun) over the surface [m2]; unit vectors in body axes.

    A Lambertian body of reflectance rho in the irradiance E sends rho / pi * E times this area towards view [W/sr].
    """
    zero = wp.float64(0.0)
    if body.radius_m > zero:
        phase = angle_from_x(wp.length(wp.cross(view, sun)), wp.dot(view, sun))
        shape = wp.sin(phase) + (_PI - phase) * wp.cos(phase)
        return body.radius_m * body.radius_m * shape * (wp.float64(2.0) / wp.float64(3.0))
    ends = body.top_m2 * wp.max(view[2], zero) * wp.max(sun[2], zero)
    ends += body.base_m2 * wp.max(-view[2], zero) * wp.max(-sun[2], zero)
    a = body.side_along * view[2]
    b = body.side_across * wp.sqrt(view[0] * view[0] + view[1] * view[1])
    c = body.side_along * sun[2]
    d = body.side_across * wp.sqrt(sun[0] * sun[0] + sun[1] * sun[1])
    apart = angle_from_x(wp.abs(view[0] * sun[1] - view[1] * sun[0]), view[0] * sun[0] + view[1] * sun[1])
    side = wp.max(both_positive(a, b, c, d, apart), zero)  # rounding must not make light negative
    return ends + body.side_m2 / _TWO_PI * side


@wp.kernel(enable_backward=False)
def projected_area_kernel(
    # in
    body: Body,
    aspect_rad: wp.array[wp.float64],  # (n,)
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Projected area at each aspect."""
    i = wp.tid()
    area_m2[i] = projected_area_m2(body, wp.cos(aspect_rad[i]), wp.abs(wp.sin(aspect_rad[i])))


@wp.func
def body_projected_area_m2(body: Body, facets: Facets, view: wp.vec3d) -> wp.float64:
    """Projected area of a body of any kind [m2]; view: unit, body axes."""
    if body.n_facet == 0:
        return projected_area_m2(body, view[2], wp.sqrt(view[0] * view[0] + view[1] * view[1]))
    zero = wp.float64(0.0)
    total = wp.float64(0.0)
    for i in range(body.first_facet, body.first_facet + body.n_facet):
        total += facets.area_m2[i] * wp.max(wp.dot(facets.normal[i], view), zero)
    return total


@wp.func
def body_reflected_area_m2(body: Body, facets: Facets, view: wp.vec3d, sun: wp.vec3d) -> wp.float64:
    """Reflected area of a body of any kind [m2]; unit vectors in body axes."""
    if body.n_facet == 0:
        return reflected_area_m2(body, view, sun)
    zero = wp.float64(0.0)
    total = wp.float64(0.0)
    for i in range(body.first_facet, body.first_facet + body.n_facet):
        normal = facets.normal[i]
        total += facets.area_m2[i] * wp.max(wp.dot(normal, view), zero) * wp.max(wp.dot(normal, sun), zero)
    return total


@wp.kernel(enable_backward=False)
def projected_area_along_kernel(
    # in
    body: Body,
    facets: Facets,
    view: wp.array[wp.vec3d],  # (n,) unit, body axes
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Projected area along each direction."""
    i = wp.tid()
    area_m2[i] = body_projected_area_m2(body, facets, view[i])


@wp.kernel(enable_backward=False)
def reflected_area_kernel(
    # in
    body: Body,
    facets: Facets,
    view: wp.array[wp.vec3d],  # (n,) unit, body axes
    sun: wp.array[wp.vec3d],  # (n,) unit, body axes
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Reflected area of each pair of directions."""
    i = wp.tid()
    area_m2[i] = body_reflected_area_m2(body, facets, view[i], sun[i])
