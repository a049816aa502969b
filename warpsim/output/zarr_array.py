"""Zarr v3 arrays of the counts of one sensor and band, axes (frame, row, column); the extra `zarr`.

An image is a chunk, as many as SHARD_BYTES hold are a shard, which is a file. One process writes an array, shard by
shard. What a FITS header says stands in the array's attributes; what changes from frame to frame is a list there.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import naming
from warpsim.output.fits_header import STATE_WORDS

SHARD_BYTES = 32 * 2**20
"""Largest size of images in a shard, but for a single one: held in memory before it is written."""

ARRAY: dict[str, Any] = {
    "fill_value": 0,
    "config": {"write_empty_chunks": True},  # which files there are does not depend on what the images show
}
"""Settings of every array of images."""

_OF_A_FRAME = {
    *("FRAME", "TIME_S", "DATE-OBS", "MJD-OBS", "CRVAL1", "CRVAL2", "CD1_1", "CD1_2", "CD2_1", "CD2_2"),
    *("UPREPL", "BOREPL", "SLEWING"),
    *STATE_WORDS,
}


def check_zarr() -> None:
    """Check that the package is installed.

    Raises:
        InputError: zarr is not installed, or is older than 3.
    """
    try:
        from zarr import create_array  # noqa: F401
    except ImportError:
        message = "zarr: needs zarr 3 or later, which the extra `zarr` brings: pip install 'warpsim[zarr]'"
        raise InputError(message) from None


def zarr_names(name: str, shape: tuple[int, int, int]) -> list[str]:
    """Files of an array of images, relative to its folder; its description is the last."""
    n_shard = -(-shape[0] // shard_frames(shape))
    return [*(f"{name}/c/{number}/0/0" for number in range(n_shard)), f"{name}/zarr.json"]


def append_counts(path: Path, shape: tuple[int, int, int], first: int, counts: npt.NDArray[np.uint16]) -> None:
    """Write images from an index on, in whole shards but for the last; the array has no description yet."""
    n_together = shard_frames(shape)
    with naming(path):
        array = _new_array(path, shape)
        for begin in range(0, len(counts), n_together):
            part = counts[begin : begin + n_together]
            array[first + begin : first + begin + len(part)] = part
        (path / "zarr.json").unlink()


def finish_array(path: Path, shape: tuple[int, int, int], facts: list[dict[str, Any]]) -> None:
    """Describe a complete array: common keywords as they are, others as a list with an item for each frame."""
    known = {
        name: [of_frame[name] for of_frame in facts] if name in _OF_A_FRAME else value
        for name, value in facts[0].items()
    }
    with naming(path):
        _new_array(path, shape).update_attributes(known)


def shard_frames(shape: tuple[int, int, int]) -> int:
    """Return the number of images of a shard."""
    n_frame, n_row, n_col = shape
    return max(1, min(n_frame, SHARD_BYTES // (2 * n_row * n_col)))


def read_zarr_counts(path: Path, frames: Sequence[int]) -> npt.NDArray[np.uint16]:
    """Images of some frames, shape (n, row, column)."""
    import zarr

    array: Any = zarr.open_array(str(path), mode="r")
    index_of = {number: index for index, number in enumerate(array.attrs["FRAME"])}
    return np.stack([np.asarray(array[index_of[frame]]) for frame in frames])


def _new_array(path: Path, shape: tuple[int, int, int]) -> Any:
    import zarr

    return zarr.create_array(
        store=zarr.storage.LocalStore(path),  # a path as text may be taken for an address
        shape=shape,
        dtype="uint16",
        chunks=(1, *shape[1:]),
        shards=(shard_frames(shape), *shape[1:]),
        dimension_names=("frame", "row", "column"),
        zarr_format=3,
        **ARRAY,
    )
