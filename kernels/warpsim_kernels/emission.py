"""Irradiance of targets in each band."""

import functools
from typing import NamedTuple

import warp as wp

from warpsim_kernels.records import DARK, Observation
from warpsim_kernels.signature import ALBEDO, EARTH, EMITTED, N_TERM, SUN, Features

_W_CM2_PER_W_M2 = wp.constant(wp.float64(1.0e-4))


@wp.struct
class RadianceTable:
    """In-band radiance as a cubic Hermite table of ln(radiance) against ln(T).

    The first rows are those of blackbodies, one for each band; as many follow for each surface given by wavelength.
    """

    ln_radiance: wp.array2d[wp.float64]  # (n_row, n_node)
    slope: wp.array2d[wp.float64]  # (n_row, n_node) d ln(radiance) / d ln(T) times the node step
    ln_temperature_start: wp.float64
    ln_temperature_step: wp.float64


@wp.func
def band_radiance_w_m2_sr(table: RadianceTable, row: int, temperature_k: wp.float64) -> wp.float64:
    """In-band radiance of a blackbody, or of a surface given by wavelength."""
    x = (wp.log(temperature_k) - table.ln_temperature_start) / table.ln_temperature_step
    node = wp.clamp(int(wp.floor(x)), 0, table.ln_radiance.shape[1] - 2)
    u = x - wp.float64(node)
    w = wp.float64(1.0) - u
    a = table.ln_radiance[row, node]
    b = table.ln_radiance[row, node + 1]
    bend = table.slope[row, node] * (u * w * w) - table.slope[row, node + 1] * (u * u * w)
    return wp.exp(a + (b - a) * (u * u * (wp.float64(3.0) - wp.float64(2.0) * u)) + bend)


@wp.struct
class Surfaces:
    """Emissivity and reflectance of the surfaces of targets and of their patches, each (n_band, n_target + n_patch)."""

    emissivity: wp.array2d[wp.float64]  # 1 for a surface given by wavelength, whose radiances include it
    radiance_row: wp.array2d[wp.int32]  # of the radiance table; (0, 0) where no surface is given by wavelength
    sun_w_m2_sr: wp.array2d[wp.float64]  # reflectance / pi times the Sun's irradiance at 1 au
    earth_w_m2_sr: wp.array2d[wp.float64]  # reflectance times the Earth's radiance
    albedo_w_m2_sr2: wp.array2d[wp.float64]  # reflectance / pi times albedo / pi times the Sun's irradiance at 1 au
    first_patch: wp.array[wp.int32]  # (n_target + 1,) columns of each target's patches, behind those of all targets


@wp.func
def irradiance_per_intensity(seen: Observation) -> wp.float64:
    """W/cm2 at the pupil for each W/sr; 0 when the target is occulted, not deployed or absent."""
    if (seen.flags & DARK) != 0:
        return wp.float64(0.0)
    distance_m = wp.max(seen.range_m, wp.float64(1.0))
    return _W_CM2_PER_W_M2 / (distance_m * distance_m)


@functools.cache
def emitted_of(spectral: bool) -> wp.Function:
    """Return the function of a target's thermal emission."""

    @wp.func
    def emitted_w_m2_sr(
        surfaces: Surfaces, table: RadianceTable, temperature_k: wp.float64, band: int, target: int
    ) -> wp.float64:
        """Intensity of the thermal emission for each square metre of projected area."""
        row = band
        if wp.static(spectral):
            row = surfaces.radiance_row[band, target]
        radiance = band_radiance_w_m2_sr(table, row, temperature_k)
        return surfaces.emissivity[band, target] * radiance

    return emitted_w_m2_sr


