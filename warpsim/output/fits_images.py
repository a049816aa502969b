"""FITS files of the images of a sensor and band: cubes, and files with an image extension for each frame.

Cubes: the primary HDU has counts, axes (frame, row, column) in NumPy order, row 0 the top row of the image. Extension
FRAMES: one row per plane with FRAME (number), TIME_S (after the epoch), DATE_OBS (UTC), the TAN keywords CRVAL1 ...
CD2_2 of the plane's apparent sky, UP_REPLACED, BORESIGHT_REPLACED, SLEWING where cameras slew, and the sensor's state,
POS_X ... QUAT_W; its header has the axis types and the SIP polynomials of a distorted camera.
`read_cube(path).wcs(plane)` makes an astropy WCS of them.

Files of frames, for viewers that know no table of WCS: the primary HDU has no data and the keywords of all images.
Extension FRAME000060 holds frame 60, row 0 the top row, and in its header all that is known of it: the same keywords,
its time, its WCS, and the sensor's state. The file only grows, a whole number of blocks for each frame.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import naming
from warpsim.instant import utc_dates
from warpsim.optics.wcs import lens_keywords, tan_keywords, wcs_from_keywords
from warpsim.output.fits_header import Card, Views, provenance_cards
from warpsim.scene.description import SceneDescription
from warpsim.tables.checked_files import open_fits

if TYPE_CHECKING:
    from astropy.table import Table
    from astropy.wcs import WCS

_FLAG_COLUMNS = {"UPREPL": "UP_REPLACED", "BOREPL": "BORESIGHT_REPLACED", "SLEWING": "SLEWING"}
"""Columns of flags of views, by keyword."""

FITS_BLOCK_BYTES = 2880

_WCS_KEYS = ("CRVAL1", "CRVAL2", "CRPIX1", "CRPIX2", "CD1_1", "CD1_2", "CD2_1", "CD2_2", "LONPOLE")


@dataclass(frozen=True, repr=False)
class Cube:
    """A cube as read from a file."""

    counts: npt.NDArray[np.uint16]
    """Shape (n_frame, n_row, n_col)."""
    frames: Table
    """One row per plane."""
    header: Any
    """Primary header."""

    def __repr__(self) -> str:
        n_frame, n_row, n_col = self.counts.shape
        size = f"{n_frame} frames, {n_row} x {n_col} pixels"
        return f"Cube({self.header['SENSOR']}, band {self.header['FILTER']}: {size})"

    def wcs(self, plane: int) -> WCS:
        """WCS of one plane, for zero-based pixel coordinates with astropy's pixel functions."""
        row = self.frames[plane]
        return wcs_from_keywords({key: float(row[key]) for key in _WCS_KEYS}, self.frames.meta)


def append_planes(path: Path, planes: npt.NDArray[Any], n_frame: int, cards: Sequence[Card]) -> None:
    """Append planes to a FITS array of n_frame of them, which is begun with the first.

    Args:
        path: File to write to.
        planes: uint16 or float32, shape (n, ...).
        n_frame: Length of the first axis in the end.
        cards: Keywords beyond those of the array's form.
    """
    stored = _stored_planes(planes)
    with naming(path), path.open("ab") as file:
        if file.tell() == 0:
            file.write(_header([*_form_cards(planes.dtype, planes.shape[1:], n_frame), *cards]))
        file.write(stored.data)


def append_frames(
    path: Path, planes: npt.NDArray[Any], numbers: Sequence[int], cards: Sequence[list[Card]], shared: list[Card]
) -> None:
    """Append an extension for each plane to a file, which is begun with the first.

    Args:
        path: File to write to.
        planes: uint16 or float32, shape (n, ..., row, column).
        numbers: Frame numbers, n of them.
        cards: Keywords of each.
        shared: Keywords of the primary HDU.
    """
    with naming(path), path.open("ab") as file:
        if file.tell() == 0:
            begin: list[Card] = [("SIMPLE", True, "conforms to FITS"), ("BITPIX", 8, ""), ("NAXIS", 0, "no data here")]
            file.write(_header([*begin, ("EXTEND", True, ""), *shared]))
        for number, plane, own in zip(numbers, _stored_planes(planes), cards, strict=True):
            name: Card = ("EXTNAME", _extension_name(number), "")
            file.write(_header([*_form_cards(planes.dtype, plane.shape), name, *own]))
            file.write(np.ascontiguousarray(plane).data)
            file.write(bytes(-file.tell() % FITS_BLOCK_BYTES))


def _extension_name(frame: int) -> str:
    return f"FRAME{frame:06d}"


def _header(cards: Sequence[Card]) -> bytes:
    from astropy.io import fits

    return bytes(fits.Header([fits.Card(*card) for card in cards]).tostring(), "ascii")


