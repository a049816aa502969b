"""Frames per second of each kind of sensor of a scene, with its own images, bands and stars."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from warpsim.render.device import default_device
from warpsim.render.renderer import Renderer
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.speed.clock import synchronised_s
from warpsim.speed.report import counts_of
from warpsim.speed.work import MOST_VIEWS, PIXELS_PER_CALL


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

    Args:
        scenario: Whose sensors are measured.
        devices: Names of Warp devices; the CPU and every GPU when empty.
        n_round: Timed calls, of which the median counts.
        n_frame: Frames of a call, as far as a kind of sensor has them; as many as fit into a call when left out.
        resident: Whether counts stay on the device; otherwise each call ends with them in host memory.

    Raises:
        InputError: No such device.
    """
    names = devices or ("cpu", *(str(device) for device in wp.get_cuda_devices()))
    for device in [default_device(name) for name in names]:
        renderer = Renderer(scenario, device)
        for instrument in scenario.instruments.values():
            yield _measured(renderer, instrument, n_round, n_frame, resident)


def _measured(
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
