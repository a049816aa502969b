"""Positions and attitudes at an instant, in float64.

Tracks are positions and velocities at uniform nodes, those of each body in its own step; between nodes the cubic
Hermite polynomial is used.
"""

import warp as wp

from warpsim_kernels.angles import cosine_sine

TWO_PI = wp.constant(wp.float64(6.283185307179586))


@wp.struct
class NodeGrid:
    """Uniform time nodes."""

    start_s: wp.float64
    step_s: wp.float64
    n_node: int


@wp.func
def node_before(time_s: wp.float64, grid: NodeGrid) -> int:
    """Index of the node that begins the interval holding time_s (clamped to the grid)."""
    node = int(wp.floor((time_s - grid.start_s) / grid.step_s))
    return wp.clamp(node, 0, grid.n_node - 2)


@wp.func
def part_after(time_s: wp.float64, node: int, grid: NodeGrid) -> wp.float64:
    """The part of a step that has gone by since a node."""
    return (time_s - grid.start_s) / grid.step_s - wp.float64(node)


@wp.struct
class BodyNodes:
    """The nodes of a body."""

    grid: NodeGrid
    first: int  # index of its first node among those of all bodies
    steps_per_m: wp.float64  # steps that light takes for a metre


@wp.struct
class Nodes:
    """States of bodies at their nodes, one body after the other."""

    bodies: wp.array[BodyNodes]  # (n_body,)
    position_m: wp.array[wp.vec3d]  # (n_node,) geocentric
    velocity_m_s: wp.array[wp.vec3d]  # (n_node,)


@wp.struct
class Cubic:
    """A polynomial in the part of a step that has gone by: what Hermite's is between two nodes."""

    start: wp.vec3d
    first: wp.vec3d
    second: wp.vec3d
    third: wp.vec3d


@wp.func
def cubic_after(nodes: Nodes, own: BodyNodes, node: int) -> Cubic:
    """Positions of a body from a node to the next [m]."""
    two = wp.float64(2.0)
    at = own.first + node
    way = Cubic()
    way.start = nodes.position_m[at]
    chord = nodes.position_m[at + 1] - way.start  # small against the geocentric distance: last bits are kept
    m0 = nodes.velocity_m_s[at] * own.grid.step_s
    m1 = nodes.velocity_m_s[at + 1] * own.grid.step_s
    way.first = m0
    way.second = chord * wp.float64(3.0) - m0 * two - m1
    way.third = m0 + m1 - chord * two
    return way


@wp.func
def cubic_at(way: Cubic, part: wp.float64) -> wp.vec3d:
    """The position after a part of the step."""
    return way.start + (way.first + (way.second + way.third * part) * part) * part


@wp.func
def hermite_position_m(nodes: Nodes, body: int, time_s: wp.float64) -> wp.vec3d:
    """Position of a body at time_s [m]."""
    own = nodes.bodies[body]
    node = node_before(time_s, own.grid)
    return cubic_at(cubic_after(nodes, own, node), part_after(time_s, node, own.grid))


@wp.func
def hermite_velocity_m_s(nodes: Nodes, body: int, time_s: wp.float64) -> wp.vec3d:
    """Velocity of a body at time_s [m/s]: the derivative of the Hermite polynomial."""
    own = nodes.bodies[body]
    node = node_before(time_s, own.grid)
    at = own.first + node
    u = part_after(time_s, node, own.grid)
    one = wp.float64(1.0)
    three = wp.float64(3.0)
    six = wp.float64(6.0)
    two = wp.float64(2.0)
    chord = (nodes.position_m[at + 1] - nodes.position_m[at]) / own.grid.step_s
    v0 = nodes.velocity_m_s[at]
    v1 = nodes.velocity_m_s[at + 1]
    w = one - u
    return chord * (six * u * w) + v0 * (w * (one - three * u)) + v1 * (u * (three * u - two))


@wp.func
def linear_vector(values: wp.array[wp.vec3d], time_s: wp.float64, grid: NodeGrid) -> wp.vec3d:
    """A slowly changing vector (the Earth's barycentric velocity) between nodes."""
    node = node_before(time_s, grid)
    u = part_after(time_s, node, grid)
    return values[node] + (values[node + 1] - values[node]) * u


@wp.func
def linear_rate(values: wp.array[wp.vec3d], time_s: wp.float64, grid: NodeGrid) -> wp.vec3d:
    """By how much `linear_vector` changes in a second."""
    node = node_before(time_s, grid)
    return (values[node + 1] - values[node]) / grid.step_s


@wp.func
def turns(rate_rev_s: wp.float64, time_s: wp.float64) -> wp.float64:
    """Fraction of a turn after time_s at a constant rate, without losing phase over long times.

    The rate is cut into a part of 20 binary places, whose product with whole seconds is exact, and a small rest.
    """
    scale = wp.float64(1048576.0)
    coarse = wp.floor(rate_rev_s * scale) / scale
    whole_s = wp.floor(time_s)
    exact = coarse * whole_s
    phase = (exact - wp.floor(exact)) + (rate_rev_s - coarse) * whole_s + rate_rev_s * (time_s - whole_s)
    return phase - wp.floor(phase)


@wp.struct
class Attitude:
    """Motion of a body about a fixed direction.

    The body's z axis stands at polar angle `tilt + rolling` from `reference` and turns about it by precession; the body
    turns about its z axis by spin.
    """

    reference: wp.vec3d  # fixed direction, unit, ICRS axes
    first: wp.vec3d  # unit, perpendicular to reference
    second: wp.vec3d  # reference x first
    tilt_rad: wp.float64
    precession_rev_s: wp.float64
    precession_phase_rev: wp.float64
    rolling_rev_s: wp.float64
    rolling_phase_rev: wp.float64
    spin_rev_s: wp.float64
    spin_phase_rev: wp.float64


@wp.func
def axes_before_spin(attitude: Attitude, time_s: wp.float64) -> wp.mat33d:
    """The body's axes x, y, z as rows, ICRS axes, as they would be without spin: F Rz(azimuth) Ry(polar)."""
    rolled = turns(attitude.rolling_rev_s, time_s) + attitude.rolling_phase_rev
    polar = cosine_sine(attitude.tilt_rad / TWO_PI + rolled)
    azimuth = cosine_sine(turns(attitude.precession_rev_s, time_s) + attitude.precession_phase_rev)
    out = attitude.first * azimuth[0] + attitude.second * azimuth[1]
    y = wp.cross(attitude.reference, out)
    x = out * polar[0] - attitude.reference * polar[1]
    z = attitude.reference * polar[0] + out * polar[1]
    return wp.matrix_from_rows(x, y, z)


@wp.func
def spun(axes: wp.mat33d, attitude: Attitude, time_s: wp.float64) -> wp.mat33d:
    """Axes (rows) after the body's spin about its z axis."""
    angle = cosine_sine(turns(attitude.spin_rev_s, time_s) + attitude.spin_phase_rev)
    x = axes[0] * angle[0] + axes[1] * angle[1]
    y = axes[1] * angle[0] - axes[0] * angle[1]
    return wp.matrix_from_rows(x, y, axes[2])