def _stored_planes(planes: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return uint16 or float32 numbers as FITS stores them."""
    # 16-bit integers of FITS have a sign: 32768 is added by the reader.
    stored = planes ^ np.uint16(0x8000) if planes.dtype == np.uint16 else planes
    return stored.astype(stored.dtype.newbyteorder(">"))


def finish_cubes(paths: Sequence[Path], scene: SceneDescription, views: Views) -> None:
    """Finish the cubes of a sensor, of a band each, with the table of their frames."""
    table = _frames_extension(scene, views)
    for path in paths:
        finish_planes(path)
        with naming(path), path.open("ab") as file:
            file.write(table)


def _frames_extension(scene: SceneDescription, views: Views) -> bytes:
    """The extension FRAMES as it stands in a file."""
    from astropy.io import fits
    from astropy.table import Table

    camera, time_s = views.instrument.sensor.camera, views.time_s
    rows = [
        {"FRAME": number, "TIME_S": float(time_s[i]), **tan_keywords(views.axes_icrs[i], camera)}
        | {_FLAG_COLUMNS[word]: bool(values[i]) for word, values in views.flags.items()}
        for i, number in enumerate(views.frames)
    ]
    table = Table(rows=rows)
    for name, values in views.states.items():
        table[name] = values
        table[name].unit = {"POS": "m", "VEL": "m / s"}.get(name[:3])
    table.add_column(utc_dates(scene.epoch_utc, table["TIME_S"]), index=2, name="DATE_OBS")
    table["TIME_S"].unit = "s"
    for name in _WCS_KEYS[:2]:
        table[name].unit = "deg"
    for name in _WCS_KEYS[4:8]:
        table[name].unit = "deg / pix"
    extension = fits.table_to_hdu(table)
    extension.name = "FRAMES"
    extension.header.update(lens_keywords(camera))
    for name, value, comment in provenance_cards(scene):
        extension.header[name] = value, comment
    file = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), extension]).writeto(file)
    return file.getvalue()[FITS_BLOCK_BYTES:]  # behind a first header without data


def finish_planes(path: Path) -> None:
    """Fill the last block of a FITS array."""
    with naming(path), path.open("ab") as file:
        file.write(bytes(-file.tell() % FITS_BLOCK_BYTES))


def read_cube(path: str | Path) -> Cube:
    """Read a cube written by warpsim.

    Raises:
        InputError: The file is missing or is not such a cube.
    """
    from astropy.table import Table

    try:
        with open_fits(path) as file:
            counts = np.asarray(file[0].data, dtype=np.uint16)
            return Cube(counts, Table.read(file["FRAMES"]), file[0].header)
    except (OSError, KeyError, AttributeError, TypeError, ValueError) as error:
        raise InputError(f"is not a warpsim FITS cube: {error}").of(path) from None


def read_planes(path: Path, frames: Sequence[int]) -> npt.NDArray[np.uint16]:
    """Read the planes of some frame numbers of a cube, and no others."""
    from astropy.io import fits

    with fits.open(path) as file:
        numbers = np.asarray(file["FRAMES"].data["FRAME"]).tolist()
        return np.stack([np.asarray(file[0].section[numbers.index(frame)], dtype=np.uint16) for frame in frames])


def read_frames(path: Path, frames: Sequence[int]) -> npt.NDArray[np.uint16]:
    """Read the counts of some frame numbers of a file of frames, and of no others, shape (n, row, column)."""
    from astropy.io import fits

    with fits.open(path) as file:
        return np.stack([np.asarray(file[_extension_name(frame)].data, dtype=np.uint16) for frame in frames])


def _form_cards(dtype: Any, shape: tuple[int, ...], n_frame: int | None = None) -> list[Card]:
    """Return the first keywords of an array of n_frame planes of a shape, or of an image extension of one plane."""
    is_whole, axes = dtype == np.uint16, [*shape[::-1], *([] if n_frame is None else [n_frame])]
    words = ["columns", "rows, first row on top", *["targets"] * (len(shape) - 2), "frames"]
    begin: Card = ("SIMPLE", True, "conforms to FITS") if n_frame is not None else ("XTENSION", "IMAGE", "")
    end: list[Card] = [("EXTEND", True, "")] if n_frame is not None else [("PCOUNT", 0, ""), ("GCOUNT", 1, "")]
    cards: list[Card] = [
        begin,
        ("BITPIX", 16 if is_whole else -32, "16-bit integers" if is_whole else "32-bit floats"),
        ("NAXIS", len(axes), ""),
        *((f"NAXIS{i}", n, word) for i, (n, word) in enumerate(zip(axes, words, strict=False), start=1)),
        *end,
    ]
    return [*cards, ("BSCALE", 1, ""), ("BZERO", 32768, "unsigned 16-bit")] if is_whole else cards
