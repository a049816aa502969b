"""Sources that move and change during the exposure: images against samples and transforms in float64."""

import numpy as np
import pytest
import warp as wp
from drawing import draw, stamp_fractions
from scipy import special
from streak_oracles import airy_streak, even_times, fine_times, gaussian_streak, legendre
from warpsim_kernels.streaks import Paths, source_of, streak_length_px

import warpsim as ws
from warpsim.optics.pattern import annular_transfer
from warpsim.optics.psf_bank import PsfBank, stamp_rule
from warpsim.optics.streak_rules import LONGEST_STREAK, sharpness
from warpsim.optics.tables import epsf_table

SEED = 271828
STREAK_ATOL = 1e-5  # per unit flux, of the 10,000 samples
FINE_ATOL = 2e-6
"""A fifth of what is asked for. With flux_error = 1e-6 the nodes may err by half of it and a table by 6e-7; sums of
float32 come on top. Measured 9e-7."""
CLOSURE_ATOL = 1e-6  # reported fractions against the sum of the image
SUM_ATOL = 2e-6  # float32 images that are summed in another order: one rounding of 6e-8 for each of 30 nodes at a pixel
SHAPE = (24, 32)
STILL = np.zeros((1, 2))
STEADY = np.ones(1)


def as_float32(values):
    return np.asarray(values, dtype=np.float32).astype(np.float64)


def straight(length_px, angle_rad, n=2):
    """Coefficients of an even motion about the middle."""
    movement = np.zeros((n, 2))
    movement[1] = 0.5 * length_px * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    return as_float32(movement)


def pulses(n_pulse, degree):
    """Legendre coefficients of 2 cos^2, n_pulse times over the exposure, mean 1."""
    t, weight = fine_times(40)
    light = 1 + np.cos(2 * np.pi * n_pulse * t + 0.7)
    terms = [(2 * k + 1) * np.sum(weight * light * special.eval_legendre(k, t)) for k in range(degree + 1)]
    return as_float32(np.array(terms) / terms[0])


def paths_of(movement_px, brightness, device, n_target=None):
    """The kernels' Paths of one view and band."""
    paths = Paths()
    paths.offset_px = wp.array(np.asarray(movement_px)[None], dtype=wp.vec2, device=device)
    paths.brightness = wp.array(np.asarray(brightness)[None, None], dtype=wp.float32, device=device)
    paths.n_target = len(brightness) if n_target is None else n_target
    return paths


@wp.kernel
def lengths_kernel(paths: Paths, aspect: float, length_px: wp.array[float]):
    slot = wp.tid()
    source = source_of(0, 0, slot, wp.vec2d(), 1.0)
    length_px[slot] = streak_length_px(paths, source, aspect)


@pytest.mark.parametrize("n_term", [2, 4, 5, 8, 33])
@pytest.mark.ci
def test_lengths_are_those_at_the_highest_speed(n_term):
    """Never less than dense samples have it; of many terms 8.3 % more at most, for a straight path nothing."""
    movement = as_float32(np.random.default_rng(n_term).normal(size=(50, n_term, 2)))
    length_px, aspect = wp.zeros(50, dtype=float, device="cpu"), 0.8
    wp.launch(lengths_kernel, 50, [paths_of(movement, np.ones((50, 1)), "cpu"), aspect], [length_px], device="cpu")
    t = np.linspace(-1, 1, 20001)
    speed = np.polynomial.legendre.legval(t, np.polynomial.legendre.legder(movement, axis=1).transpose(1, 0, 2))
    highest = 2 * np.linalg.norm(speed * [[[1.0], [aspect]]], axis=1).max(axis=1)
    over = length_px.numpy() / highest
    assert over.min() > 1 - 1e-5
    if n_term > 4:
        assert over.max() < 1.083


