"""Light curves: how bright targets are over time, without images."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import ABSENT, IN_FOV, NOT_DEPLOYED, OCCULTED
from warpsim_kernels.signature import N_TERM

from warpsim.arguments import chosen_names, times_s
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.render.batch import inputs_of_views, new_columns
from warpsim.render.descriptions import with_units
from warpsim.render.device import default_device, worker_count
from warpsim.render.device_scene import DeviceBodies
from warpsim.render.device_upload import make_device_bodies
from warpsim.render.request import checked_names
from warpsim.render.truth import observe, sunlit_fraction
from warpsim.scene.instrument import Instrument
from warpsim.scene.light_terms import TERMS
from warpsim.scene.provenance import provenance
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from astropy.table import Table

Flags = npt.NDArray[np.bool_]

MOST_NUMBERS = 500_000_000
"""Numbers in one set of light curves (4 GB)."""

_VIEWS_PER_LAUNCH = 4096
_PIECES_PER_THREAD = 16


@dataclass(frozen=True, repr=False)
class LightCurves:
    """Brightness of targets over time; axes (time, sensor, target), or (time, sensor, band, target).

    Where a target is absent its numbers are NaN, as in truth, and its light is 0.
    """

    scenario: Scenario
    instrument: Instrument
    """The kind of the sensors."""
    time_s: F64
    """Times after the epoch [s], (n_time,)."""
    sensors: list[str]
    bands: list[str]
    targets: list[str]
    range_km: F64
    aspect_deg: F64
    projected_area_m2: F64
    """Mean over the exposure."""
    temperature_k: F64
    sunlit_fraction: F64
    """Part of the Sun's disc that the target sees; NaN where the scene leaves sunlight out."""
    in_fov: Flags
    occulted: Flags
    not_deployed: Flags
    absent: Flags
    terms_w_cm2: dict[str, F64]
    """Irradiance at the pupil by term: emitted, sun, earth, albedo; each (n_time, n_sensor, n_band, n_target)."""

    @property
    def irradiance_w_cm2(self) -> F64:
        """Irradiance at the pupil, all terms; 0 without a line of sight; (n_time, n_sensor, n_band, n_target)."""
        return np.asarray(sum(self.terms_w_cm2.values()))

    @property
    def snr(self) -> F64:
        """Irradiance over NEI, (n_time, n_sensor, n_band, n_target)."""
        nei_w_cm2 = np.array([self.instrument.nei_w_cm2(band) for band in self.bands])
        return np.asarray(self.irradiance_w_cm2 / nei_w_cm2[:, None])

    def table(self) -> Table:
        """One row per time x sensor x band x target, with the columns of `FrameSet.truth` that need no image."""
        from astropy.table import Table

        names = (self.time_s, np.array(self.sensors), np.array(self.bands), np.array(self.targets))
        grid = np.meshgrid(*(np.arange(len(axis)) for axis in names), indexing="ij")
        columns: dict[str, Any] = {
            name: axis[index.ravel()]
            for name, axis, index in zip(("time_s", "sensor", "band", "target"), names, grid, strict=True)
        }
        shape = grid[0].shape
        flags = ("in_fov", "occulted", "not_deployed", "absent")
        for name in (*flags, "range_km", "aspect_deg", "projected_area_m2", "temperature_k"):
            columns[name] = np.broadcast_to(getattr(self, name)[:, :, None], shape).ravel()
        columns["sunlit_fraction"] = np.broadcast_to(self.sunlit_fraction[:, :, None], shape).ravel()
        columns["irradiance_w_cm2"] = self.irradiance_w_cm2.ravel()
        columns |= {f"{name}_w_cm2": values.ravel() for name, values in self.terms_w_cm2.items()}
        columns["snr"] = self.snr.ravel()
        return with_units(Table(columns, meta=provenance(self.scenario.scene)))

    def __repr__(self) -> str:
        sizes = f"{len(self.time_s)} times, {len(self.sensors)} sensors, {len(self.targets)} targets"
        return f"LightCurves({self.scenario.scene.name}: {sizes}, bands {' '.join(self.bands)})"


