"""Stage aim: camera axes, position and velocity of every view."""

import functools
from typing import NamedTuple

import warp as wp

from warpsim_kernels.apparent import Tracks, observer_of
from warpsim_kernels.motion import hermite_position_m, hermite_velocity_m_s, linear_vector
from warpsim_kernels.pointing import (
    SLEWING,
    PointingLaw,
    ScanRows,
    axes_between,
    law_axes_of,
    local_frame,
    slew_part,
)
from warpsim_kernels.pointing_errors import Jitter, PointingError, jitter_rad, steady_error_rad, turned_axes
from warpsim_kernels.records import View
from warpsim_kernels.timed_tables import row_before


class AimFeatures(NamedTuple):
    """Ways of pointing that a kernel of the stage holds."""

    track: bool = False  # cameras that follow targets
    fixed: bool = False  # that look in one direction
    scan: bool = False  # that move along the rows of a table
    attitude: bool = False  # that are fixed in a body
    steps: bool = False  # that follow one law after the other
    slews: bool = False  # and turn from one to the next; with steps only
    steady_errors: bool = False  # bias and drift
    jitter: bool = False


@wp.struct
class Pointing:
    """Pointing laws and errors of the sensors of a scene; indices are those of sensors."""

    laws: wp.array[PointingLaw]  # (n_law,)
    law: wp.array[wp.int32]  # (n_sensor,) without steps
    step_first: wp.array[wp.int32]  # (n_sensor,) with steps, its first one
    step_count: wp.array[wp.int32]  # (n_sensor,)
    step_start_s: wp.array[wp.float64]  # (n_step,)
    step_law: wp.array[wp.int32]  # (n_step,)
    turn_s: wp.array[wp.float64]  # (n_step,) duration of the turn that it begins with, 0 for none
    turn_ramp: wp.array[wp.float64]  # (n_step,)
    turn_vector: wp.array[wp.vec3d]  # (n_step,) axis times angle of the turn at its beginning [rad]
    unsettled_s: wp.array[wp.float64]  # (n_step,) until the camera is settled
    slews: wp.array[wp.int32]  # (n_sensor,) not 0: it turns from step to step, within an exposure too
    rows: ScanRows
    errors: wp.array[PointingError]  # (n_sensor,)
    jitters: wp.array[Jitter]  # (n_sensor,)


@functools.cache
def make_aim_kernel(features: AimFeatures) -> wp.Kernel:
    """Kernel of the stage; what is off is not in its code."""
    law_axes = law_axes_of(features.track, features.fixed, features.scan, features.attitude)

    @wp.func
    def step_of(pointing: Pointing, sensor: int, time_s: wp.float64, middle_s: wp.float64):
        """Index of the step of a sensor: that of the middle of its exposure, unless it turns from step to step."""
        step_s = middle_s
        if wp.static(features.slews):
            if pointing.slews[sensor] != 0:
                step_s = time_s
        # Steps are instants, not intervals: the last one, too, may be that which has come.
        return row_before(pointing.step_start_s, pointing.step_first[sensor], pointing.step_count[sensor] + 1, step_s)

    @wp.kernel(module="unique", enable_backward=False)
    def aim_kernel(
        # in
        view_time_s: wp.array[wp.float64],  # (n_view,)
        view_middle_s: wp.array[wp.float64],  # (n_view,) middle of the exposure, for what holds in all of it
        view_sensor: wp.array[wp.uint32],  # (n_view,) index of the sensor, and its row in the tracks
        tracks: Tracks,
        pointing: Pointing,
        # out
        views: wp.array[View],  # (n_view,) axes, position, velocity, flags
    ):
        """Point each camera."""
        view = wp.tid()
        time_s = view_time_s[view]
        sensor = int(view_sensor[view])
        position_m = hermite_position_m(tracks.nodes, sensor, time_s)
        orbital_m_s = hermite_velocity_m_s(tracks.nodes, sensor, time_s)
        earth_m_s = linear_vector(tracks.earth_velocity_m_s, time_s, tracks.grid)
        velocity_m_s = earth_m_s + orbital_m_s
        frame = local_frame(position_m, orbital_m_s)
        observer = observer_of(time_s, position_m, earth_m_s, velocity_m_s)

        since_middle_s = time_s - view_middle_s[view]
        step = int(0)
        number = pointing.law[sensor]
        if wp.static(features.steps):
            step = step_of(pointing, sensor, time_s, view_middle_s[view])
            number = pointing.step_law[step]
        commanded = law_axes(
            pointing.laws[number], pointing.rows, sensor, time_s, frame, tracks, observer, since_middle_s
        )
        axes = commanded.axes
        flags = commanded.flags
        if wp.static(features.slews):
            since_s = time_s - pointing.step_start_s[step]
            begun = since_s >= wp.float64(0.0)  # an exposure about the first step's start begins before it
            if begun and since_s < pointing.unsettled_s[step]:
                flags = flags | SLEWING
            if begun and since_s < pointing.turn_s[step]:
                before = law_axes(
                    pointing.laws[pointing.step_law[step - 1]],
                    pointing.rows,
                    sensor,
                    time_s,
                    frame,
                    tracks,
                    observer,
                    since_middle_s,
                )
                part = slew_part(since_s, pointing.turn_s[step], pointing.turn_ramp[step])
                axes = axes_between(before.axes, axes, part, pointing.turn_vector[step])
        if wp.static(features.steady_errors):
            axes = turned_axes(axes, steady_error_rad(pointing.errors[sensor], time_s, view_middle_s[view]))
        if wp.static(features.jitter):
            jitter = pointing.jitters[sensor]
            if jitter.step_s > wp.float64(0.0):
                axes = turned_axes(axes, jitter_rad(jitter, time_s))
        views[view].axes = axes
        views[view].position_m = position_m
        views[view].velocity_m_s = velocity_m_s
        views[view].flags = flags

    return aim_kernel
