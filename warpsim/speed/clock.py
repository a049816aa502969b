"""Measures: frames per second the way the paper's Table 7 counts them, and the time that each stage takes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any
from unittest import mock

import warp as wp

from warpsim.launches import Stage
from warpsim.render.renderer import Renderer
from warpsim.speed.work import BAND, SpeedWork, speed_work

StageTimes = dict[str, list[tuple[int, float]]]
"""By stage, what each pass took: images, and seconds."""


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
