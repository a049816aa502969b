"""FITS files with one image extension for each frame: what viewers read that know no table of WCS.

The primary HDU has no data and the keywords of all images of a sensor and band. Extension FRAME000060 holds frame 60,
row 0 the top row, and in its header all that is known of it: the same keywords, its time, its WCS, and the sensor's
state. The file only grows, a whole number of blocks for each frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.files import naming
from warpsim.output.fits_cube import FITS_BLOCK_BYTES, form_cards, stored_planes
from warpsim.output.fits_header import Card


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
        for number, plane, own in zip(numbers, stored_planes(planes), cards, strict=True):
            name: Card = ("EXTNAME", extension_name(number), "")
            file.write(_header([*form_cards(planes.dtype, plane.shape), name, *own]))
            file.write(np.ascontiguousarray(plane).data)
            file.write(bytes(-file.tell() % FITS_BLOCK_BYTES))


def extension_name(frame: int) -> str:
    """Return the name of the extension of a frame."""
    return f"FRAME{frame:06d}"


def read_frames(path: Path, frames: Sequence[int]) -> npt.NDArray[np.uint16]:
    """Read the counts of some frame numbers, and of no others, shape (n, row, column)."""
    from astropy.io import fits

    with fits.open(path) as file:
        return np.stack([np.asarray(file[extension_name(frame)].data, dtype=np.uint16) for frame in frames])


def _header(cards: Sequence[Card]) -> bytes:
    from astropy.io import fits

    return bytes(fits.Header([fits.Card(*card) for card in cards]).tostring(), "ascii")
