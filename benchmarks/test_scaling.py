"""Growth of cost: linear in pixels and in sources, not at all in the size of the catalog; memory by chunk.

    python -m pytest benchmarks/test_scaling.py --benchmark-json=benchmarks/results/scaling.json
    python benchmarks/report.py benchmarks/results/scaling.json --plot scaling.png

One thread, one sensor, one band of `stss`, a Gaussian of 0.7 px. Catalogs of 1e4 to 1e7 stars are equally dense, 242
stars in view: each holds the stars of the smaller ones, and others further away from where the camera looks. Ten
million stars take about 5 GB: leave them out with -k "not 10000000".
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import warpsim as ws
from warpsim.speed.work import BAND, SpeedWork, power_law_nei, speed_work, stage_times_us

SKY_STARS = 10_000_000
"""Of the largest catalog, which covers the sky."""

MB = 2**20


def work_of(benchmark, n_pixel: int, n_star: int) -> SpeedWork:
    return speed_work(n_pixel, n_star, psf="gaussian", n_frame=None if benchmark.enabled else 2)


def note(benchmark, scaling: str, x: float, us_per_image: float | None, device: str, **facts: Any) -> None:
    if us_per_image is not None:
        benchmark.extra_info.update(
            scaling=scaling, x=x, us_per_image=us_per_image, device=device, n_thread=1, **facts
        )  # fmt: skip


@pytest.mark.parametrize("n_pixel", [64, 128, 256, 512, 1024, 2048])
def test_pixels(benchmark, us_per_image, n_pixel, device):
    work = work_of(benchmark, n_pixel, 100)
    us = us_per_image(work, ws.Renderer(work.scene, device, 1, work.catalog))
    note(benchmark, "pixels of an image", n_pixel**2, us, device)


@pytest.mark.parametrize("n_star", [0, 100, 300, 1_000, 3_000, 10_000])
def test_sources(benchmark, us_per_image, n_star, device):
    work = work_of(benchmark, 256, n_star)
    us = us_per_image(work, ws.Renderer(work.scene, device, 1, work.catalog))
    note(benchmark, "sources in view", n_star + len(work.scene.target_names), us, device)


@pytest.mark.parametrize("n_star", [10_000, 100_000, 1_000_000, SKY_STARS])
def test_catalog(benchmark, us_per_image, n_star, device):
    full = benchmark.enabled
    work = work_of(benchmark, 128, 0)
    catalog = even_sky(work, n_star if full else n_star // 1000)
    work = replace(work, catalog=catalog, n_star=242)
    us = us_per_image(work, ws.Renderer(work.scene, device, 1, catalog))
    if us is not None:
        stage_us = stage_times_us(work, device)["gather_stars"]
        note(benchmark, "stars in the catalog", n_star, us, device, gather_stars_us=stage_us)


def even_sky(work: SpeedWork, n_star: int) -> ws.StarCatalog:
    """The stars of an evenly filled sky that are next to where the sensor looks; so many, nearest first."""
    rng = np.random.default_rng(83)
    axis = work.scene.scenario.view_axes(work.sensors[0], [work.scene.frames.start_s])[0, 2]
    # In the order of their distance, stars fill equal areas: 1 - cos(distance) grows evenly.
    along = 1.0 - 2.0 * (np.arange(n_star) + rng.uniform(size=n_star)) / SKY_STARS
    turn = np.random.default_rng(84).uniform(0, 2 * np.pi, n_star)
    right = np.cross(axis, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    across = np.sqrt(1.0 - along**2)
    star = along[:, None] * axis + (across * np.cos(turn))[:, None] * right
    star += (across * np.sin(turn))[:, None] * np.cross(axis, right)
    per_jy = ws.StarCatalog.from_arrays([0.0], [0.0], {BAND: [1.0]}).irradiance_w_cm2(BAND)[0]
    flux_jy = power_law_nei(n_star) * work.scene.scenario.instrument.nei_w_cm2(BAND) / per_jy
    ra_deg = np.degrees(np.arctan2(star[:, 1], star[:, 0])) % 360.0
    dec_deg = np.degrees(np.arcsin(np.clip(star[:, 2], -1.0, 1.0)))
    return ws.StarCatalog.from_arrays(ra_deg, dec_deg, {BAND: flux_jy}, id=np.full(n_star, ""))


@pytest.mark.parametrize("chunk_mb", [1, 2, 4, 8, 16, 32, 64])
@pytest.mark.parametrize("n_pixel", [128, 1024])
def test_chunk(benchmark, us_per_image, n_pixel, chunk_mb, device):
    """Time and memory against the memory that a chunk may take."""
    work = work_of(benchmark, n_pixel, 100)
    renderer = ws.Renderer(work.scene, device, 1, work.catalog, chunk_bytes=chunk_mb * MB)
    us = us_per_image(work, renderer)
    scaling = f"memory of a chunk [MB], {n_pixel} x {n_pixel}"
    note(benchmark, scaling, chunk_mb, us, device, buffer_mb=renderer.buffer_bytes / MB)
