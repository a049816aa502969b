"""Laws of pointing: what a boresight follows, and the camera axes that come of it, float64."""

import functools
import math

import warp as wp

from warpsim_kernels.apparent import Observer, Tracks, path_from_target
from warpsim_kernels.camera import camera_axes, up_is_lost
from warpsim_kernels.timed_tables import AttitudeTables, row_before, table_quaternion, turned_axes

UP_ZENITH = wp.constant(0)
UP_NORTH = wp.constant(1)
UP_ORBIT_NORMAL = wp.constant(2)

LAW_TRACK = wp.constant(0)
LAW_FIXED = wp.constant(1)
LAW_SCAN = wp.constant(2)
LAW_ATTITUDE = wp.constant(3)
"""Kinds of pointing laws: targets, one direction, the rows of a table, or the axes of the body."""

UP_REPLACED = wp.constant(1)
BORESIGHT_REPLACED = wp.constant(2)
SLEWING = wp.constant(4)
"""Bits of a view's flag word."""

_NEAREST_M = wp.constant(wp.float64(1.0e-3))
"""Tracks are good to 1 mm: a body nearer than that has no direction."""


@wp.struct
class PointingLaw:
    """Pointing law: direction of the boresight, and roll about it."""

    kind: int
    up_rule: int
    first_tracked: int  # LAW_TRACK: row in the tracks of the first of the targets whose mean direction is followed
    n_tracked: int
    direction: wp.vec3d  # LAW_FIXED: unit
    local: int  # not 0: directions are (forward, right, zenith) of the satellite, not ICRS
    roll_rad: wp.float64  # LAW_FIXED
    turn: wp.mat33d  # what roll and offset make of camera axes that look straight at it


@wp.struct
class ScanRows:
    """Rows of tables of directions, by sensor and time."""

    time_s: wp.array[wp.float64]  # (n_row,)
    direction: wp.array[wp.vec3d]  # (n_row,) unit
    roll_rad: wp.array[wp.float64]  # (n_row,) without jumps by a whole turn
    first: wp.array[wp.int32]  # (n_sensor,) first row of each sensor
    count: wp.array[wp.int32]  # (n_sensor,) its rows, at least 2; 1 or more where they are of attitudes
    attitudes: AttitudeTables  # of the bodies of sensors with LAW_ATTITUDE, whose first and count are of these


@wp.struct
class LocalFrame:
    """Directions of a satellite: unit vectors, 0 where they are not defined."""

    forward: wp.vec3d  # of its motion, across the zenith
    right: wp.vec3d  # against the orbit's normal
    zenith: wp.vec3d
    normal: wp.vec3d  # of the orbit: position x velocity


@wp.struct
class Sight:
    """A direction (0 where there is none) and the roll that belongs to it."""

    direction: wp.vec3d
    roll_rad: wp.float64


@wp.struct
class CommandedAxes:
    """Camera axes (rows x, y, z, ICRS axes), and what had to be replaced in them."""

    axes: wp.mat33d
    flags: int


@wp.func
def local_frame(position_m: wp.vec3d, velocity_m_s: wp.vec3d) -> LocalFrame:
    """Local frame of a satellite from its geocentric state."""
    frame = LocalFrame()
    frame.zenith = wp.normalize(position_m)
    frame.normal = wp.normalize(wp.cross(position_m, velocity_m_s))
    frame.forward = wp.cross(frame.normal, frame.zenith)
    frame.right = -frame.normal
    return frame


@wp.func
def tracked_direction(tracks: Tracks, law: PointingLaw, observer: Observer, since_middle_s: wp.float64) -> wp.vec3d:
    """Mean apparent direction of the tracked targets that exist; 0 where there is none.

    Those that exist in the middle of the exposure count in all of it: one that ends meanwhile does not turn the camera.
    """
    towards = wp.vec3d()
    for body in range(law.first_tracked, law.first_tracked + law.n_tracked):
        path = path_from_target(tracks, body, observer)
        middle_s = path.emission_time_s - since_middle_s
        exists_s = tracks.presence.exists_s[body]
        if path.range_m > _NEAREST_M and middle_s >= exists_s[0] and middle_s <= exists_s[1]:
            towards += path.apparent
    if wp.length(towards) < wp.float64(1.0e-9):
        return wp.vec3d()
    return wp.normalize(towards)


