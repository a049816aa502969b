"""Targets of a scene on a device: bodies, attitudes, light and the kernels for that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.earth import Earth
from warpsim_kernels.emission import Surfaces, make_profile_kernel
from warpsim_kernels.signature import Exposure, Features, Surroundings, Tables, Target
from warpsim_kernels.targets import Bodies, make_observe_targets_kernel

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.legendre import series_matrix
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.render.attitude_arrays import AttitudeArrays, make_attitudes, motion_struct
from warpsim.render.temperature_arrays import TemperatureArrays, make_radiance, make_temperatures
from warpsim.scene.exposure import ExposureRule
from warpsim.scene.instrument import Instrument
from warpsim.scene.light_terms import LightTerm
from warpsim.scene.lighting import Lighting
from warpsim.scene.scenario import Scenario
from warpsim.scene.targets import SceneTarget
from warpsim.scene.tracks import Tracks
from warpsim.target.albedo_table import albedo_table
from warpsim.target.areas import body_struct
from warpsim.target.earth_radiation import albedo_method, rule_struct
from warpsim.target.facets import facets_of
from warpsim.target.heat_table import heat_method, heat_tables
from warpsim.target.surface import Graybody, Light

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TargetField:
    """Kernel and arrays of the stage observe_targets, for some of a scene's bands."""

    features: Features
    in_shadow: bool
    """All targets are in the Earth's shadow throughout, so that the kernel does not ask."""
    bodies: Any
    """The kernels' Bodies."""
    n_profile: int
    """Coefficients of each target's brightness over the exposure; 0 where nothing asks for them."""
    threads_per_view: int
    """On the CPU one, which finds once what a view's targets have in common."""
    observe_kernel: wp.Kernel
    profile_kernel: wp.Kernel | None


def make_target_field(
    scenario: Scenario, instrument: Instrument, bands: Sequence[str], device: wp.Device, with_profiles: bool = False
) -> TargetField:
    """Put the targets of a scene on a device, as an instrument sees them.

    Args:
        scenario: What the scene gives.
        instrument: The kind of sensor.
        bands: Names of the bands, in the order of the images.
        device: Where everything is put.
        with_profiles: Whether brightness is followed through exposures with streaks.
    """
    attitudes = make_attitudes(scenario.attitudes, device)
    temperatures = make_temperatures(scenario.temperatures, device)
    targets, terms = scenario.targets, instrument.light_terms
    own_bands = [instrument.bands[name] for name in bands]
    facets = facets_of([target.spec.shape for target in targets], device)
    farthest_m = [float(np.linalg.norm(track.position_m, axis=1).max()) for track in scenario.tracks.targets]
    limb_sine = EARTH_POLAR_RADIUS_M / max(farthest_m, default=EARTH_EQUATORIAL_RADIUS_M)
    lighting = scenario.scene.lighting
    earth_degree, n_earth = earth_method(lighting, terms["earth"], limb_sine)
    albedo_degree, n_albedo = albedo_series(lighting, terms["albedo"], limb_sine)
    spectral = list(dict.fromkeys(target.spec.surface for target in targets if target.spec.surface.is_spectral))
    streaks = instrument.sensor.streaks
    features = Features(
        attitude_tables=any(attitudes.table_count),
        meshes=any(facets.count),
        earth_degree=earth_degree,
        albedo_degree=albedo_degree,
        profile=with_profiles and streaks,
        distortion=instrument.sensor.camera.lens is not None,
        spectral=bool(spectral),
        **{name: term.kept for name, term in terms.items()},
    )
    exposure = _exposure(instrument.exposure_rule, device)
    tables: Any = Tables()
    tables.attitudes, tables.facets, tables.temperatures = attitudes.tables, facets.facets, temperatures.tables
    structs = _target_structs(scenario, attitudes, temperatures, facets.first)
    bodies: Any = Bodies()
    bodies.targets = wp.array(structs, dtype=Target, device=device)
    bodies.tables, bodies.exposure = tables, exposure
    bodies.surroundings = _surroundings(scenario.tracks, (earth_degree, n_earth), (albedo_degree, n_albedo), device)
    bodies.surfaces = _surfaces(targets, spectral, lighting, own_bands, device)
    bodies.radiance = make_radiance(own_bands, temperatures.span_k, device, spectral)
    return TargetField(
        features,
        lighting.sun and terms["sun"].bound_nei == 0.0,
        bodies,
        int(exposure.weight.shape[0]) if features.profile else 0,
        max(len(targets), 1) if device.is_cuda else 1,
        make_observe_targets_kernel(features),
        make_profile_kernel(features) if features.profile else None,
    )


def albedo_series(lighting: Lighting, term: LightTerm, limb_sine: float) -> tuple[int, int]:
    """Return the degree of the series, and nodes, for sunlight reflected by the Earth; the same for all bands."""
    if not term.kept:
        return 0, 1
    error = max(lighting.albedo_error, lighting.leave_out_nei / term.bound_nei)  # bound > 0, as it is kept
    return albedo_method(error, limb_sine)


