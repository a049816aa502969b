"""Zarr v3: one group per split, with an array for each plane; a shard of the data set owns whole shards of the arrays.

Two processes that write into one Zarr shard lose what the other wrote. So each shard of the data set is written to a
copy of the empty group, in a folder of its own, and its files are then moved to their final paths.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from warpsim.dataset.layout import ImageKey, Shard
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence, split_of
from warpsim.errors import InputError
from warpsim.output.zarr_array import ARRAY
from warpsim.render.frameset import FrameSet

STORE = "images.zarr"
CHUNK_BYTES = 2**18
"""Of small images at most: each chunk takes zarr some milliseconds, whatever its size."""

AXES = ("sequence", "frame", "sensor", "band", "row", "column")


def store_path(split: str) -> str:
    """Path of a split's group, relative to the data set."""
    return f"{split}/{STORE}"


def array_shapes(recipe: Recipe) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Shape of one sequence and type of each array of a recipe."""
    (instrument,) = recipe.instruments.values()
    camera = instrument.sensor.camera
    image = (camera.n_row, camera.n_col)
    views = (recipe.n_frame, recipe.n_sensor, len(recipe.band_names))
    arrays: dict[str, tuple[tuple[int, ...], Any]] = {"counts": ((*views, *image), np.uint16)}
    if recipe.signal:
        arrays["signal_w_cm2"] = ((*views, *image), np.float32)
    if recipe.masks:
        arrays["mask"] = ((*views, *image), np.uint16)
    if recipe.contributions:
        arrays["contributions_w_cm2"] = ((*views, len(recipe.scenario.targets), *image), np.float32)
    return arrays


def create_store(recipe: Recipe, split: str, path: Path) -> dict[str, Any]:
    """Make a split's group, whose arrays are empty; the arrays by name."""
    from zarr import create_group
    from zarr.storage import LocalStore

    # An explicit store: a path as text may be taken for an address.
    group = create_group(store=LocalStore(path), zarr_format=3, attributes=_attributes(recipe, split))
    n_sequence = len(split_of(recipe)[split])
    return {
        name: group.create_array(
            name,
            shape=(n_sequence, *shape),
            dtype=dtype,
            chunks=_chunk_shape(shape, dtype, recipe.frames_per_shard),
            shards=(recipe.shard_size, recipe.frames_per_shard, *shape[1:]),
            dimension_names=AXES if len(shape) == 5 else (*AXES[:4], "target", *AXES[4:]),
            **ARRAY,
        )
        for name, (shape, dtype) in array_shapes(recipe).items()
    }


def _chunk_shape(shape: tuple[int, ...], dtype: Any, n_frame: int) -> tuple[int, ...]:
    """Shape of a chunk: an image, and if it is small some of its targets' planes, then some frames of it."""
    n_plane = max(1, CHUNK_BYTES // (shape[-2] * shape[-1] * int(np.dtype(dtype).itemsize)))
    n_target = shape[3] if len(shape) == 6 else 1
    targets = _largest_divisor(n_target, n_plane)
    frames = _largest_divisor(n_frame, n_plane // n_target) if targets == n_target else 1
    return (1, frames, 1, 1, *(targets,) * (len(shape) - 5), *shape[-2:])


def _largest_divisor(number: int, most: int) -> int:
    """Largest divisor up to a limit: chunks must fill shards."""
    return max(d for d in range(1, max(1, min(number, most)) + 1) if number % d == 0)


def _attributes(recipe: Recipe, split: str) -> dict[str, Any]:
    """Attributes that name the axes. Sensors differ from sequence to sequence: they are in the table of images."""
    known = {"sequence": split_of(recipe)[split], "band": recipe.band_names, "interval_s": recipe.step_s}
    return known | ({"target": recipe.scenario.target_names} if recipe.contributions else {})


class ZarrShard:
    """Writer of a shard of the data set: whole shards of each array of its split's group."""

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        self._recipe, self._shard = recipe, shard
        self._path = folder / store_path(shard.split)
        self._arrays = create_store(recipe, shard.split, self._path)
        self._buffers: dict[str, Any] = {}
        self._first = shard.number * recipe.shard_size

    def add(self, sequence: Sequence, position: int, frames: FrameSet, planes: dict[str, Any], truth: Any) -> None:
        """Keep frames until a shard of an array is full."""
        if self._recipe.contributions and sequence.scenario.target_names != self._recipe.scenario.target_names:
            raise InputError(
                "contributions in one Zarr array need the same targets in every sequence; choose another format",
                f"sequence {sequence.number}",
            )
        n_frame = self._recipe.frames_per_shard
        for name, (shape, dtype) in array_shapes(self._recipe).items():
            for f, number in enumerate(frames.frames):
                if name not in self._buffers:
                    self._buffers[name] = np.zeros((len(self._shard.sequences), n_frame, *shape[1:]), dtype)
                self._buffers[name][position, number % n_frame] = planes[name][f]
                if len(self._shard.sequences) == 1 and (number % n_frame == n_frame - 1 or number == shape[0] - 1):
                    self._flush(name, number // n_frame * n_frame, number + 1)

    def _flush(self, name: str, first: int, end: int) -> None:
        """Write a whole shard of an array."""
        last = self._first + len(self._shard.sequences)
        self._arrays[name][self._first : last, first:end] = self._buffers.pop(name)[:, : end - first]

    def finish(self) -> None:
        """Write buffered frames; the group's description is written by the run."""
        for name in list(self._buffers):
            self._flush(name, 0, self._recipe.n_frame)
        for path in self._path.rglob("zarr.json"):
            os.unlink(path)  # noqa: PTH108

    def close(self) -> None:
        """Do nothing: no file is open."""

    def locate(self, sequence: Sequence, key: ImageKey) -> tuple[str, str]:
        """The array and the index of an image."""
        index = f"[{self._first + key.position}, {key.frame}, {key.sensor_number}, {key.band_number}]"
        return f"{store_path(self._shard.split)}/counts", index
