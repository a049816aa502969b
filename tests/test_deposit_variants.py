"""Other ways to add up light, which the benchmark compares: all draw the same image."""

import numpy as np
import pytest
import warp as wp

import warpsim as ws
from benchmarks.deposit_variants import QUANTUM, VARIANTS, Variant
from warpsim.optics.psf_bank import stamp_rule

SEED = 161803
SHAPE = (40, 50)
FLOAT32_RTOL = 2e-6  # of the brightest pixel: 400 sources, 30 additions at a pixel


def sources(device, n=400):
    rng = np.random.default_rng(SEED)
    xy = wp.array(rng.uniform(-2, [52, 42], (n, 2)), dtype=wp.vec2d, device=device)
    return xy, wp.array(rng.uniform(0, 1, n), dtype=wp.float32, device=device)


@pytest.mark.parametrize("name", VARIANTS)
@pytest.mark.ci
def test_variants_draw_the_same_image(device, name):
    xy, irradiance = sources(device)
    psf = ws.PsfAiry(0.478)
    product = ws.deposit(xy.numpy(), irradiance.numpy(), psf, SHAPE, device=device, flux_error=1e-6)
    variant = Variant(name, psf, SHAPE, device, 4)
    variant.draw(xy, irradiance, stamp_rule([0.0], 1e-6, device))
    np.testing.assert_allclose(variant.values(), product, rtol=0, atol=FLOAT32_RTOL * product.max())


@pytest.mark.ci
def test_fixed_point_does_not_ask_for_the_order(device):
    xy, irradiance = sources(device)
    rule = stamp_rule([0.0], 1e-6, device)
    variant = Variant("scatter fixed point", ws.PsfAiry(0.478), SHAPE, device, 4)
    variant.draw(xy, irradiance, rule)
    one = variant.values()
    order = np.random.default_rng(SEED).permutation(len(xy))
    mixed = [wp.array(a.numpy()[order], dtype=a.dtype, device=device) for a in (xy, irradiance)]
    variant.draw(*mixed, rule)
    np.testing.assert_array_equal(variant.values(), one)
    exact = Variant("gather float64", ws.PsfAiry(0.478), SHAPE, device, 4)
    exact.draw(xy, irradiance, rule)
    np.testing.assert_allclose(one, exact.values(), rtol=0, atol=QUANTUM * len(xy))
