"""Read-outs without a scene, for tests of noise: signal in, counts out; float64 twins; gates of statistics."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import warp as wp
from scipy import special, stats

from warpsim.detector.levels import electron_levels, levels
from warpsim.detector.nei import NeiDetector
from warpsim.optics.camera import Camera
from warpsim.optics.telescope import Optics
from warpsim.render import stages
from warpsim.render.read_out import make_read_out
from warpsim.sky.bands import BANDS

N_SIGMA = 5.0
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


def read_out(detector, signal, device, *, frames=None, sensors=None, bands=None, seed=SEED, tiles=True):
    """Counts of signal (n_view, n_band, n_row, n_col), by the renderer's stage or by the scalar kernel alone."""
    n_view, n_band, n_row, n_col = signal.shape

    def numbers(values, n):
        return np.arange(n) if values is None else np.asarray(values)

    def upload(values):
        return wp.array(values, dtype=wp.uint32, device=device)

    band_numbers = numbers(bands, n_band)
    names = [BAND_NAMES[number % len(BAND_NAMES)] for number in band_numbers]
    known = {name: levels(detector, OPTICS, CAMERA, name) for name in names}
    views = SimpleNamespace(
        frame=upload(numbers(frames, n_view)), sensor=upload(numbers(sensors or [0] * n_view, n_view))
    )
    world = SimpleNamespace(
        band_id=upload(band_numbers),
        read_out=make_read_out(detector, known, names, seed, (n_row, n_col), wp.get_device(device)),
        device=wp.get_device(device),
    )
    counts = wp.zeros(signal.shape, dtype=wp.uint16, device=device)
    light = wp.array(signal, dtype=wp.float32, device=device)
    if tiles:
        stages.read_out(world, SimpleNamespace(counts=counts, signal_w_cm2=light, views=views))
    else:
        inputs = [light.flatten(), views.frame, views.sensor, world.band_id, world.read_out.detector, 0]
        dim = (n_view, n_band, n_row * n_col)
        wp.launch(world.read_out.rest_kernel, dim=dim, inputs=inputs, outputs=[counts.flatten()], device=device)
    return counts.numpy()


def deviates(device, shape=(1, 1, 512, 512), detector=FINE, **numbers):
    """Noise in units of its standard deviation; of a detector with FINE's gain and offset."""
    return (read_out(detector, np.zeros(shape), device, **numbers).astype(np.float64) - FINE_OFFSET) / FINE_GAIN


def levels_of(detector, band="A"):
    """Levels of a detector in electrons behind OPTICS and CAMERA."""
    return electron_levels(detector, OPTICS, CAMERA, band)


def twin_words(frame, sensor, band, seed, n_pixel, stream=1, first_pair=0):
    """64 bits of each pixel, and whether it takes the sine: Philox in NumPy's 64-bit integers."""
    low = np.uint64(0xFFFFFFFF)
    c = [np.uint64(x) for x in (frame, sensor, band, stream)]
    k = [np.uint64(seed) & low, np.uint64(seed) >> np.uint64(32)]
    for _ in range(10):
        a, b = np.uint64(0xD2511F53) * c[0], np.uint64(0xCD9E8D57) * c[2]
        c = [(b >> np.uint64(32)) ^ c[1] ^ k[0], b & low, (a >> np.uint64(32)) ^ c[3] ^ k[1], a & low]
        k = [(k[0] + np.uint64(0x9E3779B9)) & low, (k[1] + np.uint64(0xBB67AE85)) & low]
    pixel = np.arange(n_pixel)
    x, y, key = (pixel // 128 * 64 + pixel % 64 + first_pair).astype(np.uint64), np.full(n_pixel, c[1]), c[0]
    for _ in range(10):
        product = np.uint64(0xD256D193) * x
        x, y = (product >> np.uint64(32)) ^ key ^ y, product & low
        key = (key + np.uint64(0x9E3779B9)) & low
    return x, y, pixel % 128 >= 64


def twin_deviates(frame, sensor, band, seed, n_pixel, stream=1, first_pair=0):
    """The same deviates in float64: Box and Muller."""
    upper, lower, takes_sine = twin_words(frame, sensor, band, seed, n_pixel, stream, first_pair)
    turns = ((lower % 2**31) + 0.5) / 2**32 - 0.25 + 0.5 * (lower >> np.uint64(31))
    angle = 2 * np.pi * turns
    return np.sqrt(-2 * np.log((upper + 0.5) / 2**32)) * np.where(takes_sine, np.sin(angle), np.cos(angle))


def check_gaussian(histogram):
    """5-sigma gates on a histogram of fine counts."""
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


def assert_uncorrelated(a, b):
    """Neither the deviates nor their squares (a shared radius would show there) nor their signs are correlated."""
    a, b = np.ravel(a), np.ravel(b)
    gate = N_SIGMA / np.sqrt(len(a))
    assert abs(np.corrcoef(a, b)[0, 1]) < gate
    assert abs(np.corrcoef(a * a, b * b)[0, 1]) < gate
    assert abs(np.corrcoef(a * a, b)[0, 1]) < gate
