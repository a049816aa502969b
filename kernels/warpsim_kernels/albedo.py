"""Sunlight that the Earth reflects onto a body, float64: a Lambertian sphere lit by the Sun, seen in part.

A point of the ground under the solar zenith angle z has the radiance albedo / pi * E_sun * max(0, cos z). What a
Lambertian body of reflectance rho sends on is rho / pi * albedo / pi * E_sun times the areas of this module, integrals
over the seen disc of max(0, cos z) max(0, n.direction) max(0, n.view).

The disc is cut into rings about the nadir, told apart by the zenith angle of the line of sight at the ground. On a
ring both factors of a plane element are a + b cos(azimuth) where positive, and their integral over azimuth is that of
`shapes.both_positive`. Rings are summed by a rule, in pieces that end at the first ring which the terminator meets
and at the first which the element's horizon meets.

Directions are unit vectors in body axes, `limb_sine` is the Earth's radius over the distance from its centre.
"""

import warp as wp

from warpsim_kernels.earthlight import Rule, limb_cosine
from warpsim_kernels.facets import Facets
from warpsim_kernels.shapes import Body, both_positive, lit_half_arc

_PI = wp.constant(wp.float64(3.141592653589793))
_HALF_PI = wp.constant(wp.float64(1.5707963267948966))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_LEAST_STRETCH = wp.constant(wp.float64(0.2))


@wp.struct
class Cap:
    """The part of the ground that a body sees, and how the Sun stands over it."""

    nadir: wp.vec3d
    sun: wp.vec3d
    limb_sine: wp.float64
    limb_cosine: wp.float64
    stretch: wp.float64  # how near the limb rings crowd, see `ring_depth`
    sun_up: wp.float64  # cosine of the solar zenith angle at the point below the body
    sun_across: wp.float64  # its sine
    first: wp.float64  # zenith angle at the first ring with light [rad]; a right angle if there is none
    partly: wp.float64  # that at the first ring which the terminator meets, 0 if it meets none


@wp.struct
class Ring:
    """Points of the ground that are seen under one angle from the nadir."""

    cosine: wp.float64  # of that angle
    sine: wp.float64
    up: wp.float64  # cosine of the angle at the Earth's centre
    across: wp.float64
    weight: wp.float64  # solid angle per depth and azimuth


@wp.func
def seen_cap(nadir: wp.vec3d, limb_sine: wp.float64, sun: wp.vec3d) -> Cap:
    """The seen cap of the Earth, the Sun far away in the direction `sun`."""
    cap = Cap()
    cap.nadir = nadir
    cap.sun = sun
    cap.limb_sine = wp.min(limb_sine, wp.float64(1.0))
    cap.limb_cosine = limb_cosine(cap.limb_sine)
    cap.stretch = wp.max(cap.limb_cosine, _LEAST_STRETCH)
    cap.sun_up = -wp.dot(nadir, sun)
    cap.sun_across = wp.length(wp.cross(nadir, sun))
    cap.first = wp.float64(0.0)
    cap.partly = wp.float64(0.0)
    # The terminator comes within |90 deg - zenith angle of the Sun| of the point below, the cap reaches to
    # acos(limb_sine); the zenith angle of the line of sight is atan2(sin, cos - limb_sine) of such an angle.
    if cap.sun_across > cap.limb_sine:
        cap.partly = wp.atan2(wp.abs(cap.sun_up), cap.sun_across - cap.limb_sine)
        if cap.sun_up < wp.float64(0.0):
            cap.first = cap.partly
    else:
        if cap.sun_up <= wp.float64(0.0):
            cap.first = _HALF_PI
    return cap


@wp.func
def ring_depth(cap: Cap, zenith_rad: wp.float64) -> wp.float64:
    """The rule's variable: 0 at the limb, asinh((90 deg - zenith angle) / stretch).

    Close to the ground, the angle from the nadir turns over within limb_cosine of the limb; this variable widens that
    zone, so that one rule serves all distances.
    """
    x = (_HALF_PI - zenith_rad) / cap.stretch
    return wp.log(x + wp.sqrt(x * x + wp.float64(1.0)))


