"""The user's map of the sky's surface brightness, a FITS image with WCS or HEALPix pixels, as plates."""

from __future__ import annotations

from pathlib import Path

from warpsim.background.function_map import function_plates
from warpsim.background.healpix_map import healpix_map
from warpsim.background.image_map import celestial_wcs, image_map
from warpsim.background.map_units import radiance_scales, response_width_hz
from warpsim.background.sky_plates import SkyMap, SkyPlate
from warpsim.config.fields import FUNCTION
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

__all__ = ["radiance_scales", "read_sky_map", "response_width_hz", "sky_map_plates"]


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


def read_sky_map(path: str, bands: list[Band]) -> SkyMap:
    """Read the map in a FITS file.

    Raises:
        InputError: As `sky_map_plates`.
    """
    from astropy.io import fits

    if not Path(path).is_file():
        raise InputError("must be a file that exists", "background.sky_map", path)
    try:
        with fits.open(path) as hdus:
            for hdu in hdus:
                if hdu.header.get("PIXTYPE") == "HEALPIX":
                    return healpix_map(hdu, bands)
                if hdu.is_image and hdu.header.get("NAXIS", 0) >= 2 and hdu.data is not None:
                    wcs = celestial_wcs(hdu, hdus)
                    if wcs is None:
                        rule = "an image must have a celestial WCS"
                        raise InputError(rule, "CTYPE1", hdu.header.get("CTYPE1", ""))
                    return image_map(hdu, hdus, wcs, bands)
    except InputError as error:
        raise error.of(path) from None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}", "background.sky_map", path) from None
    raise InputError("must hold an image, or a table of HEALPix pixels", "background.sky_map", path)
