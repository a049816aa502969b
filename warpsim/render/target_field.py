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
from warpsim_kernels.signature import Exposure, Features, Surroundings, Tables, Target
from warpsim_kernels.targets import Bodies, make_observe_targets_kernel
from warpsim_kernels.timed_tables import AttitudeTables, TemperatureTables

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.launches import struct_of
from warpsim.legendre import series_matrix
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band, band_radiance_w_m2_sr
from warpsim.scene.environment import Lighting
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
from warpsim.target.torque_free import TorqueFreeMotion

Span = tuple[int, int]


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
    weight = instrument.exposure_rule.weight
    first_patch = len(targets) + np.cumsum([0, *map(len, patches)])
    bodies = struct_of(
        Bodies,
        device,
        targets=_target_structs(scenario, attitude_spans, temperature_spans, nutation_spans, facets.first),
        patches=[body_struct(part, first) for part, first in zip(parts, facets.first, strict=True)][len(targets) :],
        tables=struct_of(
            Tables, attitudes=attitudes, facets=facets.facets, temperatures=temperatures, nutations=nutations
        ),
        exposure=struct_of(
            Exposure,
            device,
            offset_s=instrument.exposure_rule.offset_s,
            weight=weight,
            series=series_matrix(len(weight)),
        ),
        surroundings=_surroundings(scenario.tracks, features, device),
        surfaces=surfaces_struct(own, spectral, lighting, own_bands, device, first_patch),
        radiance=make_radiance(own_bands, span_k, device, spectral),
    )
    return TargetField(
        features,
        lighting.sun and terms["sun"].bound_nei == 0.0,
        bodies,
        len(parts) - len(targets),
        len(weight) if features.profile else 0,
        max(len(targets), 1) if device.is_cuda or rolling else 1,
        make_observe_targets_kernel(features),
        make_profile_kernel(features) if features.profile else None,
    )


def _albedo_degree(lighting: Lighting, term: LightTerm, limb_sine: float) -> int:
    """Degree of albedo's series, the same for all bands: rougher where the term is faint."""
    error = max(lighting.albedo_error, lighting.leave_out_nei / term.bound_nei) if term.kept else 1.0
    return albedo_degree(error, limb_sine)


def _target_structs(
    scenario: Scenario, attitudes: list[Span], temperatures: list[Span], nutations: list[Span], facets: list[int]
) -> list[Any]:
    """The kernels' targets, by where their rows and facets lie."""
    structs = []
    for number, (one, attitude) in enumerate(zip(scenario.targets, scenario.attitudes, strict=True)):
        target = struct_of(Target, body=body_struct(one.spec.shape, facets[number]), attitude=motion_struct(attitude))
        target.table_first, target.table_count = attitudes[number]
        target.temperature_first, target.temperature_count = temperatures[number]
        target.nutation_first, target.nutation_count = nutations[number]
        structs.append(target)
    return structs


def _surroundings(tracks: Tracks, features: Features, device: wp.Device) -> Any:
    return struct_of(
        Surroundings,
        device,
        sun_m=tracks.sun.position_m,
        earth=earth_struct(tracks.pole_icrs),
        infrared_table=infrared_table() if features.earth else np.zeros((0, 0, 0, 4)),
        albedo_table=albedo_table(features.albedo_degree) if features.albedo else np.zeros((0, 0, 0)),
    )


