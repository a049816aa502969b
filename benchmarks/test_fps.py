"""Frames per second against resolution: one sensor, one band, whole chain, counts in host memory (paper, Table 7).

    python -m pytest benchmarks/test_fps.py --benchmark-json=benchmarks/results/fps.json
    python benchmarks/report.py benchmarks/results/fps.json

Each round renders other frames of `stss`, 10 ms apart: aim, star query, 30 targets, deposit, fresh noise, 14-bit
uint16. Kernels are compiled and buffers warm before the clock starts. Beside its time each case carries the error of
its point spread function: the worst pixel of a unit source against float64 quadrature.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import warp as wp
from scipy.special import erf, j1

import warpsim as ws
from warpsim.render.speed import PAPER_FPS, frames_per_call, speed_scene

DEVICES = ["cpu", *(["cuda:0"] if wp.is_cuda_available() else [])]


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("psf", ["airy", "gaussian"])
@pytest.mark.parametrize("n_pixel", list(PAPER_FPS))
def test_fps(benchmark, n_pixel, psf, device):
    scene = speed_scene(n_pixel, psf)
    renderer = ws.Renderer(scene, device)
    sensor = renderer.sensors_with_access[0]
    n_frame = frames_per_call(n_pixel)
    starts = itertools.count(0, n_frame)

    def one_call():
        first = next(starts)
        counts = renderer.render(range(first, first + n_frame), sensors=[sensor], bands=["A"]).counts.numpy()
        assert counts.shape == (n_frame, 1, 1, n_pixel, n_pixel)

    benchmark.pedantic(one_call, rounds=9, warmup_rounds=2, iterations=1)
    if benchmark.stats is None:  # --benchmark-disable: only see that it runs
        return
    fps = n_frame / benchmark.stats.stats.median
    benchmark.extra_info.update(
        n_pixel=n_pixel,
        psf=psf,
        device=str(wp.get_device(device)),
        device_name=wp.get_device(device).name,
        n_thread=renderer.n_thread,
        frames_per_call=n_frame,
        fps=fps,
        paper_fps=PAPER_FPS[n_pixel],
        psf_error=psf_error(scene.psf("A")),
    )


def psf_error(psf: ws.PsfGaussian | ws.PsfAiry) -> float:
    """Worst pixel of a unit source over a few phases, against float64 quadrature over 7 x 7 pixels."""
    worst = 0.0
    for dx, dy in [(0.0, 0.0), (0.31, -0.27), (0.5, 0.5), (-0.44, 0.12)]:
        image = ws.deposit([[8 + dx, 8 + dy]], [1.0], psf, (17, 17), device="cpu").astype(np.float64)
        for row, column in itertools.product(range(5, 12), repeat=2):
            exact = pixel_share(psf, column - 8 - dx, row - 8 - dy)
            worst = max(worst, abs(image[row, column] - exact))
    return worst


def pixel_share(psf: ws.PsfGaussian | ws.PsfAiry, x: float, y: float) -> float:
    """Share of a unit source in the pixel at offset (x, y)."""
    if isinstance(psf, ws.PsfAiry):
        return sum(part * airy_share(radius, x, y) for radius, part in zip(psf.radii_px, psf.parts, strict=True))
    a = np.array([x - 0.5, x + 0.5, y - 0.5, y + 0.5]) / (psf.sigma_px * np.sqrt(2))
    return float((erf(a[1]) - erf(a[0])) * (erf(a[3]) - erf(a[2])) / 4)


def airy_share(radius_px: float, x: float, y: float) -> float:
    """Share of a unit Airy pattern of one wavelength in the pixel at offset (x, y)."""
    node, weight = np.polynomial.legendre.leggauss(16)
    # Panels no longer than the core is wide, bounded at the source, where the pattern bends most.
    panels = [
        np.unique(np.concatenate([np.linspace(c - 0.5, c + 0.5, 1 + int(np.ceil(4 / radius_px))), _inside(c)]))
        for c in (x, y)
    ]
    axes = []
    for edges in panels:
        half = np.diff(edges) / 2
        axes.append(((edges[:-1] + half)[:, None] + half[:, None] * node, half[:, None] * weight))
    (xs, wx), (ys, wy) = ((p.ravel(), w.ravel()) for p, w in axes)
    v = np.maximum(np.hypot(xs[None, :], ys[:, None]) * np.pi * 1.2196698912665045 / radius_px, 1e-12)
    lambda_f = radius_px / 1.2196698912665045
    brightness = np.pi / 4 / lambda_f**2 * (2 * j1(v) / v) ** 2
    return float(wy @ brightness @ wx)


def _inside(centre: float) -> list[float]:
    return [0.0] if abs(centre) < 0.5 else []
