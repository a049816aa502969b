"""The Earth as an obstacle to sight and to sunlight, and heights above it as tables of its light hold them; float64."""

import warp as wp

_TO_THE_STARS_M = wp.constant(wp.float64(1.0e10))
"""Beyond everything near the Earth, yet short enough for the digits of the test."""
_LIMB_SLACK_RAD = wp.constant(wp.float64(1.0e-6))
"""Covers the rounding of angles, 2e-8 where arc cosines are worst."""
SUN_RADIUS_M = wp.constant(wp.float64(6.957e8))
"""Nominal solar radius (IAU 2015 resolution B3)."""

_HALF = wp.constant(wp.float64(0.5))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_SUN_AND_MORE = wp.constant(wp.float64(1.01))
"""Covers the stretched axis, 1.0034 once in the Sun's size and once in its distance."""
_TWO_PI = wp.constant(wp.float64(6.283185307179586))


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


@wp.func
def covered_fraction(sun_rad: wp.float64, earth_rad: wp.float64, apart_rad: wp.float64) -> wp.float64:
    """Fraction of the Sun's disc behind the Earth's; angular radii and distance of the centres [rad].

    Two caps of the unit sphere that cross have two sectors less two spherical triangles in common. Half-angle formulae
    and l'Huilier's keep the digits at first and last contact.
    """
    sun_square = wp.sin(_HALF * sun_rad) * wp.sin(_HALF * sun_rad)  # a quarter of a cap's area over pi
    earth_square = wp.sin(_HALF * earth_rad) * wp.sin(_HALF * earth_rad)
    if apart_rad >= sun_rad + earth_rad:
        return _ZERO
    if apart_rad <= wp.abs(earth_rad - sun_rad):
        return wp.min(earth_square / sun_square, _ONE)
    half = _HALF * (sun_rad + earth_rad + apart_rad)
    less_sun = wp.max(_HALF * (earth_rad + apart_rad - sun_rad), _ZERO)
    less_earth = wp.max(_HALF * (sun_rad + apart_rad - earth_rad), _ZERO)
    less_apart = wp.max(_HALF * (sun_rad + earth_rad - apart_rad), _ZERO)
    sine = wp.sin(half)
    sine_sun = wp.sin(less_sun)
    sine_earth = wp.sin(less_earth)
    sine_apart = wp.sin(less_apart)
    at_sun = _TWO * wp.atan2(wp.sqrt(sine_sun * sine_apart), wp.sqrt(sine * sine_earth))
    at_earth = _TWO * wp.atan2(wp.sqrt(sine_earth * sine_apart), wp.sqrt(sine * sine_sun))
    tangents = wp.tan(_HALF * half) * wp.tan(_HALF * less_sun) * wp.tan(_HALF * less_earth) * wp.tan(_HALF * less_apart)
    excess = wp.float64(4.0) * wp.atan(wp.sqrt(tangents))
    common = _TWO * (at_sun * sun_square + at_earth * earth_square) - excess
    return wp.clamp(common / (_TWO_PI * sun_square), _ZERO, _ONE)


@wp.func
def sunlit_fraction(position_m: wp.vec3d, to_sun_m: wp.vec3d, earth: Earth) -> wp.float64:
    """Fraction of the Sun's disc seen from a position past the Earth's ellipsoid, 0 to 1.

    The polar axis is stretched until the ellipsoid is a sphere; the Sun's disc is then an ellipse, and counts with its
    reach towards the Earth's centre.
    """
    if wp.dot(position_m, to_sun_m) >= _ZERO:
        return _ONE  # above the plane across the local vertical, where the Earth's disc does not reach
    position = stretched(position_m, earth)
    to_sun = stretched(to_sun_m, earth)
    # Sine of the angle from the Earth's limb to the Sun's centre, times squared radius and the Sun's distance. Where
    # it is more than the Sun's radius, all or nothing is seen: most positions need no angles, and no division.
    square = wp.dot(position, position)
    beside = wp.length(wp.cross(position, to_sun))
    behind = -wp.dot(position, to_sun)
    limb = wp.sqrt(wp.max(square - earth.equatorial_radius_m * earth.equatorial_radius_m, _ZERO))
    past_limb = beside * limb - behind * earth.equatorial_radius_m
    if wp.abs(past_limb) > _SUN_AND_MORE * SUN_RADIUS_M * square:
        return wp.where(past_limb > _ZERO, _ONE, _ZERO)
    distance_m = wp.length(to_sun_m)
    sine = SUN_RADIUS_M / distance_m
    away = to_sun_m / distance_m
    length_m = wp.length(to_sun)
    ahead = to_sun / length_m
    across = ahead * wp.dot(position, ahead) - position
    width = wp.length(across)
    factor = _ONE
    if width > _ZERO:
        reach = stretched(across / width, earth)
        factor = wp.length(reach - away * wp.dot(reach, away))
    sun_rad = wp.atan(sine / wp.sqrt((_ONE - sine) * (_ONE + sine)) * factor * distance_m / length_m)
    earth_rad = wp.asin(wp.min(earth.equatorial_radius_m / wp.length(position), _ONE))
    apart_rad = wp.atan2(beside, behind)
    return _ONE - covered_fraction(sun_rad, earth_rad, apart_rad)
