"""FITS files of planes that come one after the other: noiseless images, masks, light of single targets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError


class PlaneWriter:
    """Writer of an array along its first axis, part by part.

    Args:
        path: Name to write to.
        shape: Of the whole array.
        dtype: uint16 or float32.
        words: What the values are, for the header.
    """

    def __init__(self, path: Path, shape: tuple[int, ...], dtype: Any, words: str) -> None:
        from astropy.io import fits

        if np.dtype(dtype) not in (np.dtype(np.uint16), np.dtype(np.float32)):
            raise InputError("must be uint16 or float32", "dtype", dtype)
        self._is_whole = np.dtype(dtype) == np.uint16
        path.unlink(missing_ok=True)  # StreamingHDU appends to what is there
        cards = [
            ("SIMPLE", True, "conforms to FITS"),
            ("BITPIX", 16 if self._is_whole else -32, ""),
            ("NAXIS", len(shape), ""),
        ]
        cards += [(f"NAXIS{i + 1}", n, "") for i, n in enumerate(reversed(shape))]
        cards += [("BSCALE", 1, ""), ("BZERO", 32768, "unsigned 16-bit")] if self._is_whole else []
        header = fits.Header([fits.Card(*card) for card in cards])
        header["HISTORY"] = words
        self._stream = fits.StreamingHDU(str(path), header)

    def add(self, values: npt.NDArray[Any]) -> None:
        """Append values."""
        if self._is_whole:
            values = (values.astype(np.int32) - 32768).astype(np.int16)
        self._stream.write(np.ascontiguousarray(values))

    def close(self) -> None:
        """Finish the file."""
        self._stream.close()

    abandon = close
