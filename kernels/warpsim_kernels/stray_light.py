"""Stray light: what the optics scatter of the Sun, the Moon and the Earth's disc over all of an image."""

import warp as wp

from warpsim_kernels.earth_shine import EarthShine, SunPath, as_sphere, earth_geometry, sun_index


@wp.struct
class StrayLight:
    """Light from outside the field, scattered over all of the image: radiance per irradiance by angle [1/sr]."""

    angle_rad: wp.array[float]  # (n_edge,) off the boresight, from 0 to pi: ends of pieces
    log_ratio: wp.array[float]  # (n_edge,) natural logarithm, a line along a piece
    moon_m: wp.array[wp.vec3d]  # (n_time,) geocentric, at the times of the Sun's path
    moon_radius_m: wp.float64
    sun_w_cm2: wp.array[float]  # (n_band,) irradiance at 1 au
    moon_w_cm2: wp.array2d[float]  # (n_band, n_phase) irradiance at one radius, if it went on as at a distance
    earth: wp.bool  # whether the Earth's disc is a source
    across: wp.array[wp.vec2]  # (n_node,) Gauss nodes across a piece, from 0 to 1, and weights that add up to 1
    along: wp.array[wp.vec2]  # (n_node,) nodes along an arc about the boresight, from -1 to 1, and such weights


@wp.struct
class EarthCap:
    """The Earth as a sphere that has the ellipsoid's limb on the boresight's side: a cap about the nadir."""

    radius: float  # angular
    offset: float  # of the nadir off the boresight
    sun: wp.vec3  # direction of the Sun: across the boresight towards the nadir, square to that, along the boresight


@wp.func
def ratio_in_piece(stray: StrayLight, piece: int, angle: float) -> float:
    """Radiance per irradiance at an angle within a piece of the table [1/sr]."""
    start, end = stray.angle_rad[piece], stray.angle_rad[piece + 1]
    return wp.exp(wp.lerp(stray.log_ratio[piece], stray.log_ratio[piece + 1], (angle - start) / (end - start)))


@wp.func
def angle_between(a: wp.vec3d, b: wp.vec3d) -> float:
    """Angle between two vectors, from 0 to pi."""
    return float(wp.atan2(wp.length(wp.cross(a, b)), wp.dot(a, b)))


@wp.func
def moon_position(stray: StrayLight, sun: SunPath, time_s: wp.float64) -> wp.vec3d:
    """Geocentric position of the Moon at a time [m]."""
    index = sun_index(sun, time_s)
    node = wp.min(int(index), stray.moon_m.shape[0] - 2)
    part = index - wp.float64(node)
    return stray.moon_m[node] * (wp.float64(1.0) - part) + stray.moon_m[node + 1] * part


@wp.func
def stray_ratio(stray: StrayLight, boresight: wp.vec3d, direction: wp.vec3d) -> float:
    """Radiance of the image per irradiance by a source in a direction [1/sr], log-linear in the angle."""
    angle = angle_between(boresight, direction)
    piece = int(0)
    while piece < stray.angle_rad.shape[0] - 2 and angle > stray.angle_rad[piece + 1]:
        piece += 1
    return ratio_in_piece(stray, piece, angle)


@wp.func
def is_seen(earth: EarthShine, position_m: wp.vec3d, direction: wp.vec3d) -> bool:
    """Whether the Earth hides nothing in a direction."""
    return earth_geometry(earth, position_m, direction, direction)[0] >= wp.float64(0.0)


@wp.func
def earth_cap(earth: EarthShine, position_m: wp.vec3d, boresight: wp.vec3d, sun: wp.vec3d) -> EarthCap:
    """The Earth's disc about the boresight; its radius is that of the ellipsoid in the plane of boresight and nadir."""
    nadir = -wp.normalize(position_m)
    side = wp.cross(wp.cross(nadir, boresight), nadir)
    if wp.length(side) < wp.float64(1.0e-6):
        side = wp.vec3d(nadir[1], -nadir[0], wp.float64(0.0))
        if wp.abs(nadir[2]) > wp.float64(0.9):
            side = wp.vec3d(nadir[2], wp.float64(0.0), -nadir[0])
    side = wp.normalize(side)
    # Lines towards nadir + t side touch the ellipsoid where a t^2 + 2 b t + c = 0.
    start, down, out = (
        as_sphere(earth, position_m * wp.float64(1.0e-3)),
        as_sphere(earth, nadir),
        as_sphere(earth, side),
    )
    outside = wp.length_sq(start) - earth.radius_km * earth.radius_km
    a = wp.dot(start, out) * wp.dot(start, out) - outside * wp.length_sq(out)
    b = wp.dot(start, down) * wp.dot(start, out) - outside * wp.dot(down, out)
    c = wp.dot(start, down) * wp.dot(start, down) - outside * wp.length_sq(down)
    cosine, sine = wp.dot(boresight, nadir), wp.dot(boresight, side)
    towards = nadir * sine - side * cosine
    cap = EarthCap()
    cap.radius = float(wp.atan2(c, wp.sqrt(wp.max(b * b - a * c, wp.float64(0.0))) - b))
    cap.offset = float(wp.atan2(sine, cosine))
    across = wp.dot(wp.cross(boresight, towards), sun)
    cap.sun = wp.vec3(float(wp.dot(towards, sun)), float(across), float(wp.dot(boresight, sun)))
    return cap


