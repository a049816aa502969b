"""Light of the Earth's limb and disc along lines of sight, and the Sun's direction.

The limb is sharp, so its radiance is looked up per pixel, by how high above the ground a line of sight passes.
"""

import warp as wp

HIGHEST_KM = wp.constant(400.0)
"""Lines of sight that pass higher, or away from the Earth, have this height."""

NARROW_KM = wp.constant(0.5)
"""Heights within which the limb is nearly straight."""


@wp.struct
class SunPath:
    """Direction of the Sun from the Earth against time, and the plate's: in the middle of the scene."""

    start_s: wp.float64
    step_s: wp.float64
    direction: wp.array[wp.vec3d]  # (n_time,) ICRS
    strength: wp.array[float]  # (n_time,) sunlight over that at 1 au
    middle: wp.vec3d
    ecliptic_pole: wp.vec3d


@wp.struct
class EarthShine:
    """The Earth's limb and disc; profiles begin at the ground, in steps."""

    pole: wp.vec3d
    stretch: wp.float64  # equatorial over polar radius: along the pole, it makes the ellipsoid a sphere
    radius_km: wp.float64
    step_km: float
    n_height: int
    disc_w_cm2_sr: wp.array2d[float]  # (n_band, 2) emitted, and reflected under the Sun at the zenith
    limb_w_cm2_sr: wp.array3d[float]  # (n_band, 2, n_height)
    above_km_w_cm2_sr: wp.array3d[float]  # (n_band, 2, n_height) the integral from a height up


@wp.func
def sun_index(sun: SunPath, time_s: wp.float64) -> wp.float64:
    """Index of a time among the nodes of the Sun's path, with its fraction."""
    return wp.clamp((time_s - sun.start_s) / sun.step_s, wp.float64(0.0), wp.float64(sun.direction.shape[0] - 1))


@wp.func
def sun_direction(sun: SunPath, time_s: wp.float64) -> wp.vec3d:
    """Direction of the Sun at a time."""
    index = sun_index(sun, time_s)
    node = wp.min(int(index), sun.direction.shape[0] - 2)
    part = index - wp.float64(node)
    return wp.normalize(sun.direction[node] * (wp.float64(1.0) - part) + sun.direction[node + 1] * part)


@wp.func
def sun_strength(sun: SunPath, time_s: wp.float64) -> float:
    """Sunlight at the Earth over that at 1 au."""
    index = sun_index(sun, time_s)
    node = wp.min(int(index), sun.strength.shape[0] - 2)
    return wp.lerp(sun.strength[node], sun.strength[node + 1], float(index - wp.float64(node)))


@wp.func
def turned_back(sun: SunPath, now: wp.vec3d, direction: wp.vec3d) -> wp.vec3d:
    """A direction as it was, relative to the Sun, in the middle of the scene: turned about the ecliptic's pole."""
    pole = sun.ecliptic_pole
    sine = wp.dot(pole, wp.cross(now, sun.middle))
    across = wp.dot(now, sun.middle) - wp.dot(now, pole) * wp.dot(sun.middle, pole)
    size = wp.sqrt(sine * sine + across * across)
    cosine, turn = across / size, sine / size
    along = pole * wp.dot(pole, direction)
    return along + (direction - along) * cosine + wp.cross(pole, direction) * turn


@wp.func
def as_sphere(earth: EarthShine, vector: wp.vec3d) -> wp.vec3d:
    """A vector stretched along the pole, so that the WGS84 ellipsoid is a sphere."""
    return vector + earth.pole * (wp.dot(earth.pole, vector) * (earth.stretch - wp.float64(1.0)))


