"""The user's map of the sky's surface brightness, a FITS image with WCS or HEALPix pixels, as plates."""

from __future__ import annotations

import importlib
import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.sky_plates import RadianceOf, SkyPlate, sky_cube, sky_plate
from warpsim.config.fields import FUNCTION
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.radiometry.band import Band

if TYPE_CHECKING:
    from astropy.coordinates import SkyCoord

Array = NDArray[np.float64]

MOST_NODES = 4096
"""Nodes along an edge of a plate: 64 MiB of float32 a band."""

WIDEST_DEG = 140.0
"""Of an image on one plate."""

_MJY_SR_W_M2_SR_HZ = 1e-20


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
    from astropy.io import fits

    if path.startswith(FUNCTION):
        return _function_plates(path, bands)
    if not Path(path).is_file():
        raise InputError("must be a file that exists", "background.sky_map", path)
    try:
        with fits.open(path) as hdus:
            for hdu in hdus:
                if hdu.header.get("PIXTYPE") == "HEALPIX":
                    return _healpix_plates(hdu, bands)
                if hdu.is_image and hdu.header.get("NAXIS", 0) >= 2 and hdu.data is not None:
                    return [_image_plate(hdu, bands)]
    except InputError as error:
        raise error.of(path) from None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}", "background.sky_map", path) from None
    raise InputError("must hold an image, or a table of HEALPix pixels", "background.sky_map", path)


FUNCTION_NODES = 181
"""Nodes along an edge of the cube that a function is looked up on: 0.6 degrees apart."""


def _function_plates(name: str, bands: list[Band]) -> list[SkyPlate]:
    """The faces of a cube, filled by a function of the user's."""
    try:
        module, attribute = name.removeprefix(FUNCTION).split(":")
        function: Any = importlib.import_module(module)
        for part in attribute.split("."):
            function = getattr(function, part)
    except (ImportError, AttributeError) as error:
        raise InputError(f"cannot be imported ({error})", "background.sky_map", name) from None

    def radiance_of(direction: Array) -> Array:
        found = []
        for band in bands:
            values = np.asarray(function(direction, band), dtype=np.float64)
            if values.shape != (len(direction),) or not np.isfinite(values).all() or (values < 0.0).any():
                rule = f"must return {len(direction):,} radiances of 0 or more for as many directions, got shape"
                raise InputError(f"{rule} {values.shape}", "background.sky_map", name)
            found.append(values)
        return np.stack(found)

    return sky_cube(radiance_of, FUNCTION_NODES)


def radiance_scales(unit: str, bands: list[Band]) -> Array:
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


def _image_plate(hdu: Any, bands: list[Band]) -> SkyPlate:
    """A plate about the middle of an image, with nodes as close as its pixels."""
    from astropy.wcs import WCS
    from scipy.ndimage import map_coordinates

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        wcs = WCS(hdu.header).celestial
    if not wcs.has_celestial:
        raise InputError("an image must have a celestial WCS", "CTYPE1", hdu.header.get("CTYPE1", ""))
    image = np.asarray(hdu.data, dtype=np.float64)
    image = np.nan_to_num(image.reshape(-1, *image.shape[-2:])[0], nan=0.0, posinf=0.0, neginf=0.0)
    scales = radiance_scales(hdu.header.get("BUNIT", ""), bands)
    n_row, n_col = image.shape
    edge = np.array([[-0.5, -0.5], [n_col - 0.5, -0.5], [-0.5, n_row - 0.5], [n_col - 0.5, n_row - 0.5]])
    middle = np.array([[(n_col - 1) / 2, (n_row - 1) / 2]])
    points = wcs.pixel_to_world(*np.concatenate([middle, edge]).T).icrs.cartesian.xyz.value.T
    centre, corners = points[0], points[1:]
    half_width = math.tan(min(float(np.arccos(np.clip(corners @ centre, -1, 1)).max()), math.radians(WIDEST_DEG / 2)))
    pixel_rad = float(np.sqrt(np.abs(np.linalg.det(wcs.pixel_scale_matrix)))) * math.pi / 180
    n_side = int(np.clip(math.ceil(2 * half_width / pixel_rad) + 1, 2, MOST_NODES))

    def radiance_of(direction: Array) -> Array:
        x, y = wcs.world_to_pixel(_sky_of(direction))
        near = (x > -0.5) & (x < n_col - 0.5) & (y > -0.5) & (y < n_row - 0.5)
        values = np.zeros(len(direction))
        values[near] = map_coordinates(image, [y[near], x[near]], order=1, mode="nearest")
        return np.asarray(scales[:, None] * values)

    return sky_plate(radiance_of, _axes_about(centre), half_width, n_side)


def _sky_of(direction: Array) -> SkyCoord:
    """Unit vectors as coordinates."""
    from astropy.coordinates import SkyCoord

    longitude = np.arctan2(direction[:, 1], direction[:, 0])
    return SkyCoord(longitude, np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)), unit="rad", frame="icrs")


def _axes_about(centre: Array) -> Array:
    """Rows x (east), y (north), centre."""
    east = np.cross([0.0, 0.0, 1.0], centre)
    east = east if np.linalg.norm(east) > 1e-6 else np.array([1.0, 0.0, 0.0])
    east /= np.linalg.norm(east)
    return np.array([east, np.cross(centre, east), centre])


def _healpix_plates(hdu: Any, bands: list[Band]) -> list[SkyPlate]:
    """The faces of a cube with nodes half as far apart as HEALPix pixels."""
    try:
        from astropy_healpix import HEALPix
    except ImportError:
        raise InputError("needs the package astropy-healpix: pip install 'warpsim[healpix]'", "sky_map") from None
    header, column = hdu.header, hdu.columns[0].name
    values = np.asarray(hdu.data[column], dtype=np.float64).ravel()
    frame = {"G": "galactic", "C": "icrs", "E": "barycentricmeanecliptic"}.get(str(header.get("COORDSYS", "C"))[:1])
    healpix = HEALPix(int(header["NSIDE"]), str(header.get("ORDERING", "RING")).strip().lower(), frame=frame)
    if healpix.npix != len(values):
        raise InputError(f"must hold {healpix.npix} HEALPix pixels for NSIDE = {healpix.nside}", column, len(values))
    values = np.where(np.isfinite(values) & (values > -1e30), values, 0.0)
    scales = radiance_scales(hdu.columns[0].unit or header.get("BUNIT", ""), bands)

    def radiance_of(direction: Array) -> Array:
        own = _sky_of(direction).transform_to(frame)
        found = healpix.interpolate_bilinear_lonlat(own.spherical.lon, own.spherical.lat, values)
        return np.asarray(scales[:, None] * found)

    both: RadianceOf = radiance_of
    return sky_cube(both, int(np.clip(4 * healpix.nside + 1, 9, MOST_NODES)))
