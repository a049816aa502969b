"""Stamps drawn several pixels at a time: tables laid out for it, edges of images, and flags of what has got light."""

import math

import numpy as np
import pytest
import warp as wp
from drawing import draw, source_lists
from scipy import special
from streak_oracles import axis_fractions
from warpsim_kernels.canvas import STRIP_PIXELS, flags_of_image, n_flag
from warpsim_kernels.psf import TABLE_SIMD_WIDTH, natural_log

import warpsim as ws
from warpsim.optics.psf_bank import PsfBank, stamp_rule
from warpsim.optics.table_upload import axis_table, by_block
from warpsim.optics.tables import epsf_table

SEED = 577215
LOG_ATOL = 3e-7  # five float32 roundings, of two terms and their sum, relative to logarithms above 1; measured 1.1e-7
FRACTION_ATOL = 1e-7  # a table's own rounding to float32, at most 3e-8, and interpolation
WING_RTOL = 2e-5  # of each pixel of a stamp: interpolation at 8 sigma, 6e-6, along both axes; the rest is float32

PSFS = [ws.PsfGaussian(0.01), ws.PsfGaussian(0.7), ws.PsfGaussian(3.0), ws.PsfAiry(0.185), ws.PsfAiry(1.5, 0.3)]
every_psf = pytest.mark.parametrize("psf", PSFS, ids=["sharp", "gauss", "wide", "airy-sharp", "airy-annular"])


@every_psf
@pytest.mark.ci
def test_a_launch_keeps_the_tables_of_its_bank(device, psf):
    """Others may take the memory of what is held no more."""
    xy, rule, shape = [[7.3, 8.1]], stamp_rule([0.0], 1e-4, device), (16, 17)
    expected = draw(xy, [1.0], psf, shape, device, rule)
    bank = PsfBank([psf], wp.get_device(device))
    tables = [value for value in vars(bank).values() if isinstance(value, wp.array)]
    sizes = [table.size * wp.types.type_size_in_bytes(table.dtype) for table in tables]
    signal = wp.zeros((1, 1, *shape), dtype=wp.float32, device=device)
    launch = bank.deposit(source_lists(xy, [1.0], device), rule, shape[0], signal)
    del bank, tables
    others = [wp.full(size, 255, dtype=wp.uint8, device=device) for size in sizes for _ in range(20)]
    launch.run()
    np.testing.assert_array_equal(signal.numpy()[0, 0], expected)
    del others


@wp.kernel(enable_backward=False)
def log_kernel(x: wp.array[float], y: wp.array[float]):
    y[wp.tid()] = natural_log(x[wp.tid()])


def test_logarithm(device):
    x = np.concatenate([np.logspace(-37, 37, 20_001), np.linspace(0.5, 2.0, 20_001)]).astype(np.float32)
    y = wp.empty(len(x), dtype=wp.float32, device=device)
    wp.launch(log_kernel, len(x), [wp.array(x, dtype=wp.float32, device=device)], [y], device=device)
    exact = np.log(x.astype(np.float64))
    assert (np.abs(y.numpy() - exact) / np.maximum(np.abs(exact), 1.0)).max() < LOG_ATOL