def earth_method(lighting: Lighting, term: LightTerm, limb_sine: float) -> tuple[int, int]:
    """Return the degree of the polynomials, and nodes, for the Earth's infrared; the same for all bands."""
    return heat_method(lighting.quadrature_error, limb_sine) if term.kept else (0, 1)


def _doubles(values: Any, device: wp.Device) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device=device)


def _target_structs(
    scenario: Scenario, attitudes: AttitudeArrays, temperatures: TemperatureArrays, first_facet: list[int]
) -> list[Any]:
    structs = []
    for number, (one, attitude) in enumerate(zip(scenario.targets, scenario.attitudes, strict=True)):
        target: Any = Target()
        target.body = body_struct(one.spec.shape, first_facet[number])
        target.attitude = motion_struct(attitude)
        target.table_first, target.table_count = attitudes.table_first[number], attitudes.table_count[number]
        target.temperature_first = temperatures.first[number]
        target.temperature_count = temperatures.count[number]
        structs.append(target)
    return structs


def _exposure(rule: ExposureRule, device: wp.Device) -> Any:
    exposure: Any = Exposure()
    exposure.offset_s, exposure.weight = _doubles(rule.offset_s, device), _doubles(rule.weight, device)
    exposure.series = _doubles(series_matrix(len(rule.weight)), device)
    return exposure


def _surroundings(tracks: Tracks, heat: tuple[int, int], albedo: tuple[int, int], device: wp.Device) -> Any:
    surroundings: Any = Surroundings()
    surroundings.sun_m = wp.array(tracks.sun.position_m, dtype=wp.vec3d, device=device)
    surroundings.earth = earth_struct(tracks.pole_icrs)
    surroundings.earth_rule = rule_struct(heat[1], device)
    surroundings.heat = heat_tables(heat[0], device)
    surroundings.albedo_rule = rule_struct(albedo[1], device)
    surroundings.albedo_table = albedo_table(*albedo, device)
    return surroundings


def _surfaces(
    targets: Sequence[SceneTarget],
    spectral: Sequence[Graybody],
    lighting: Lighting,
    bands: Sequence[Band],
    device: wp.Device,
) -> Any:
    """Return the optical properties of the targets' surfaces; `spectral` are the different ones by wavelength."""
    own = [target.spec.surface for target in targets]
    different = {surface: number for number, surface in enumerate(dict.fromkeys(own))}
    which = np.array([different[surface] for surface in own], dtype=np.intp)

    def per_band(value: Callable[[Graybody, Band], float]) -> F64:
        values = np.array([[value(surface, band) for surface in different] for band in bands])
        return values.reshape(len(bands), len(different))[:, which]

    def reflectance(light: Light) -> F64:
        return per_band(
            lambda surface, band: (
                surface.reflectance_in(band, light) if surface.is_spectral else 1.0 - surface.emissivity_in(band)
            )
        )

    sunlight = np.array([lighting.sun_w_m2_in(band) for band in bands])[:, None]
    albedo = np.array([lighting.earth_albedo_in(band) for band in bands])[:, None]
    heat = np.array([band_radiance_w_m2_sr(lighting.earth_k_in(band), band) for band in bands])[:, None]
    surfaces: Any = Surfaces()
    surfaces.emissivity = _doubles(per_band(lambda s, band: 1.0 if s.is_spectral else s.emissivity_in(band)), device)
    surfaces.radiance_row = wp.array(_radiance_rows(own, spectral, len(bands)), dtype=wp.int32, device=device)
    surfaces.sun_w_m2_sr = _doubles(reflectance("sun") / np.pi * sunlight, device)
    surfaces.earth_w_m2_sr = _doubles(reflectance("earth") * heat, device)
    surfaces.albedo_w_m2_sr2 = _doubles(reflectance("albedo") / np.pi * albedo / np.pi * sunlight, device)
    return surfaces


def _radiance_rows(own: Sequence[Graybody], spectral: Sequence[Graybody], n_band: int) -> npt.NDArray[np.int32]:
    """Rows of the radiance table, (n_band, n_target); empty where no surface is given by wavelength."""
    if not spectral:
        return np.zeros((0, 0), dtype=np.int32)
    first_row = {surface: n_band * (1 + number) for number, surface in enumerate(spectral)}
    first = [first_row.get(surface, 0) for surface in own]
    return np.asarray(np.arange(n_band)[:, None] + np.array(first), dtype=np.int32)


def earth_struct(pole_icrs: npt.NDArray[np.float64]) -> Any:
    """Return the Earth's ellipsoid about the pole of date, as the kernels' struct."""
    earth: Any = Earth()
    earth.pole = wp.vec3d(*pole_icrs)
    earth.equatorial_radius_m = EARTH_EQUATORIAL_RADIUS_M
    earth.polar_radius_m = EARTH_POLAR_RADIUS_M
    return earth
