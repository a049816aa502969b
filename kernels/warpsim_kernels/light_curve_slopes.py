"""Derivatives of light curves by parameters of their target, float64: closed forms, not those of a tape.

A thread takes views of one set in turn, as in `light_curve`. Derivatives of areas are in `area_slopes` and
`earth_slopes`; here they are summed over the exposure and the terms, by parameter.
"""

import functools

import warp as wp

from warpsim_kernels.area_slopes import AreaSlopes, ShapeVector, projected_slopes, reflected_slopes
from warpsim_kernels.curve_views import CurveView
from warpsim_kernels.earth_albedo import albedo_series_of
from warpsim_kernels.earth_slopes import albedo_slopes_of, infrared_slopes
from warpsim_kernels.emission import RadianceTable
from warpsim_kernels.light_curve import (
    CurveScene,
    CurveSet,
    axes_after_of,
    axes_before_of,
    curve_kelvin,
    patch_weights,
    per_intensity,
    radiance_row,
    weights_of,
    with_body,
)
from warpsim_kernels.motion import Attitude
from warpsim_kernels.signature import ALBEDO, EARTH, EMITTED, N_TERM, SUN, Features

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_THREE = wp.constant(wp.float64(3.0))
_SIX = wp.constant(wp.float64(6.0))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_RAD_PER_DEG = wp.constant(wp.float64(0.017453292519943295))

SPIN, PRECESSION, ROLLING, ANGLE_DEG, AXIS_RA_DEG, AXIS_DEC_DEG = (wp.constant(number) for number in (0, 2, 4, 6, 7, 8))
"""Rotations of a target: phases [rev], each followed by its rate [rev/s], and angles."""
N_ROTATION = 9
SHAPE, SCALE, START_K, END_K, OFFSET_K, RANGE, EMISSIVITY = (wp.constant(number) for number in range(9, 16))
"""Other columns of derivatives; EMISSIVITY and those behind it are of the bands."""

RotationVector = wp.types.vector(length=N_ROTATION, dtype=wp.float64)
Rotations = wp.types.matrix(shape=(N_TERM, N_ROTATION), dtype=wp.float64)
Shapes = wp.types.matrix(shape=(N_TERM, 6), dtype=wp.float64)


@wp.struct
class TermSlopes:
    """Areas of the terms, means over the exposure, and what they change by with rotations and with the shape."""

    area_m2: wp.vec4d
    rotation: Rotations
    shape: Shapes


@wp.func
def rotations(torque: wp.vec3d, roll_axis: wp.vec3d, attitude: Attitude, since_s: wp.float64) -> RotationVector:
    """What an area changes by with each rotation; torque: its change with a small turn of the body, ICRS axes."""
    out = RotationVector()
    out[PRECESSION] = wp.dot(torque, attitude.reference) * _TWO_PI
    out[PRECESSION + 1] = out[PRECESSION] * since_s
    rolled = wp.dot(torque, roll_axis)
    out[ROLLING] = rolled * _TWO_PI
    out[ROLLING + 1] = out[ROLLING] * since_s
    out[ANGLE_DEG] = rolled * _RAD_PER_DEG
    out[AXIS_RA_DEG] = torque[2] * _RAD_PER_DEG
    out[AXIS_DEC_DEG] = wp.dot(torque, attitude.second) * _RAD_PER_DEG
    return out


@wp.func
def add_term(
    sums: TermSlopes,
    term: int,
    weight: wp.float64,
    slopes: AreaSlopes,
    before: wp.mat33d,
    axes: wp.mat33d,
    attitude: Attitude,
    since_s: wp.float64,
) -> TermSlopes:
    """Add the area of a term at an instant of the exposure; axes before and after the spin."""
    turned = rotations(wp.transpose(axes) * slopes.torque, before[1], attitude, since_s)
    turned[SPIN] = slopes.torque[2] * _TWO_PI
    turned[SPIN + 1] = turned[SPIN] * since_s
    result = sums
    result.area_m2[term] = sums.area_m2[term] + weight * slopes.area_m2
    result.rotation[term] = sums.rotation[term] + weight * turned
    result.shape[term] = sums.shape[term] + weight * slopes.shape
    return result


