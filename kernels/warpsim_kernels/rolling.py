"""Stage roll: a detector that is read row by row has each source as it is in the middle of its own row's exposure.

Paths are followed over the window in which any row is exposed (see trace.py). A source is drawn where its path meets
the row that is exposed then: t = (y(t) - middle row) * line time, t after the frame's time. The path over the exposure
of that row is the same polynomial of time on a part of the window, so that its series is exact. All rows of a source's
stamp take the one time: what its own motion changes from row to row of the stamp is left out.
"""

import functools

import warp as wp

from warpsim_kernels.apparent import Tracks, observer_of, path_from_target
from warpsim_kernels.camera import Camera, depth, projection
from warpsim_kernels.motion import linear_vector
from warpsim_kernels.records import Sources, View
from warpsim_kernels.streaks import next_legendre
from warpsim_kernels.trace import Instants, add_to_series, clear_series

N_NEWTON = wp.constant(8)
"""Each step squares the error; the first is at most a hundredth of the window for sources slower than the read-out."""

LEAST_SLOPE = wp.constant(wp.float64(0.1))
"""Of Newton's method: a source as fast as the read-out, or faster, has no single row time; steps stay finite."""

_NOWHERE_PX = wp.constant(wp.float64(1.0e6))


@wp.struct
class Roll:
    """Times of the rows of a detector, and the exposure of each."""

    line_time_s: wp.float64  # from row to row; negative from the bottom up
    middle_row: wp.float64  # exposed at the frame's time
    half_rows_s: wp.float64  # from there to the outer edge of the last row
    half_exposure_s: wp.float64
    half_window_s: wp.float64  # over which paths are series: that of all rows and half an exposure on either side
    charge_drift_px: wp.float64  # movement along y from the middle of the exposure to its end that charge's steps add
    node: wp.array[wp.float64]  # (n_path,) Gauss-Legendre nodes in (-1, 1)
    instants: Instants


@wp.func
def moved_of(window_px: wp.array3d[wp.vec2], view: int, slot: int, t: wp.float64) -> wp.vec3d:
    """Movement of a source at t in [-1, 1] of the window: x, y, and the rate of y [px] per unit of t."""
    moved = wp.vec3d()
    before = wp.float64(0.0)
    legendre = wp.float64(1.0)
    rate_before = wp.float64(0.0)  # derivatives: P'(l+1) = P'(l-1) + (2 l + 1) P(l)
    rate = wp.float64(0.0)
    for l in range(window_px.shape[2]):
        term = window_px[view, slot, l]
        x = wp.float64(term[0])
        y = wp.float64(term[1])
        moved += wp.vec3d(x * legendre, y * legendre, y * rate)
        rate_after = rate_before + wp.float64(2 * l + 1) * legendre
        rate_before = rate
        rate = rate_after
        after = next_legendre(l, t, legendre, before)
        before = legendre
        legendre = after
    return moved


@wp.func
def row_time_of(roll: Roll, window_px: wp.array3d[wp.vec2], view: int, slot: int, y_px: wp.float64) -> wp.float64:
    """Mid-exposure of a source's row after the frame's time [s]; off the array, that of its nearest edge."""
    if wp.abs(y_px) > _NOWHERE_PX:  # behind the camera
        return wp.float64(0.0)
    time_s = wp.clamp((y_px - roll.middle_row) * roll.line_time_s, -roll.half_rows_s, roll.half_rows_s)
    for _ in range(N_NEWTON):
        moved = moved_of(window_px, view, slot, time_s / roll.half_window_s)
        missed_s = time_s - (y_px + moved[1] - roll.middle_row) * roll.line_time_s
        slope = wp.float64(1.0) - roll.line_time_s * moved[2] / roll.half_window_s
        time_s = wp.clamp(time_s - missed_s / wp.max(slope, LEAST_SLOPE), -roll.half_rows_s, roll.half_rows_s)
    return time_s


