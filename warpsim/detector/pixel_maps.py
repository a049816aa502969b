"""The user's maps of a detector: gains, offsets and bad pixels from FITS files, as `calibrate` writes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError

PLACE = "{sensor}"
"""Stands for the name of a sensor in the name of a file."""

LARGEST_GAIN = 4.0


@dataclass(frozen=True)
class PixelMaps:
    """Maps of some sensors, (n_sensor, n_band, n_row, n_col) each; of one where all share a file."""

    gain: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    """Irradiance [W/cm2], or electrons of the dark current [e]."""
    bad: npt.NDArray[np.uint8]
    """1 dead, 2 hot, 0 neither."""


def read_maps(file: str, sensors: Sequence[str], bands: Sequence[str], n_row: int, n_col: int) -> PixelMaps:
    """Read the maps of sensors; a map that a file lacks is 1, nothing, and no bad pixels.

    Args:
        file: FITS file with image extensions GAIN_BAND, OFFSET_BAND and BAD_BAND, or GAIN, OFFSET and BAD.
        sensors: Names of all sensors of the kind.
        bands: Names of bands.
        n_row: Rows of images.
        n_col: Columns.

    Raises:
        InputError: No such file, none of these extensions, another shape, or a value out of range.
    """
    names = list(sensors) if PLACE in file else [""]
    found = [_maps_of(file.replace(PLACE, name), bands, (n_row, n_col)) for name in names]
    return PixelMaps(*(np.stack(values) for values in zip(*found, strict=True)))


def _maps_of(file: str, bands: Sequence[str], shape: tuple[int, int]) -> tuple[npt.NDArray[Any], ...]:
    from astropy.io import fits

    if not Path(file).is_file():
        raise InputError("must be a file that exists", "detector.maps_file", file)
    try:
        with fits.open(file) as hdus:
            images = {hdu.name.upper(): np.asarray(hdu.data, dtype=np.float64) for hdu in hdus[1:] if hdu.is_image}
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}", "detector.maps_file", file) from None
    rules = {"GAIN": (0.0, LARGEST_GAIN, 1.0), "OFFSET": (-np.inf, np.inf, 0.0), "BAD": (0.0, 2.0, 0.0)}
    known = {f"{name}{end.upper()}" for name in rules for end in ("", *(f"_{band}" for band in bands))}
    if not known & images.keys():
        raise InputError(f"must have an image GAIN, OFFSET or BAD in {file}, or one by band", "detector.maps_file")
    maps = []
    for name, (low, high, unknown) in rules.items():
        planes = [images.get(f"{name}_{band.upper()}", images.get(name, np.full(shape, unknown))) for band in bands]
        for plane in planes:
            if plane.shape != shape:
                rule = f"must hold images of shape {shape}, got {plane.shape} of {name} in {file}"
                raise InputError(rule, "detector.maps_file")
            if not np.isfinite(plane).all() or plane.min() < low or plane.max() > high:
                raise InputError(
                    f"must be finite, and within {low:g} to {high:g}, in {name} of {file}", "detector.maps_file"
                )
        maps.append(np.stack(planes).astype(np.uint8 if name == "BAD" else np.float32))
    return tuple(maps)
