"""Sunlight that the Earth reflects onto a body, float64: a Lambertian sphere lit by the Sun, seen in part.

A point of the ground under the solar zenith angle z has the radiance albedo / pi * E_sun * max(0, cos z). What a
Lambertian body of reflectance rho sends on is rho / pi * albedo / pi * E_sun times the areas of this module, integrals
over the seen disc of max(0, cos z) max(0, n.direction) max(0, n.view).

What a plane element receives from all around is a smooth function of its normal, even where the light itself has edges:
the cosine of incidence damps the light's harmonics of degree l by A_l (Ramamoorthi and Hanrahan 2001, J. Opt. Soc. Am.
A 18, 2448), which falls like l^-2.5 and is 0 for odd l > 1. The harmonics are taken about the nadir, with azimuth
counted from the Sun's: the Earth's light is even in it, so cosines will do. They depend on height and solar zenith
angle alone and come from a table (`warpsim.target.earth_light`); each face then costs a polynomial in its normal.

Directions are unit vectors in body axes, `limb_sine` is the Earth's radius over the distance from its centre.
"""

import functools
import math
from typing import NamedTuple

import warp as wp

from warpsim_kernels.angles import angle_from_x
from warpsim_kernels.earth import height_position
from warpsim_kernels.shapes import Body, Facets, positive_moments_of

_PI = wp.constant(wp.float64(3.141592653589793))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_NO_AZIMUTH = wp.constant(wp.float64(1.0e-12))  # sine of the Sun's zenith angle below which its azimuth does not count


class AlbedoSeries(NamedTuple):
    """Device functions of the series up to some degree, and the type of its harmonics."""

    Harmonics: type
    harmonics: wp.Function
    """(table, limb_sine, sun_up, sun_across): of what a plane element receives; cosine and sine of the Sun's zenith
    angle at the point below."""
    area_m2_sr: wp.Function
    """(harmonics, body, facets, view, nadir, sun): what a body sends towards view [m2 sr]."""


@wp.func
def is_dark(limb_sine: wp.float64, sun_up: wp.float64, sun_across: wp.float64) -> bool:
    """Whether all the ground in view is in the night; cosine and sine of the Sun's zenith angle at the point below."""
    return sun_up <= wp.float64(0.0) and sun_across <= limb_sine