@pytest.mark.parametrize("sigma_px", [1e-4, 0.01, 0.064, 0.35, 0.7, 5.0, 64.0])
def test_table_of_a_gaussian_holds_its_fractions(sigma_px):
    fraction, n_step, per_px, n_pixel = axis_table(sigma_px)
    assert fraction.shape == (2 * n_step + 4, n_pixel)
    assert fraction.nbytes < 2e5
    row = np.random.default_rng(SEED).integers(0, len(fraction), 50)
    offset_px = (row - n_step - 1) / per_px  # of the edge before the pixel n_pixel / 2
    low = (offset_px[:, None] + np.arange(n_pixel) - n_pixel // 2) / sigma_px
    exact = special.ndtr(low + 1 / sigma_px) - special.ndtr(low)
    np.testing.assert_allclose(fraction[row], exact, rtol=0, atol=FRACTION_ATOL)


@pytest.mark.parametrize("sigma_px", [0.03, 0.35, 0.7, 2.0, 20.0])
def test_every_pixel_of_a_gaussian_stamp_keeps_its_digits(device, sigma_px):
    """Wings of a source 1e13 times brighter than what it may leave out; down to 1e-13 of the light."""
    shape = (220, 230) if sigma_px > 10 else (60, 64)
    for xy in np.random.default_rng(SEED).uniform(0.4, 0.6, (6, 2)) * shape[::-1]:
        image = draw([xy], [1.0], ws.PsfGaussian(sigma_px), shape, device, stamp_rule([0.0], 1e-14, device))
        expected = np.outer(axis_fractions([xy[1]], shape[0], sigma_px), axis_fractions([xy[0]], shape[1], sigma_px))
        bright = expected > 1e-13
        np.testing.assert_allclose(image[bright], expected[bright], rtol=WING_RTOL, atol=0)


@pytest.mark.parametrize("psf", [ws.PsfAiry(0.478), ws.PsfAiry(1.5, 0.3)], ids=str)
def test_blocks_hold_the_table(psf):
    table = epsf_table(psf)
    fraction, zero_pixel = by_block(table)
    n_row, n_block, n_phase, simd_width = fraction.shape
    assert (n_row, simd_width) == (table.fraction.shape[0], TABLE_SIMD_WIDTH)
    rng, per_px, before = np.random.default_rng(SEED), table.per_px[1], table.n_point // 2 - 1
    for _ in range(200):
        row, pixel, phase = rng.integers(n_row), rng.integers(n_block * simd_width), rng.integers(n_phase)
        node = abs((pixel - zero_pixel) * per_px + phase - per_px // 2 - before)
        if node + table.zero[1] < table.fraction.shape[1]:
            assert (
                fraction[row, pixel // simd_width, phase, pixel % simd_width]
                == table.fraction[row, table.zero[1] + node]
            )
    steps = math.ceil(table.reach_px[1] + 0.5)
    assert zero_pixel >= steps and n_block * simd_width - zero_pixel > steps


@every_psf
@pytest.mark.parametrize("cut", [1e-3, 1e-8])
def test_edges_of_an_image_cut_stamps_and_change_no_bit(device, psf, cut):
    """Vectors that would leave the image are drawn pixel by pixel: each image is a part of a wider one."""
    rng = np.random.default_rng(SEED)
    xy, flux = rng.uniform(-3, [43, 15], (60, 2)), rng.uniform(0.1, 5, 60)
    rule = stamp_rule([0.0], cut, device)
    wide = draw(xy, flux, psf, (13, 90), device, rule)
    for n_col in (1, 3, 7, 8, 15, 16, 17, 31, 40):
        np.testing.assert_array_equal(draw(xy, flux, psf, (13, n_col), device, rule), wide[:, :n_col])


@wp.kernel(enable_backward=False)
def flags_kernel(n_pixel: wp.array[int], n: wp.array[int]):
    n[wp.tid()] = flags_of_image(n_pixel[wp.tid()])


def test_number_of_flags(device):
    """As many as whole blocks have strips: 16 for every 2048 pixels."""
    n_pixel = [1, 127, 2047, 2048, 2049, 128 * 128, 1024 * 1023, 2**29 - 1]
    n = wp.empty(len(n_pixel), dtype=int, device=device)
    wp.launch(flags_kernel, len(n_pixel), [wp.array(n_pixel, dtype=int, device=device)], [n], device=device)
    expected = [16 * len(range(0, pixels, 2048)) for pixels in n_pixel]
    assert n.numpy().tolist() == expected == [n_flag(pixels) for pixels in n_pixel]


@every_psf
@pytest.mark.parametrize("shape", [(1, 1), (37, 5), (50, 16), (40, 100), (30, 128), (21, 331)], ids=str)
def test_flags_tell_which_strips_have_light(device, psf, shape):
    rng = np.random.default_rng(SEED)
    for n_row_per_block in (shape[0], 4):
        for cut, n_source in ((1e-2, 6), (1e-2, 1), (1e-6, 1), (1e-9, 1)):
            xy = rng.uniform(-2, [shape[1] + 1, shape[0] + 1], (n_source, 2))
            touched = wp.zeros((1, 1, n_flag(shape[0] * shape[1])), dtype=wp.uint8, device=device)
            rule = stamp_rule([0.0], cut, device)
            image = draw(
                xy, np.ones(n_source), psf, shape, device, rule, n_row_per_block=n_row_per_block, touched=touched
            )
            strips = np.zeros((touched.size, STRIP_PIXELS))
            strips.ravel()[: image.size] = image.ravel()
            np.testing.assert_array_equal(touched.numpy()[0, 0], (strips != 0).any(axis=1))


def test_flags_of_many_images(device):
    """Each view and band has its own; what was set stays set."""
    n_view, shape = 3, (20, 30)
    sources = [
        wp.array([1, 0, 1], dtype=wp.int32, device=device),
        wp.array([[[3.0, 4.0]], [[0.0, 0.0]], [[25.0, 18.0]]], dtype=wp.vec2d, device=device),
        wp.array([[[1.0], [0.0]], [[0.0], [0.0]], [[1.0], [2.0]]], dtype=wp.float32, device=device),
    ]
    signal = wp.zeros((n_view, 2, *shape), dtype=wp.float32, device=device)
    touched = wp.zeros((n_view, 2, n_flag(shape[0] * shape[1])), dtype=wp.uint8, device=device)
    bank = PsfBank([ws.PsfGaussian(0.5)] * 2, wp.get_device(device))
    launch = bank.deposit(sources, stamp_rule([0.0, 0.0], 1e-3, device), shape[0], signal, touched=touched)
    for _ in range(2):
        launch.run()
        assert touched.numpy()[..., :5].tolist() == [
            [[1, 1, 0, 0, 0], [0, 0, 0, 0, 0]],
            [[0, 0, 0, 0, 0], [0, 0, 0, 0, 0]],
            [[0, 0, 0, 1, 1], [0, 0, 0, 1, 1]],
        ]
