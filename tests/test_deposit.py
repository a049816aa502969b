"""Point sources on pixels: every fraction against error functions or direct quadrature in float64."""

import time

import numpy as np
import pytest
import warp as wp
from conftest import slow
from drawing import draw, draw_each, source_lists, stamp_fractions
from psf_oracles import converged_airy_fraction
from streak_oracles import airy_streak, axis_fractions

import warpsim as ws
from benchmarks.deposit_variants import QUANTUM, VARIANTS, Variant
from warpsim.optics.psf_bank import PsfBank, stamp_rule

SEED = 314159
N_PHASE = 12_500  # per sigma; 1e5 over the eight

GAUSSIAN_ATOL = 2e-7
"""Asked for, per unit flux. Float32 offsets, error functions and products: 1.2e-7 over 1e5 phases, on any processor."""
DEFAULT_ATOL = 1e-6
"""Asked for, and what flux_error's default promises. Stamps leave out just the pixels whose fractions are sure to be
below it, which may come close to it; no rounding adds to those."""
AIRY_ATOL = 1e-6
"""Asked for, per unit flux, of table interpolation and wing, and with the default of what stamps leave out."""
WIDE_RTOL = 1e-5  # against the peak: per axis, two float32 error functions rounded to 3e-8 leave a fraction of 8e-3
CLOSURE_ATOL = 1e-6  # a stamp and what the oracle says lies outside it

CUT_LINE = "Stamps as large as an error of 1e-6 asks for"

UNDERFLOW = 1e-37  # float32 holds fewer digits below

SIGMAS_PX = [0.01, 0.03, 0.064, 0.35, 0.7, 2.0, 5.0, 50.0]
AIRY_RADII_PX = [0.03, 0.185, 0.478, 1.5, 4.0, 10.0]


def airy_radii_px(*of_seconds):
    """Parameters; those whose oracle takes some seconds are for CI."""
    return [pytest.param(px, marks=[pytest.mark.ci] * (px in of_seconds)) for px in AIRY_RADII_PX]


SHAPE = (24, 32)
HARD_POINTS = {
    "centre": (16.0, 12.0),
    "edge": (16.5, 12.0),
    "corner": (16.5, 12.5),
    "just-left-of-an-edge": (np.nextafter(16.5, 0), 12.0),
    "frame-corner-half-out": (-0.5, -0.5),
    "far-corner-half-out": (31.5, 23.5),
    "one-pixel-out": (-1.3, 10.2),
    "three-out-above": (7.9, 26.5),
}


def gaussian_image(xy_px, flux, sigma_px, shape):
    """All sources at once: sum over sources of flux * rows * columns."""
    xy = np.atleast_2d(xy_px)
    rows = axis_fractions(xy[:, 1], shape[0], sigma_px) * np.asarray(flux, dtype=np.float64)[:, None]
    return rows.T @ axis_fractions(xy[:, 0], shape[1], sigma_px)