STREAKS = {
    "along-columns": (straight(9.0, 0.0), [15.27, 11.6], STEADY),
    "along-a-pixel-edge": (straight(9.0, np.pi / 2), [15.5, 11.6], STEADY),
    "slanted": (straight(12.0, 0.81), [14.9, 12.2], STEADY),
    "through-a-corner": (straight(8.0, np.pi / 4), [15.5, 11.5], STEADY),
    "across-the-frame-edge": (straight(14.0, 0.4), [-0.5, 20.3], STEADY),
    "out-and-in-at-a-corner": (as_float32([[0, 0], [1, -4], [3, 3]]), [31.0, 0.5], STEADY),
    "curved": (as_float32([[0.3, -0.2], [5, 1], [-1, 2], [0.4, 0.7]]), [15.1, 12.4], STEADY),
    "there-and-back": (as_float32([[0, 0], [0, 0], [4, 2.5]]), [15.1, 12.4], STEADY),
    "growing-brighter": (straight(9.0, 0.3), [15.27, 11.6], as_float32([1, 0.8])),
    "three-pulses": (straight(10.0, 2.2), [15.27, 11.6], pulses(3, 20)),
    "curved-pulses": (as_float32([[0, 0], [4, 1], [0, 1]]), [15.27, 11.6], pulses(2, 16)),
    "shorter-than-a-blur": (straight(0.03, 0.9), [15.49, 11.52], STEADY),
    "short-and-bent": (as_float32([[0, 0], [0.05, 0.02], [0.02, -0.03], [0.02, 0.01]]), [15.48, 11.53], STEADY),
    "shorter-and-bent": (as_float32([[0, 0], [5e-3, 1e-3], [1e-3, 1e-3], [1e-3, 2e-3]]), [15.494, 11.504], STEADY),
    "a-thousandth": (straight(0.001, 0.9), [15.5, 11.5], as_float32([1, 0.5])),
}
each_streak = pytest.mark.parametrize(("movement", "xy", "brightness"), STREAKS.values(), ids=STREAKS)


@each_streak
@pytest.mark.parametrize("sigma_px", [0.35, 0.7, 2.0])
@pytest.mark.ci
def test_gaussian_streak_against_ten_thousand_samples(device, sigma_px, movement, xy, brightness, record_accuracy):
    image = ws.deposit(
        [xy], [1.0], ws.PsfGaussian(sigma_px), SHAPE, device=device, movement_px=[movement], brightness=[brightness]
    )
    samples = gaussian_streak(xy, movement, brightness, sigma_px, SHAPE, even_times())
    np.testing.assert_allclose(image, samples, rtol=0, atol=STREAK_ATOL)
    np.testing.assert_allclose(image, samples, rtol=0, atol=FINE_ATOL)
    error = np.abs(image - samples).max()
    record_accuracy("Streak of a Gaussian", error, STREAK_ATOL, "of the flux", "10,000 samples")


@pytest.mark.slow
@each_streak
@pytest.mark.parametrize("sigma_px", [0.01, 0.064])
def test_sharp_gaussian_streak_against_fine_panels(device, sigma_px, movement, xy, brightness):
    """Ten thousand even samples would err by more than 1e-5 themselves: an edge is crossed within 1e-3 of the time."""
    image = ws.deposit(
        [xy], [1.0], ws.PsfGaussian(sigma_px), SHAPE, device=device, movement_px=[movement], brightness=[brightness]
    )
    expected = gaussian_streak(xy, movement, brightness, sigma_px, SHAPE, fine_times(4000))
    np.testing.assert_allclose(image, expected, rtol=0, atol=FINE_ATOL)


