"""Stage observe_targets: where each target is seen, what of it, and how bright it is."""

import functools

import warp as wp

from warpsim_kernels.apparent import LightPath, Observer, Tracks, observer_of, path_from_target
from warpsim_kernels.camera import Camera, depth, projection, within_frame
from warpsim_kernels.earth import is_occulted
from warpsim_kernels.emission import RadianceTable, Surfaces, irradiance_of, irradiance_per_intensity, patches_of
from warpsim_kernels.motion import hermite_velocity_m_s, linear_rate, linear_vector
from warpsim_kernels.records import ABSENT, BEHIND, IN_FOV, NOT_DEPLOYED, OCCULTED, Observation, Sources, View
from warpsim_kernels.shapes import Body
from warpsim_kernels.signature import (
    Exposure,
    Features,
    RelativeMotion,
    Signature,
    Surroundings,
    Tables,
    Target,
    signature_of,
)
from warpsim_kernels.timed_tables import temperature_k


@wp.struct
class Bodies:
    """The targets of a scene and what surrounds them."""

    targets: wp.array[Target]  # (n_target,)
    patches: wp.array[Body]  # (n_patch,) facets of the patches of all targets
    tables: Tables
    exposure: Exposure
    surroundings: Surroundings
    surfaces: Surfaces
    radiance: RadianceTable


@wp.func
def towards_sensor(path: LightPath) -> wp.vec3d:
    """Unit vector from a target to the sensor; any for a sensor at the target."""
    if path.range_m > wp.float64(0.0):
        return -path.vector_m / path.range_m
    return wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))


@wp.func
def with_areas(seen: Observation, areas: Signature) -> Observation:
    """An observation with the areas of a signature."""
    result = seen
    result.aspect_rad = areas.aspect_rad
    result.area_m2 = areas.area_m2
    result.sunlit = areas.sunlit
    result.sun_area_m2 = areas.sun_area_m2
    result.earth_area_m2 = areas.earth_area_m2
    result.albedo_area_m2_sr = areas.albedo_area_m2_sr
    return result


@wp.func
def with_body(target: Target, body: Body) -> Target:
    """A target with another body."""
    result = target
    result.body = body
    return result


@wp.func
def in_its_row(seen: Observation, camera: Camera, xy_px: wp.vec2d) -> Observation:
    """An observation at the position where its row has the target; behind the camera, and absent, as it is."""
    result = seen
    if (seen.flags & (ABSENT | BEHIND)) == 0:
        result.xy_px = xy_px
        result.flags = seen.flags & ~IN_FOV
        if within_frame(camera, xy_px, wp.float64(0.0)):
            result.flags = seen.flags | IN_FOV
    return result


@functools.cache
def projected_target_of(distortion: bool) -> wp.Function:
    """The function that begins a target's observation: where it is seen."""
    projected_px = projection(distortion)

    @wp.func
    def projected_target(
        camera: Camera, axes: wp.mat33d, observer: Observer, path: LightPath, bodies: Bodies
    ) -> Observation:
        seen = Observation()
        seen.range_m = path.range_m
        seen.xy_px = wp.vec2d(wp.float64(-1.0e9), wp.float64(-1.0e9))
        if path.absent != 0:
            seen.flags = ABSENT
            return seen
        if depth(axes, path.apparent) > wp.float64(0.0):
            seen.xy_px = projected_px(camera, axes, path.apparent)
            if within_frame(camera, seen.xy_px, wp.float64(0.0)):
                seen.flags = IN_FOV
        else:
            seen.flags = BEHIND
        if is_occulted(observer.position_m, path.vector_m, bodies.surroundings.earth):
            seen.flags = seen.flags | OCCULTED
        if path.not_deployed != 0:
            seen.flags = seen.flags | NOT_DEPLOYED
        return seen

    return projected_target


@functools.cache
def seen_areas_of(features: Features) -> wp.Function:
    """The function that completes an observation by the areas that a target shows."""
    signature = signature_of(features)

    @wp.func
    def seen_areas(
        seen: Observation,
        target: Target,
        bodies: Bodies,
        sun_m: wp.vec3d,
        observer_m: wp.vec3d,
        path: LightPath,
        motion: RelativeMotion,
        series: wp.array2d[wp.float64],
    ) -> Observation:
        areas = signature(
            target,
            bodies.tables,
            bodies.exposure,
            bodies.surroundings,
            sun_m,
            observer_m + path.vector_m,
            towards_sensor(path),
            path.emission_time_s,
            motion,
            series,
        )
        return with_areas(seen, areas)

    return seen_areas


