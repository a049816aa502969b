"""Poisson deviates: the distribution itself, exactly, and its draws at means from 1e-3 to 1e9."""

import numpy as np
import pytest
import warp as wp
from read_outs import N_SIGMA, N_SIGMA_TAIL
from scipy import special, stats
from warpsim_kernels.canvas import PAIRS_PER_BLOCK
from warpsim_kernels.poisson import SMALLEST_EXPANDED_MEAN, exp_of_minus, poisson, poisson_of_normal, searched_poisson
from warpsim_kernels.random_numbers import STREAM_FEW, STREAM_NOISE, hashed, normal_cosine, normal_radius, stream_key

THRESHOLD = float(SMALLEST_EXPANDED_MEAN)
LARGEST_W = 6.67  # of a deviate
N_DRAW = 10_000_000


@wp.kernel(enable_backward=False)
def exp_kernel(x: wp.array[wp.float64], y: wp.array[wp.float64]):
    i = wp.tid()
    y[i] = exp_of_minus(x[i])


@wp.kernel(enable_backward=False)
def searched_kernel(mean: float, word: wp.array[wp.uint32], count: wp.array[float]):
    i = wp.tid()
    count[i] = searched_poisson(mean, word[i])


@wp.kernel(enable_backward=False)
def expanded_kernel(mean: float, w: wp.array[float], count: wp.array[float]):
    i = wp.tid()
    count[i] = poisson_of_normal(mean, w[i])


