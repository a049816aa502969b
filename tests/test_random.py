"""Random words, normal deviates and Poisson deviates of kernels: published vectors, moments, tails, collisions."""

import importlib

import numpy as np
import pytest
import warp as wp
from read_outs import N_SIGMA, N_SIGMA_TAIL, philox, twin_hash, twin_normals
from scipy import special, stats
from warpsim_kernels.canvas import PAIRS_PER_BLOCK
from warpsim_kernels.pixel_pairs import STREAM_FEW, STREAM_NOISE
from warpsim_kernels.poisson import SMALLEST_EXPANDED_MEAN, exp_of_minus, poisson, poisson_of_normal, searched_poisson
from warpsim_kernels.random_numbers import (
    fma,
    hashed,
    normal_cosine,
    normal_radius,
    normal_sine,
    philox4x32,
    stream_key,
)

N_WORD = 1_000_000
SEED = 20260101

DEVIATE_ATOL = 2e-6  # float32 arithmetic and the short polynomials, as random_numbers.py promises
ANGLE_ATOL = 5e-7  # of a cosine or sine: five float32 roundings and the polynomials' 5e-8; measured 2e-7
CIRCLE_ATOL = 1e-6  # cosine^2 + sine^2 of one angle: twice the polynomials' error, which is near 2e-7