def surfaces_struct(
    own: Sequence[Graybody],
    spectral: Sequence[Graybody],
    lighting: Lighting,
    bands: Sequence[Band],
    device: wp.Device,
    first_patch: npt.NDArray[np.int64] | None = None,
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
    return struct_of(
        Surfaces,
        device,
        emissivity=per_band(lambda surface, band: 1.0 if surface.is_spectral else surface.emissivity_in(band)),
        radiance_row=_radiance_rows(own, spectral, len(bands)),
        sun_w_m2_sr=reflectance("sun") / np.pi * sunlight,
        earth_w_m2_sr=reflectance("earth") * heat,
        albedo_w_m2_sr2=reflectance("albedo") / np.pi * albedo / np.pi * sunlight,
        **({} if first_patch is None else {"first_patch": first_patch}),
    )


def _radiance_rows(own: Sequence[Graybody], spectral: Sequence[Graybody], n_band: int) -> npt.NDArray[np.int32]:
    """Rows of the radiance table, (n_band, n_target); empty where no surface is given by wavelength."""
    if not spectral:
        return np.zeros((0, 0), dtype=np.int32)
    first_row = {surface: n_band * (1 + number) for number, surface in enumerate(spectral)}
    first = [first_row.get(surface, 0) for surface in own]
    return np.asarray(np.arange(n_band)[:, None] + np.array(first), dtype=np.int32)


def earth_struct(pole_icrs: npt.NDArray[np.float64]) -> Any:
    """Return the Earth's ellipsoid about the pole of date, as the kernels' struct."""
    return struct_of(
        Earth,
        pole=pole_icrs,
        equatorial_radius_m=EARTH_EQUATORIAL_RADIUS_M,
        polar_radius_m=EARTH_POLAR_RADIUS_M,
    )


def rows_once(tables: Sequence[Any], **columns: tuple[int, ...]) -> tuple[dict[str, F64], list[Span]]:
    """Return the rows of tables one behind the other, those of each table once, and where they lie: first, count.

    What has no rows, as it moves by itself, is (0, 0).

    Args:
        tables: Tables, and anything without the first of the columns.
        columns: By name of a column, the shape of a row of it.
    """
    length = next(iter(columns))
    distinct = list({id(table): table for table in tables if hasattr(table, length)}.values())
    counts = [len(getattr(table, length)) for table in distinct]
    spans = dict(zip(map(id, distinct), zip(np.cumsum([0, *counts]).tolist(), counts, strict=False), strict=True))
    rows = {
        name: np.concatenate([np.zeros((0, *shape)), *(getattr(table, name) for table in distinct)])
        for name, shape in columns.items()
    }
    return rows, [spans.get(id(table), (0, 0)) for table in tables]


def make_attitudes(attitudes: Sequence[AnyAttitude | None], device: wp.Device) -> tuple[Any, list[Span]]:
    """Put the attitude tables of all targets on a device, each once; return them, and first row and count of each."""
    rows, spans = rows_once(attitudes, time_s=(), quaternion=(4,))
    return struct_of(AttitudeTables, device, **rows), spans


def make_nutations(attitudes: Sequence[AnyAttitude], device: wp.Device) -> tuple[wp.array, list[Span]]:
    """Put the nutations of all targets that turn freely on a device, each once; return first row and count of each."""
    own = [attitude.nutation if isinstance(attitude, TorqueFreeMotion) else None for attitude in attitudes]
    rows, spans = rows_once(own, quaternion=(4,), step=(4,))
    both = np.stack([rows["quaternion"], rows["step"]], axis=1)
    return wp.array(both, dtype=wp.quatd, device=device), spans


def motion_struct(attitude: AnyAttitude) -> Any:
    """A motion as the kernels' struct; for a table, one that is not read."""
    if isinstance(attitude, TorqueFreeMotion):
        nutation, (reference, first, second) = attitude.nutation, attitude.axes
        rates = {"precession_rev_s": nutation.precession_rev_s, "spin_rev_s": nutation.rate_rev_s}
        return struct_of(AttitudeStruct, reference=reference, first=first, second=second, **rates)
    if not isinstance(attitude, BodyMotion):
        return AttitudeStruct()
    motion = attitude.attitude
    reference, first, second = attitude.axes
    rates = {name: getattr(motion, name) for name in ("precession_rev_s", "rolling_rev_s", "spin_rev_s")}
    phases = {name: getattr(attitude, name) for name in ("precession_phase_rev", "rolling_phase_rev", "spin_phase_rev")}
    tilt_rad = float(np.radians(motion.precession_angle_deg))
    return struct_of(
        AttitudeStruct, reference=reference, first=first, second=second, tilt_rad=tilt_rad, **rates, **phases
    )


LN_TEMPERATURE_STEP = 0.005
"""Node spacing of the radiance table in ln(T): the cubic Hermite error is below 1e-9 at 300 K and above."""

DARKEST_W_M2_SR = 1e-300
"""Stands for less in the radiance table: a body of some kelvin has no light in a short band, which has no logarithm."""


_NO_TARGET_K = 300.0  # of a scene without targets, whose radiances nobody asks for


def make_temperatures(
    temperatures: Sequence[TemperatureRows], device: wp.Device
) -> tuple[Any, list[Span], tuple[float, float]]:
    """Put the temperatures of all targets on a device, each once.

    Return them, first row and count of each target, and the lowest and the highest [K].
    """
    rows, spans = rows_once(temperatures, time_s=(), temperature_k=())
    kelvin = rows["temperature_k"] if len(temperatures) else np.array(_NO_TARGET_K)
    return struct_of(TemperatureTables, device, **rows), spans, (float(kelvin.min()), float(kelvin.max()))


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
    return struct_of(
        RadianceTable,
        device,
        ln_temperature_start=start,
        ln_temperature_step=LN_TEMPERATURE_STEP,
        ln_radiance=ln_radiance(0.0),
        slope=slope * LN_TEMPERATURE_STEP,
    )
