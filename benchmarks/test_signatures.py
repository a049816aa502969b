"""Targets observed a second, by terms of their light and by threads.

    python -m pytest benchmarks/test_signatures.py --benchmark-json=benchmarks/results/signatures.json
    python benchmarks/report.py benchmarks/results/signatures.json --plot signatures.png

`light_curves` of the preset in sunlight: geometry, attitude, areas and all three bands of its 30 targets, seen by the
sensors with access. The error is that of a scene's light against the finest quadrature, as a share of the brightest.
"""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws

OFF = {"sun": False, "earth": False, "albedo": False}
TERMS = {
    "emission": OFF,
    "+ Sun": {**OFF, "sun": True},
    "+ Sun, Earth": {**OFF, "sun": True, "earth": True},
    "all": {},
}
ERRORS = (1e-1, 1e-2, 1e-3, 1e-4)
FINEST = 1e-5
EXPOSURE_S = 0.03


def sunlit() -> ws.Scene:
    """The preset at an hour when Sun and sunlit ground matter."""
    return ws.Scene.load("stss").replace(epoch_utc="2025-03-20T00:00:00")


@pytest.mark.parametrize("n_thread", [1, 2])
@pytest.mark.parametrize("terms", TERMS)
def test_terms(benchmark, terms, n_thread, device):
    scene = sunlit().replace(lighting={**TERMS[terms], "leave_out_nei": 0.0})
    measure(benchmark, scene, n_thread, device, kind="terms", terms=terms, light_error=0.0)


@pytest.mark.parametrize("error", ERRORS)
@pytest.mark.parametrize("exposure_s", [EXPOSURE_S])
def test_error(benchmark, error, exposure_s, device):
    scene = sunlit().replace(
        lighting={"quadrature_error": error, "leave_out_nei": 0.0}, detector__exposure_s=exposure_s
    )
    finest = scene.replace(lighting__quadrature_error=FINEST)
    times = np.linspace(0, scene.duration_s, 12)
    light, exact = (
        ws.light_curves(s, times, ["sat11", "sat47"], device=device).irradiance_w_cm2 for s in (scene, finest)
    )
    share = np.abs(light - exact).max(axis=(0, 1, 2)) / exact.max(axis=(0, 1, 2))
    measure(
        benchmark, scene, 1, device, kind="error", asked=error, exposure_s=exposure_s, light_error=float(share.max())
    )


def measure(benchmark, scene: ws.Scene, n_thread: int, device: str, **info: object) -> None:
    """Time light curves, and note how many observations a second that is."""
    n_time = 1500 if benchmark.enabled else 1
    times = np.linspace(0, scene.duration_s, n_time)
    sensors = ws.Renderer(scene, device=device).sensors_with_access

    def run() -> ws.LightCurves:
        return ws.light_curves(scene, times, sensors, device=device, n_thread=n_thread)

    run()  # compiled
    curves = benchmark.pedantic(run, rounds=5, warmup_rounds=0)
    if benchmark.stats is None:
        return
    n_observation = curves.range_km.size
    benchmark.extra_info.update(
        device=device,
        n_thread=n_thread,
        n_band=len(curves.bands),
        n_observation=n_observation,
        us_per_observation=benchmark.stats.stats.median / n_observation * 1e6,
        observations_per_s=n_observation / benchmark.stats.stats.median,
        **info,
    )
