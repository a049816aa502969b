"""Read-out: statistics of the noise, its independence, and the counts model against a float64 twin."""

import ast
import dataclasses
import inspect

import numpy as np
import pytest
import warp as wp
import warpsim_kernels.read_out
from read_outs import (
    FINE,
    FINE_GAIN,
    N_SIGMA,
    N_SIGMA_TAIL,
    SEED,
    assert_alone_as_in_batch,
    assert_uncorrelated,
    check_gaussian,
    deviates,
    read_out,
    twin_columns,
    twin_deviates,
    twin_words,
)
from scipy import stats
from warpsim_kernels import pixel_pairs
from warpsim_kernels.pixel_pairs import STREAM_BAD, STREAM_GAIN, STREAM_OFFSET

from warpsim.detector.detectors import NeiDetector
from warpsim.render.buffers import new_signal

COUNTS_RTOL = 4e-7  # six float32 roundings of 6e-8 from signal to counts: where a rounding edge may be missed
DEVIATE_ATOL = 2e-6  # of the float32 deviates, see random_numbers.py


def histogram_of(device, n_frame):
    """Histogram of n_frame frames of 1e6 pixels, 10 at a time."""
    total = np.zeros(65536, dtype=np.int64)
    for first in range(0, n_frame, 10):
        counts = read_out(FINE, np.zeros((10, 1, 1000, 1000)), device, frames=np.arange(first, first + 10))
        total += np.bincount(counts.ravel(), minlength=65536)
    return total


@pytest.mark.ci
def test_noise_is_gaussian_over_1e8_draws(device, record_accuracy):
    pull = check_gaussian(histogram_of(device, 100))
    record_accuracy("Gaussian noise, moments of 1e8 draws", pull, N_SIGMA, "sigma", "theory")


@pytest.mark.slow
def test_noise_is_gaussian_over_1e9_draws(device, record_accuracy):
    pull = check_gaussian(histogram_of(device, 1000))
    record_accuracy("Gaussian noise, moments of 1e9 draws", pull, N_SIGMA, "sigma", "theory")


def test_each_half_of_a_strip_is_gaussian(device):
    strips = read_out(FINE, np.zeros((40, 1, 512, 512)), device).reshape(-1, 2, 64)
    for half in range(2):
        check_gaussian(np.bincount(strips[:, half].ravel(), minlength=65536))


