"""The user's light of every pixel: glow of the optics, or what a model of their own says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError


def read_pixel_image(path: str, n_band: int, n_row: int, n_col: int) -> NDArray[np.float32]:
    """Read the irradiance that every pixel gets in each band of a sensor [W/cm2], (n_band, n_row, n_col).

    Args:
        path: FITS image or NPY file, (n_row, n_col) for all bands, or with a plane for each.
        n_band: Bands of the sensor.
        n_row: Rows of its images.
        n_col: Columns.

    Raises:
        InputError: No such file, another shape, or values that are negative or not finite.
    """
    if not Path(path).is_file():
        raise InputError("must be a file that exists", "background.image", path)
    try:
        if path.lower().endswith(".npy"):
            values = np.load(path, allow_pickle=False)
        else:
            from astropy.io import fits

            values = fits.getdata(path)
        image = np.asarray(values, dtype=np.float64)
    except (OSError, ValueError, TypeError, IndexError) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}", "background.image", path) from None
    if image.shape not in ((n_row, n_col), (n_band, n_row, n_col)):
        both = f"{(n_row, n_col)}, or {(n_band, n_row, n_col)} with a plane for each band"
        rule = f"must have shape {both}, got {image.shape}"
        raise InputError(rule, "background.image", path)
    if not np.isfinite(image).all() or (image < 0.0).any():
        raise InputError("must hold finite numbers of 0 or more", "background.image", path)
    return np.array(np.broadcast_to(image, (n_band, n_row, n_col)), dtype=np.float32)
