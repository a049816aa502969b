"""Work to measure speed on (`stss` with any number of pixels, sensors and stars), and the clock.

Frames per second are counted the way the paper's Table 7 counts them; the time that each stage takes, by the pass.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
import warp as wp

from warpsim.arrays import F64
from warpsim.directions import normalised, perpendicular
from warpsim.errors import InputError
from warpsim.launches import Stage
from warpsim.render.renderer import Renderer
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.positions import position_of
from warpsim.streams import uniforms

BAND = "A"

PSFS: dict[str, dict[str, Any]] = {"airy": {"psf": "airy"}, "gaussian": {"psf": "gaussian", "sigma_px": 0.7}}
"""The telescope's own pattern, and a Gaussian that is as wide at every image size."""

FLUX_RANGE_NEI = (20.0, 1e5)
"""Light of the faintest and of the brightest star, over the noise of a pixel."""

FLUX_SLOPE = -2.5
"""dN/dF ~ F^-2.5: stars that fill space evenly."""

N_CALL = 4
"""Calls with different frames, repeated in turn."""

SATELLITES_PER_SENSOR = 7
"""One satellite in six sees the targets from the first frame to the last."""

MOST_VIEWS = 2048
PIXELS_PER_CALL = 2**25
"""64 MB of counts."""

WARM_UP_S = 0.3
"""Time that a GPU works before it is timed: its clock rises with work."""

_MARGIN_RAD = np.radians(0.3)  # stars outside the image whose light reaches it
_SEED = 607

StageTimes = dict[str, list[tuple[int, float]]]
"""By stage, what each pass took: images, and seconds."""


@dataclass(frozen=True)
class SpeedWork:
    """A scene, and the calls to repeat: N_CALL calls of n_frame frames each."""

    scene: Scene
    sensors: list[str]
    catalog: StarCatalog
    n_frame: int
    n_star: int
    """Stars in view, about."""
    psf: str

    @property
    def n_pixel(self) -> int:
        """Rows, and columns."""
        return int(self.scene.camera.n_row)

    @property
    def n_view(self) -> int:
        """Images of one call."""
        return self.n_frame * len(self.sensors)

    def frames(self, call: int) -> range:
        """Frames of a call."""
        first = call % N_CALL * self.n_frame
        return range(first, first + self.n_frame)