@wp.func
def ring_at(cap: Cap, depth: wp.float64) -> Ring:
    """The ring at a depth > 0 from the limb."""
    ring = Ring()
    s = cap.limb_sine
    half_growth = wp.float64(0.5) * wp.exp(depth)
    half_decay = wp.float64(0.25) / half_growth
    elevation_rad = cap.stretch * (half_growth - half_decay)  # stretch * sinh(depth)
    sine = wp.cos(elevation_rad)  # of the zenith angle
    cosine = wp.sin(elevation_rad)
    ring.sine = s * sine
    ring.cosine = wp.sqrt(cosine * cosine + cap.limb_cosine * cap.limb_cosine * sine * sine)
    ring.up = cosine * ring.cosine + s * sine * sine
    ring.across = sine * (ring.cosine - s * cosine)
    ring.weight = s * s * sine * cosine / ring.cosine * cap.stretch * (half_growth + half_decay)
    return ring


@wp.func
def _element_rings(
    rule: Rule,
    cap: Cap,
    cosine: wp.float64,
    sine: wp.float64,
    apart: wp.float64,
    start_rad: wp.float64,
    end_rad: wp.float64,
) -> wp.float64:
    """A plane element's share of the rings between two zenith angles, 0 if they are in the wrong order."""
    total = wp.float64(0.0)
    if end_rad <= start_rad:
        return total
    high = ring_depth(cap, start_rad)
    low = ring_depth(cap, end_rad)
    for i in range(rule.n_node):
        ring = ring_at(cap, low + (high - low) * rule.place[i])
        light = both_positive(
            ring.up * cap.sun_up, ring.across * cap.sun_across, ring.cosine * cosine, ring.sine * sine, apart
        )
        total += rule.weight[i] * ring.weight * light
    return (high - low) * total


@wp.func
def element_albedo_sr(rule: Rule, cap: Cap, normal: wp.vec3d) -> wp.float64:
    """Integral over the disc of max(0, cos of the solar zenith angle) max(0, n.direction), for a plane element [sr]."""
    zero = wp.float64(0.0)
    cosine = wp.dot(normal, cap.nadir)
    if cap.first >= _HALF_PI or cosine <= -cap.limb_sine:
        return zero
    sine = wp.length(wp.cross(normal, cap.nadir))
    beside = wp.abs(wp.dot(cap.nadir, wp.cross(normal, cap.sun)))
    apart = wp.atan2(beside, wp.dot(normal, cap.sun) + cosine * cap.sun_up)
    first = cap.first
    horizon = zero  # of the element: the first ring that it cuts
    if wp.abs(cosine) < cap.limb_sine:
        horizon = wp.atan2(wp.abs(cosine), wp.sqrt((cap.limb_sine - cosine) * (cap.limb_sine + cosine)))
        if cosine < zero:
            first = wp.max(first, horizon)
    near = wp.max(first, wp.min(cap.partly, horizon))
    far = wp.max(first, wp.max(cap.partly, horizon))
    total = _element_rings(rule, cap, cosine, sine, apart, first, near)
    total += _element_rings(rule, cap, cosine, sine, apart, near, far)
    return total + _element_rings(rule, cap, cosine, sine, apart, far, _HALF_PI)


@wp.func
def _side_arc(
    rule: Rule,
    cap: Cap,
    body: Body,
    ahead: wp.vec3d,
    beside: wp.vec3d,
    a: wp.float64,
    b: wp.float64,
    start: wp.float64,
    end: wp.float64,
) -> wp.float64:
    """Integral of (a + b cos x) times an element's share from start to end, 0 if they are in the wrong order."""
    total = wp.float64(0.0)
    if end <= start:
        return total
    for i in range(rule.n_node):
        x = start + (end - start) * rule.place[i]
        across = ahead * wp.cos(x) + beside * wp.sin(x)
        normal = across * body.side_across + wp.vec3d(wp.float64(0.0), wp.float64(0.0), body.side_along)
        total += rule.weight[i] * (a + b * wp.cos(x)) * element_albedo_sr(rule, cap, normal)
    return (end - start) * total