WITHIN_ONE_IMAGE = {
    "columns": lambda z: (z[:, :-1], z[:, 1:]),
    "rows": lambda z: (z[:-1], z[1:]),
    "diagonal": lambda z: (z[:-1, :-1], z[1:, 1:]),
    "pair-halves": lambda z: (z.reshape(-1, 2, 64)[:, 0], z.reshape(-1, 2, 64)[:, 1]),
    "neighbouring-strips": lambda z: (z.reshape(-1, 128)[:-1], z.reshape(-1, 128)[1:]),
    "neighbouring-blocks": lambda z: (z.reshape(-1, 2048)[:-1], z.reshape(-1, 2048)[1:]),
    "halves-of-the-image": lambda z: (z[: len(z) // 2], z[len(z) // 2 :]),
}


@pytest.mark.parametrize("pairs", WITHIN_ONE_IMAGE.values(), ids=WITHIN_ONE_IMAGE)
def test_pixels_of_one_image_are_independent(device, pairs, record_accuracy):
    pull = assert_uncorrelated(*pairs(deviates(device, (1, 1, 1024, 1024))[0, 0]))
    record_accuracy("Correlation of noise, pixels of one image", pull, N_SIGMA, "sigma", "theory")


OTHER_IMAGE = {
    "next-frame": {"frames": [8]},
    "far-frame": {"frames": [7 + 2**31]},
    "sensor": {"sensors": [1]},
    "band": {"bands": [1]},
    "frame-and-sensor-swapped": {"frames": [0], "sensors": [7]},
    "seed-low-word": {"seed": SEED + 1},
    "seed-high-word": {"seed": SEED + 2**32},
    "seed-words-swapped": {"seed": 0x89ABCDEF01234567},
}


@pytest.mark.parametrize("other", OTHER_IMAGE.values(), ids=OTHER_IMAGE)
def test_images_are_independent(device, other, record_accuracy):
    first = deviates(device, (1, 1, 1024, 1024), frames=[7])
    pull = assert_uncorrelated(first, deviates(device, (1, 1, 1024, 1024), **{"frames": [7], **other}))
    record_accuracy("Correlation of noise across frames, sensors, bands, seeds", pull, N_SIGMA, "sigma", "theory")


SHAPES = [(1, 1), (3, 5), (127, 129), (128, 128), (16, 16), (1, 257), (300, 70)]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: f"{s[0]}x{s[1]}")
def test_whole_strips_and_ragged_ends_give_the_same_counts(device, shape):
    signal = np.random.default_rng(5).uniform(-2e-18, 6e-18, (2, 3, *shape))
    whole = read_out(FINE, signal, device, bands=[4, 0, 2])
    np.testing.assert_array_equal(whole, read_out(FINE, signal, device, bands=[4, 0, 2], ragged=True))


def test_untouched_strips_count_as_touched_ones_without_light(device):
    """Only flagged strips are read; they are 0 afterwards."""
    shape, where = (2, 2, 40, 160), wp.get_device(device)
    rng = np.random.default_rng(4)
    flags = rng.random((2, 2, 50)) < 0.3
    light = np.where(np.repeat(flags, 128, axis=2), rng.uniform(1e-18, 9e-18, (2, 2, 6400)), 0.0).reshape(shape)
    signal = new_signal(shape, where)
    signal.images.assign(light.astype(np.float32))
    signal.touched.assign(np.pad(flags, ((0, 0), (0, 0), (0, signal.touched.shape[2] - 50))).astype(np.uint8))
    np.testing.assert_array_equal(read_out(FINE, light, device, signal=signal), read_out(FINE, light, device))
    assert not signal.flat.numpy().any()


def test_a_strip_that_is_not_flagged_counts_as_zero(device):
    """Whatever is in it; it is not read."""
    signal = new_signal((1, 1, 40, 160), wp.get_device(device))
    signal.images.fill_(1e-15)
    zeros = np.zeros((1, 1, 40, 160))
    np.testing.assert_array_equal(read_out(FINE, zeros, device, signal=signal), read_out(FINE, zeros, device))


@pytest.mark.parametrize("shape", [(7, 30), (16, 16), (40, 60)], ids=lambda s: f"{s[0]}x{s[1]}")
def test_images_land_where_they_belong(device, shape):
    """Those of some views among the counts of all; and through a replaced output."""
    light = np.random.default_rng(6).uniform(0, 9e-18, (2, 2, *shape))
    numbers = {"frames": [4, 2], "sensors": [1, 3]}
    alone = read_out(FINE, light, device, **numbers)
    for first_view in (0, 1, 3):
        counts = read_out(FINE, light, device, **numbers, first_view=first_view, n_counts=5)
        np.testing.assert_array_equal(counts[first_view : first_view + 2], alone)
        assert not np.delete(counts, [first_view, first_view + 1], axis=0).any()


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: f"{s[0]}x{s[1]}")
def test_deviates_are_those_of_the_float64_twin(device, shape):
    z = deviates(device, (1, 1, *shape), frames=[3], sensors=[11], bands=[5]).ravel()
    expected = twin_deviates(3, 11, 5, SEED, z.size)
    rounding = (0.5 + COUNTS_RTOL * 65535) / FINE_GAIN
    np.testing.assert_allclose(z, expected, rtol=0, atol=rounding + DEVIATE_ATOL)