@wp.kernel(enable_backward=False)
def draw_kernel(mean: float, key: wp.uint32, whole: wp.float64, count: wp.array[wp.int32]):
    """Draws less `whole`, made as the read-out makes them."""
    i = wp.tid()
    none = wp.uint32(0)
    number = wp.uint32(i % PAIRS_PER_BLOCK)
    keys = stream_key(none, none, STREAM_NOISE, i // PAIRS_PER_BLOCK, wp.vec2ui(key, none))
    few = stream_key(none, none, STREAM_FEW, i // PAIRS_PER_BLOCK, wp.vec2ui(key, none))
    w = normal_cosine(normal_radius(hashed(number, keys[0], keys[1])), hashed(number, keys[2], keys[3]))
    count[i] = wp.int32(wp.float64(poisson(mean, w, hashed(number, few[0], few[1]))) - whole)


def launched(kernel, device, mean, numbers, dtype):
    out = wp.empty(len(numbers), dtype=float, device=device)
    wp.launch(kernel, len(numbers), [mean, wp.array(numbers, dtype=dtype, device=device)], [out], device=device)
    return out.numpy().astype(np.float64)


def draws(device, mean, n, key=1):
    """Histogram of n draws, and the count that it begins with."""
    first = int(max(0, mean - 9 * np.sqrt(mean) - 9))
    out = wp.empty(min(n, N_DRAW), dtype=wp.int32, device=device)
    histogram = np.zeros(1, dtype=np.int64)
    for batch in range(n // len(out)):
        wp.launch(draw_kernel, len(out), [mean, key + batch, float(first)], [out], device=device)
        new = np.bincount(out.numpy())
        size = max(len(new), len(histogram))
        histogram = np.pad(histogram, (0, size - len(histogram))) + np.pad(new, (0, size - len(new)))
    return histogram, first


def check_moments(histogram, first, mean):
    """Mean, variance and third central moment within 5 sigma of theirs; central moments of Poisson in the mean.

    Returns how many sigma the farthest is off.
    """
    n = histogram.sum()
    off = first + np.arange(len(histogram)) - mean
    m2, m3, m4, m6 = mean, mean, mean + 3 * mean**2, mean + 25 * mean**2 + 15 * mean**3
    share = histogram / n
    mean_off = share @ off
    pulls = [
        mean_off / np.sqrt(m2 / n),
        (share @ (off - mean_off) ** 2 - m2) / np.sqrt((m4 - m2**2) / n),
        (share @ (off - mean_off) ** 3 - m3) / np.sqrt((m6 - m3**2 - 6 * m4 * m2 + 9 * m2**3) / n),
    ]
    assert np.abs(pulls).max() < N_SIGMA, pulls
    return np.abs(pulls).max()


def check_probabilities(histogram, first, mean):
    """Chi-square against the probabilities, in bins that hold at least 50 draws each."""
    n = histogram.sum()
    count = first + np.arange(len(histogram))
    edges = [-1.0]
    expected = n * stats.poisson.pmf(count, mean)
    width = max(1, int(np.sqrt(mean) / 30))  # some 400 bins
    total = 0.0
    for last in range(width - 1, len(count), width):
        total += expected[last - width + 1 : last + 1].sum()
        if total >= 50:
            edges.append(float(count[last]))
            total = 0.0
    edges[-1] = np.inf
    below = np.concatenate([[0], np.cumsum(histogram)])
    seen = np.diff([0 if e < first else below[-1] if np.isinf(e) else below[int(e) - first + 1] for e in edges])
    wanted = n * np.diff(stats.poisson.cdf(edges, mean))
    statistic = ((seen - wanted) ** 2 / wanted).sum()
    low, high = stats.chi2.ppf([N_SIGMA_TAIL, 1 - N_SIGMA_TAIL], len(wanted) - 1)
    assert low <= statistic <= high, f"chi-square {statistic:.0f} of {len(wanted) - 1}"


MEANS = (1e-3, 1e-2, 0.1, 0.7, 3.0, 11.9, 12.0, 20.5, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7)


@pytest.mark.parametrize("mean", MEANS)
@pytest.mark.ci
def test_draws(device, mean, record_accuracy):
    mean = float(np.float32(mean))
    histogram, first = draws(device, mean, N_DRAW)
    pull = check_moments(histogram, first, mean)
    record_accuracy("Poisson noise, mean 1e-3 to 1e7, moments of 1e7 draws", pull, N_SIGMA, "sigma", "theory")
    check_probabilities(histogram, first, mean)


@pytest.mark.ci
def test_moments_at_the_largest_full_well(device):
    """Where float32 has steps of 64 electrons, a five-hundredth of the standard deviation."""
    check_moments(*draws(device, 1e9, N_DRAW), 1e9)


@pytest.mark.slow
@pytest.mark.parametrize("mean", MEANS)
def test_1e8_draws(device, mean):
    mean = float(np.float32(mean))
    histogram, first = draws(device, mean, 10 * N_DRAW, key=1000)
    check_moments(histogram, first, mean)
    check_probabilities(histogram, first, mean)


def total_variation(device, mean):
    """Of the expansion at a mean from the Poisson distribution: where each count begins on the axis of w, by bisection.

    The function is the kernel's own, in float32.
    """
    count = np.arange(max(0, np.floor(mean - 8 * np.sqrt(mean))), np.ceil(mean + 9 * np.sqrt(mean) + 20))
    low, high = np.full(len(count), -LARGEST_W), np.full(len(count), LARGEST_W)
    for _ in range(32):
        middle = ((low + high) / 2).astype(np.float32)
        below = launched(expanded_kernel, device, mean, middle, wp.float32) < count
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    begin = np.where(count == 0, 0.0, special.ndtr((low + high) / 2))
    share = np.diff(begin, append=1.0)
    return 0.5 * np.abs(share - stats.poisson.pmf(count, mean)).sum()


# At least twice what docs/physics.md says, and less than 1e7 draws could tell, 1 / sqrt(1e7) = 3e-4. Worst at the
# smallest mean; from 1e4 up float32 limits where counts begin: w has steps of 2.4e-7 at 2 to 4, of which a count is
# worth 1 / sqrt(mean).
LARGEST_VARIATION = {THRESHOLD: 2e-5, 16.0: 1e-5, 32.0: 1e-6, 100.0: 5e-7, 1e4: 5e-6, 1e6: 5e-5, 1e7: 1.5e-4}


@pytest.mark.parametrize(("mean", "largest"), LARGEST_VARIATION.items())
def test_total_variation_of_the_expansion(device, mean, largest, record_accuracy):
    distance = total_variation(device, mean)
    assert distance < largest
    record_accuracy("Poisson noise, total variation", distance, largest, "", "scipy")


@pytest.mark.parametrize("mean", [0.0, 1e-6, 1e-3, 0.1, 1.0, 5.0, 11.9])
@pytest.mark.ci
def test_search_inverts_the_distribution(device, mean):
    ends = [0, 1, 2, 9, 2**24 - 1, 2**24, 2**31 - 1, 2**31, 2**32 - 2, 2**32 - 1]
    words = np.concatenate([ends, np.arange(2000) * 3, np.random.default_rng(2).integers(0, 2**32, 200_000)])
    uniform = (words + 0.5) / 2**32
    exact = float(np.float32(mean))
    expected = stats.poisson.isf(uniform, exact) if mean else np.zeros(len(words))
    near = np.abs(stats.poisson.sf(expected - 1, exact) / uniform - 1) < 1e-9 if mean else np.zeros(len(words), bool)
    counts = launched(searched_kernel, device, mean, words.astype(np.uint32), wp.uint32)
    assert near.mean() < 1e-4
    np.testing.assert_array_equal(counts[~near], expected[~near])


def test_exponential(device):
    x = np.concatenate([[0.0, 700.0], np.linspace(0, 20, 20001)])
    out = wp.empty(len(x), dtype=wp.float64, device=device)
    wp.launch(exp_kernel, len(x), [wp.array(x, device=device)], [out], device=device)
    np.testing.assert_allclose(out.numpy(), np.exp(-x), rtol=1e-12)  # the series ends at y^10 / 10!


def test_expansion_never_goes_below_zero_and_is_finite(device):
    w = np.linspace(-LARGEST_W, LARGEST_W, 20001)
    for mean in (THRESHOLD, 14.0, 1e3, 4e9):
        counts = launched(expanded_kernel, device, mean, w, wp.float32)
        assert np.isfinite(counts).all() and counts.min() >= 0
