"""A FITS table of HEALPix pixels as a map of the sky."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.map_units import checked_values, radiance_scales, radiance_sizes, sky_of
from warpsim.background.sky_plates import MOST_CUBE_NODES, SkyMap
from warpsim.errors import InputError, errors_at
from warpsim.radiometry.band import Band

Array = NDArray[np.float64]

PIXEL = "PIXEL"
"""Column of the numbers of pixels, in tables of some of them."""

_UNSEEN = -1e30
"""Values below are those of pixels without one: HEALPix writes -1.6375e30."""

_FRAMES = {
    "G": "galactic",
    "GALACTIC": "galactic",
    "C": "icrs",
    "CELESTIAL": "icrs",
    "EQUATORIAL": "icrs",
    "ICRS": "icrs",
    "E": "barycentricmeanecliptic",
    "ECLIPTIC": "barycentricmeanecliptic",
}

_MOST_NSIDE = (MOST_CUBE_NODES - 1) // 4
"""Of pixels whose light has nodes half as far apart; finer ones are averaged."""


def healpix_map(hdu: Any, unit: str, bands: list[Band]) -> SkyMap:
    """A map of the whole sky; nothing where it is not finite, and where a table of some pixels has none."""
    try:
        from astropy_healpix import HEALPix
    except ImportError:
        raise InputError("needs the package astropy-healpix: pip install 'warpsim[healpix]'") from None
    header, column = hdu.header, _light_column(hdu)
    frame = _keyword(header, "COORDSYS", _FRAMES)
    order = _keyword(header, "ORDERING", {"RING": "ring", "NESTED": "nested", "NEST": "nested"})
    n_side = header.get("NSIDE")
    if not isinstance(n_side, int) or n_side < 1 or n_side & (n_side - 1):
        raise _keyword_error("must be a power of 2", "NSIDE", n_side)
    healpix = HEALPix(n_side, order, frame=frame)
    with errors_at(column.name):
        scales = radiance_scales(column.unit or header.get("BUNIT", unit), bands)
        values = np.asarray(hdu.data[column.name]).ravel()
        values = np.where(values > _UNSEEN, values, np.nan) if values.dtype.kind == "f" else values
        values = checked_values(values)
        sizes = radiance_sizes(values, scales)
    values = _all_pixels(hdu, column.name, values, healpix.npix)
    healpix, values = _coarser(healpix, np.where(np.isfinite(values), values, 0.0))

    def radiance_of(direction: Array) -> Array:
        own = sky_of(direction).transform_to(frame)
        found = healpix.interpolate_bilinear_lonlat(own.spherical.lon, own.spherical.lat, values)
        return np.asarray(scales[:, None] * found)

    return SkyMap(radiance_of, 1 / healpix.nside, np.array([0.0, 0.0, 1.0]), math.pi, sizes)


def _light_column(hdu: Any) -> Any:
    """The first column that has a unit; where none has, the first that is no pixel number."""
    light = [column for column in hdu.columns if column.name.upper() != PIXEL]
    if not light:
        raise InputError("must have a column of surface brightness", "columns", hdu.columns.names)
    return next((column for column in light if column.unit), light[0])


def _keyword(header: Any, name: str, known: dict[str, str]) -> str:
    """What a keyword means."""
    given = header.get(name)
    found = known.get(str(given).strip().upper())
    if found is None:
        raise _keyword_error(f"must be one of {', '.join(known)}", name, given)
    return found


def _keyword_error(rule: str, name: str, given: Any) -> InputError:
    return InputError(f"{rule}, and is missing", name) if given is None else InputError(rule, name, given)


def _all_pixels(hdu: Any, name: str, values: Array, n_pixel: int) -> Array:
    """Values of all pixels, not finite where a table does not have them."""
    number = next((column.name for column in hdu.columns if column.name.upper() == PIXEL), None)
    if number is None:
        if str(hdu.header.get("INDXSCHM", "")).strip().upper() == "EXPLICIT":
            raise InputError(f"must have a column {PIXEL} where INDXSCHM is EXPLICIT", "columns", hdu.columns.names)
        if len(values) != n_pixel:
            raise InputError(f"must hold {n_pixel:,} HEALPix pixels for this NSIDE", name, len(values))
        return values
    pixel = np.asarray(hdu.data[number]).ravel()
    if pixel.dtype.kind not in "iu" or len(pixel) != len(values):
        raise InputError("must be a whole number for each value", number)
    if (off := (pixel < 0) | (pixel >= n_pixel)).any():
        raise InputError(f"must be from 0 to {n_pixel - 1:,} for this NSIDE", number, int(pixel[off][0]))
    if len(np.unique(pixel)) < len(pixel):
        raise InputError("must name each pixel once", number)
    found = np.full(n_pixel, np.nan)
    found[pixel] = values
    return found


def _coarser(healpix: Any, values: Array) -> tuple[Any, Array]:
    """Pixels no finer than nodes can show: means of those within larger ones."""
    from astropy_healpix import HEALPix

    if healpix.nside <= _MOST_NSIDE:
        return healpix, values
    if healpix.order == "ring":
        values = values[healpix.nested_to_ring(np.arange(healpix.npix))]
    means = values.reshape(-1, (healpix.nside // _MOST_NSIDE) ** 2).mean(axis=1)
    return HEALPix(_MOST_NSIDE, "nested", frame=healpix.frame), means
