"""Layout of a data set: paths of its parts, and which sequences are written as one.

manifest.json                      what was made, from what, with what; the last file to come
sequences.parquet                  one row per sequence: what was drawn
annotations/SPLIT.json             COCO
SPLIT/000012/...                   formats with a folder for each sequence
SPLIT/000003.tar, SPLIT/images.zarr   formats that put several sequences into one file
.../images.parquet, truth.parquet  one row per image; per image and target
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from warpsim.dataset.recipe import SHARDED, Recipe
from warpsim.dataset.sequences import Sequence, split_of
from warpsim.output.output_folder import MANIFEST
from warpsim.render.frameset import FrameSet

SEQUENCES = "sequences.parquet"
ANNOTATIONS = "annotations"
COCO = "coco"
"""In the folder of parts: texts of annotations."""


@dataclass(frozen=True)
class Shard:
    """Sequences that are written as one: the unit of work."""

    split: str
    number: int
    """Among the shards of its split."""
    sequences: tuple[int, ...]

    @property
    def name(self) -> str:
        """Unique within the data set."""
        return f"{self.split}-{self.number:06d}"

    @property
    def stem(self) -> str:
        """Stem of its files in formats that put several sequences into one."""
        return f"{self.split}/{self.number:06d}"


class ImageKey(NamedTuple):
    """Key of an image within a shard."""

    sequence: int
    position: int
    """Of the sequence in the shard."""
    frame: int
    sensor: str
    sensor_number: int
    """Of the sensor in the sequence."""
    band: str
    band_number: int
    """Of the band among those of the recipe."""


def shards_of(recipe: Recipe) -> list[Shard]:
    """All shards of a data set, in order."""
    size = recipe.shard_size
    return [
        Shard(split, number, tuple(numbers[first : first + size]))
        for split, numbers in split_of(recipe).items()
        for number, first in enumerate(range(0, len(numbers), size))
    ]


def folder_of(shard: Shard, sequence: int) -> str:
    """Folder of a sequence, in formats that have one."""
    return f"{shard.split}/{sequence:06d}"


def table_path(recipe: Recipe, shard: Shard, sequence: int, table: str) -> str:
    """Path of a table: "images", "truth" or "stars"."""
    if recipe.format in SHARDED:
        return f"{shard.stem}.{table}.parquet"
    return f"{folder_of(shard, sequence)}/{table}.parquet"


def image_keys(recipe: Recipe, sequence: Sequence, position: int, frames: FrameSet) -> list[ImageKey]:
    """Return the keys of the images of a render call, in the order (frame, sensor, band)."""
    bands = recipe.band_names
    views = [(sensor, sequence.sensors.index(sensor)) for sensor in frames.sensors]
    return [
        ImageKey(sequence.number, position, frame, sensor, number, band, bands.index(band))
        for frame in frames.frames
        for sensor, number in views
        for band in frames.bands
    ]


def image_id(recipe: Recipe, key: ImageKey) -> int:
    """Return the number of an image, unique within the data set, from 1."""
    view = (key.sequence * recipe.n_frame + key.frame) * recipe.n_sensor + key.sensor_number
    return view * len(recipe.band_names) + key.band_number + 1


def top_names(recipe: Recipe) -> list[str]:
    """Names of the top-level entries of a data set."""
    return [*recipe.ratios, ANNOTATIONS, SEQUENCES, MANIFEST]
