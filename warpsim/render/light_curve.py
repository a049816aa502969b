"""The light curve of a target as a function of its parameters, with derivatives: many sets of parameters at a time."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.area_slopes import ShapeVector
from warpsim_kernels.curve_views import CurveView, TargetOfCurve, make_curve_views_kernel
from warpsim_kernels.earth_albedo import albedo_series_of
from warpsim_kernels.light_curve import CurveScene, CurveSet, make_light_curve_kernel
from warpsim_kernels.light_curve_slopes import Columns, make_light_curve_slopes_kernel
from warpsim_kernels.records import View
from warpsim_kernels.signature import Features, Tables

from warpsim.arguments import chosen_names, finite_number, whole_number
from warpsim.arrays import F64
from warpsim.detector.levels import noise_variance
from warpsim.errors import InputError
from warpsim.launches import struct_of, to_numpy
from warpsim.render.batch import inputs_of_views
from warpsim.render.curve_parameters import CurveTarget, ParameterSets
from warpsim.render.device import default_device, worker_count
from warpsim.render.device_scene import DeviceBodies
from warpsim.render.device_upload import make_device_bodies
from warpsim.render.information import Information, information_of
from warpsim.render.light_curves import checked_times
from warpsim.render.request import checked_names
from warpsim.render.stages import aim
from warpsim.render.target_field import (
    LN_TEMPERATURE_STEP,
    make_attitudes,
    make_nutations,
    make_radiance,
    surfaces_struct,
)
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.scene.target_histories import within_scene
from warpsim.streams import uniforms
from warpsim.target.areas import body_struct, facets_of, has_facets
from warpsim.target.patches import patch_areas
from warpsim.target.surface import Graybody
from warpsim.target.temperature import Temperature
from warpsim.target.torque_free import TorqueFreeMotion

MOST_NUMBERS = 500_000_000
"""Numbers in one answer (4 GB)."""

_LN_MARGIN_STEPS = 139
"""By so many nodes radiances are tabulated beyond the temperatures of the scene: from half to twice of them."""

_WORTH_A_THREAD = 20_000
"""Views times sets below which a call stays on its thread."""


class LightCurve:
    """Irradiance of a target as sensors of one kind see it, as a function of parameters of the target.

    What does not depend on the parameters (directions, ranges, the Sun, shadow, the Earth) is computed once, as
    `light_curves` does it. Axes are (time, sensor, band), behind that of the sets where there are several.

    Args:
        scene: The scene, or its scenario.
        target: Name of a target.
        parameters: Names of the parameters; all that act when left out (emissivities stand for reflectances).
        time_s: Times after the epoch [s], within the scene; those of its frames when left out.
        sensors: Names of sensors, or the name of a kind; those that have access at some time when left out.
        bands: Band names; all of the kind when left out.
        device: Warp device; "cuda:0" where present, else "cpu", when left out.
        n_thread: CPU threads; all cores when left out. Results do not depend on it.
        phase_time_s: Time at which phases of motions count [s]: the epoch, as in `Attitude`, when left out. Phases at a
            time amid the data hardly depend on the rates.

    Raises:
        InputError: An unknown name, a parameter that does not act on the target, a time outside the scene.
    """

    def __init__(
        self,
        scene: Scene | Scenario,
        target: str,
        parameters: str | Sequence[str] | None = None,
        time_s: npt.ArrayLike | None = None,
        sensors: str | Sequence[str] | None = None,
        bands: str | Sequence[str] | None = None,
        device: Any = None,
        n_thread: int | None = None,
        phase_time_s: float = 0.0,
    ) -> None:
        scenario = scenario_of(scene)
        self.scenario = scenario
        self.instrument, self.sensors, self.bands = checked_names(scenario, sensors, bands)
        self.target = chosen_names("target", [target], scenario.target_names)[0]
        self.time_s: F64 = checked_times(scenario, self.instrument, time_s)
        number = scenario.target_names.index(self.target)
        attitude, spec = scenario.attitudes[number], scenario.targets[number].spec
        self._device = default_device(device)
        self._n_worker = worker_count(self._device, n_thread)
        bodies = make_device_bodies(scenario, self.instrument, self.bands, self._device)
        self._features = _features(bodies, scenario, number)
        self._views, self._harmonics = self._seen(bodies, number)
        views = to_numpy(self._views)
        self.range_km: F64 = np.where(views["visible"] > 0, views["range_m"] / 1e3, np.nan).reshape(self._shape[:2])
        """Range, NaN where the target cannot be seen, (n_time, n_sensor)."""
        kelvin = _kelvin(scenario)
        nearest_m = float(views["range_m"].min(initial=np.inf))
        self.phase_time_s = finite_number("phase_time_s", phase_time_s)
        own = CurveTarget(
            spec.shape, attitude, spec.surface, spec.temperature, self.bands, kelvin, nearest_m,
            self.phase_time_s, spec.patches,
        )  # fmt: skip
        self._sets = ParameterSets(own, own.chosen(parameters))
        self.parameters = self._sets.names
        """Names of the parameters."""
        self.values: F64 = self._sets.values
        """The scene's own values of the parameters, (n_param,)."""
        self.bounds: F64 = self._sets.bounds
        """Lowest and highest value of each, (n_param, 2)."""
        self._scene = self._curve_scene(bodies, number, kelvin)

    @property
    def _shape(self) -> tuple[int, int, int]:
        return len(self.time_s), len(self.sensors), len(self.bands)

    def __repr__(self) -> str:
        sizes = f"{len(self.time_s)} times, {len(self.sensors)} sensors, bands {' '.join(self.bands)}"
        return f"LightCurve({self.target}: {', '.join(self.parameters)}; {sizes})"

    def _seen(self, bodies: DeviceBodies, number: int) -> tuple[wp.array, wp.array]:
        """Views of the curve, (n_time * n_sensor,), and harmonics of Earth albedo."""
        device, n_view = self._device, len(self.time_s) * len(self.sensors)
        rows = [self.instrument.index(name) for name in self.sensors]
        inputs = inputs_of_views(device, self.time_s, rows)
        views = wp.zeros(n_view, dtype=View, device=device)
        aim(bodies, inputs, views).run()
        target = self.scenario.targets[number]
        chosen = struct_of(
            TargetOfCurve, number=number, has_base=0 if isinstance(target.spec.temperature, Temperature) else 1
        )
        chosen.start_s, chosen.end_s = within_scene(target.exists_s, self.scenario.scene.duration_s)
        seen = wp.zeros(n_view, dtype=CurveView, device=device)
        harmonics = wp.zeros(n_view, dtype=albedo_series_of(self._features.albedo_degree).Harmonics, device=device)
        wp.launch(
            make_curve_views_kernel(self._features),
            n_view,
            [inputs.time_s, views, bodies.tracks, bodies.field.bodies, chosen],
            [seen, harmonics],
            device=device,
        )
        return seen, harmonics

    def _curve_scene(self, bodies: DeviceBodies, number: int, kelvin: tuple[float, float]) -> Any:
        """What all sets share, as the kernels' struct."""
        scenario, device, field = self.scenario, self._device, bodies.field.bodies
        target, bands = scenario.targets[number], [self.instrument.bands[name] for name in self.bands]
        # Where the surface has one number in each band, those of the sets are parts of reflectance 1.
        surfaces = target.spec.surfaces
        spectral = list(dict.fromkeys(surface for surface in surfaces if surface.is_spectral))
        own = target.spec.surface if target.spec.surface.is_spectral else Graybody(1.0)
        patches = patch_areas(target.spec.shape, target.spec.patches)
        facets = facets_of([target.spec.shape, *patches], device)
        attitudes, spans = make_attitudes([scenario.attitudes[number]], device)
        nutations, nutation_spans = make_nutations([scenario.attitudes[number]], device)
        tables = struct_of(
            Tables,
            attitudes=attitudes,
            facets=facets.facets,
            nutations=nutations,
            temperatures=field.tables.temperatures,
        )
        return struct_of(
            CurveScene,
            device,
            nutation_count=nutation_spans[0][1],
            patches=[body_struct(patch, first) for patch, first in zip(patches, facets.first[1:], strict=True)],
            views=self._views,
            tables=tables,
            exposure=field.exposure,
            table_first=spans[0][0],
            table_count=spans[0][1],
            phase_s=self.phase_time_s,
            infrared_table=field.surroundings.infrared_table,
            surfaces=surfaces_struct([own, *surfaces[1:]], spectral, scenario.scene.lighting, bands, device),
            radiance=make_radiance(bands, kelvin, device, spectral),
        )

    def __call__(self, params: npt.ArrayLike) -> F64:
        """Return the irradiance at the pupil [W/cm2], (n_time, n_sensor, n_band), behind an axis of sets if any.

        Args:
            params: Values of the parameters, (n_param,), or sets of them, (n_set, n_param).

        Raises:
            InputError: A value is out of bounds, the shape is another, or it would be too much at once.
        """
        return self._answer(params, with_slopes=False)[0]

    def jacobian(self, params: npt.ArrayLike) -> F64:
        """Return what the irradiance changes by with each parameter; as a call, with a last axis of parameters."""
        return self._answer(params, with_slopes=True)[1]

    def with_jacobian(self, params: npt.ArrayLike) -> tuple[F64, F64]:
        """Return irradiance and Jacobian, for the cost of the Jacobian."""
        return self._answer(params, with_slopes=True)

    def sigma_w_cm2(self, irradiance_w_cm2: npt.ArrayLike) -> F64:
        """Return the noise of irradiances, whose last axis is that of bands: the detector's, as of light in one pixel.

        It has the variance of a pixel on blank sky, (NEI)^2 with rounding to counts, and the shot noise of the light.
        """
        light = np.maximum(np.asarray(irradiance_w_cm2, dtype=np.float64), 0.0)
        detector, levels = self.instrument.sensor.detector, self.instrument.levels
        noise = np.array([noise_variance(detector, levels[band]) for band in self.bands])
        return np.asarray(np.sqrt(noise[:, 0] + noise[:, 1] * light))

    def fisher(self, params: npt.ArrayLike, sigma_w_cm2: npt.ArrayLike | None = None) -> Information:
        """Return what the light curve says about its parameters, with Cramer-Rao bounds.

        Args:
            params: Values of the parameters, (n_param,).
            sigma_w_cm2: Noise, of a shape that broadcasts with the irradiance's; the detector's when left out. What the
                noise itself says about the light is left out.

        Raises:
            InputError: As of a call, or a noise is not above 0.
        """
        light, slopes = self.with_jacobian(np.ravel(params))
        sigma = self.sigma_w_cm2(light) if sigma_w_cm2 is None else checked_sigma(sigma_w_cm2, light.shape)
        weighted = (slopes / sigma[..., None]).reshape(-1, len(self.parameters))
        return information_of(self.parameters, weighted, light / sigma)

    def sample(self, params: npt.ArrayLike, key: int, first: int = 0) -> F64:
        """Return the irradiance with noise drawn for it [W/cm2], as a call; that of `sigma_w_cm2`, Gaussian.

        Args:
            params: As of a call.
            key: Seed of the noise.
            first: Number of the first set; a set's noise depends on key and number alone.
        """
        from scipy.special import ndtri

        key, first = whole_number("key", key, 0), whole_number("first", first, 0)
        light = self(params)
        sets = light if light.ndim == 4 else light[None]
        draws = [ndtri(uniforms(key, "light curve", first + number, one.size)) for number, one in enumerate(sets)]
        unit = np.reshape(draws, sets.shape)
        return np.asarray((sets + self.sigma_w_cm2(sets) * unit).reshape(light.shape))

    def _answer(self, params: npt.ArrayLike, with_slopes: bool) -> tuple[F64, F64]:
        """Irradiance and, if asked for, Jacobian, with the axes of the parameters given."""
        sets = self._sets.checked(params)
        n_set, n_view, n_param = len(sets), len(self._views), len(self.parameters)
        if n_set * n_view * len(self.bands) * (1 + with_slopes * n_param) > MOST_NUMBERS:
            raise InputError(f"would give more than {MOST_NUMBERS:.2g} numbers at once", "params", sets.shape)
        records, optics, shapes = self._sets.records(sets)
        light = wp.empty((n_set, n_view, len(self.bands)), dtype=wp.float64, device=self._device)
        slopes = wp.empty((*light.shape, n_param), dtype=wp.float64, device=self._device) if with_slopes else None
        given = [
            wp.array(records, dtype=CurveSet, device=self._device, copy=False),
            wp.array(optics, dtype=wp.vec2d, device=self._device, copy=False),
        ]
        if with_slopes:
            given.append(wp.array(shapes, dtype=ShapeVector, device=self._device, copy=False))
        if light.size:
            self._launch(given, light, slopes)
        shape = (*np.shape(params)[:-1], *self._shape)
        found = to_numpy(light).reshape(shape)
        if slopes is None:
            return found, found
        jacobian = to_numpy(slopes).reshape(*shape, n_param)
        signs = self._sets.signs
        return found, jacobian * signs if (signs < 0).any() else jacobian

    def _launch(self, given: list[wp.array], light: wp.array, slopes: wp.array | None) -> None:
        """Launch over all sets: at once, or on the CPU in parts, one for each thread."""
        n_set, n_view, _ = light.shape
        make = make_light_curve_kernel if slopes is None else make_light_curve_slopes_kernel
        kernel, threads = make(self._features), n_view if self._device.is_cuda else 1
        kind = wp.array(self._sets.kind, dtype=wp.int32, device=self._device) if slopes is not None else None

        def launch(first: int, end: int) -> None:
            inputs: list[Any] = [given[0][first:end], given[1][first:end], self._scene, self._harmonics]
            outputs = [light[first:end]]
            if slopes is not None:
                inputs.append(struct_of(Columns, kind=kind, shape=given[2][first:end]))
                outputs.append(slopes[first:end])
            wp.launch(kernel, (end - first, threads), [*inputs, threads], outputs, device=self._device)

        if self._n_worker == 1 or n_set * n_view < _WORTH_A_THREAD:
            launch(0, n_set)
            return
        wp.load_module(kernel.module, self._device)
        ends = np.linspace(0, n_set, min(n_set, 4 * self._n_worker) + 1).astype(int)
        with ThreadPoolExecutor(self._n_worker) as pool:
            list(pool.map(launch, ends[:-1].tolist(), ends[1:].tolist()))