@wp.func
def great_circle(start: wp.vec3d, end: wp.vec3d, part: wp.float64) -> wp.vec3d:
    """Unit vector a part of the way from start to end (not opposite), at a constant rate."""
    angle = wp.atan2(wp.length(wp.cross(start, end)), wp.dot(start, end))
    rest = wp.float64(1.0) - part
    if angle < wp.float64(1.0e-8):  # the chord is as good
        return wp.normalize(start * rest + end * part)
    return wp.normalize(start * wp.sin(rest * angle) + end * wp.sin(part * angle))


@wp.func
def scan_sight(rows: ScanRows, sensor: int, time_s: wp.float64) -> Sight:
    """Direction by the table for a sensor and a time; beyond its ends, that of the row at the end."""
    first = rows.first[sensor]
    row = row_before(rows.time_s, first, rows.count[sensor], time_s)
    part = (time_s - rows.time_s[row]) / (rows.time_s[row + 1] - rows.time_s[row])
    part = wp.clamp(part, wp.float64(0.0), wp.float64(1.0))
    sight = Sight()
    sight.direction = great_circle(rows.direction[row], rows.direction[row + 1], part)
    sight.roll_rad = rows.roll_rad[row] + (rows.roll_rad[row + 1] - rows.roll_rad[row]) * part
    return sight


@wp.func
def from_local(frame: LocalFrame, direction: wp.vec3d) -> wp.vec3d:
    """ICRS components of (forward, right, zenith) ones."""
    return wp.normalize(frame.forward * direction[0] + frame.right * direction[1] + frame.zenith * direction[2])


@wp.func
def rolled_axes(axes: wp.mat33d, roll_rad: wp.float64) -> wp.mat33d:
    """Camera axes (rows) turned right-handed about the boresight: up moves to the right of the image."""
    cosine = wp.cos(roll_rad)
    sine = wp.sin(roll_rad)
    zero = wp.float64(0.0)
    return wp.mat33d(cosine, sine, zero, -sine, cosine, zero, zero, zero, wp.float64(1.0)) * axes


@functools.cache
def law_axes_of(track: bool, fixed: bool, scan: bool, attitude: bool = False) -> wp.Function:
    """The function that gives the axes of a law; it holds the kinds of laws that there are."""
    alone = track + fixed + scan + attitude == 1

    @wp.func
    def law_axes(
        law: PointingLaw,
        rows: ScanRows,
        sensor: int,
        time_s: wp.float64,
        frame: LocalFrame,
        tracks: Tracks,
        observer: Observer,
        since_middle_s: wp.float64,
    ) -> CommandedAxes:
        boresight = law.direction
        roll_rad = law.roll_rad
        if wp.static(track):
            if wp.static(alone) or law.kind == LAW_TRACK:
                boresight = tracked_direction(tracks, law, observer, since_middle_s)
        if wp.static(scan):
            if wp.static(alone) or law.kind == LAW_SCAN:
                sight = scan_sight(rows, sensor, time_s)
                boresight = sight.direction
                roll_rad = sight.roll_rad
        if wp.static(fixed or scan):
            if law.local != 0:
                boresight = from_local(frame, boresight)
        commanded = CommandedAxes()
        commanded.flags = int(0)
        if wp.length(boresight) < wp.float64(0.5):
            commanded.flags = int(BORESIGHT_REPLACED)
            boresight = frame.forward
            if wp.length(boresight) < wp.float64(0.5):
                boresight = frame.zenith
        up = frame.zenith
        fallback = frame.normal
        if law.up_rule == UP_NORTH:
            up = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
            fallback = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
        if law.up_rule == UP_ORBIT_NORMAL:
            up = frame.normal
            fallback = frame.zenith
        if up_is_lost(boresight, up):
            commanded.flags = commanded.flags | UP_REPLACED
        axes = camera_axes(boresight, up, fallback)
        if wp.static(fixed or scan):
            axes = rolled_axes(axes, roll_rad)
        if wp.static(attitude):
            if wp.static(alone) or law.kind == LAW_ATTITUDE:
                commanded.flags = int(0)
                axes = turned_axes(table_quaternion(rows.attitudes, rows.first[sensor], rows.count[sensor], time_s))
        commanded.axes = law.turn * axes
        return commanded

    return law_axes


