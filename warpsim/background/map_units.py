"""Units of maps of the sky, and radiance in bands that follows from them."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

if TYPE_CHECKING:
    from astropy.coordinates import SkyCoord

Array = NDArray[np.float64]

LARGEST = float(np.finfo(np.float32).max)
"""Radiance that images hold."""

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


def checked_values(data: Any) -> Array:
    """Numbers of a map in float64, not finite where it has none.

    Raises:
        InputError: No numbers, none that is finite, or a negative one.
    """
    given = np.asarray(data)
    if given.dtype.kind not in "fiu":
        raise InputError("must hold real numbers", value=str(given.dtype), form="s")
    values = given.astype(np.float64)
    if (below := values < 0.0).any():
        first = np.unravel_index(below.argmax(), values.shape)
        where = f"pixel {first[0]}" if values.ndim == 1 else f"row {first[-2]}, column {first[-1]}"
        n_more = np.count_nonzero(below) - 1
        more = f" and {n_more:,} more" if n_more else ""
        raise InputError(f"must hold no negative values{more}; clip them at 0, got {values[first]:g} in {where}")
    if not np.isfinite(values).any():
        raise InputError("must hold a finite value, and has none")
    return values


def radiance_sizes(values: Array, scales: Array) -> Array:
    """Median and largest radiance of a map's finite pixels in each band [W/cm2/sr], (n_band, 2).

    Raises:
        InputError: Images cannot hold it.
    """
    known = values[np.isfinite(values)]
    sizes = np.outer(scales, [np.median(known), known.max()])
    if sizes.max() > LARGEST:
        raise InputError(
            f"must hold radiances up to {LARGEST:.2g} W/cm2/sr, those of float32", value=float(sizes.max())
        )
    return sizes


def sky_of(direction: Array) -> SkyCoord:
    """Unit vectors as coordinates."""
    from astropy.coordinates import SkyCoord

    longitude = np.arctan2(direction[:, 1], direction[:, 0])
    return SkyCoord(longitude, np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)), unit="rad", frame="icrs")
