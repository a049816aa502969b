"""What lies behind sources: smooth light on a coarse grid of nodes per view, and bilinear between them.

Nodes hold what is smooth over the field: the light of the sky per pixel, how high above the ground a line of sight
passes, and how high the Sun stands there. The limb is sharp, so its radiance is looked up per pixel by that height.
"""

import functools

import warp as wp

from warpsim_kernels.canvas import STRIP_SHIFT, flags_of_image
from warpsim_kernels.records import View
from warpsim_kernels.shared_memory import thread_of_block

RUN = 32
"""Pixels of a row that are added to at once."""

HIGHEST_KM = wp.constant(400.0)
"""Lines of sight that pass higher, or away from the Earth, have this height."""

ASTRONOMICAL_UNIT_M = wp.constant(wp.float64(149597870700.0))

NARROW_KM = wp.constant(0.5)
"""Heights within which the limb is nearly straight."""

SPEED_OF_LIGHT_M_S = wp.constant(wp.float64(299792458.0))


@wp.struct
class SkyPlates:
    """Radiance of the sky on square plates that touch the sphere: gnomonic grids. The first plate of a layer serves."""

    axes: wp.array[wp.mat33d]  # (n_plate,) rows x, y, centre; ICRS
    half_width: wp.array[wp.float64]  # (n_plate,) tangent of the angle from the centre to an edge
    n_side: wp.array[wp.int32]  # (n_plate,) nodes along an edge
    first: wp.array[wp.int32]  # (n_plate,) the first of its values
    layer: wp.array[wp.int32]  # (n_plate,) 0 for the zodiacal light, which goes with the Sun
    radiance_w_cm2_sr: wp.array2d[float]  # (n_band, n_value) row after row of each plate


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


@wp.struct
class Background:
    """What the stage reads of the scene."""

    direction: wp.array[wp.vec3d]  # (n_node,) camera axes
    pixel_sr: wp.array[float]  # (n_node,) solid angle of a pixel
    n_across: int
    n_down: int
    step_px: int
    plates: SkyPlates
    sun: SunPath
    earth: EarthShine
    stray: StrayLight


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
def plate_radiance(plates: SkyPlates, plate: int, band: int, seen: wp.vec3d) -> float:
    """Radiance at a position on a plate, bilinear; `seen` is in its axes [W/cm2/sr]."""
    n = plates.n_side[plate]
    scale = wp.float64(n - 1) / (wp.float64(2.0) * plates.half_width[plate])
    x = (seen[0] / seen[2] + plates.half_width[plate]) * scale
    y = (seen[1] / seen[2] + plates.half_width[plate]) * scale
    col, row = wp.clamp(int(x), 0, n - 2), wp.clamp(int(y), 0, n - 2)
    u, v = float(x - wp.float64(col)), float(y - wp.float64(row))
    at = plates.first[plate] + row * n + col
    light = plates.radiance_w_cm2_sr[band]
    return wp.lerp(wp.lerp(light[at], light[at + 1], u), wp.lerp(light[at + n], light[at + n + 1], u), v)


@wp.func
def sky_radiance(plates: SkyPlates, band: int, direction: wp.vec3d, sunward: wp.vec3d) -> float:
    """Radiance of the sky in a direction [W/cm2/sr]; `sunward` is that direction relative to the Sun."""
    total = float(0.0)
    done = int(-1)
    for plate in range(plates.layer.shape[0]):
        if plates.layer[plate] != done:
            looked = direction
            if plates.layer[plate] == 0:
                looked = sunward
            seen = plates.axes[plate] * looked
            edge = seen[2] * plates.half_width[plate]
            if edge > wp.float64(0.0) and wp.abs(seen[0]) <= edge and wp.abs(seen[1]) <= edge:
                total += plate_radiance(plates, plate, band, seen)
                done = plates.layer[plate]
    return total


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


