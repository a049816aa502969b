"""The user's map of the sky's surface brightness, a FITS image with WCS or HEALPix pixels, as plates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.function_map import function_plates
from warpsim.background.healpix_map import healpix_map
from warpsim.background.image_map import celestial_wcs, image_map
from warpsim.background.map_units import radiance_scales, response_width_hz
from warpsim.background.sky_plates import SkyMap, SkyPlate
from warpsim.config.fields import FUNCTION
from warpsim.errors import InputError, one_line
from warpsim.radiometry.band import Band
from warpsim.tables.checked_files import is_image, open_fits

__all__ = ["radiance_scales", "response_width_hz", "sky_map_plates", "sky_map_sizes"]

Array = NDArray[np.float64]


def sky_map_plates(path: str, bands: list[Band]) -> list[SkyPlate]:
    """Read a map and return the plates that hold it.

    A spectral radiance (MJy/sr, say) is taken to be the same at all frequencies of a band; a radiance (W/m2/sr, say) is
    that in every band. Pixels that are not finite are 0. Outside an image the map is 0.

    Args:
        path: FITS file: an image with a celestial WCS, or a table of HEALPix pixels, with BUNIT or TUNIT; or the name
            of a function.
        bands: Bands to render.

    Raises:
        InputError: No such file, no map in it, no unit or one that is no surface brightness.
    """
    if path.startswith(FUNCTION):
        return function_plates(path, bands)
    return read_sky_map(path, bands).plates()


def sky_map_sizes(path: str, bands: list[Band]) -> Array:
    """Return the median and the largest radiance of a map in each band [W/cm2/sr], (n_band, 2), over its finite pixels.

    Those of a function are over its nodes.

    Raises:
        InputError: As `sky_map_plates`.
    """
    if not path.startswith(FUNCTION):
        return read_sky_map(path, bands).size_w_cm2_sr
    light = np.concatenate(
        [plate.radiance_w_cm2_sr.reshape(len(bands), -1) for plate in function_plates(path, bands)], 1
    )
    return np.stack([np.median(light, axis=1), light.max(axis=1)], axis=1)


def read_sky_map(path: str, bands: list[Band]) -> SkyMap:
    """Read the map in a FITS file.

    Raises:
        InputError: As `sky_map_plates`.
    """
    field = "background.sky_map"
    if not Path(path).is_file():
        raise InputError("must be a file that exists", field, path)
    try:
        with open_fits(path) as hdus:
            return _map_in(hdus, bands)
    except InputError as error:
        raise error.of(path).within(field) from None
    except Exception as error:  # astropy raises many kinds for a broken file
        raise InputError(f"cannot be read ({one_line(error)})").of(path).within(field) from None


def _map_in(hdus: Any, bands: list[Band]) -> SkyMap:
    """The first map in a file: HEALPix pixels, or an image that has a celestial WCS."""
    unit, plain = str(hdus[0].header.get("BUNIT", "")), None
    for hdu in hdus:
        if str(hdu.header.get("PIXTYPE", "")).strip().upper() == "HEALPIX":
            return healpix_map(hdu, unit, bands)
        if is_image(hdu) and len(hdu.shape) >= 2 and 0 not in hdu.shape:
            if (wcs := celestial_wcs(hdu, hdus)) is not None:
                return image_map(hdu, wcs, str(hdu.header.get("BUNIT", unit)), bands)
            plain = hdu if plain is None else plain
    if plain is not None:
        raise InputError("an image must have a celestial WCS", "CTYPE1", plain.header.get("CTYPE1", ""))
    raise InputError("must hold an image with a celestial WCS, or a table of HEALPix pixels")
