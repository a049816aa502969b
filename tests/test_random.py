"""Random integers and normal deviates: published vectors, big-integer twins, statistics and float64 mathematics."""

import numpy as np
import pytest
import warp as wp
from read_outs import N_SIGMA, twin_hash, twin_normals
from scipy import stats
from warpsim_kernels.canvas import PAIRS_PER_BLOCK
from warpsim_kernels.random_numbers import (
    STREAM_NOISE,
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


def twin_4x32(counter, key):
    """Philox4x32-10 in Python integers: output words."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(10):
        high0, low0 = divmod(0xD2511F53 * c0, 2**32)
        high1, low1 = divmod(0xCD9E8D57 * c2, 2**32)
        c0, c1, c2, c3 = high1 ^ c1 ^ k0, low1, high0 ^ c3 ^ k1, low0
        k0, k1 = (k0 + 0x9E3779B9) % 2**32, (k1 + 0xBB67AE85) % 2**32
    return c0, c1, c2, c3


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
    assert twin_4x32(counter, key) == expected
    assert tuple(device_words([counter], [key], device)[0]) == expected


def test_philox_equals_big_integer_twin(device):
    rng = np.random.default_rng(SEED)
    counter = rng.integers(0, 2**32, (2000, 4), dtype=np.uint64)
    key = rng.integers(0, 2**32, (2000, 2), dtype=np.uint64)
    counter[:1000, 0] = np.arange(1000)  # neighbours, as frames are
    counter[:1000, 1:] = 0
    expected = [twin_4x32(tuple(c), tuple(k)) for c, k in zip(counter.tolist(), key.tolist(), strict=True)]
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