# Known answers of Random123 (kat_vectors): rounds 10, counter words, key words, output words.
PI_COUNTER = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344)
KAT_4X32 = {
    "zeros": ((0,) * 4, (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    "ones": ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    "pi": (PI_COUNTER, (0xA4093822, 0x299F31D0), (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
}


@wp.kernel(enable_backward=False)
def philox_4x32_kernel(counter: wp.array2d[wp.uint32], key: wp.array2d[wp.uint32], out: wp.array2d[wp.uint32]):
    i = wp.tid()
    words = philox4x32(wp.vec4ui(counter[i, 0], counter[i, 1], counter[i, 2], counter[i, 3]), key[i, 0], key[i, 1])
    for j in range(4):
        out[i, j] = words[j]


@wp.kernel(enable_backward=False)
def fma_kernel(a: wp.array[float], b: wp.array[float], c: wp.array[float], out: wp.array[float]):
    i = wp.tid()
    out[i] = fma(a[i], b[i], c[i])


@wp.kernel(enable_backward=False)
def hash_kernel(
    number: wp.array[wp.uint32], key: wp.array[wp.uint32], second: wp.array[wp.uint32], out: wp.array[wp.uint32]
):
    i = wp.tid()
    out[i] = hashed(number[i], key[i], second[i])


@wp.kernel(enable_backward=False)
def block_words_kernel(first_block: int, seed: wp.uint32, first: wp.array2d[wp.uint32], second: wp.array2d[wp.uint32]):
    """The words of pixel pairs, block by block, as a read-out draws them."""
    block, number = wp.tid()
    none = wp.uint32(0)
    key = stream_key(none, none, STREAM_NOISE, first_block + block, wp.vec2ui(seed, none))
    first[block, number] = hashed(wp.uint32(number), key[0], key[1])
    second[block, number] = hashed(wp.uint32(number), key[2], key[3])


@wp.kernel(enable_backward=False)
def normal_kernel(
    word: wp.array[wp.uint32], angle: wp.array[wp.uint32],
    radius: wp.array[float], cosine: wp.array[float], sine: wp.array[float],
):  # fmt: skip
    i = wp.tid()
    radius[i] = normal_radius(word[i])
    cosine[i] = normal_cosine(1.0, angle[i])
    sine[i] = normal_sine(1.0, angle[i])


def launched(kernel, arrays, dtypes, device, out_dtypes):
    """Outputs of a kernel over the elements of some arrays."""
    inputs = [wp.array(x, dtype=dtype, device=device) for x, dtype in zip(arrays, dtypes, strict=True)]
    out = [wp.empty(len(arrays[0]), dtype=dtype, device=device) for dtype in out_dtypes]
    wp.launch(kernel, dim=len(arrays[0]), inputs=inputs, outputs=out, device=device)
    return [x.numpy() for x in out]


def extreme_words():
    """Words at, and next to, every end of their range, of float32's exactness and of the quadrants, all with all."""
    ends = [0, 1, 2, 255, 2**23, 2**24 - 1, 2**24 + 1, 2**30, 2**31 - 1, 2**31, 2**31 + 1, 3 * 2**30, 2**32 - 256]
    ends += [2**32 - 130, 2**32 - 129, 2**32 - 128, 2**32 - 2, 2**32 - 1]
    return np.array([(high, low) for high in ends for low in ends], dtype=np.uint64).T


def device_normals(words, device):
    """Radius, cosine, sine of each pair of words, float64 copies of the device's float32."""
    out = launched(normal_kernel, words, [wp.uint32] * 2, device, [wp.float32] * 3)
    return [x.astype(np.float64) for x in out]


@pytest.fixture(scope="module")
def words():
    random = np.random.default_rng(SEED).integers(0, 2**32, (2, N_WORD), dtype=np.uint64)
    return np.concatenate([extreme_words(), random], axis=1)


@pytest.mark.parametrize(("counter", "key", "expected"), KAT_4X32.values(), ids=KAT_4X32)
def test_philox_known_answers(device, counter, key, expected):
    assert philox(counter, key) == expected
    assert tuple(device_words([counter], [key], device)[0]) == expected


def test_philox_equals_big_integer_twin(device):
    rng = np.random.default_rng(SEED)
    counter = rng.integers(0, 2**32, (2000, 4), dtype=np.uint64)
    key = rng.integers(0, 2**32, (2000, 2), dtype=np.uint64)
    counter[:1000, 0] = np.arange(1000)  # neighbours, as frames are
    counter[:1000, 1:] = 0
    expected = [philox(tuple(c), tuple(k)) for c, k in zip(counter.tolist(), key.tolist(), strict=True)]
    np.testing.assert_array_equal(device_words(counter, key, device), np.array(expected, dtype=np.uint64))


def device_words(counter, key, device):
    """Output words of many (counter, key), shape (n, 4)."""
    inputs = [wp.array(np.array(x, dtype=np.uint32), dtype=wp.uint32, device=device) for x in (counter, key)]
    out = wp.empty((len(counter), 4), dtype=wp.uint32, device=device)
    wp.launch(philox_4x32_kernel, dim=len(counter), inputs=inputs, outputs=[out], device=device)
    return out.numpy()


def test_hash_equals_its_twin(device):
    numbers = np.random.default_rng(SEED).integers(0, 2**32, (3, 100_000), dtype=np.uint64)
    numbers[:, :8] = [[0, 0, 1, 2**32 - 1, 2**31, 5, 6, 7], [0, 1, 0, 2**32 - 1, 2**31, 0, 0, 0], [0] * 8]
    (got,) = launched(hash_kernel, numbers, [wp.uint32] * 3, device, [wp.uint32])
    np.testing.assert_array_equal(got, twin_hash(*numbers))


def test_fused_multiplication_rounds_once(device):
    """Products of 24-bit numbers whose sum with c would lose its last bits if it was rounded in between."""
    rng = np.random.default_rng(SEED)
    a, b = (rng.integers(2**23, 2**24, 100_000).astype(np.float32) for _ in range(2))
    c = -(a * b)  # the rounded product: what is left is the rounding
    (got,) = launched(fma_kernel, [a, b, c], [wp.float32] * 3, device, [wp.float32])
    exact = a.astype(np.int64) * b.astype(np.int64) + c.astype(np.int64)
    np.testing.assert_array_equal(got, exact.astype(np.float32))
    assert np.count_nonzero(got) > 90_000


def block_words(device, n_block, first_block=0):
    """Both words of the pairs of blocks, (n_block, PAIRS_PER_BLOCK) each."""
    out = [wp.empty((n_block, PAIRS_PER_BLOCK), dtype=wp.uint32, device=device) for _ in range(2)]
    wp.launch(block_words_kernel, out[0].shape, [first_block, SEED], out, device=device)
    return [x.numpy() for x in out]


def check_words_are_even(device, n_batch, n_block):
    """Cells of the upper, middle and lower bits of two to four words, however near, fill evenly: chi-square."""
    histograms = {}
    for batch in range(n_batch):
        word, angle = block_words(device, n_block, batch * n_block)
        count_cells(histograms, "word and angle", [word, angle])
        count_cells(histograms, "next block", [word[1:], word[:-1]])
        count_cells(histograms, "two words and angles", [word[:, 1:], angle[:, 1:], word[:, :-1], angle[:, :-1]])
        for lag in (1, 2, 3, 8, 64, 256):
            count_cells(histograms, f"word and angle {lag} apart", [word[:, lag:], angle[:, :-lag]])
            for shift in (0, 12, 24):
                bits = word << np.uint32(shift)
                four = [bits[:, start : start + 1024 - 3 * lag] for start in (0, lag, 2 * lag, 3 * lag)]
                for n in (2, 3, 4):
                    count_cells(histograms, f"{n} words {lag} apart, from bit {shift}", four[:n])
    for name, cells in histograms.items():
        freedom = cells.size - 1
        z = (((cells - cells.mean()) ** 2).sum() / cells.mean() - freedom) / np.sqrt(2 * freedom)
        assert abs(z) < N_SIGMA, f"{name}: {z:.1f} sigma"


def count_cells(histograms, name, words):
    """Add to the histogram of the upper bits of words taken together."""
    n_bit = {2: 8, 3: 5, 4: 4}[len(words)]
    cell = np.uint32(0)
    for word in words:
        cell = cell * np.uint32(2**n_bit) + (word >> np.uint32(32 - n_bit))
    found = np.bincount(cell.ravel(), minlength=2 ** (n_bit * len(words)))
    histograms[name] = histograms.get(name, 0) + found


@pytest.mark.ci
def test_words_near_each_other_are_independent(device):
    check_words_are_even(device, 1, 4096)


@pytest.mark.slow
def test_words_near_each_other_are_independent_over_1e9_draws(device):
    check_words_are_even(device, 256, 4096)


def test_every_bit_of_a_word_depends_on_every_bit_of_the_number():
    """Strict avalanche of the twin: flipping one input bit flips each output bit half of the time, within 5 %."""
    rng = np.random.default_rng(SEED)
    n = 20_000
    number, key, second = rng.integers(0, 1024, n), rng.integers(0, 2**32, n), rng.integers(0, 2**32, n)
    plain = twin_hash(*(x.astype(np.uint64) for x in (number, key, second)))
    for bit in range(10):
        changed = twin_hash(*(x.astype(np.uint64) for x in (number ^ (1 << bit), key, second)))
        flips = ((plain ^ changed)[:, None] >> np.arange(32, dtype=np.uint64)) & np.uint64(1)
        assert np.abs(flips.mean(axis=0) - 0.5).max() < 0.05


def test_words_collide_as_often_as_chance_across_blocks(device):
    word = np.sort(block_words(device, 8192)[0].ravel())  # 8.4 million words
    expected = word.size**2 / 2 / 2**32
    found = np.count_nonzero(np.diff(word) == 0)
    low, high = stats.poisson.ppf([stats.norm.sf(N_SIGMA), 1 - stats.norm.sf(N_SIGMA)], expected)
    assert low <= found <= high


def test_angle_functions_match_float64(device, words):
    _, cosine, sine = device_normals(words, device)
    turn = 2 * np.pi * words[1].astype(np.uint32).view(np.int32) / 2.0**33
    np.testing.assert_allclose(cosine, np.cos(turn), rtol=0, atol=ANGLE_ATOL)
    np.testing.assert_allclose(sine, np.sin(turn), rtol=0, atol=ANGLE_ATOL)
    np.testing.assert_allclose(cosine**2 + sine**2, 1.0, rtol=0, atol=CIRCLE_ATOL)


def test_radius_matches_float64(device, words):
    radius, _, _ = device_normals(words, device)
    expected = twin_normals(words[0], np.zeros_like(words[0]), False)
    np.testing.assert_allclose(radius, expected, rtol=0, atol=DEVIATE_ATOL)
    assert (np.sign(radius) == np.where(words[0] % 2 == 1, -1, 1)).all()


def test_normals_are_finite_and_bounded(device, words):
    radius, cosine, sine = device_normals(words, device)
    for values, largest in ((radius, 6.6605), (cosine, 1 + ANGLE_ATOL), (sine, 1 + ANGLE_ATOL)):
        assert np.isfinite(values).all()
        assert np.abs(values).max() <= largest
    assert radius.max() == pytest.approx(np.sqrt(2 * 32 * np.log(2)), abs=DEVIATE_ATOL)  # word 0 is among them
    assert 0 < np.abs(radius).min() < 1e-4


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


def poisson_counts(kernel, device, mean, numbers, dtype):
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
    fraction = histogram / n
    mean_off = fraction @ off
    pulls = [
        mean_off / np.sqrt(m2 / n),
        (fraction @ (off - mean_off) ** 2 - m2) / np.sqrt((m4 - m2**2) / n),
        (fraction @ (off - mean_off) ** 3 - m3) / np.sqrt((m6 - m3**2 - 6 * m4 * m2 + 9 * m2**3) / n),
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
        below = poisson_counts(expanded_kernel, device, mean, middle, wp.float32) < count
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    begin = np.where(count == 0, 0.0, special.ndtr((low + high) / 2))
    fraction = np.diff(begin, append=1.0)
    return 0.5 * np.abs(fraction - stats.poisson.pmf(count, mean)).sum()


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
    counts = poisson_counts(searched_kernel, device, mean, words.astype(np.uint32), wp.uint32)
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
        counts = poisson_counts(expanded_kernel, device, mean, w, wp.float32)
        assert np.isfinite(counts).all() and counts.min() >= 0


def test_streams_of_random_numbers_are_different():
    """Those that modules define or import, by name."""
    modules = [
        importlib.import_module(f"warpsim_kernels.{name}") for name in ("pixel_pairs", "pointing_errors", "artifacts")
    ]
    streams = {
        name: int(value) for module in modules for name, value in vars(module).items() if name.startswith("STREAM_")
    }
    assert len(set(streams.values())) == len(streams) == 12
