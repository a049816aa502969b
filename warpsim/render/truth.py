"""Truth tables: the numbers that the images were drawn from; and those of views whose images are not drawn."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import ABSENT, BEHIND, IN_FOV, NOT_DEPLOYED, OCCULTED
from warpsim_kernels.signature import N_TERM

from warpsim.detector.detectors import ElectronDetector
from warpsim.detector.levels import ElectronLevels
from warpsim.instant import utc_dates
from warpsim.launches import to_numpy
from warpsim.optics.psf_bank import paths_struct
from warpsim.orbit.earth import earth_clearance_m
from warpsim.render.batch import Columns, HostColumns, Inputs
from warpsim.render.buffers import new_background_nodes, new_view_arrays
from warpsim.render.descriptions import STATE_NAMES, described, with_units
from warpsim.render.device_scene import DeviceBodies, DeviceScene, moved
from warpsim.render.line_of_sight import sensor_states, target_states
from warpsim.render.request import Request
from warpsim.render.resolution import resolution_columns
from warpsim.render.stages import background_of_targets, split_light, target_stages
from warpsim.scene.light_terms import TERMS
from warpsim.scene.provenance import provenance

if TYPE_CHECKING:
    from astropy.table import Table


def truth_table(frames: Request, scene: DeviceScene, seen: HostColumns) -> Table:
    """Return one row per frame x sensor x band x target; DESCRIPTIONS has what its columns mean.

    Positions are NaN behind the camera and for absent targets, of which a row knows nothing else; dx_px and dy_px are 0
    where streaks are off. row_time_s is there with line_time_s alone: all but access is then as at the time of the row.
    Light is 0 when occulted, not deployed or absent, and a term of it where the scene leaves it out. With a background
    there are also background_w_cm2, noise_nei and earth_behind; NaN and false far outside the frame.
    """
    from astropy.table import Table

    shape = (len(frames.frames), len(frames.sensors), scene.n_band, scene.n_target)

    def spread(values: Any, *axes: int) -> npt.NDArray[Any]:
        """Values with the given axes of (frame, sensor, band, target), repeated along the others."""
        array = np.asarray(values)
        full = [shape[axis] if axis in axes else 1 for axis in range(4)]
        return np.broadcast_to(array.reshape(full), shape).ravel()

    targets = frames.scenario.targets
    columns = {
        "frame": spread(np.asarray(frames.frames, dtype=np.int64), 0),
        "time_s": spread(frames.time_s, 0),
        "date_obs": spread(utc_dates(frames.scenario.scene.epoch_utc, frames.time_s), 0),
        "sensor": spread(frames.sensors, 1),
        "band": spread(frames.bands, 2),
        "target": spread(np.array([target.name for target in targets], dtype=str), 3),
        "class": spread(np.array([target.spec.class_name for target in targets], dtype=str), 3),
    }
    groups: list[tuple[tuple[int, ...], dict[str, npt.NDArray[Any]]]] = [
        ((0, 1, 3), _flags(frames, scene, seen)),
        ((0, 1, 3), _geometry(scene, seen)),
        ((0, 1, 2, 3), _light(frames, scene, seen)),
    ]
    if seen.background_w_cm2 is not None:
        groups.append(((0, 1, 2, 3), _background(frames, seen)))
        groups.append(((0, 1, 3), {"earth_behind": _earth_behind(frames, seen)}))
    groups.append(((0, 1, 2, 3), resolution_columns(scene, seen)))
    groups.append(((0, 1), _sensor_states(frames, seen)))
    states = _states_of_targets(frames, seen)
    groups.append(((0, 1, 3), {f"target_{name}": states[..., i] for i, name in enumerate(STATE_NAMES)}))
    for axes, group in groups:
        columns |= {name: spread(values, *axes) for name, values in group.items()}
    return described(with_units(Table(columns, meta=provenance(frames.scenario.scene))))


def _flags(frames: Request, scene: DeviceScene, seen: HostColumns) -> dict[str, npt.NDArray[np.bool_]]:
    """Return the yes-or-no columns of each target, each (frame, sensor, target)."""
    word = seen.observations["flags"].reshape(len(frames.frames), len(frames.sensors), scene.n_target)
    absent = (word & int(ABSENT)) != 0
    rows = [frames.instrument.index(name) for name in frames.sensors]
    return {
        "access": frames.instrument.can_observe(rows, frames.time_s) & ~absent,
        "in_fov": (word & int(IN_FOV)) != 0,
        "occulted": (word & int(OCCULTED)) != 0,
        "not_deployed": (word & int(NOT_DEPLOYED)) != 0,
        "absent": absent,
    }


def _geometry(scene: DeviceScene, seen: HostColumns) -> dict[str, npt.NDArray[np.float64]]:
    """Return position and aspect of each target, each (view, target); NaN for absent ones."""
    observed = seen.observations
    flags = observed["flags"]
    there = (flags & int(ABSENT)) == 0
    in_front = there & ((flags & int(BEHIND)) == 0)

    def known(values: Any, mask: npt.NDArray[np.bool_] = there) -> npt.NDArray[np.float64]:
        return np.where(mask, np.asarray(values, dtype=np.float64), np.nan)

    xy_px, moved_px = observed["xy_px"], moved(seen.offset_px)
    row_time = {} if seen.row_time_s is None else {"row_time_s": known(seen.row_time_s, in_front)}
    return {
        "x_px": known(xy_px[..., 0], in_front),
        "y_px": known(xy_px[..., 1], in_front),
        "dx_px": known(moved_px[..., 0], in_front),
        "dy_px": known(moved_px[..., 1], in_front),
        **row_time,
        "range_km": known(observed["range_m"] / 1e3),
        "aspect_deg": known(np.degrees(observed["aspect_rad"])),
        "projected_area_m2": known(observed["area_m2"]),
        "temperature_k": known(observed["temperature_k"]),
        "sunlit_fraction": known(sunlit_fraction(scene, observed["sunlit"])),
    }


def _light(frames: Request, scene: DeviceScene, seen: HostColumns) -> dict[str, npt.NDArray[np.float64]]:
    """Return the brightness of each target, each (view, band, target)."""
    peak_part, stamp_part = _stamp_parts(scene, seen)
    # A target at the sensor itself would be infinitely bright: as bright as float32 can say.
    irradiance = np.minimum(seen.irradiance_w_cm2, np.finfo(np.float32).max).astype(np.float64)
    snr = irradiance / frames.nei_w_cm2[:, None]
    terms = split_irradiance_w_cm2(scene, seen.columns.observations)
    return {
        "irradiance_w_cm2": irradiance,
        **{f"{name}_w_cm2": values for name, values in terms.items()},
        "snr": snr,
        "snr_peak": snr * peak_part,
        "left_out_w_cm2": irradiance * np.maximum(1 - stamp_part, 0),
    }


def _background(frames: Request, seen: HostColumns) -> dict[str, npt.NDArray[np.float64]]:
    """Return the background behind each target, and the noise with it, each (view, band, target)."""
    background = np.asarray(seen.background_w_cm2, dtype=np.float64)
    noise_nei = np.ones_like(background)
    detector = frames.instrument.sensor.detector
    for index, name in enumerate(frames.bands):
        levels = frames.instrument.levels[name]
        if isinstance(levels, ElectronLevels) and isinstance(detector, ElectronDetector) and detector.shot_noise:
            electrons = background[:, index] * levels.e_per_w_cm2
            noise_nei[:, index] = np.sqrt(1.0 + electrons / levels.noise_e**2)
    return {"background_w_cm2": background, "noise_nei": np.where(np.isnan(background), np.nan, noise_nei)}


def _earth_behind(frames: Request, seen: HostColumns) -> npt.NDArray[np.bool_]:
    """Return whether lines of sight to targets in front of the camera meet the Earth behind them, (view, target)."""
    observed, camera = seen.observations, frames.instrument.sensor.camera
    flags, xy_px = observed["flags"], observed["xy_px"]
    there = (flags & int(ABSENT | BEHIND | OCCULTED)) == 0
    behind = np.zeros(there.shape, dtype=bool)
    axes, position_m = seen.views["axes"], seen.views["position_m"]
    for view in np.flatnonzero(there.any(axis=1)):
        lines = camera.direction(xy_px[view, there[view]], axes[view])
        far_m = position_m[view] + 1e7 * lines
        clearance_m = earth_clearance_m(position_m[view], far_m, frames.scenario.tracks.pole_icrs, beyond=True)
        behind[view, there[view]] = clearance_m < 0.0
    return behind


def _sensor_states(frames: Request, seen: HostColumns) -> dict[str, npt.NDArray[np.float64]]:
    """Return the states of sensors, each (frame, sensor)."""
    axes = seen.views["axes"].reshape(len(frames.frames), len(frames.sensors), 3, 3)
    kind, time_s = frames.instrument, frames.time_s
    states = [sensor_states(kind, name, time_s, axes[:, i]) for i, name in enumerate(frames.sensors)]
    return {f"sensor_{name}": np.stack([state[:, i] for state in states], 1) for i, name in enumerate(STATE_NAMES)}


def target_positions_m(frames: Request, seen: HostColumns) -> npt.NDArray[np.float64]:
    """Return the positions of targets when their light left [m], (view, target, 3); NaN for absent ones."""
    return _states_of_targets(frames, seen)[..., :3]


def _states_of_targets(frames: Request, seen: HostColumns) -> npt.NDArray[np.float64]:
    observed = seen.observations
    range_m = np.where((observed["flags"] & int(ABSENT)) == 0, observed["range_m"], np.nan)
    time_s = np.repeat(frames.time_s, len(frames.sensors))[:, None] + np.zeros(range_m.shape)
    return target_states(frames.scenario, time_s if seen.row_time_s is None else time_s + seen.row_time_s, range_m)


def sunlit_fraction(scene: DeviceBodies, sunlit: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the part of the Sun's disc that targets see, (n_view, n_target); NaN with sunlight off, or left out."""
    if scene.field.features.sun:
        return sunlit
    return np.full(sunlit.shape, 0.0 if scene.field.in_shadow else np.nan)


