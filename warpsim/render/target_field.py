"""The targets of a scene on a device: what they are, how they turn, what lights them, and the kernels for that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.earth import Earth
from warpsim_kernels.emission import RadianceTable, Surfaces, make_emit_kernel, make_split_kernel
from warpsim_kernels.signature import Exposure, Features, Surroundings, Tables, Target
from warpsim_kernels.targets import make_observe_targets_kernel

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.render.turning import Turning, make_turning, motion_struct
from warpsim.scene.exposure import exposure_rule
from warpsim.scene.scene import Scene
from warpsim.sky.bands import BANDS, band_radiance_w_m2_sr
from warpsim.sky.sunlight import sun_irradiance_w_m2
from warpsim.target.areas import body_struct
from warpsim.target.facets import facets_of

LN_TEMPERATURE_STEP = 0.005
"""Node spacing of the radiance table in ln(T): the cubic Hermite error is below 1e-9 at 300 K and above."""


@dataclass(frozen=True)
class TargetField:
    """What the stage observe_targets launches and reads, for some of a scene's bands."""

    n_target: int
    first_row: int
    """Row of the first target in the tracks."""
    features: Features
    targets: wp.array
    tables: Any
    exposure: Any
    surroundings: Any
    surfaces: Any
    radiance: Any
    observe_kernel: wp.Kernel
    emit_kernel: wp.Kernel
    split_kernel: wp.Kernel


def make_target_field(scene: Scene, bands: Sequence[str], device: wp.Device) -> TargetField:
    """Put the targets of a scene on a device."""
    turning = make_turning(scene.attitudes, device)
    facets = facets_of([spec.shape for spec in scene.target_specs], device)
    features = Features(
        attitude_tables=any(turning.table_count),
        meshes=any(facets.count),
        sun=scene.light_terms["sun"].kept,
    )
    tables: Any = Tables()
    tables.attitudes, tables.facets = turning.tables, facets.facets
    return TargetField(
        len(scene.target_names),
        len(scene.sensor_names),
        features,
        wp.array(_target_structs(scene, turning, facets.first), dtype=Target, device=device),
        tables,
        _exposure(scene, device),
        _surroundings(scene, device),
        _surfaces(scene, bands, device),
        radiance_table(scene, bands, device),
        make_observe_targets_kernel(features),
        make_emit_kernel(features),
        make_split_kernel(features),
    )


def _doubles(values: Any, device: wp.Device) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device=device)


def _target_structs(scene: Scene, turning: Turning, first_facet: list[int]) -> list[Any]:
    structs = []
    for number, (spec, attitude) in enumerate(zip(scene.target_specs, scene.attitudes, strict=True)):
        target: Any = Target()
        target.body = body_struct(spec.shape, first_facet[number])
        target.attitude = motion_struct(attitude)
        target.table_first, target.table_count = turning.table_first[number], turning.table_count[number]
        target.start_temperature_k = spec.temperature.start_k
        target.end_temperature_k = spec.temperature.end_k or spec.temperature.start_k
        target.cooling_start_s = 0.0
        target.cooling_duration_s = scene.duration_s
        structs.append(target)
    return structs


def _exposure(scene: Scene, device: wp.Device) -> Any:
    exposure: Any = Exposure()
    rule = exposure_rule(scene)
    exposure.offset_s, exposure.weight = _doubles(rule.offset_s, device), _doubles(rule.weight, device)
    return exposure


def _surroundings(scene: Scene, device: wp.Device) -> Any:
    surroundings: Any = Surroundings()
    surroundings.sun_m = wp.array(scene.tracks.sun.position_m, dtype=wp.vec3d, device=device)
    surroundings.earth = earth_struct(scene)
    return surroundings


def _surfaces(scene: Scene, bands: Sequence[str], device: wp.Device) -> Any:
    emissivity = np.array([[spec.surface.emissivity_value for spec in scene.target_specs]] * len(bands))
    reflected = (1.0 - emissivity) / np.pi
    sunlight = np.array([sun_irradiance_w_m2(name) for name in bands])[:, None]
    surfaces: Any = Surfaces()
    surfaces.emissivity = _doubles(emissivity, device)
    surfaces.sun_w_m2_sr = _doubles(reflected * sunlight, device)
    return surfaces


def radiance_table(scene: Scene, bands: Sequence[str], device: wp.Device) -> Any:
    """ln(radiance) and its scaled slope at nodes of ln(T) that span the scene's temperatures."""
    all_k = [t for spec in scene.targets for t in (spec.temperature.start_k, spec.temperature.end_k) if t is not None]
    start = float(np.log(min(all_k))) - LN_TEMPERATURE_STEP
    n_node = int(np.ceil((np.log(max(all_k)) - start) / LN_TEMPERATURE_STEP)) + 2
    ln_temperature = start + LN_TEMPERATURE_STEP * np.arange(n_node)

    def ln_radiance(shift: float) -> Any:
        kelvin = np.exp(ln_temperature + shift)
        # A body of some kelvin has no light in a short band: far below any NEI, but its logarithm must stay finite.
        radiance = [np.maximum(band_radiance_w_m2_sr(kelvin, BANDS[name]), 1e-300) for name in bands]
        return np.log(np.stack(radiance))

    h = 1e-3  # fourth-order difference: its error stays below the table's own
    slope = (8 * (ln_radiance(h) - ln_radiance(-h)) - (ln_radiance(2 * h) - ln_radiance(-2 * h))) / (12 * h)
    table: Any = RadianceTable()
    table.ln_radiance, table.slope = _doubles(ln_radiance(0.0), device), _doubles(slope * LN_TEMPERATURE_STEP, device)
    table.ln_temperature_start, table.ln_temperature_step = start, LN_TEMPERATURE_STEP
    return table


def earth_struct(scene: Scene) -> Any:
    """The Earth's ellipsoid about the pole of date, as the kernels' struct."""
    earth: Any = Earth()
    earth.pole = wp.vec3d(*scene.tracks.pole_icrs)
    earth.equatorial_radius_m = EARTH_EQUATORIAL_RADIUS_M
    earth.polar_radius_m = EARTH_EQUATORIAL_RADIUS_M * (1 - EARTH_FLATTENING)
    return earth