def speed_work(
    n_pixel: int, n_star: int = 100, n_sensor: int = 1, psf: str = "airy", n_frame: int | None = None
) -> SpeedWork:
    """Make the work: about n_star stars in each image, and sensors that see the targets in every frame.

    A call has so many frames that they are 64 MB of counts, but no more than 2048 images, when n_frame is left out.
    An unknown psf or a number that is out of range is an InputError.
    """
    scene = speed_scene(n_pixel, psf, n_sensor)
    if n_frame is None:
        n_frame = max(1, min(MOST_VIEWS, max(16, PIXELS_PER_CALL // n_pixel**2)) // n_sensor)
    sensors = _observing_sensors(scene.scenario, n_sensor, N_CALL * n_frame)
    catalog = speed_catalog(scene.scenario, sensors, N_CALL * n_frame, n_star)
    return SpeedWork(scene, sensors, catalog, n_frame, n_star, psf)


def speed_scene(n_pixel: int, psf: str = "airy", n_sensor: int = 1) -> Scene:
    """Stss with n_pixel x n_pixel arrays, frames 10 ms apart, and satellites for n_sensor sensors; its sky is empty.

    The field of view stays 1 degree, and with it the number of stars in view.
    """
    if psf not in PSFS:
        raise InputError(f"must be {' or '.join(PSFS)}", "psf", psf)
    if n_sensor < 1:
        raise InputError("must be >= 1", "n_sensor", n_sensor)
    scene = Scene.load("stss")
    n_satellite = 28 * math.ceil(n_sensor * SATELLITES_PER_SENSOR / 28)
    return scene.replace(
        constellation__n_satellite=n_satellite,
        camera__n_row=n_pixel,
        camera__n_col=n_pixel,
        frames={"count": 100_000, "interval_s": 0.01, "start_s": 600.0},
        sky={"catalog": "none"},
        **{f"optics__{name}": value for name, value in PSFS[psf].items()},
    )


def _observing_sensors(scenario: Scenario, n_sensor: int, n_frame: int) -> list[str]:
    """Sensors that see the targets in each of the first frames."""
    first_s, last_s = scenario.instrument.frame_time_s([0, n_frame - 1])
    table = scenario.access()
    seen = table[(table["start_s"] <= first_s) & (table["end_s"] >= last_s)]
    sensors = [str(name) for name in seen["sensor"]][:n_sensor]
    if len(sensors) < n_sensor:
        raise InputError(f"{len(sensors)} sensors see the targets", "n_sensor", n_sensor)
    return sensors


def speed_catalog(scenario: Scenario, sensors: list[str], n_frame: int, n_star: int) -> StarCatalog:
    """Return stars of even density wherever sensors look in the first frames, about n_star in each image.

    Their light follows FLUX_SLOPE within FLUX_RANGE_NEI. Each sensor has a cap of the sky; stars of a cap that lie in
    the cap of an earlier sensor are left out, so that the density is the same where caps meet.
    """
    if n_star < 0:
        raise InputError("must be >= 0", "n_star", n_star)
    instrument = scenario.instrument
    camera = instrument.sensor.camera
    first_s, last_s = instrument.frame_time_s([0, n_frame - 1])
    time_s = np.linspace(first_s, last_s, 17)
    per_sr = n_star * camera.focal_px * camera.focal_row_px / (camera.n_row * camera.n_col)
    caps: list[tuple[F64, float]] = []
    directions: list[F64] = [np.empty((0, 3))]
    for item, name in enumerate(sensors):
        axis, cosine = _cap_around(scenario.view_axes(name, time_s)[:, 2], camera.half_diagonal_rad() + _MARGIN_RAD)
        star = _even_stars(axis, cosine, per_sr, item)
        for other, other_cosine in caps:
            star = star[star @ other < other_cosine]
        caps.append((axis, cosine))
        directions.append(star)
    ra_deg, dec_deg = position_of(*np.concatenate(directions).T)
    n = len(ra_deg)
    w_cm2_per_jy = StarCatalog.from_arrays([0.0], [0.0], {BAND: [1.0]}).irradiance_w_cm2(BAND)[0]
    flux_jy = power_law_nei(n) * instrument.nei_w_cm2(BAND) / w_cm2_per_jy
    return StarCatalog.from_arrays(ra_deg, dec_deg, {BAND: flux_jy}, id=np.full(n, ""), name="even stars")


def power_law_nei(n: int) -> F64:
    """Return the light of n stars [NEI]: FLUX_SLOPE within FLUX_RANGE_NEI."""
    low, high = FLUX_RANGE_NEI
    power = FLUX_SLOPE + 1.0
    u = uniforms(_SEED, "light of stars", 0, n)
    return np.asarray(low * (1.0 - u * (1.0 - (high / low) ** power)) ** (1.0 / power))


def _cap_around(directions: F64, margin_rad: float) -> tuple[F64, float]:
    """Axis of a cap that holds directions and a margin about them, and the cosine of its radius."""
    axis = normalised(directions.mean(axis=0))
    radius_rad = float(np.arccos(np.clip(directions @ axis, -1.0, 1.0)).max()) + margin_rad
    return axis, float(np.cos(min(radius_rad, np.pi)))


def _even_stars(axis: F64, cosine: float, per_sr: float, item: int) -> F64:
    """Directions of even density in a cap, (n, 3)."""
    n = round(2.0 * np.pi * (1.0 - cosine) * per_sr)
    u = uniforms(_SEED, "places of stars", item, 2 * n).reshape(2, n)
    along = 1.0 - u[0] * (1.0 - cosine)
    across, turn = np.sqrt(1.0 - along**2), 2.0 * np.pi * u[1]
    right = normalised(perpendicular(axis))
    parts = (along, axis), (across * np.cos(turn), right), (across * np.sin(turn), np.cross(axis, right))
    return np.asarray(sum(np.outer(component, direction) for component, direction in parts))


def measure_fps(
    n_pixel: int,
    device: Any = None,
    psf: str = "airy",
    n_round: int = 7,
    n_star: int = 100,
    n_sensor: int = 1,
    n_thread: int | None = None,
    n_frame: int | None = None,
    resident: bool = False,
) -> float:
    """Median frames per second of one band of `stss`: images per second over all sensors.

    Args:
        n_pixel: Rows and columns.
        device: Warp device.
        psf: "airy", the telescope's own pattern, or "gaussian", of 0.7 px.
        n_round: Timed calls.
        n_star: Stars in view, about.
        n_sensor: Sensors.
        n_thread: CPU threads; all cores when left out.
        n_frame: Frames of a call; 64 MB of counts, but no more than 2048 images, when left out.
        resident: Whether counts stay on the device; otherwise each call ends with them in host memory.

    Raises:
        InputError: An unknown psf, or a number that is out of range.
    """
    work = speed_work(n_pixel, n_star, n_sensor, psf, n_frame)
    return work_fps(work, Renderer(work.scene, device, n_thread, work.catalog), n_round, resident)


def work_fps(work: SpeedWork, renderer: Renderer, n_round: int, resident: bool = False) -> float:
    """Median images per second of a renderer that was made for the work."""
    render_call(work, renderer, 0, resident)  # compiles, and finds how long source lists are
    begin = time.perf_counter()
    while renderer.device.is_cuda and time.perf_counter() - begin < WARM_UP_S:
        render_call(work, renderer, 0, resident)
    calls = [partial(render_call, work, renderer, number, resident) for number in range(1, n_round + 1)]
    seconds = [synchronised_s(call, renderer.device) for call in calls]
    return work.n_view / statistics.median(seconds)


def synchronised_s(call: Callable[[], Any], device: wp.Device) -> float:
    """Seconds of a call, from when the device is idle until it is idle again."""
    wp.synchronize_device(device)
    begin = time.perf_counter()
    call()
    wp.synchronize_device(device)
    return time.perf_counter() - begin


def render_call(work: SpeedWork, renderer: Renderer, call: int, resident: bool = False) -> Any:
    """Make a numbered call of the work and wait for its counts (frame, sensor, 1, n_pixel, n_pixel).

    They are a NumPy array in host memory, or images that stay on the device.
    """
    counts = renderer.render(work.frames(call), sensors=work.sensors, bands=[BAND]).counts
    if not resident:
        return counts.numpy()
    wp.synchronize_device(renderer.device)
    return counts


def stage_times_us(work: SpeedWork, device: Any = None, n_round: int = 3, resident: bool = False) -> dict[str, float]:
    """Microseconds per image of each stage, in order: the median over the full passes of some calls, one thread."""
    with timed_stages() as times:
        renderer = Renderer(work.scene, device, 1, work.catalog)
        render_call(work, renderer, 0, resident)
        times.clear()
        for number in range(1, n_round + 1):
            render_call(work, renderer, number, resident)
    return {name: _per_image_us(spans) for name, spans in times.items()}


def _per_image_us(spans: list[tuple[int, float]]) -> float:
    """Median time per image of the largest passes: a short one has more launches to an image."""
    largest = max(n_view for n_view, _ in spans)
    return statistics.median(seconds for n_view, seconds in spans if n_view == largest) / largest * 1e6


@contextmanager
def timed_stages() -> Iterator[StageTimes]:
    """Time every stage of every pass, by one thread, of renderers that are used meanwhile.

    On the CPU it is the thread's own time, without what the thread waits for others.
    """
    times: StageTimes = {}
    run = Stage.run

    def timed(stage: Stage, n_view: int | None = None, stream: wp.Stream | None = None) -> None:
        now = time.thread_time if stream is None else time.perf_counter
        if stream is not None:
            wp.synchronize_stream(stream)
        begin = now()
        run(stage, n_view, stream)
        if stream is not None:
            wp.synchronize_stream(stream)
        done = stage.n_view if n_view is None else n_view
        times.setdefault(stage.name, []).append((done, now() - begin))

    with mock.patch.object(Stage, "run", timed):
        yield times