@wp.func
def slew_part(since_s: wp.float64, duration_s: wp.float64, ramp: wp.float64) -> wp.float64:
    """Part of a turn's rotation that is done: constant acceleration, constant rate, constant deceleration."""
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    u = wp.clamp(since_s / duration_s, wp.float64(0.0), one)
    rest = wp.min(u, one - u)
    begun = rest - half * ramp
    if rest < ramp:
        begun = half * rest * rest / ramp
    begun = begun / (one - ramp)
    if u <= half:
        return begun
    return one - begun


@wp.func
def rotation_vector(rotation: wp.mat33d) -> wp.vec3d:
    """Axis times angle [rad] of a rotation matrix; angles of 0 to pi."""
    half = wp.float64(0.5)
    skew = (
        wp.vec3d(rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1])
        * half
    )
    sine = wp.length(skew)
    cosine = half * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - wp.float64(1.0))
    axis = skew
    if cosine <= wp.float64(0.0):
        # Near half a turn the skew part vanishes: the axis is a column of the symmetric part.
        axis = wp.vec3d(
            rotation[0, 0] - cosine, half * (rotation[1, 0] + rotation[0, 1]), half * (rotation[2, 0] + rotation[0, 2])
        )
        if rotation[1, 1] > rotation[0, 0] and rotation[1, 1] >= rotation[2, 2]:
            axis = wp.vec3d(
                half * (rotation[1, 0] + rotation[0, 1]),
                rotation[1, 1] - cosine,
                half * (rotation[2, 1] + rotation[1, 2]),
            )
        elif rotation[2, 2] > rotation[0, 0]:
            axis = wp.vec3d(
                half * (rotation[2, 0] + rotation[0, 2]),
                half * (rotation[2, 1] + rotation[1, 2]),
                rotation[2, 2] - cosine,
            )
        if wp.dot(axis, skew) < wp.float64(0.0):
            axis = -axis
    if wp.length(axis) <= wp.float64(1.0e-12):
        return wp.vec3d()
    return wp.normalize(axis) * wp.atan2(sine, cosine)


@wp.func
def axes_between(before: wp.mat33d, after: wp.mat33d, part: wp.float64, near: wp.vec3d) -> wp.mat33d:
    """Camera axes (rows) a part of the rotation from some to others, the one of the two ways round nearer to `near`."""
    vector = rotation_vector(after * wp.transpose(before))
    length = wp.length(vector)
    if length > wp.float64(0.0):
        other = vector * (wp.float64(1.0) - wp.float64(wp.static(2.0 * math.pi)) / length)
        if wp.length_sq(other - near) < wp.length_sq(vector - near):
            vector = other
    vector = vector * part
    angle = wp.length(vector)
    if angle == wp.float64(0.0):
        return before
    n = vector / angle
    zero = wp.float64(0.0)
    cross = wp.mat33d(zero, -n[2], n[1], n[2], zero, -n[0], -n[1], n[0], zero)
    half_sine = wp.sin(wp.float64(0.5) * angle)
    turn = (
        wp.identity(n=3, dtype=wp.float64)
        + cross * wp.sin(angle)
        + (cross * cross) * (wp.float64(2.0) * half_sine * half_sine)
    )
    return turn * before
