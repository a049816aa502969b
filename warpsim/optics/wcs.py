"""World coordinates of an image: the TAN projection of the apparent sky, with SIP polynomials behind a lens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.optics.camera import Camera
from warpsim.optics.sip import sip_polynomials

if TYPE_CHECKING:
    from astropy.wcs import WCS


def tan_keywords(axes_icrs: npt.NDArray[np.float64], camera: Camera) -> dict[str, float]:
    """FITS keywords of the TAN projection for camera axes (rows x, y, z).

    The reference point is the boresight's apparent position; CD turns pixel offsets into degrees east and north there
    (Calabretta and Greisen 2002). CRPIX counts from 1, as FITS does.
    """
    x, y, z = axes_icrs
    ra, dec = np.arctan2(z[1], z[0]), np.arctan2(z[2], np.hypot(z[0], z[1]))
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    north = np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
    scale_x, scale_y = np.degrees(1.0) / camera.focal_px, np.degrees(1.0) / camera.focal_row_px
    centre_x, centre_y = camera.centre_px
    return {
        "CRVAL1": float(np.degrees(ra) % 360.0),
        "CRVAL2": float(np.degrees(dec)),
        "CRPIX1": centre_x + 1,
        "CRPIX2": centre_y + 1,
        "CD1_1": float(scale_x * (east @ x)),
        "CD1_2": float(scale_y * (east @ y)),
        "CD2_1": float(scale_x * (north @ x)),
        "CD2_2": float(scale_y * (north @ y)),
        # Said aloud, because its default is 0 instead for a boresight exactly at the north pole.
        "LONPOLE": 180.0,
    }


def lens_keywords(camera: Camera) -> dict[str, Any]:
    """FITS keywords that all images of a camera share: axis types, and the polynomials of a distorted camera."""
    sip = sip_polynomials(camera)
    if sip is None:
        return {"CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "RADESYS": "ICRS"}
    return {"CTYPE1": "RA---TAN-SIP", "CTYPE2": "DEC--TAN-SIP", "RADESYS": "ICRS", **sip.keywords()}


def wcs_from_keywords(tan: Mapping[str, float], lens: Mapping[str, Any]) -> WCS:
    """Astropy WCS from tan_keywords and lens_keywords, or from a header that holds the latter."""
    from astropy.wcs import WCS, Sip

    wcs = WCS(naxis=2)
    wcs.wcs.ctype = [lens["CTYPE1"], lens["CTYPE2"]]
    wcs.wcs.radesys = "ICRS"
    wcs.wcs.cunit = ["deg", "deg"]
    wcs.wcs.crval = [tan["CRVAL1"], tan["CRVAL2"]]
    wcs.wcs.crpix = [tan["CRPIX1"], tan["CRPIX2"]]
    wcs.wcs.cd = [[tan["CD1_1"], tan["CD1_2"]], [tan["CD2_1"], tan["CD2_2"]]]
    wcs.wcs.lonpole = tan["LONPOLE"]
    if "A_ORDER" in lens:
        wcs.sip = Sip(*(_table(lens, name) for name in ("A", "B", "AP", "BP")), wcs.wcs.crpix)
    wcs.wcs.set()
    return wcs


def _table(lens: Mapping[str, Any], name: str) -> npt.NDArray[np.float64]:
    order = int(lens[f"{name}_ORDER"])
    table = np.zeros((order + 1, order + 1))
    for p in range(order + 1):
        for q in range(order + 1 - p):
            table[p, q] = float(lens.get(f"{name}_{p}_{q}", 0.0))
    return table


def tan_wcs(axes_icrs: npt.NDArray[np.float64], camera: Camera) -> WCS:
    """Astropy WCS of an image with the given camera axes."""
    return wcs_from_keywords(tan_keywords(axes_icrs, camera), lens_keywords(camera))