@pytest.mark.slow
@each_streak
@pytest.mark.parametrize(("radius_px", "obscuration"), [(0.185, 0.0), (0.478, 0.3), (1.5, 0.0)])
def test_airy_streak_against_its_transform(device, radius_px, obscuration, movement, xy, brightness, record_accuracy):
    psf = ws.PsfAiry(radius_px, obscuration)
    image = ws.deposit([xy], [1.0], psf, SHAPE, device=device, movement_px=[movement], brightness=[brightness])
    period_px = 60.0 if radius_px < 0.2 else 150.0
    expected = airy_streak(xy, movement, brightness, radius_px, obscuration, SHAPE, fine_times(300), period_px)
    np.testing.assert_allclose(image, expected, rtol=0, atol=FINE_ATOL)
    error = np.abs(image - expected).max()
    record_accuracy("Streak of an Airy pattern", error, FINE_ATOL, "of the flux", "Fourier integrals")


@pytest.mark.ci
def test_three_hundred_pixels(device):
    """Panels: even the largest rule is too short."""
    movement, xy, shape = straight(300.0, 0.02), [160.2, 8.3], (18, 322)
    image = ws.deposit([xy], [1.0], ws.PsfGaussian(0.064), shape, device=device, movement_px=[movement])
    expected = gaussian_streak(xy, movement, STEADY, 0.064, shape, fine_times(6000))
    np.testing.assert_allclose(image, expected, rtol=0, atol=FINE_ATOL)
    assert image.sum() == pytest.approx(1, rel=0, abs=CLOSURE_ATOL)


@pytest.fixture(scope="module")
def random_streaks():
    """Streaks of all kinds, with their images in float64: (xy, movement, brightness, sigma_px, expected)."""
    rng, streaks = np.random.default_rng(SEED), []
    for _ in range(40):
        sigma_px = 10 ** rng.uniform(-2, 0.5)
        movement = straight(10 ** rng.uniform(-2, 1.2), rng.choice([rng.uniform(0, 7), 0, np.pi / 2]), 4)
        movement[2:] = as_float32(rng.normal(size=(2, 2)) * rng.choice([0, 0, 0.1]) * np.abs(movement[1]).max())
        brightness = as_float32([1, *rng.uniform(-0.3, 0.3, rng.choice([0, 0, 3]))])
        xy = [15.5, 11.5] + rng.uniform(-0.5, 0.5, 2) * rng.choice([0.01, 1])
        expected = gaussian_streak(xy, movement, brightness, sigma_px, SHAPE, fine_times(2500))
        streaks.append((xy, movement, brightness, sigma_px, expected))
    return streaks


@pytest.mark.slow
@pytest.mark.parametrize("error", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
def test_error_is_within_what_is_allowed(device, random_streaks, error):
    """Random streaks; and coarse bounds are made use of: fewer nodes than the finest takes leave a larger error."""
    found = []
    for xy, movement, brightness, sigma_px, expected in random_streaks:
        paths = paths_of([movement], [brightness], device)
        rule = stamp_rule([0.0], 1e-9, device, error)
        image = draw([xy], [1.0], ws.PsfGaussian(sigma_px), SHAPE, device, rule, paths)
        found.append(np.abs(image - expected).max())
    assert max(found) <= error
    assert max(found) >= 0.01 * error


def test_faint_sources_may_err_by_what_their_stamps_leave_out(device):
    psf, movement, xy = ws.PsfGaussian(0.064), straight(10.0, 0.3), [15.2, 11.7]
    expected = gaussian_streak(xy, movement, STEADY, 0.064, SHAPE, fine_times(2000))
    errors = []
    for flux in (1e-18, 1e-16, 1e-14, 1e-12):  # cut at 1e-19: 0.1 to 1e-7 of the light
        rule = stamp_rule([1e-19], 0.0, device)
        image = draw([xy], [flux], psf, SHAPE, device, rule, paths_of([movement], [STEADY], device))
        errors.append(np.abs(image / flux - expected).max())
        assert errors[-1] <= max(1e-19 / flux, 1e-6)
    assert errors[0] > 1e-4  # not wasted


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 4, 8, 16, 32, 64, 128])
def test_lengths_that_rules_serve(count):
    """The table of LONGEST_STREAK anew: the light on one side of an edge, sampled at the nodes of each rule."""
    node, weight = np.polynomial.legendre.leggauss(count)
    for step, length in enumerate(LONGEST_STREAK[count], 1):
        if not np.isfinite(length):
            continue
        edge = np.linspace(0, length / 2 + 5, 4000)
        mean = special.ndtr(length / 2 * node + edge[:, None]) @ (weight / 2)
        t, fine = fine_times(int(length) + 1)
        exact = special.ndtr(length / 2 * t + edge[:, None]) @ fine
        worst, allowed = np.abs(mean - exact).max(), 10 ** (-step / 2)
        assert worst <= allowed * 1.001
        assert worst >= allowed * 0.7  # lengths are rounded down to three digits


