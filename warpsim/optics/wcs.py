"""World coordinates of an image: the TAN projection of the apparent sky."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.optics.camera import Camera

if TYPE_CHECKING:
    from astropy.wcs import WCS


def tan_keywords(axes_icrs: npt.NDArray[np.float64], camera: Camera) -> dict[str, float]:
    """FITS keywords of the TAN projection for camera axes (rows x, y, z).

    The reference point is the boresight's apparent place; CD turns pixel offsets into degrees east and north there
    (Calabretta and Greisen 2002). CRPIX counts from 1, as FITS does.
    """
    x, y, z = axes_icrs
    ra, dec = np.arctan2(z[1], z[0]), np.arctan2(z[2], np.hypot(z[0], z[1]))
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    north = np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
    scale = np.degrees(1.0) / camera.focal_px
    centre_x, centre_y = camera.centre_px
    return {
        "CRVAL1": float(np.degrees(ra) % 360.0),
        "CRVAL2": float(np.degrees(dec)),
        "CRPIX1": centre_x + 1,
        "CRPIX2": centre_y + 1,
        "CD1_1": float(scale * (east @ x)),
        "CD1_2": float(scale * (east @ y)),
        "CD2_1": float(scale * (north @ x)),
        "CD2_2": float(scale * (north @ y)),
        # Said aloud, because its default is 0 instead for a boresight exactly at the north pole.
        "LONPOLE": 180.0,
    }


def wcs_from_keywords(keywords: dict[str, float]) -> WCS:
    """Astropy WCS from the numbers of tan_keywords."""
    from astropy.wcs import WCS

    wcs = WCS(naxis=2)
    wcs.wcs.ctype = ["RA---TAN", "DEC--TAN"]
    wcs.wcs.radesys = "ICRS"
    wcs.wcs.cunit = ["deg", "deg"]
    wcs.wcs.crval = [keywords["CRVAL1"], keywords["CRVAL2"]]
    wcs.wcs.crpix = [keywords["CRPIX1"], keywords["CRPIX2"]]
    wcs.wcs.cd = [[keywords["CD1_1"], keywords["CD1_2"]], [keywords["CD2_1"], keywords["CD2_2"]]]
    wcs.wcs.lonpole = keywords["LONPOLE"]
    wcs.wcs.set()
    return wcs


def tan_wcs(axes_icrs: npt.NDArray[np.float64], camera: Camera) -> WCS:
    """Astropy WCS of an image with the given camera axes."""
    return wcs_from_keywords(tan_keywords(axes_icrs, camera))
