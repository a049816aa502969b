"""Projected and reflected areas of targets, float64.

Each term of a target's intensity is a radiance times an area, and only the radiance depends on the band. So the areas
are found once for all bands: the projected area for thermal emission, the reflected areas for light from outside. They
are means over the exposure, as a body that spins or tumbles changes its face during it.
"""

import functools
from typing import NamedTuple

import warp as wp

from warpsim_kernels.angles import angle_from_x
from warpsim_kernels.apparent import ASTRONOMICAL_UNIT_M
from warpsim_kernels.earth import Earth, geocentric_radius_m, sunlit_fraction
from warpsim_kernels.earth_albedo import albedo_series_of, is_dark
from warpsim_kernels.earth_infrared import earth_area_m2
from warpsim_kernels.motion import Attitude, axes_before_spin, spun
from warpsim_kernels.shapes import (
    Body,
    Facets,
    body_projected_area_m2,
    body_reflected_area_m2,
    projected_area_m2,
    reflected_area_m2,
)
from warpsim_kernels.timed_tables import (
    AttitudeTables,
    TemperatureTables,
    table_quaternion,
    torque_free_axes,
    turned_axes,
)


class Features(NamedTuple):
    """Parts of the stage that a kernel holds: a scene does not pay for what none of its targets needs."""

    attitude_tables: bool = False  # a target turns by a table
    meshes: bool = False  # a target is a mesh
    sun: bool = False  # reflected sunlight
    earth: bool = False  # reflected heat of the Earth
    albedo: bool = False  # reflected sunlight by way of the Earth
    albedo_degree: int = 4  # that by harmonics up to this degree
    profile: bool = False  # how areas change during the exposure, not their means alone
    distortion: bool = False  # the camera's lens distorts
    spectral: bool = False  # a target's surface is given by wavelength
    rolling: bool = False  # each target is seen at the time of its own row
    torque_free: bool = False  # a target turns freely by its moments of inertia
    patches: bool = False  # a target has patches of other surfaces


@wp.struct
class Target:
    """Shape, attitude and temperature of a target."""

    body: Body
    attitude: Attitude
    table_first: int  # row of the attitude tables where this target's begins
    table_count: int  # its rows; 0: `attitude` says how it turns
    temperature_first: int  # row of the temperature tables where this target's begins
    temperature_count: int  # its rows, at least 1
    nutation_first: int  # row of the nutations where this target's begins
    nutation_count: int  # its rows; 0: the body does not turn freely


@wp.struct
class Tables:
    """Rows that the targets share, one table behind the other."""

    attitudes: AttitudeTables
    facets: Facets
    temperatures: TemperatureTables
    nutations: wp.array2d[wp.quatd]  # (n_row, 2) one period behind the other


@wp.struct
class Exposure:
    """Quadrature over the exposure, about its middle: an odd number of nodes, the one in the middle at 0 s."""

    offset_s: wp.array[wp.float64]  # (n_exposure,)
    weight: wp.array[wp.float64]  # (n_exposure,) sum 1
    series: wp.array2d[wp.float64]  # (n_exposure, n_exposure) what makes Legendre coefficient l of the value at node k


@wp.struct
class Surroundings:
    """Light from outside on a target."""

    sun_m: wp.array[wp.vec3d]  # (n_node,) geocentric
    earth: Earth
    infrared_table: wp.array3d[wp.vec4d]  # (2, n_height - 1, n_cosine - 1) of the Earth's heat
    albedo_table: wp.array3d[wp.float64]  # (n_height, n_zenith, n_harmonic) of the sunlight that it reflects


@wp.struct
class RelativeMotion:
    """Motion of a target against a sensor."""

    vector_m: wp.vec3d  # sensor -> target in the middle of the exposure
    velocity_m_s: wp.vec3d  # of the target against the sensor


@wp.func
def range_factor(motion: RelativeMotion, offset_s: wp.float64) -> wp.float64:
    """By how much more light arrives than in the middle of the exposure, as the range changes."""
    then_m = motion.vector_m + motion.velocity_m_s * offset_s
    nearest_m2 = wp.float64(1.0)
    now_m2 = wp.max(wp.dot(motion.vector_m, motion.vector_m), nearest_m2)
    return now_m2 / wp.max(wp.dot(then_m, then_m), nearest_m2)


@wp.struct
class Signature:
    """Areas of a target towards a sensor."""

    aspect_rad: wp.float64  # in the middle of the exposure
    area_m2: wp.float64  # projected
    sunlit: wp.float64  # fraction of the Sun's disc that the target sees
    sun_area_m2: wp.float64  # reflects sunlight, per irradiance at 1 au
    earth_area_m2: wp.float64  # reflects the Earth's heat, per pi times radiance
    albedo_area_m2_sr: wp.float64  # reflects the Earth's sunlight, per albedo / pi times irradiance at 1 au


EMITTED = wp.constant(0)
SUN = wp.constant(1)
EARTH = wp.constant(2)
ALBEDO = wp.constant(3)
N_TERM = 4
"""Indices of the terms of a target's light along axes that hold all of them."""


@wp.func
def add_to_series(series: wp.array2d[wp.float64], term: int, exposure: Exposure, k: int, area_m2: wp.float64):
    """Take a term's area at node k into its Legendre series over the exposure."""
    for l in range(exposure.offset_s.shape[0]):
        series[term, l] += exposure.series[l, k] * area_m2


@wp.func
def scale_series(series: wp.array2d[wp.float64], term: int, factor: wp.float64):
    """Multiply a term's series."""
    for l in range(series.shape[1]):
        series[term, l] *= factor


