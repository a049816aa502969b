"""Time of each stage of an image, by image size, stars, and point spread function.

    python -m pytest benchmarks/test_stages.py --benchmark-json=benchmarks/results/stages.json
    python benchmarks/report.py benchmarks/results/stages.json

One thread, one sensor, one band of `stss`. A stage's time is the median over full chunks, its launches included; the
whole is a call without clocks inside, so that what is no stage shows as the difference: Python between launches, and
the first touch of new memory. On CUDA the device is waited for after each stage, which costs some microseconds of its
own per launch.
"""

from __future__ import annotations

import itertools

import pytest
import warp as wp

import warpsim as ws
from warpsim.speed.report import PAPER_FPS
from warpsim.speed.work import speed_work, stage_times_us

# Pixels, stars in view, point spread function.
CASES = [
    *itertools.product(PAPER_FPS, [100], ["gaussian", "airy"]),
    *itertools.product([128, 1024], [1_000, 10_000], ["gaussian"]),
]


@pytest.mark.parametrize(("n_pixel", "n_star", "psf"), CASES)
def test_stages(benchmark, us_per_image, n_pixel, n_star, psf, device, resident):
    work = speed_work(n_pixel, n_star, psf=psf, n_frame=None if benchmark.enabled else 2)
    whole_us = us_per_image(work, ws.Renderer(work.scene, device, 1, work.catalog), resident)
    if whole_us is None:
        return
    benchmark.extra_info.update(
        n_pixel=n_pixel,
        n_star=n_star,
        psf=psf,
        device=device,
        device_name=wp.get_device(device).name,
        n_thread=1,
        resident=resident,
        stage_us=stage_times_us(work, device, n_round=7, resident=resident),
        whole_us=whole_us,
    )