@wp.func
def roll_source(roll: Roll, window_px: wp.array3d[wp.vec2], view: int, slot: int, sources: Sources) -> wp.float64:
    """Give a source the position at its row's time, which is returned, and the path over its row's exposure."""
    middle_px = sources.xy_px[view, slot]
    time_s = row_time_of(roll, window_px, view, slot, middle_px[1])
    at = moved_of(window_px, view, slot, time_s / roll.half_window_s)
    sources.xy_px[view, slot] = middle_px + wp.vec2d(at[0], at[1])
    clear_series(sources.offset_px, view, slot, roll.instants.n_path)
    if roll.half_exposure_s > wp.float64(0.0):
        for k in range(roll.instants.n_path):
            then_s = time_s + roll.half_exposure_s * roll.node[k]
            then = moved_of(window_px, view, slot, then_s / roll.half_window_s)
            add_to_series(sources.offset_px, view, slot, k, roll.instants, wp.vec2d(then[0] - at[0], then[1] - at[1]))
        sources.offset_px[view, slot, 1] += wp.vec2(0.0, float(roll.charge_drift_px))
    return time_s


@functools.cache
def make_locate_targets_kernel(distortion: bool) -> wp.Kernel:
    """Kernel that finds where targets are at the frame's time."""
    projected_px = projection(distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def locate_targets_kernel(
        # in
        path_time_s: wp.array2d[wp.float64],  # (n_view, n_path) an odd number of nodes
        path: wp.array2d[View],  # (n_view, n_path)
        tracks: Tracks,
        camera: Camera,
        # out
        sources: Sources,  # xy_px of the first slots; far outside the frame behind the camera
    ):
        """Position of every (view, target) at the node in the middle."""
        view, target = wp.tid()
        middle = path.shape[1] // 2
        time_s = path_time_s[view, middle]
        earth_m_s = linear_vector(tracks.earth_velocity_m_s, time_s, tracks.grid)
        camera_at = path[view, middle]
        observer = observer_of(time_s, camera_at.position_m, earth_m_s, camera_at.velocity_m_s)
        light = path_from_target(tracks, tracks.first_target + target, observer)
        sources.xy_px[view, target] = wp.vec2d(wp.float64(-1.0e9), wp.float64(-1.0e9))
        if depth(camera_at.axes, light.apparent) > wp.float64(0.0):
            sources.xy_px[view, target] = projected_px(camera, camera_at.axes, light.apparent)

    return locate_targets_kernel


@wp.kernel(enable_backward=False)
def roll_targets_kernel(
    # in
    view_time_s: wp.array[wp.float64],  # (n_view,) the frame's time
    view_sensor: wp.array[wp.uint32],  # (n_view,)
    roll: Roll,
    window_px: wp.array3d[wp.vec2],  # (n_view, n_slot, n_path) movement over the window: Legendre coefficients
    # in and out
    sources: Sources,  # xy_px, offset_px of the first slots
    # out
    offset_px: wp.array3d[wp.vec2],  # (n_view, n_target, n_path) the same, for the truth
    row_time_s: wp.array2d[wp.float64],  # (n_view, n_target) of a target's row after the frame's time
    time_s: wp.array2d[wp.float64],  # (n_view, n_target) the same after the epoch: when its camera is aimed
    middle_s: wp.array2d[wp.float64],  # (n_view, n_target) the frame's time
    sensor: wp.array2d[wp.uint32],  # (n_view, n_target)
):
    """Every (view, target) at its row's time, and the view of it then."""
    view, target = wp.tid()
    own_s = roll_source(roll, window_px, view, target, sources)
    for l in range(roll.instants.n_path):
        offset_px[view, target, l] = sources.offset_px[view, target, l]
    row_time_s[view, target] = own_s
    time_s[view, target] = view_time_s[view] + own_s
    middle_s[view, target] = view_time_s[view]
    sensor[view, target] = view_sensor[view]


@wp.kernel(enable_backward=False)
def roll_stars_kernel(
    # in
    roll: Roll,
    window_px: wp.array3d[wp.vec2],  # (n_view, n_slot, n_path)
    n_target: int,
    # in and out
    sources: Sources,  # xy_px, offset_px of the slots behind the targets
):
    """Every star at its row's time."""
    view, star = wp.tid()
    slot = n_target + star
    if slot < sources.n_source[view]:
        roll_source(roll, window_px, view, slot, sources)
