"""Random integers and normal deviates: published vectors, big-integer twins and float64 mathematics."""

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.normal import normal_cosine, normal_radius, normal_sine
from warpsim_kernels.philox import lower_word, philox2x32_word, philox4x32, upper_word

N_WORD = 1_000_000
SEED = 20260101

DEVIATE_ATOL = 2e-6  # float32 arithmetic and the short polynomials, as normal.py promises
CIRCLE_ATOL = 1e-6  # cosine^2 + sine^2 of one angle: twice the polynomials' error, which is near 2e-7

# Known answers of Random123 (kat_vectors): rounds 10, counter words, key words, output words.
PI_COUNTER = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344)
KAT_2X32 = {
    "zeros": ((0, 0), (0,), (0xFF1DAE59, 0x6CD10DF2)),
    "ones": ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF,), (0x2C3F628B, 0xAB4FD7AD)),
    "pi": (PI_COUNTER[:2], (0x13198A2E,), (0xDD7CE038, 0xF62A4C12)),
}
KAT_4X32 = {
    "zeros": ((0,) * 4, (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    "ones": ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    "pi": (PI_COUNTER, (0xA4093822, 0x299F31D0), (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1)),
}


def twin_2x32(counter, key):
    """Philox2x32-10 in Python integers: output words."""
    left, right = counter
    (k,) = key
    for _ in range(10):
        high, low = divmod(0xD256D193 * left, 2**32)
        left, right = high ^ k ^ right, low
        k = (k + 0x9E3779B9) % 2**32
    return left, right


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
def philox_2x32_kernel(counter: wp.array2d[wp.uint32], key: wp.array2d[wp.uint32], word: wp.array[wp.uint64]):
    i = wp.tid()
    word[i] = philox2x32_word(counter[i, 0], counter[i, 1], key[i, 0])


@wp.kernel(enable_backward=False)
def philox_4x32_kernel(counter: wp.array2d[wp.uint32], key: wp.array2d[wp.uint32], out: wp.array2d[wp.uint32]):
    i = wp.tid()
    words = philox4x32(wp.vec4ui(counter[i, 0], counter[i, 1], counter[i, 2], counter[i, 3]), key[i, 0], key[i, 1])
    for j in range(4):
        out[i, j] = words[j]


@wp.kernel(enable_backward=False)
def normal_kernel(
    word: wp.array[wp.uint64], radius: wp.array[float], cosine: wp.array[float], sine: wp.array[float]
):
    i = wp.tid()
    radius[i] = normal_radius(upper_word(word[i]))
    cosine[i] = normal_cosine(lower_word(word[i]))
    sine[i] = normal_sine(lower_word(word[i]))


def device_words(kernel, counter, key, device):
    """Output words of many (counter, key), shape (n, 2 or 4)."""
    inputs = [wp.array(np.array(x, dtype=np.uint32), dtype=wp.uint32, device=device) for x in (counter, key)]
    n = len(counter)
    if kernel is philox_4x32_kernel:
        out = wp.empty((n, 4), dtype=wp.uint32, device=device)
        wp.launch(kernel, dim=n, inputs=inputs, outputs=[out], device=device)
        return out.numpy()
    out = wp.empty(n, dtype=wp.uint64, device=device)
    wp.launch(kernel, dim=n, inputs=inputs, outputs=[out], device=device)
    words = out.numpy()
    return np.stack([words >> np.uint64(32), words & np.uint64(0xFFFFFFFF)], axis=1)


def extreme_words():
    """Words whose halves are at, and next to, every end of their range and of the quadrants."""
    ends = [0, 1, 2, 255, 2**23, 2**24 - 1, 2**24 + 1, 2**30, 2**31 - 1, 2**31, 2**31 + 1, 3 * 2**30, 2**32 - 256]
    ends += [2**32 - 130, 2**32 - 129, 2**32 - 128, 2**32 - 2, 2**32 - 1]
    return np.array([(high << 32) | low for high in ends for low in ends], dtype=np.uint64)


def device_normals(words, device):
    """Radius, cosine, sine of each word, float64 copies of the device's float32."""
    out = [wp.empty(len(words), dtype=wp.float32, device=device) for _ in range(3)]
    wp.launch(normal_kernel, dim=len(words), inputs=[wp.array(words, device=device)], outputs=out, device=device)
    return [x.numpy().astype(np.float64) for x in out]


@pytest.fixture(scope="module")
def words():
    random = np.random.default_rng(SEED).integers(0, 2**64, N_WORD, dtype=np.uint64)
    return np.concatenate([extreme_words(), random])


def angle_turns(words):
    """Fraction of a turn of each word: 32 low bits, the highest of which adds half a turn."""
    low = (words & np.uint64(0xFFFFFFFF)).astype(np.int64)
    return ((low % 2**31) + 0.5) / 2**32 - 0.25 + 0.5 * (low >> 31)


@pytest.mark.parametrize(("counter", "key", "expected"), KAT_2X32.values(), ids=KAT_2X32)
def test_philox_2x32_known_answers(device, counter, key, expected):
    assert twin_2x32(counter, key) == expected
    assert tuple(device_words(philox_2x32_kernel, [counter], [key], device)[0]) == expected


@pytest.mark.parametrize(("counter", "key", "expected"), KAT_4X32.values(), ids=KAT_4X32)
def test_philox_4x32_known_answers(device, counter, key, expected):
    assert twin_4x32(counter, key) == expected
    assert tuple(device_words(philox_4x32_kernel, [counter], [key], device)[0]) == expected


@pytest.mark.parametrize(
    ("kernel", "twin", "n_counter", "n_key"),
    [(philox_2x32_kernel, twin_2x32, 2, 1), (philox_4x32_kernel, twin_4x32, 4, 2)],
    ids=["2x32", "4x32"],
)
def test_philox_equals_big_integer_twin(device, kernel, twin, n_counter, n_key):
    rng = np.random.default_rng(SEED + n_key)
    counter = rng.integers(0, 2**32, (2000, n_counter), dtype=np.uint64)
    key = rng.integers(0, 2**32, (2000, n_key), dtype=np.uint64)
    counter[:1000, 0] = np.arange(1000)  # neighbours, as pixels and frames are
    counter[:1000, 1:] = 0
    expected = [twin(tuple(c), tuple(k)) for c, k in zip(counter.tolist(), key.tolist(), strict=True)]
    np.testing.assert_array_equal(device_words(kernel, counter, key, device), np.array(expected, dtype=np.uint64))


def test_angle_functions_match_float64(device, words):
    _, cosine, sine = device_normals(words, device)
    turns = angle_turns(words)
    np.testing.assert_allclose(cosine, np.cos(2 * np.pi * turns), rtol=0, atol=DEVIATE_ATOL)
    np.testing.assert_allclose(sine, np.sin(2 * np.pi * turns), rtol=0, atol=DEVIATE_ATOL)
    np.testing.assert_allclose(cosine**2 + sine**2, 1.0, rtol=0, atol=CIRCLE_ATOL)


def test_radius_matches_float64(device, words):
    radius, _, _ = device_normals(words, device)
    u = ((words >> np.uint64(32)).astype(np.float64) + 0.5) / 2**32
    np.testing.assert_allclose(radius, np.sqrt(-2 * np.log(u)), rtol=0, atol=DEVIATE_ATOL)


def test_normals_are_finite_and_bounded(device, words):
    radius, cosine, sine = device_normals(words, device)
    for values, largest in ((radius, 6.7638), (cosine, 1 + DEVIATE_ATOL), (sine, 1 + DEVIATE_ATOL)):
        assert np.isfinite(values).all()
        assert np.abs(values).max() <= largest
    assert radius.min() >= 0
    assert radius.max() == pytest.approx(np.sqrt(-2 * np.log(0.5 / 2**32)), abs=DEVIATE_ATOL)  # word 0 is among them