@functools.cache
def signature_of(features: Features) -> wp.Function:
    """The function that finds a target's signature."""
    Harmonics, table_harmonics, series_area_m2_sr = albedo_series_of(features.albedo_degree)

    @wp.func
    def body_axes(target: Target, tables: Tables, time_s: wp.float64) -> wp.mat33d:
        """Axes of the body as rows, ICRS axes; spin is left out where it changes nothing."""
        if wp.static(features.attitude_tables):
            if target.table_count > 0:
                return turned_axes(table_quaternion(tables.attitudes, target.table_first, target.table_count, time_s))
        if wp.static(features.torque_free):
            if target.nutation_count > 0:
                return torque_free_axes(
                    target.attitude, tables.nutations, target.nutation_first, target.nutation_count, time_s
                )
        axes = axes_before_spin(target.attitude, time_s)
        if wp.static(features.meshes):
            if target.body.n_facet > 0:
                axes = spun(axes, target.attitude, time_s)
        return axes

    @wp.func
    def projected_m2(body: Body, tables: Tables, view: wp.vec3d) -> wp.float64:
        if wp.static(features.meshes):
            return body_projected_area_m2(body, tables.facets, view)
        return projected_area_m2(body, view[2], wp.sqrt(view[0] * view[0] + view[1] * view[1]))

    @wp.func
    def illuminated_m2(body: Body, tables: Tables, view: wp.vec3d, sun: wp.vec3d) -> wp.float64:
        if wp.static(features.meshes):
            return body_reflected_area_m2(body, tables.facets, view, sun)
        return reflected_area_m2(body, view, sun)

    @wp.func
    def signature(
        target: Target,
        tables: Tables,
        exposure: Exposure,
        surroundings: Surroundings,
        sun_m: wp.vec3d,  # geocentric
        place_m: wp.vec3d,  # of the target, geocentric
        towards_sensor: wp.vec3d,  # unit
        time_s: wp.float64,  # when the light left in the middle of the exposure
        motion: RelativeMotion,  # read if profiles are kept
        series: wp.array2d[wp.float64],  # (N_TERM, n_exposure) of this target's areas; written if profiles are kept
    ) -> Signature:
        seen = Signature()
        if wp.static(features.sun or features.albedo):
            to_sun_m = sun_m - place_m
            distance_au = wp.length(to_sun_m) / ASTRONOMICAL_UNIT_M
            towards_sun = wp.normalize(to_sun_m)
        if wp.static(features.sun):
            seen.sunlit = sunlit_fraction(place_m, to_sun_m, surroundings.earth)
        if wp.static(features.earth or features.albedo):
            distance_m = wp.length(place_m)
            nadir = -place_m / distance_m
            limb_sine = wp.min(geocentric_radius_m(place_m, surroundings.earth) / distance_m, wp.float64(1.0))
        if wp.static(features.albedo):
            sun_up = -wp.dot(nadir, towards_sun)
            sun_across = wp.length(wp.cross(nadir, towards_sun))
            dark = is_dark(limb_sine, sun_up, sun_across)
            light = Harmonics()
            if not dark:
                light = table_harmonics(surroundings.albedo_table, limb_sine, sun_up, sun_across)
        n_exposure = exposure.offset_s.shape[0]
        if wp.static(features.profile):
            for term in range(wp.static(N_TERM)):
                for l in range(n_exposure):
                    series[term, l] = wp.float64(0.0)
        for k in range(n_exposure):
            weight = exposure.weight[k]
            if wp.static(features.profile):
                factor = range_factor(motion, exposure.offset_s[k])
            axes = body_axes(target, tables, time_s + exposure.offset_s[k])
            view = axes * towards_sensor
            area_m2 = projected_m2(target.body, tables, view)
            seen.area_m2 += weight * area_m2
            if wp.static(features.profile):
                add_to_series(series, EMITTED, exposure, k, factor * area_m2)
            if 2 * k + 1 == n_exposure:
                seen.aspect_rad = angle_from_x(wp.sqrt(view[0] * view[0] + view[1] * view[1]), view[2])
            if wp.static(features.sun):
                if seen.sunlit > wp.float64(0.0):
                    sun_area_m2 = illuminated_m2(target.body, tables, view, axes * towards_sun)
                    seen.sun_area_m2 += weight * sun_area_m2
                    if wp.static(features.profile):
                        add_to_series(series, SUN, exposure, k, factor * sun_area_m2)
            if wp.static(features.earth):
                infrared_area_m2 = earth_area_m2(
                    surroundings.infrared_table, target.body, tables.facets, view, axes * nadir, limb_sine
                )
                seen.earth_area_m2 += weight * infrared_area_m2
                if wp.static(features.profile):
                    add_to_series(series, EARTH, exposure, k, factor * infrared_area_m2)
            if wp.static(features.albedo):
                if not dark:
                    albedo_area_m2_sr = series_area_m2_sr(
                        light, target.body, tables.facets, view, axes * nadir, axes * towards_sun
                    )
                    seen.albedo_area_m2_sr += weight * albedo_area_m2_sr
                    if wp.static(features.profile):
                        add_to_series(series, ALBEDO, exposure, k, factor * albedo_area_m2_sr)
        if wp.static(features.albedo):
            seen.albedo_area_m2_sr /= distance_au * distance_au
            if wp.static(features.profile):
                scale_series(series, ALBEDO, wp.float64(1.0) / (distance_au * distance_au))
        if wp.static(features.sun):
            seen.sun_area_m2 *= seen.sunlit / (distance_au * distance_au)
            if wp.static(features.profile):
                scale_series(series, SUN, seen.sunlit / (distance_au * distance_au))
        return seen

    return signature