@wp.func
def band_radiance_slope(table: RadianceTable, row: int, temperature_k: wp.float64) -> wp.vec2d:
    """As `band_radiance_w_m2_sr`, and its change with the temperature."""
    x = (wp.log(temperature_k) - table.ln_temperature_start) / table.ln_temperature_step
    node = wp.clamp(int(wp.floor(x)), 0, table.ln_radiance.shape[1] - 2)
    u = x - wp.float64(node)
    w = _ONE - u
    rise = table.ln_radiance[row, node + 1] - table.ln_radiance[row, node]
    first = table.slope[row, node]
    second = table.slope[row, node + 1]
    bend = first * (u * w * w) - second * (u * u * w)
    radiance = wp.exp(table.ln_radiance[row, node] + rise * (u * u * (_THREE - _TWO * u)) + bend)
    slope = _SIX * rise * u * w + first * w * (w - _TWO * u) - second * u * (_TWO * w - u)
    return wp.vec2d(radiance, radiance * slope / (table.ln_temperature_step * temperature_k))


@functools.cache
def term_slopes_of(features: Features) -> wp.Function:
    """The function of all terms' areas in a view."""
    axes_before, axes_after = axes_before_of(features), axes_after_of(features)
    Harmonics = albedo_series_of(features.albedo_degree).Harmonics
    albedo_slopes = albedo_slopes_of(features.albedo_degree)

    @wp.func
    def term_slopes(
        one: CurveSet, scene: CurveScene, harmonics: wp.array[Harmonics], seen: CurveView, view: int
    ) -> TermSlopes:
        sums = TermSlopes()
        facets = scene.tables.facets
        for k in range(scene.exposure.offset_s.shape[0]):
            weight = scene.exposure.weight[k]
            time_s = seen.emission_time_s + scene.exposure.offset_s[k]
            before = axes_before(one, scene, time_s)
            axes = axes_after(before, one, scene, time_s)
            since_s = time_s - scene.phase_s
            to_sensor = axes * seen.to_sensor
            slopes = projected_slopes(one.body, facets, to_sensor)
            sums = add_term(sums, EMITTED, weight, slopes, before, axes, one.attitude, since_s)
            if wp.static(features.sun):
                if seen.sun_au2 > _ZERO:
                    slopes = reflected_slopes(one.body, facets, to_sensor, axes * seen.to_sun)
                    sums = add_term(sums, SUN, weight * seen.sun_au2, slopes, before, axes, one.attitude, since_s)
            if wp.static(features.earth):
                nadir = axes * seen.nadir
                slopes = infrared_slopes(scene.infrared_table, one.body, facets, to_sensor, nadir, seen.limb_sine)
                sums = add_term(sums, EARTH, weight, slopes, before, axes, one.attitude, since_s)
            if wp.static(features.albedo):
                if seen.albedo_au2 > _ZERO:
                    slopes = albedo_slopes(
                        harmonics[view], one.body, facets, to_sensor, axes * seen.nadir, axes * seen.level
                    )
                    sums = add_term(sums, ALBEDO, weight * seen.albedo_au2, slopes, before, axes, one.attitude, since_s)
        return sums

    return term_slopes


@wp.struct
class Columns:
    """Parameters that derivatives are taken for."""

    kind: wp.array[wp.int32]  # (n_param,) SPIN to EMISSIVITY + band
    shape: wp.array2d[ShapeVector]  # (n_set, n_param) change of the Body's members, for those of SHAPE


@wp.struct
class BandSlopes:
    """Irradiance in a band and what it changes by."""

    light: wp.float64
    rotation: RotationVector
    shape: ShapeVector
    by_kelvin: wp.float64
    by_emissivity: wp.float64


@wp.func
def target_slopes(
    scene: CurveScene, kelvin: wp.float64, optics: wp.vec2d, band: int, terms: TermSlopes, factor: wp.float64
) -> BandSlopes:
    """Light by areas of the target's own surface."""
    radiance = band_radiance_slope(scene.radiance, radiance_row(scene, band, 0), kelvin)
    weights = weights_of(scene, radiance[0], optics, band) * factor
    slopes = BandSlopes()
    slopes.light = wp.dot(weights, terms.area_m2)
    slopes.rotation = weights * terms.rotation
    slopes.shape = weights * terms.shape
    slopes.by_kelvin = factor * optics[0] * radiance[1] * terms.area_m2[EMITTED]
    unit = weights_of(scene, radiance[0], wp.vec2d(_ONE, -_ONE), band) * factor
    slopes.by_emissivity = wp.dot(unit, terms.area_m2)
    return slopes


