"""Stage trace: how sources move over the focal plane while the exposure lasts.

Places are found at the Gauss-Legendre nodes of the exposure and turned into Legendre series (see paths.py). A star's
apparent direction is that of the middle: its aberration changes by 0.006 arcsec a second at most.
"""

import warp as wp

from warpsim_kernels.apparent import Releases, path_from_target
from warpsim_kernels.camera import Camera, depth, projected_px
from warpsim_kernels.motion import NodeGrid, linear_vector

REACH_SAFETY = wp.constant(wp.float64(2.0))
"""The ends of an exposure lie beyond its outermost node: up to 1.7 times as far for three nodes on a parabola."""

_NOWHERE_PX = wp.constant(wp.float64(1.0e6))


@wp.struct
class Instants:
    """When during the exposure places are found."""

    n_path: int
    series: wp.array2d[wp.float64]  # (n_path, n_path) what makes coefficient l of the value at instant k


@wp.func
def corner_direction(camera: Camera, corner: int) -> wp.vec3d:
    """Direction of a corner of the frame, or (4) of its centre, in camera axes; without distortion, not of length 1."""
    if corner == 4:
        return wp.vec3d(wp.float64(0.0), wp.float64(0.0), camera.focal_px)
    x = wp.float64(camera.n_col) * wp.float64(0.5)
    y = wp.float64(camera.n_row) * wp.float64(0.5)
    if corner % 2 == 1:
        x = -x
    if corner // 2 == 1:
        y = -y
    return wp.vec3d(x, y, camera.focal_px)


@wp.kernel(enable_backward=False)
def reach_kernel(
    # in
    view_axes: wp.array[wp.mat33d],  # (n_view,) in the middle of the exposure
    path_axes: wp.array2d[wp.mat33d],  # (n_view, n_path) at its nodes
    camera: Camera,
    # out
    reach: wp.array[wp.vec2d],  # (n_view,) how far stars move at most: [px], [rad]
):
    """How far the sky moves over the frame."""
    view = wp.tid()
    far_px = wp.float64(0.0)
    far_rad = wp.float64(0.0)
    for k in range(path_axes.shape[1]):
        turn = path_axes[view, k] * wp.transpose(view_axes[view])
        for corner in range(5):
            before = corner_direction(camera, corner)
            after = turn * before
            sine = wp.length(wp.cross(before, after)) / wp.dot(before, before)
            far_rad = wp.max(far_rad, wp.asin(wp.min(sine, wp.float64(1.0))))
            if after[2] > wp.float64(0.01) * before[2]:
                scale = before[2] / after[2]
                shift = wp.vec2d(after[0] * scale - before[0], after[1] * scale - before[1])
                far_px = wp.max(far_px, wp.length(shift))
            else:
                far_px = _NOWHERE_PX
    reach[view] = wp.vec2d(REACH_SAFETY * far_px, REACH_SAFETY * far_rad)


@wp.func
def add_to_series(
    offset_px: wp.array3d[wp.vec2], view: int, slot: int, k: int, instants: Instants, moved_px: wp.vec2d
):
    """Take the offset at instant k into the series."""
    for l in range(instants.n_path):
        part = moved_px * instants.series[l, k]
        offset_px[view, slot, l] += wp.vec2(float(part[0]), float(part[1]))


@wp.func
def forget_series(offset_px: wp.array3d[wp.vec2], view: int, slot: int, n_path: int):
    """Set a source's series to zero."""
    for l in range(n_path):
        offset_px[view, slot, l] = wp.vec2(0.0, 0.0)


@wp.kernel(enable_backward=False)
def trace_targets_kernel(
    # in
    path_time_s: wp.array2d[wp.float64],  # (n_view, n_path)
    path_axes: wp.array2d[wp.mat33d],  # (n_view, n_path)
    path_position_m: wp.array2d[wp.vec3d],  # (n_view, n_path)
    path_velocity_m_s: wp.array2d[wp.vec3d],  # (n_view, n_path) barycentric
    position_m: wp.array2d[wp.vec3d],  # (n_body, n_node)
    velocity_m_s: wp.array2d[wp.vec3d],  # (n_body, n_node)
    earth_velocity_m_s: wp.array[wp.vec3d],  # (n_node,)
    releases: Releases,
    grid: NodeGrid,
    first_target: int,  # row of the first target in the tracks
    camera: Camera,
    instants: Instants,
    source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) places in the middle
    # out
    offset_px: wp.array3d[wp.vec2],  # (n_view, n_slot, n_path)
):
    """Series of every (view, target); none for a target that is, or comes, behind the camera."""
    view, target = wp.tid()
    forget_series(offset_px, view, target, instants.n_path)
    middle_px = source_xy_px[view, target]
    if wp.max(wp.abs(middle_px[0]), wp.abs(middle_px[1])) > _NOWHERE_PX:
        return
    for k in range(instants.n_path):
        time_s = path_time_s[view, k]
        path = path_from_target(
            position_m, velocity_m_s, releases, first_target + target, time_s, grid, path_position_m[view, k],
            linear_vector(earth_velocity_m_s, time_s, grid), path_velocity_m_s[view, k],
        )
        if depth(path_axes[view, k], path.apparent) <= wp.float64(1.0e-3):
            forget_series(offset_px, view, target, instants.n_path)
            return
        moved_px = projected_px(camera, path_axes[view, k], path.apparent) - middle_px
        add_to_series(offset_px, view, target, k, instants, moved_px)


@wp.kernel(enable_backward=False)
def trace_stars_kernel(
    # in
    path_axes: wp.array2d[wp.mat33d],  # (n_view, n_path)
    camera: Camera,
    instants: Instants,
    n_target: int,
    n_source: wp.array[wp.int32],  # (n_view,)
    source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) places in the middle
    source_direction: wp.array2d[wp.vec3d],  # (n_view, n_slot) apparent, unit, ICRS axes
    # out
    offset_px: wp.array3d[wp.vec2],  # (n_view, n_slot, n_path)
):
    """Series of every star; none for one that comes behind the camera."""
    view, star = wp.tid()
    slot = n_target + star
    if slot >= n_source[view]:
        return
    forget_series(offset_px, view, slot, instants.n_path)
    seen = source_direction[view, slot]
    for k in range(instants.n_path):
        axes = path_axes[view, k]
        if depth(axes, seen) <= wp.float64(1.0e-3):
            forget_series(offset_px, view, slot, instants.n_path)
            return
        add_to_series(offset_px, view, slot, k, instants, projected_px(camera, axes, seen) - source_xy_px[view, slot])