def checked_sigma(sigma_w_cm2: npt.ArrayLike, shape: tuple[int, ...]) -> F64:
    """Return noise in the shape of irradiances; InputError where it is not above 0."""
    try:
        sigma = np.broadcast_to(np.asarray(sigma_w_cm2, dtype=np.float64), shape)
    except (TypeError, ValueError):
        raise InputError(f"must be numbers that broadcast to {shape}", "sigma_w_cm2") from None
    if not (sigma > 0.0).all():
        raise InputError("must be above 0", "sigma_w_cm2")
    return sigma


def _features(bodies: DeviceBodies, scenario: Scenario, number: int) -> Features:
    """Parts of the kernels that a target needs."""
    spec, attitude = scenario.targets[number].spec, scenario.attitudes[number]
    return bodies.field.features._replace(
        attitude_tables=hasattr(attitude, "time_s"),
        torque_free=isinstance(attitude, TorqueFreeMotion),
        meshes=has_facets(spec.shape) or bool(spec.patches),
        patches=bool(spec.patches),
        spectral=any(surface.is_spectral for surface in spec.surfaces),
        profile=False,
        distortion=False,
        rolling=False,
    )


def _kelvin(scenario: Scenario) -> tuple[float, float]:
    """Lowest and highest temperature of radiance tables, whose nodes are those of the scene's own and more."""
    kelvin = np.concatenate([rows.temperature_k for rows in scenario.temperatures])
    margin = np.exp(_LN_MARGIN_STEPS * LN_TEMPERATURE_STEP)
    return float(kelvin.min() / margin), float(kelvin.max() * margin)
