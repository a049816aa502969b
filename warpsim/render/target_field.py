"""Targets of a scene on a device: bodies, attitudes, light and the kernels for that."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.earth import Earth
from warpsim_kernels.emission import RadianceTable, Surfaces, make_profile_kernel
from warpsim_kernels.motion import Attitude as AttitudeStruct
from warpsim_kernels.shapes import Body
from warpsim_kernels.signature import Exposure, Features, Surroundings, Tables, Target
from warpsim_kernels.targets import Bodies, make_observe_targets_kernel
from warpsim_kernels.timed_tables import AttitudeTables, TemperatureTables

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.legendre import series_matrix
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band, band_radiance_w_m2_sr
from warpsim.scene.environment import Lighting
from warpsim.scene.exposure import ExposureRule
from warpsim.scene.instrument import Instrument
from warpsim.scene.light_terms import LightTerm
from warpsim.scene.scenario import Scenario
from warpsim.scene.target_histories import AnyAttitude
from warpsim.scene.tracks import Tracks
from warpsim.target.areas import body_struct, facets_of
from warpsim.target.attitude import BodyMotion
from warpsim.target.earth_light import albedo_degree, albedo_table, infrared_table
from warpsim.target.patches import patch_areas
from warpsim.target.surface import Graybody, Light
from warpsim.target.temperature import TemperatureRows
from warpsim.target.torque_free import Nutation, TorqueFreeMotion

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TargetField:
    """Kernel and arrays of the stage observe_targets, for some of a scene's bands."""

    features: Features
    in_shadow: bool
    """All targets are in the Earth's shadow throughout, so that the kernel does not ask."""
    bodies: Any
    """The kernels' Bodies."""
    n_patch: int
    """Patches of all targets."""
    n_profile: int
    """Coefficients of each target's brightness over the exposure; 0 where nothing asks for them."""
    threads_per_view: int
    """On the CPU one, which finds once what a view's targets have in common, unless each has a time of its own."""
    observe_kernel: wp.Kernel
    profile_kernel: wp.Kernel | None


def make_target_field(
    scenario: Scenario, instrument: Instrument, bands: Sequence[str], device: wp.Device, with_profiles: bool = False
) -> TargetField:
    """Put the targets of a scene on a device, as an instrument sees them."""
    attitudes, attitude_spans = make_attitudes(scenario.attitudes, device)
    nutations, nutation_spans = make_nutations(scenario.attitudes, device)
    temperatures, temperature_spans, span_k = make_temperatures(scenario.temperatures, device)
    targets, terms = scenario.targets, instrument.light_terms
    own_bands = [instrument.bands[name] for name in bands]
    patches = [patch_areas(target.spec.shape, target.spec.patches) for target in targets]
    parts: list[Any] = [*(target.spec.shape for target in targets), *itertools.chain(*patches)]
    facets = facets_of(parts, device)
    farthest_m = [float(np.linalg.norm(track.position_m, axis=1).max()) for track in scenario.tracks.targets]
    limb_sine = EARTH_POLAR_RADIUS_M / max(farthest_m, default=EARTH_EQUATORIAL_RADIUS_M)
    lighting = scenario.scene.lighting
    degree = _albedo_degree(lighting, terms["albedo"], limb_sine)
    own = [target.spec.surface for target in targets] + [s for target in targets for s in target.spec.surfaces[1:]]
    spectral = list(dict.fromkeys(surface for surface in own if surface.is_spectral))
    streaks, rolling = instrument.sensor.streaks, with_profiles and instrument.sensor.rolls
    features = Features(
        attitude_tables=any(count for _, count in attitude_spans),
        torque_free=any(count for _, count in nutation_spans),
        meshes=any(facets.count),
        patches=any(patches),
        albedo_degree=degree,
        profile=with_profiles and streaks,
        distortion=instrument.sensor.camera.lens is not None,
        spectral=bool(spectral),
        rolling=rolling,
        **{name: term.kept for name, term in terms.items()},
    )
    exposure = _exposure(instrument.exposure_rule, device)
    tables: Any = Tables()
    tables.attitudes, tables.facets, tables.temperatures = attitudes, facets.facets, temperatures
    tables.nutations = nutations
    structs = _target_structs(scenario, attitude_spans, temperature_spans, nutation_spans, facets.first)
    bodies: Any = Bodies()
    bodies.targets = wp.array(structs, dtype=Target, device=device)
    bodies.tables, bodies.exposure = tables, exposure
    bodies.surroundings = _surroundings(scenario.tracks, features, device)
    bodies.patches = wp.array(
        [body_struct(part, first) for part, first in list(zip(parts, facets.first, strict=True))[len(targets) :]],
        dtype=Body, device=device,
    )  # fmt: skip
    bodies.surfaces = surfaces_struct(own, spectral, lighting, own_bands, device)
    first_patch = len(targets) + np.cumsum([0, *map(len, patches)])
    bodies.surfaces.first_patch = wp.array(first_patch, dtype=wp.int32, device=device)
    bodies.radiance = make_radiance(own_bands, span_k, device, spectral)
    return TargetField(
        features,
        lighting.sun and terms["sun"].bound_nei == 0.0,
        bodies,
        len(parts) - len(targets),
        int(exposure.weight.shape[0]) if features.profile else 0,
        max(len(targets), 1) if device.is_cuda or rolling else 1,
        make_observe_targets_kernel(features),
        make_profile_kernel(features) if features.profile else None,
    )