@pytest.mark.parametrize("obscuration", [0.0, 0.2, 0.4, 0.6])
@pytest.mark.ci
def test_blur_bounds_the_transfer_function(obscuration):
    """An Airy pattern's transfer function: closed form against the Hankel transform of the pattern; and its bound."""
    v, step = np.linspace(1e-6, 6000, 3_000_001, retstep=True)
    amplitude = 2 * special.j1(v) / v
    if obscuration:
        amplitude -= 2 * obscuration * special.j1(obscuration * v) / v
    pattern = amplitude**2 * v * step
    for frequency in (0.05, 0.31, 0.5, 0.77):
        hankel = (pattern * special.j0(2 * frequency * v)).sum() / (2 * (1 - obscuration**2))
        assert annular_transfer(np.array([frequency]), obscuration)[0] == pytest.approx(hankel, rel=0, abs=3e-4)
    frequency = np.linspace(0.01, 0.999, 777)
    sigma_px, limit_per_px = sharpness(ws.PsfAiry(1.2196698912665045, obscuration))
    bound = np.exp(-0.5 * (2 * np.pi * sigma_px * frequency) ** 2)
    assert limit_per_px == pytest.approx(1, rel=1e-12)
    assert (annular_transfer(frequency, obscuration) <= bound).all()
    assert sigma_px > 0.36  # lambda F; a Gaussian like the core has 0.42


PSFS = [ws.PsfGaussian(0.064), ws.PsfGaussian(2.0), ws.PsfAiry(0.185), ws.PsfAiry(1.5, 0.3)]
every_psf = pytest.mark.parametrize("psf", PSFS, ids=["gauss-sharp", "gauss", "airy-sharp", "airy-annular"])


@every_psf
@pytest.mark.parametrize("cut_fraction", [1e-3, 1e-9], ids=["small-stamps", "wide-stamps"])
@pytest.mark.ci
def test_no_movement_is_no_streak_bit_by_bit(device, psf, cut_fraction):
    rng = np.random.default_rng(SEED)
    xy, flux = rng.uniform(-2, [34, 26], (30, 2)), rng.uniform(0.1, 5, 30)
    rule = stamp_rule([0.0], cut_fraction, device)
    plain = draw(xy, flux, psf, SHAPE, device, rule)
    for n_movement, n_brightness in ((1, 0), (0, 1), (3, 4)):
        brightness = np.zeros((30, n_brightness))
        brightness[:, :1] = 1
        brightness[:, 1:] = 0.2
        paths = paths_of(np.zeros((30, n_movement, 2)), brightness, device)
        np.testing.assert_array_equal(draw(xy, flux, psf, SHAPE, device, rule, paths), plain)
        for one, other in zip(
            stamp_fractions(xy, flux, psf, device, rule),
            stamp_fractions(xy, flux, psf, device, rule, paths),
            strict=True,
        ):
            np.testing.assert_array_equal(other, one)


