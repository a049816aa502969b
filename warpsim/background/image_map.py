"""A FITS image with a celestial WCS as a map of the sky."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.map_units import checked_values, radiance_scales, radiance_sizes, sky_of
from warpsim.background.sky_plates import SkyMap, node_step_rad
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

Array = NDArray[np.float64]

_POINTS = 65
"""Along each axis of an image, whose directions say how far it reaches."""

_CYLINDRICAL = ("CAR", "CEA", "CYP", "MER")
"""Projections whose columns may be those of another turn."""

_EDGE_PX = 0.5 + 1e-6
"""From the centre of a pixel to its edge, with the rounding of directions."""


def celestial_wcs(hdu: Any, hdus: Any) -> Any:
    """The celestial WCS of an image; None where it has none."""
    from astropy.wcs import WCS

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = WCS(hdu.header, hdus)
        wcs = whole.celestial
    if not wcs.has_celestial:
        return None
    if {whole.wcs.lng, whole.wcs.lat} != {0, 1} or any(n != 1 for n in hdu.shape[:-2]):
        rule = (
            "an image must be one plane of longitude and latitude; write the plane that is meant to a file of its own"
        )
        raise InputError(rule, "NAXIS", hdu.shape)
    wcs.wcs.bounds_check(False, True)  # columns beyond half a turn are on the sky too
    return wcs


def image_map(hdu: Any, wcs: Any, unit: str, bands: list[Band]) -> SkyMap:
    """A map of an image; nothing outside it, and where it is not finite."""
    from astropy.wcs.utils import proj_plane_pixel_scales

    image = checked_values(hdu.data.reshape(hdu.shape[-2:]))
    scales = radiance_scales(unit, bands)
    sizes = radiance_sizes(image, scales)
    centre, half_angle_rad = _extent(wcs, *image.shape)
    pixel_rad = math.radians(float(np.min(proj_plane_pixel_scales(wcs))))
    own = _lookup(image, wcs, math.ceil(node_step_rad(pixel_rad, half_angle_rad) / pixel_rad - 0.01))

    def radiance_of(direction: Array) -> Array:
        return np.asarray(scales[:, None] * own(direction))

    return SkyMap(radiance_of, pixel_rad, centre, half_angle_rad, sizes)


def _extent(wcs: Any, n_row: int, n_col: int) -> tuple[Array, float]:
    """Direction of the middle of an image, and the angle from there to its farthest point on the sky [rad]."""
    x, y = np.meshgrid(np.linspace(-0.5, n_col - 0.5, _POINTS), np.linspace(-0.5, n_row - 0.5, _POINTS))
    points = _directions(wcs, x.ravel(), y.ravel())
    on_sky = np.isfinite(points).all(axis=1)
    if not on_sky.any():
        raise InputError("no pixel of it is on the sky, by its WCS", "CRVAL1, CRPIX1")
    points = points[on_sky]
    middle = _directions(wcs, np.array([(n_col - 1) / 2]), np.array([(n_row - 1) / 2]))[0]
    if not np.isfinite(middle).all():
        mean = points.mean(axis=0)
        middle = mean / np.linalg.norm(mean) if np.linalg.norm(mean) > 1e-3 else points[0]
    farthest_rad = float(np.arccos(np.clip(points @ middle, -1.0, 1.0)).max())
    return middle, farthest_rad * (1.0 if on_sky.all() else 1 + 4 / _POINTS)  # its edge lies between points


def _directions(wcs: Any, x: Array, y: Array) -> Array:
    """Unit vectors of pixels, (n, 3); not finite off the sky."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(wcs.pixel_to_world(x, y).icrs.cartesian.xyz.value.T)


def _lookup(image: Array, wcs: Any, coarse: int) -> Callable[[Array], Array]:
    """A function from directions to an image's values: bilinear between finite pixels.

    Args:
        image: Values, (n_row, n_col).
        wcs: Where they are.
        coarse: Pixels between nodes; above 1, nodes get the mean of as many pixels.
    """
    from scipy.ndimage import map_coordinates, uniform_filter

    n_row, n_col = image.shape
    finite = np.isfinite(image)
    weight = finite.astype(np.float64)
    light = np.where(finite, image, 0.0)
    if coarse > 1:
        light, weight = (uniform_filter(part, coarse, mode="nearest") for part in (light, weight))
    turns = _turns_px(wcs)

    def values_of(direction: Array) -> Array:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            x, y = wcs.world_to_pixel(sky_of(direction))
        values = np.zeros(len(direction))
        left = np.ones(len(direction), dtype=bool)
        for across, down in turns:
            u, v = x + across, y + down
            inside = (u >= -_EDGE_PX) & (u <= n_col - 1 + _EDGE_PX) & (v >= -_EDGE_PX) & (v <= n_row - 1 + _EDGE_PX)
            inside &= left
            position = [v[inside], u[inside]]
            found, known = (map_coordinates(part, position, order=1, mode="nearest") for part in (light, weight))
            values[inside] = np.divide(found, known, out=np.zeros_like(found), where=known > 1e-9)
            left &= ~inside
        return values

    return values_of


def _turns_px(wcs: Any) -> list[tuple[float, float]]:
    """Steps that lead to the same direction [px]: none, and a turn either way of a cylindrical projection."""
    turns = [(0.0, 0.0)]
    if str(wcs.wcs.ctype[0])[-3:] in _CYLINDRICAL:
        across, down = np.linalg.solve(wcs.pixel_scale_matrix, 360.0 * np.eye(2)[wcs.wcs.lng])
        turns += [(across, down), (-across, -down)]
    return turns