@pytest.mark.ci
@pytest.mark.parametrize("sigma_px", SIGMAS_PX)
def test_gaussian_at_random_phases(device, sigma_px, record_accuracy):
    shape = (14, 18)
    rng = np.random.default_rng(SEED)
    xy = rng.uniform(-2, [19, 15], (N_PHASE, 2))
    xy[: N_PHASE // 10] = np.round(2 * xy[: N_PHASE // 10]) / 2  # a tenth exactly on centres, edges and corners
    rows, columns = axis_fractions(xy[:, 1], shape[0], sigma_px), axis_fractions(xy[:, 0], shape[1], sigma_px)
    expected = rows[:, :, None] * columns[:, None, :]
    fine = draw_each(xy, ws.PsfGaussian(sigma_px), shape, device, 1e-9)
    np.testing.assert_allclose(fine, expected, rtol=0, atol=GAUSSIAN_ATOL)
    coarse = draw_each(xy, ws.PsfGaussian(sigma_px), shape, device, 1e-6)
    np.testing.assert_allclose(coarse, expected, rtol=0, atol=DEFAULT_ATOL)
    error = np.abs(coarse - expected).max()
    record_accuracy(CUT_LINE, error, DEFAULT_ATOL, "of the flux", "error functions, quadrature")
    error = np.abs(fine - expected).max()
    record_accuracy("Gaussian integrated over a pixel", error, GAUSSIAN_ATOL, "of the flux", "error functions")


@pytest.mark.parametrize("xy_px", HARD_POINTS.values(), ids=HARD_POINTS)
@pytest.mark.parametrize("sigma_px", SIGMAS_PX)
def test_gaussian_at_hard_points(device, sigma_px, xy_px, record_accuracy):
    expected = gaussian_image(xy_px, [1.0], sigma_px, SHAPE)
    psf = ws.PsfGaussian(sigma_px)
    fine = ws.deposit([xy_px], [1.0], psf, SHAPE, device=device, flux_error=1e-9)
    np.testing.assert_allclose(fine, expected, rtol=0, atol=GAUSSIAN_ATOL)
    coarse = ws.deposit([xy_px], [1.0], psf, SHAPE, device=device)
    np.testing.assert_allclose(coarse, expected, rtol=0, atol=DEFAULT_ATOL)
    error = np.abs(fine - expected).max()
    record_accuracy("Gaussian integrated over a pixel", error, GAUSSIAN_ATOL, "of the flux", "error functions")


def test_wide_gaussian_is_right_against_its_own_peak(device):
    xy = [[70.3, 61.7]]
    image = ws.deposit(xy, [1.0], ws.PsfGaussian(50.0), (128, 140), device=device, flux_error=1e-9)
    expected = gaussian_image(xy, [1.0], 50.0, (128, 140))
    np.testing.assert_allclose(image, expected, rtol=0, atol=WIDE_RTOL * expected.max())


def airy_offsets(rng):
    """Source positions, and for each the pixels to look at: near ones and some far out."""
    for x, y in [*HARD_POINTS.values(), *rng.uniform(4, 20, (4, 2))]:
        near = [(round(y) + j, round(x) + i) for j in range(-1, 2) for i in range(-1, 2)]
        far = zip(rng.integers(0, SHAPE[0], 8), rng.integers(0, SHAPE[1], 8), strict=True)
        inside = [(r, c) for r, c in [*near, *far] if 0 <= r < SHAPE[0] and 0 <= c < SHAPE[1]]
        yield (x, y), np.array(inside)


@pytest.mark.parametrize("obscuration", [0.0, slow(0.3)])
@pytest.mark.parametrize("radius_px", airy_radii_px(0.03, 1.5, 10.0))
def test_airy_at_hard_and_random_points(device, radius_px, obscuration, record_accuracy):
    psf = ws.PsfAiry(radius_px, obscuration)
    for (x, y), pixels in airy_offsets(np.random.default_rng(SEED)):
        expected = [converged_airy_fraction(c - x, r - y, radius_px, obscuration) for r, c in pixels]
        for flux_error in (1e-6, 1e-9):
            image = ws.deposit([(x, y)], [1.0], psf, SHAPE, device=device, flux_error=flux_error)
            np.testing.assert_allclose(image[tuple(pixels.T)], expected, rtol=0, atol=AIRY_ATOL)
            error = np.abs(image[tuple(pixels.T)] - expected).max()
            if flux_error == 1e-6:
                record_accuracy(CUT_LINE, error, AIRY_ATOL, "of the flux", "error functions, quadrature")
            else:
                record_accuracy("Airy pattern integrated over a pixel", error, AIRY_ATOL, "of the flux", "quadrature")


@pytest.mark.parametrize("sigma_px", SIGMAS_PX[:-1])
def test_flux_closes_gaussian(device, sigma_px, record_accuracy):
    shape = (80, 90)
    xy = np.random.default_rng(SEED).uniform(-3, [92, 82], (50, 2))
    images = draw_each(xy, ws.PsfGaussian(sigma_px), shape, device, 1e-10)
    inside = axis_fractions(xy[:, 1], 80, sigma_px).sum(1) * axis_fractions(xy[:, 0], 90, sigma_px).sum(1)
    np.testing.assert_allclose(images.sum((1, 2)), inside, rtol=0, atol=CLOSURE_ATOL)
    error = np.abs(images.sum((1, 2)) - inside).max()
    record_accuracy("Sum of a stamp", error, CLOSURE_ATOL, "of the flux", "flux less what falls outside")


CUTS = [0.3, 0.03, 1e-3, 1e-4, 1e-5, 1e-6]


@pytest.mark.parametrize("sigma_px", SIGMAS_PX[:-1])
def test_no_pixel_outside_a_gaussian_stamp_holds_more_than_the_cut(device, sigma_px):
    shape, worst = (60, 64), []
    xy = np.random.default_rng(SEED).uniform([31.5, 29.5], [32.5, 30.5], (150, 2))
    xy[:50] = np.round(2 * xy[:50]) / 2
    for cut in CUTS:
        images = draw_each(xy, ws.PsfGaussian(sigma_px), shape, device, cut)
        rows, columns = axis_fractions(xy[:, 1], 60, sigma_px), axis_fractions(xy[:, 0], 64, sigma_px)
        left_out = (rows[:, :, None] * columns[:, None, :])[images == 0].max()
        assert left_out <= cut
        worst.append(left_out / cut)
    assert sigma_px < 0.3 or max(worst) > 0.3  # stamps are no larger than they must be


@pytest.mark.parametrize("obscuration", [0.0, slow(0.3)])
@pytest.mark.parametrize("radius_px", airy_radii_px(0.03, 0.185))
def test_no_pixel_outside_an_airy_stamp_holds_more_than_the_cut(device, radius_px, obscuration):
    worst, still, is_sharp = [], (np.zeros(1), np.ones(1)), radius_px < 0.1
    shape, n = ((14, 16), 5) if is_sharp else ((60, 64), 12)
    period_px = 20.0 if is_sharp else 150.0  # the series takes (2 period / lambda F)^2 terms
    xy = np.random.default_rng(SEED).uniform(-0.5, 0.5, (n, 2))
    xy[:3] = [[-0.5, -0.5], [0, 0], [-0.5, 0]]
    xy += [shape[1] // 2, shape[0] // 2]
    exact = np.array([airy_streak(p, [[0, 0]], [1], radius_px, obscuration, shape, still, period_px) for p in xy])
    for cut in CUTS:
        images = draw_each(xy, ws.PsfAiry(radius_px, obscuration), shape, device, cut)
        left_out = exact[images == 0].max(initial=0.0)
        assert left_out <= cut + 5e-7  # the oracle's own error in a field that repeats
        worst.append(left_out / cut)
    assert max(worst) > 0.3


@pytest.mark.parametrize("psf", [ws.PsfGaussian(2.0), ws.PsfAiry(0.478), ws.PsfAiry(1.5, 0.3)], ids=str)
@pytest.mark.parametrize("cut", [1e-2, 1e-3, 1e-5, 1e-7])
def test_stamps_are_alike_left_and_right_and_round(device, psf, cut):
    for n in (80, 81):  # a source on a corner, and one on a centre
        middle = (n - 1) / 2
        (image,) = draw_each([[middle, middle]], psf, (n, n), device, cut)
        for other in (image[:, ::-1], image[::-1], image.T):
            np.testing.assert_array_equal(other != 0, image != 0)
            np.testing.assert_allclose(other, image, rtol=0, atol=GAUSSIAN_ATOL)
        reach_px = np.abs(np.nonzero(image)[1] - middle).max()
        if 6 < reach_px < 0.4 * n:
            corner_px = np.hypot(*(np.array(np.nonzero(image)) - middle)).max()
            assert corner_px < reach_px + 1
            assert np.count_nonzero(image) == pytest.approx(np.pi * reach_px**2 + 4 * reach_px, rel=0.1)


@pytest.mark.ci
@pytest.mark.parametrize("psf", [ws.PsfAiry(0.478), ws.PsfAiry(4.0, 0.3)], ids=str)
def test_a_very_bright_source_fills_a_wide_image(device, psf):
    """1e8 NEI and more: the wings go on to the corners of a frame of 1500 pixels; rings are averaged over 20."""
    shape, xy = (1500, 1400), [201.3, 333.8]
    image = draw([xy], [1.0], psf, shape, device, stamp_rule([1e-14], 0.0, device))
    assert (image > 0).all()
    for row, column in [(324, 900), (1480, 1380), (0, 1380), (700, 201)]:
        rows, columns = np.arange(row, row + 20), np.arange(column, column + 20)
        offsets = [(c - xy[0], r - xy[1]) for r in rows for c in columns]
        fractions = [converged_airy_fraction(*offset, psf.radius_px, psf.obscuration) for offset in offsets]
        found = image[row : row + 20, column : column + 20].mean()
        assert found == pytest.approx(np.mean(fractions), rel=0.05, abs=0)


def test_a_wide_gaussian_fills_a_wide_image(device):
    shape, xy = (900, 1100), [[20.2, 450.4]]
    image = draw(xy, [1.0], ws.PsfGaussian(50.0), shape, device, stamp_rule([1e-15], 0.0, device))
    expected = gaussian_image(xy, [1.0], 50.0, shape)
    np.testing.assert_allclose(image, expected, rtol=0, atol=WIDE_RTOL * expected.max())
    assert image[450, 360] > 0 and image[450, 385] == 0


@pytest.mark.parametrize(
    "psf", [ws.PsfGaussian(0.35), ws.PsfGaussian(5.0), ws.PsfAiry(0.478, 0.3), ws.PsfAiry(4.0)], ids=str
)
@pytest.mark.parametrize("cut", [1e-2, 1e-4, 3e-7, 1e-8])
@pytest.mark.ci
def test_reported_fractions_are_those_of_the_image(device, psf, cut):
    shape, rule = (901, 901), stamp_rule([0.0], cut, device)
    xy = 450 + np.random.default_rng(SEED).uniform(-0.5, 0.5, (3, 2))
    peak, stamp = stamp_fractions(xy, np.ones(len(xy)), psf, device, rule)
    for number in range(3):
        image = draw(xy[number : number + 1], [1.0], psf, shape, device, rule)
        assert stamp[number] == pytest.approx(image.sum(), rel=0, abs=CLOSURE_ATOL)
        assert peak[number] == pytest.approx(image[450, 450], rel=0, abs=GAUSSIAN_ATOL)


@pytest.mark.parametrize("psf", [ws.PsfAiry(0.185), ws.PsfAiry(0.478, 0.3)], ids=str)
def test_reported_fraction_of_stamps_of_thousands_of_pixels(device, psf):
    """Beyond a radius r lies 2 pi w / r of the light, w = lambda F / (pi^3 (1 - eps))."""
    wing_px3 = psf.radius_px / 1.2196698912665045 / np.pi**3 / (1 - psf.obscuration)
    for cut in (1e-11, 1e-13, 1e-15):
        _, stamp = stamp_fractions([[5.2, 5.4]], [1.0], psf, device, stamp_rule([0.0], cut, device))
        reach_px = np.cbrt(wing_px3 / cut)
        assert 1 - stamp[0] == pytest.approx(2 * np.pi * wing_px3 / reach_px, rel=0, abs=5e-5)
    xy = np.random.default_rng(SEED).uniform(0, 9, (200, 2))
    start = time.perf_counter()
    stamp_fractions(xy, np.ones(len(xy)), psf, device, stamp_rule([0.0], 1e-15, device))
    assert time.perf_counter() - start < 4  # 20 ms each; by pixels it would be an hour


def test_each_band_has_its_own_cut(device):
    psf, xy = ws.PsfGaussian(1.0), [[20.1, 12.3]]
    sources = source_lists(xy, np.full(2, 1e-15), device)
    signal = wp.zeros((1, 2, 24, 32), dtype=wp.float32, device=device)
    cuts = [1e-18, 1e-21]
    PsfBank([psf, psf], wp.get_device(device)).deposit(sources, stamp_rule(cuts, 0.0, device), 24, signal).run()
    for image, cut in zip(signal.numpy()[0], cuts, strict=True):
        (expected,) = draw_each(xy, psf, (24, 32), device, cut / 1e-15)
        np.testing.assert_allclose(image, 1e-15 * expected, rtol=1e-6, atol=0)


@pytest.mark.parametrize("psf", [ws.PsfGaussian(0.5), ws.PsfAiry(0.478)], ids=str)
@pytest.mark.ci
def test_stamps_of_faint_and_bright_sources_in_one_frame(device, psf):
    """Fifteen decades: what is left out stays below the cut everywhere."""
    flux, cut, shape = np.logspace(-25, -10, 16), 1e-19, (120, 130)
    xy = np.random.default_rng(SEED).uniform(10, 110, (16, 2))
    image = draw(xy, flux, psf, shape, device, stamp_rule([cut], 0.0, device))
    if isinstance(psf, ws.PsfGaussian):
        expected = gaussian_image(xy, flux, psf.sigma_px, shape)
        np.testing.assert_array_less(np.abs(image - expected), 16 * cut + 1e-6 * expected + 1e-30)
        return
    still = np.zeros(1), np.ones(1)
    expected = flux @ [airy_streak(p, [[0, 0]], [1], psf.radius_px, 0, shape, still, 260).ravel() for p in xy]
    expected = expected.reshape(shape)
    distance = np.hypot(*(np.indices(shape)[::-1, ..., None] - xy.T[:, None, None]))
    table = 1e-6 * np.minimum(1, (18 / distance) ** 3) @ flux  # of the light, and of the wings what rings make of it
    np.testing.assert_array_less(np.abs(image - expected), 16 * cut + table)


def test_two_sources_within_a_thousandth_of_a_pixel(device):
    for psf in PSFS:
        near = ws.deposit([[10.4999, 7.5], [10.5003, 7.5001]], [1.0, 2.0], psf, SHAPE, device=device)
        positions = ([10.4999, 7.5], 1.0), ([10.5003, 7.5001], 2.0)
        alone = [ws.deposit([position], [flux], psf, SHAPE, device=device) for position, flux in positions]
        np.testing.assert_allclose(near, alone[0] + alone[1], rtol=0, atol=3 * GAUSSIAN_ATOL)


PSFS = [ws.PsfGaussian(0.064), ws.PsfGaussian(0.7), ws.PsfAiry(0.478), ws.PsfAiry(1.5, 0.3)]
every_psf = pytest.mark.parametrize("psf", PSFS, ids=["gauss-sharp", "gauss", "airy-sharp", "airy-annular"])


def field(n=60, span=(32, 24)):
    """Random sources, on a grid of 2**-20 px, so that whole-pixel shifts are exact."""
    rng = np.random.default_rng(SEED)
    xy = np.round(rng.uniform(-2, np.add(span, 2), (n, 2)) * 2**20) / 2**20
    return xy, rng.uniform(0.1, 5.0, n).astype(np.float32).astype(np.float64)


@every_psf
def test_whole_pixel_shift_moves_the_image_bit_by_bit(device, psf):
    xy, flux = field()
    image = ws.deposit(xy, flux, psf, (60, 70), device=device)
    moved = ws.deposit(np.add(xy, [9.0, 14.0]), flux, psf, (60, 70), device=device)
    np.testing.assert_array_equal(moved[14:, 9:], image[:-14, :-9])


@every_psf
def test_mirror_and_transpose(device, psf):
    xy, flux = field()
    image = ws.deposit(xy, flux, psf, SHAPE, device=device, flux_error=1e-8)
    mirrored = ws.deposit(xy * [-1, 1] + [31, 0], flux, psf, SHAPE, device=device, flux_error=1e-8)
    turned = ws.deposit(xy[:, ::-1], flux, psf, SHAPE[::-1], device=device, flux_error=1e-8)
    atol = GAUSSIAN_ATOL * flux.sum()
    np.testing.assert_allclose(mirrored[:, ::-1], image, rtol=0, atol=atol)
    np.testing.assert_allclose(turned.T, image, rtol=0, atol=atol)


@every_psf
def test_linear_in_flux_and_independent_of_order(device, psf):
    xy, flux = field()
    whole = ws.deposit(xy, flux, psf, SHAPE, device=device)
    halves = [ws.deposit(xy[part], flux[part], psf, SHAPE, device=device) for part in (slice(25), slice(25, None))]
    atol = GAUSSIAN_ATOL * flux.sum()
    np.testing.assert_allclose(halves[0] + halves[1], whole, rtol=0, atol=atol)
    np.testing.assert_allclose(ws.deposit(xy[::-1], flux[::-1], psf, SHAPE, device=device), whole, rtol=0, atol=atol)
    scaled = ws.deposit(xy, flux * -(2.0**40), psf, SHAPE, device=device) / -(2.0**40)
    np.testing.assert_allclose(scaled, whole, rtol=2.0**-23, atol=UNDERFLOW)


@every_psf
@pytest.mark.parametrize("n_row_per_block", [1, 3, 4, 23])
def test_row_blocks_do_not_change_a_bit(device, psf, n_row_per_block):
    xy, flux = field()
    rule = stamp_rule([0.0], 1e-6, device)
    whole, blocks = (draw(xy, flux, psf, SHAPE, device, rule, n_row_per_block=n) for n in (None, n_row_per_block))
    np.testing.assert_array_equal(blocks, whole)


@every_psf
def test_far_sources_and_none_leave_the_image_dark(device, psf):
    far = [[1e300, 0.0], [-1e9, 5.0], [5.0, 2.0**31], [-(2.0**40), -(2.0**40)], [3000.0, 3000.0]]
    assert not ws.deposit(far, np.ones(5), psf, SHAPE, device=device).any()
    assert not ws.deposit(np.empty((0, 2)), [], psf, SHAPE, device=device).any()
    assert not ws.deposit([[3.0, 4.0]], [0.0], psf, SHAPE, device=device).any()


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (37, 2)], ids=str)
def test_thin_images(device, shape):
    xy, flux = field(40, shape[::-1])
    image = ws.deposit(xy, flux, ws.PsfGaussian(0.7), shape, device=device, flux_error=1e-9)
    assert image.shape == shape and image.dtype == np.float32
    expected = gaussian_image(xy, flux, 0.7, shape)
    np.testing.assert_allclose(image, expected, rtol=0, atol=GAUSSIAN_ATOL * flux.sum())