def check_counts(detector, signal, device):
    """Counts equal the float64 model, save one count where the model lies on a rounding edge."""
    counts = read_out(detector, signal, device, frames=[6], sensors=[2], bands=[1])[0, 0].ravel().astype(np.int64)
    z = twin_deviates(6, 2, 1, SEED, counts.size)
    light = signal.astype(np.float32).astype(np.float64).ravel()
    nei, sei, gain = detector.nei_w_cm2, detector.sei_w_cm2, detector.counts_per_nei
    level = np.minimum(light / nei + z, sei / nei)
    free = level * gain + detector.offset_counts + 0.5
    real = np.clip(free, 0, 2**detector.bits - 1)
    unsure = COUNTS_RTOL * (np.abs(level) * gain + detector.offset_counts) + DEVIATE_ATOL * gain
    near = (np.abs(free - np.round(free)) < unsure) & (free > 0.5) & (free < 2**detector.bits - 0.5)
    np.testing.assert_array_equal(counts[~near], np.floor(real[~near]))
    assert np.abs(counts - np.floor(real)).max() <= 1
    return counts, near


@pytest.mark.parametrize("bits", range(1, 17))
def test_counts_at_every_depth(device, bits):
    top = 2**bits
    detector = NeiDetector(1e-18, 3e-15, bits=bits, offset_counts=top / 4, counts_per_nei=top / 16)
    signal = np.random.default_rng(bits).uniform(0, 14e-18, (1, 1, 64, 100))
    counts, near = check_counts(detector, signal, device)
    assert counts.max() == top - 1 and counts.min() >= 0
    assert near.mean() < 0.08  # the exact comparison covers nearly all


def test_counts_clip_at_the_saturation_irradiance(device):
    detector = NeiDetector(1e-18, 3e-17, bits=14, offset_counts=100.0, counts_per_nei=5.0)
    signal = np.full((1, 1, 40, 40), 1e6 * 3e-17)
    counts, _ = check_counts(detector, signal, device)
    assert (counts == 250).all()  # 100 + 5 * 30: saturated pixels show no noise


def test_full_well_above_the_converter_reads_its_top(device):
    detector = NeiDetector(1e-18, 3e-15, bits=12, offset_counts=100.0, counts_per_nei=5.0)
    counts = read_out(detector, np.full((1, 1, 40, 40), 1e6 * 3e-15), device)
    assert (counts == 4095).all()


def test_counts_over_fifteen_decades_never_wrap(device):
    detector = NeiDetector(1e-18, 3e-15, bits=16, offset_counts=100.0, counts_per_nei=20.0)
    signal = np.logspace(-25, -10, 128 * 64).reshape(1, 1, 64, 128)
    counts, _ = check_counts(detector, signal, device)
    assert (counts[signal.ravel() > 3.1e-15] == 60100).all()  # 100 + 20 * 3000
    assert (np.abs(counts[signal.ravel() < 1e-21] - 100) < 20 * 6.77).all()


def test_blank_sky_without_offset_clips_at_zero(device):
    detector = NeiDetector(1e-18, 3e-15, bits=14, offset_counts=0.0, counts_per_nei=5.0)
    counts, _ = check_counts(detector, np.zeros((1, 1, 64, 64)), device)
    assert 0.4 < np.mean(counts == 0) < 0.7
    assert counts.max() < 40


def test_infinite_signal_saturates(device):
    detector = NeiDetector(1e-18, 3e-17, bits=14, offset_counts=100.0, counts_per_nei=5.0)
    counts = read_out(detector, np.full((1, 1, 1, 3), 3e38), device)  # signal / NEI overflows to infinity
    assert (counts == 250).all()


def test_warps_cache_sees_every_function_of_a_tile_map():
    """The hash of a kernel leaves out functions that are given to tile_map: a changed one would find an old binary."""
    trees = [ast.parse(inspect.getsource(module)) for module in (pixel_pairs, warpsim_kernels.read_out)]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    calls = [node for node in nodes if isinstance(node, ast.Call) and ast.unparse(node.func) == "wp.tile_map"]
    given = {ast.unparse(call.args[0]) for call in calls}
    (named,) = [node for node in nodes if isinstance(node, ast.FunctionDef) and node.name == "mapped_functions"]
    assert given == {node.id for node in ast.walk(named) if isinstance(node, ast.Name) and node.id[0] != "_"} - {"wp"}


