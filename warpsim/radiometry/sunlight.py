"""Sunlight in a band."""

from __future__ import annotations

import numpy as np

from warpsim.constants import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M, SUN_TEMPERATURE_K
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import band_radiance_w_m2_sr


def sun_irradiance_w_m2(band: Band | str) -> float:
    """In-band irradiance of the Sun at 1 au [W/m2], that of a blackbody of 5772 K with the nominal radius.

    The temperature is that of the whole output. In the thermal infrared the Sun's brightness temperature is lower,
    about 5000 K at 10 um, so that its light there is 10 to 15 % below this.

    Args:
        band: A Band, or the name of one in BANDS.

    Raises:
        InputError: An unknown band.
    """
    fraction = (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2
    return float(np.pi * fraction * band_radiance_w_m2_sr(SUN_TEMPERATURE_K, band))