@wp.kernel(module="unique", enable_backward=False)
def stray_light_kernel(
    # in
    time_s: wp.array[wp.float64],  # (n_view,)
    views: wp.array[View],  # (n_view,)
    background: Background,
    # out
    stray_w_cm2_sr: wp.array2d[float],  # (n_view, n_band)
):
    """Add what the optics scatter of the Sun, the Moon and the Earth's disc."""
    view = wp.tid()
    seen = views[view]
    stray, earth = background.stray, background.earth
    position, boresight = seen.position_m, wp.vec3d(seen.axes[2, 0], seen.axes[2, 1], seen.axes[2, 2])
    sun = sun_direction(background.sun, time_s[view])
    from_moon = position - moon_position(stray, background.sun, time_s[view])
    ratio_sun, ratio_moon = float(0.0), float(0.0)
    if is_seen(earth, position, sun):
        ratio_sun = stray_ratio(stray, boresight, sun)
    if is_seen(earth, position, -wp.normalize(from_moon)):
        radii = wp.length(from_moon) / stray.moon_radius_m
        ratio_moon = stray_ratio(stray, boresight, -wp.normalize(from_moon)) / float(radii * radii)
    phase = angle_between(sun * ASTRONOMICAL_UNIT_M + from_moon - position, from_moon)
    index = phase / wp.PI * float(stray.moon_w_cm2.shape[1] - 1)
    node = wp.min(int(index), stray.moon_w_cm2.shape[1] - 2)
    of_earth, strength = wp.vec2(0.0, 0.0), sun_strength(background.sun, time_s[view])
    if stray.earth:
        of_earth = stray_of_earth(stray, earth_cap(earth, position, boresight, sun))
    for band in range(stray_w_cm2_sr.shape[1]):
        disc = earth.disc_w_cm2_sr[band]
        of_moon = wp.lerp(stray.moon_w_cm2[band, node], stray.moon_w_cm2[band, node + 1], index - float(node))
        bodies = ratio_sun * strength * stray.sun_w_cm2[band] + ratio_moon * of_moon
        stray_w_cm2_sr[view, band] = bodies + of_earth[0] * disc[0] + of_earth[1] * strength * disc[1]


@functools.cache
def make_background_nodes_kernel(earth: bool, stray: bool) -> wp.Kernel:
    """Kernel over views and nodes: the light of the sky per pixel, and where lines of sight pass the Earth."""

    @wp.kernel(module="unique", enable_backward=False)
    def background_nodes_kernel(
        # in
        time_s: wp.array[wp.float64],  # (n_view,)
        views: wp.array[View],  # (n_view,)
        background: Background,
        stray_w_cm2_sr: wp.array2d[float],  # (n_view, n_band); where on
        # out
        sky_w_cm2: wp.array3d[float],  # (n_view, n_band, n_node) in a pixel
        earth_km: wp.array3d[float],  # (n_view, 2, n_node) height, and sunlight on the ground over 1 au's; where on
    ):
        view, node = wp.tid()
        seen = views[view]
        apparent = wp.transpose(seen.axes) * background.direction[node]
        direction = wp.normalize(apparent - seen.velocity_m_s / SPEED_OF_LIGHT_M_S)
        sun = sun_direction(background.sun, time_s[view])
        sunward = turned_back(background.sun, sun, direction)
        if wp.static(earth):
            geometry = earth_geometry(background.earth, seen.position_m, apparent, sun)
            earth_km[view, 0, node] = float(geometry[0])
            earth_km[view, 1, node] = float(geometry[1]) * sun_strength(background.sun, time_s[view])
        for band in range(sky_w_cm2.shape[1]):
            radiance = sky_radiance(background.plates, band, direction, sunward)
            if wp.static(stray):
                radiance += stray_w_cm2_sr[view, band]
            sky_w_cm2[view, band, node] = radiance * background.pixel_sr[node]

    return background_nodes_kernel


@wp.struct
class Cell:
    """Values at the corners of a cell of nodes, as they are along a row of pixels."""

    start: float
    slope: float  # per pixel


@wp.func
def along_row(values: wp.array[float], background: Background, node: int, v: float) -> Cell:
    """Values between the four nodes of a cell, from its left edge on, `v` of the way down."""
    left = wp.lerp(values[node], values[node + background.n_across], v)
    right = wp.lerp(values[node + 1], values[node + 1 + background.n_across], v)
    cell = Cell()
    cell.start = left
    cell.slope = (right - left) / float(background.step_px)
    return cell


@wp.func
def earth_cell_is_dark(heights: wp.array[float], background: Background, node: int) -> bool:
    """Whether all lines of sight of a cell pass above what glows."""
    n = background.n_across
    least = wp.min(wp.min(heights[node], heights[node + 1]), wp.min(heights[node + n], heights[node + n + 1]))
    return least > background.earth.step_km * float(background.earth.n_height)


@wp.func
def earth_cell_is_disc(heights: wp.array[float], background: Background, node: int) -> bool:
    """Whether all pixels of a cell lie on the disc, their heights below the ground by more than they span."""
    n = background.n_across
    most = wp.max(wp.max(heights[node], heights[node + 1]), wp.max(heights[node + n], heights[node + n + 1]))
    least = wp.min(wp.min(heights[node], heights[node + 1]), wp.min(heights[node + n], heights[node + n + 1]))
    return most + 2.0 * (most - least) / float(background.step_px) < -0.02


