"""FITS maps of the sky for tests."""

import numpy as np
from astropy.io import fits
from astropy.wcs import WCS


def image_file(
    path, projection="TAN", system="RADEC", crval=(10, 20), shape=(64, 64), pixel_deg=0.1, data=None, **header
):
    """A FITS image of ones in MJy/sr about a direction."""
    first, second = {"RADEC": ("RA--", "DEC-"), "GAL": ("GLON", "GLAT")}[system]
    wcs = WCS(naxis=2)
    wcs.wcs.ctype = [f"{first}-{projection}", f"{second}-{projection}"]
    wcs.wcs.crval, wcs.wcs.cdelt = list(crval), [-pixel_deg, pixel_deg]
    wcs.wcs.crpix = [shape[1] / 2 + 0.5, shape[0] / 2 + 0.5]
    for name, value in {**wcs.to_header(), "BUNIT": "MJy/sr", **header}.items():
        header[name] = value
    fits.writeto(path, np.ones(shape) if data is None else data, fits.Header(header), overwrite=True)
    return str(path)
