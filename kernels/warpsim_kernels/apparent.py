"""Apparent directions: parallax, deflection by the Sun, light time and special-relativistic aberration, float64."""

import warp as wp

from warpsim_kernels.motion import NodeGrid, Nodes, cubic_after, cubic_at, node_before, part_after

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


@wp.struct
class Boost:
    """A velocity as the Lorentz transformation of lines of sight needs it."""

    beta: wp.vec3d  # in units of the speed of light
    inverse_gamma: wp.float64
    along_factor: wp.float64  # 1 / (1 + inverse_gamma)


@wp.func
def boost_by(velocity_m_s: wp.vec3d) -> Boost:
    """The boost into the frame of an observer who moves at velocity_m_s."""
    boost = Boost()
    one = wp.float64(1.0)
    boost.beta = velocity_m_s / SPEED_OF_LIGHT_M_S
    boost.inverse_gamma = wp.sqrt(one - wp.dot(boost.beta, boost.beta))
    boost.along_factor = one / (one + boost.inverse_gamma)
    return boost


@wp.func
def boosted(vector: wp.vec3d, length: wp.float64, boost: Boost) -> wp.vec3d:
    """A vector along a line of sight, as a moving observer has it; its length becomes `boosted_length`.

    Klioner (2003), "A practical relativistic model for microarcsecond astrometry in space", Eq. 10 without potential,
    times the vector's length: light's four-vector transforms linearly, so lengths need no root.
    """
    along = wp.dot(vector, boost.beta)
    return vector * boost.inverse_gamma + boost.beta * (length + along * boost.along_factor)


@wp.func
def boosted_length(vector: wp.vec3d, length: wp.float64, boost: Boost) -> wp.float64:
    """Length of `boosted`."""
    return length + wp.dot(vector, boost.beta)


@wp.struct
class Observer:
    """Position, velocity and time of the sensor of a view, common to the light of all bodies."""

    time_s: wp.float64
    position_m: wp.vec3d  # geocentric
    to_barycentric: Boost  # out of the geocentric frame
    to_observer: Boost  # from there into the observer's


@wp.func
def observer_of(
    time_s: wp.float64,
    position_m: wp.vec3d,
    earth_velocity_m_s: wp.vec3d,
    velocity_m_s: wp.vec3d,  # barycentric
) -> Observer:
    """An observer at a time."""
    observer = Observer()
    observer.time_s = time_s
    observer.position_m = position_m
    observer.to_barycentric = boost_by(-earth_velocity_m_s)
    observer.to_observer = boost_by(velocity_m_s)
    return observer


@wp.struct
class LightPath:
    """The way of the light from a body to an observer."""

    vector_m: wp.vec3d  # observer -> where the body was when the light left, geocentric axes
    range_m: wp.float64
    emission_time_s: wp.float64
    apparent: wp.vec3d  # unit direction the observer sees, aberration included; 0 for a body at the observer
    not_deployed: int  # not 0: the body had not left its carrier
    absent: int  # not 0: the body was not there


@wp.struct
class Presence:
    """Times at which bodies leave what carries them, and in which they exist."""

    release_s: wp.array[wp.float64]  # (n_body,) far in the past where nothing carries the body
    carrier: wp.array[wp.int32]  # (n_body,) row in the tracks
    exists_s: wp.array[wp.vec2d]  # (n_body,) from when to when


@wp.struct
class Tracks:
    """Motion of all bodies, sensors first, then targets, and of the Earth."""

    nodes: Nodes
    earth_velocity_m_s: wp.array[wp.vec3d]  # (n_node,) barycentric
    presence: Presence
    grid: NodeGrid  # of the Earth and the Sun
    first_target: int  # row of the first target


@wp.func
def path_from_body(tracks: Tracks, body: int, observer: Observer) -> LightPath:
    """Apparent position of a body for an observer.

    In the geocentric frame of the tracks the light time is exactly range / c. It is found in three steps, each of which
    leaves v / c of the error, 3e-5 or so: what is left is below rounding. The direction is then taken to the
    barycentric frame (which moves at -earth_velocity), where star catalogs live, and from there to the observer like a
    star's, so that targets and stars are seen by the same rule to second order in v / c.
    """
    path = LightPath()
    own = tracks.nodes.bodies[body]
    last = node_before(observer.time_s, own.grid)
    node = last
    since_last = part_after(observer.time_s, last, own.grid)
    way = cubic_after(tracks.nodes, own, node)
    part = since_last - wp.length(cubic_at(way, since_last) - observer.position_m) * own.steps_per_m
    if part < wp.float64(0.0) and node > 0:  # the light left before the node
        node = wp.max(node + int(wp.floor(part)), 0)
        way = cubic_after(tracks.nodes, own, node)
    since_node = since_last + wp.float64(last - node)
    part = part + wp.float64(last - node)
    for _ in range(2):
        path.vector_m = cubic_at(way, part) - observer.position_m
        path.range_m = wp.length(path.vector_m)
        part = since_node - path.range_m * own.steps_per_m
    path.emission_time_s = observer.time_s - path.range_m / SPEED_OF_LIGHT_M_S
    seen = boosted(path.vector_m, path.range_m, observer.to_barycentric)
    length_m = boosted_length(path.vector_m, path.range_m, observer.to_barycentric)
    path.apparent = boosted(seen, length_m, observer.to_observer)
    length_m = boosted_length(seen, length_m, observer.to_observer)
    if length_m > wp.float64(0.0):
        path.apparent = path.apparent / length_m
    return path


@wp.func
def path_from_target(tracks: Tracks, body: int, observer: Observer) -> LightPath:
    """As path_from_body, with a target at the position of its carrier until its release."""
    path = path_from_body(tracks, body, observer)
    if path.emission_time_s < tracks.presence.release_s[body]:
        path = path_from_body(tracks, tracks.presence.carrier[body], observer)
        path.not_deployed = 1
    exists_s = tracks.presence.exists_s[body]
    if path.emission_time_s < exists_s[0] or path.emission_time_s > exists_s[1]:
        path.absent = 1
    return path
