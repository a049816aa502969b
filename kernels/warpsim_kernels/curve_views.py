"""What a light curve has at each time whatever the target's parameters: directions, range, the Sun, the Earth; float64.

It is found once for a curve by the functions that find the light of frames, so that both agree.
"""

import functools

import warp as wp

from warpsim_kernels.apparent import ASTRONOMICAL_UNIT_M, Tracks, observer_of, path_from_target
from warpsim_kernels.earth import geocentric_radius_m, is_occulted, sunlit_fraction
from warpsim_kernels.earth_albedo import albedo_series_of, is_dark
from warpsim_kernels.motion import linear_rate, linear_vector
from warpsim_kernels.records import View
from warpsim_kernels.signature import Features
from warpsim_kernels.targets import Bodies, towards_sensor
from warpsim_kernels.timed_tables import temperature_k

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_NO_AZIMUTH = wp.constant(wp.float64(1.0e-12))  # as in earth_albedo


@wp.struct
class CurveView:
    """A sensor at a time, as the target sees it; directions are unit vectors, ICRS axes."""

    to_sensor: wp.vec3d
    to_sun: wp.vec3d
    nadir: wp.vec3d
    level: wp.vec3d  # horizontal direction of the Sun
    emission_time_s: wp.float64
    range_m: wp.float64
    visible: wp.float64  # 1; 0 where occulted, not deployed or absent
    sun_au2: wp.float64  # part of the Sun's disc that the target sees over its distance squared
    albedo_au2: wp.float64  # 1 over that distance squared; 0 where all the ground in view is in the night
    limb_sine: wp.float64
    base_k: wp.float64  # temperature that the parameters of temperature are added to
    part: wp.float64  # of the temperature's span that has gone by


@wp.struct
class TargetOfCurve:
    """Which target a curve is of."""

    number: int
    has_base: int  # not 0: temperatures are added to those of its table
    start_s: wp.float64  # span of its temperature
    end_s: wp.float64


@functools.cache
def make_curve_views_kernel(features: Features) -> wp.Kernel:
    """Kernel that fills the views of a light curve, for the terms of light that a scene keeps."""
    Harmonics, table_harmonics, _ = albedo_series_of(features.albedo_degree)

    @wp.kernel(module="unique", enable_backward=False)
    def curve_views_kernel(
        # in
        time_s: wp.array[wp.float64],  # (n_view,)
        views: wp.array[View],  # alike
        tracks: Tracks,
        bodies: Bodies,
        chosen: TargetOfCurve,
        # out
        curve_views: wp.array[CurveView],  # (n_view,)
        harmonics: wp.array[Harmonics],  # (n_view,) of the Earth's sunlight; empty without that term
    ):
        """Write what each view has of the target."""
        view = wp.tid()
        camera_at = views[view]
        earth_m_s = linear_vector(tracks.earth_velocity_m_s, time_s[view], tracks.grid)
        observer = observer_of(time_s[view], camera_at.position_m, earth_m_s, camera_at.velocity_m_s)
        path = path_from_target(tracks, tracks.first_target + chosen.number, observer)
        place_m = observer.position_m + path.vector_m
        sun_m = linear_vector(bodies.surroundings.sun_m, time_s[view], tracks.grid)
        sun_m += linear_rate(bodies.surroundings.sun_m, time_s[view], tracks.grid) * (
            path.emission_time_s - time_s[view]
        )
        earth = bodies.surroundings.earth
        seen = CurveView()
        seen.to_sensor = towards_sensor(path)
        seen.emission_time_s = path.emission_time_s
        seen.range_m = path.range_m
        hidden = is_occulted(observer.position_m, path.vector_m, earth)
        seen.visible = wp.where(hidden or path.not_deployed != 0 or path.absent != 0, _ZERO, _ONE)
        to_sun_m = sun_m - place_m
        distance_au = wp.length(to_sun_m) / ASTRONOMICAL_UNIT_M
        seen.to_sun = wp.normalize(to_sun_m)
        distance_m = wp.length(place_m)
        seen.nadir = -place_m / distance_m
        seen.limb_sine = wp.min(geocentric_radius_m(place_m, earth) / distance_m, _ONE)
        if wp.static(features.sun):
            seen.sun_au2 = sunlit_fraction(place_m, to_sun_m, earth) / (distance_au * distance_au)
        if wp.static(features.albedo):
            up = -wp.dot(seen.nadir, seen.to_sun)
            across = wp.length(wp.cross(seen.nadir, seen.to_sun))
            level = seen.to_sun + seen.nadir * up
            seen.level = level / wp.max(wp.length(level), _NO_AZIMUTH)
            if not is_dark(seen.limb_sine, up, across):
                seen.albedo_au2 = _ONE / (distance_au * distance_au)
                harmonics[view] = table_harmonics(bodies.surroundings.albedo_table, seen.limb_sine, up, across)
        target = bodies.targets[chosen.number]
        if chosen.has_base != 0:
            first, count = target.temperature_first, target.temperature_count
            seen.base_k = temperature_k(bodies.tables.temperatures, first, count, path.emission_time_s)
        if chosen.end_s > chosen.start_s:
            part = (path.emission_time_s - chosen.start_s) / (chosen.end_s - chosen.start_s)
            seen.part = wp.clamp(part, _ZERO, _ONE)
        curve_views[view] = seen

    return curve_views_kernel