@functools.cache
def intensity_of(features: Features) -> wp.Function:
    """The function that sums the terms that the scene keeps, each an area times what the surface makes of it."""

    @wp.func
    def intensity_w_sr(
        surfaces: Surfaces,
        emitted_w_m2_sr: wp.float64,
        band: int,
        target: int,
        area_m2: wp.float64,
        sun_area_m2: wp.float64,
        earth_area_m2: wp.float64,
        albedo_area_m2_sr: wp.float64,
    ) -> wp.float64:
        intensity = emitted_w_m2_sr * area_m2
        if wp.static(features.sun):
            intensity += surfaces.sun_w_m2_sr[band, target] * sun_area_m2
        if wp.static(features.earth):
            intensity += surfaces.earth_w_m2_sr[band, target] * earth_area_m2
        if wp.static(features.albedo):
            intensity += surfaces.albedo_w_m2_sr2[band, target] * albedo_area_m2_sr
        return intensity

    return intensity_w_sr


class PatchFunctions(NamedTuple):
    """Functions of what patches change: each term by its area, the patch's surface less that of the body below it."""

    patch_w_sr: wp.Function
    """(surfaces, table, temperature_k, band, target, patch, areas by terms): terms of a patch's intensity."""
    patches_w_sr: wp.Function
    """(surfaces, table, seen by a view, band, target): terms of all of a target's patches."""


@functools.cache
def patches_of(features: Features) -> PatchFunctions:
    """The functions for the terms that the scene keeps."""
    emitted_w_m2_sr = emitted_of(features.spectral)

    @wp.func
    def patch_w_sr(
        surfaces: Surfaces,
        table: RadianceTable,
        temperature_k: wp.float64,
        band: int,
        target: int,
        patch: int,
        areas: wp.vec4d,
    ) -> wp.vec4d:
        more = wp.vec4d()
        own = emitted_w_m2_sr(surfaces, table, temperature_k, band, patch)
        more[EMITTED] = (own - emitted_w_m2_sr(surfaces, table, temperature_k, band, target)) * areas[EMITTED]
        if wp.static(features.sun):
            more[SUN] = (surfaces.sun_w_m2_sr[band, patch] - surfaces.sun_w_m2_sr[band, target]) * areas[SUN]
        if wp.static(features.earth):
            more[EARTH] = (surfaces.earth_w_m2_sr[band, patch] - surfaces.earth_w_m2_sr[band, target]) * areas[EARTH]
        if wp.static(features.albedo):
            change = surfaces.albedo_w_m2_sr2[band, patch] - surfaces.albedo_w_m2_sr2[band, target]
            more[ALBEDO] = change * areas[ALBEDO]
        return more

    @wp.func
    def patches_w_sr(
        surfaces: Surfaces, table: RadianceTable, seen: wp.array[Observation], band: int, target: int
    ) -> wp.vec4d:
        more = wp.vec4d()
        kelvin = seen[target].temperature_k
        for patch in range(surfaces.first_patch[target], surfaces.first_patch[target + 1]):
            one = seen[patch]
            areas = wp.vec4d(one.area_m2, one.sun_area_m2, one.earth_area_m2, one.albedo_area_m2_sr)
            more += patch_w_sr(surfaces, table, kelvin, band, target, patch, areas)
        return more

    return PatchFunctions(patch_w_sr, patches_w_sr)


@functools.cache
def irradiance_of(features: Features) -> wp.Function:
    """The function of a target's irradiance: intensity over range squared, summed over the terms that a scene keeps."""
    emitted_w_m2_sr, intensity_w_sr = emitted_of(features.spectral), intensity_of(features)

    @wp.func
    def irradiance_w_cm2(
        surfaces: Surfaces, table: RadianceTable, seen: Observation, band: int, target: int
    ) -> wp.float64:
        light_w_sr = intensity_w_sr(
            surfaces,
            emitted_w_m2_sr(surfaces, table, seen.temperature_k, band, target),
            band,
            target,
            seen.area_m2,
            seen.sun_area_m2,
            seen.earth_area_m2,
            seen.albedo_area_m2_sr,
        )
        return light_w_sr * irradiance_per_intensity(seen)

    return irradiance_w_cm2


