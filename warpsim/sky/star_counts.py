"""Numbers of stars by magnitude, or by in-band irradiance where a band has no zero point."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.sky.catalog import StarCatalog

Array = NDArray[np.float64]
Counts = tuple[NDArray[np.int64], NDArray[np.int64]]

# A magnitude of 3 exactly belongs to 3, and 1e-16 W/cm2 to its own decade, whatever the rounding of a flux.
_ROUNDING = 1e-9

_FINEST_DEX = 0.05
"""Narrowest bins of irradiance in which counts of stars are compared."""


def has_zero_point(band: Band | str) -> bool:
    """Whether stars have magnitudes in a band.

    Raises:
        InputError: The band is unknown.
    """
    return bool(as_band(band).zero_mag_w_cm2 > 0.0)


def magnitude_counts(catalog: StarCatalog, band: Band | str) -> Counts:
    """Return whole magnitudes without gaps, and the number of stars from each to below the next.

    Stars without light in the band are not counted.

    Args:
        catalog: The stars.
        band: A band with a zero point, or the name of one.

    Raises:
        InputError: The band is unknown or has no zero point.
    """
    return _counts(catalog.magnitude(band))


def irradiance_counts(catalog: StarCatalog, band: Band | str) -> Counts:
    """Return whole decades of in-band irradiance without gaps, and the number of stars in each.

    Decade k holds the stars from 10^k to below 10^(k+1) W/cm2; stars without light in the band are not counted.

    Args:
        catalog: The stars.
        band: A band, or the name of one.

    Raises:
        InputError: The band is unknown, or beyond the wavelengths at which the light of stars is known.
    """
    with np.errstate(divide="ignore"):
        return _counts(np.log10(catalog.irradiance_w_cm2(band)))


def complete_to(irradiance: Array) -> float:
    """Return the irradiance down to which stars are complete: that of the faintest in the fullest bin of its logarithm.

    Stars become ever more numerous as they fade; where a catalog's do not, it misses some. Bins follow Freedman and
    Diaconis (1981), and are no narrower than 0.05 dex.

    Args:
        irradiance: Of the stars, in any unit, shape (n,); those of 0 are not counted.

    Returns:
        NaN where no star has light.
    """
    light = irradiance[irradiance > 0.0]
    if not light.size:
        return math.nan
    dex = np.log10(light)
    quartile = np.percentile(dex, [25.0, 75.0])
    width = max(_FINEST_DEX, 2.0 * float(quartile[1] - quartile[0]) / len(dex) ** (1 / 3))
    number = np.floor(dex / width + _ROUNDING)
    bins, counts = np.unique(number, return_counts=True)
    return float(light[number == bins[np.argmax(counts)]].min())


def _counts(values: Array) -> Counts:
    whole = np.floor(values[np.isfinite(values)] + _ROUNDING).astype(np.int64)
    if not len(whole):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    return np.arange(whole.min(), whole.max() + 1), np.bincount(whole - whole.min())
