"""Stamps drawn several pixels at a time, by laid-out tables or polynomials in cells; flags of illuminated strips."""

import functools
import math

import numpy as np
import pytest
import warp as wp
from conftest import slow
from drawing import draw, draw_each, source_lists
from scipy import special
from streak_oracles import axis_fractions
from warpsim_kernels.canvas import STRIP_PIXELS, flags_of_image, n_flag
from warpsim_kernels.psf import TABLE_SIMD_WIDTH, natural_log
from warpsim_kernels.spots import table_spots
from warpsim_kernels.stamps import StampRule, columns_of_row, whole_image
from warpsim_kernels.table_layout import CELL_DEGREES, TableLayout, n_term_of

import warpsim as ws
from warpsim.errors import InputError
from warpsim.optics.cell_table import BLOCK_PX, MOST_CELLS, cell_bytes, cell_table, cells_for
from warpsim.optics.flow import pixel_fractions
from warpsim.optics.image_table import spline_of
from warpsim.optics.pattern import FIRST_DARK_RING, AiryPattern
from warpsim.optics.psf_bank import PsfBank, stamp_rule
from warpsim.optics.table_upload import axis_table, by_block
from warpsim.optics.tables import TableAccuracy, cheapest_layout, epsf_table, fitted_nodes, polynomials

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


CELL_SEED = 141421
N_SOURCE, CELL_SHAPE = 400, (24, 30)
CELL_LINE = "Polynomials of patterns, radius 0.1 to 10 px, against their stated error"


def hard_and_random_positions(n, rng):
    """On corners, edges and middles of pixels and cells and next to them, and anywhere; some off the image."""
    near = rng.choice([-0.5, -0.25, 0.0, 0.25, 0.5], (n, 2)) + rng.choice([-1e-6, 0.0, 1e-6], (n, 2))
    middle = rng.integers(-2, [CELL_SHAPE[1] + 2, CELL_SHAPE[0] + 2], (n, 2))
    return np.where(rng.random((n, 1)) < 0.5, middle + near, middle + rng.uniform(-0.5, 0.5, (n, 2)))


def offsets(xy):
    """Of all pixels from each source, along columns and rows."""
    dx = np.arange(CELL_SHAPE[1]) - xy[:, 0, None, None] + np.zeros((CELL_SHAPE[0], 1))
    dy = np.arange(CELL_SHAPE[0])[:, None] - xy[:, 1, None, None] + np.zeros(CELL_SHAPE[1])
    return dx.ravel(), dy.ravel()


@pytest.mark.parametrize("degree", CELL_DEGREES)
@pytest.mark.parametrize(
    ("radius_px", "aspect"), [(0.1, 1.0), (0.478, 1.0), (0.478, 1.4), slow(1.5, 0.7), slow(1.5, 1.0), (10.0, 1.0)]
)
@pytest.mark.ci
def test_pixels_keep_the_error_asked_for(device, degree, radius_px, aspect, record_accuracy):
    error = 6e-7 if degree > 3 or radius_px > 1 else 1e-4
    if degree == 5 and radius_px < 0.2:
        error = 1e-5
    psf = ws.PsfAiry(radius_px, 0.3)
    xy = hard_and_random_positions(N_SOURCE, np.random.default_rng(CELL_SEED))
    found = draw_each(xy, psf, CELL_SHAPE, device, 1e-9, aspect, TableAccuracy(error, None, degree))
    pattern = AiryPattern((radius_px / FIRST_DARK_RING,), (1.0,), 0.3, 0.0)
    dx, dy = offsets(xy)
    exact = pixel_fractions(pattern.flow(60.0), dx, dy, aspect).reshape(found.shape)
    table = polynomials(psf, aspect, error, degree)
    assert table.degree == degree and table.error <= error
    worst = np.abs(found - exact).max()
    assert worst <= table.error + 1e-9  # what the stamp leaves out
    if error == 6e-7:
        record_accuracy(CELL_LINE, worst, error, "of the flux", "quadrature")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degree", "oversample", "smear_px"), [(3, 5.0, 0.0), (5, 5.0, 0.0), (7, 5.0, 0.0), (3, 7.0, 0.3), (3, 9.0, 0.4)]
)
def test_images_without_symmetry(device, degree, oversample, smear_px):
    """A table that is not mirrored, off its middle: against the spline through the same samples."""
    y, x = np.mgrid[:41, :47]
    samples = np.exp(-0.5 * (((x - 25.0) / 4.0) ** 2 + ((y - 17.0) / 2.5) ** 2)) + 0.3 * np.exp(
        -((x - 14.0) ** 2) / 9 - (y - 25.0) ** 2 / 20
    )
    psf, error = ws.PsfTable(samples, oversample, smear_px), 1e-4 if (degree, oversample) == (3, 5.0) else 1e-5
    n_cell = np.array(polynomials(psf, 1.0, error, degree).n_cell)
    middles = 8.0 + (np.arange(n_cell[1]) + 0.5) / n_cell[1] - 0.5  # of cells, where errors are large
    grid = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    xy = np.concatenate([hard_and_random_positions(N_SOURCE, np.random.default_rng(CELL_SEED)), grid])
    found = draw_each(xy, psf, CELL_SHAPE, device, 1e-9, accuracy=TableAccuracy(error, None, degree))
    exact = spline_of(psf.image, oversample, smear_px, 1.0).fractions(*offsets(xy)).reshape(found.shape)
    assert np.abs(found - exact).max() <= error


