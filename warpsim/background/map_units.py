"""Units of maps of the sky, and radiance in bands that follows from them."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

if TYPE_CHECKING:
    from astropy.coordinates import SkyCoord

Array = NDArray[np.float64]

_MJY_SR_W_M2_SR_HZ = 1e-20


def radiance_scales(unit: str, bands: list[Band]) -> Array:
    """Factors from a map's unit to radiance in each band [W/cm2/sr], (n_band,)."""
    from astropy import units

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        given = units.Unit(unit, parse_strict="silent") if unit else units.dimensionless_unscaled
    if given.is_equivalent(units.Unit("W m-2 sr-1")):
        return np.full(len(bands), given.to(units.Unit("W cm-2 sr-1")))
    if given.is_equivalent(units.Unit("MJy sr-1")):
        scale = given.to(units.Unit("MJy sr-1")) * _MJY_SR_W_M2_SR_HZ * 1e-4
        return np.array([scale * response_width_hz(band) for band in bands])
    raise InputError("its unit (BUNIT, TUNIT) must be one of surface brightness, W/m2/sr or MJy/sr", "unit", unit)


def response_width_hz(band: Band) -> float:
    """Integral of a band's energy response over frequency [Hz]."""
    node_um, weight_um = band.quadrature_um
    return float(np.sum(weight_um * SPEED_OF_LIGHT_M_S / node_um**2)) * 1e6


def sky_of(direction: Array) -> SkyCoord:
    """Unit vectors as coordinates."""
    from astropy.coordinates import SkyCoord

    longitude = np.arctan2(direction[:, 1], direction[:, 0])
    return SkyCoord(longitude, np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)), unit="rad", frame="icrs")
