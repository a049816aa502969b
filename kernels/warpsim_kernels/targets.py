"""Stage observe_targets, first half: where each target is seen, and what of it."""

import functools

import warp as wp

from warpsim_kernels.apparent import Presence, observer_of, path_from_target
from warpsim_kernels.camera import Camera, depth, projection, within_frame
from warpsim_kernels.earth import is_occulted
from warpsim_kernels.motion import NodeGrid, hermite_velocity_m_s, linear_rate, linear_vector
from warpsim_kernels.signature import Exposure, Features, Passing, Surroundings, Tables, Target, signature_of
from warpsim_kernels.temperature import temperature_k

IN_FOV = wp.constant(1)
OCCULTED = wp.constant(2)
BEHIND = wp.constant(4)
NOT_DEPLOYED = wp.constant(8)
ABSENT = wp.constant(16)
DARK = wp.constant(26)
"""Bits of the flag word of an observation; DARK is OCCULTED | NOT_DEPLOYED | ABSENT. An absent target has no other."""


@functools.cache
def make_observe_targets_kernel(features: Features) -> wp.Kernel:
    """Kernel of the stage; its code holds what the scene's targets need."""
    signature = signature_of(features)
    projected_px = projection(features.distortion)

    @wp.kernel(module="unique", enable_backward=False)
    def observe_targets_kernel(
        # in
        view_time_s: wp.array[wp.float64],  # (n_view,)
        view_axes: wp.array[wp.mat33d],  # (n_view,)
        view_position_m: wp.array[wp.vec3d],  # (n_view,)
        view_velocity_m_s: wp.array[wp.vec3d],  # (n_view,) barycentric
        position_m: wp.array2d[wp.vec3d],  # (n_body, n_node)
        velocity_m_s: wp.array2d[wp.vec3d],  # (n_body, n_node)
        earth_velocity_m_s: wp.array[wp.vec3d],  # (n_node,)
        presence: Presence,
        grid: NodeGrid,
        first_target: int,  # row of the first target in the tracks
        targets: wp.array[Target],  # (n_target,)
        tables: Tables,
        exposure: Exposure,
        surroundings: Surroundings,
        camera: Camera,
        n_lane: int,  # threads that share a view
        # out
        source_xy_px: wp.array2d[wp.vec2d],  # (n_view, n_slot) first slots; far outside the frame if behind the camera
        range_m: wp.array2d[wp.float64],  # (n_view, n_target)
        aspect_rad: wp.array2d[wp.float64],  # (n_view, n_target)
        area_m2: wp.array2d[wp.float64],  # (n_view, n_target)
        sun_area_m2: wp.array2d[wp.float64],  # (n_view, n_target)
        earth_area_m2: wp.array2d[wp.float64],  # (n_view, n_target)
        albedo_area_m2_sr: wp.array2d[wp.float64],  # (n_view, n_target)
        sunlit: wp.array2d[wp.float64],  # (n_view, n_target)
        temperature: wp.array2d[wp.float64],  # (n_view, n_target) [K]
        flags: wp.array2d[wp.int32],  # (n_view, n_target) IN_FOV | OCCULTED | BEHIND | NOT_DEPLOYED, or ABSENT
        area_series: wp.array4d[wp.float64],  # (n_view, n_target, N_TERM, n_exposure); empty unless profiles are kept
    ):
        """Geometry of every (view, target); the threads of a view take its targets in turn."""
        view, lane = wp.tid()
        time_s = view_time_s[view]
        axes = view_axes[view]
        earth_velocity = linear_vector(earth_velocity_m_s, time_s, grid)
        observer = observer_of(time_s, grid, view_position_m[view], earth_velocity, view_velocity_m_s[view])
        sun_m = linear_vector(surroundings.sun_m, time_s, grid)
        sun_m_s = linear_rate(surroundings.sun_m, time_s, grid)
        for target_id in range(lane, targets.shape[0], n_lane):
            target = targets[target_id]
            path = path_from_target(position_m, velocity_m_s, presence, first_target + target_id, grid, observer)
            flag = int(0)
            place_px = wp.vec2d(wp.float64(-1.0e9), wp.float64(-1.0e9))
            if depth(axes, path.apparent) > wp.float64(0.0):
                place_px = projected_px(camera, axes, path.apparent)
                if within_frame(camera, place_px, wp.float64(0.0)):
                    flag = IN_FOV
            else:
                flag = BEHIND
            if is_occulted(observer.position_m, path.vector_m, surroundings.earth):
                flag = flag | OCCULTED
            if path.not_deployed != 0:
                flag = flag | NOT_DEPLOYED
            if path.absent != 0:
                flag = ABSENT
                place_px = wp.vec2d(wp.float64(-1.0e9), wp.float64(-1.0e9))

            towards_sensor = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))  # of a sensor at the target
            if path.range_m > wp.float64(0.0):
                towards_sensor = -path.vector_m / path.range_m
            passing = Passing()
            if wp.static(features.profile):
                passing.vector_m = path.vector_m
                passing.velocity_m_s = hermite_velocity_m_s(
                    position_m, velocity_m_s, first_target + target_id, path.emission_time_s, grid
                ) - (view_velocity_m_s[view] - earth_velocity)
            seen = signature(
                target,
                tables,
                exposure,
                surroundings,
                sun_m + sun_m_s * (path.emission_time_s - time_s),
                observer.position_m + path.vector_m,
                towards_sensor,
                path.emission_time_s,
                passing,
                area_series[view, target_id],
            )
            source_xy_px[view, target_id] = place_px
            range_m[view, target_id] = path.range_m
            aspect_rad[view, target_id] = seen.aspect_rad
            area_m2[view, target_id] = seen.area_m2
            if wp.static(features.sun):
                sun_area_m2[view, target_id] = seen.sun_area_m2
                sunlit[view, target_id] = seen.sunlit
            if wp.static(features.earth):
                earth_area_m2[view, target_id] = seen.earth_area_m2
            if wp.static(features.albedo):
                albedo_area_m2_sr[view, target_id] = seen.albedo_area_m2_sr
            temperature[view, target_id] = temperature_k(
                tables.temperatures, target.temperature_first, target.temperature_count, path.emission_time_s
            )
            flags[view, target_id] = flag

    return observe_targets_kernel
