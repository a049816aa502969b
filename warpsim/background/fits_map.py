"""A FITS map of the sky: an image with a celestial WCS or a table of HEALPix pixels, and radiance by its unit."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.arrays import F64
from warpsim.background.sky_plates import MOST_CUBE_NODES, SkyMap, node_step_rad
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError, errors_at
from warpsim.radiometry.band import Band

if TYPE_CHECKING:
    from astropy.coordinates import SkyCoord


LARGEST = float(np.finfo(np.float32).max)
"""Radiance that images hold."""

_MJY_SR_W_M2_SR_HZ = 1e-20


def radiance_scales(unit: str, bands: list[Band]) -> F64:
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


def checked_values(data: Any) -> F64:
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


def radiance_sizes(values: F64, scales: F64) -> F64:
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


def sky_of(direction: F64) -> SkyCoord:
    """Unit vectors as coordinates."""
    from astropy.coordinates import SkyCoord

    longitude = np.arctan2(direction[:, 1], direction[:, 0])
    return SkyCoord(longitude, np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)), unit="rad", frame="icrs")


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
        values = checked_values(np.where(values > _UNSEEN, values, np.nan) if values.dtype.kind == "f" else values)
        sizes = radiance_sizes(values, scales)
    values = _all_pixels(hdu, column.name, values, healpix.npix)
    healpix, values = _coarser(healpix, np.where(np.isfinite(values), values, 0.0))

    def radiance_of(direction: F64) -> F64:
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


def _all_pixels(hdu: Any, name: str, values: F64, n_pixel: int) -> F64:
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


def _coarser(healpix: Any, values: F64) -> tuple[Any, F64]:
    """Pixels no finer than nodes can show: means of those within larger ones."""
    from astropy_healpix import HEALPix

    if healpix.nside <= _MOST_NSIDE:
        return healpix, values
    if healpix.order == "ring":
        values = values[healpix.nested_to_ring(np.arange(healpix.npix))]
    means = values.reshape(-1, (healpix.nside // _MOST_NSIDE) ** 2).mean(axis=1)
    return HEALPix(_MOST_NSIDE, "nested", frame=healpix.frame), means


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

    def radiance_of(direction: F64) -> F64:
        return np.asarray(scales[:, None] * own(direction))

    return SkyMap(radiance_of, pixel_rad, centre, half_angle_rad, sizes)


def _extent(wcs: Any, n_row: int, n_col: int) -> tuple[F64, float]:
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


def _directions(wcs: Any, x: F64, y: F64) -> F64:
    """Unit vectors of pixels, (n, 3); not finite off the sky."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(wcs.pixel_to_world(x, y).icrs.cartesian.xyz.value.T)


def _lookup(image: F64, wcs: Any, coarse: int) -> Callable[[F64], F64]:
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

    def values_of(direction: F64) -> F64:
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