@every_psf
@pytest.mark.parametrize("n_row_per_block", [1, 4, 23])
@pytest.mark.parametrize("cut_fraction", [1e-6, 3e-9], ids=["near", "near-and-far"])
def test_row_blocks_do_not_change_a_bit(device, psf, n_row_per_block, cut_fraction):
    rng, n = np.random.default_rng(SEED), 6
    xy, flux = rng.uniform(-2, [34, 26], (n, 2)), rng.uniform(0.1, 5, n)
    paths = paths_of(rng.normal(size=(n, 3, 2)) * [[[0], [4], [1]]], [[1, 0.4, -0.2]] * n, device)
    rule = stamp_rule([0.0], cut_fraction, device, 1e-4)
    whole = draw(xy, flux, psf, SHAPE, device, rule, paths)
    np.testing.assert_array_equal(draw(xy, flux, psf, SHAPE, device, rule, paths, n_row_per_block), whole)


@pytest.mark.ci
@every_psf
def test_reported_fractions_are_those_of_the_image(device, psf):
    rng, shape = np.random.default_rng(SEED), (241, 241)
    for cut_fraction in (1e-2, 1e-4, 1e-6):
        xy = [[120 + rng.uniform(-0.5, 0.5), 120 + rng.uniform(-0.5, 0.5)]]
        paths = paths_of([[[0, 0], [3, 1], [0.5, -1]]], [[1, 0.5, 0.1]], device)
        rule = stamp_rule([0.0], cut_fraction, device)
        image = draw(xy, [1.0], psf, shape, device, rule, paths).astype(np.float64)
        peak, stamp = stamp_fractions(xy, [1.0], psf, device, rule, paths)
        assert stamp[0] == pytest.approx(image.sum(), rel=0, abs=CLOSURE_ATOL)
        assert peak[0] == pytest.approx(image[120, 120], rel=0, abs=max(cut_fraction, CLOSURE_ATOL))


@pytest.mark.parametrize("psf", [ws.PsfGaussian(0.3), ws.PsfGaussian(5.0)], ids=str)
@pytest.mark.ci
def test_flux_closes(device, psf):
    """Streaks half outside the frame: what is drawn, and what falls outside."""
    rng = np.random.default_rng(SEED)
    for _ in range(10):
        movement, xy = as_float32(rng.normal(size=(3, 2)) * [[0], [8], [2]]), rng.uniform(-3, [35, 27])
        rule = stamp_rule([0.0], 1e-10, device)
        paths = paths_of([movement], [[1, 0.4]], device)
        image = draw([xy], [1.0], psf, SHAPE, device, rule, paths)
        inside = gaussian_streak(xy, movement, [1, np.float32(0.4)], psf.sigma_px, SHAPE, fine_times(800)).sum()
        assert image.sum(dtype=np.float64) == pytest.approx(inside, rel=0, abs=CLOSURE_ATOL)


@pytest.mark.parametrize("length_px", [0.4, 5.0, 40.0])
@pytest.mark.parametrize("psf", [ws.PsfAiry(0.185), ws.PsfAiry(1.5, 0.3)], ids=str)
@pytest.mark.ci
def test_far_light_of_bright_streaks(device, psf, length_px):
    """Few nodes draw the wings; they are as good as many."""
    shape, xy = (160, 180), [88.3, 79.6]
    movement, brightness = straight(length_px, 0.6, 3), as_float32([1, 0.5])
    movement[2, 1] = np.float32(length_px / 20)
    cut = 5e-9  # a reach of 120 px and more
    rule = stamp_rule([0.0], cut, device)
    image = draw([xy], [1.0], psf, shape, device, rule, paths_of([movement], [brightness], device))
    t, weight = fine_times(max(4, int(6 * length_px / psf.radius_px)), 6)
    positions = xy + legendre(movement, t)
    still = draw(positions, weight * legendre(brightness, t), psf, shape, device, rule)
    np.testing.assert_allclose(image, still, rtol=0, atol=SUM_ATOL)
    near = max(30.0, 1.0 + np.hypot(*epsf_table(psf).reach_px))  # the corners of the table
    away = np.hypot(*np.meshgrid(np.arange(180) - xy[0], np.arange(160) - xy[1])) > near + length_px / 2
    # Few nodes do not average where single stamps end, and where the table passes into its wing.
    assert np.abs(image - still)[away].max() <= cut
    assert np.median(np.abs(image - still)[away]) <= 1e-3 * np.median(still[away])


