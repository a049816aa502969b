"""Rotation of bodies on which no torque acts: nutation, by a table of its period, within precessing axes; float64."""

import warp as wp

from warpsim_kernels.motion import Attitude, axes_before_spin, turns
from warpsim_kernels.timed_tables import turned_axes


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