NEI = 1e-18
SHAPE = (1, 1, 1024, 1024)

# Signals and gains of patterns are such that half a count is a few thousandths of the pattern's own deviation.
LIGHT_NEI, PRNU = 4.0, 0.1
EVEN = NeiDetector(NEI, 1e-12, bits=16, offset_counts=15000.0, counts_per_nei=3000.0)
COUNT_OF_DEVIATE = {"prnu": PRNU * LIGHT_NEI * 3000.0, "dsnu_nei": 3000.0, "column_noise_nei": 3000.0}


def pattern(device, term, shape=SHAPE, **numbers):
    """Deviates of one term: what it changes in an image whose other noise is the same bit for bit."""
    uneven = dataclasses.replace(EVEN, **{term: PRNU if term == "prnu" else 1.0})
    signal = np.full(shape, LIGHT_NEI * NEI)
    with_term, without = (read_out(detector, signal, device, **numbers) for detector in (uneven, EVEN))
    return (with_term.astype(np.int64) - without) / COUNT_OF_DEVIATE[term]


def check_normal(z):
    """5-sigma gates on moments, and a Kolmogorov-Smirnov gate; z may have been rounded by a thousandth."""
    n = z.size
    assert abs(z.mean()) < N_SIGMA / np.sqrt(n) + 1e-3
    assert abs(z.var() - 1) < N_SIGMA * np.sqrt(2 / n) + 1e-3
    assert abs(stats.skew(z)) < N_SIGMA * np.sqrt(6 / n)
    assert abs(stats.kurtosis(z)) < N_SIGMA * np.sqrt(24 / n)
    assert stats.kstest(z + np.random.default_rng(0).uniform(-4e-4, 4e-4, n), "norm").pvalue > 2 * N_SIGMA_TAIL


@pytest.mark.parametrize(("term", "stream"), [("prnu", STREAM_GAIN), ("dsnu_nei", STREAM_OFFSET)])
@pytest.mark.parametrize("shape", [(300, 70), (1, 1), (3, 5), (1, 257)], ids=str)
@pytest.mark.ci
def test_patterns_are_those_of_the_float64_twin(device, term, stream, shape):
    z = pattern(device, term, (1, 1, *shape), frames=[9], sensors=[11], bands=[4]).ravel()
    expected = twin_deviates(0, 11, 4, SEED, z.size, stream=int(stream))
    # Two counts are rounded, and light of 4 NEI plus noise is known to half a count.
    np.testing.assert_allclose(z, expected, rtol=0, atol=1.01 / COUNT_OF_DEVIATE[term])


@pytest.mark.parametrize("term", ["prnu", "dsnu_nei"])
@pytest.mark.ci
def test_patterns_are_normal_and_stay(device, term):
    z = pattern(device, term)
    check_normal(z.ravel())
    later = pattern(device, term, frames=[5000])
    np.testing.assert_allclose(later, z, rtol=0, atol=2.01 / COUNT_OF_DEVIATE[term])


@pytest.mark.ci
@pytest.mark.parametrize("term", ["prnu", "dsnu_nei"])
@pytest.mark.parametrize(
    "other", [{"sensors": [1]}, {"bands": [1]}, {"seed": SEED + 1}, {"seed": SEED + 2**32}], ids=str
)
def test_patterns_of_others_are_independent(device, term, other):
    assert_uncorrelated(pattern(device, term), pattern(device, term, **other))


