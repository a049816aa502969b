"""Sunlight that the Earth reflects onto a body, float64, by a short series of spherical harmonics: fast, less exact.

What a plane element receives from all around is a smooth function of its normal, even where the light itself has edges:
the cosine of incidence damps the light's harmonics of degree l by A_l (Ramamoorthi and Hanrahan 2001, J. Opt. Soc. Am.
A 18, 2448), which falls like l^-2.5 and is 0 for odd l > 1. The harmonics are taken about the nadir, with azimuth
counted from the Sun's: the Earth's light is even in it, so cosines will do. They depend neither on the body nor on its
attitude, and are found once; each face then costs a polynomial in its normal.

The areas are those of albedo.py but for the harmonics left out.
"""

import functools
import math
from typing import NamedTuple

import warp as wp

from warpsim_kernels.earthlight import Rule, limb_cosine
from warpsim_kernels.facets import Facets
from warpsim_kernels.shapes import Body, positive_moments_of

_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_NO_AZIMUTH = wp.constant(wp.float64(1.0e-12))  # sine of the Sun's zenith angle below which its azimuth does not count
_CROWDING = wp.constant(wp.float64(4.0))  # how near the limb rings crowd: found by trial, from the ground to the Moon


class AlbedoSeries(NamedTuple):
    """Device functions of the series up to some degree, and the type of its harmonics."""

    Harmonics: type
    harmonics: wp.Function
    """(rule, limb_sine, sun_up, sun_across): of what a plane element receives; cosine and sine of the Sun's zenith
    angle at the point below, the rule is that of the rings."""
    area_m2_sr: wp.Function
    """(harmonics, body, facets, view, nadir, sun): what a body sends towards view [m2 sr]."""


@wp.func
def is_dark(limb_sine: wp.float64, sun_up: wp.float64, sun_across: wp.float64) -> bool:
    """Whether all the ground in view is in the night; cosine and sine of the Sun's zenith angle at the point below."""
    return sun_up <= wp.float64(0.0) and sun_across <= wp.min(limb_sine, wp.float64(1.0))