@pytest.mark.parametrize("aspect", [0.5, 1.4])
@pytest.mark.parametrize("sigma_px", [0.1, 0.7, 3.0])
def test_gaussians_on_pixels_that_are_not_square(device, sigma_px, aspect):
    """Sigma counts in pixel widths; along rows it is sigma / aspect pixel heights."""
    psf, xy = ws.PsfGaussian(sigma_px), [15.3, 11.8]
    still = gaussian_streak(xy, STILL, STEADY, sigma_px, SHAPE, (np.zeros(1), np.ones(1)), aspect)
    for cut in (1e-2, 1e-4, 1e-6):
        image = draw([xy], [1.0], psf, SHAPE, device, stamp_rule([0.0], cut, device), aspect=aspect)
        assert still[image == 0].max() <= cut
        np.testing.assert_allclose(image[image > 0], still[image > 0], rtol=0, atol=2e-7)
    movement, rule = straight(7.0, 1.1), stamp_rule([0.0], 1e-7, device)
    image = draw([xy], [1.0], psf, SHAPE, device, rule, paths_of([movement], [STEADY], device), aspect=aspect)
    expected = gaussian_streak(xy, movement, STEADY, sigma_px, SHAPE, fine_times(600), aspect)
    np.testing.assert_allclose(image, expected, rtol=0, atol=FINE_ATOL)


@pytest.mark.parametrize("aspect", [0.5, 1.4])
@pytest.mark.parametrize("psf", [ws.PsfGaussian(1.5), ws.PsfAiry(0.478, 0.3)], ids=["gauss", "airy"])
@pytest.mark.parametrize("cut", [1e-3, 1e-6])
@pytest.mark.ci
def test_fractions_and_sizes_on_pixels_that_are_not_square(device, psf, aspect, cut):
    rule, shape, xy = stamp_rule([0.0], cut, device), (301, 301), [[150.3, 150.2]]
    image = draw(xy, [1.0], psf, shape, device, rule, aspect=aspect)
    _, stamp = stamp_fractions(xy, [1.0], psf, device, rule, aspect=aspect)
    assert stamp[0] == pytest.approx(image.sum(dtype=np.float64), rel=0, abs=CLOSURE_ATOL)
    half = wp.zeros((1, 1), dtype=wp.int32, device=device)
    light = wp.ones((1, 1), dtype=wp.float32, device=device)
    PsfBank([psf], wp.get_device(device), aspect).size_stamps(light, rule, half)
    margin = int(half.numpy()[0, 0])
    for position in ([-0.5 - margin - 1e-6, 20.0], [20.0, 300.5 + margin + 1e-6]):
        assert not draw([position], [1.0], psf, shape, device, rule, aspect=aspect).any()
    rows, columns = np.nonzero(image)
    assert max(np.abs(columns - 150.3).max(), np.abs(rows - 150.2).max()) > margin - 1  # no wider than it must be


def crooked(rng):
    """A pattern without any symmetry, of two cores and a tail."""
    y, x = np.mgrid[-20:21, -24:25] / 8
    image = np.exp(-2 * ((x - 0.4) ** 2 + (y + 0.2) ** 2) / 0.3**2) + 0.3 * np.exp(-((x + 1) ** 2) - 3 * y**2)
    return ws.PsfTable(image + 1e-3 * rng.uniform(0, 1, image.shape), 8.0)


@each_streak
@pytest.mark.ci
def test_streaks_of_a_crooked_image(device, movement, xy, brightness):
    """Against itself, drawn still at many positions."""
    psf = crooked(np.random.default_rng(SEED))
    image = ws.deposit([xy], [1.0], psf, SHAPE, device=device, movement_px=[movement], brightness=[brightness])
    t, weight = fine_times(60)
    positions = xy + legendre(movement, t)
    still = ws.deposit(positions, weight * legendre(brightness, t), psf, SHAPE, device=device, flux_error=1e-7)
    np.testing.assert_allclose(image, still, rtol=0, atol=SUM_ATOL)


