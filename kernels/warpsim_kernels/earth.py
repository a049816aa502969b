"""The Earth as an obstacle, and heights above it as tables of its light hold them."""

import warp as wp

_TO_THE_STARS_M = wp.constant(wp.float64(1.0e10))
"""Beyond everything near the Earth, yet short enough for the digits of the test."""
_LIMB_SLACK_RAD = wp.constant(wp.float64(1.0e-6))
"""Covers the rounding of angles, 2e-8 where arc cosines are worst."""


@wp.struct
class Earth:
    """The opaque Earth: the WGS84 ellipsoid."""

    pole: wp.vec3d  # unit, ICRS axes
    equatorial_radius_m: wp.float64
    polar_radius_m: wp.float64


@wp.func
def geocentric_radius_m(position_m: wp.vec3d, earth: Earth) -> wp.float64:
    """Distance from the Earth's centre to the ellipsoid along a position's direction [m]."""
    sine = wp.dot(position_m, earth.pole) / wp.length(position_m)
    squash = earth.equatorial_radius_m / earth.polar_radius_m
    stretch = (squash - wp.float64(1.0)) * (squash + wp.float64(1.0))
    return earth.equatorial_radius_m / wp.sqrt(wp.float64(1.0) + stretch * sine * sine)


@wp.func
def limb_cosine(limb_sine: wp.float64) -> wp.float64:
    """Cosine of the angular radius of the Earth's disc."""
    return wp.sqrt((wp.float64(1.0) - limb_sine) * (wp.float64(1.0) + limb_sine))


@wp.func
def height_position(limb_sine: wp.float64, n_height: int) -> wp.float64:
    """Position among the heights of a table, at even steps of limb_sine - limb_cosine from -1 to 1."""
    return wp.float64(0.5) * (wp.float64(1.0) + limb_sine - limb_cosine(limb_sine)) * wp.float64(n_height - 1)


@wp.func
def stretched(vector_m: wp.vec3d, earth: Earth) -> wp.vec3d:
    """A vector in axes whose polar one is stretched until the ellipsoid is a sphere."""
    stretch = earth.equatorial_radius_m / earth.polar_radius_m - wp.float64(1.0)
    return vector_m + earth.pole * (wp.dot(vector_m, earth.pole) * stretch)


@wp.func
def is_occulted(observer_m: wp.vec3d, vector_m: wp.vec3d, earth: Earth) -> bool:
    """True when the segment from the observer along vector_m meets the ellipsoid."""
    start = stretched(observer_m, earth)
    way = stretched(vector_m, earth)
    length2 = wp.max(wp.dot(way, way), wp.float64(1.0e-30))
    nearest = wp.clamp(-wp.dot(start, way) / length2, wp.float64(0.0), wp.float64(1.0))
    foot = start + way * nearest
    return wp.dot(foot, foot) < earth.equatorial_radius_m * earth.equatorial_radius_m


@wp.func
def is_star_occulted(observer_m: wp.vec3d, direction: wp.vec3d, earth: Earth) -> bool:
    """True when the ray from the observer in a unit direction meets the ellipsoid.

    The catalog's barycentric direction is taken for the geocentric one: at the limb, 20 arcsec are 0.3 km at 3000 km.
    """
    return is_occulted(observer_m, direction * _TO_THE_STARS_M, earth)


@wp.func
def is_earth_near(observer_m: wp.vec3d, direction: wp.vec3d, radius_rad: wp.float64, earth: Earth) -> bool:
    """False only where no ray within radius_rad of a unit direction meets the Earth: a sphere about the ellipsoid."""
    one = wp.float64(1.0)
    distance_m = wp.length(observer_m)
    if distance_m <= earth.equatorial_radius_m:
        return True
    limb_rad = wp.asin(earth.equatorial_radius_m / distance_m)
    off_nadir_rad = wp.acos(wp.clamp(-wp.dot(observer_m, direction) / distance_m, -one, one))
    return off_nadir_rad <= limb_rad + radius_rad + _LIMB_SLACK_RAD