@pytest.mark.ci
def test_terms_are_independent_of_each_other_and_of_the_noise(device):
    gain, offset, column = (pattern(device, term) for term in ("prnu", "dsnu_nei", "column_noise_nei"))
    noise = deviates(device, SHAPE)
    assert_uncorrelated(gain, offset)
    assert_uncorrelated(gain, noise)
    assert_uncorrelated(offset, noise)
    assert_uncorrelated(gain, np.roll(offset, 1, axis=-1))
    # Columns are few: what they share is averaged over their rows.
    for image in (gain, offset, noise):
        assert_uncorrelated(image.mean(axis=2) * 32, column[:, :, 0])


@pytest.mark.parametrize("term", ["prnu", "dsnu_nei"])
def test_neighbours_are_independent(device, term):
    z = pattern(device, term)[0, 0]
    assert_uncorrelated(z[:, :-1], z[:, 1:])
    assert_uncorrelated(z[:-1], z[1:])
    tiles = z.reshape(-1, 2, 64)
    assert_uncorrelated(tiles[:, 0], tiles[:, 1])  # cosine and sine of one word


@pytest.mark.slow
@pytest.mark.parametrize("term", ["prnu", "dsnu_nei"])
def test_patterns_of_100_sensors_are_normal(device, term):
    check_normal(np.concatenate([pattern(device, term, sensors=[k]).ravel() for k in range(100)]))


@pytest.mark.parametrize("shape", [(300, 70), (40, 128), (1, 3000), (500, 1)], ids=str)
@pytest.mark.ci
def test_columns_share_a_deviate(device, shape):
    z = pattern(device, "column_noise_nei", (1, 1, *shape), frames=[9], sensors=[2], bands=[4])[0, 0]
    assert np.ptp(z, axis=0).max() <= 2.01 / 3000
    np.testing.assert_allclose(z[0], twin_columns(9, 2, 4, SEED, shape[1]), rtol=0, atol=1.01 / 3000)


@pytest.mark.ci
def test_columns_are_normal_and_new_in_every_frame(device):
    shape = (1, 1, 1, 200_000)
    first = pattern(device, "column_noise_nei", shape, frames=[7])
    check_normal(first.ravel())
    assert_uncorrelated(first[..., 1:], first[..., :-1])
    for other in ({"frames": [8]}, {"frames": [7], "sensors": [1]}, {"frames": [7], "bands": [1]}):
        assert_uncorrelated(first, pattern(device, "column_noise_nei", shape, **other))


DEAD, HOT = 0.03, 0.02


def bad_pixels(device, signal_nei=100.0, shape=SHAPE, **numbers):
    """Which pixels are dead and hot by their counts: bright everywhere else."""
    detector = NeiDetector(NEI, 200 * NEI, bits=16, offset_counts=500.0, counts_per_nei=50.0)
    detector = dataclasses.replace(detector, dead_fraction=DEAD, hot_fraction=HOT)
    counts = read_out(detector, np.full(shape, signal_nei * NEI), device, **numbers)
    return counts, counts < 500 + 50 * 7, counts == 500 + 50 * 200


@pytest.mark.ci
def test_bad_pixels(device):
    counts, dead, hot = bad_pixels(device)
    n = counts.size
    for bad, share in ((dead, DEAD), (hot, HOT)):
        assert abs(bad.sum() - n * share) < N_SIGMA * np.sqrt(n * share * (1 - share))
        assert abs(np.corrcoef(bad[..., 1:].ravel(), bad[..., :-1].ravel())[0, 1]) < N_SIGMA / np.sqrt(n)
    assert not (dead & hot).any()
    assert abs(counts[dead].mean() - 500) < N_SIGMA * 50 / np.sqrt(dead.sum())  # they have their noise
    _, dead_later, hot_later = bad_pixels(device, frames=[12345])
    np.testing.assert_array_equal(dead, dead_later)
    np.testing.assert_array_equal(hot, hot_later)
    for other in ({"sensors": [1]}, {"bands": [1]}, {"seed": SEED + 1}):
        there = bad_pixels(device, **other)[1]
        assert abs(np.corrcoef(dead.ravel(), there.ravel())[0, 1]) < N_SIGMA / np.sqrt(n)