@wp.func
def _side_albedo_m2_sr(rule: Rule, cap: Cap, body: Body, view: wp.vec3d) -> wp.float64:
    """Part of the side of a turned body in `albedo_area_m2`; azimuth counts from the view's, towards the nadir's."""
    zero = wp.float64(0.0)
    across = wp.sqrt(view[0] * view[0] + view[1] * view[1])
    ahead = wp.vec3d(wp.float64(1.0), zero, zero)
    if across > zero:
        ahead = wp.vec3d(view[0] / across, view[1] / across, zero)
    beside = wp.vec3d(-ahead[1], ahead[0], zero)
    if wp.dot(cap.nadir, beside) < zero:
        beside = -beside
    x = wp.dot(cap.nadir, ahead)
    y = wp.abs(wp.dot(cap.nadir, beside))  # -0.0 would turn the angle below round
    apart = wp.atan2(y, x)
    a = body.side_along * view[2]
    b = body.side_across * across
    c = body.side_along * cap.nadir[2]
    d = body.side_across * wp.sqrt(x * x + y * y)
    seen = lit_half_arc(a, b)
    whole = lit_half_arc(c - cap.limb_sine, d)
    rising = lit_half_arc(c + cap.limb_sine, d)
    over = apart - _TWO_PI  # once more round
    total = _side_arc(rule, cap, body, ahead, beside, a, b, wp.max(-seen, apart - rising), wp.min(seen, apart - whole))
    total += _side_arc(rule, cap, body, ahead, beside, a, b, wp.max(-seen, apart - whole), wp.min(seen, apart + whole))
    total += _side_arc(rule, cap, body, ahead, beside, a, b, wp.max(-seen, apart + whole), wp.min(seen, apart + rising))
    total += _side_arc(rule, cap, body, ahead, beside, a, b, -seen, wp.min(seen, over + whole))
    total += _side_arc(rule, cap, body, ahead, beside, a, b, wp.max(-seen, over + whole), wp.min(seen, over + rising))
    return body.side_m2 / _TWO_PI * total


@wp.func
def _sphere_share(cosine: wp.float64) -> wp.float64:
    """Reflected area of a unit sphere between two directions: 2/3 (sin p + (pi - p) cos p) [m2]."""
    c = wp.clamp(cosine, wp.float64(-1.0), wp.float64(1.0))
    sine = wp.sqrt((wp.float64(1.0) - c) * (wp.float64(1.0) + c))
    return (sine + (_PI - wp.atan2(sine, c)) * c) * (wp.float64(2.0) / wp.float64(3.0))


@wp.func
def _sphere_arc(
    rule: Rule, light: wp.vec3d, mean: wp.float64, swing: wp.float64, start: wp.float64, end: wp.float64
) -> wp.float64:
    """Integral over azimuth x from view's of light . (1, cos x, sin x) times the share at mean + swing cos x."""
    total = wp.float64(0.0)
    if end <= start:
        return total
    for i in range(rule.n_node):
        x = start + (end - start) * rule.place[i]
        cosine = wp.cos(x)
        share = _sphere_share(mean + swing * cosine)
        total += rule.weight[i] * (light[0] + light[1] * cosine + light[2] * wp.sin(x)) * share
    return (end - start) * total


@wp.func
def _sphere_rings(
    rule: Rule,
    cap: Cap,
    cosine: wp.float64,
    sine: wp.float64,
    apart: wp.float64,
    start_rad: wp.float64,
    end_rad: wp.float64,
) -> wp.float64:
    """A unit sphere's share of the rings between two zenith angles, 0 if they are in the wrong order."""
    zero = wp.float64(0.0)
    total = zero
    if end_rad <= start_rad:
        return total
    high = ring_depth(cap, start_rad)
    low = ring_depth(cap, end_rad)
    for i in range(rule.n_node):
        ring = ring_at(cap, low + (high - low) * rule.place[i])
        up = ring.up * cap.sun_up
        across = ring.across * cap.sun_across
        mean = ring.cosine * cosine
        swing = ring.sine * sine
        half = lit_half_arc(up, across)
        light = wp.vec3d(up, across * wp.cos(apart), -across * wp.sin(apart))
        if half >= _PI:
            light[2] = zero  # odd, over a whole turn
            arc = wp.float64(2.0) * _sphere_arc(rule, light, mean, swing, zero, _PI)
        else:
            # Cut where K has its weak kinks: at view's azimuth, else opposite.
            middle = zero
            if half <= apart:
                middle = wp.max(-_PI, -half - apart)
            arc = _sphere_arc(rule, light, mean, swing, -half - apart, middle)
            arc += _sphere_arc(rule, light, mean, swing, middle, half - apart)
        total += rule.weight[i] * ring.weight * arc
    return (high - low) * total


