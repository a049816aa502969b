"""The user's light of every pixel: glow of the optics, or what a model of their own says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.background.fits_map import LARGEST
from warpsim.errors import InputError, one_line
from warpsim.tables.fits_file import is_image, open_fits
from warpsim.tables.npy_file import npy_array


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
    try:
        values = np.asarray(_stored(path))
    except Exception as error:  # astropy and NumPy raise many kinds for a broken file
        raise InputError(f"cannot be read ({one_line(error)})").of(path).within(field) from None
    if values.dtype.kind not in "fiu":
        raise InputError(f"must hold real numbers, has {values.dtype}").of(path).within(field)
    if values.shape not in ((n_row, n_col), (n_band, n_row, n_col)):
        both = f"{(n_row, n_col)}, or {(n_band, n_row, n_col)} with a plane for each band"
        raise InputError(f"must have shape {both}, has {values.shape}").of(path).within(field)
    if (bad := ~((values >= 0) & (values <= LARGEST))).any():
        index = np.unravel_index(bad.argmax(), values.shape)
        plane = f"plane {index[0]}, " if values.ndim == 3 else ""
        where = f"{values[index]:g} in {plane}row {index[-2]}, column {index[-1]}"
        raise (
            InputError(f"must hold finite numbers of 0 or more that float32 holds, has {where}").of(path).within(field)
        )
    return np.array(np.broadcast_to(values, (n_band, n_row, n_col)), dtype=np.float32)


def _stored(path: str) -> Any:
    """The array in a file."""
    if path.lower().endswith(".npy"):
        return npy_array(Path(path).read_bytes())
    with open_fits(path) as hdus:
        found = next((hdu.data for hdu in hdus[:2] if is_image(hdu)), None)
    if found is None:
        raise InputError("must hold an image")
    return found
