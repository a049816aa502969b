"""Speed with counts left on the device: over image sizes, point spread functions and frames of a call; by stage."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import Any
from unittest import mock

import warpsim as ws
from benchmarks.gpu.plan import Plan, Row, rows_of
from warpsim.render import pipeline, schedule, stages
from warpsim.speed.work import PSFS, SpeedWork, speed_work, stage_times_us, work_fps

FRAMES = {128: (64, 512, 2048, 8192), 256: (64, 512, 2048), 512: (64, 512), 1024: (16, 64, 128, 256)}
"""Frames of a call by rows and columns of an image; of the largest the stages are timed, too."""

SMALL_FRAMES = {32: (4,)}
N_ROUND = 7

SETTINGS: dict[str, dict[str, Any]] = {"passes of 64 MiB": {"chunk_bytes": 64 * 2**20}}
"""Arguments of a renderer that are tried besides the defaults."""

RUN_THREADS = (64, 256)
"""Threads that draw and read out a run of pixels, tried besides the default."""

SIGNAL_MIB = (32, 128, 512)
"""Light that goes by way of memory at a time, tried besides none: less than the cache holds, and more."""

IN_MEMORY: dict[str, dict[str, Any]] = {
    "streaks": {
        "detector__exposure_s": 0.009, "detector__streaks": True,
        "pointing__drift": {"urad_s": [2e4, 0.0], "reset_s": 0.01},
    },
    "background": {"background": {"zodiacal": True, "earth": True}},
}  # fmt: skip
"""Changes of the scene that have light go by way of memory; where there are streaks, the camera drifts by them."""


def _work(plan: Plan, n_pixel: int, psf: str, n_frame: int) -> SpeedWork:
    return speed_work(n_pixel, 5 if plan.quick else 100, 1, psf, n_frame)


def speed(plan: Plan) -> Iterator[Row]:
    """Images per second by size, point spread function and frames of a call; then with other settings."""

    def fps(
        n_pixel: int,
        psf: str,
        n_frame: int,
        resident: bool = True,
        patch: AbstractContextManager[Any] | None = None,
        changes: dict[str, Any] | None = None,
        **arguments: Any,
    ) -> Row:
        work = _work(plan, n_pixel, psf, n_frame)
        if changes:
            work = replace(work, scene=work.scene.replace(**changes))
        with patch or nullcontext():
            renderer = ws.Renderer(work.scene, plan.device, catalog=work.catalog, **arguments)
            found = work_fps(work, renderer, (2 if plan.quick else N_ROUND), resident)
        size = {"n_pixel": n_pixel, "psf": psf, "n_frame": n_frame, "resident": resident}
        return {**size, "fps": found, "us_per_image": 1e6 / found, "buffer_mb": renderer.buffer_bytes / 1e6}

    sizes = SMALL_FRAMES if plan.quick else FRAMES
    cases: list[tuple[str, Any]] = [
        (f"{psf} {n_pixel}, {n_frame} frames", partial(fps, n_pixel, psf, n_frame))
        for n_pixel, frames in sizes.items()
        for psf in PSFS
        for n_frame in frames
    ]
    for n_pixel in sorted({min(sizes), max(sizes)}):
        n_frame = sizes[n_pixel][-1]
        name = f"gaussian {n_pixel}, {n_frame} frames"
        cases.append((f"{name}, counts in host memory", partial(fps, n_pixel, "gaussian", n_frame, False)))
        for setting, arguments in SETTINGS.items():
            cases.append((f"{name}, {setting}", partial(fps, n_pixel, "gaussian", n_frame, **arguments)))
        for n_thread in RUN_THREADS:
            threads = mock.patch.object(stages, "RUN_THREADS", n_thread)
            cases.append(
                (f"{name}, {n_thread} threads a run", partial(fps, n_pixel, "gaussian", n_frame, patch=threads))
            )
        for kind, changes in IN_MEMORY.items():
            cases.append((f"{name}, {kind}", partial(fps, n_pixel, "gaussian", n_frame, changes=changes)))
        for mib in SIGNAL_MIB:
            patch = _drawn_and_read_out_apart(mib)
            cases.append(
                (f"{name}, light of {mib} MiB in memory", partial(fps, n_pixel, "gaussian", n_frame, patch=patch))
            )
    return rows_of(cases)


@contextmanager
def _drawn_and_read_out_apart(mib: int) -> Iterator[None]:
    """Light goes by way of memory, so much at a time."""
    with (
        mock.patch.object(schedule, "SIGNAL_BYTES_AT_A_TIME_CUDA", mib * 2**20),
        mock.patch.object(pipeline, "is_read_out_at_once", return_value=False),
    ):
        yield


def stage_times(plan: Plan) -> Iterator[Row]:
    """Microseconds of an image by stage, the device waited for after each."""

    def times(n_pixel: int, psf: str, n_frame: int) -> Row:
        work = _work(plan, n_pixel, psf, n_frame)
        us = stage_times_us(work, plan.device, (2 if plan.quick else N_ROUND), resident=True)
        return {"n_pixel": n_pixel, "psf": psf, "n_frame": n_frame, "stage_us": us, "sum_us": sum(us.values())}

    return rows_of(
        (f"{psf} {n_pixel}, {frames[-1]} frames", partial(times, n_pixel, psf, frames[-1]))
        for n_pixel, frames in (SMALL_FRAMES if plan.quick else FRAMES).items()
        for psf in PSFS
    )
