"""Read-outs without a scene, for tests of noise: signal in, counts out; float64 twins; gates of statistics."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import warp as wp
from scipy import special, stats
from warpsim_kernels.canvas import STRIP_PIXELS, STRIPS_PER_BLOCK

from warpsim.detector.detectors import NeiDetector
from warpsim.detector.levels import electron_levels, levels
from warpsim.optics.camera import Camera
from warpsim.optics.telescope import Optics
from warpsim.radiometry.bands import BANDS
from warpsim.render import stages
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_signal
from warpsim.render.read_out import make_read_out

N_SIGMA = 5.0
"""Gates of statistics. Seeds are fixed: every processor sees the same draws but for their last bits, so that no room
below the gates is needed. A test that passes on one passes on all."""
N_SIGMA_TAIL = stats.norm.sf(N_SIGMA)  # one-sided probability behind the gates that are not Gaussian
KS_GATE = np.sqrt(-0.5 * np.log(N_SIGMA_TAIL))  # sqrt(n) * D exceeds it with probability 2 * N_SIGMA_TAIL

SEED = 0x0123456789ABCDEF
BAND_NAMES = ("A", *(name for name in BANDS if name != "A"))
"""Band number 0 is A."""
OPTICS = Optics(aperture_m=0.4, obscuration=0.3)
CAMERA = Camera(n_row=128, n_col=128, fov_deg=1.0)

# A gain so fine that deviates can be read back: half a count is 1.1e-4 sigma, and nothing clips below 7.2 sigma.
FINE_GAIN, FINE_OFFSET = 4500.0, 32768.0
FINE = NeiDetector(nei_w_cm2=1e-18, sei_w_cm2=3e-15, bits=16, offset_counts=FINE_OFFSET, counts_per_nei=FINE_GAIN)


def read_out(
    detector,
    light,
    device,
    *,
    frames=None,
    sensors=None,
    bands=None,
    seed=SEED,
    ragged=False,
    signal=None,
    first_view=0,
    n_counts=None,
):
    """Counts of light (n_view, n_band, n_row, n_col), by the renderer's stage or the kernel of ragged ends alone."""
    n_view, n_band, n_row, n_col = light.shape

    def numbers(values, n):
        return np.arange(n) if values is None else np.asarray(values)

    band_numbers = numbers(bands, n_band)
    names = [BAND_NAMES[number % len(BAND_NAMES)] for number in band_numbers]
    known = {name: levels(detector, OPTICS, CAMERA, name) for name in names}
    where = wp.get_device(device)
    inputs = new_inputs(where, np.zeros(n_view), numbers(frames, n_view), numbers(sensors or [0] * n_view, n_view))
    world = SimpleNamespace(
        band_id=wp.array(band_numbers, dtype=wp.uint32, device=device),
        read_out=make_read_out(instrument_of(detector, known, seed, (n_row, n_col)), names, where),
        device=where,
    )
    counts = wp.zeros((n_counts or n_view, *light.shape[1:]), dtype=wp.uint16, device=device)
    signal = lit_everywhere(light, where) if signal is None else signal
    if ragged:
        n_image, n_pixel = n_view * n_band, n_row * n_col
        n_strip = -(-n_pixel // STRIP_PIXELS)
        reads = [inputs.frame, inputs.sensor, world.band_id, world.read_out.detector, 0, n_strip, 0, 0]
        reads.append(signal.touched.flatten())
        writes = [counts.reshape((n_image, n_pixel)), signal.images.reshape((n_image, n_pixel))]
        dim = [n_image * -(-n_strip // STRIPS_PER_BLOCK)]
        wp.launch_tiled(world.read_out.rest_kernel, dim=dim, inputs=reads, outputs=writes, block_dim=64, device=device)
    else:
        elsewhere = wp.zeros(light.shape, dtype=wp.uint16, device=device)
        stage = stages.read_out(world, inputs, signal, elsewhere, first_view)
        stages.read_out_into(stage, stages.counts_for(stage, counts))
        stage.run()
    return counts.numpy()


N_SENSOR = 100


def instrument_of(detector, known, seed, shape):
    """What make_read_out asks of an instrument of N_SENSOR sensors."""
    camera = SimpleNamespace(n_row=shape[0], n_col=shape[1])
    return SimpleNamespace(
        sensor=SimpleNamespace(detector=detector, camera=camera), levels=known, names=range(N_SENSOR),
        noise_key=lambda sensor: sensor_key(seed, sensor),
    )  # fmt: skip


def sensor_key(seed, sensor):
    """64 bits of a sensor; those of the first are the seed."""
    return (int(seed) + 0x9E3779B97F4A7C15 * int(sensor)) % 2**64


def lit_everywhere(light, device):
    """Signal of any images, every strip of them flagged."""
    signal = new_signal(light.shape, device)
    signal.images.assign(np.asarray(light, dtype=np.float32))
    signal.touched.fill_(1)
    return signal


def deviates(device, shape=(1, 1, 512, 512), detector=FINE, **numbers):
    """Noise in units of its standard deviation; of a detector with FINE's gain and offset."""
    return (read_out(detector, np.zeros(shape), device, **numbers).astype(np.float64) - FINE_OFFSET) / FINE_GAIN


def levels_of(detector, band="A"):
    """Levels of a detector in electrons behind OPTICS and CAMERA."""
    return electron_levels(detector, OPTICS, CAMERA, band)


def twin_words(frame, sensor, band, seed, n_pixel, stream=1):
    """Two words of 32 bits of each pixel's pair, and whether it takes the sine: in NumPy's 64-bit integers."""
    pixel = np.arange(n_pixel)
    c = twin_key(frame, sensor, band, seed, stream + 256 * (pixel // 2048))
    number = (pixel % 2048 // 128 * 64 + pixel % 64).astype(np.uint64)
    return twin_hash(number, c[0], c[1]), twin_hash(number, c[2], c[3]), pixel % 128 >= 64


def philox(counter, key):
    """Philox4x32-10 in Python integers."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(10):
        high0, low0 = divmod(0xD2511F53 * c0, 2**32)
        high1, low1 = divmod(0xCD9E8D57 * c2, 2**32)
        c0, c1, c2, c3 = high1 ^ c1 ^ k0, low1, high0 ^ c3 ^ k1, low0
        k0, k1 = (k0 + 0x9E3779B9) % 2**32, (k1 + 0xBB67AE85) % 2**32
    return c0, c1, c2, c3


def twin_key(frame, sensor, band, seed, purpose):
    """Four words of Philox4x32-10 keyed by the sensor's 64 bits; purposes may be an array."""
    key = sensor_key(seed, sensor)
    purposes, inverse = np.unique(purpose, return_inverse=True)
    words = [philox((int(frame), 0, int(band), int(one)), (key % 2**32, key >> 32)) for one in purposes]
    return np.moveaxis(np.array(words, dtype=np.uint64)[inverse.reshape(np.shape(purpose))], -1, 0)


def twin_hash(number, key, second_key):
    """The hash of random_numbers.py."""
    low = np.uint64(0xFFFFFFFF)
    x = (number * (key | np.uint64(1)) + second_key) & low
    x = ((x ^ (x >> np.uint64(16))) * np.uint64(0x21F0AAAD)) & low
    x = ((x ^ (x >> np.uint64(15))) * np.uint64(0xD35A2D97)) & low
    return x ^ (x >> np.uint64(15))


def twin_deviates(frame, sensor, band, seed, n_pixel, stream=1):
    """The same deviates in float64: Box and Muller."""
    word, angle, takes_sine = twin_words(frame, sensor, band, seed, n_pixel, stream)
    return twin_normals(word, angle, takes_sine)


def twin_columns(frame, sensor, band, seed, n_col):
    """Deviates of columns: cosines of the words of the first block, whatever the column's number."""
    keys = np.array(twin_key(frame, sensor, band, seed, 5), dtype=np.uint64)
    column = np.arange(n_col, dtype=np.uint64)
    return twin_normals(twin_hash(column, *keys[:2]), twin_hash(column, *keys[2:]), False)


def twin_normals(word, angle, takes_sine):
    """Unit normal deviates of two words, in float64."""
    radius = np.sqrt(-2 * np.log((word | np.uint64(1)) / 2.0**32)) * np.where(word & np.uint64(1), -1.0, 1.0)
    turn = 2 * np.pi * angle.astype(np.uint32).view(np.int32) / 2.0**33
    return radius * np.where(takes_sine, np.sin(turn), np.cos(turn))


def check_gaussian(histogram):
    """5-sigma gates on a histogram of fine counts; returns how many sigma the farthest moment is off."""
    n = int(histogram.sum())
    z = (np.arange(65536) - FINE_OFFSET) / FINE_GAIN
    share = histogram / n
    mean = share @ z
    variance, skew, kurtosis = (share @ (z - mean) ** k for k in (2, 3, 4))
    assert abs(mean) < N_SIGMA / np.sqrt(n)
    assert abs(variance - 1 - 1 / (12 * FINE_GAIN**2)) < N_SIGMA * np.sqrt(2 / n)
    assert abs(skew / variance**1.5) < N_SIGMA * np.sqrt(6 / n)
    assert abs(kurtosis / variance**2 - 3) < N_SIGMA * np.sqrt(24 / n)
    edge = z + 0.5 / FINE_GAIN
    distance = np.abs(np.cumsum(share) - special.ndtr(edge)).max()
    assert distance * np.sqrt(n) < KS_GATE
    for n_sigma in (4, 5):
        step = n_sigma * int(FINE_GAIN)
        for tail in (histogram[: 32768 - step], histogram[32768 + step + 1 :]):  # beyond n_sigma plus half a count
            expected = n * stats.norm.sf(n_sigma + 0.5 / FINE_GAIN)
            low, high = stats.poisson.ppf([N_SIGMA_TAIL, 1 - N_SIGMA_TAIL], expected)
            assert low <= tail.sum() <= high, f"{tail.sum()} draws beyond {n_sigma} sigma, expected {expected:.1f}"
    pulls = [mean * np.sqrt(n), (variance - 1 - 1 / (12 * FINE_GAIN**2)) * np.sqrt(n / 2)]
    pulls += [skew / variance**1.5 * np.sqrt(n / 6), (kurtosis / variance**2 - 3) * np.sqrt(n / 24)]
    return np.abs(pulls).max()


def assert_uncorrelated(a, b):
    """Neither the deviates nor their squares (a shared radius would show there) nor their signs are correlated.

    Returns the largest of the correlations in sigma.
    """
    a, b = np.ravel(a), np.ravel(b)
    pairs = ((a, b), (a * a, b * b), (a * a, b))
    pulls = [abs(np.corrcoef(one, other)[0, 1]) * np.sqrt(len(a)) for one, other in pairs]
    assert max(pulls) < N_SIGMA
    return max(pulls)


def assert_alone_as_in_batch(detector, signal, device):
    """An image (3, 2, n_row, n_col) in a batch is as it is alone, and by the kernel of ragged ends."""
    numbers = {"frames": [4, 2, 9], "sensors": [1, 0, 5], "bands": [3, 1]}
    batch = read_out(detector, signal, device, **numbers)
    alone = read_out(detector, signal[1:2, 1:], device, frames=[2], sensors=[0], bands=[1])
    np.testing.assert_array_equal(batch[1, 1], alone[0, 0])
    np.testing.assert_array_equal(read_out(detector, signal, device, ragged=True, **numbers), batch)
