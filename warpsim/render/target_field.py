"""The targets of a scene on a device: what they are, how they turn, what lights them, and the kernels for that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.earth import Earth
from warpsim_kernels.emission import Surfaces, make_emit_kernel, make_profile_kernel
from warpsim_kernels.signature import Exposure, Features, Surroundings, Tables, Target
from warpsim_kernels.targets import make_observe_targets_kernel

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.legendre import series_matrix
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.radiometry.bands import band_radiance_w_m2_sr
from warpsim.render.turning import Turning, make_turning, motion_struct
from warpsim.render.warmth import Warmth, make_radiance, make_warmth
from warpsim.scene.exposure import exposure_rule
from warpsim.scene.scene import Scene
from warpsim.target.albedo_table import albedo_table
from warpsim.target.areas import body_struct
from warpsim.target.earthlight import albedo_method, rule_struct
from warpsim.target.facets import facets_of
from warpsim.target.heat_table import heat_method, heat_tables


@dataclass(frozen=True)
class TargetField:
    """What the stage observe_targets launches and reads, for some of a scene's bands."""

    n_target: int
    first_row: int
    """Row of the first target in the tracks."""
    features: Features
    in_shadow: bool
    """All targets are in the Earth's shadow throughout, so that the kernel does not ask."""
    targets: wp.array
    tables: Any
    exposure: Any
    surroundings: Any
    surfaces: Any
    radiance: Any
    n_profile: int
    """Coefficients of each target's brightness over the exposure; 0 where nothing asks for them."""
    n_lane: int
    """Threads that share the targets of a view: on the CPU one, which finds once what they have in common."""
    observe_kernel: wp.Kernel
    emit_kernel: wp.Kernel
    profile_kernel: wp.Kernel | None


def make_target_field(
    scene: Scene, bands: Sequence[str], device: wp.Device, with_profiles: bool = False
) -> TargetField:
    """Put the targets of a scene on a device; with_profiles, brightness is followed through exposures with streaks."""
    turning = make_turning(scene.attitudes, device)
    warmth = make_warmth(scene.temperatures, device)
    facets = facets_of([spec.shape for spec in scene.target_specs], device)
    earth_degree, n_earth = heat_method_of(scene)
    degree, n_albedo = albedo_method_of(scene)
    features = Features(
        attitude_tables=any(turning.table_count),
        meshes=any(facets.count),
        earth_degree=earth_degree,
        albedo_degree=degree,
        profile=with_profiles and scene.streaks,
        distortion=scene.camera.lens is not None,
        **{name: term.kept for name, term in scene.light_terms.items()},
    )
    exposure = _exposure(scene, device)
    tables: Any = Tables()
    tables.attitudes, tables.facets, tables.temperatures = turning.tables, facets.facets, warmth.tables
    return TargetField(
        len(scene.target_names),
        len(scene.sensor_names),
        features,
        scene.lighting.sun and scene.light_terms["sun"].bound_nei == 0.0,
        wp.array(_target_structs(scene, turning, warmth, facets.first), dtype=Target, device=device),
        tables,
        exposure,
        _surroundings(scene, (earth_degree, n_earth), (degree, n_albedo), device),
        _surfaces(scene, bands, device),
        make_radiance(bands, warmth.span_k, device),
        int(exposure.weight.shape[0]) if features.profile else 0,
        len(scene.target_names) if device.is_cuda else 1,
        make_observe_targets_kernel(features),
        make_emit_kernel(features),
        make_profile_kernel(features) if features.profile else None,
    )


def albedo_method_of(scene: Scene) -> tuple[int, int]:
    """Degree of the series, and nodes, for the scene's sunlight by way of the Earth; the same for all its bands."""
    lighting, term = scene.lighting, scene.light_terms["albedo"]
    if not term.kept:
        return 0, 1
    error = max(lighting.albedo_error, lighting.leave_out_nei / term.bound_nei)  # bound > 0, as it is kept
    return albedo_method(error, _smallest_limb_sine(scene))


def heat_method_of(scene: Scene) -> tuple[int, int]:
    """Degree of the polynomials, and nodes, for the Earth's heat; the same for all the scene's bands."""
    if not scene.light_terms["earth"].kept:
        return 0, 1
    return heat_method(scene.lighting.quadrature_error, _smallest_limb_sine(scene))


def _smallest_limb_sine(scene: Scene) -> float:
    far_m = max(float(np.linalg.norm(track.position_m, axis=1).max()) for track in scene.tracks.targets)
    return EARTH_POLAR_RADIUS_M / far_m


def _doubles(values: Any, device: wp.Device) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device=device)


def _target_structs(scene: Scene, turning: Turning, warmth: Warmth, first_facet: list[int]) -> list[Any]:
    structs = []
    for number, (spec, attitude) in enumerate(zip(scene.target_specs, scene.attitudes, strict=True)):
        target: Any = Target()
        target.body = body_struct(spec.shape, first_facet[number])
        target.attitude = motion_struct(attitude)
        target.table_first, target.table_count = turning.table_first[number], turning.table_count[number]
        target.temperature_first, target.temperature_count = warmth.first[number], warmth.count[number]
        structs.append(target)
    return structs


def _exposure(scene: Scene, device: wp.Device) -> Any:
    exposure: Any = Exposure()
    rule = exposure_rule(scene)
    exposure.offset_s, exposure.weight = _doubles(rule.offset_s, device), _doubles(rule.weight, device)
    exposure.series = _doubles(series_matrix(len(rule.weight)), device)
    return exposure


def _surroundings(scene: Scene, heat: tuple[int, int], albedo: tuple[int, int], device: wp.Device) -> Any:
    surroundings: Any = Surroundings()
    surroundings.sun_m = wp.array(scene.tracks.sun.position_m, dtype=wp.vec3d, device=device)
    surroundings.earth = earth_struct(scene)
    surroundings.earth_rule = rule_struct(heat[1], device)
    surroundings.heat = heat_tables(heat[0], device)
    surroundings.albedo_rule = rule_struct(albedo[1], device)
    surroundings.albedo_table = albedo_table(*albedo, device)
    return surroundings


def _surfaces(scene: Scene, bands: Sequence[str], device: wp.Device) -> Any:
    emissivity = np.array([[spec.surface.emissivity_in(name) for spec in scene.target_specs] for name in bands])
    reflectance, lighting = 1.0 - emissivity, scene.lighting
    sunlight = np.array([lighting.sun_w_m2_in(name) for name in bands])[:, None]
    heat = np.array([band_radiance_w_m2_sr(lighting.earth_k_in(name), name) for name in bands])[:, None]
    surfaces: Any = Surfaces()
    surfaces.emissivity = _doubles(emissivity, device)
    surfaces.sun_w_m2_sr = _doubles(reflectance / np.pi * sunlight, device)
    surfaces.earth_w_m2_sr = _doubles(reflectance * heat, device)
    surfaces.albedo_w_m2_sr2 = _doubles(reflectance / np.pi * lighting.earth_albedo / np.pi * sunlight, device)
    return surfaces


def earth_struct(scene: Scene) -> Any:
    """The Earth's ellipsoid about the pole of date, as the kernels' struct."""
    earth: Any = Earth()
    earth.pole = wp.vec3d(*scene.tracks.pole_icrs)
    earth.equatorial_radius_m = EARTH_EQUATORIAL_RADIUS_M
    earth.polar_radius_m = EARTH_POLAR_RADIUS_M
    return earth
