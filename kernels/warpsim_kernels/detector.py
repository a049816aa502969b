"""A detector as its kernels see it: which steps are on, and the numbers of its pixels."""

from typing import NamedTuple

import warp as wp


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
class Detector:
    """A detector's arrays."""

    pixels: wp.array[PixelScalars]  # (n_band,)
    keys: wp.array[wp.vec2ui]  # (n_sensor,) of all noise: each sensor has its own
    n_pixel: int  # of an image
    n_col: int
