"""Read-outs without a scene, for tests of noise: signal in, counts out, by the renderer's own stage."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import warp as wp

from warpsim.detector.levels import electron_levels, levels
from warpsim.detector.nei import NeiDetector
from warpsim.optics.camera import Camera
from warpsim.optics.psf import Optics
from warpsim.render import stages
from warpsim.render.read_out import make_read_out
from warpsim.sky.bands import BANDS

SEED = 0x0123456789ABCDEF
BAND_NAMES = tuple(BANDS)
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
    known = {name: levels(detector, OPTICS, CAMERA, name) for name in BAND_NAMES}
    names = [BAND_NAMES[number % len(BAND_NAMES)] for number in band_numbers]
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