@pytest.mark.ci
def test_bad_pixels_are_those_of_the_twin(device):
    _, dead, hot = bad_pixels(device, shape=(1, 1, 50, 77), sensors=[6], bands=[2])
    upper, lower, second = twin_words(0, 6, 2, SEED, 50 * 77, stream=int(STREAM_BAD))
    word = np.where(second, lower, upper).astype(np.float64)
    np.testing.assert_array_equal(dead.ravel(), word < DEAD * 2**32)
    np.testing.assert_array_equal(hot.ravel(), word >= (1 - HOT) * 2**32)


@pytest.mark.ci
def test_all_pixels_may_be_bad(device):
    detector = NeiDetector(NEI, 200 * NEI, bits=16, offset_counts=500.0, counts_per_nei=50.0)
    detector = dataclasses.replace(detector, dead_fraction=0.5, hot_fraction=0.5)
    counts = read_out(detector, np.full(SHAPE, 100 * NEI), device)
    assert ((counts == 500 + 50 * 200) | (counts < 500 + 50 * 7)).all()


TERMS = [
    {"prnu": 0.02},
    {"dsnu_nei": 1.0},
    {"column_noise_nei": 1.0},
    {"dead_fraction": 0.01, "hot_fraction": 0.01},
    {"nonlinearity": 0.2},
    {"prnu": 0.02, "dsnu_nei": 1.0, "column_noise_nei": 1.0, "dead_fraction": 0.01, "nonlinearity": 0.2},
]


@pytest.mark.parametrize("terms", [{}, *(pytest.param(terms, marks=pytest.mark.ci) for terms in TERMS)], ids=str)
def test_an_image_does_not_depend_on_its_batch(device, terms):
    detector = NeiDetector(NEI, 3000 * NEI, bits=16, counts_per_nei=20.0, **terms)
    signal = np.random.default_rng(1).uniform(0, 100 * NEI, (3, 2, 40, 61))
    assert_alone_as_in_batch(detector, signal, device)


@pytest.mark.ci
def test_counts_follow_the_float64_model_with_every_term(device):
    detector = NeiDetector(
        NEI,
        200 * NEI,
        bits=16,
        offset_counts=300.0,
        counts_per_nei=50.0,
        prnu=0.05,
        dsnu_nei=2.0,
        column_noise_nei=1.0,
        dead_fraction=0.02,
        hot_fraction=0.03,
        nonlinearity=0.25,
    )
    n_row, n_col = 50, 77
    light = np.random.default_rng(3).uniform(0, 260, (n_row, n_col)).astype(np.float32).astype(np.float64)
    counts = read_out(detector, (light * NEI)[None, None], device, frames=[6], sensors=[2], bands=[1])[0, 0]
    n = light.size
    upper, lower, second = twin_words(0, 2, 1, SEED, n, stream=int(STREAM_BAD))
    word = np.where(second, lower, upper).astype(np.float64).reshape(light.shape)
    gain = 1 + 0.05 * twin_deviates(0, 2, 1, SEED, n, stream=int(STREAM_GAIN)).reshape(light.shape)
    offset = 2.0 * twin_deviates(0, 2, 1, SEED, n, stream=int(STREAM_OFFSET)).reshape(light.shape)
    column = twin_columns(6, 2, 1, SEED, n_col)
    seen = np.minimum(np.where(word < 0.02 * 2**32, 0, light) * gain, 200)
    level = seen * (1 - 0.25 * seen / 200) + offset + column
    level = np.where(word >= 0.97 * 2**32, np.inf, level) + twin_deviates(6, 2, 1, SEED, n).reshape(light.shape)
    expected = np.clip(np.minimum(level, 150) * 50 + 300.5, 0, 65535)
    away = np.abs(counts - np.floor(expected))
    assert away.max() <= 1
    assert (away > 0).mean() < 0.01