def test_fluxes_over_fifteen_decades_in_one_frame(device):
    flux = np.append(np.logspace(-25, -10, 16), -1e-14)  # a negative one too
    xy = np.array([[10.3 + 20 * i, 8.6] for i in range(17)])
    image = ws.deposit(xy, flux, ws.PsfGaussian(0.5), (18, 350), device=device)
    for (x, y), strength in zip(xy, flux, strict=True):
        first = int(x) - 9
        expected = gaussian_image([[x - first, y]], [1.0], 0.5, (18, 19))
        np.testing.assert_allclose(image[:, first : first + 19] / strength, expected, rtol=0, atol=DEFAULT_ATOL)


def light_in_reach(xy_px, flux, half_width_px, shape):
    """Flux of all sources whose stamp may hold each pixel."""
    rows, columns = (
        np.abs(np.arange(n) - np.floor(xy_px[:, axis, None] + 0.5)) <= half_width_px
        for n, axis in ((shape[0], 1), (shape[1], 0))
    )
    return (rows * flux[:, None]).T @ columns


@pytest.mark.slow
def test_a_million_sources_in_one_frame(device):
    """A thousand a pixel: the float32 sum still errs by less than each source may by itself."""
    rng = np.random.default_rng(SEED)
    expected, allowed, lists = np.zeros(SHAPE), np.zeros(SHAPE), []
    for _ in range(10):
        xy, flux = rng.uniform(-2, [34, 26], (100_000, 2)), rng.uniform(0, 1, 100_000)
        expected += gaussian_image(xy, flux, 0.7, SHAPE)
        allowed += DEFAULT_ATOL * light_in_reach(xy, flux, 4, SHAPE)
        lists.append((xy, flux))
    image = ws.deposit(*map(np.concatenate, zip(*lists, strict=True)), ws.PsfGaussian(0.7), SHAPE, device=device)
    assert (np.abs(image - expected) / allowed).max() <= 1