def damping(degree: int) -> float:
    """A_l, what the cosine of incidence leaves of harmonics of a degree (Ramamoorthi and Hanrahan 2001, eq. 19)."""
    if degree < 2:
        return math.pi * (1.0 - degree / 3.0)
    if degree % 2:
        return 0.0
    sign = 1.0 if degree % 4 else -1.0
    return sign * 2.0 * math.pi / ((degree + 2) * (degree - 1)) * math.comb(degree, degree // 2) / 2.0**degree


def kept_harmonics(degree: int) -> list[tuple[int, int]]:
    """Degree l and order m of the harmonics up to a degree that are not 0, as the table holds them."""
    return [(l, m) for m in range(degree + 1) for l in range(m, degree + 1) if l < 2 or l % 2 == 0]


def step(degree: int, order: int) -> float:
    """Return b of q_{l+1} = c q_l - b q_{l-1}.

    q_l sin^m is the associated Legendre function of degree l and order m, scaled so that q_l = c^(l-m) + lower powers.
    """
    if degree == order:
        return 0.0
    return (degree - order) * (degree + order) / ((2 * degree - 1) * (2 * degree + 1))


def sample_weights(degree: int, sample: int) -> list[float]:
    """Share of a sample, of 2 degree + 1 over a turn, in the cosines of a trigonometric polynomial of some degree."""
    n_sample = 2 * degree + 1
    turn = 2.0 * math.pi * sample / n_sample
    return [(2.0 if m else 1.0) * math.cos(m * turn) / n_sample for m in range(degree + 1)]


@functools.cache
def albedo_series_of(degree: int) -> AlbedoSeries:
    """The series up to an even degree."""
    n_order = degree + 1
    kept = kept_harmonics(degree)
    n_kept = len(kept)
    number = {key: k for k, key in enumerate(kept)}
    Harmonics = wp.types.vector(length=n_kept, dtype=wp.float64)
    spread = wp.constant(Harmonics(*(damping(l) for l, _ in kept)))  # what a sphere sends on, over what it receives
    Moments = wp.types.vector(length=n_order, dtype=wp.float64)
    weights = [Moments(*sample_weights(degree, j)) for j in range(n_order)]

    def summer(m: int) -> wp.Function:
        @wp.func
        def sum_order(light: Harmonics, cosine: wp.float64) -> wp.float64:
            """Sum of the harmonics of order m, apart from sin^m cos(m azimuth)."""
            total = wp.float64(0.0)
            q = wp.float64(1.0)
            q_last = wp.float64(0.0)
            for l in range(m, n_order):
                if wp.static((l, m) in number):
                    total += light[wp.static(number.get((l, m), 0))] * q
                q_next = cosine * q - wp.float64(wp.static(step(l, m))) * q_last
                q_last = q
                q = q_next
            return total

        return sum_order

    positive_moments = positive_moments_of(n_order)
    summers = [summer(m) for m in range(n_order)]

    @wp.func
    def harmonics(
        table: wp.array3d[wp.float64], limb_sine: wp.float64, sun_up: wp.float64, sun_across: wp.float64
    ) -> Harmonics:
        """Linear between the table's heights and between its zenith angles."""
        height = height_position(limb_sine, table.shape[0])
        zenith = angle_from_x(sun_across, sun_up) / _PI * wp.float64(table.shape[1] - 1)
        row = wp.clamp(int(height), 0, table.shape[0] - 2)
        column = wp.clamp(int(zenith), 0, table.shape[1] - 2)
        u = height - wp.float64(row)
        v = zenith - wp.float64(column)
        light = Harmonics()
        for i in range(n_kept):
            low = table[row, column, i] + (table[row, column + 1, i] - table[row, column, i]) * v
            high = table[row + 1, column, i] + (table[row + 1, column + 1, i] - table[row + 1, column, i]) * v
            light[i] = (low + (high - low) * u) * (limb_sine * limb_sine)
        return light

    @wp.func
    def element_sr(light: Harmonics, cosine: wp.float64, along: wp.float64) -> wp.float64:
        """The series for a normal, by its parts along the nadir and along the Sun's horizontal direction."""
        one = wp.float64(1.0)
        sine2 = (one - cosine) * (one + cosine)
        total = wp.float64(0.0)
        turned = one  # sin^m cos(m azimuth)
        last = along
        for m in range(n_order):
            total += turned * wp.static(summers[m])(light, cosine)
            after = wp.float64(2.0) * along * turned - sine2 * last
            if wp.static(m == 0):
                after = along
            last = turned
            turned = after
        return total

    @wp.func
    def side_m2_sr(light: Harmonics, body: Body, view: wp.vec3d, nadir: wp.vec3d, level: wp.vec3d) -> wp.float64:
        """A turned body's side: over azimuth, the series is a trigonometric polynomial that its samples determine."""
        zero = wp.float64(0.0)
        across = wp.sqrt(view[0] * view[0] + view[1] * view[1])
        ahead = wp.vec3d(wp.float64(1.0), zero, zero)
        if across > zero:
            ahead = wp.vec3d(view[0] / across, view[1] / across, zero)
        beside = wp.vec3d(-ahead[1], ahead[0], zero)
        moments = positive_moments(body.side_along * view[2], body.side_across * across)
        cosine = body.side_along * nadir[2]
        along = body.side_along * level[2]
        cosine_x = body.side_across * wp.dot(ahead, nadir)
        along_x = body.side_across * wp.dot(ahead, level)
        cosine_y = body.side_across * wp.dot(beside, nadir)
        along_y = body.side_across * wp.dot(beside, level)
        total = wp.dot(moments, wp.static(weights[0])) * element_sr(light, cosine + cosine_x, along + along_x)
        for j in range(1, n_order):
            x = wp.float64(wp.static(math.cos(2.0 * math.pi * j / (2 * n_order - 1))))
            y = wp.float64(wp.static(math.sin(2.0 * math.pi * j / (2 * n_order - 1))))
            c = cosine + cosine_x * x
            d = along + along_x * x
            pair = element_sr(light, c + cosine_y * y, d + along_y * y)
            pair += element_sr(light, c - cosine_y * y, d - along_y * y)
            total += wp.dot(moments, wp.static(weights[j])) * pair
        return total * body.side_m2 / _TWO_PI

    @wp.func
    def area_m2_sr(
        light: Harmonics, body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, sun: wp.vec3d
    ) -> wp.float64:
        """What a body of any kind sends towards view [m2 sr], not below 0."""
        zero = wp.float64(0.0)
        sun_up = -wp.dot(nadir, sun)
        level = sun + nadir * sun_up
        level = level / wp.max(wp.length(level), _NO_AZIMUTH)
        total = zero
        if body.radius_m > zero:
            sphere = wp.cw_mul(light, spread)
            total = body.radius_m * body.radius_m * element_sr(sphere, wp.dot(view, nadir), wp.dot(view, level))
            return wp.max(total, zero)
        if body.n_facet > 0:
            for i in range(body.first_facet, body.first_facet + body.n_facet):
                normal = facets.normal[i]
                seen = wp.dot(normal, view)
                if seen > zero:
                    total += facets.area_m2[i] * seen * element_sr(light, wp.dot(normal, nadir), wp.dot(normal, level))
            return wp.max(total, zero)
        if view[2] > zero and body.top_m2 > zero:
            total = body.top_m2 * view[2] * element_sr(light, nadir[2], level[2])
        if view[2] < zero and body.base_m2 > zero:
            total = body.base_m2 * -view[2] * element_sr(light, -nadir[2], -level[2])
        if body.side_m2 > zero:
            total += side_m2_sr(light, body, view, nadir, level)
        return wp.max(total, zero)

    return AlbedoSeries(Harmonics, harmonics, area_m2_sr)
