"""Apparent directions: parallax, deflection by the Sun, light time and special-relativistic aberration, float64."""

import warp as wp

from warpsim_kernels.motion import NodeGrid, hermite_position_m

SPEED_OF_LIGHT_M_S = wp.constant(wp.float64(299792458.0))


ASTRONOMICAL_UNIT_M = wp.constant(wp.float64(149597870700.0))
_SUN_SCHWARZSCHILD_AU = wp.constant(wp.float64(1.97412574336e-8))


@wp.func
def seen_from(direction: wp.vec3d, parallax_rad: wp.float64, observer_m: wp.vec3d) -> wp.vec3d:
    """Direction of a star from an observer off the barycentre (annual parallax); direction is barycentric."""
    return wp.normalize(direction - observer_m * (parallax_rad / ASTRONOMICAL_UNIT_M))


@wp.func
def deflected(direction: wp.vec3d, from_sun_m: wp.vec3d) -> wp.vec3d:
    """Direction of a star after the Sun has bent its light; from_sun_m is the observer's heliocentric position.

    Klioner (2003), Eq. 70 for a source at infinity; as ERFA's ldsun, the bending fades within 5 arcmin of the Sun's
    centre, where the Sun hides the star.
    """
    one = wp.float64(1.0)
    distance_au = wp.length(from_sun_m) / ASTRONOMICAL_UNIT_M
    away = wp.normalize(from_sun_m)
    nearest = wp.float64(1.0e-6) / wp.max(distance_au * distance_au, one)
    bend = _SUN_SCHWARZSCHILD_AU / (distance_au * wp.max(one + wp.dot(direction, away), nearest))
    # The part of `away` across the line of sight: the star is seen farther from the Sun.
    return wp.normalize(direction + (away - direction * wp.dot(direction, away)) * bend)


@wp.func
def aberrated(direction: wp.vec3d, velocity_m_s: wp.vec3d) -> wp.vec3d:
    """Unit direction seen by an observer with the given barycentric velocity (Lorentz transformation).

    Klioner (2003), "A practical relativistic model for microarcsecond astrometry in space", Eq. 10 without potential.
    """
    one = wp.float64(1.0)
    beta = velocity_m_s / SPEED_OF_LIGHT_M_S
    along = wp.dot(direction, beta)
    inverse_gamma = wp.sqrt(one - wp.dot(beta, beta))
    moved = direction * inverse_gamma + beta * (one + along / (one + inverse_gamma))
    return wp.normalize(moved)


@wp.struct
class LightPath:
    """The way of the light from a body to an observer."""

    vector_m: wp.vec3d  # observer -> where the body was when the light left, geocentric axes
    range_m: wp.float64
    emission_time_s: wp.float64
    apparent: wp.vec3d  # unit direction the observer sees, aberration included
    stowed: int  # not 0: the body had not left its carrier


@wp.func
def light_path(
    position_m: wp.array2d[wp.vec3d],
    velocity_m_s: wp.array2d[wp.vec3d],
    body: int,
    time_s: wp.float64,
    grid: NodeGrid,
    observer_m: wp.vec3d,
    earth_velocity_m_s: wp.vec3d,
    observer_velocity_m_s: wp.vec3d,  # barycentric
) -> LightPath:
    """Where a body is seen at time_s.

    In the geocentric frame of the tracks the light time is exactly range / c; it is iterated to convergence. The
    direction is then taken to the barycentric frame (which moves at -earth_velocity), where star catalogs live, and
    from there to the observer like a star's, so that targets and stars are seen by the same rule to second order in
    v / c.
    """
    path = LightPath()
    path.emission_time_s = time_s
    for _ in range(3):
        place = hermite_position_m(position_m, velocity_m_s, body, path.emission_time_s, grid)
        path.vector_m = place - observer_m
        path.range_m = wp.length(path.vector_m)
        path.emission_time_s = time_s - path.range_m / SPEED_OF_LIGHT_M_S
    barycentric = aberrated(wp.normalize(path.vector_m), -earth_velocity_m_s)
    path.apparent = aberrated(barycentric, observer_velocity_m_s)
    return path


@wp.struct
class Releases:
    """When bodies leave what carries them."""

    release_s: wp.array[wp.float64]  # (n_body,) far in the past where nothing carries the body
    carrier: wp.array[wp.int32]  # (n_body,) row in the tracks


@wp.func
def path_from_target(
    position_m: wp.array2d[wp.vec3d],
    velocity_m_s: wp.array2d[wp.vec3d],
    releases: Releases,
    body: int,
    time_s: wp.float64,
    grid: NodeGrid,
    observer_m: wp.vec3d,
    earth_velocity_m_s: wp.vec3d,
    observer_velocity_m_s: wp.vec3d,  # barycentric
) -> LightPath:
    """As light_path, with a target at the place of its carrier until its release."""
    path = light_path(
        position_m, velocity_m_s, body, time_s, grid, observer_m, earth_velocity_m_s, observer_velocity_m_s
    )
    if path.emission_time_s < releases.release_s[body]:
        carrier = releases.carrier[body]
        path = light_path(
            position_m, velocity_m_s, carrier, time_s, grid, observer_m, earth_velocity_m_s, observer_velocity_m_s
        )
        path.stowed = 1
    return path
