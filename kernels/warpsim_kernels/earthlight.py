"""Heat radiation of the Earth on a body, float64: the Earth as a sphere of one radiance L, in full view or rising.

A plane element receives pi L F, F its view factor. What a Lambertian body of reflectance rho sends on towards `view`
is rho / pi * pi L times the integral over the surface of max(0, n.view) F(n) dA: the areas of this module. Flat faces
are in closed form; the side of a turned body is an integral over azimuth, cut where F has kinks and where the side
goes out of sight; a sphere is an integral along the edge of the Earth's disc.

Directions are unit vectors in body axes, `limb_sine` is the Earth's radius over the distance from its centre.
"""

import warp as wp

from warpsim_kernels.facets import Facets
from warpsim_kernels.shapes import Body, lit_half_arc, product_over_arcs

_PI = wp.constant(wp.float64(3.141592653589793))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))


@wp.struct
class Rule:
    """A quadrature rule on the interval 0 to 1 (Gauss and Legendre)."""

    place: wp.array[wp.float64]  # (n_node,)
    weight: wp.array[wp.float64]  # (n_node,) their sum is 1
    n_node: int


@wp.func
def limb_cosine(limb_sine: wp.float64) -> wp.float64:
    """Cosine of the angular radius of the Earth's disc."""
    one = wp.float64(1.0)
    return wp.sqrt((one - limb_sine) * (one + limb_sine))


@wp.func
def view_factor(cosine: wp.float64, limb_sine: wp.float64) -> wp.float64:
    """Share of a plane element's hemisphere that the Earth fills, weighted by the cosine of incidence.

    Hamilton and Morgan 1952 (NACA TN 2836), configuration P-6; Howell, catalog of view factors, B-43. Written with the
    half-angles of two segments, of a circle and of an ellipse, by arc tangents that keep their digits where the Earth
    touches the element's horizon.

    Args:
        cosine: Of the angle between the normal and the nadir.
        limb_sine: Earth's radius over distance; more than 1 counts as 1, on the ground.
    """
    s = wp.min(limb_sine, wp.float64(1.0))
    if cosine >= s:
        return cosine * s * s
    if cosine <= -s:
        return wp.float64(0.0)
    k = limb_cosine(s)
    q = wp.sqrt((s - cosine) * (s + cosine))
    return (wp.atan2(q, k) + cosine * s * s * wp.atan2(q, -k * cosine) - k * q) / _PI


@wp.func
def _flow(cosine: wp.float64) -> wp.float64:
    """Flow h(p) of `sphere_earth_area`, from the cosine of p.

    h(p) sin(p)^2 is the integral from 0 to p of (K - pi/4) sin, K = 2/3 (sin p + (pi - p) cos p) what a unit sphere
    reflects at the phase angle p and pi/4 its mean over all directions. It is finite at both ends; beyond a right angle
    it is written with pi - p.
    """
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    c = wp.min(wp.abs(cosine), one)
    sine2 = (one - c) * (one + c)
    sine = wp.sqrt(sine2)
    p = wp.atan2(sine, c)
    m = p / wp.float64(3.0) + _PI / (wp.float64(4.0) * (one + c))
    if sine2 > wp.float64(0.0):
        m -= (p - sine * c) / (two * sine2)
    if cosine < wp.float64(0.0):
        return m
    return _PI / wp.float64(3.0) - m


@wp.func
def sphere_earth_area(rule: Rule, cosine: wp.float64, sine: wp.float64, limb_sine: wp.float64) -> wp.float64:
    """Integral of max(0, n.view) F(n) over a unit sphere; cosine and sine of the angle between view and nadir.

    It is the integral over the Earth's disc of K(p) / pi, p the angle from view. K less its mean is the divergence of a
    flow along the great circles through view, so the integral over the disc is one along its edge.
    """
    s = wp.min(limb_sine, wp.float64(1.0))
    k = limb_cosine(s)
    edge = wp.float64(0.0)
    for i in range(rule.n_node):
        turn = wp.cos(_PI * rule.place[i])
        outwards = s * cosine - k * sine * turn
        edge += rule.weight[i] * outwards * _flow(k * cosine + s * sine * turn)
    return wp.float64(0.5) * _PI * s * s / (wp.float64(1.0) + k) + wp.float64(2.0) * s * edge


@wp.func
def _rising_arc(
    rule: Rule,
    a: wp.float64,
    b: wp.float64,
    c: wp.float64,
    d: wp.float64,
    apart: wp.float64,
    limb_sine: wp.float64,
    start: wp.float64,
    end: wp.float64,
) -> wp.float64:
    """Integral of (a + b cos x) F(c + d cos(x - apart)) from start to end, 0 if they are in the wrong order."""
    total = wp.float64(0.0)
    if end <= start:
        return total
    for i in range(rule.n_node):
        x = start + (end - start) * rule.place[i]
        total += rule.weight[i] * (a + b * wp.cos(x)) * view_factor(c + d * wp.cos(x - apart), limb_sine)
    return (end - start) * total


@wp.func
def _side_integral(
    rule: Rule, a: wp.float64, b: wp.float64, c: wp.float64, d: wp.float64, apart: wp.float64, limb_sine: wp.float64
) -> wp.float64:
    """Integral of max(0, a + b cos x) F(c + d cos(x - apart)) over a turn; b, d >= 0, apart in [0, pi]."""
    s = wp.min(limb_sine, wp.float64(1.0))
    seen = lit_half_arc(a, b)
    whole = lit_half_arc(c - s, d)  # within this of nadir's azimuth, the whole Earth is above a normal's horizon
    rising = lit_half_arc(c + s, d)  # within this, some of it
    total = s * s * product_over_arcs(a, b, c, d, apart, seen, whole)
    total += _rising_arc(rule, a, b, c, d, apart, s, wp.max(-seen, apart - rising), wp.min(seen, apart - whole))
    total += _rising_arc(rule, a, b, c, d, apart, s, wp.max(-seen, apart + whole), wp.min(seen, apart + rising))
    over = apart - _TWO_PI  # once more round
    return total + _rising_arc(rule, a, b, c, d, apart, s, wp.max(-seen, over + whole), wp.min(seen, over + rising))