BAD = {
    "flat-xy": (([1.0, 2.0], [1.0], SHAPE, 1e-6), r"^xy_px: must have shape \(n, 2\), got \(2,\)$"),
    "three-columns": (([[1.0, 2.0, 3.0]], [1.0], SHAPE, 1e-6), r"^xy_px: must have shape"),
    "flux-length": (([[1.0, 2.0]], [1.0, 2.0], SHAPE, 1e-6), r"^flux: must have shape \(1,\) like xy_px, got \(2,\)$"),
    "nan-xy": (([[np.nan, 2.0]], [1.0], SHAPE, 1e-6), "^xy_px: must be finite"),
    "inf-flux": (([[1.0, 2.0]], [np.inf], SHAPE, 1e-6), "^flux: must be finite"),
    "no-rows": (([[1.0, 2.0]], [1.0], (0, 5), 1e-6), r"^shape: must be \(n_row, n_col\)"),
    "shape-1d": (([[1.0, 2.0]], [1.0], (5,), 1e-6), "^shape: must be"),
    "flux-error-zero": (([[1.0, 2.0]], [1.0], SHAPE, 0.0), r"^flux_error: must be in \[1e-9, 1\), got 0.0$"),
    "flux-error-one": (([[1.0, 2.0]], [1.0], SHAPE, 1.0), "^flux_error: must be in"),
    "flux-error-nan": (([[1.0, 2.0]], [1.0], SHAPE, np.nan), "^flux_error: must be in"),
}


