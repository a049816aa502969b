"""Stage aim: camera axes, position and velocity of every view."""

import functools

import warp as wp

from warpsim_kernels.apparent import Observer, Releases, observer_of, path_from_target
from warpsim_kernels.camera import camera_axes, up_is_lost
from warpsim_kernels.jitter import Jitter, jitter_rad, turned_axes
from warpsim_kernels.motion import NodeGrid, hermite_position_m, hermite_velocity_m_s, linear_vector

UP_ZENITH = wp.constant(0)
UP_NORTH = wp.constant(1)
UP_ORBIT_NORMAL = wp.constant(2)

AIM_TRACK = 0
AIM_FIXED = 1
AIM_TABLE = 2
"""What the boresight follows: bodies, one direction, or the rows of a table."""

UP_REPLACED = wp.constant(1)
BORESIGHT_REPLACED = wp.constant(2)
"""Bits of a view's flag word."""

_NEAREST_M = wp.constant(wp.float64(1.0e-3))
"""Tracks are good to 1 mm: a body nearer than that has no direction."""


@wp.struct
class Aim:
    """Where the cameras of a scene look; the same for all its views."""

    up_rule: int
    first_tracked: int  # AIM_TRACK: the boresight follows the mean direction of these bodies
    n_tracked: int
    direction: wp.vec3d  # AIM_FIXED: unit
    local: int  # not 0: fixed and table's directions are (forward, right, zenith) of the satellite, not ICRS
    turn: wp.mat33d  # what roll and offset make of camera axes that look straight at it


@wp.struct
class AimTable:
    """Rows of a table of directions, by sensor and time."""

    time_s: wp.array[wp.float64]  # (n_row,)
    direction: wp.array[wp.vec3d]  # (n_row,) unit
    roll_rad: wp.array[wp.float64]  # (n_row,) without jumps by a whole turn
    first: wp.array[wp.int32]  # (n_sensor,) first row of each sensor
    count: wp.array[wp.int32]  # (n_sensor,) its rows; at least 2 where scan
    scan: int  # not 0: from row to row along great circles; 0: each row holds until the next


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
def tracked_direction(
    position_m: wp.array2d[wp.vec3d],
    velocity_m_s: wp.array2d[wp.vec3d],
    releases: Releases,
    aim: Aim,
    grid: NodeGrid,
    observer: Observer,
) -> wp.vec3d:
    """Mean apparent direction of the tracked bodies; 0 where they are at the observer, or all around."""
    towards = wp.vec3d()
    for body in range(aim.first_tracked, aim.first_tracked + aim.n_tracked):
        path = path_from_target(position_m, velocity_m_s, releases, body, grid, observer)
        if path.range_m > _NEAREST_M:
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
def table_sight(table: AimTable, sensor: int, time_s: wp.float64) -> Sight:
    """What the table says for a sensor and a time; beyond its ends, the row at the end."""
    first = table.first[sensor]
    row = first
    beyond = first + table.count[sensor]  # the row wanted is the last before `beyond` whose time has come
    while row + 1 < beyond:
        middle = (row + beyond) // 2
        if table.time_s[middle] <= time_s:
            row = middle
        else:
            beyond = middle
    sight = Sight()
    if table.scan == 0:
        sight.direction = table.direction[row]
        sight.roll_rad = table.roll_rad[row]
        return sight
    row = wp.min(row, first + table.count[sensor] - 2)
    part = (time_s - table.time_s[row]) / (table.time_s[row + 1] - table.time_s[row])
    part = wp.clamp(part, wp.float64(0.0), wp.float64(1.0))
    sight.direction = great_circle(table.direction[row], table.direction[row + 1], part)
    sight.roll_rad = table.roll_rad[row] + (table.roll_rad[row + 1] - table.roll_rad[row]) * part
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
def make_aim_kernel(kind: int, with_jitter: bool) -> wp.Kernel:
    """Kernel of the stage for one kind of pointing; what is off is not in its code."""

    @wp.kernel(module="unique", enable_backward=False)
    def aim_kernel(
        # in
        view_time_s: wp.array[wp.float64],  # (n_view,)
        view_middle_s: wp.array[wp.float64],  # (n_view,) middle of the exposure, throughout which a stare holds its row
        view_sensor: wp.array[wp.uint32],  # (n_view,) row of the sensor in the tracks
        position_m: wp.array2d[wp.vec3d],  # (n_body, n_node) sensors first, then targets
        velocity_m_s: wp.array2d[wp.vec3d],  # (n_body, n_node)
        earth_velocity_m_s: wp.array[wp.vec3d],  # (n_node,) barycentric
        releases: Releases,
        grid: NodeGrid,
        aim: Aim,
        table: AimTable,
        jitter: Jitter,
        # out
        view_axes: wp.array[wp.mat33d],  # (n_view,) rows x, y, z, ICRS axes
        view_position_m: wp.array[wp.vec3d],  # (n_view,) geocentric
        view_velocity_m_s: wp.array[wp.vec3d],  # (n_view,) barycentric
        view_flags: wp.array[wp.int32],  # (n_view,) UP_REPLACED | BORESIGHT_REPLACED
    ):
        """Point each camera."""
        view = wp.tid()
        time_s = view_time_s[view]
        sensor = int(view_sensor[view])
        place = hermite_position_m(position_m, velocity_m_s, sensor, time_s, grid)
        orbital_velocity = hermite_velocity_m_s(position_m, velocity_m_s, sensor, time_s, grid)
        earth_velocity = linear_vector(earth_velocity_m_s, time_s, grid)
        velocity = earth_velocity + orbital_velocity
        frame = local_frame(place, orbital_velocity)

        boresight = aim.direction
        roll_rad = wp.float64(0.0)
        if wp.static(kind == AIM_TRACK):
            observer = observer_of(time_s, grid, place, earth_velocity, velocity)
            boresight = tracked_direction(position_m, velocity_m_s, releases, aim, grid, observer)
        if wp.static(kind == AIM_TABLE):
            sight_s = time_s
            if table.scan == 0:
                sight_s = view_middle_s[view]
            sight = table_sight(table, sensor, sight_s)
            boresight = sight.direction
            roll_rad = sight.roll_rad
        if wp.static(kind != AIM_TRACK):
            if aim.local != 0:
                boresight = from_local(frame, boresight)

        flags = int(0)
        if wp.length(boresight) < wp.float64(0.5):
            flags = int(BORESIGHT_REPLACED)
            boresight = frame.forward
            if wp.length(boresight) < wp.float64(0.5):
                boresight = frame.zenith
        up = frame.zenith
        spare = frame.normal
        if aim.up_rule == UP_NORTH:
            up = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
            spare = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
        if aim.up_rule == UP_ORBIT_NORMAL:
            up = frame.normal
            spare = frame.zenith
        if up_is_lost(boresight, up):
            flags = flags | UP_REPLACED
        axes = camera_axes(boresight, up, spare)
        if wp.static(kind == AIM_TABLE):
            axes = rolled_axes(axes, roll_rad)
        axes = aim.turn * axes
        if wp.static(with_jitter):
            axes = turned_axes(axes, jitter_rad(jitter, view_sensor[view], time_s))
        view_axes[view] = axes
        view_position_m[view] = place
        view_velocity_m_s[view] = velocity
        view_flags[view] = flags

    return aim_kernel