def _albedo_degree(lighting: Lighting, term: LightTerm, limb_sine: float) -> int:
    """Degree of albedo's series, the same for all bands: rougher where the term is faint."""
    error = max(lighting.albedo_error, lighting.leave_out_nei / term.bound_nei) if term.kept else 1.0
    return albedo_degree(error, limb_sine)


def _doubles(values: Any, device: wp.Device) -> wp.array:
    return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device=device)


def _target_structs(
    scenario: Scenario,
    attitude_spans: list[tuple[int, int]],
    temperature_spans: list[tuple[int, int]],
    nutation_spans: list[tuple[int, int]],
    first_facet: list[int],
) -> list[Any]:
    structs = []
    for number, (one, attitude) in enumerate(zip(scenario.targets, scenario.attitudes, strict=True)):
        target: Any = Target()
        target.body = body_struct(one.spec.shape, first_facet[number])
        target.attitude = motion_struct(attitude)
        target.table_first, target.table_count = attitude_spans[number]
        target.temperature_first, target.temperature_count = temperature_spans[number]
        target.nutation_first, target.nutation_count = nutation_spans[number]
        structs.append(target)
    return structs


def _exposure(rule: ExposureRule, device: wp.Device) -> Any:
    exposure: Any = Exposure()
    exposure.offset_s, exposure.weight = _doubles(rule.offset_s, device), _doubles(rule.weight, device)
    exposure.series = _doubles(series_matrix(len(rule.weight)), device)
    return exposure


def _surroundings(tracks: Tracks, features: Features, device: wp.Device) -> Any:
    surroundings: Any = Surroundings()
    surroundings.sun_m = wp.array(tracks.sun.position_m, dtype=wp.vec3d, device=device)
    surroundings.earth = earth_struct(tracks.pole_icrs)
    infrared = infrared_table() if features.earth else np.zeros((0, 0, 0, 4))
    albedo = albedo_table(features.albedo_degree) if features.albedo else np.zeros((0, 0, 0))
    surroundings.infrared_table = wp.array(infrared, dtype=wp.vec4d, device=device)
    surroundings.albedo_table = _doubles(albedo, device)
    return surroundings


def surfaces_struct(
    own: Sequence[Graybody],
    spectral: Sequence[Graybody],
    lighting: Lighting,
    bands: Sequence[Band],
    device: wp.Device,
) -> Any:
    """Return the optical properties of surfaces; `spectral` are the different ones by wavelength."""
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


def _rows_once(tables: Sequence[Any]) -> tuple[list[Any], list[tuple[int, int]]]:
    """Return the different ones of tables of rows in time, and where the rows of each lie among theirs: first, count.

    What has no rows, as it moves by itself, is (0, 0).
    """
    distinct: dict[int, Any] = {}
    first: dict[int, int] = {}
    n_row = 0
    for table in tables:
        if hasattr(table, "time_s") and id(table) not in distinct:
            distinct[id(table)], first[id(table)] = table, n_row
            n_row += len(table.time_s)
    return list(distinct.values()), [
        (first[id(table)], len(table.time_s)) if id(table) in distinct else (0, 0) for table in tables
    ]


def make_attitudes(attitudes: Sequence[AnyAttitude], device: wp.Device) -> tuple[Any, list[tuple[int, int]]]:
    """Put the attitude tables of all targets on a device, each once; return them, and first row and count of each."""
    distinct, spans = _rows_once(attitudes)
    tables: Any = AttitudeTables()
    tables.time_s = _doubles(np.concatenate([np.zeros(0), *(rows.time_s for rows in distinct)]), device)
    quaternion = np.concatenate([np.zeros((0, 4)), *(rows.quaternion for rows in distinct)])
    tables.quaternion = wp.array(quaternion, dtype=wp.quatd, device=device)
    return tables, spans


