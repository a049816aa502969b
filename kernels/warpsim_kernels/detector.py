"""A detector as its kernels see it: which steps are on, the numbers of its pixels, and the steps themselves.

Steps are small branch-free functions of scalars: `wp.tile_map` over each becomes vector instructions on the CPU; a
read-out puts those together that a scene needs. Struct fields are handed over as scalars, because with a struct the CPU
compiler does not vectorise.
"""

from typing import NamedTuple

import warp as wp

from warpsim_kernels.random_numbers import fma


class ReadOutFeatures(NamedTuple):
    """Features of a read-out kernel."""

    electrons: bool = False  # in electrons, else in NEI terms
    bad_pixels: bool = False
    prnu: bool = False
    dsnu: bool = False
    column_noise: bool = False
    nonlinearity: bool = False
    shot_noise: bool = False  # electrons only, like those below
    small_means: bool = False  # a pixel's mean may be too small for the expansion of the Poisson distribution
    read_noise: bool = False
    maps: bool = False  # of the user's, in the place of random gains, offsets and bad pixels

    @property
    def pattern(self) -> bool:
        """Return whether any property stays with a pixel from frame to frame."""
        return self.bad_pixels or self.prnu or self.dsnu


@wp.struct
class PixelScalars:
    """A detector's pixels in one band. Levels are irradiances [W/cm2] in NEI terms, else electrons."""

    # both
    zero_counts: float  # of no level, and half a count more, for rounding
    most_counts: float  # of the converter, or of saturation where that is less
    prnu: float  # rms of gains
    dsnu: float  # rms of offsets [W/cm2], or of dark currents as a fraction of their mean
    column_noise: float  # rms, a level
    full_level: float  # SEI or full well: where a pixel saturates
    loss_per_level: float  # of the response, relative to a linear one
    most: float  # level of hot pixels and of the brightest light, beyond saturation
    dead_below: wp.uint32  # random words of dead pixels
    hot_below: wp.uint32  # complements of random words of hot pixels
    # in NEI terms
    counts_per_w_cm2: float
    counts_per_nei: float
    # in electrons
    e_per_w_cm2: float
    background_e: float
    dark_e: float
    read_noise_e: float
    counts_per_e: float


@wp.struct
class PixelMaps:
    """The user's maps in the place of random numbers, whole strips long; planes by sensor and band."""

    gain: wp.array[float]  # (n_plane * stride,) deviates that scale 1 to a gain
    offset: wp.array[float]  # alike, to an offset or a dark current
    bad: wp.array[wp.uint32]  # random words of pixels that are dead, hot, or neither
    stride: int  # of a plane
    by_sensor: int  # 1 where sensors have planes of their own, else 0


@wp.struct
class Detector:
    """A detector's arrays."""

    pixels: wp.array[PixelScalars]  # (n_band,)
    keys: wp.array[wp.vec2ui]  # (n_sensor,) of all noise: each sensor has its own
    n_pixel: int  # of an image
    n_col: int


@wp.struct
class MappedDetector:
    """A detector's arrays and maps: a struct of its own, since a larger one costs kernels without maps a fourteenth."""

    pixels: wp.array[PixelScalars]  # as of Detector
    keys: wp.array[wp.vec2ui]
    n_pixel: int
    n_col: int
    maps: PixelMaps


def detector_struct(features: ReadOutFeatures) -> type:
    """Return the struct that a read-out with some features takes."""
    return MappedDetector if features.maps else Detector


@wp.func
def without_dead(light: float, word: wp.uint32, dead_below: wp.uint32) -> float:
    """Light of a pixel; none in a dead one."""
    return wp.where(word < dead_below, 0.0, light)


@wp.func
def with_hot(level: float, word: wp.uint32, hot_below: wp.uint32, most: float) -> float:
    """Level of a pixel; the most there is in a hot one. Dead and hot pixels are taken from the two ends of the word."""
    return wp.where(~word < hot_below, most, level)


@wp.func
def scaled(light: float, deviate: float, rms: float) -> float:
    """Light times a gain about 1."""
    return light * fma(rms, deviate, 1.0)


@wp.func
def shifted(level: float, deviate: float, rms: float) -> float:
    """Level plus an offset about 0."""
    return fma(rms, deviate, level)


@wp.func
def bent(level: float, most: float, loss_per_level: float) -> float:
    """A response that falls short of linear by the fraction level * loss_per_level; the level is at most `most`."""
    clipped_level = wp.min(level, most)
    return clipped_level * (1.0 - clipped_level * loss_per_level)


@wp.func
def counts_of(
    level: float, deviate: float, counts_per_level: float, counts_rms: float, zero_counts: float, most_counts: float
) -> wp.uint16:
    """Counts of a level with noise of counts_rms; zero_counts, those of no level, carry half a count for rounding."""
    counts = fma(level, counts_per_level, fma(deviate, counts_rms, zero_counts))
    return wp.uint16(wp.int32(wp.max(wp.min(counts, most_counts), 0.0)))


@wp.func
def photo_electrons(signal_w_cm2: float, e_per_w_cm2: float, background_e: float, most_e: float) -> float:
    """Mean electrons by light, from the sources and the background, 0 to most_e; what is not a number is the most."""
    return wp.max(wp.min(fma(signal_w_cm2, e_per_w_cm2, background_e), most_e), 0.0)


@wp.func
def with_dark(electrons: float, dark_e: float) -> float:
    """Mean electrons with those of the dark current."""
    return electrons + dark_e


@wp.func
def with_uneven_dark(electrons: float, deviate: float, dark_e: float, rms: float) -> float:
    """Mean electrons of a pixel whose dark current differs from the mean by a fraction; it is never negative."""
    return fma(dark_e, wp.max(fma(rms, deviate, 1.0), 0.0), electrons)


@wp.func
def clipped(electrons: float, full_well_e: float) -> float:
    """Electrons that a pixel's well keeps."""
    return wp.min(electrons, full_well_e)


@wp.func
def counts_of_charge(charge_e: float, counts_per_e: float, zero_counts: float, most_counts: float) -> wp.uint16:
    """Counts of the charge that is read, its noise included."""
    return wp.uint16(wp.int32(wp.max(wp.min(fma(charge_e, counts_per_e, zero_counts), most_counts), 0.0)))