def split_irradiance_w_cm2(scene: DeviceBodies, observations: wp.array) -> dict[str, npt.NDArray[np.float64]]:
    """Return the irradiance by each term (emitted, sun, earth, albedo), each (n_view, n_band, n_target)."""
    terms = wp.zeros((N_TERM, len(observations), scene.n_band, scene.n_target), dtype=wp.float64, device=scene.device)
    if terms.size:
        split_light(scene, observations.to(scene.device), terms).run()
    return dict(zip(("emitted", *TERMS), to_numpy(terms), strict=True))


def _stamp_parts(scene: DeviceScene, seen: HostColumns) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Parts of each target's light in its own pixel and in its stamp, each (n_view, n_band, n_target)."""
    shape = seen.irradiance_w_cm2.shape
    parts = [wp.empty(shape, dtype=wp.float32, device=scene.device) for _ in range(2)]
    if parts[0].size:
        here = seen.columns.to(scene.device)
        paths = paths_struct(here.offset_px, here.brightness, scene.n_target) if scene.streaks.enabled else None
        xy_px = wp.array(np.ascontiguousarray(seen.observations["xy_px"]), dtype=wp.vec2d, device=scene.device)
        scene.psf.measure_stamps([xy_px, here.irradiance_w_cm2], scene.stamp_rule, parts, paths)
    peak, stamp = (to_numpy(array).astype(np.float64) for array in parts)
    return peak, stamp


