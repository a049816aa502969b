"""Savings of each setting of accuracy on whole images: speed against error, one thread.

    python -m pytest benchmarks/test_approximations.py --benchmark-json=benchmarks/results/approximations.json
    python benchmarks/report.py benchmarks/results/approximations.json --plot approximations.png

Time is that of the whole chain per image of `stss` with about 100 stars. The error of a setting is that of the worst
pixel of noiseless images, in units of a pixel's noise, against the same scene at the setting's finest. What stages do
on their own is in test_deposit.py, test_read_out.py, test_signatures.py, test_star_places.py and test_star_query.py.

Nodes of tracks are found once per scene: their time is that of the scene, their error the distance from the propagator
at the worst of 2,000 random times.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

import warpsim as ws
from warpsim.orbit.node_steps import make_tracks
from warpsim.speed.work import BAND, SpeedWork, speed_work

N_CHECKED = 3
"""Frames whose images are compared."""

EXPOSED = {"detector__exposure_s": 0.05, "frames__interval_s": 0.05, "frames__count": 10_000}
WIDE = {"optics__stamp_cut_nei": 3e-3}  # so that the edges of stamps are not what is seen
SUNLIT = {"epoch_utc": "2025-03-20T00:00:00"}

# Setting: point spread function, pixels, what else is changed, values, the finest value.
SETTINGS = {
    "optics.stamp_cut_nei, Gaussian": ("gaussian", 256, {}, (3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.001), 1e-5),
    "optics.stamp_cut_nei, Airy": ("airy", 1024, {}, (3.0, 1.0, 0.3, 0.1, 0.03, 0.01), 1e-3),
    "optics.psf_error": ("airy", 1024, WIDE, (1e-2, 1e-3, 1e-4, 1e-5, 1e-6), 6e-7),
    "optics.psf_error, narrow pattern": ("airy", 128, WIDE, (1e-2, 1e-3, 1e-4, 1e-5, 1e-6), 6e-7),
    "optics.n_interval": ("airy", 1024, WIDE, (1, 2, 4, 6, 12), 32),
    "detector.streaks": ("gaussian", 256, EXPOSED, (False, True), True),
    "lighting.leave_out_nei": ("gaussian", 256, SUNLIT, (1000.0, 100.0, 10.0, 0.01), 0.0),
    "lighting.quadrature_error": ("gaussian", 256, {**EXPOSED, **SUNLIT}, (0.1, 1e-2, 1e-3, 1e-4), 1e-5),
}
CASES = [(name, value) for name, setting in SETTINGS.items() for value in setting[3]]


def changed(work: SpeedWork, changes: dict) -> SpeedWork:
    """Another scene over the same time, for which there are stars."""
    scene = work.scene.replace(**changes)
    n_frame = max(1, round(work.n_frame * work.scene.frames.interval_s / scene.frames.interval_s))
    return replace(work, scene=scene, n_frame=n_frame)


def signal_nei(work: SpeedWork, device: str) -> np.ndarray:
    """Noiseless images of some frames, spread over all calls."""
    frames = np.linspace(0, 4 * work.n_frame - 1, N_CHECKED).astype(int).tolist()
    renderer = ws.Renderer(work.scene, device, 1, work.catalog)
    signal = renderer.render(frames, work.sensors, [BAND], keep_signal=True).signal_w_cm2.numpy()
    return signal.astype(np.float64) / work.scene.scenario.instrument.nei_w_cm2(BAND)


@pytest.mark.parametrize(("name", "value"), CASES, ids=[f"{name}-{value}" for name, value in CASES])
def test_setting(benchmark, us_per_image, name, value, device):
    psf, n_pixel, changes, _, finest = SETTINGS[name]
    field = name.partition(",")[0].replace(".", "__")
    shape = (n_pixel, 100, None) if benchmark.enabled else (32, 5, 2)
    plain = changed(speed_work(shape[0], shape[1], psf=psf, n_frame=shape[2]), changes)
    work = changed(plain, {field: value})
    us = us_per_image(work, ws.Renderer(work.scene, device, 1, work.catalog))
    if us is not None:
        finest_work = changed(plain, {field: finest})
        error = np.abs(signal_nei(work, device) - signal_nei(finest_work, device)).max()
        note(benchmark, device, name, value, us, error_nei=float(error), n_pixel=n_pixel)


@pytest.mark.parametrize("error_m", [1.0, 1e-1, 1e-2, 1e-3, 1e-4])
def test_track_nodes(benchmark, error_m):
    full = benchmark.enabled
    orbit = ws.Walker(28 if full else 2, 2, 1, altitude_km=1598, inclination_deg=78)
    epoch = ws.Scene.load("stss").epoch
    duration_s = 86400.0 if full else 600.0

    def state(time_s):
        return orbit.states(epoch, time_s)

    names = [f"{row}" for row in range(orbit.n_satellite)]
    make = benchmark.pedantic(make_tracks, args=(names, state, duration_s, error_m), rounds=5, warmup_rounds=1)
    if benchmark.stats is None:
        return
    time_s = np.sort(np.random.default_rng(7).uniform(0, duration_s, 2000))
    exact_m = state(time_s)[0]
    found_m = np.stack([track.position_at_m(time_s) for track in make], axis=1)
    begin = time.perf_counter()
    for track in make:
        track.position_at_m(time_s)
    host_us = (time.perf_counter() - begin) / len(make) / len(time_s) * 1e6
    note(
        benchmark, "cpu", "error of tracks [m]", error_m, None, scene_s=benchmark.stats.stats.median, host_us=host_us,
        error_m=float(np.linalg.norm(found_m - exact_m, axis=-1).max()), n_node=make[0].n_node,
    )  # fmt: skip


def note(benchmark, device: str, setting: str, value: object, us_per_image: float | None, **facts: object) -> None:
    benchmark.extra_info.update(
        setting=setting, value=value, us_per_image=us_per_image, device=device, n_thread=1, **facts
    )