@wp.func
def patch_slopes(
    scene: CurveScene,
    kelvin: wp.float64,
    optics: wp.vec2d,
    band: int,
    patch: int,
    terms: TermSlopes,
    factor: wp.float64,
) -> BandSlopes:
    """Light of a patch less that of the target's own surface below it."""
    below = target_slopes(scene, kelvin, optics, band, terms, factor)
    weights = patch_weights(scene, kelvin, band, patch) * factor
    rise = band_radiance_slope(scene.radiance, radiance_row(scene, band, patch + 1), kelvin)[1]
    own_kelvin = factor * scene.surfaces.emissivity[band, patch + 1] * rise * terms.area_m2[EMITTED]
    slopes = BandSlopes()
    slopes.light = wp.dot(weights, terms.area_m2) - below.light
    slopes.rotation = weights * terms.rotation - below.rotation
    slopes.by_kelvin = own_kelvin - below.by_kelvin
    slopes.by_emissivity = -below.by_emissivity
    return slopes


@wp.func
def column_slope(
    columns: Columns, number: int, column: int, one: CurveSet, seen: CurveView, band: int, slopes: BandSlopes
) -> wp.float64:
    """Change of the irradiance in a band with one parameter."""
    kind = columns.kind[column]
    if kind < N_ROTATION:
        return slopes.rotation[kind]
    if kind == SHAPE:
        return wp.dot(slopes.shape, columns.shape[number, column])
    if kind == SCALE:
        return _TWO * slopes.light / one.scale
    if kind == START_K:
        return slopes.by_kelvin * (_ONE - seen.part)
    if kind == END_K:
        return slopes.by_kelvin * seen.part
    if kind == OFFSET_K:
        return slopes.by_kelvin
    if kind == RANGE:
        return -_TWO * slopes.light / wp.max(seen.range_m + one.range_offset_m, _ONE)
    if kind == EMISSIVITY + band:
        return slopes.by_emissivity
    return _ZERO


@functools.cache
def make_light_curve_slopes_kernel(features: Features) -> wp.Kernel:
    """Kernel of the light by each set of parameters, and of what it changes by with each of them."""
    term_slopes = term_slopes_of(features)
    Harmonics = albedo_series_of(features.albedo_degree).Harmonics

    @wp.kernel(module="unique", enable_backward=False)
    def light_curve_slopes_kernel(
        # in
        sets: wp.array[CurveSet],  # (n_set,)
        optics: wp.array2d[wp.vec2d],  # (n_set, n_band) emissivity and reflectance
        scene: CurveScene,
        harmonics: wp.array[Harmonics],  # (n_view,)
        columns: Columns,
        threads_per_set: int,
        # out
        irradiance_w_cm2: wp.array3d[wp.float64],  # (n_set, n_view, n_band)
        slope: wp.array4d[wp.float64],  # (n_set, n_view, n_band, n_param)
    ):
        """Irradiance at the pupil in each view by each set, and its derivatives."""
        number, thread = wp.tid()
        one = sets[number]
        for view in range(thread, irradiance_w_cm2.shape[1], threads_per_set):
            seen = scene.views[view]
            factor = per_intensity(one, seen)
            terms = TermSlopes()
            if factor > _ZERO:
                terms = term_slopes(one, scene, harmonics, seen, view)
            kelvin = curve_kelvin(one, seen)
            for band in range(irradiance_w_cm2.shape[2]):
                slopes = target_slopes(scene, kelvin, optics[number, band], band, terms, factor)
                irradiance_w_cm2[number, view, band] = slopes.light
                for column in range(slope.shape[3]):
                    slope[number, view, band, column] = column_slope(columns, number, column, one, seen, band, slopes)
            if factor > _ZERO:
                for patch in range(scene.patches.shape[0]):
                    terms = term_slopes(with_body(one, scene.patches[patch]), scene, harmonics, seen, view)
                    for band in range(irradiance_w_cm2.shape[2]):
                        slopes = patch_slopes(scene, kelvin, optics[number, band], band, patch, terms, factor)
                        irradiance_w_cm2[number, view, band] += slopes.light
                        for column in range(slope.shape[3]):
                            change = column_slope(columns, number, column, one, seen, band, slopes)
                            slope[number, view, band, column] += change

    return light_curve_slopes_kernel