@pytest.mark.parametrize(("arguments", "message"), BAD.values(), ids=BAD)
def test_bad_input_is_named_in_one_line(arguments, message):
    xy, flux, shape, flux_error = arguments
    with pytest.raises(ws.InputError, match=message) as caught:
        ws.deposit(xy, flux, ws.PsfGaussian(0.5), shape, device="cpu", flux_error=flux_error)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is one")
@pytest.mark.parametrize("name", ["cuda", "cuda:0"])
def test_a_gpu_that_is_not_there_is_told(name, capfd):
    """In one line, without Warp's own."""
    with pytest.raises(ws.InputError, match=r"^device: must be cpu, as no CUDA device was found: .*, got 'cuda"):
        ws.deposit([[1.0, 2.0]], [1.0], ws.PsfGaussian(0.5), SHAPE, device=name)
    assert "error 36" not in "".join(capfd.readouterr())


def test_unknown_device_is_named():
    with pytest.raises(ws.InputError, match=r"^device: must be one of cpu"):
        ws.deposit([[1.0, 2.0]], [1.0], ws.PsfGaussian(0.5), SHAPE, device="tpu")


WRONG = {"xy_px": "abc", "flux": ["x"], "psf": "airy", "shape": 33, "flux_error": "a"}


@pytest.mark.parametrize(("name", "value"), WRONG.items())
def test_wrong_kinds_of_values_are_told_in_one_line(name, value):
    given = {"xy_px": [[1.0, 1.0]], "flux": [1.0], "psf": ws.PsfGaussian(1.0), "shape": (4, 4), name: value}
    with pytest.raises(ws.InputError, match=rf"^{name}: must [^\n]+$"):
        ws.deposit(**given)


