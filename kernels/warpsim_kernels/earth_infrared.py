"""Earth infrared that a body reflects, float64: the Earth as a sphere of one radiance L, in full view or rising.

A plane element receives pi L F, F its view factor. What a Lambertian body of reflectance rho sends on towards `view` is
rho L times the integral over the surface of max(0, n.view) F(n) dA: the areas of this module. A table holds F, and the
area of a unit sphere, over height and cosine (`warpsim.target.earth_light`). Around the side of a turned body, samples
of F make a trigonometric polynomial; its product with what is seen of the side is integrated in closed form.

Directions are unit vectors in body axes, `limb_sine` is the Earth's radius over the distance from its centre.
"""

import math

import warp as wp

from warpsim_kernels.earth import height_position
from warpsim_kernels.shapes import Body, Facets, positive_moments_of

_TWO_PI = wp.constant(wp.float64(6.283185307179586))

ELEMENT = wp.constant(0)
SPHERE = wp.constant(1)
"""Parts of the table, whose cells hold (value, its step along cosine, along height, along both)."""

N_SAMPLE = 8
_TURNS = [math.pi * (j + 0.5) / N_SAMPLE for j in range(N_SAMPLE)]  # the middles of equal parts of half a turn
Samples = wp.types.vector(length=N_SAMPLE, dtype=wp.float64)
Waves = wp.types.matrix(shape=(N_SAMPLE, N_SAMPLE), dtype=wp.float64)
COSINES = wp.constant(Samples(*(math.cos(turn) for turn in _TURNS)))
WAVES = wp.constant(
    Waves(*((2.0 if m else 1.0) * math.cos(m * turn) / N_SAMPLE for m in range(N_SAMPLE) for turn in _TURNS))
)
_positive_moments = positive_moments_of(N_SAMPLE)


@wp.func
def received(table: wp.array3d[wp.vec4d], part: int, height: wp.float64, cosine: wp.float64) -> wp.float64:
    """Value of a part of the table over limb_sine^2, linear between its heights and between its cosines."""
    position = wp.float64(0.5) * (wp.float64(1.0) + cosine) * wp.float64(table.shape[2])
    row = wp.clamp(int(height), 0, table.shape[1] - 1)
    column = wp.clamp(int(position), 0, table.shape[2] - 1)
    cell = table[part, row, column]
    v = position - wp.float64(column)
    return cell[0] + cell[1] * v + (cell[2] + cell[3] * v) * (height - wp.float64(row))


@wp.func
def _side_integral(
    table: wp.array3d[wp.vec4d], height: wp.float64, body: Body, view: wp.vec3d, nadir: wp.vec3d
) -> wp.float64:
    """Integral over azimuth of max(0, n.view) times what the side receives."""
    across = wp.sqrt(view[0] * view[0] + view[1] * view[1])
    level = wp.sqrt(nadir[0] * nadir[0] + nadir[1] * nadir[1])
    apart = view[0] * nadir[0] + view[1] * nadir[1]  # cosine of the angle between their azimuths
    apart = apart / wp.max(across * level, wp.float64(1.0e-30))
    moments = _positive_moments(body.side_along * view[2], body.side_across * across)
    weight = WAVES[0] * moments[0]
    wave = apart  # cos(m apart)
    last = wp.float64(1.0)
    for m in range(1, wp.static(N_SAMPLE)):
        weight += WAVES[m] * (moments[m] * wave)
        following = wp.float64(2.0) * apart * wave - last
        last = wave
        wave = following
    cosine = body.side_along * nadir[2]
    swing = body.side_across * level
    total = wp.float64(0.0)
    for j in range(wp.static(N_SAMPLE)):
        total += weight[j] * received(table, ELEMENT, height, cosine + swing * COSINES[j])
    return total


@wp.func
def earth_area_m2(
    table: wp.array3d[wp.vec4d], body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64
) -> wp.float64:
    """Integral of max(0, n.view) F(n) over the surface of a body of any kind [m2]."""
    zero = wp.float64(0.0)
    height = height_position(limb_sine, table.shape[1] + 1)
    total = zero
    if body.radius_m > zero:
        total = body.radius_m * body.radius_m * received(table, SPHERE, height, wp.dot(view, nadir))
    elif body.n_facet > 0:
        for i in range(body.first_facet, body.first_facet + body.n_facet):
            seen = wp.dot(facets.normal[i], view)
            if seen > zero:
                light = received(table, ELEMENT, height, wp.dot(facets.normal[i], nadir))
                total += facets.area_m2[i] * seen * light
    else:
        if view[2] > zero:
            total = body.top_m2 * view[2] * received(table, ELEMENT, height, nadir[2])
        if view[2] < zero:
            total = body.base_m2 * -view[2] * received(table, ELEMENT, height, -nadir[2])
        if body.side_m2 > zero:
            total += body.side_m2 / _TWO_PI * _side_integral(table, height, body, view, nadir)
    return wp.max(total, zero) * limb_sine * limb_sine
