"""The detector on a device: the steps that its kernels hold, and the numbers they read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.canvas import STRIP_PIXELS
from warpsim_kernels.detector import PixelMaps, PixelScalars, ReadOutFeatures, detector_struct
from warpsim_kernels.poisson import SMALLEST_EXPANDED_MEAN
from warpsim_kernels.read_out import make_read_out_kernel

from warpsim.detector.detectors import ElectronDetector, NeiDetector
from warpsim.detector.levels import ElectronLevels, Levels
from warpsim.detector.pixel_maps import SENSOR_FIELD, read_maps
from warpsim.errors import InputError
from warpsim.launches import struct_of
from warpsim.scene.instrument import Instrument

LARGEST_DEVIATE = 6.67
"""Largest value of a unit normal deviate."""

_BEYOND_ANY_LEVEL_W_CM2 = 3e38

_GOOD_WORD = 0x80000000
"""Random word of a pixel that is neither dead nor hot; those are 0 and its complement."""


@dataclass(frozen=True)
class ReadOut:
    """Kernels and arguments of the stage `read_out`."""

    features: ReadOutFeatures
    detector: Any
    kernel: wp.Kernel
    """Kernel of whole strips."""

    @cached_property
    def rest_kernel(self) -> wp.Kernel:
        """Kernel of the pixels behind the last whole strip of an image; most images have none."""
        return make_read_out_kernel(self.features, ragged=True)


def make_read_out(instrument: Instrument, bands: Sequence[str], device: wp.Device, dark: bool = True) -> ReadOut:
    """Choose the kernels of a detector and upload its numbers.

    The kernels hold what any band needs: a frame must not depend on which of them are rendered. Without `dark` maps of
    dark currents are not read.
    """
    detector, levels, camera = instrument.sensor.detector, instrument.levels, instrument.sensor.camera
    features = read_out_features(detector, levels)
    arrays = struct_of(
        detector_struct(features),
        device,
        pixels=[_scalars(detector, levels[band]) for band in bands],
        keys=[(key & 0xFFFFFFFF, key >> 32) for key in map(instrument.noise_key, range(len(instrument.names)))],
        n_pixel=camera.n_row * camera.n_col,
        n_col=camera.n_col,
    )
    if detector.maps_file is not None:
        arrays.maps = _maps_struct(instrument, bands, device, dark)
    return ReadOut(features, arrays, make_read_out_kernel(features))


def _maps_struct(instrument: Instrument, bands: Sequence[str], device: wp.Device, dark: bool) -> Any:
    """The user's maps as the numbers that random ones would be."""
    detector, camera = instrument.sensor.detector, instrument.sensor.camera
    assert detector.maps_file is not None
    known, shape = list(instrument.sensor.bands), (camera.n_row, camera.n_col)
    maps = read_maps(detector.maps_file, instrument.names, bands, known, shape, every=False)
    offset = maps.offset.astype(np.float64) if dark else np.zeros(maps.offset.shape)
    if isinstance(detector, ElectronDetector):
        dark_e = np.array([getattr(instrument.levels[band], "dark_e") for band in bands])[:, None, None]  # noqa: B009
        if not (dark_e > 0.0).all() and np.nan_to_num(offset).any():
            raise InputError("must be above 0 with offsets in maps_file", "detector.dark_e_s", detector.dark_e_s, "g")
        offset = np.where(dark_e > 0.0, offset / np.where(dark_e > 0.0, dark_e, 1.0) - 1.0, 0.0)
    offset = np.nan_to_num(offset)  # without a map of them offsets are 0, and dark currents the detector's own
    words = np.array([_GOOD_WORD, 0, 0xFFFFFFFF], dtype=np.uint32)[maps.bad]
    n_pixel = camera.n_row * camera.n_col
    stride = -(-n_pixel // STRIP_PIXELS) * STRIP_PIXELS

    def planes(values: Any) -> Any:
        return np.pad(values.reshape(-1, n_pixel), ((0, 0), (0, stride - n_pixel))).ravel()

    return struct_of(
        PixelMaps,
        device,
        stride=stride,
        by_sensor=int(len(maps.gain) > 1 or SENSOR_FIELD in detector.maps_file),
        gain=planes((maps.gain - 1.0).astype(np.float32)),
        offset=planes(offset),
        bad=planes(words),
    )


def read_out_features(detector: NeiDetector | ElectronDetector, levels: Mapping[str, Levels]) -> ReadOutFeatures:
    """The steps that a detector needs: those of its fields of the same names, and those that follow from several."""
    electrons = isinstance(detector, ElectronDetector)
    if isinstance(detector, ElectronDetector):
        smallest_e = min(_smallest_mean_e(detector, level) for level in levels.values())
        own = {
            "dsnu": detector.dsnu * detector.dark_e_s > 0,
            "column_noise": detector.column_noise_e > 0,
            "shot_noise": detector.shot_noise,
            "small_means": detector.shot_noise and smallest_e < SMALLEST_EXPANDED_MEAN,
            "read_noise": detector.read_noise_e > 0,
        }
    else:
        own = {
            "dsnu": detector.dsnu_nei > 0,
            "column_noise": detector.column_noise_nei > 0,
        }
    maps = detector.maps_file is not None
    alike = {name: getattr(detector, name) > 0 for name in ReadOutFeatures._fields if hasattr(detector, name)}
    bad_pixels = detector.dead_fraction + detector.hot_fraction > 0
    if maps:
        own |= {"maps": True, "prnu": True, "bad_pixels": True, "small_means": own.get("shot_noise", False)}
        own["dsnu"] = not electrons or getattr(detector, "dark_e_s", 0.0) > 0
    return ReadOutFeatures(**alike | {"electrons": electrons, "bad_pixels": bad_pixels} | own)


def _smallest_mean_e(detector: ElectronDetector, levels: Levels) -> float:
    """Mean electrons of the darkest pixel that there may be."""
    assert isinstance(levels, ElectronLevels)
    light = 0.0 if detector.dead_fraction > 0 else levels.background_e * (1 - LARGEST_DEVIATE * detector.prnu)
    # Half a part in a thousand makes up for the kernel's float32.
    return 0.9995 * (light + levels.dark_e * max(0.0, 1 - LARGEST_DEVIATE * detector.dsnu))


def _scalars(detector: NeiDetector | ElectronDetector, levels: Levels) -> Any:
    """The kernels' numbers of one band: the fields of the same names, and those that follow from several."""
    scalars: Any = PixelScalars()
    for name in PixelScalars.vars:
        if hasattr(detector, name):
            setattr(scalars, name, getattr(detector, name))
    scalars.zero_counts = detector.offset_counts + 0.5
    scalars.most_counts = float(2**detector.bits - 1)
    scalars.dead_below = _words(detector.dead_fraction)
    scalars.hot_below = _words(detector.hot_fraction)
    if detector.maps_file is not None:
        scalars.prnu, scalars.dead_below, scalars.hot_below = 1.0, 1, 1
    if isinstance(detector, ElectronDetector):
        assert isinstance(levels, ElectronLevels)
        if detector.maps_file is not None:
            scalars.dsnu = 1.0
        scalars.column_noise = detector.column_noise_e
        scalars.full_level = detector.full_well_e
        # Before gains, of which the smallest is about a third.
        scalars.most = 4 * detector.full_well_e + 1000
        scalars.loss_per_level = detector.nonlinearity / detector.full_well_e
        scalars.e_per_w_cm2, scalars.background_e = levels.e_per_w_cm2, levels.background_e
        scalars.dark_e = levels.dark_e
        scalars.counts_per_e = 1 / detector.gain_e_per_count
    else:
        scalars.dsnu = 1.0 if detector.maps_file is not None else detector.dsnu_nei * levels.nei_w_cm2
        scalars.column_noise = detector.column_noise_nei * levels.nei_w_cm2
        scalars.full_level, scalars.most = levels.sei_w_cm2, _BEYOND_ANY_LEVEL_W_CM2
        scalars.loss_per_level = detector.nonlinearity / levels.sei_w_cm2
        ceiling_nei = levels.sei_w_cm2 / levels.nei_w_cm2 * (1 - detector.nonlinearity)
        saturated_counts = ceiling_nei * detector.counts_per_nei + scalars.zero_counts
        scalars.most_counts = min(saturated_counts, scalars.most_counts)
        scalars.counts_per_w_cm2 = detector.counts_per_nei / levels.nei_w_cm2
        scalars.counts_per_nei = detector.counts_per_nei
    return scalars


def _words(fraction: float) -> int:
    """Return the number of the 2**32 random words that are a fraction of them."""
    return round(fraction * 2**32)