@wp.func
def half_arc(cap: EarthCap, angle: float) -> float:
    """Half of the arc of a circle about the boresight that lies on the Earth's disc, from 0 to pi."""
    on = wp.sin(0.5 * (cap.offset + cap.radius - angle)) * wp.sin(0.5 * (angle + cap.radius - cap.offset))
    off = wp.sin(0.5 * (angle + cap.offset + cap.radius)) * wp.sin(0.5 * (angle + cap.offset - cap.radius))
    return 2.0 * wp.atan2(wp.sqrt(wp.max(on, 0.0)), wp.sqrt(wp.max(off, 0.0)))


@wp.func
def mean_sun_cosine(stray: StrayLight, cap: EarthCap, angle: float, arc: float) -> float:
    """Mean cosine of the Sun's zenith angle, 0 by night, along an arc about the boresight."""
    sine, cosine, far = wp.sin(angle), wp.cos(angle), 1.0 / wp.sin(cap.radius)
    down, out = cosine * wp.cos(cap.offset), sine * wp.sin(cap.offset)
    below = far * (wp.sin(cap.offset) * cap.sun[0] + wp.cos(cap.offset) * cap.sun[2])
    total = float(0.0)
    for i in range(stray.along.shape[0]):
        turn = arc * stray.along[i][0]
        nadir = down + out * wp.cos(turn)
        slant = far * nadir - wp.sqrt(wp.max(1.0 - far * far * (1.0 - nadir * nadir), 0.0))
        sunward = sine * (wp.cos(turn) * cap.sun[0] + wp.sin(turn) * cap.sun[1]) + cosine * cap.sun[2]
        total += stray.along[i][1] * wp.max(slant * sunward - below, 0.0)
    return total


@wp.func
def stray_in_piece(stray: StrayLight, cap: EarthCap, piece: int, low: float, high: float) -> wp.vec2:
    """Integral over the disc, of angles in a piece and between bounds, of the ratio and of the ratio times cosine.

    Angles go as the cosine of u between the bounds: the arc, which grows as a root from bounds, is smooth in u.
    """
    total = wp.vec2(0.0, 0.0)
    start, end = wp.max(low, stray.angle_rad[piece]), wp.min(high, stray.angle_rad[piece + 1])
    if end <= start:
        return total
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    first = wp.acos(wp.clamp((middle - start) / half, -1.0, 1.0))
    last = wp.acos(wp.clamp((middle - end) / half, -1.0, 1.0))
    for i in range(stray.across.shape[0]):
        u = wp.lerp(first, last, stray.across[i][0])
        angle = middle - half * wp.cos(u)
        arc = half_arc(cap, angle)
        area = 2.0 * arc * wp.sin(angle) * half * wp.sin(u) * (last - first) * stray.across[i][1]
        weight = area * ratio_in_piece(stray, piece, angle)
        total += weight * wp.vec2(1.0, mean_sun_cosine(stray, cap, angle, arc))
    return total


@wp.func
def stray_of_earth(stray: StrayLight, cap: EarthCap) -> wp.vec2:
    """Integral over the Earth's disc of the ratio, and of the ratio times the cosine of the Sun's zenith angle."""
    pi = float(wp.PI)
    near, far = wp.abs(cap.radius - cap.offset), cap.radius + cap.offset
    far = wp.min(far, 2.0 * pi - far)
    total = wp.vec2(0.0, 0.0)
    for piece in range(stray.angle_rad.shape[0] - 1):
        total += stray_in_piece(stray, cap, piece, near, far)  # arcs
        if cap.offset < cap.radius:
            total += stray_in_piece(stray, cap, piece, 0.0, near)  # circles about the boresight
        if cap.offset + cap.radius > pi:
            total += stray_in_piece(stray, cap, piece, far, pi)  # about what is opposite to it
    return total
