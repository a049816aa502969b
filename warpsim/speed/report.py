"""The reports of `warpsim bench`: frames per second by device, image size and sensors, and the time of each stage.

Of `stss` with any number of pixels, sensors and stars, or of each kind of sensor of a scene.
"""

from __future__ import annotations

import platform
import statistics
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import warp as wp

from warpsim.render.device import default_device
from warpsim.render.renderer import Renderer
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.speed.work import MOST_VIEWS, PIXELS_PER_CALL, speed_work, stage_times_us, synchronised_s, work_fps
from warpsim.version import __version__

PAPER_FPS = {128: 607, 256: 305, 512: 88, 1024: 32}
"""The paper's Table 7: frames per second by pixels on a side."""

REAL_TIME_HZ = 30.0
"""At this rate the paper's figures are 20, 10, 2 and 1 sensors."""


@dataclass(frozen=True)
class BenchmarkPlan:
    """Cases to measure.

    Args:
        devices: Names of Warp devices; the CPU and every GPU when empty.
        pixels: Rows and columns.
        sensors: Numbers of sensors.
        n_star: Stars in view, about.
        psf: "airy" or "gaussian".
        quick: A third of the rounds, and short calls: good to a factor, done in seconds.
        frames: Frames of a call; as many as quick or the work says when None.
        resident: Whether counts stay on the device; otherwise each call ends with them in host memory.
    """

    devices: tuple[str, ...] = ()
    pixels: tuple[int, ...] = tuple(PAPER_FPS)
    sensors: tuple[int, ...] = (1, 20)
    n_star: int = 100
    psf: str = "airy"
    quick: bool = False
    frames: int | None = None
    resident: bool = False

    @property
    def n_round(self) -> int:
        """Timed calls."""
        return 3 if self.quick else 9

    def n_frame(self, n_sensor: int) -> int | None:
        """Frames of a call; as many as the work has, for None."""
        if self.frames is not None:
            return self.frames
        return max(1, 64 // n_sensor) if self.quick else None


@dataclass(frozen=True)
class Speed:
    """One case, measured."""

    device: str
    n_thread: int
    n_pixel: int
    n_sensor: int
    n_star: int
    psf: str
    fps: float
    """Images per second, of all sensors together."""
    stage_us: dict[str, float] | None
    """Microseconds per image by stage, one thread; with one sensor only."""
    n_frame: int
    """Frames of a call."""

    @property
    def n_sensor_in_real_time(self) -> int:
        """Sensors of which REAL_TIME_HZ images a second are made."""
        return int(self.fps // REAL_TIME_HZ)


def measured(plan: BenchmarkPlan) -> Iterator[Speed]:
    """Measure case after case."""
    for device in _devices(plan.devices):
        for n_pixel in plan.pixels:
            for n_sensor in plan.sensors:
                work = speed_work(n_pixel, plan.n_star, n_sensor, plan.psf, plan.n_frame(n_sensor))
                renderer = Renderer(work.scene, device, None, work.catalog)
                fps = work_fps(work, renderer, plan.n_round, plan.resident)
                stages = None
                if n_sensor == min(plan.sensors):
                    stages = stage_times_us(work, device, plan.n_round, plan.resident)
                case = str(device), renderer.n_thread, n_pixel, n_sensor, plan.n_star, plan.psf
                yield Speed(*case, fps, stages, work.n_frame)


def _devices(names: tuple[str, ...]) -> list[wp.Device]:
    """The named devices; the CPU and every GPU when there are no names."""
    return [default_device(name) for name in names or ("cpu", *(str(device) for device in wp.get_cuda_devices()))]


def heading(plan: BenchmarkPlan) -> str:
    """Caption and head of the table."""
    psf = "the telescope's Airy pattern" if plan.psf == "airy" else "a Gaussian of 0.7 px"
    return (
        f"stss: 30 targets, about {plan.n_star} stars in view, {psf}, one band, fresh noise, "
        f"{counts_of(plan.resident)};\n"
        f"median of {plan.n_round} calls, of so many frames of each sensor; paper: its Table 7\n\n"
        f"{'device':<8} {'pixels':>7} {'sensors':>8} {'per call':>8} {'frames/s':>10} {'paper':>6} {'ratio':>7} "
        f"{'at 30 Hz':>9} {'paper':>6}"
    )


def counts_of(resident: bool) -> str:
    """Return where the counts of a measured call end."""
    return "counts left on the device" if resident else "counts in host memory"


def row(speed: Speed) -> str:
    """A case as a row of the table; the paper has figures for some sizes only."""
    paper = PAPER_FPS.get(speed.n_pixel)
    if paper is None:
        fps, ratio, sensors = "-", "-", "-"
    else:
        fps, ratio, sensors = f"{paper}", f"{speed.fps / paper:.1f}", f"{paper // REAL_TIME_HZ:.0f}"
    return (
        f"{speed.device:<8} {speed.n_pixel:>5}^2 {speed.n_sensor:>8} {speed.n_frame:>8,} {speed.fps:>10,.0f} {fps:>6} "
        f"{ratio:>7} {speed.n_sensor_in_real_time:>9,} {sensors:>6}"
    )


def stage_table(speeds: list[Speed]) -> str:
    """Time per image by stage, for the cases that have it."""
    timed = [(speed, speed.stage_us) for speed in speeds if speed.stage_us]
    names = list(timed[0][1])
    width = max(len(name) for name in names)
    lines = ["microseconds per image by stage, one thread; whole: threads / (frames/s), with all that is no stage", ""]
    lines.append(" " * width + "".join(f" {f'{s.device} {s.n_pixel}^2':>13}" for s, _ in timed))
    lines += [f"{name:<{width}}" + "".join(f" {us[name]:>13,.1f}" for _, us in timed) for name in names]
    lines.append(f"{'sum':<{width}}" + "".join(f" {sum(us.values()):>13,.1f}" for _, us in timed))
    lines.append(f"{'whole':<{width}}" + "".join(f" {s.n_thread / s.fps * 1e6:>13,.1f}" for s, _ in timed))
    return "\n".join(lines)


def as_json(plan: BenchmarkPlan, speeds: list[Speed]) -> dict[str, Any]:
    """All figures, with the paper's beside them, and what they were measured with."""
    return {
        "warpsim": __version__,
        "warp": wp.__version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "device_names": {name: wp.get_device(name).name for name in {speed.device for speed in speeds}},
        "plan": asdict(plan),
        "cases": [
            {
                **asdict(speed),
                "n_sensor_at_30_hz": speed.n_sensor_in_real_time,
                "paper_fps": PAPER_FPS.get(speed.n_pixel),
            }
            for speed in speeds
        ],
    }


# --- a scene's own sensors ---


@dataclass(frozen=True)
class SceneSpeed:
    """Speed of a kind of sensor."""

    kind: str
    device: str
    n_row: int
    n_col: int
    n_band: int
    n_sensor: int
    n_frame: int
    """Frames of a timed call."""
    images_per_s: float
    """Images, one for each frame, sensor and band, per second."""
    resident: bool
    """Whether counts stay on the device."""


def scene_speeds(
    scenario: Scenario,
    devices: tuple[str, ...] = (),
    n_round: int = 5,
    n_frame: int | None = None,
    resident: bool = False,
) -> Iterator[SceneSpeed]:
    """Measure kind after kind: its sensors with access, or all where none has any, at frames spread over the scene.

    The median of n_round calls counts, each of n_frame frames, as far as there are so many, or as many as fit into one.
    """
    for device in _devices(devices):
        renderer = Renderer(scenario, device)
        for instrument in scenario.instruments.values():
            yield _measured_kind(renderer, instrument, n_round, n_frame, resident)


def _measured_kind(
    renderer: Renderer, instrument: Instrument, n_round: int, n_frame: int | None, resident: bool
) -> SceneSpeed:
    """Time calls of as many sensors and frames as fit into a call."""
    sensor = instrument.sensor
    n_row, n_col, n_band = sensor.camera.n_row, sensor.camera.n_col, len(sensor.bands)
    n_image = max(1, min(MOST_VIEWS, PIXELS_PER_CALL // (n_row * n_col * n_band)))
    sensors = (instrument.sensors_with_access or instrument.names)[:n_image]
    n_frame = max(1, min(instrument.frames.count, n_frame or n_image // len(sensors)))
    frames = np.linspace(0, instrument.frames.count - 1, n_frame).round().astype(int).tolist()

    def call() -> None:
        counts = renderer.render(frames, sensors=sensors).counts
        if not resident:
            counts.numpy()

    call()  # compiles, and finds how long source lists are
    seconds = [synchronised_s(call, renderer.device) for _ in range(n_round)]
    rate = len(frames) * len(sensors) * n_band / statistics.median(seconds)
    size = n_row, n_col, n_band, len(sensors), len(frames)
    return SceneSpeed(sensor.name, str(renderer.device), *size, rate, resident)


def scene_speed_table(scenario: Scenario, speeds: list[SceneSpeed]) -> str:
    """Return the figures as a table."""
    width = max(len("sensor"), *(len(speed.kind) for speed in speeds))
    lines = [
        f"{scenario.scene.name}: {len(scenario.targets)} targets, {counts_of(speeds[0].resident)}; median of the calls",
        "",
        f"{'device':<8} {'sensor':<{width}} {'pixels':>11} {'bands':>5} {'sensors':>7} {'frames':>6} {'images/s':>9} "
        f"{'Mpixel/s':>9}",
    ]
    for speed in speeds:
        pixels = f"{speed.n_row} x {speed.n_col}"
        mega = speed.images_per_s * speed.n_row * speed.n_col / 1e6
        lines.append(
            f"{speed.device:<8} {speed.kind:<{width}} {pixels:>11} {speed.n_band:>5} {speed.n_sensor:>7} "
            f"{speed.n_frame:>6} {speed.images_per_s:>9,.0f} {mega:>9,.0f}"
        )
    return "\n".join(lines)