@functools.cache
def make_profile_kernel(features: Features) -> wp.Kernel:
    """Kernel that turns the series of areas into one of brightness, in parts of its mean."""
    emitted_w_m2_sr, intensity_w_sr = emitted_of(features.spectral), intensity_of(features)
    patch_w_sr = patches_of(features).patch_w_sr

    @wp.kernel(module="unique", enable_backward=False)
    def profile_kernel(
        # in
        surfaces: Surfaces,
        table: RadianceTable,
        seen: wp.array2d[Observation],  # (n_view, n_target + n_patch)
        area_series: wp.array4d[wp.float64],  # (n_view, n_target + n_patch, N_TERM, n_exposure)
        # out
        brightness: wp.array4d[float],  # (n_view, n_band, n_target, n_exposure) Legendre coefficients, the first 1
    ):
        """Write each target's brightness over the exposure."""
        view, band, target = wp.tid()
        emitted = emitted_w_m2_sr(surfaces, table, seen[view, target].temperature_k, band, target)
        mean_w_sr = wp.float64(0.0)
        for l in range(brightness.shape[3]):
            light_w_sr = intensity_w_sr(
                surfaces,
                emitted,
                band,
                target,
                area_series[view, target, EMITTED, l],
                area_series[view, target, SUN, l],
                area_series[view, target, EARTH, l],
                area_series[view, target, ALBEDO, l],
            )
            if wp.static(features.patches):
                for patch in range(surfaces.first_patch[target], surfaces.first_patch[target + 1]):
                    areas = wp.vec4d(
                        area_series[view, patch, EMITTED, l],
                        area_series[view, patch, SUN, l],
                        area_series[view, patch, EARTH, l],
                        area_series[view, patch, ALBEDO, l],
                    )
                    more = patch_w_sr(surfaces, table, seen[view, target].temperature_k, band, target, patch, areas)
                    light_w_sr += more[0] + more[1] + more[2] + more[3]
            if l == 0:
                mean_w_sr = light_w_sr
            brightness[view, band, target, l] = float(0.0)
            if mean_w_sr > wp.float64(0.0):
                brightness[view, band, target, l] = float(light_w_sr / mean_w_sr)
        brightness[view, band, target, 0] = 1.0

    return profile_kernel


@functools.cache
def make_split_kernel(features: Features) -> wp.Kernel:
    """Kernel that gives the terms of the irradiance one by one, for the truth; those left out stay as they are."""
    emitted_w_m2_sr, patches_w_sr = emitted_of(features.spectral), patches_of(features).patches_w_sr

    @wp.kernel(module="unique", enable_backward=False)
    def split_kernel(
        # in
        surfaces: Surfaces,
        table: RadianceTable,
        seen: wp.array2d[Observation],  # (n_view, n_target + n_patch)
        # out
        irradiance_w_cm2: wp.array4d[wp.float64],  # (N_TERM, n_view, n_band, n_target)
    ):
        """Irradiance at the pupil by each term."""
        view, band, target = wp.tid()
        target_seen = seen[view, target]
        scale = irradiance_per_intensity(target_seen)
        emitted = emitted_w_m2_sr(surfaces, table, target_seen.temperature_k, band, target)
        irradiance_w_cm2[EMITTED, view, band, target] = scale * (emitted * target_seen.area_m2)
        if wp.static(features.sun):
            sun_w_sr = surfaces.sun_w_m2_sr[band, target] * target_seen.sun_area_m2
            irradiance_w_cm2[SUN, view, band, target] = scale * sun_w_sr
        if wp.static(features.earth):
            earth_w_sr = surfaces.earth_w_m2_sr[band, target] * target_seen.earth_area_m2
            irradiance_w_cm2[EARTH, view, band, target] = scale * earth_w_sr
        if wp.static(features.albedo):
            albedo_w_sr = surfaces.albedo_w_m2_sr2[band, target] * target_seen.albedo_area_m2_sr
            irradiance_w_cm2[ALBEDO, view, band, target] = scale * albedo_w_sr
        if wp.static(features.patches):
            more = patches_w_sr(surfaces, table, seen[view], band, target)
            for term in range(wp.static(N_TERM)):
                irradiance_w_cm2[term, view, band, target] += scale * more[term]

    return split_kernel