@wp.func
def earth_geometry(earth: EarthShine, position_m: wp.vec3d, direction: wp.vec3d, sun: wp.vec3d) -> wp.vec2d:
    """How high a line of sight passes, below 0 on the disc [km], and the cosine of the Sun's zenith angle there."""
    start = as_sphere(earth, position_m * wp.float64(1.0e-3))
    line = wp.normalize(as_sphere(earth, direction))
    along = -wp.dot(start, line)
    nearest = start + line * along
    height = wp.length(nearest) - earth.radius_km
    if along <= wp.float64(0.0):
        return wp.vec2d(wp.float64(HIGHEST_KM), wp.float64(0.0))
    point = nearest
    if height < wp.float64(0.0):
        point = nearest - line * wp.sqrt(-height * (wp.length(nearest) + earth.radius_km))
    stretched = wp.max(wp.length(as_sphere(earth, wp.normalize(nearest))), wp.float64(1.0))  # of heights there
    return wp.vec2d(wp.min(height / stretched, wp.float64(HIGHEST_KM)), wp.dot(wp.normalize(point), sun))


@wp.func
def column_above(earth: EarthShine, band: int, term: int, height_km: float) -> float:
    """Integral of the limb's radiance over height from a height up, below 0 as at 0 [km W/cm2/sr].

    From above, so that the thin air's light is not the difference of large numbers.
    """
    if height_km <= 0.0:
        return earth.above_km_w_cm2_sr[band, term, 0] - earth.limb_w_cm2_sr[band, term, 0] * height_km
    steps = height_km / earth.step_km
    node = int(steps)
    if node >= earth.n_height - 1:
        return 0.0
    part = steps - float(node)
    low, high = earth.limb_w_cm2_sr[band, term, node], earth.limb_w_cm2_sr[band, term, node + 1]
    rest = 0.5 * (1.0 - part) * (wp.lerp(low, high, part) + high)
    return earth.above_km_w_cm2_sr[band, term, node + 1] + earth.step_km * rest


@wp.func
def disc_part(height_km: float, span_km: wp.vec2) -> float:
    """Part of a pixel whose lines of sight meet the ground; its heights span the sum of two even spreads."""
    wide, narrow = wp.max(wp.max(span_km[0], span_km[1]), 0.02), wp.min(span_km[0], span_km[1])
    rest = 0.5 * (wide + narrow) - wp.abs(height_km)
    part = float(0.0)
    if rest >= narrow:
        part = (rest - 0.5 * narrow) / wide
    elif rest > 0.0:
        part = 0.5 * rest * rest / (wide * narrow)
    if height_km < 0.0:
        return 1.0 - part
    return part


@wp.func
def mean_air(earth: EarthShine, band: int, height_km: float, width_km: float, sun_cosine: float) -> float:
    """Mean radiance of the limb over some heights, as at the ground below it [W/cm2/sr]."""
    low, high = height_km - 0.5 * width_km, height_km + 0.5 * width_km
    lit = wp.max(sun_cosine, 0.0)
    if high <= 0.0:
        return earth.limb_w_cm2_sr[band, 0, 0] + lit * earth.limb_w_cm2_sr[band, 1, 0]
    emitted = column_above(earth, band, 0, low) - column_above(earth, band, 0, high)
    reflected = column_above(earth, band, 1, low) - column_above(earth, band, 1, high)
    return (emitted + reflected * lit) / width_km


@wp.func
def earth_radiance(earth: EarthShine, band: int, height_km: float, span_km: wp.vec2, sun_cosine: float) -> float:
    """Mean radiance of the limb and the disc over a pixel [W/cm2/sr]; its heights span the sum of two even spreads.

    The narrower spread of the limb, which is smooth, is two Gauss nodes, or is added to the wider one's variance.
    """
    wide, narrow = wp.max(wp.max(span_km[0], span_km[1]), 0.02), wp.min(span_km[0], span_km[1])
    air = float(0.0)
    if narrow < NARROW_KM:
        air = mean_air(earth, band, height_km, wp.sqrt(wide * wide + narrow * narrow), sun_cosine)
    else:
        off = 0.2886751 * narrow
        upper = mean_air(earth, band, height_km + off, wide, sun_cosine)
        air = 0.5 * (upper + mean_air(earth, band, height_km - off, wide, sun_cosine))
    lit = wp.max(sun_cosine, 0.0)
    disc = earth.disc_w_cm2_sr[band, 0] + lit * earth.disc_w_cm2_sr[band, 1]
    ground = earth.limb_w_cm2_sr[band, 0, 0] + lit * earth.limb_w_cm2_sr[band, 1, 0]
    return air + disc_part(height_km, span_km) * (disc - ground)
