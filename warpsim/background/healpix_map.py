"""A FITS table of HEALPix pixels as a map of the sky."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.map_units import radiance_scales, sky_of
from warpsim.background.sky_plates import MOST_CUBE_NODES, SkyMap
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

Array = NDArray[np.float64]

_MOST_NSIDE = (MOST_CUBE_NODES - 1) // 4
"""Of pixels whose light has nodes half as far apart; finer ones are averaged."""


def healpix_map(hdu: Any, bands: list[Band]) -> SkyMap:
    """A map of the whole sky; nothing where it is not finite."""
    try:
        from astropy_healpix import HEALPix
    except ImportError:
        raise InputError("needs the package astropy-healpix: pip install 'warpsim[healpix]'") from None
    header, column = hdu.header, hdu.columns[0].name
    values = np.asarray(hdu.data[column], dtype=np.float64).ravel()
    frame = {"G": "galactic", "C": "icrs", "E": "barycentricmeanecliptic"}.get(str(header.get("COORDSYS", "C"))[:1])
    healpix = HEALPix(int(header["NSIDE"]), str(header.get("ORDERING", "RING")).strip().lower(), frame=frame)
    if healpix.npix != len(values):
        raise InputError(f"must hold {healpix.npix} HEALPix pixels for NSIDE = {healpix.nside}", column, len(values))
    known = np.isfinite(values) & (values > -1e30)
    scales = radiance_scales(hdu.columns[0].unit or header.get("BUNIT", ""), bands)
    some = values[known] if known.any() else np.zeros(1)
    size = np.outer(scales, [np.median(some), some.max()])
    healpix, values = _coarser(healpix, np.where(known, values, 0.0))

    def radiance_of(direction: Array) -> Array:
        own = sky_of(direction).transform_to(frame)
        found = healpix.interpolate_bilinear_lonlat(own.spherical.lon, own.spherical.lat, values)
        return np.asarray(scales[:, None] * found)

    return SkyMap(radiance_of, 1 / healpix.nside, np.array([0.0, 0.0, 1.0]), math.pi, size)


def _coarser(healpix: Any, values: Array) -> tuple[Any, Array]:
    """Pixels no finer than nodes can show: means of those within larger ones, if NSIDE is a power of 2."""
    from astropy_healpix import HEALPix

    if healpix.nside <= _MOST_NSIDE or healpix.nside & (healpix.nside - 1):
        return healpix, values
    if healpix.order == "ring":
        values = values[healpix.nested_to_ring(np.arange(healpix.npix))]
    means = values.reshape(-1, (healpix.nside // _MOST_NSIDE) ** 2).mean(axis=1)
    return HEALPix(_MOST_NSIDE, "nested", frame=healpix.frame), means
