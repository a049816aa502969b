"""Stage aim: camera axes, position and velocity of every view."""

import warp as wp

from warpsim_kernels.apparent import light_path
from warpsim_kernels.camera import camera_axes
from warpsim_kernels.motion import NodeGrid, hermite_position_m, hermite_velocity_m_s, linear_vector

UP_ZENITH = wp.constant(0)
UP_NORTH = wp.constant(1)
UP_ORBIT_NORMAL = wp.constant(2)


@wp.kernel(enable_backward=False)
def aim_kernel(
    # in
    view_time_s: wp.array[wp.float64],  # (n_view,)
    view_sensor: wp.array[wp.uint32],  # (n_view,) row of the sensor in the tracks
    position_m: wp.array2d[wp.vec3d],  # (n_body, n_node) sensors first, then targets
    velocity_m_s: wp.array2d[wp.vec3d],  # (n_body, n_node)
    earth_velocity_m_s: wp.array[wp.vec3d],  # (n_node,) barycentric
    grid: NodeGrid,
    first_tracked: int,  # the boresight follows the mean direction of these bodies
    n_tracked: int,
    up_rule: int,
    # out
    view_axes: wp.array[wp.mat33d],  # (n_view,) rows x, y, z, ICRS axes
    view_position_m: wp.array[wp.vec3d],  # (n_view,) geocentric
    view_velocity_m_s: wp.array[wp.vec3d],  # (n_view,) barycentric
):
    """Point each camera at the apparent direction of what it tracks."""
    view = wp.tid()
    time_s = view_time_s[view]
    sensor = int(view_sensor[view])
    place = hermite_position_m(position_m, velocity_m_s, sensor, time_s, grid)
    orbital_velocity = hermite_velocity_m_s(position_m, velocity_m_s, sensor, time_s, grid)
    earth_velocity = linear_vector(earth_velocity_m_s, time_s, grid)
    barycentric_velocity = earth_velocity + orbital_velocity

    towards = wp.vec3d()
    for body in range(first_tracked, first_tracked + n_tracked):
        path = light_path(
            position_m, velocity_m_s, body, time_s, grid, place, earth_velocity, barycentric_velocity
        )
        towards += path.apparent
    boresight = wp.normalize(towards)

    zenith = wp.normalize(place)
    normal = wp.normalize(wp.cross(place, orbital_velocity))
    up = zenith
    spare = normal
    if up_rule == UP_NORTH:
        up = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        spare = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    if up_rule == UP_ORBIT_NORMAL:
        up = normal
        spare = zenith
    view_axes[view] = camera_axes(boresight, up, spare)
    view_position_m[view] = place
    view_velocity_m_s[view] = barycentric_velocity
