"""Stage trace: how sources move over the focal plane while the exposure lasts.

Places are found at the Gauss-Legendre nodes of the exposure and turned into Legendre series (see paths.py). A star's
apparent direction is that of the middle: its aberration changes by 0.006 arcsec a second at most.
"""

import functools

import warp as wp

from warpsim_kernels.apparent import Presence, observer_of, path_from_target
from warpsim_kernels.camera import Camera, depth, projection
from warpsim_kernels.motion import NodeGrid, linear_vector

REACH_SAFETY = wp.constant(wp.float64(2.0))
"""The ends of an exposure lie beyond its outermost node: up to 1.7 times as far for three nodes on a parabola."""

_NOWHERE_PX = wp.constant(wp.float64(1.0e6))
_ASIDE = wp.constant(wp.float64(1.0e-3))
"""Of a unit vector along the boresight, below which a place is not followed: it is beside or behind the camera."""


@wp.struct
class Instants:
    """When during the exposure places are found."""

    n_path: int
    series: wp.array2d[wp.float64]  # (n_path, n_path) what makes coefficient l of the value at instant k


@functools.cache
def make_reach_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that finds how far the sky moves over the frame."""
    projected_px = projection(distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def reach_kernel(
        # in
        view_axes: wp.array[wp.mat33d],  # (n_view,) in the middle of the exposure
        path_axes: wp.array2d[wp.mat33d],  # (n_view, n_path) at its nodes
        camera: Camera,
        landmark: wp.array[wp.vec3d],  # (n_landmark,) unit directions of corners and the like, in camera axes
        # out
        reach: wp.array[wp.vec2d],  # (n_view,) how far stars move at most: [px], [rad]
    ):
        """Largest movement of the landmarks, with a margin."""
        view = wp.tid()
        still = wp.identity(n=3, dtype=wp.float64)
        far_px = wp.float64(0.0)
        far_rad = wp.float64(0.0)
        for k in range(path_axes.shape[1]):
            turn = path_axes[view, k] * wp.transpose(view_axes[view])
            for point in range(landmark.shape[0]):
                before = landmark[point]
                after = turn * before
                far_rad = wp.max(far_rad, wp.asin(wp.min(wp.length(wp.cross(before, after)), wp.float64(1.0))))
                if after[2] > _ASIDE:
                    shift = projected_px(camera, still, after) - projected_px(camera, still, before)
                    far_px = wp.max(far_px, wp.length(shift))
                else:
                    far_px = _NOWHERE_PX
        reach[view] = wp.vec2d(REACH_SAFETY * far_px, REACH_SAFETY * far_rad)

    return reach_kernel


@wp.func
def add_to_series(offset_px: wp.array3d[wp.vec2], view: int, slot: int, k: int, instants: Instants, moved_px: wp.vec2d):
    """Take the offset at instant k into the series."""
    for l in range(instants.n_path):
        part = moved_px * instants.series[l, k]
        offset_px[view, slot, l] += wp.vec2(float(part[0]), float(part[1]))


@wp.func
def forget_series(offset_px: wp.array3d[wp.vec2], view: int, slot: int, n_path: int):
    """Set a source's series to zero."""
    for l in range(n_path):
        offset_px[view, slot, l] = wp.vec2(0.0, 0.0)


@functools.cache
def make_trace_targets_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that follows the targets."""
    projected_px = projection(distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_targets_kernel(
        # in
        path_time_s: wp.array2d[wp.float64],  # (n_view, n_path)
        path_axes: wp.array2d[wp.mat33d],  # (n_view, n_path)
        path_position_m: wp.array2d[wp.vec3d],  # (n_view, n_path)
        path_velocity_m_s: wp.array2d[wp.vec3d],  # (n_view, n_path) barycentric
        position_m: wp.array2d[wp.vec3d],  # (n_body, n_node)
        velocity_m_s: wp.array2d[wp.vec3d],  # (n_body, n_node)
        earth_velocity_m_s: wp.array[wp.vec3d],  # (n_node,)
        presence: Presence,
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
            earth_velocity = linear_vector(earth_velocity_m_s, time_s, grid)
            observer = observer_of(time_s, grid, path_position_m[view, k], earth_velocity, path_velocity_m_s[view, k])
            path = path_from_target(position_m, velocity_m_s, presence, first_target + target, grid, observer)
            if depth(path_axes[view, k], path.apparent) <= _ASIDE:
                forget_series(offset_px, view, target, instants.n_path)
                return
            moved_px = projected_px(camera, path_axes[view, k], path.apparent) - middle_px
            add_to_series(offset_px, view, target, k, instants, moved_px)

    return trace_targets_kernel


@functools.cache
def make_trace_stars_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that follows the stars."""
    projected_px = projection(distortion)

    @wp.kernel(module="unique", enable_backward=False)
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
            if depth(axes, seen) <= _ASIDE:
                forget_series(offset_px, view, slot, instants.n_path)
                return
            moved_px = projected_px(camera, axes, seen) - source_xy_px[view, slot]
            add_to_series(offset_px, view, slot, k, instants, moved_px)

    return trace_stars_kernel
