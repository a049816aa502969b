"""World coordinates of an image: the TAN projection of the apparent sky, with SIP polynomials behind a lens.

SIP (Shupe et al. 2005): on the image u, v count pixels from the boresight. A and B lead from there to the pinhole's
pixels, where CD goes on to the sky: u + A(u, v), v + B(u, v); AP and BP lead back. The lens' formula leads from the
pinhole to the image, so AP and BP are exact, and A and B are fitted.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.optics.camera import Camera
from warpsim.optics.distortion import Distortion

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
    wcs.wcs.radesys, wcs.wcs.cunit, wcs.wcs.lonpole = "ICRS", ["deg", "deg"], tan["LONPOLE"]
    wcs.wcs.crval, wcs.wcs.crpix = ([tan[f"{name}{axis}"] for axis in (1, 2)] for name in ("CRVAL", "CRPIX"))
    wcs.wcs.cd = [[tan[f"CD{row}_{column}"] for column in (1, 2)] for row in (1, 2)]
    if "A_ORDER" in lens:
        tables = []
        for name in ("A", "B", "AP", "BP"):
            n = int(lens[f"{name}_ORDER"]) + 1
            tables.append(np.array([[float(lens.get(f"{name}_{p}_{q}", 0.0)) for q in range(n)] for p in range(n)]))
        wcs.sip = Sip(*tables, wcs.wcs.crpix)
    wcs.wcs.set()
    return wcs


def tan_wcs(axes_icrs: npt.NDArray[np.float64], camera: Camera) -> WCS:
    """Astropy WCS of an image with the given camera axes."""
    return wcs_from_keywords(tan_keywords(axes_icrs, camera), lens_keywords(camera))


ERROR_PX = 1e-6
"""The order is the lowest that reaches this."""
LARGEST_ORDER = 9
"""Largest order in the SIP convention."""

_BEYOND = 1.02
"""The fit takes in so much more than the array."""
_N_NODE, _N_CHECK = 41, 61


@dataclass(frozen=True)
class SipPolynomials:
    """Coefficients by the powers of u and v, shape (order + 1, order + 1) each."""

    a: F64
    b: F64
    ap: F64
    bp: F64
    error_px: float
    """Largest distance on the array between what A, B say and the camera [px]."""
    moved_px: float
    """Largest distance on the array that the distortion moves a position [px]."""

    def keywords(self) -> dict[str, float]:
        """FITS keywords: orders, coefficients that are not 0, and SIPERR, the error [px]."""
        cards: dict[str, float] = {}
        for name in ("a", "b", "ap", "bp"):
            table: F64 = getattr(self, name)
            cards[f"{name.upper()}_ORDER"] = len(table) - 1
            for p, q in np.argwhere(table):
                cards[f"{name.upper()}_{p}_{q}"] = float(table[p, q])
        return cards | {"SIPERR": self.error_px}


@functools.lru_cache(maxsize=16)
def sip_polynomials(camera: Camera) -> SipPolynomials | None:
    """The polynomials of a camera, None where nothing is distorted."""
    if camera.lens is None:
        return None
    half = np.array([camera.n_col, camera.n_row]) / 2
    # Chebyshev's nodes: least squares there is close to the smallest largest error.
    node = _BEYOND * np.cos(np.pi * (np.arange(_N_NODE) + 0.5) / _N_NODE)
    axes = (node, np.linspace(-1.0, 1.0, _N_CHECK))
    fit_uv, check_uv = (np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2) * half for axis in axes)
    fit_offset, check_offset = _to_pinhole_px(camera, fit_uv), _to_pinhole_px(camera, check_uv)
    moved_px = float(np.linalg.norm(check_offset, axis=1).max())
    best, error_px = np.zeros((2, 3, 3)), moved_px
    for order in range(2, LARGEST_ORDER + 1):
        table = _fitted(fit_uv / half, fit_offset, order) / _powers(half, order)
        missed = np.linalg.norm(_values(table, check_uv) - check_offset, axis=1).max()
        if missed < error_px:
            best, error_px = table, float(missed)
        if error_px < ERROR_PX:
            break
    ap, bp = _to_image_px(camera, camera.lens)
    return SipPolynomials(best[0], best[1], ap, bp, error_px, moved_px)


def _to_pinhole_px(camera: Camera, uv: F64) -> F64:
    """Difference of the pinhole's positions from those of the image [px], shape (n, 2)."""
    seen = camera.direction(uv + camera.centre_px)
    return np.asarray(seen[:, :2] / seen[:, 2:] * [camera.focal_px, camera.focal_row_px] - uv)


def _fitted(unit_uv: F64, offset: F64, order: int) -> F64:
    """Coefficients of both polynomials by least squares, shape (2, order + 1, order + 1)."""
    terms = [(p, q) for p in range(order + 1) for q in range(order + 1 - p) if p + q >= 2]  # as SIP has them
    columns = np.stack([unit_uv[:, 0] ** p * unit_uv[:, 1] ** q for p, q in terms], axis=-1)
    solved = np.linalg.lstsq(columns, offset, rcond=None)[0]
    table = np.zeros((2, order + 1, order + 1))
    for (p, q), pair in zip(terms, solved, strict=True):
        table[:, p, q] = pair
    return table


def _powers(half: F64, order: int) -> F64:
    return np.asarray(half[0] ** np.arange(order + 1)[:, None] * half[1] ** np.arange(order + 1)[None])


def _values(table: F64, uv: F64) -> F64:
    return np.stack([np.polynomial.polynomial.polyval2d(uv[:, 0], uv[:, 1], part) for part in table], axis=-1)


def _to_image_px(camera: Camera, lens: Distortion) -> tuple[F64, F64]:
    """AP and BP: the lens' formula in pixels."""
    order = 7 if lens.k3 else 5 if lens.k2 else 3 if lens.k1 else 2
    x, y = np.zeros((order + 1, order + 1)), np.zeros((order + 1, order + 1))
    for power, k in enumerate((lens.k1, lens.k2, lens.k3), start=1):
        for j in range(power + 1 if k else 0):  # k r^(2 power), r^2 = x^2 + y^2
            coefficient = k * math.comb(power, j)
            x[2 * j + 1, 2 * (power - j)] += coefficient
            y[2 * j, 2 * (power - j) + 1] += coefficient
    x[1, 1] += 2 * lens.p1
    x[2, 0] += 3 * lens.p2
    x[0, 2] += lens.p2
    y[1, 1] += 2 * lens.p2
    y[0, 2] += 3 * lens.p1
    y[2, 0] += lens.p1
    scale = _powers(np.array([camera.focal_px, camera.focal_row_px]), order)
    return x * camera.focal_px / scale, y * camera.focal_row_px / scale
