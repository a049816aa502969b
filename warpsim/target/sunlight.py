"""Sunlight in a band."""

from __future__ import annotations

import functools

import numpy as np

from warpsim.constants import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M
from warpsim.sky.bands import Band, as_band, band_radiance_w_m2_sr

SUN_TEMPERATURE_K = 5772.0
"""Nominal effective temperature of the Sun (IAU 2015 resolution B3) [K]."""


@functools.lru_cache(maxsize=64)
def _of(band: Band) -> float:
    return float(np.pi * band_radiance_w_m2_sr(SUN_TEMPERATURE_K, band) * (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2)


def sun_irradiance_w_m2(band: Band | str) -> float:
    """In-band irradiance of the Sun at 1 au [W/m2]: a blackbody of its effective temperature and nominal radius.

    Raises:
        InputError: There is no band of that name.
    """
    return _of(as_band(band))
