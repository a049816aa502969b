"""Part of the Sun's disc that is seen from a position near the Earth, float64."""

import warp as wp

from warpsim_kernels.earth import Earth, stretched

SUN_RADIUS_M = wp.constant(wp.float64(6.957e8))
"""Nominal solar radius (IAU 2015 resolution B3)."""

_HALF = wp.constant(wp.float64(0.5))
_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_SUN_AND_MORE = wp.constant(wp.float64(1.01))
"""Covers the stretched axis, 1.0034 once in the Sun's size and once in its distance."""
_TWO_PI = wp.constant(wp.float64(6.283185307179586))


@wp.func
def covered_fraction(sun_rad: wp.float64, earth_rad: wp.float64, apart_rad: wp.float64) -> wp.float64:
    """Share of the Sun's disc behind the Earth's; angular radii and distance of the centres [rad].

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
def sunlit_fraction(place_m: wp.vec3d, to_sun_m: wp.vec3d, earth: Earth) -> wp.float64:
    """Share of the Sun's disc seen from a place past the Earth's ellipsoid, 0 to 1.

    The polar axis is stretched until the ellipsoid is a sphere; the Sun's disc is then an ellipse, and counts with its
    reach towards the Earth's centre.
    """
    if wp.dot(place_m, to_sun_m) >= _ZERO:
        return _ONE  # above the plane across the local vertical, where the Earth's disc does not reach
    place = stretched(place_m, earth)
    to_sun = stretched(to_sun_m, earth)
    # Sine of the angle from the Earth's limb to the Sun's centre, times the square of the place and the Sun's distance.
    # Where it is more than the Sun's radius, all or nothing is seen: most places need no angles, and no division.
    square = wp.dot(place, place)
    beside = wp.length(wp.cross(place, to_sun))
    behind = -wp.dot(place, to_sun)
    limb = wp.sqrt(wp.max(square - earth.equatorial_radius_m * earth.equatorial_radius_m, _ZERO))
    past_limb = beside * limb - behind * earth.equatorial_radius_m
    if wp.abs(past_limb) > _SUN_AND_MORE * SUN_RADIUS_M * square:
        return wp.where(past_limb > _ZERO, _ONE, _ZERO)
    distance_m = wp.length(to_sun_m)
    sine = SUN_RADIUS_M / distance_m
    away = to_sun_m / distance_m
    length_m = wp.length(to_sun)
    ahead = to_sun / length_m
    across = ahead * wp.dot(place, ahead) - place
    width = wp.length(across)
    factor = _ONE
    if width > _ZERO:
        reach = stretched(across / width, earth)
        factor = wp.length(reach - away * wp.dot(reach, away))
    sun_rad = wp.atan(sine / wp.sqrt((_ONE - sine) * (_ONE + sine)) * factor * distance_m / length_m)
    earth_rad = wp.asin(wp.min(earth.equatorial_radius_m / wp.length(place), _ONE))
    apart_rad = wp.atan2(beside, behind)
    return _ONE - covered_fraction(sun_rad, earth_rad, apart_rad)


@wp.kernel(enable_backward=False)
def sunlit_fraction_kernel(
    # in
    place_m: wp.array[wp.vec3d],  # (n,) geocentric
    sun_m: wp.array[wp.vec3d],  # (n,) geocentric
    earth: Earth,
    # out
    fraction: wp.array[wp.float64],  # (n,)
):
    """Sunlit fraction of each place."""
    i = wp.tid()
    fraction[i] = sunlit_fraction(place_m[i], sun_m[i] - place_m[i], earth)
