"""Heat of the Earth that a body reflects, float64, by polynomials: fast, less exact.

A plane element's view factor is limb_sine^2 (c / 2 + E(c^2)), c the cosine between normal and nadir: what is odd in c
is linear, as what a disc gives to both sides of a plane adds up so. E is smooth, and the host keeps polynomials of it
in a table over the height (`warpsim.target.heat_table`). Around the side of a turned body c is c0 + d cos(azimuth), and
E a trigonometric polynomial, whose first waves come from samples over half a turn; its product with the share of the
side that is seen is integrated in closed form. A sphere's area is such a polynomial as well (Funk and Hecke).

The areas are those of earthlight.py but for the polynomials' error.
"""

import functools
import math
from typing import NamedTuple

import warp as wp

from warpsim_kernels.earthlight import limb_cosine
from warpsim_kernels.facets import Facets
from warpsim_kernels.shapes import Body, positive_moments_of

_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_THIRD_PI = wp.constant(wp.float64(1.0471975511965976))


class HeatSeries(NamedTuple):
    """Device functions of polynomials of one degree, and the type of their coefficients."""

    Coefficients: type
    coefficients: wp.Function
    """(rows, limb_sine): of the polynomial in c^2 at a height, from one of the tables."""
    area_m2: wp.Function
    """(tables, body, facets, view, nadir, limb_sine): what a body reflects towards view, as `earth_area_m2`."""


@wp.struct
class HeatTables:
    """Coefficients of polynomials in c^2, lowest first, at even steps of limb_sine - limb_cosine from -1 to 1."""

    element: wp.array2d[wp.float64]  # (n_height, degree / 2 + 1) of a plane element's even part
    sphere: wp.array2d[wp.float64]  # (n_height, degree / 2 + 1) of that of a unit sphere


def sample_turns(n_sample: int) -> list[float]:
    """Azimuths of the samples [rad]: the middles of equal parts of half a turn."""
    return [math.pi * (j + 0.5) / n_sample for j in range(n_sample)]


@functools.cache
def heat_series_of(degree: int) -> HeatSeries:
    """The functions for polynomials of an even degree in c."""
    # Waves of higher orders are small, and meet still smaller moments: leaving them out costs less than 1e-5.
    n_order, n_power, n_sample = degree // 2, degree // 2 + 1, degree // 2 + 2
    Coefficients = wp.types.vector(length=n_power, dtype=wp.float64)
    Samples = wp.types.vector(length=n_sample, dtype=wp.float64)
    turns = sample_turns(n_sample)
    ones = wp.constant(Samples(*([1.0] * n_sample)))
    cosines = wp.constant(Samples(*(math.cos(turn) for turn in turns)))
    waves = [Samples(*((2.0 if m else 1.0) * math.cos(m * turn) / n_sample for turn in turns)) for m in range(n_order)]
    positive_moments = positive_moments_of(n_order)

    @wp.func
    def coefficients(rows: wp.array2d[wp.float64], limb_sine: wp.float64) -> Coefficients:
        """Linear between the table's heights."""
        height = wp.float64(0.5) * (wp.float64(1.0) + limb_sine - limb_cosine(limb_sine))
        place = height * wp.float64(rows.shape[0] - 1)
        row = wp.clamp(int(place), 0, rows.shape[0] - 2)
        part = place - wp.float64(row)
        found = Coefficients()
        for i in range(n_power):
            found[i] = rows[row, i] + (rows[row + 1, i] - rows[row, i]) * part
        return found

    @wp.func
    def even_part(even: Coefficients, cosine: wp.float64) -> wp.float64:
        square = cosine * cosine
        total = even[wp.static(n_power - 1)]
        for i in range(1, n_power):
            total = total * square + even[wp.static(n_power - 1) - i]
        return total

    @wp.func
    def factor(even: Coefficients, cosine: wp.float64) -> wp.float64:
        """View factor of a plane element over limb_sine^2."""
        return wp.float64(0.5) * cosine + even_part(even, cosine)

    @wp.func
    def side_integral(even: Coefficients, body: Body, view: wp.vec3d, nadir: wp.vec3d) -> wp.float64:
        """Integral over azimuth of the seen share of the side times `factor`."""
        across = wp.sqrt(view[0] * view[0] + view[1] * view[1])
        level = wp.sqrt(nadir[0] * nadir[0] + nadir[1] * nadir[1])
        apart = view[0] * nadir[0] + view[1] * nadir[1]  # cosine of the angle between their azimuths
        apart = apart / wp.max(across * level, wp.float64(1.0e-30))
        moments = positive_moments(body.side_along * view[2], body.side_across * across)
        c0 = body.side_along * nadir[2]
        d = body.side_across * level
        cosine = ones * c0 + cosines * d
        square = wp.cw_mul(cosine, cosine)
        light = ones * even[wp.static(n_power - 1)]
        for i in range(1, n_power):
            light = wp.cw_mul(light, square) + ones * even[wp.static(n_power - 1) - i]
        weight = wp.static(waves[0]) * moments[0]
        wave = apart  # cos(m apart)
        last = wp.float64(1.0)
        for m in range(1, n_order):
            weight += wp.static(waves[m]) * (moments[m] * wave)
            following = wp.float64(2.0) * apart * wave - last
            last = wave
            wave = following
        linear = c0 * moments[0] + d * apart * moments[1]
        return wp.float64(0.5) * linear + wp.dot(light, weight)

    @wp.func
    def turned_m2(even: Coefficients, body: Body, view: wp.vec3d, nadir: wp.vec3d) -> wp.float64:
        """A turned body's ends and side."""
        total = wp.float64(0.0)
        if view[2] > wp.float64(0.0):
            total = body.top_m2 * view[2] * factor(even, nadir[2])
        if view[2] < wp.float64(0.0):
            total = body.base_m2 * -view[2] * factor(even, -nadir[2])
        if body.side_m2 > wp.float64(0.0):
            total += body.side_m2 / _TWO_PI * side_integral(even, body, view, nadir)
        return total

    @wp.func
    def facets_m2(even: Coefficients, facets: Facets, body: Body, view: wp.vec3d, nadir: wp.vec3d) -> wp.float64:
        total = wp.float64(0.0)
        for i in range(body.first_facet, body.first_facet + body.n_facet):
            seen = wp.dot(facets.normal[i], view)
            if seen > wp.float64(0.0):
                total += facets.area_m2[i] * seen * factor(even, wp.dot(facets.normal[i], nadir))
        return total

    @wp.func
    def area_m2(
        tables: HeatTables, body: Body, facets: Facets, view: wp.vec3d, nadir: wp.vec3d, limb_sine: wp.float64
    ) -> wp.float64:
        """`earthlight.body_earth_area_m2` by polynomials, not below 0."""
        s = wp.min(limb_sine, wp.float64(1.0))
        total = wp.float64(0.0)
        if body.radius_m > wp.float64(0.0):
            cosine = wp.dot(view, nadir)
            sphere = coefficients(tables.sphere, s)
            total = body.radius_m * body.radius_m * (_THIRD_PI * cosine + even_part(sphere, cosine))
        else:
            even = coefficients(tables.element, s)
            if body.n_facet > 0:
                total = facets_m2(even, facets, body, view, nadir)
            else:
                total = turned_m2(even, body, view, nadir)
        return wp.max(total, wp.float64(0.0)) * s * s

    return HeatSeries(Coefficients, coefficients, area_m2)
