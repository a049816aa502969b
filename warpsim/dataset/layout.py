"""Layout of a data set: paths of its parts, which sequences are written as one, and all that its bytes depend on.

manifest.json                      what was made, from what, with what; the last file to come
sequences.parquet                  one row per sequence: what was drawn
annotations/SPLIT.json             COCO
SPLIT/000012/...                   formats with a folder for each sequence
SPLIT/000003.tar, SPLIT/images.zarr   formats that put several sequences into one file
.../images.parquet, truth.parquet  one row per image; per image and target
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import Any, NamedTuple

from warpsim.dataset.recipe import SHARDED, Recipe, choices_with_files
from warpsim.dataset.sequences import Sequence, check_extremes, draw_sequence, split_of, varied
from warpsim.output.manifest import package_versions
from warpsim.output.output_folder import MANIFEST
from warpsim.render.frameset import FrameSet
from warpsim.render.stars import catalog_checksums
from warpsim.scene.environment import BUILT_IN_CATALOGS
from warpsim.scene.inputs import input_checksums
from warpsim.scene.scene import Scene
from warpsim.scene.scene_files import named_files
from warpsim.version import __version__

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


STAR_CATALOG = "star catalog"
"""Among the inputs: the scene's, whether it came from a file or not; of each kind of sensor with stars of its own."""

Identity = dict[str, Any]

Stamp = tuple[int, int] | None


def identity_of(recipe: Recipe, device: str) -> Identity:
    """Return all inputs that the bytes of a data set depend on, as plain values for its manifest; any GPU is "cuda"."""
    return {
        "recipe": recipe.to_dict(),
        "inputs": _inputs(recipe),
        "device": "cuda" if device.startswith("cuda") else "cpu",
        "warpsim": __version__,
        "packages": package_versions(*writers_of(recipe)),
    }


def writers_of(recipe: Recipe) -> list[str]:
    """Packages that write files of this recipe, beyond those that warpsim always needs."""
    return [
        "pyarrow",
        *(["zarr"] if recipe.format == "zarr" else []),
        *(["av"] if recipe.preview == "mp4" else []),
        *(["pycocotools"] if recipe.masks else []),
    ]


def input_files(recipe: Recipe) -> list[str]:
    """Paths of all files that sequences may be made from."""
    scenes = [recipe.scene.to_dict(), *(nested for *_, nested in choices_with_files(recipe.distributions))]
    catalogs = (scene.get("sky", {}).get("catalog", BUILT_IN_CATALOGS[0]) for scene in scenes)
    named = [*(path for scene in scenes for path in named_files(scene)), *catalogs]
    return [path for path in dict.fromkeys(named) if path not in BUILT_IN_CATALOGS]


def stamp_of(path: str) -> Stamp:
    """Return a stamp of a file that changes with its content; None where it is missing."""
    try:
        stat = os.stat(path)  # noqa: PTH116
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size


def _inputs(recipe: Recipe) -> dict[str, str]:
    """Checksums of all files that sequences may be made from, by path, and of star catalogs."""
    found = _inputs_of(recipe.scene)
    for name, number, value, _ in choices_with_files(recipe.distributions):
        for path, checksum in _inputs_of(varied(recipe, {name: value}, f"sample.{name}")).items():
            if found.get(path) != checksum:
                found[f"{path}, for {name} {number}"] = checksum
    return found


def _inputs_of(scene: Scene) -> dict[str, str]:
    found = catalog_checksums(scene.scenario)  # one for all kinds of sensors, or one of each
    catalogs = {f"{STAR_CATALOG} of {kind}": checksum for kind, checksum in found.items()}
    if len(set(found.values())) == 1:
        catalogs = {STAR_CATALOG: next(iter(found.values()))}
    return catalogs | input_checksums(scene.scenario)


def recipe_report(recipe: Recipe) -> str:
    """Size, splits and sampled fields of a data set, and its first sequence as an example; InputError for none."""
    check_extremes(recipe)
    identity_of(recipe, "cpu")  # reads every file that is named
    n_pool = len(recipe.pool_of(recipe.scenario))
    size = recipe.n_sequence * recipe.n_frame * recipe.frame_bytes
    splits = ", ".join(f"{name} {len(numbers)}" for name, numbers in split_of(recipe).items())
    first = draw_sequence(recipe, 0)
    drawn = "".join(f", {name} = {value!r}" for name, value in first.values.items())
    lines = [
        f"{recipe.n_image:,} images: {recipe.n_sequence:,} sequences of {recipe.n_frame} frames every "
        f"{recipe.step_s:g} s, {recipe.n_sensor} of {n_pool} sensors, bands {' '.join(recipe.band_names)}",
        f"sequences: {splits}",
        f"{recipe.format}, {len(shards_of(recipe)):,} shards; {size / 1e6:,.1f} MB before compression, and tables",
        *(f"drawn: {name} = {json.dumps(how)[:80]}" for name, how in recipe.to_dict().get("sample", {}).items()),
        f"sequence 0: from {first.scene.frames.start_s:.3f} s on, {', '.join(first.sensors)}{drawn}",
    ]
    return "\n".join(lines)
