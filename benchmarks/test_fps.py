"""Frames per second against image size, sensors and stars: one band, whole chain, counts in host memory (Table 7).

    python -m pytest benchmarks/test_fps.py --benchmark-json=benchmarks/results/fps.json
    python benchmarks/report.py benchmarks/results/fps.json

Each round renders other frames of `stss`, 10 ms apart: aim, star query, 30 targets, deposit, fresh noise, 14-bit
uint16. With `--resident` counts stay on the device. Kernels are compiled and buffers warm before the clock starts.
Beside its time each case carries the error of its point spread function: the worst pixel of a unit source against
float64 quadrature.
"""

from __future__ import annotations

import itertools

import pytest
import warp as wp

import warpsim as ws
from benchmarks.psf_oracle import psf_error
from warpsim.speed.report import PAPER_FPS
from warpsim.speed.work import BAND, render_call, speed_work

# Pixels, sensors, stars in view, point spread function.
CASES = [
    *itertools.product(PAPER_FPS, [1], [100], ["airy", "gaussian"]),
    *itertools.product(PAPER_FPS, [4, 20], [100], ["airy"]),
    *itertools.product(PAPER_FPS, [1], [1_000, 10_000], ["gaussian"]),
]
SMALL_FRAMES = 2


@pytest.mark.parametrize(("n_pixel", "n_sensor", "n_star", "psf"), CASES)
def test_fps(benchmark, us_per_image, n_pixel, n_sensor, n_star, psf, device, resident):
    work = speed_work(n_pixel, n_star, n_sensor, psf, None if benchmark.enabled else SMALL_FRAMES)
    renderer = ws.Renderer(work.scene, device, catalog=work.catalog)
    assert render_call(work, renderer, 0, resident).shape == (work.n_frame, n_sensor, 1, n_pixel, n_pixel)
    us = us_per_image(work, renderer, resident, rounds=9, warmup_rounds=2)
    if us is None:  # --benchmark-disable: only see that it runs
        return
    benchmark.extra_info.update(
        n_pixel=n_pixel,
        n_sensor=n_sensor,
        n_star=n_star,
        psf=psf,
        device=str(wp.get_device(device)),
        device_name=wp.get_device(device).name,
        n_thread=renderer.n_thread,
        resident=resident,
        frames_per_call=work.n_frame,
        fps=1e6 / us,
        paper_fps=PAPER_FPS[n_pixel],
        psf_error=psf_error(work.scene.scenario.instrument.psf(BAND), device),
    )
