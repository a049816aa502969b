"""Projected areas of convex bodies of revolution, float64.

Aspect is the angle between the body axis (base to apex) and the direction to the observer. The bodies are opaque, so
the projected area does not depend on spin. Derivation of the cone: the silhouette is the base ellipse and the two
tangents from the projected apex.
"""

import warp as wp

SPHERE = wp.constant(0)
CYLINDER = wp.constant(1)
CONE = wp.constant(2)

_PI = wp.constant(wp.float64(3.141592653589793))


@wp.struct
class Body:
    """A sphere, cylinder or cone; height_m is ignored for a sphere."""

    kind: int
    radius_m: wp.float64
    height_m: wp.float64


@wp.func
def cone_area_m2(radius_m: wp.float64, height_m: wp.float64, cosine: wp.float64, sine: wp.float64) -> wp.float64:
    """Projected area of a closed cone; cosine may have either sign, sine >= 0."""
    flat = radius_m * wp.abs(cosine)
    tall = height_m * sine
    if tall <= flat:
        return _PI * radius_m * flat  # the apex lies inside the base's outline
    # atan2 of the same root, not acos(flat / tall): next to the half-angle the two terms must cancel.
    root = wp.sqrt((tall - flat) * (tall + flat))
    return radius_m * (flat * (_PI - wp.atan2(root, flat)) + root)


@wp.func
def projected_area_m2(body: Body, cosine: wp.float64, sine: wp.float64) -> wp.float64:
    """Area of the body's outline seen at the aspect whose cosine and (non-negative) sine are given [m2]."""
    if body.kind == SPHERE:
        return _PI * body.radius_m * body.radius_m
    if body.kind == CYLINDER:
        end = _PI * body.radius_m * body.radius_m * wp.abs(cosine)
        return end + wp.float64(2.0) * body.radius_m * body.height_m * sine
    return cone_area_m2(body.radius_m, body.height_m, cosine, sine)


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
