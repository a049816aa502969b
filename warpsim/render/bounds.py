"""Cramer-Rao bounds of targets in images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.detector.levels import ElectronLevels, noise_variance
from warpsim.launches import struct_of, to_numpy
from warpsim.render.batch import HostColumns
from warpsim.render.device_scene import DeviceScene
from warpsim.scene.instrument import Instrument

Ints = npt.NDArray[np.int64]

MOST_VALUES = 2**22
"""Pixels about moving targets that are held at a time, of 32 bytes; those of one target at least."""


def full_w_cm2(instrument: Instrument, band: str) -> float:
    """Return the light in a pixel from which on it, or the converter, is full [W/cm2]."""
    levels = instrument.levels[band]
    if isinstance(levels, ElectronLevels):  # the converter's end is part of the SEI
        return levels.sei_w_cm2
    most_nei = (2.0**instrument.sensor.detector.bits - 1.0 - levels.blank_counts) / levels.counts_per_nei
    return min(levels.sei_w_cm2, most_nei * levels.nei_w_cm2)


def cramer_rao_bounds(
    scene: DeviceScene, bands: Sequence[str], targets: Any, seen: HostColumns, half_px: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the bounds of x and y [px] and of the light over itself, (view, band, target, 3); NaN without light.

    Args:
        scene: What was rendered.
        bands: Names of the bands.
        targets: The kernels' TargetImages, of the same views.
        seen: Columns of the views.
        half_px: Columns and rows to each side of a target, or of its path, that are fitted, (n_band, 2).
    """
    instrument, moving = scene.instrument, scene.streaks.enabled
    shape = tuple(targets.irradiance_w_cm2.shape)
    found = np.full((*shape, 3), np.nan)
    if found.size == 0:
        return found
    noise = _pixel_noise(instrument, bands, scene.device)
    item = np.argwhere(to_numpy(targets.irradiance_w_cm2) > 0.0)
    window = _windows(instrument, seen, half_px)[tuple(item.T)]
    n_value = (window[:, 1] - window[:, 0]) * (window[:, 3] - window[:, 2]) * int(moving)
    for first, end in _parts(n_value):
        own = n_value[first:end]
        kinds = ((item[first:end], wp.vec3i), (window[first:end], wp.vec4i), (np.cumsum(own) - own, wp.int32))
        given = [wp.array(array.astype(np.int32), dtype=dtype, device=scene.device) for array, dtype in kinds]
        sigma = wp.empty(end - first, dtype=wp.vec3d, device=scene.device)
        values = wp.empty(int(own.sum()), dtype=wp.vec4d, device=scene.device)
        scene.psf.measure_bounds(targets, scene.stamp_rule, noise, given, [sigma, values], moving)
        found[tuple(item[first:end].T)] = to_numpy(sigma).reshape(-1, 3)
    return found


def _windows(instrument: Instrument, seen: HostColumns, half_px: npt.NDArray[np.float64]) -> Ints:
    """First and end of columns, then of rows, that are fitted, cut to the image, (view, band, target, 4)."""
    camera = instrument.sensor.camera
    middle = np.floor(np.nan_to_num(seen.observations["xy_px"], nan=-1e9) + 0.5)[:, None]
    way_px = np.abs(seen.offset_px).sum(axis=2, dtype=np.float64)[:, None]  # Legendre polynomials are at most 1
    half = np.ceil(half_px[:, None] + way_px)
    size = np.array([camera.n_col, camera.n_row])
    low = np.clip(middle - half, 0, size).astype(np.int64)
    high = np.clip(middle + half + 1, low, size).astype(np.int64)
    return np.stack([low[..., 0], high[..., 0], low[..., 1], high[..., 1]], axis=-1)


def _parts(n_value: Ints) -> Iterator[tuple[int, int]]:
    """First and end of targets whose values are held together."""
    first, held = 0, 0
    for number, n in enumerate(n_value.tolist()):
        if held + n > MOST_VALUES and number > first:
            yield first, number
            first, held = number, 0
        held += n
    if first < len(n_value):
        yield first, len(n_value)


def _pixel_noise(instrument: Instrument, bands: Sequence[str], device: wp.Device) -> Any:
    """The kernels' PixelNoise; rounding to counts included."""
    from warpsim_kernels.bounds import PixelNoise  # with the kernels of gradients, which take time to import

    noise = [noise_variance(instrument.sensor.detector, instrument.levels[band]) for band in bands]
    variance, shot = zip(*noise, strict=True)
    sei = [full_w_cm2(instrument, band) for band in bands]
    return struct_of(PixelNoise, device, variance_w2_cm4=variance, shot_w_cm2=shot, sei_w_cm2=sei)
