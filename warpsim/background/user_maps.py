"""Light of the user's own: a map of the sky, a FITS file or a function, as plates; and an image of every pixel."""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.background.fits_map import LARGEST, celestial_wcs, healpix_map, image_map
from warpsim.background.sky_plates import SkyMap, SkyPlate, sky_cube
from warpsim.config.fields import FUNCTION
from warpsim.errors import InputError, errors_at, one_line
from warpsim.radiometry.band import Band
from warpsim.tables.checked_files import is_image, npy_array, open_fits

FUNCTION_NODES = 181
"""Nodes along an edge of the cube that a function is looked up on: 0.6 degrees apart."""


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


def sky_map_sizes(path: str, bands: list[Band]) -> F64:
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


def function_plates(name: str, bands: list[Band]) -> list[SkyPlate]:
    """The faces of a cube, filled by a function of the user's.

    Raises:
        InputError: No such function, or what it does or returns is not what a map needs.
    """
    function = _imported(name)

    def radiance_of(direction: F64) -> F64:
        return np.stack([_asked(function, name, direction, band) for band in bands])

    return sky_cube(radiance_of, FUNCTION_NODES)


def function_checksum(name: str, bands: list[Band]) -> str:
    """SHA-256 of a function's radiances on its plates, as images hold them: it changes with whatever changes these."""
    found = hashlib.sha256()
    for plate in function_plates(name, bands):
        found.update(plate.radiance_w_cm2_sr.astype("<f4").tobytes())
    return found.hexdigest()


def _imported(name: str) -> Callable[..., Any]:
    module, _, attribute = name.removeprefix(FUNCTION).partition(":")
    if ":" in attribute or not all((*module.split("."), *attribute.split("."))):
        raise _error('must be of the form "python:module:function", with the whole name of a module', name)
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except (Exception, SystemExit) as error:  # a module of the user's may do anything
        raise _error(f"cannot be imported ({_said(error)})", name) from None
    if not callable(found):
        raise _error(f"must be a function, but is of type {type(found).__name__}", name)
    return found  # type: ignore[no-any-return]


def _asked(function: Callable[..., Any], name: str, direction: F64, band: Band) -> F64:
    """A function's radiances in directions, (n,)."""
    try:
        returned = function(direction.copy(), band)
        found = np.asarray(returned)
    except (Exception, SystemExit) as error:  # as above
        raise _error(f"fails in band {band.name} ({_said(error)})", name) from None
    if found.dtype.kind not in "fiu" or hasattr(returned, "unit"):
        kind = type(returned).__name__ if found.dtype.kind in "fiu" else f"{type(returned).__name__} of {found.dtype}"
        raise _error(f"must return plain numbers [W/cm2/sr], returned {kind}", name)
    if found.shape != (len(direction),):
        rule = f"must return {len(direction):,} radiances of 0 or more for as many directions"
        raise _error(f"{rule}, returned shape {found.shape}", name)
    values = found.astype(np.float64)
    if (bad := ~((values >= 0.0) & (values <= LARGEST))).any():
        where = ", ".join(f"{x:.4f}" for x in direction[bad.argmax()])
        rule = f"must return finite radiances of 0 or more that float32 holds, returned {values[bad][0]:g}"
        raise _error(f"{rule} in direction ({where}), band {band.name}", name)
    return values


def _error(rule: str, name: str) -> InputError:
    return InputError(rule, "background.sky_map", name)


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {one_line(ValueError(*error.args))}"


def read_pixel_image(path: str, n_band: int, n_row: int, n_col: int) -> NDArray[np.float32]:
    """Read the irradiance that every pixel gets in each band of a sensor [W/cm2], (n_band, n_row, n_col).

    Args:
        path: FITS image or NPY file, (n_row, n_col) for all bands, or with a plane for each.
        n_band: Bands of the sensor.
        n_row: Rows of its images.
        n_col: Columns.

    Raises:
        InputError: No such file, another shape, no real numbers, or values that are negative,
            not finite or beyond float32.
    """
    field = "background.image"
    if not Path(path).is_file():
        raise InputError("must be a file that exists", field, path)
    with errors_at(field, path):
        try:
            values = np.asarray(_array_in(path))
        except Exception as error:  # astropy and NumPy raise many kinds for a broken file
            raise InputError(f"cannot be read ({one_line(error)})") from None
        if values.dtype.kind not in "fiu":
            raise InputError(f"must hold real numbers, has {values.dtype}")
        if values.shape not in ((n_row, n_col), (n_band, n_row, n_col)):
            both = f"{(n_row, n_col)}, or {(n_band, n_row, n_col)} with a plane for each band"
            raise InputError(f"must have shape {both}, has {values.shape}")
        if (bad := ~((values >= 0) & (values <= LARGEST))).any():
            index = np.unravel_index(bad.argmax(), values.shape)
            plane = f"plane {index[0]}, " if values.ndim == 3 else ""
            where = f"{values[index]:g} in {plane}row {index[-2]}, column {index[-1]}"
            raise InputError(f"must hold finite numbers of 0 or more that float32 holds, has {where}")
    return np.array(np.broadcast_to(values, (n_band, n_row, n_col)), dtype=np.float32)


def _array_in(path: str) -> Any:
    if path.lower().endswith(".npy"):
        return npy_array(Path(path).read_bytes())
    with open_fits(path) as hdus:
        found = next((hdu.data for hdu in hdus[:2] if is_image(hdu)), None)
    if found is None:
        raise InputError("must hold an image")
    return found
