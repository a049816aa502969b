"""Counts as irradiance, and their likelihood under a detector's noise, with its gradient."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.detector.detectors import ElectronDetector
from warpsim.detector.levels import ElectronLevels, noise_variance
from warpsim.errors import InputError
from warpsim.render.frameset import FrameSet
from warpsim.render.gradients import checked_parameters, gradients
from warpsim.render.resolution import full_w_cm2
from warpsim.scene.instrument import Instrument

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


@dataclass(frozen=True)
class LogLikelihood:
    """Logarithm of the probability density of counts, given what frames show."""

    value: float
    """Of all images."""
    images: F64
    """Of each image, (frame, sensor, band)."""
    n_pixel: npt.NDArray[np.int64]
    """Pixels that count, (frame, sensor, band)."""
    cotangent: F64
    """Derivatives by the noiseless pixels, (frame, sensor, band, row, column) [cm2/W]."""
    gradient: dict[str, F64]
    """By parameters, as `gradients` has them."""


def log_likelihood(
    frames: FrameSet, counts: npt.ArrayLike, wrt: str | Sequence[str] = ("x_px", "y_px", "irradiance_w_cm2")
) -> LogLikelihood:
    """Return the likelihood of counts, if what frames show were the truth, and its gradient.

    Pixels are independent and normal about the noiseless signal as the detector reads it, its non-linearity included.
    The variance is that of `noise_variance`: read noise, dark current, background and rounding, and with shot noise
    the light's own, whose change is part of the gradient: Poisson and Gaussian noise together, good from some ten
    electrons on. Left out: pixels that are full, in the counts or in the signal; gains and offsets of pixels and
    columns, bad pixels, hits and flicker, which counts must be rid of.

    Args:
        frames: The model: frames rendered with keep_signal=True.
        counts: Counts of the same images, shape (frame, sensor, band, row, column).
        wrt: Parameters, as in `gradients`; none: only the value.

    Raises:
        InputError: As in `gradients`; frames without signal, counts of another shape.
    """
    names = checked_parameters(wrt) if len(wrt) else []
    if frames.signal_w_cm2 is None:
        raise InputError("render with keep_signal=True", "log_likelihood")
    observed = np.asarray(counts)
    if observed.shape != frames.counts.shape or observed.dtype.kind not in "uif":
        raise InputError(f"must be numbers of shape {frames.counts.shape}", "counts", observed.shape)
    signal = frames.signal_w_cm2.numpy()
    images, n_pixel = np.zeros(signal.shape[:3]), np.zeros(signal.shape[:3], dtype=np.int64)
    cotangent = np.zeros(signal.shape)
    for number, band in enumerate(frames.bands):
        own = np.s_[:, :, number]
        density, slope, is_used = pixel_likelihood(frames.instrument, band, observed[own], signal[own])
        images[own], n_pixel[own] = density.sum(axis=(2, 3)), is_used.sum(axis=(2, 3))
        cotangent[own] = slope
    found = gradients(frames, cotangent, names) if names else {}
    return LogLikelihood(float(images.sum()), images, n_pixel, cotangent, found)


def pixel_likelihood(
    instrument: Instrument, band: str, counts: npt.NDArray[Any], signal_w_cm2: npt.NDArray[Any]
) -> tuple[F64, F64, npt.NDArray[np.bool_]]:
    """Return the log density of each pixel's counts, its derivative by the signal, and which count; 0 for others."""
    levels = instrument.levels[band]
    found = irradiance_of(instrument, band, counts)
    light = signal_w_cm2.astype(np.float64)
    is_used = ~found.is_full & (light < full_w_cm2(instrument, band)) & np.isfinite(found.light_w_cm2)
    read, slope = read_light(instrument, band, light)
    variance, by_light = found.variance(light), np.where(light > 0.0, found.shot_w_cm2, 0.0)
    off = found.light_w_cm2 - read
    counts_per_light = levels.counts_per_nei / levels.nei_w_cm2
    density = -0.5 * (off * off / variance + np.log(2.0 * math.pi * variance * counts_per_light**2))
    derivative = off * slope / variance + 0.5 * by_light * (off * off / variance - 1.0) / variance
    return np.where(is_used, density, 0.0), np.where(is_used, derivative, 0.0), is_used


def read_light(instrument: Instrument, band: str, light_w_cm2: F64) -> tuple[F64, F64]:
    """Return the light that counts of a linear response would say, and its derivative by the light [W/cm2]."""
    detector, levels = instrument.sensor.detector, instrument.levels[band]
    if isinstance(detector, ElectronDetector) and isinstance(levels, ElectronLevels):
        blank_e, loss_per_e = levels.background_e + levels.dark_e, detector.nonlinearity / detector.full_well_e
        blank_slope = 1.0 - 2.0 * loss_per_e * blank_e
        more_e = light_w_cm2 * levels.e_per_w_cm2
        read = light_w_cm2 * (blank_slope - loss_per_e * more_e) / blank_slope
        return read, (blank_slope - 2.0 * loss_per_e * more_e) / blank_slope
    lost = detector.nonlinearity * light_w_cm2 / levels.sei_w_cm2
    return light_w_cm2 * (1.0 - lost), 1.0 - 2.0 * lost