def damping(degree: int) -> float:
    """A_l, what the cosine of incidence leaves of harmonics of a degree (Ramamoorthi and Hanrahan 2001, eq. 19)."""
    if degree < 2:
        return math.pi * (1.0 - degree / 3.0)
    if degree % 2:
        return 0.0
    sign = 1.0 if degree % 4 else -1.0
    return sign * 2.0 * math.pi / ((degree + 2) * (degree - 1)) * math.comb(degree, degree // 2) / 2.0**degree


def step(degree: int, order: int) -> float:
    """Return b of q_{l+1} = c q_l - b q_{l-1}.

    q_l sin^m is the associated Legendre function of degree l and order m, scaled so that q_l = c^(l-m) + lower powers.
    """
    if degree == order:
        return 0.0
    return (degree - order) * (degree + order) / ((2 * degree - 1) * (2 * degree + 1))


def norm(degree: int, order: int) -> float:
    """Factor of the integral of light times q_l sin^m cos(m azimuth), A_l included."""
    highest = math.prod(range(1, 2 * degree, 2)) / math.factorial(degree - order)
    share = math.factorial(degree - order) / math.factorial(degree + order) * (1 if order == 0 else 2)
    return damping(degree) * (2 * degree + 1) / (4.0 * math.pi) * share * highest * highest


def sample_weights(degree: int, sample: int) -> list[float]:
    """Share of a sample, of 2 degree + 1 over a turn, in the cosines of a trigonometric polynomial of some degree."""
    n_sample = 2 * degree + 1
    turn = 2.0 * math.pi * sample / n_sample
    return [(2.0 if m else 1.0) * math.cos(m * turn) / n_sample for m in range(degree + 1)]


@functools.cache
def albedo_series_of(degree: int) -> AlbedoSeries:
    """The series up to an even degree."""
    n_order = degree + 1
    kept = [(l, m) for m in range(n_order) for l in range(m, n_order) if l < 2 or l % 2 == 0]
    place = {key: k for k, key in enumerate(kept)}
    Harmonics = wp.types.vector(length=len(kept), dtype=wp.float64)
    norms = wp.constant(Harmonics(*(norm(l, m) for l, m in kept)))
    spread = wp.constant(Harmonics(*(damping(l) for l, _ in kept)))  # what a sphere sends on, over what it receives
    Moments = wp.types.vector(length=n_order, dtype=wp.float64)
    weights = [Moments(*sample_weights(degree, j)) for j in range(n_order)]

    def adder(m: int) -> wp.Function:
        @wp.func
        def add_order(light: Harmonics, cosine: wp.float64, moment: wp.float64) -> Harmonics:
            """Add a ring's cos(m azimuth) to the harmonics of order m."""
            more = light
            q = wp.float64(1.0)
            q_last = wp.float64(0.0)
            for l in range(m, n_order):
                if wp.static((l, m) in place):
                    more[wp.static(place.get((l, m), 0))] += moment * q
                q_next = cosine * q - wp.float64(wp.static(step(l, m))) * q_last
                q_last = q
                q = q_next
            return more

        return add_order

    def summer(m: int) -> wp.Function:
        @wp.func
        def sum_order(light: Harmonics, cosine: wp.float64) -> wp.float64:
            """Sum of the harmonics of order m, apart from sin^m cos(m azimuth)."""
            total = wp.float64(0.0)
            q = wp.float64(1.0)
            q_last = wp.float64(0.0)
            for l in range(m, n_order):
                if wp.static((l, m) in place):
                    total += light[wp.static(place.get((l, m), 0))] * q
                q_next = cosine * q - wp.float64(wp.static(step(l, m))) * q_last
                q_last = q
                q = q_next
            return total

        return sum_order

    positive_moments = positive_moments_of(n_order)
    adders = [adder(m) for m in range(n_order)]
    summers = [summer(m) for m in range(n_order)]

    @wp.func
    def add_ring(
        light: Harmonics, cosine: wp.float64, sine: wp.float64, up: wp.float64, across: wp.float64, weight: wp.float64
    ) -> Harmonics:
        """Add the light max(0, up + across cos(azimuth)) of a ring under an angle from the nadir."""
        if up <= -across:
            return light
        moments = positive_moments(up, across)
        more = wp.static(adders[0])(light, cosine, weight * moments[0])
        more = wp.static(adders[1])(more, cosine, weight * sine * moments[1])
        if up < across:
            power = weight * sine
            for m in range(2, n_order):
                power *= sine
                more = wp.static(adders[m])(more, cosine, power * moments[m])
        return more

    @wp.func
    def add_rings(
        rule: Rule,
        light: Harmonics,
        limb_sine: wp.float64,
        sun_up: wp.float64,
        sun_across: wp.float64,
        start: wp.float64,
        end: wp.float64,
    ) -> Harmonics:
        """Add the rings between two cosines of the zenith angle of the line of sight at the ground."""
        s = limb_sine
        k = limb_cosine(s)
        one = wp.float64(1.0)
        # The variable x crowds rings at the limb, low above the ground: cosine = x (x + near) / (1 + near).
        near = _CROWDING * k / s
        scale = one + near
        low = wp.float64(0.0)
        if start > low:
            low = wp.float64(2.0) * scale * start / (near + wp.sqrt(near * near + wp.float64(4.0) * scale * start))
        high = wp.float64(2.0) * scale * end / (near + wp.sqrt(near * near + wp.float64(4.0) * scale * end))
        more = light
        for i in range(rule.n_node):
            x = low + (high - low) * rule.place[i]
            zenith = x * (x + near) / scale
            zenith_sine2 = wp.max((one - zenith) * (one + zenith), wp.float64(0.0))  # 1 may be rounded up
            zenith_sine = wp.sqrt(zenith_sine2)
            cosine = wp.sqrt(k * k + s * s * zenith * zenith)
            up = zenith * cosine + s * zenith_sine2
            across = zenith_sine * (cosine - s * zenith)
            weight = rule.weight[i] * (high - low) * (wp.float64(2.0) * x + near) / scale * s * s * zenith / cosine
            more = add_ring(more, cosine, s * zenith_sine, up * sun_up, across * sun_across, weight)
        return more

    @wp.func
    def harmonics(rule: Rule, limb_sine: wp.float64, sun_up: wp.float64, sun_across: wp.float64) -> Harmonics:
        """Of what a plane element receives, the Sun at a zenith angle above the point below [sr]."""
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        s = wp.min(limb_sine, one)
        light = Harmonics()
        if sun_across <= s:
            if sun_up > zero:  # no terminator in view
                light = add_rings(rule, light, s, sun_up, sun_across, zero, one)
        else:
            # The first ring that the terminator meets, as in albedo.seen_cap.
            high = sun_across - s
            partly = high / wp.sqrt(sun_up * sun_up + high * high)
            light = add_rings(rule, light, s, sun_up, sun_across, zero, partly)
            if sun_up > zero:
                light = add_rings(rule, light, s, sun_up, sun_across, partly, one)
        return wp.cw_mul(light, norms)

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
        """`albedo.body_albedo_area_m2` by the series, not below 0."""
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


@functools.cache
def make_albedo_series_kernel(degree: int) -> wp.Kernel:
    """Kernel of `albedo.albedo_area_kernel` by the series up to an even degree; the rule is that of the rings."""
    series = albedo_series_of(degree)

    @wp.kernel(module="unique", enable_backward=False)
    def albedo_series_kernel(
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
        light = series.harmonics(rule, limb_sine[i], -wp.dot(nadir[i], sun[i]), wp.length(wp.cross(nadir[i], sun[i])))
        area_m2_sr[i] = series.area_m2_sr(light, body, facets, view[i], nadir[i], sun[i])

    return albedo_series_kernel