@wp.func
def earth_area_m2(rule: Rule, body: Body, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64) -> wp.float64:
    """Integral of max(0, n.view) F(n) over the surface [m2], F the Earth's view factor."""
    zero = wp.float64(0.0)
    if body.radius_m > zero:
        sine = wp.length(wp.cross(view, nadir))
        return body.radius_m * body.radius_m * sphere_earth_area(rule, wp.dot(view, nadir), sine, limb_sine)
    area = zero
    if view[2] > zero:
        area = body.top_m2 * view[2] * view_factor(nadir[2], limb_sine)
    if view[2] < zero:
        area = body.base_m2 * -view[2] * view_factor(-nadir[2], limb_sine)
    if body.side_m2 <= zero:
        return area
    b = body.side_across * wp.sqrt(view[0] * view[0] + view[1] * view[1])
    d = body.side_across * wp.sqrt(nadir[0] * nadir[0] + nadir[1] * nadir[1])
    apart = wp.atan2(wp.abs(view[0] * nadir[1] - view[1] * nadir[0]), view[0] * nadir[0] + view[1] * nadir[1])
    side = _side_integral(rule, body.side_along * view[2], b, body.side_along * nadir[2], d, apart, limb_sine)
    return area + body.side_m2 / _TWO_PI * side


@wp.func
def absorbed_area_m2(rule: Rule, body: Body, nadir: wp.vec3d, limb_sine: wp.float64) -> wp.float64:
    """Integral of F(n) over the whole surface [m2]: a black body absorbs pi L times this [W]."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    if body.radius_m > zero:
        s = wp.min(limb_sine, one)
        return _TWO_PI * body.radius_m * body.radius_m * s * s / (one + limb_cosine(s))
    area = body.top_m2 * view_factor(nadir[2], limb_sine) + body.base_m2 * view_factor(-nadir[2], limb_sine)
    if body.side_m2 <= zero:
        return area
    d = body.side_across * wp.sqrt(nadir[0] * nadir[0] + nadir[1] * nadir[1])
    side = _side_integral(rule, one, zero, body.side_along * nadir[2], d, zero, limb_sine)
    return area + body.side_m2 / _TWO_PI * side


@wp.func
def facets_earth_area_m2(
    facets: Facets,
    first: int,
    count: int,
    view: wp.vec3d,
    nadir: wp.vec3d,
    limb_sine: wp.float64,
) -> wp.float64:
    """Sum of area * max(0, n.view) * F(n) over facets first to first + count - 1 [m2]: exact, without a rule."""
    total = wp.float64(0.0)
    for i in range(first, first + count):
        seen = wp.dot(facets.normal[i], view)
        if seen > wp.float64(0.0):
            total += facets.area_m2[i] * seen * view_factor(wp.dot(facets.normal[i], nadir), limb_sine)
    return total


@wp.func
def body_earth_area_m2(
    rule: Rule, body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64
) -> wp.float64:
    """`earth_area_m2` of a body of any kind [m2]."""
    if body.n_facet > 0:
        return facets_earth_area_m2(facets, body.first_facet, body.n_facet, view, nadir, limb_sine)
    return earth_area_m2(rule, body, view, nadir, limb_sine)


@wp.func
def facets_absorbed_area_m2(
    facets: Facets,
    first: int,
    count: int,
    nadir: wp.vec3d,
    limb_sine: wp.float64,
) -> wp.float64:
    """Sum of area * F(n) over facets first to first + count - 1 [m2]."""
    total = wp.float64(0.0)
    for i in range(first, first + count):
        total += facets.area_m2[i] * view_factor(wp.dot(facets.normal[i], nadir), limb_sine)
    return total


@wp.kernel(enable_backward=False)
def view_factor_kernel(
    # in
    cosine: wp.array[wp.float64],  # (n,)
    limb_sine: wp.array[wp.float64],  # (n,)
    # out
    factor: wp.array[wp.float64],  # (n,)
):
    """View factor of each element."""
    i = wp.tid()
    factor[i] = view_factor(cosine[i], limb_sine[i])


@wp.kernel(enable_backward=False)
def earth_area_kernel(
    # in
    rule: Rule,
    body: Body,
    facets: Facets,
    view: wp.array[wp.vec3d],  # (n,) unit, body axes
    nadir: wp.array[wp.vec3d],  # (n,) unit, body axes
    limb_sine: wp.array[wp.float64],  # (n,)
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Area that reflects the Earth's heat, for each geometry."""
    i = wp.tid()
    area_m2[i] = body_earth_area_m2(rule, body, facets, view[i], nadir[i], limb_sine[i])


@wp.kernel(enable_backward=False)
def absorbed_area_kernel(
    # in
    rule: Rule,
    body: Body,
    facets: Facets,
    nadir: wp.array[wp.vec3d],  # (n,) unit, body axes
    limb_sine: wp.array[wp.float64],  # (n,)
    # out
    area_m2: wp.array[wp.float64],  # (n,)
):
    """Area that absorbs the Earth's heat, for each geometry."""
    i = wp.tid()
    if body.n_facet > 0:
        area_m2[i] = facets_absorbed_area_m2(facets, body.first_facet, body.n_facet, nadir[i], limb_sine[i])
    else:
        area_m2[i] = absorbed_area_m2(rule, body, nadir[i], limb_sine[i])
