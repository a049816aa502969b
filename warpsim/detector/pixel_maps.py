"""The user's maps of a detector: gains, offsets and bad pixels from FITS files, as `calibrate` writes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError, one_line
from warpsim.tables.checked_files import is_image, open_fits

SENSOR_FIELD = "{sensor}"
"""Stands for the name of a sensor in the name of a file."""

LARGEST_GAIN = 4.0
_LARGEST = 1e30
"""Offset of any sign."""


@dataclass(frozen=True)
class PixelMaps:
    """Maps of some sensors, (n_sensor, n_band, n_row, n_col) each; of one where all share a file."""

    gain: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    """Irradiance [W/cm2], or electrons of the dark current [e]; NaN in all of an image that a file lacks."""
    bad: npt.NDArray[np.uint8]
    """1 dead, 2 hot, 0 neither."""


def maps_path(file: str, sensor: str) -> Path:
    """Return the path of the maps of a sensor."""
    return Path(file.replace(SENSOR_FIELD, sensor))


def read_maps(
    file: str,
    sensors: Sequence[str],
    bands: Sequence[str],
    known: Sequence[str],
    shape: tuple[int, int],
    every: bool = True,
) -> PixelMaps:
    """Read the maps of sensors; what a file lacks are gains of 1, offsets that are not known, and no bad pixels.

    Args:
        file: FITS file with image extensions GAIN_BAND, OFFSET_BAND and BAD_BAND, or GAIN, OFFSET and BAD.
        sensors: Names of sensors.
        bands: Names of bands, each of which may be without a map.
        known: Names of all bands of the sensors.
        shape: Rows and columns of images.
        every: Whether each sensor with a file of its own must have it; else those without are as without maps.

    Raises:
        InputError: No such file, none of these extensions, another shape, or a value out of range.
    """
    found = []
    for path in [maps_path(file, sensor) for sensor in sensors] if SENSOR_FIELD in file else [Path(file)]:
        missing = not every and SENSOR_FIELD in file and not path.is_file()
        found.append(_planes({}, bands, shape) if missing else _maps_of(path, bands, known, shape))
    return PixelMaps(*(np.stack(values) for values in zip(*found, strict=True)))


def check_maps_files(file: str | None, sensors: Sequence[str]) -> None:
    """Check that each of some sensors has its file of maps; InputError otherwise."""
    if file is None or SENSOR_FIELD not in file:
        return
    for sensor in sensors:
        if not (path := maps_path(file, sensor)).is_file():
            raise InputError(f"must be a file that exists for {sensor}", "detector.maps_file", str(path))


_RULES = {"GAIN": (0.0, LARGEST_GAIN, 1.0), "OFFSET": (-_LARGEST, _LARGEST, np.nan), "BAD": (0.0, 2.0, 0.0)}
"""Least and largest value of a map, and what stands for one that is not given."""


def _maps_of(
    path: Path, bands: Sequence[str], known: Sequence[str], shape: tuple[int, int]
) -> tuple[npt.NDArray[Any], ...]:
    if not path.is_file():
        raise InputError("must be a file that exists", "detector.maps_file", str(path))
    try:
        with open_fits(path) as hdus:
            images = {hdu.name.upper(): np.asarray(hdu.data, dtype=np.float64) for hdu in hdus[1:] if is_image(hdu)}
    except Exception as error:  # astropy raises many kinds for a broken file
        raise InputError(f"cannot be read: {one_line(error)}", "detector.maps_file", str(path)) from None
    names = {f"{name}{end.upper()}": name for name in _RULES for end in ("", *(f"_{band}" for band in known))}
    if not names.keys() & images.keys():
        raise InputError(f"must have an image GAIN, OFFSET or BAD in {path}, or one by band", "detector.maps_file")
    for image in names.keys() & images.keys():
        _check_plane(images[image], names[image], shape, path)
    return _planes(images, bands, shape)


def _check_plane(plane: npt.NDArray[np.float64], name: str, shape: tuple[int, int], path: Path) -> None:
    low, high, _ = _RULES[name]
    if plane.shape != shape:
        rule = f"must hold images of shape {shape}, got {plane.shape} of {name} in {path}"
    elif not np.isfinite(plane).all() or plane.min() < low or plane.max() > high:
        rule = f"must be finite, and within {low:g} to {high:g}, in {name} of {path}"
    elif name == "BAD" and (plane % 1.0).any():
        rule = f"must be 0, 1 or 2, in BAD of {path}"
    else:
        return
    raise InputError(rule, "detector.maps_file")


def _planes(
    images: dict[str, npt.NDArray[np.float64]], bands: Sequence[str], shape: tuple[int, int]
) -> tuple[npt.NDArray[Any], ...]:
    """Gains, offsets and bad pixels, (n_band, n_row, n_col) each."""
    maps = []
    for name, (*_, unknown) in _RULES.items():
        other = images.get(name, np.full(shape, unknown))
        planes = np.stack([images.get(f"{name}_{band.upper()}", other) for band in bands])
        maps.append(planes.astype(np.uint8 if name == "BAD" else np.float32))
    return tuple(maps)