@wp.func
def add_disc(
    background: Background,
    band: int,
    cosine: Cell,
    sky: Cell,
    node: int,
    v: float,
    first: int,
    n_pixel: int,
    thread: int,
    n_thread: int,
    signal_w_cm2: wp.array[float],
):
    """Replace the sky by the disc in pixels of a row of a cell that all lie on it; of them, those of a thread."""
    area = along_row(background.pixel_sr, background, node, v)
    emitted, reflected = background.earth.disc_w_cm2_sr[band, 0], background.earth.disc_w_cm2_sr[band, 1]
    for pixel in range(thread, n_pixel, n_thread):
        i = float(pixel)
        radiance = emitted + reflected * wp.max(cosine.start + cosine.slope * i, 0.0)
        light = radiance * (area.start + area.slope * i) - (sky.start + sky.slope * i)
        signal_w_cm2[first + pixel] = signal_w_cm2[first + pixel] + light


@wp.func
def earth_at(background: Background, earth_km: wp.array2d[float], band: int, node: int, u: float, v: float) -> wp.vec2:
    """Radiance of the Earth at a position in a cell, u of the way across, v down [W/cm2/sr], and how much it covers."""
    heights, cosines = earth_km[0], earth_km[1]
    n, step = background.n_across, float(background.step_px)
    left, right = wp.lerp(heights[node], heights[node + n], v), wp.lerp(heights[node + 1], heights[node + n + 1], v)
    down = wp.lerp(heights[node + n] - heights[node], heights[node + n + 1] - heights[node + 1], u)
    span_km = wp.vec2(wp.abs(right - left), wp.abs(down)) / step
    upper, lower = wp.lerp(cosines[node], cosines[node + 1], u), wp.lerp(cosines[node + n], cosines[node + n + 1], u)
    height_km = wp.lerp(left, right, u)
    radiance = earth_radiance(background.earth, band, height_km, span_km, wp.lerp(upper, lower, v))
    return wp.vec2(radiance, disc_part(height_km, span_km))


@functools.cache
def make_add_background_kernel(earth: bool, n_thread: int) -> wp.Kernel:
    """Kernel over rows of images: add the background to each pixel, and flag all strips.

    The n_thread threads of a block draw a row together, each its own pixels. Where there is one, on the CPU, runs of
    pixels are tiles, which the compiler turns into vector instructions.
    """

    @wp.func
    def ramp(light: float, i: float, start: float, slope: float):
        return light + (start + slope * i)

    @wp.kernel(module="unique", enable_backward=False)
    def add_background_kernel(
        # in
        background: Background,
        sky_w_cm2: wp.array3d[float],  # (n_view, n_band, n_node)
        earth_km: wp.array3d[float],  # (n_view, 2, n_node)
        n_col: int,
        n_row: int,
        # in and out
        signal_w_cm2: wp.array[float],  # flat images
        touched: wp.array[wp.uint8],  # (n_image * n_flag,)
    ):
        if wp.static(False):
            _a = ramp
        item, thread = wp.tid(), thread_of_block()
        image = item // n_row
        row = item - image * n_row
        n_band = sky_w_cm2.shape[1]
        view = image // n_band
        band = image - view * n_band
        begin = row * n_col
        strip = image * flags_of_image(n_row * n_col)
        for s in range(begin >> STRIP_SHIFT, ((begin + n_col - 1) >> STRIP_SHIFT) + 1):
            touched[strip + s] = wp.uint8(1)
        begin += image * n_row * n_col
        down = row // background.step_px
        v = float(row - down * background.step_px) / float(background.step_px)
        for across in range(background.n_across - 1):
            node = down * background.n_across + across
            first = across * background.step_px
            end = wp.min(first + background.step_px, n_col)
            sky = along_row(sky_w_cm2[view, band], background, node, v)
            n_whole = int(0)
            if wp.static(n_thread == 1):
                n_whole = (end - first) // RUN
            for run in range(n_whole):
                at = begin + first + run * RUN
                light = wp.tile_load(signal_w_cm2, shape=RUN, offset=at, bounds_check=False)
                i = wp.tile_arange(RUN, dtype=float)
                start = sky.start + sky.slope * float(run * RUN)
                brighter = wp.tile_map(ramp, light, i, start, sky.slope)
                wp.tile_store(signal_w_cm2, brighter, offset=at, bounds_check=False)
            for col in range(first + n_whole * RUN + thread, end, wp.static(n_thread)):
                signal_w_cm2[begin + col] = signal_w_cm2[begin + col] + sky.start + sky.slope * float(col - first)
            if wp.static(earth):
                heights = earth_km[view, 0]
                if earth_cell_is_disc(heights, background, node):
                    cosine = along_row(earth_km[view, 1], background, node, v)
                    n_pixel, step = end - first, wp.static(n_thread)
                    add_disc(background, band, cosine, sky, node, v, begin + first, n_pixel, thread, step, signal_w_cm2)
                elif not earth_cell_is_dark(heights, background, node):
                    area = along_row(background.pixel_sr, background, node, v)
                    for col in range(first + thread, end, wp.static(n_thread)):
                        u = float(col - first) / float(background.step_px)
                        seen = earth_at(background, earth_km[view], band, node, u, v)
                        hidden = seen[1] * (sky.start + sky.slope * float(col - first))
                        pixel = begin + col
                        pixel_sr = area.start + area.slope * float(col - first)
                        signal_w_cm2[pixel] = signal_w_cm2[pixel] + seen[0] * pixel_sr - hidden

    return add_background_kernel


