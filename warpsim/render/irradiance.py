"""Irradiance of an image by its counts, with its noise."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.detector.detectors import ElectronDetector
from warpsim.detector.levels import noise_variance
from warpsim.render.frameset import FrameSet
from warpsim.scene.instrument import Instrument

F64 = npt.NDArray[np.float64]

_FULL_SIGMA = 5.0
"""Noise by which a full pixel may read less than what it holds."""


class IrradianceImage(NamedTuple):
    """One image as irradiance, (row, column)."""

    light_w_cm2: F64
    """By the counts above blank sky, where the response is linear [W/cm2]."""
    sky_variance: F64
    """Variance of a pixel without light [W2/cm4], one number as an array without axes."""
    shot_w_cm2: float
    """Variance over light: the irradiance of one electron, 0 where there is no shot noise [W/cm2]."""
    is_full: npt.NDArray[np.bool_]
    """Whether the converter or the pixel is full."""

    def variance(self, light_w_cm2: npt.ArrayLike) -> F64:
        """Variance of pixels that hold a light [W2/cm4]."""
        return np.asarray(self.sky_variance + np.maximum(light_w_cm2, 0.0) * self.shot_w_cm2)


def irradiance_image(frames: FrameSet, frame: int, sensor: str, band: str, what: str) -> IrradianceImage:
    """Return one image as irradiance; InputError, as of `what`, if it was not rendered."""
    _, number = frames.image_numbers(what, frame, sensor, band)
    counts = frames.counts[frames.frames.index(frame)][frames.sensors.index(sensor), number]
    return irradiance_of(frames.instrument, band, counts)


def irradiance_of(instrument: Instrument, band: str, counts: npt.NDArray[Any]) -> IrradianceImage:
    """Return counts of a detector as irradiance; of any shape."""
    detector, levels = instrument.sensor.detector, instrument.levels[band]
    light = (counts.astype(np.float64) - levels.blank_counts) / levels.counts_per_nei * levels.nei_w_cm2
    variance, shot_w_cm2 = noise_variance(detector, levels)
    full_nei = levels.sei_w_cm2 / levels.nei_w_cm2
    if isinstance(detector, ElectronDetector):
        full_nei -= _FULL_SIGMA  # read noise lies on top of a full well
    most = min(2.0**detector.bits - 1.0, levels.blank_counts + levels.counts_per_nei * full_nei)
    return IrradianceImage(light, np.asarray(variance), shot_w_cm2, counts >= np.floor(most))
