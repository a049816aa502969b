"""Attitudes (quaternions), periods of nutation and temperatures of targets by tables in time, in float64."""

import warp as wp

from warpsim_kernels.motion import Attitude, axes_before_spin, turns

_SMALL_ANGLE_RAD = wp.constant(wp.float64(1.0e-4))


@wp.struct
class AttitudeTables:
    """The tables of all targets, one behind the other."""

    time_s: wp.array[wp.float64]  # (n_row,) ascending within a table
    quaternion: wp.array[wp.quatd]  # (n_row,) body -> ICRS axes, scalar last, unit; neighbours in one hemisphere


@wp.func
def row_before(time_s: wp.array[wp.float64], first: int, count: int, time: wp.float64) -> int:
    """Row that begins the interval holding a time, among rows first to first + count - 1 (clamped to the table)."""
    low = first
    high = first + count - 1
    while high - low > 1:
        middle = (low + high) // 2
        if time_s[middle] <= time:
            low = middle
        else:
            high = middle
    return low


@wp.func
def sine_ratio(angle_rad: wp.float64) -> wp.float64:
    """sin(x) / x."""
    ratio = wp.float64(1.0) - angle_rad * angle_rad / wp.float64(6.0)
    if angle_rad > _SMALL_ANGLE_RAD:
        ratio = wp.sin(angle_rad) / angle_rad
    return ratio


@wp.func
def slerp(a: wp.quatd, b: wp.quatd, part: wp.float64) -> wp.quatd:
    """From a (part = 0) to b (part = 1) at a constant rate; their scalar product must be >= 0 (Shoemake 1985)."""
    arc = wp.float64(2.0) * wp.atan2(wp.length(b - a), wp.length(b + a))
    rest = wp.float64(1.0) - part
    between = a * (rest * sine_ratio(rest * arc)) + b * (part * sine_ratio(part * arc))
    return wp.normalize(between)


@wp.func
def table_quaternion(tables: AttitudeTables, first: int, count: int, time: wp.float64) -> wp.quatd:
    """Rotation body -> ICRS axes at a time; the end rows hold beyond the table."""
    row = row_before(tables.time_s, first, count, time)
    turned = tables.quaternion[row]
    if count > 1:
        start = tables.time_s[row]
        part = (time - start) / (tables.time_s[row + 1] - start)
        turned = slerp(turned, tables.quaternion[row + 1], wp.clamp(part, wp.float64(0.0), wp.float64(1.0)))
    return turned


@wp.func
def turned_axes(turned: wp.quatd) -> wp.mat33d:
    """The body's axes x, y, z as rows, in ICRS axes."""
    return wp.transpose(wp.quat_to_matrix(wp.normalize(turned)))


@wp.func
def nutation_quaternion(nodes: wp.array2d[wp.quatd], first: int, count: int, phase_rev: wp.float64) -> wp.quatd:
    """Rotation body -> precessing axes at a phase of 0 to 1: cubic (Hermite's) between rows first to first + count - 1.

    A row holds the rotation at one of `count` equal steps over the period, and by how much it changes in a step.
    """
    two = wp.float64(2.0)
    three = wp.float64(3.0)
    position = phase_rev * wp.float64(count)
    node = wp.min(int(position), count - 1)
    u = position - wp.float64(node)
    start = nodes[first + node, 0]
    before = nodes[first + node, 1]
    after = nodes[first + (node + 1) % count, 1]
    chord = nodes[first + (node + 1) % count, 0] - start
    bend = chord * three - before * two - after + (before + after - chord * two) * u
    return start + (before + bend * u) * u


@wp.func
def torque_free_axes(
    attitude: Attitude, nodes: wp.array2d[wp.quatd], first: int, count: int, time_s: wp.float64
) -> wp.mat33d:
    """The body's axes as rows, ICRS axes; precession is about the reference, and spin stands for the nutation."""
    inner = nutation_quaternion(nodes, first, count, turns(attitude.spin_rev_s, time_s))
    return turned_axes(inner) * axes_before_spin(attitude, time_s)


@wp.struct
class TemperatureTables:
    """The rows of all targets, one table behind the other; a constant temperature is a table of one row."""

    time_s: wp.array[wp.float64]  # (n_row,) ascending within a table
    temperature_k: wp.array[wp.float64]  # (n_row,)


@wp.func
def temperature_k(tables: TemperatureTables, first: int, count: int, time_s: wp.float64) -> wp.float64:
    """Temperature from rows first to first + count - 1; the end rows hold beyond the table."""
    row = row_before(tables.time_s, first, count, time_s)
    kelvin = tables.temperature_k[row]
    if count > 1:
        start_s = tables.time_s[row]
        part = (time_s - start_s) / (tables.time_s[row + 1] - start_s)
        rise = tables.temperature_k[row + 1] - kelvin
        kelvin = kelvin + rise * wp.clamp(part, wp.float64(0.0), wp.float64(1.0))
    return kelvin