@pytest.mark.ci
def test_light_beyond_float32_is_refused():
    with pytest.raises(ws.InputError, match=r"^flux: must leave pixels below 3.4e38"):
        ws.deposit([[1.0, 1.0]], [1e300], ws.PsfGaussian(1.0), (4, 4))


VARIANT_SHAPE = (40, 50)
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
    product = ws.deposit(xy.numpy(), irradiance.numpy(), psf, VARIANT_SHAPE, device=device, flux_error=1e-6)
    variant = Variant(name, psf, VARIANT_SHAPE, device, 4)
    variant.draw(xy, irradiance, stamp_rule([0.0], 1e-6, device))
    np.testing.assert_allclose(variant.values(), product, rtol=0, atol=FLOAT32_RTOL * product.max())


@pytest.mark.ci
def test_fixed_point_does_not_ask_for_the_order(device):
    xy, irradiance = sources(device)
    rule = stamp_rule([0.0], 1e-6, device)
    variant = Variant("scatter fixed point", ws.PsfAiry(0.478), VARIANT_SHAPE, device, 4)
    variant.draw(xy, irradiance, rule)
    one = variant.values()
    order = np.random.default_rng(SEED).permutation(len(xy))
    mixed = [wp.array(a.numpy()[order], dtype=a.dtype, device=device) for a in (xy, irradiance)]
    variant.draw(*mixed, rule)
    np.testing.assert_array_equal(variant.values(), one)
    exact = Variant("gather float64", ws.PsfAiry(0.478), VARIANT_SHAPE, device, 4)
    exact.draw(xy, irradiance, rule)
    np.testing.assert_allclose(one, exact.values(), rtol=0, atol=QUANTUM * len(xy))