@functools.cache
def make_observe_targets_kernel(features: Features) -> wp.Kernel:
    """Kernel of the stage; its code holds what the scene's targets need."""
    projected_target = projected_target_of(features.distortion)
    seen_areas, irradiance_w_cm2 = seen_areas_of(features), irradiance_of(features)
    patches_w_sr = patches_of(features).patches_w_sr

    @wp.kernel(module="unique", enable_backward=False)
    def observe_targets_kernel(
        # in
        view_time_s: wp.array[wp.float64],  # (n_view,); of each target's row, (n_view * n_target,), where rows differ
        views: wp.array[View],  # alike
        tracks: Tracks,
        bodies: Bodies,
        camera: Camera,
        threads_per_view: int,
        # out
        sources: Sources,  # first slots: xy_px, irradiance_w_cm2
        observations: wp.array2d[Observation],  # (n_view, n_target + n_patch)
        irradiance: wp.array3d[float],  # (n_view, n_band, n_target) as in sources, for the truth
        area_series: wp.array4d[wp.float64],  # (same, N_TERM, n_exposure); empty unless profiles are kept
    ):
        """Geometry and light of every (view, target); the threads of a view take its targets in turn."""
        view, thread = wp.tid()
        own = view
        if wp.static(features.rolling):
            own = view * threads_per_view + thread  # of the thread's only target
        time_s = view_time_s[own]
        camera_at = views[own]
        earth_m_s = linear_vector(tracks.earth_velocity_m_s, time_s, tracks.grid)
        observer = observer_of(time_s, camera_at.position_m, earth_m_s, camera_at.velocity_m_s)
        sun_m = linear_vector(bodies.surroundings.sun_m, time_s, tracks.grid)
        sun_m_s = linear_rate(bodies.surroundings.sun_m, time_s, tracks.grid)
        for number in range(thread, bodies.targets.shape[0], threads_per_view):
            target = bodies.targets[number]
            body = tracks.first_target + number
            path = path_from_target(tracks, body, observer)
            seen = projected_target(camera, camera_at.axes, observer, path, bodies)
            if wp.static(features.rolling):
                seen = in_its_row(seen, camera, sources.xy_px[view, number])
            motion = RelativeMotion()
            if wp.static(features.profile):
                motion.vector_m = path.vector_m
                body_m_s = hermite_velocity_m_s(tracks.nodes, body, path.emission_time_s)
                motion.velocity_m_s = body_m_s - (camera_at.velocity_m_s - earth_m_s)
            seen.temperature_k = temperature_k(
                bodies.tables.temperatures, target.temperature_first, target.temperature_count, path.emission_time_s
            )
            sun_then_m = sun_m + sun_m_s * (path.emission_time_s - time_s)
            seen = seen_areas(
                seen, target, bodies, sun_then_m, observer.position_m, path, motion, area_series[view, number]
            )
            observations[view, number] = seen
            if wp.static(features.patches):
                for k in range(bodies.surfaces.first_patch[number], bodies.surfaces.first_patch[number + 1]):
                    patch = with_body(target, bodies.patches[k - bodies.targets.shape[0]])
                    observations[view, k] = seen_areas(
                        seen, patch, bodies, sun_then_m, observer.position_m, path, motion, area_series[view, k]
                    )
            sources.xy_px[view, number] = seen.xy_px
            for band in range(irradiance.shape[1]):
                light_w_cm2 = irradiance_w_cm2(bodies.surfaces, bodies.radiance, seen, band, number)
                if wp.static(features.patches):
                    more = patches_w_sr(bodies.surfaces, bodies.radiance, observations[view], band, number)
                    light_w_cm2 += (more[0] + more[1] + more[2] + more[3]) * irradiance_per_intensity(seen)
                    light_w_cm2 = wp.max(light_w_cm2, wp.float64(0.0))  # facets end where smooth bodies do, but nearly
                light = float(light_w_cm2)
                sources.irradiance_w_cm2[view, band, number] = light
                irradiance[view, band, number] = light

    return observe_targets_kernel