def light_curves(
    scene: Scene | Scenario,
    time_s: npt.ArrayLike | None = None,
    sensors: str | Sequence[str] | None = None,
    targets: str | Sequence[str] | None = None,
    bands: str | Sequence[str] | None = None,
    device: Any = None,
    n_thread: int | None = None,
) -> LightCurves:
    """Return brightness of targets as sensors of one kind see them, at any times, as in the truth of frames then.

    Of a detector with line_time_s too, all targets are as at the time itself, not at those of their rows.

    Args:
        scene: The scene, or its scenario.
        time_s: Times after the epoch [s], within the scene; those of its frames when left out.
        sensors: Names of sensors, or the name of a kind; those that have access at some time when left out.
        targets: Target names; all when left out.
        bands: Band names; all of the kind when left out.
        device: Warp device; "cuda:0" where present, else "cpu", when left out.
        n_thread: CPU threads; all cores when left out. Results do not depend on it.

    Raises:
        InputError: An unknown name, a time outside the scene, no sensor with access, or too much at once.
    """
    scenario = scenario_of(scene)
    instrument, sensor_list, band_list = checked_names(scenario, sensors, bands)
    times = checked_times(scenario, instrument, time_s)
    target_list = chosen_names("targets", targets, scenario.target_names)
    bodies = make_device_bodies(scenario, instrument, band_list, default_device(device))
    n_worker = worker_count(bodies.device, n_thread)
    observations, terms = _observed(bodies, times, [instrument.index(name) for name in sensor_list], n_worker)
    chosen = [scenario.target_names.index(name) for name in target_list]

    def seen(name: str) -> npt.NDArray[Any]:
        return np.asarray(observations[name][..., chosen])

    flags = seen("flags")
    absent = (flags & int(ABSENT)) != 0

    def known(values: Any) -> F64:
        return np.where(absent, np.nan, values)

    return LightCurves(
        scenario,
        instrument,
        times,
        sensor_list,
        band_list,
        target_list,
        known(seen("range_m") / 1e3),
        known(np.degrees(seen("aspect_rad"))),
        known(seen("area_m2")),
        known(seen("temperature_k")),
        known(sunlit_fraction(bodies, seen("sunlit"))),
        (flags & int(IN_FOV)) != 0,
        (flags & int(OCCULTED)) != 0,
        (flags & int(NOT_DEPLOYED)) != 0,
        absent,
        dict(zip(("emitted", *TERMS), terms[..., chosen], strict=True)),
    )


def _observed(bodies: DeviceBodies, times: F64, rows: list[int], n_worker: int) -> tuple[npt.NDArray[Any], F64]:
    """Observations, (n_time, n_sensor, n_target), and light by term, (N_TERM, n_time, n_sensor, n_band, n_target)."""
    device, shape, n_view = bodies.device, (len(times), len(rows)), len(times) * len(rows)
    n_number = n_view * bodies.n_target * (bodies.n_band * N_TERM + 8)
    if n_number > MOST_NUMBERS:
        raise InputError(f"these curves would be {n_number:.2g} numbers, more than {MOST_NUMBERS:.2g}", "time_s")
    inputs = inputs_of_views(device, times, rows)
    no_light = wp.empty((n_view, 0, bodies.n_target), dtype=wp.float32, device=device)  # but its terms
    columns = replace(new_columns(bodies, n_view), irradiance_w_cm2=no_light)
    terms = wp.zeros((N_TERM, n_view, bodies.n_band, bodies.n_target), dtype=wp.float64, device=device)
    # Enough pieces that the first, which is done alone, costs the threads little.
    size = n_view if n_worker == 1 else min(-(-n_view // (_PIECES_PER_THREAD * n_worker)), _VIEWS_PER_LAUNCH)
    if terms.size:
        with ThreadPoolExecutor(n_worker) as pool:
            observe(bodies, inputs, columns, size, pool, terms)
    observations = to_numpy(columns.observations)[:, : bodies.n_target].reshape(*shape, bodies.n_target)
    return observations, to_numpy(terms).reshape(N_TERM, *shape, bodies.n_band, bodies.n_target)


def checked_times(scenario: Scenario, instrument: Instrument, time_s: npt.ArrayLike | None) -> F64:
    """Return times within the scene, those of its frames for None; InputError for others."""
    if time_s is None:
        return instrument.frame_time_s(np.arange(instrument.frames.count))
    times, duration_s = times_s(time_s), scenario.scene.duration_s
    if times.ndim != 1:
        raise InputError("must have shape (n,)", "time_s", times.shape)
    bad = ~((times >= 0.0) & (times <= duration_s))
    if bad.any():
        raise InputError(f"must be within the scene, 0 to {duration_s:g} s", "time_s", times[bad][0], "g")
    return times
