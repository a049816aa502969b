"""Stage trace: how sources move over the focal plane while the exposure lasts.

Positions are found at the Gauss-Legendre nodes of the exposure and turned into Legendre series (see streaks.py). A
star's apparent direction is that of the middle: its aberration changes by 0.006 arcsec a second at most.
"""

import functools

import warp as wp

from warpsim_kernels.apparent import Tracks, observer_of, path_from_target
from warpsim_kernels.camera import Camera, depth, projection
from warpsim_kernels.motion import linear_vector
from warpsim_kernels.records import Sources, View

REACH_SAFETY = wp.constant(wp.float64(2.0))
"""The ends of an exposure lie beyond its outermost node: up to 1.7 times as far for three nodes on a parabola."""

_NOWHERE_PX = wp.constant(wp.float64(1.0e6))
_ASIDE = wp.constant(wp.float64(1.0e-3))
"""Of a unit vector along the boresight, below which a position is not followed: it is beside or behind the camera."""


@wp.struct
class Instants:
    """Instants of the exposure at which positions are found."""

    n_path: int
    series: wp.array2d[wp.float64]  # (n_path, n_path) what makes coefficient l of the value at instant k


@wp.kernel(enable_backward=False)
def spread_views_kernel(
    # in
    view_time_s: wp.array[wp.float64],  # (n_view,) middle of the exposure
    view_sensor: wp.array[wp.uint32],  # (n_view,)
    offset_s: wp.array[wp.float64],  # (n_path,)
    # out
    time_s: wp.array2d[wp.float64],  # (n_view, n_path)
    middle_s: wp.array2d[wp.float64],  # (n_view, n_path)
    sensor: wp.array2d[wp.uint32],  # (n_view, n_path)
):
    """Views at the instants of the exposure."""
    view, k = wp.tid()
    time_s[view, k] = view_time_s[view] + offset_s[k]
    middle_s[view, k] = view_time_s[view]
    sensor[view, k] = view_sensor[view]


@functools.cache
def make_reach_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that finds how far the sky moves over the frame."""
    projected_px = projection(distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def reach_kernel(
        # in
        path: wp.array2d[View],  # (n_view, n_path) at the nodes of the exposure
        camera: Camera,
        sample_point: wp.array[wp.vec3d],  # (n_point,) unit directions of corners and the like, in camera axes
        # in and out
        views: wp.array[View],  # (n_view,) in its middle; reach
    ):
        """Largest movement of the sample points, with a margin."""
        view = wp.tid()
        still = wp.identity(n=3, dtype=wp.float64)
        far_px = wp.float64(0.0)
        far_rad = wp.float64(0.0)
        for k in range(path.shape[1]):
            turn = path[view, k].axes * wp.transpose(views[view].axes)
            for point in range(sample_point.shape[0]):
                before = sample_point[point]
                after = turn * before
                far_rad = wp.max(far_rad, wp.asin(wp.min(wp.length(wp.cross(before, after)), wp.float64(1.0))))
                if after[2] > _ASIDE:
                    shift = projected_px(camera, still, after) - projected_px(camera, still, before)
                    far_px = wp.max(far_px, wp.length(shift))
                else:
                    far_px = _NOWHERE_PX
        views[view].reach = wp.vec2d(REACH_SAFETY * far_px, REACH_SAFETY * far_rad)

    return reach_kernel


@wp.func
def add_to_series(offset_px: wp.array3d[wp.vec2], view: int, slot: int, k: int, instants: Instants, moved_px: wp.vec2d):
    """Take the offset at instant k into the series."""
    for l in range(instants.n_path):
        part = moved_px * instants.series[l, k]
        offset_px[view, slot, l] += wp.vec2(float(part[0]), float(part[1]))


@wp.func
def clear_series(offset_px: wp.array3d[wp.vec2], view: int, slot: int, n_path: int):
    """Set a source's series to zero."""
    for l in range(n_path):
        offset_px[view, slot, l] = wp.vec2(0.0, 0.0)


@functools.cache
def make_trace_targets_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that follows the targets."""
    projected_px = projection(distortion)

    # 128 registers; what does not fit goes to shared memory.
    @wp.kernel(module="unique", enable_backward=False, launch_bounds=(64, 8), enable_cuda_smem_spilling=True)
    def trace_targets_kernel(
        # in
        path_time_s: wp.array2d[wp.float64],  # (n_view, n_path)
        path: wp.array2d[View],  # (n_view, n_path)
        tracks: Tracks,
        camera: Camera,
        instants: Instants,
        # in and out
        sources: Sources,  # offset_px
        # out
        offset_px: wp.array3d[wp.vec2],  # (n_view, n_target, n_path) the same, for the truth
    ):
        """Series of every (view, target); none for a target that is, or comes, behind the camera."""
        view, target = wp.tid()
        clear_series(sources.offset_px, view, target, instants.n_path)
        middle_px = sources.xy_px[view, target]
        n_followed = instants.n_path
        if wp.max(wp.abs(middle_px[0]), wp.abs(middle_px[1])) > _NOWHERE_PX:
            n_followed = int(0)
        k = int(0)
        while k < n_followed:
            time_s = path_time_s[view, k]
            earth_m_s = linear_vector(tracks.earth_velocity_m_s, time_s, tracks.grid)
            camera_at = path[view, k]
            observer = observer_of(time_s, camera_at.position_m, earth_m_s, camera_at.velocity_m_s)
            light = path_from_target(tracks, tracks.first_target + target, observer)
            if depth(camera_at.axes, light.apparent) <= _ASIDE:
                clear_series(sources.offset_px, view, target, instants.n_path)
                n_followed = int(0)
            else:
                moved_px = projected_px(camera, camera_at.axes, light.apparent) - middle_px
                add_to_series(sources.offset_px, view, target, k, instants, moved_px)
            k += 1
        for l in range(instants.n_path):
            offset_px[view, target, l] = sources.offset_px[view, target, l]

    return trace_targets_kernel


@functools.cache
def make_trace_stars_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that follows the stars."""
    projected_px = projection(distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_stars_kernel(
        # in
        path: wp.array2d[View],  # (n_view, n_path)
        camera: Camera,
        instants: Instants,
        n_target: int,
        # in and out
        sources: Sources,  # offset_px
    ):
        """Series of every star; none for one that comes behind the camera."""
        view, star = wp.tid()
        slot = n_target + star
        if slot >= sources.n_source[view]:
            return
        clear_series(sources.offset_px, view, slot, instants.n_path)
        seen = sources.direction[view, slot]
        for k in range(instants.n_path):
            axes = path[view, k].axes
            if depth(axes, seen) <= _ASIDE:
                clear_series(sources.offset_px, view, slot, instants.n_path)
                return
            moved_px = projected_px(camera, axes, seen) - sources.xy_px[view, slot]
            add_to_series(sources.offset_px, view, slot, k, instants, moved_px)

    return trace_stars_kernel