def test_sharpness_of_images():
    """A sampled Gaussian is as sharp as the Gaussian; noise is as sharp as its samples."""
    y, x = np.mgrid[-40:41, -40:41] / 10
    for sigma_px in (0.3, 0.6):
        found, _ = sharpness(ws.PsfTable(np.exp(-(x**2 + y**2) / (2 * sigma_px**2)), 10.0))
        assert 0.9 * sigma_px <= found <= sigma_px
    noise, _ = sharpness(ws.PsfTable(np.random.default_rng(SEED).uniform(0, 1, (60, 60)), 10.0))
    assert 0.005 < noise < 0.1


@every_psf
def test_star_and_target_of_the_same_path_are_the_same(device, psf, record_accuracy):
    """Slots from n_target on are stars, which keep their brightness."""
    movement, rule = straight(4.0, 0.5), stamp_rule([0.0], 1e-6, device)
    images = []
    for n_target, brightness in ((1, [[1.0]]), (1, [[1.0, 0.0, 0.0]]), (0, [[1.0, 0.7, 0.1]])):
        paths = paths_of([movement], brightness, device, n_target)
        images.append(draw([[15.3, 11.9]], [2.0], psf, SHAPE, device, rule, paths))
    np.testing.assert_array_equal(images[2], images[0])
    differ = np.count_nonzero(images[2] != images[0])
    record_accuracy("Star and target of the same path and light", differ, 0, "pixels differ", "each other")
    np.testing.assert_allclose(images[1], images[0], rtol=0, atol=2 * SUM_ATOL)


@every_psf
@pytest.mark.ci
def test_streaks_of_hard_lists(device, psf):
    movement = [[[0, 0], [1e4, 3e3]], [[0, 0], [2, 2]], [[0, 0], [1e-30, 0]], [[0, 0], [5, 0]], [[0, 0], [1e6, 0]]]
    xy, flux = [[5.0, 5.0], [1e300, 0.0], [16.5, 11.5], [-1e9, 3.0], [3e5, 10.0]], [1e-10, 1.0, 1e-25, 1.0, 1e-12]
    image = ws.deposit(xy, flux, psf, SHAPE, device=device, movement_px=movement, flux_error=1e-2)
    assert np.isfinite(image).all() and image.max() < 1
    assert not ws.deposit(np.empty((0, 2)), [], psf, SHAPE, device=device, movement_px=np.empty((0, 2, 2))).any()
    one = ws.deposit([[0.0, 0.0]], [1.0], psf, (1, 1), device=device, movement_px=[[[0, 0], [0.5, 0]]])
    assert one.shape == (1, 1) and 0 < one[0, 0] <= 1


BAD = {
    "flat": ({"movement_px": [[1.0, 2.0]]}, r"^movement_px: must have shape \(1, n_coefficient, 2\), got \(1, 2\)$"),
    "other-length": ({"brightness": [[1.0], [1.0]]}, r"^brightness: must have shape \(1, n_coefficient\)"),
    "nan": ({"movement_px": [[[np.nan, 0.0]]]}, "^movement_px: must be finite, got 1 bad values$"),
    "mean": ({"brightness": [[0.5, 0.1]]}, "^brightness: the first coefficient, the mean, must be 1$"),
}


@pytest.mark.parametrize(("arguments", "message"), BAD.values(), ids=BAD)
def test_bad_paths_are_named_in_one_line(arguments, message):
    with pytest.raises(ws.InputError, match=message):
        ws.deposit([[1.0, 2.0]], [1.0], ws.PsfGaussian(0.5), SHAPE, device="cpu", **arguments)