def star_table(frames: Request, scene: DeviceScene, star_lists: list[tuple[npt.NDArray[Any], ...]]) -> Table:
    """Return one row per frame x sensor x star whose stamp touches the image.

    Columns: frame, time_s, sensor, x_px, y_px, dx_px, dy_px (as in the truth), catalog_row, id, in_fov, and
    irradiance_w_cm2 and snr with one value per band.
    """
    from astropy.table import Table

    n_sensor = len(frames.sensors)
    if not star_lists:
        star_lists = [(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, scene.n_band)), np.zeros(0))]
    view = np.repeat(np.arange(len(star_lists)), [len(xy) for xy, *_ in star_lists])
    xy_px, moved_px, light, star = (np.concatenate(lists) for lists in zip(*star_lists, strict=True))
    light, star = light.astype(np.float64), star.astype(np.int64)
    camera = frames.instrument.sensor.camera
    in_fov = np.all((xy_px >= -0.5) & (xy_px < np.array([camera.n_col, camera.n_row]) - 0.5), axis=1)
    table = Table(
        {
            "frame": np.asarray(frames.frames, dtype=np.int64)[view // n_sensor],
            "time_s": frames.time_s[view // n_sensor],
            "sensor": np.asarray(frames.sensors)[view % n_sensor],
            "x_px": xy_px[:, 0],
            "y_px": xy_px[:, 1],
            "dx_px": moved_px[:, 0],
            "dy_px": moved_px[:, 1],
            "catalog_row": scene.stars.rows(star),
            "id": scene.stars.names(star),
            "in_fov": in_fov,
            "irradiance_w_cm2": light,
            "snr": light / frames.nei_w_cm2,
        }
    )
    name = scene.stars.index.catalog.name
    table.meta |= {"CATALOG": name, "BANDS": ",".join(frames.bands)}
    return described(with_units(table))


def observe(
    scene: DeviceBodies, inputs: Inputs, columns: Columns, size: int, threads: Executor, terms: wp.array | None = None
) -> None:
    """Fill the columns of views as rendering does, `size` views at a time.

    Args:
        scene: What the stages read.
        inputs: Inputs of the views.
        columns: Their columns.
        size: Views at a time.
        threads: Threads that work.
        terms: Irradiance by each term, (N_TERM, n_view, n_band, n_target); filled where it is asked for.
    """
    n_view = len(inputs.frame)

    def run(first: int) -> None:
        end = min(first + size, n_view)
        own = new_view_arrays(scene, inputs.part(first, end), scene.n_target, columns.part(first, end))
        own.sources.n_source.fill_(scene.n_target)
        stages = target_stages(scene, own)
        if isinstance(scene, DeviceScene) and scene.background is not None:
            nodes = new_background_nodes(scene, end - first)
            stages.append(background_of_targets(scene, own.inputs, own.columns, own.sources, nodes))
        if terms is not None:
            stages.append(split_light(scene, own.columns.observations, terms[:, first:end]))
        for stage in stages:
            stage.run()

    if n_view:
        run(0)  # kernels are compiled by one thread
        list(threads.map(run, range(size, n_view, size)))
