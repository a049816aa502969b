"""Drawing point sources: ns per source beside the error, by stamp, by length of streak, and by way of adding up.

Run: python -m pytest benchmarks/test_deposit.py --benchmark-json=benchmarks/results/deposit.json
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.paths import Paths

import warpsim as ws
from benchmarks.deposit_variants import VARIANTS, Variant
from warpsim.optics.psf_bank import psf_bank, stamp_rule
from warpsim.render.device import rows_per_block

DEVICES = ["cpu", *(["cuda:0"] if wp.is_cuda_available() else [])]
SHAPE = (256, 256)
PSFS = {"gaussian 0.7": ws.PsfGaussian(0.7), "airy 0.185": ws.PsfAiry(0.185), "airy 1.5": ws.PsfAiry(1.5)}

pytestmark = pytest.mark.parametrize("device", DEVICES)


def field(n_source: int, device: str, margin_px: float = 40.0) -> list[wp.array]:
    """Sources of flux 0.1 to 1 at random places: n_source, xy_px, irradiance."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(margin_px, SHAPE[0] - margin_px, (1, n_source, 2))
    return [
        wp.array([n_source], dtype=wp.int32, device=device),
        wp.array(xy, dtype=wp.vec2d, device=device),
        wp.array(rng.uniform(0.1, 1.0, (1, 1, n_source)), dtype=wp.float32, device=device),
    ]


def timed(benchmark: Any, draw: Any, device: str, n_source: int) -> float:
    """Median time of a call over the sources [ns]."""

    def once() -> None:
        draw()
        wp.synchronize_device(device)

    benchmark.pedantic(once, rounds=9, warmup_rounds=2)
    return float(1e9 * benchmark.stats.stats.median / n_source)


@pytest.mark.parametrize("cut", [1e-2, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", PSFS)
def test_stamps(benchmark, name, cut, device):
    """Still sources: time by what their stamps leave out."""
    n, psf = 2000, PSFS[name]
    sources, bank = field(n, device), psf_bank([psf], wp.get_device(device))
    rule = stamp_rule([0.0], cut, device)
    signal = wp.empty((1, 1, *SHAPE), dtype=wp.float32, device=device)
    rows = rows_per_block(wp.get_device(device), SHAPE[0])
    ns = timed(benchmark, lambda: bank.deposit(sources, rule, rows, signal), device, n)
    one = ws.deposit([[128.2, 127.6]], [1.0], psf, SHAPE, device=device, flux_error=max(cut, 1e-9))
    benchmark.extra_info.update(
        kind="stamps", device=device, deposit_psf=name, cut=cut, n_pixel=int((one > 0).sum()), ns_per_source=ns
    )


@pytest.mark.parametrize("streak_error", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("length_px", [0.0, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("name", PSFS)
def test_streaks(benchmark, name, length_px, streak_error, device):
    """Moving sources: time by the error asked, which stamps may leave out too, and the worst error of quadrature."""
    n, psf = (2000 if length_px < 50 else 100), PSFS[name]
    sources, bank = field(n, device, 60.0), psf_bank([psf], wp.get_device(device))
    angle = np.random.default_rng(2).uniform(0, 2 * np.pi, n)
    movement = np.zeros((1, n, 2, 2))
    movement[0, :, 1] = 0.5 * length_px * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    paths: Any = Paths()
    paths.offset_px = wp.array(movement, dtype=wp.vec2, device=device)
    signal = wp.empty((1, 1, *SHAPE), dtype=wp.float32, device=device)
    rows = rows_per_block(wp.get_device(device), SHAPE[0])

    def draw(error: float) -> None:
        bank.deposit(sources, stamp_rule([0.0], error, device, error), rows, signal, paths)

    ns = timed(benchmark, lambda: draw(streak_error), device, n)
    worst = 0.0
    for number in range(10):  # one at a time, so that errors do not add up
        alone = [
            wp.array([1], dtype=wp.int32, device=device),
            wp.array(sources[1].numpy()[:, number : number + 1], dtype=wp.vec2d, device=device),
            wp.array(np.ones((1, 1, 1)), dtype=wp.float32, device=device),
        ]
        one: Any = Paths()
        one.offset_px = wp.array(movement[:, number : number + 1], dtype=wp.vec2, device=device)
        images = []
        for error in (streak_error, 1e-7):
            bank.deposit(alone, stamp_rule([0.0], 1e-7, device, error), rows, signal, one)
            images.append(signal.numpy().copy())
        worst = max(worst, float(np.abs(images[0] - images[1]).max()))
    benchmark.extra_info.update(
        kind="streaks",
        device=device,
        deposit_psf=name,
        length_px=length_px,
        streak_error=streak_error,
        error=worst,
        ns_per_source=ns,
    )


@pytest.mark.parametrize("n_source", [1000, 100_000])
@pytest.mark.parametrize("variant", VARIANTS)
def test_ways_to_add_up(benchmark, variant, n_source, device):
    """Gathered or scattered, in float32, float64 or fixed point; errors are those of the sums, against float64."""
    psf, rule = ws.PsfAiry(0.478), stamp_rule([0.0], 1e-4, device)
    _, xy, irradiance = (array.flatten() for array in field(n_source, device))
    rows = rows_per_block(wp.get_device(device), SHAPE[0])
    way = Variant(variant, psf, SHAPE, device, rows)
    ns = timed(benchmark, lambda: way.draw(xy, irradiance, rule), device, n_source)
    exact = Variant("gather float64", psf, SHAPE, device, rows)
    exact.draw(xy, irradiance, rule)
    error = np.abs(way.values() - exact.values()).max() / exact.values().max()
    benchmark.extra_info.update(
        kind="ways to add up",
        device=device,
        deposit_psf="airy 0.478",
        variant=variant,
        n_source=n_source,
        error=float(error),
        ns_per_source=ns,
    )