def make_nutations(attitudes: Sequence[AnyAttitude], device: wp.Device) -> tuple[wp.array, list[tuple[int, int]]]:
    """Put the nutations of all targets that turn freely on a device, each once; return first row and count of each."""
    own = [attitude.nutation if isinstance(attitude, TorqueFreeMotion) else None for attitude in attitudes]
    first: dict[Nutation | None, tuple[int, int]] = {None: (0, 0)}
    rows, n_row = [np.zeros((0, 2, 4))], 0
    for nutation in dict.fromkeys(own):
        if nutation is not None:
            first[nutation] = n_row, len(nutation.quaternion)
            rows.append(np.stack([nutation.quaternion, nutation.step], axis=1))
            n_row += len(nutation.quaternion)
    return wp.array(np.concatenate(rows), dtype=wp.quatd, device=device), [first[nutation] for nutation in own]


def motion_struct(attitude: AnyAttitude) -> Any:
    """A motion as the kernels' struct; for a table, one that is not read."""
    struct: Any = AttitudeStruct()
    if isinstance(attitude, TorqueFreeMotion):
        struct.reference, struct.first, struct.second = (wp.vec3d(*axis) for axis in attitude.axes)
        struct.precession_rev_s = attitude.nutation.precession_rev_s
        struct.spin_rev_s = attitude.nutation.rate_rev_s
    if not isinstance(attitude, BodyMotion):
        return struct
    motion = attitude.attitude
    struct.reference, struct.first, struct.second = (wp.vec3d(*axis) for axis in attitude.axes)
    struct.tilt_rad = float(np.radians(motion.precession_angle_deg))
    struct.precession_rev_s = motion.precession_rev_s
    struct.precession_phase_rev = attitude.precession_phase_rev
    struct.rolling_rev_s = motion.rolling_rev_s
    struct.rolling_phase_rev = attitude.rolling_phase_rev
    struct.spin_rev_s = motion.spin_rev_s
    struct.spin_phase_rev = attitude.spin_phase_rev
    return struct


LN_TEMPERATURE_STEP = 0.005
"""Node spacing of the radiance table in ln(T): the cubic Hermite error is below 1e-9 at 300 K and above."""

DARKEST_W_M2_SR = 1e-300
"""Stands for less in the radiance table: a body of some kelvin has no light in a short band, which has no logarithm."""


_NO_TARGET_K = 300.0  # of a scene without targets, whose radiances nobody asks for


def make_temperatures(
    temperatures: Sequence[TemperatureRows], device: wp.Device
) -> tuple[Any, list[tuple[int, int]], tuple[float, float]]:
    """Put the temperatures of all targets on a device, each once.

    Return them, first row and count of each target, and the lowest and the highest [K].
    """
    distinct, spans = _rows_once(temperatures)
    kelvin = np.concatenate([np.zeros(0), *(rows.temperature_k for rows in distinct)])
    tables: Any = TemperatureTables()
    tables.time_s = _doubles(np.concatenate([np.zeros(0), *(rows.time_s for rows in distinct)]), device)
    tables.temperature_k = _doubles(kelvin, device)
    return tables, spans, (float(kelvin.min()), float(kelvin.max())) if distinct else (_NO_TARGET_K, _NO_TARGET_K)


def make_radiance(
    bands: Sequence[Band | str], span_k: tuple[float, float], device: wp.Device, surfaces: Sequence[Graybody] = ()
) -> Any:
    """Put ln(radiance) and its scaled slope at nodes of ln(T) on a device, each (n_row, n_node).

    Args:
        bands: Bands; the first rows are those of blackbodies in them.
        span_k: Lowest and highest temperature that the nodes span [K].
        device: Where they are put.
        surfaces: Surfaces by wavelength; rows of the radiance that each emits in the bands follow.
    """
    start = float(np.log(span_k[0])) - LN_TEMPERATURE_STEP
    n_node = int(np.ceil((np.log(span_k[1]) - start) / LN_TEMPERATURE_STEP)) + 2
    ln_temperature = start + LN_TEMPERATURE_STEP * np.arange(n_node)
    chosen = [as_band(band) for band in bands]

    def ln_radiance(shift: float) -> npt.NDArray[np.float64]:
        kelvin = np.exp(ln_temperature + shift)
        black = [band_radiance_w_m2_sr(kelvin, band) for band in chosen]
        own = [surface.emitted_w_m2_sr(kelvin, band) for surface in surfaces for band in chosen]
        return np.asarray(np.log(np.maximum(np.stack([*black, *own]), DARKEST_W_M2_SR)))

    h = 1e-3  # fourth-order difference: its error stays below the table's own
    slope = (8 * (ln_radiance(h) - ln_radiance(-h)) - (ln_radiance(2 * h) - ln_radiance(-2 * h))) / (12 * h)
    table: Any = RadianceTable()
    table.ln_temperature_start, table.ln_temperature_step = start, LN_TEMPERATURE_STEP
    table.ln_radiance = wp.array(ln_radiance(0.0), dtype=wp.float64, device=device)
    table.slope = wp.array(slope * LN_TEMPERATURE_STEP, dtype=wp.float64, device=device)
    return table
