"""Light curves of a target for many sets of its parameters, and their derivatives, float64.

A thread takes views of one set in turn. The light is the sum of `signature` and `emission`, in their order, over views
that are there already; its derivatives are closed forms (`area_slopes`, `earth_slopes`), not those of a tape.
"""

import functools

import warp as wp

from warpsim_kernels.area_slopes import AreaSlopes, ShapeVector, projected_slopes, reflected_slopes
from warpsim_kernels.curve_views import CurveView
from warpsim_kernels.earth_albedo import albedo_series_of
from warpsim_kernels.earth_infrared import earth_area_m2
from warpsim_kernels.earth_slopes import albedo_slopes_of, infrared_slopes
from warpsim_kernels.emission import RadianceTable, Surfaces, band_radiance_w_m2_sr
from warpsim_kernels.motion import Attitude, axes_before_spin, spun
from warpsim_kernels.shapes import Body, body_projected_area_m2, body_reflected_area_m2
from warpsim_kernels.signature import ALBEDO, EARTH, EMITTED, N_TERM, SUN, Exposure, Features, Tables
from warpsim_kernels.timed_tables import table_quaternion, turned_axes
from warpsim_kernels.torque_free import torque_free_axes

_ZERO = wp.constant(wp.float64(0.0))
_ONE = wp.constant(wp.float64(1.0))
_TWO = wp.constant(wp.float64(2.0))
_THREE = wp.constant(wp.float64(3.0))
_SIX = wp.constant(wp.float64(6.0))
_W_CM2_PER_W_M2 = wp.constant(wp.float64(1.0e-4))
_TWO_PI = wp.constant(wp.float64(6.283185307179586))
_RAD_PER_DEG = wp.constant(wp.float64(0.017453292519943295))

SPIN, PRECESSION, ROLLING, ANGLE_DEG, AXIS_RA_DEG, AXIS_DEC_DEG = (wp.constant(number) for number in (0, 2, 4, 6, 7, 8))
"""Rotations of a target: phases [rev], each followed by its rate [rev/s], and angles."""
N_ROTATION = 9
SHAPE, SCALE, START_K, END_K, OFFSET_K, RANGE, EMISSIVITY = (wp.constant(number) for number in range(9, 16))
"""Other columns of derivatives; EMISSIVITY and those behind it are of the bands."""

RotationVector = wp.types.vector(length=N_ROTATION, dtype=wp.float64)


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
