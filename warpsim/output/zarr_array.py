"""Zarr v3 arrays of the counts of one sensor and band, axes (frame, row, column); the extra `zarr`.

An image is a chunk, as many as SHARD_BYTES hold are a shard, which is a file. One process writes an array, shard by
shard. What a FITS header says stands in the array's attributes; what changes from frame to frame is a list there.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import naming, whole_folder
from warpsim.output.fits_header import image_cards
from warpsim.output.image_files import facts_of
from warpsim.render.frameset import FrameSet
from warpsim.scene.scenario import Scenario

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
    """Files of an array of images, relative to its folder."""
    n_shard = -(-shape[0] // _shard_frames(shape))
    return [f"{name}/zarr.json", *(f"{name}/c/{number}/0/0" for number in range(n_shard))]


@contextlib.contextmanager
def zarr_writer(
    path: Path, scenario: Scenario, sensor: str, band: str, n_frame: int
) -> Iterator[Callable[[FrameSet, int, int], None]]:
    """Open an array that takes frames in order, by index along the sensor and band axes; it appears when complete."""
    camera = scenario.instrument_of(sensor).sensor.camera
    shape = (n_frame, camera.n_row, camera.n_col)
    with whole_folder(path) as partial, naming(path):
        array = _new_array(partial, shape)
        waiting = np.zeros((_shard_frames(shape), *shape[1:]), dtype=np.uint16)
        known: list[dict[str, Any]] = []

        def add(frames: FrameSet, sensor_index: int, band_index: int) -> None:
            counts = frames.counts.numpy()[:, sensor_index, band_index]
            for image, cards in zip(counts, image_cards(frames, sensor, band), strict=True):
                waiting[len(known) % len(waiting)] = image
                known.append(facts_of(cards))
                if len(known) % len(waiting) == 0 or len(known) == n_frame:
                    first = (len(known) - 1) // len(waiting) * len(waiting)
                    array[first : len(known)] = waiting[: len(known) - first]

        yield add
        array.update_attributes(_attributes(known))


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
        shards=(_shard_frames(shape), *shape[1:]),
        dimension_names=("frame", "row", "column"),
        zarr_format=3,
        **ARRAY,
    )


def _shard_frames(shape: tuple[int, int, int]) -> int:
    n_frame, n_row, n_col = shape
    return max(1, min(n_frame, SHARD_BYTES // (2 * n_row * n_col)))


def _attributes(known: list[dict[str, Any]]) -> dict[str, Any]:
    """Keywords common to all images as they are, others as a list with an item for each frame."""
    return {
        name: [facts[name] for facts in known] if name in _OF_A_FRAME else value for name, value in known[0].items()
    }
