"""Light curves of a target for many sets of its parameters, float64; their derivatives are in `light_curve_slopes`.

A thread takes views of one set in turn. The light is the sum of `signature` and `emission`, in their order, over views
that are there already.
"""

import functools

import warp as wp

from warpsim_kernels.curve_views import CurveView
from warpsim_kernels.earth_albedo import albedo_series_of
from warpsim_kernels.earth_infrared import earth_area_m2
from warpsim_kernels.emission import RadianceTable, Surfaces, band_radiance_w_m2_sr
from warpsim_kernels.motion import Attitude, axes_before_spin, spun
from warpsim_kernels.shapes import Body, body_projected_area_m2, body_reflected_area_m2
from warpsim_kernels.signature import ALBEDO, EARTH, EMITTED, SUN, Exposure, Features, Tables
from warpsim_kernels.timed_tables import table_quaternion, torque_free_axes, turned_axes

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_W_CM2_PER_W_M2 = wp.constant(wp.float64(1.0e-4))


@wp.struct
class CurveSet:
    """A set of parameters of a target."""

    body: Body
    attitude: Attitude
    scale: wp.float64  # of all lengths of the body
    start_k: wp.float64
    end_k: wp.float64
    range_offset_m: wp.float64


@wp.struct
class CurveScene:
    """What all sets share."""

    views: wp.array[CurveView]  # (n_view,)
    tables: Tables
    table_first: int  # row of the attitude tables where the target's begins
    table_count: int  # its rows; 0: the attitude says how it turns
    nutation_count: int  # rows of its nutation, where it turns freely
    patches: wp.array[Body]  # (n_patch,) facets of its patches
    phase_s: wp.float64  # time at which phases of motions count
    exposure: Exposure
    infrared_table: wp.array3d[wp.vec4d]
    surfaces: Surfaces  # of the target, with reflectance 1 where that has one number in each band; its patches' behind
    radiance: RadianceTable


@functools.cache
def axes_before_of(features: Features) -> wp.Function:
    """The function that turns the target, but for its spin; a new kind of attitude goes in here and in `rotations`."""

    @wp.func
    def axes_before(one: CurveSet, scene: CurveScene, time_s: wp.float64) -> wp.mat33d:
        """Axes of the body as rows, ICRS axes."""
        if wp.static(features.attitude_tables):
            first, count = scene.table_first, scene.table_count
            return turned_axes(table_quaternion(scene.tables.attitudes, first, count, time_s))
        if wp.static(features.torque_free):
            return torque_free_axes(one.attitude, scene.tables.nutations, 0, scene.nutation_count, time_s)
        return axes_before_spin(one.attitude, time_s - scene.phase_s)

    return axes_before


@functools.cache
def axes_after_of(features: Features) -> wp.Function:
    """The function that adds the spin, where that changes how the target looks."""

    @wp.func
    def axes_after(before: wp.mat33d, one: CurveSet, scene: CurveScene, time_s: wp.float64) -> wp.mat33d:
        """Axes of the body as rows, ICRS axes."""
        if wp.static(features.meshes and not (features.attitude_tables or features.torque_free)):
            if one.body.n_facet > 0:
                return spun(before, one.attitude, time_s - scene.phase_s)
        return before

    return axes_after


@wp.func
def per_intensity(one: CurveSet, seen: CurveView) -> wp.float64:
    """W/cm2 at the pupil for each W/sr, of a body of scale 1 that is `scale` times as large."""
    distance_m = wp.max(seen.range_m + one.range_offset_m, _ONE)
    return seen.visible * _W_CM2_PER_W_M2 / (distance_m * distance_m) * (one.scale * one.scale)


@wp.func
def with_body(one: CurveSet, body: Body) -> CurveSet:
    """A set with another body."""
    result = one
    result.body = body
    return result


@wp.func
def patch_weights(scene: CurveScene, kelvin: wp.float64, band: int, patch: int) -> wp.vec4d:
    """As `weights_of`, of a patch, whose surface is that of the scene."""
    column = patch + 1
    weights = wp.vec4d()
    radiance = band_radiance_w_m2_sr(scene.radiance, radiance_row(scene, band, column), kelvin)
    weights[EMITTED] = scene.surfaces.emissivity[band, column] * radiance
    weights[SUN] = scene.surfaces.sun_w_m2_sr[band, column]
    weights[EARTH] = scene.surfaces.earth_w_m2_sr[band, column]
    weights[ALBEDO] = scene.surfaces.albedo_w_m2_sr2[band, column]
    return weights