@wp.kernel(module="unique", enable_backward=False)
def add_image_kernel(
    # in
    image_w_cm2: wp.array[float],  # (n_band * n_pixel,)
    n_pixel: int,
    n_band: int,
    # in and out
    signal_w_cm2: wp.array[float],  # flat images, those of a view behind one another
):
    """Add the user's light of every pixel; strips are flagged already."""
    item = wp.tid()
    per_view = n_pixel * n_band
    signal_w_cm2[item] = signal_w_cm2[item] + image_w_cm2[item % per_view]


@wp.kernel(module="unique", enable_backward=False)
def image_of_targets_kernel(
    # in
    xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) targets first
    image_w_cm2: wp.array3d[float],  # (n_band, n_row, n_col)
    # in and out
    background_w_cm2: wp.array3d[float],  # (n_view, n_band, n_target)
):
    """Add the user's light of a target's pixel, for the truth; none outside the image."""
    view, target = wp.tid()
    col = int(wp.floor(xy_px[view, target][0] + wp.float64(0.5)))
    row = int(wp.floor(xy_px[view, target][1] + wp.float64(0.5)))
    if col >= 0 and row >= 0 and row < image_w_cm2.shape[1] and col < image_w_cm2.shape[2]:
        for band in range(image_w_cm2.shape[0]):
            background_w_cm2[view, band, target] = background_w_cm2[view, band, target] + image_w_cm2[band, row, col]


@functools.cache
def make_background_of_targets_kernel(earth: bool) -> wp.Kernel:
    """Kernel over views and targets: the background in the pixel that holds a target, for the truth."""

    @wp.kernel(module="unique", enable_backward=False)
    def background_of_targets_kernel(
        # in
        xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) targets first
        background: Background,
        sky_w_cm2: wp.array3d[float],  # (n_view, n_band, n_node)
        earth_km: wp.array3d[float],  # (n_view, 2, n_node)
        # out
        background_w_cm2: wp.array3d[float],  # (n_view, n_band, n_target) NaN outside the grid
    ):
        view, target = wp.tid()
        step = wp.float64(background.step_px)
        pixel = xy_px[view, target] + wp.vec2d(wp.float64(0.5), wp.float64(0.5))
        x, y = wp.floor(pixel[0]) / step, wp.floor(pixel[1]) / step
        n_band = sky_w_cm2.shape[1]
        if (
            x < wp.float64(-1.0)
            or y < wp.float64(-1.0)
            or x > wp.float64(background.n_across)
            or y > wp.float64(background.n_down)
        ):
            for band in range(n_band):
                background_w_cm2[view, band, target] = wp.nan
            return
        across = wp.clamp(int(wp.floor(x)), 0, background.n_across - 2)
        down = wp.clamp(int(wp.floor(y)), 0, background.n_down - 2)
        u, v = float(x - wp.float64(across)), float(y - wp.float64(down))
        node = down * background.n_across + across
        for band in range(n_band):
            sky = along_row(sky_w_cm2[view, band], background, node, v)
            level = sky.start + sky.slope * u * float(background.step_px)
            if wp.static(earth):
                seen = earth_at(background, earth_km[view], band, node, u, v)
                area = along_row(background.pixel_sr, background, node, v)
                pixel_sr = area.start + area.slope * u * float(background.step_px)
                level = level * (1.0 - seen[1]) + seen[0] * pixel_sr
            background_w_cm2[view, band, target] = level

    return background_of_targets_kernel