def test_layout():
    table = polynomials(ws.PsfAiry(1.5), 1.0, 6e-7, 5)
    n_row, n_column = table.n_cell
    assert n_row % 2 == n_column % 2 == 0 and table.nodes.mirrored
    cells_down, cells_across, n_block, rows, n_term, simd_width = table.coefficient.shape
    assert (cells_down, cells_across) == (n_row // 2, n_column)
    assert (n_term, simd_width) == (n_term_of(5), 2 * BLOCK_PX)
    assert table.coefficient.nbytes == table.n_byte == cell_bytes(table.nodes, 5, table.n_cell)
    reach_row, reach_column = table.nodes.reach_px
    assert table.zero[0] >= reach_row and rows - 1 - table.zero[0] >= reach_row
    assert table.zero[1] >= reach_column and (n_block - 1) * BLOCK_PX - table.zero[1] > reach_column - BLOCK_PX
    # Blocks overlap by half, and hold the same there.
    one, two = table.coefficient[:, :, :-1, :, :, BLOCK_PX:], table.coefficient[:, :, 1:, :, :, :BLOCK_PX]
    np.testing.assert_array_equal(one, two)


def test_polynomials_are_shared():
    psf = ws.PsfAiry(1.21)
    assert polynomials(psf, 1.0, 6e-7, 5) is polynomials(psf, 1.0, 6e-7, 5)


def test_cheapest_layout():
    """Low degrees for wide patterns and loose errors, nodes for those that would fill too many cells."""
    assert cheapest_layout([ws.PsfAiry(1.5)]) == TableLayout(5)
    assert cheapest_layout([ws.PsfAiry(1.5)], 1.0, TableAccuracy(1e-4)) == TableLayout(3)
    assert cheapest_layout([ws.PsfAiry(0.15)]) == TableLayout(7)
    assert cheapest_layout([ws.PsfAiry(0.1)]).degree == 0
    assert cheapest_layout([ws.PsfAiry(0.01)]) == TableLayout(0, 8)
    assert cheapest_layout([ws.PsfAiry(1.5), ws.PsfAiry(0.01)]).degree == 0  # one kernel for both
    assert cheapest_layout([ws.PsfAiry(1.5)], 1.0, TableAccuracy(6e-7, 6)) == TableLayout(0, 6)
    assert cheapest_layout([ws.PsfAiry(1.5)], 1.0, TableAccuracy(6e-7, None, 7)) == TableLayout(7)


def test_too_many_cells_are_refused():
    nodes = fitted_nodes(ws.PsfAiry(0.02), 1.0, 6e-7)
    assert nodes is not None and cells_for(nodes, 3, 6e-7) is None
    assert cell_table(nodes, 3, 6e-7, (MOST_CELLS + 2, MOST_CELLS)) is None
    with pytest.raises(InputError, match="needs too many cells"):
        polynomials(ws.PsfAiry(0.02), 1.0, 6e-7, 3)


@functools.cache
def make_light_kernel(layout):
    """Kernel over pixels that draws one source as the kernel for blocks of threads does."""
    spots = table_spots(layout)
    Tables, spot_of, row_of, light_at = spots.Tables, spots.spot_of, spots.row_of, spots.light_at

    @wp.kernel(module="unique", enable_backward=False)
    def light_kernel(tables: Tables, xy_px: wp.vec2d, rule: StampRule, image: wp.array2d[float]):
        row, column = wp.tid()
        spot = spot_of(tables, 0, xy_px, 1.0, rule, whole_image(image.shape[0], image.shape[1]))
        columns = columns_of_row(spot.stamp, row)
        inside = row >= spot.stamp.window.first_row and row < spot.stamp.window.end_row
        if inside and column >= columns[0] and column < columns[1]:
            image[row, column] = light_at(tables, 0, spot, row_of(tables, 0, spot, row), column)

    return light_kernel


@pytest.mark.parametrize("layout", [*(TableLayout(degree) for degree in CELL_DEGREES), TableLayout(0, 6)], ids=str)
@pytest.mark.ci
def test_single_pixels_are_those_of_the_stamp(layout):
    """Bit for bit on the CPU, on both sides of the reach; the kernel for blocks of threads reads pixels one by one."""
    psf, cut = ws.PsfAiry(1.5), 1e-7
    accuracy = TableAccuracy(1e-4, layout.n_point or None, layout.degree)
    bank, rule = PsfBank([psf], "cpu", 1.0, accuracy), stamp_rule([0.0], cut, "cpu")
    xy = hard_and_random_positions(20, np.random.default_rng(CELL_SEED))
    for position, expected in zip(xy, draw_each(xy, psf, CELL_SHAPE, "cpu", cut, accuracy=accuracy), strict=True):
        image = wp.zeros(CELL_SHAPE, dtype=wp.float32, device="cpu")
        inputs = [bank.tables, wp.vec2d(*position), rule]
        wp.launch(make_light_kernel(layout), CELL_SHAPE, inputs, [image], device="cpu")
        np.testing.assert_array_equal(image.numpy(), expected)