@wp.func
def weights_of(scene: CurveScene, radiance_w_m2_sr: wp.float64, optics: wp.vec2d, band: int) -> wp.vec4d:
    """Intensity in a band for each area of the terms; optics: emissivity and reflectance."""
    weights = wp.vec4d()
    weights[EMITTED] = optics[0] * radiance_w_m2_sr
    weights[SUN] = optics[1] * scene.surfaces.sun_w_m2_sr[band, 0]
    weights[EARTH] = optics[1] * scene.surfaces.earth_w_m2_sr[band, 0]
    weights[ALBEDO] = optics[1] * scene.surfaces.albedo_w_m2_sr2[band, 0]
    return weights


@wp.func
def radiance_row(scene: CurveScene, band: int, column: int) -> int:
    """Row of the radiance table for the target, column 0, or a patch."""
    row = band
    if scene.surfaces.radiance_row.shape[0] > 0:
        row = scene.surfaces.radiance_row[band, column]
    return row


@wp.func
def curve_kelvin(one: CurveSet, seen: CurveView) -> wp.float64:
    """Temperature of the target."""
    return seen.base_k + one.start_k + (one.end_k - one.start_k) * seen.part


@functools.cache
def make_light_curve_kernel(features: Features) -> wp.Kernel:
    """Kernel of the light by each set of parameters."""
    axes_before, axes_after = axes_before_of(features), axes_after_of(features)
    Harmonics, _, series_area_m2_sr = albedo_series_of(features.albedo_degree)

    @wp.func
    def areas_m2(
        one: CurveSet, scene: CurveScene, harmonics: wp.array[Harmonics], seen: CurveView, view: int
    ) -> wp.vec4d:
        """Areas of the terms, means over the exposure."""
        areas = wp.vec4d()
        facets = scene.tables.facets
        for k in range(scene.exposure.offset_s.shape[0]):
            weight = scene.exposure.weight[k]
            time_s = seen.emission_time_s + scene.exposure.offset_s[k]
            axes = axes_after(axes_before(one, scene, time_s), one, scene, time_s)
            to_sensor = axes * seen.to_sensor
            areas[EMITTED] += weight * body_projected_area_m2(one.body, facets, to_sensor)
            if wp.static(features.sun):
                if seen.sun_au2 > _ZERO:
                    lit = body_reflected_area_m2(one.body, facets, to_sensor, axes * seen.to_sun)
                    areas[SUN] += weight * lit
            if wp.static(features.earth):
                areas[EARTH] += weight * earth_area_m2(
                    scene.infrared_table, one.body, facets, to_sensor, axes * seen.nadir, seen.limb_sine
                )
            if wp.static(features.albedo):
                if seen.albedo_au2 > _ZERO:
                    areas[ALBEDO] += weight * series_area_m2_sr(
                        harmonics[view], one.body, facets, to_sensor, axes * seen.nadir, axes * seen.to_sun
                    )
        areas[SUN] *= seen.sun_au2
        areas[ALBEDO] *= seen.albedo_au2
        return areas

    @wp.kernel(module="unique", enable_backward=False)
    def light_curve_kernel(
        # in
        sets: wp.array[CurveSet],  # (n_set,)
        optics: wp.array2d[wp.vec2d],  # (n_set, n_band) emissivity and reflectance
        scene: CurveScene,
        harmonics: wp.array[Harmonics],  # (n_view,)
        threads_per_set: int,
        # out
        irradiance_w_cm2: wp.array3d[wp.float64],  # (n_set, n_view, n_band)
    ):
        """Irradiance at the pupil in each view, by each set."""
        number, thread = wp.tid()
        one = sets[number]
        for view in range(thread, irradiance_w_cm2.shape[1], threads_per_set):
            seen = scene.views[view]
            factor = per_intensity(one, seen)
            if factor > _ZERO:
                areas = areas_m2(one, scene, harmonics, seen, view)
                kelvin = curve_kelvin(one, seen)
                for band in range(irradiance_w_cm2.shape[2]):
                    radiance = band_radiance_w_m2_sr(scene.radiance, radiance_row(scene, band, 0), kelvin)
                    weights = weights_of(scene, radiance, optics[number, band], band)
                    irradiance_w_cm2[number, view, band] = factor * wp.dot(weights, areas)
                for patch in range(scene.patches.shape[0]):
                    areas = areas_m2(with_body(one, scene.patches[patch]), scene, harmonics, seen, view)
                    for band in range(irradiance_w_cm2.shape[2]):
                        radiance = band_radiance_w_m2_sr(scene.radiance, radiance_row(scene, band, 0), kelvin)
                        weights = patch_weights(scene, kelvin, band, patch)
                        weights -= weights_of(scene, radiance, optics[number, band], band)
                        irradiance_w_cm2[number, view, band] += factor * wp.dot(weights, areas)
            else:
                for band in range(irradiance_w_cm2.shape[2]):
                    irradiance_w_cm2[number, view, band] = _ZERO

    return light_curve_kernel
