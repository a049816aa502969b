"""Patterns that stay with pixels and noise common to a column: statistics, persistence, independence."""

import dataclasses

import numpy as np
import pytest
from read_outs import (
    N_SIGMA,
    N_SIGMA_TAIL,
    SEED,
    assert_uncorrelated,
    deviates,
    read_out,
    twin_columns,
    twin_deviates,
    twin_words,
)
from scipy import stats
from warpsim_kernels.random_numbers import STREAM_BAD, STREAM_GAIN, STREAM_OFFSET

from warpsim.detector.detectors import NeiDetector

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


TERMS = {
    "prnu": {"prnu": 0.02},
    "dsnu": {"dsnu_nei": 1.0},
    "column": {"column_noise_nei": 1.0},
    "bad": {"dead_fraction": 0.01, "hot_fraction": 0.01},
    "nonlinearity": {"nonlinearity": 0.2},
    "all": {"prnu": 0.02, "dsnu_nei": 1.0, "column_noise_nei": 1.0, "dead_fraction": 0.01, "nonlinearity": 0.2},
}


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
@pytest.mark.ci
def test_an_image_does_not_depend_on_its_batch(device, terms):
    detector = NeiDetector(NEI, 3000 * NEI, bits=16, counts_per_nei=20.0, **terms)
    signal = np.random.default_rng(1).uniform(0, 100 * NEI, (3, 2, 40, 61))
    numbers = {"frames": [4, 2, 9], "sensors": [1, 0, 5], "bands": [3, 1]}
    batch = read_out(detector, signal, device, **numbers)
    alone = read_out(detector, signal[1:2, 1:], device, frames=[2], sensors=[0], bands=[1])
    np.testing.assert_array_equal(batch[1, 1], alone[0, 0])


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
@pytest.mark.ci
def test_whole_strips_and_ragged_ends_agree(device, terms):
    detector = NeiDetector(NEI, 3000 * NEI, bits=16, counts_per_nei=20.0, **terms)
    signal = np.random.default_rng(2).uniform(0, 100 * NEI, (2, 2, 33, 61))
    whole, ragged = (read_out(detector, signal, device, ragged=ragged) for ragged in (False, True))
    np.testing.assert_array_equal(whole, ragged)


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