@wp.func
def sphere_albedo_sr(rule: Rule, cap: Cap, view: wp.vec3d) -> wp.float64:
    """`albedo_area_m2` of a unit sphere."""
    if cap.first >= _HALF_PI:
        return wp.float64(0.0)
    cosine = wp.dot(view, cap.nadir)
    sine = wp.length(wp.cross(view, cap.nadir))
    beside = wp.abs(wp.dot(cap.nadir, wp.cross(view, cap.sun)))
    apart = wp.atan2(beside, wp.dot(view, cap.sun) + cosine * cap.sun_up)
    partly = wp.max(cap.first, cap.partly)
    total = _sphere_rings(rule, cap, cosine, sine, apart, cap.first, partly)
    return total + _sphere_rings(rule, cap, cosine, sine, apart, partly, _HALF_PI)


@wp.func
def albedo_area_m2(
    rule: Rule, body: Body, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64, sun: wp.vec3d
) -> wp.float64:
    """Integral over the Earth's disc of max(0, cos of the solar zenith angle) times the reflected area [m2 sr]."""
    zero = wp.float64(0.0)
    cap = seen_cap(nadir, limb_sine, sun)
    if cap.first >= _HALF_PI:
        return zero
    if body.radius_m > zero:
        return body.radius_m * body.radius_m * sphere_albedo_sr(rule, cap, view)
    area = zero
    if view[2] > zero and body.top_m2 > zero:
        area = body.top_m2 * view[2] * element_albedo_sr(rule, cap, wp.vec3d(zero, zero, wp.float64(1.0)))
    if view[2] < zero and body.base_m2 > zero:
        area = body.base_m2 * -view[2] * element_albedo_sr(rule, cap, wp.vec3d(zero, zero, wp.float64(-1.0)))
    if body.side_m2 > zero:
        area += _side_albedo_m2_sr(rule, cap, body, view)
    return area


@wp.func
def facets_albedo_area_m2(
    rule: Rule,
    facets: Facets,
    first: int,
    count: int,
    view: wp.vec3d,
    nadir: wp.vec3d,
    limb_sine: wp.float64,
    sun: wp.vec3d,
) -> wp.float64:
    """`albedo_area_m2` of facets first to first + count - 1 [m2 sr]."""
    total = wp.float64(0.0)
    cap = seen_cap(nadir, limb_sine, sun)
    if cap.first >= _HALF_PI:
        return total
    for i in range(first, first + count):
        seen = wp.dot(facets.normal[i], view)
        if seen > wp.float64(0.0):
            total += facets.area_m2[i] * seen * element_albedo_sr(rule, cap, facets.normal[i])
    return total


@wp.func
def body_albedo_area_m2(
    rule: Rule, body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64, sun: wp.vec3d
) -> wp.float64:
    """`albedo_area_m2` of a body of any kind [m2 sr]."""
    if body.n_facet > 0:
        return facets_albedo_area_m2(rule, facets, body.first_facet, body.n_facet, view, nadir, limb_sine, sun)
    return albedo_area_m2(rule, body, view, nadir, limb_sine, sun)


@wp.kernel(enable_backward=False)
def albedo_area_kernel(
    # in
    rule: Rule,
    body: Body,
    facets: Facets,
    view: wp.array[wp.vec3d],  # (n,) unit, body axes
    nadir: wp.array[wp.vec3d],  # (n,) unit, body axes
    limb_sine: wp.array[wp.float64],  # (n,)
    sun: wp.array[wp.vec3d],  # (n,) unit, body axes
    # out
    area_m2_sr: wp.array[wp.float64],  # (n,)
):
    """Area that reflects the Earth's sunlight, for each geometry."""
    i = wp.tid()
    area_m2_sr[i] = body_albedo_area_m2(rule, body, facets, view[i], nadir[i], limb_sine[i], sun[i])
