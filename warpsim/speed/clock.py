"""Measures: frames per second the way the paper's Table 7 counts them, and the time that each stage takes."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import warp as wp

from warpsim.launches import call
from warpsim.render import worker as worker_module
from warpsim.render.renderer import Renderer
from warpsim.speed.work import BAND, SpeedWork, speed_work

_WORKING: Any = worker_module  # to mypy, the stages that it imports are not for others

StageTimes = dict[str, list[tuple[int, float]]]
"""By stage, what each chunk took: images, and seconds."""


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
    """Make one call of the work and wait for it.

    Args:
        work: Whose frames are rendered.
        renderer: Made for the work.
        call: Number of the call.
        resident: Whether counts stay on the device, and nothing of them is copied.

    Returns:
        Counts, (frame, sensor, 1, n_pixel, n_pixel): a NumPy array in host memory, or the images on the device.
    """
    counts = renderer.render(work.frames(call), sensors=work.sensors, bands=[BAND]).counts
    if not resident:
        return counts.numpy()
    wp.synchronize_device(renderer.device)
    return counts


def stage_times_us(work: SpeedWork, device: Any = None, n_round: int = 3, resident: bool = False) -> dict[str, float]:
    """Microseconds per image of each stage, in order: the median over the full chunks of some calls, one thread."""
    with timed_stages() as times:
        renderer = Renderer(work.scene, device, 1, work.catalog)
        render_call(work, renderer, 0, resident)
        for spans in times.values():
            spans.clear()
        for number in range(1, n_round + 1):
            render_call(work, renderer, number, resident)
    return {name: _per_image_us(spans) for name, spans in times.items()}


def _per_image_us(spans: list[tuple[int, float]]) -> float:
    """Median time per image of the largest chunks: a short one has more launches to an image."""
    largest = max(n_view for n_view, _ in spans)
    return statistics.median(seconds for n_view, seconds in spans if n_view == largest) / largest * 1e6


@contextmanager
def timed_stages() -> Iterator[StageTimes]:
    """Time every stage of every chunk, by one thread, of renderers that are made and used meanwhile.

    The only code that knows how the renderer runs its stages: it puts a clock about each of those that a worker
    records. On the CPU it is the thread's own time, without what the thread waits for others; on CUDA the launches are
    not made as one graph.
    """
    lists = {name: getattr(_WORKING, name) for name in ("VIEW_STAGES", "IMAGE_STAGES")}
    times: StageTimes = {stage.__name__: [] for stages in lists.values() for stage in stages}

    def clocked(stage: Any) -> Any:
        def run(world: Any, chunk: Any) -> None:
            now = time.perf_counter if world.device.is_cuda else time.thread_time
            begin = [0.0]

            def start(n_view: int) -> None:
                wp.synchronize_device(world.device)
                begin[0] = now()

            def stop(n_view: int) -> None:
                wp.synchronize_device(world.device)
                times[stage.__name__].append((n_view, now() - begin[0]))

            call(start)
            stage(world, chunk)
            call(stop)

        return run

    for name, stages in lists.items():
        setattr(_WORKING, name, tuple(clocked(stage) for stage in stages))
    try:
        yield times
    finally:
        for name, stages in lists.items():
            setattr(_WORKING, name, stages)
