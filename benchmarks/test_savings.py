"""Savings of some of the renderer's tricks: the same work with and without each, by turns, one thread.

    python -m pytest benchmarks/test_savings.py --benchmark-json=benchmarks/results/savings.json
    python benchmarks/report.py benchmarks/results/savings.json

The whole chain of `stss`, about 100 stars, a Gaussian of 0.7 px. Medians, and the quartiles of the ratios of
neighbouring turns. Both ways give the same counts.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpsim as ws
from warpsim.launches import Launch, Stage
from warpsim.render import pipeline, schedule, stages
from warpsim.render.buffers import Signal
from warpsim.render.device_scene import DeviceScene
from warpsim.speed.work import N_CALL, SpeedWork, render_call, speed_work

N_TURN = 15


@wp.kernel(enable_backward=False)
def touch_all_kernel(touched: wp.array[wp.uint8]):
    touched[wp.tid()] = wp.uint8(1)


def deposit_and_touch_all(scene: DeviceScene, sources: Any, brightness: wp.array | None, signal: Signal) -> Stage:
    """A deposit after which no strip counts as dark."""
    stage, touched = stages.deposit(scene, sources, brightness, signal), signal.touched.flatten()
    touch_all = Launch(touch_all_kernel, (touched.size,), [], [touched], scene.device)
    return Stage(stage.name, stage.n_view, [*stage.launches, touch_all])


# What is done, and how it is left out: what to change while a renderer makes its pipelines, or an argument of it.
SAVINGS: dict[str, tuple[tuple[Any, str, Any] | None, dict[str, Any]]] = {
    "dark strips are not read": ((pipeline, "deposit", deposit_and_touch_all), {}),
    "images few at a time": ((schedule, "SIGNAL_BYTES_AT_A_TIME", 2**62), {}),
    "memory of results used again": (None, {"pool_bytes": 0}),
}


def clocked(work: SpeedWork, renderer: ws.Renderer, calls: Any) -> Callable[[], float]:
    """A turn: seconds per image."""

    def turn() -> float:
        begin = time.perf_counter()
        render_call(work, renderer, next(calls))
        return (time.perf_counter() - begin) / work.n_view

    return turn


@pytest.mark.parametrize("n_pixel", [128, 1024])
@pytest.mark.parametrize("saving", SAVINGS)
def test_saving(benchmark, monkeypatch, saving, n_pixel, device):
    size = (n_pixel, 100, 1, "gaussian") if benchmark.enabled else (32, 5, 1, "gaussian", 2)
    work = speed_work(*size)
    change, arguments = SAVINGS[saving]
    with_it = ws.Renderer(work.scene, device, 1, work.catalog)
    without = ws.Renderer(work.scene, device, 1, work.catalog, **arguments)
    with monkeypatch.context() as patch:
        if change:
            patch.setattr(*change)
        for call in range(N_CALL):  # all, so that pipelines are as large as any call needs
            render_call(work, without, call)
    for call in range(N_CALL):
        np.testing.assert_array_equal(render_call(work, without, call), render_call(work, with_it, call))
    turns = [clocked(work, renderer, itertools.count(1)) for renderer in (with_it, without)]
    times: list[list[float]] = []
    benchmark.pedantic(lambda: times.append([turn() for turn in turns]), rounds=N_TURN)
    median_us = np.median(times, axis=0) * 1e6
    low, ratio, high = np.percentile([b / a for a, b in times], [25, 50, 75])
    benchmark.extra_info |= {
        "device": device,
        "saving": saving,
        "pixels": f"{n_pixel}^2",
        "us per image": round(float(median_us[0]), 1),
        "us without it": round(float(median_us[1]), 1),
        "ratio": f"{ratio:.2f} ({low:.2f} to {high:.2f})",
    }
