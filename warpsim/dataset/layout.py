"""What a data set is made of: its sequences, functions of the recipe's seed and the sequence's number alone, and files.

Which sequences are written as one, all that their bytes depend on, and the paths:

manifest.json                      what was made, from what, with what; the last file to come
sequences.parquet                  one row per sequence: what was drawn
annotations/SPLIT.json             COCO
SPLIT/000012/...                   formats with a folder for each sequence
SPLIT/000003.tar, SPLIT/images.zarr   formats that put several sequences into one file
.../images.parquet, truth.parquet  one row per image; per image and target
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warpsim.dataset.crossings import crossing_changes
from warpsim.dataset.recipe import SHARDED, Recipe, choices_with_files, drawn_words
from warpsim.errors import InputError, errors_at
from warpsim.output.summary import package_versions
from warpsim.render.device_stars import catalog_checksums
from warpsim.render.frameset import FrameSet
from warpsim.scene.environment import BUILT_IN_CATALOGS
from warpsim.scene.provenance import input_checksums, provenance
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.scene.scene_files import named_files
from warpsim.streams import uniforms
from warpsim.version import __version__

SEQUENCES = "sequences.parquet"
ANNOTATIONS = "annotations"
COCO = "coco"
"""In the folder of parts: texts of annotations."""

MOST_ATTEMPTS = 100
"""Draws of a sequence before it is given up: a scene may leave no sensor that sees the targets for long enough."""


@dataclass(frozen=True)
class Sequence:
    """One sequence."""

    number: int
    scene: Scene
    """With the drawn values, a seed of its own, and frames 0 to n_frame - 1."""
    sensors: list[str]
    values: dict[str, Any]
    """What was drawn, by field of the scene."""
    attempt: int
    """Draws before this one in which not enough sensors saw the targets."""

    @property
    def scenario(self) -> Scenario:
        """Scenario of the scene."""
        return self.scene.scenario

    @property
    def by_kind(self) -> dict[str, list[str]]:
        """Sensors by their kind: those of one are rendered together."""
        kinds: dict[str, list[str]] = {}
        for sensor in self.sensors:
            kinds.setdefault(self.scenario.instrument_of(sensor).sensor.name, []).append(sensor)
        return kinds


def draw_sequence(recipe: Recipe, number: int) -> Sequence:
    """Draw a sequence; InputError where the drawn values are not valid in the scene, or no draw has enough sensors."""
    for attempt in range(MOST_ATTEMPTS):
        values = drawn_values(recipe, number, attempt)
        scene = varied(recipe, values, f"sequence {number}", **_of_sequence(recipe, number))
        if clips := _clips(recipe, scene):
            start_s, sensors = _chosen_clip(recipe, clips, number, attempt)
            frames = {"count": recipe.n_frame, "interval_s": recipe.step_s, "start_s": start_s}
            time_s = np.minimum(start_s + np.linspace(0.0, recipe.clip_s, recipe.n_frame), scene.duration_s)
            with errors_at("", f"sequence {number}"):
                changes = crossing_changes(scene, recipe.crossings or {}, sensors, time_s, recipe.seed, number)
                return Sequence(number, scene.replace(frames=frames, **changes), sensors, values, attempt)
        if not recipe.distributions:  # all draws are alike
            break
    raise InputError(
        f"in {attempt + 1} draws there were never {recipe.n_sensor} sensors with access to a target for "
        f"{recipe.clip_s:g} s; ask for fewer frames or sensors, or for every_frame = true",
        f"sequence {number}",
    )


def _of_sequence(recipe: Recipe, number: int) -> dict[str, Any]:
    """Fields of the scene of a sequence that the recipe sets: seeds, bands, and the same frames for all sensors."""
    seed = int(uniforms(recipe.seed, "dataset seed", number, 1)[0] * 2**53)
    fields: dict[str, Any] = {"seed": seed, "noise_seed": None}
    for index, (name, instrument) in enumerate(recipe.scenario.instruments.items()):
        fields[f"sensors__{index}__frames"] = None
        if name in recipe.instruments:
            fields[f"sensors__{index}__bands"] = recipe.bands_of(instrument)
    return fields


def drawn_values(recipe: Recipe, number: int, attempt: int = 0) -> dict[str, Any]:
    """Return values of the sampled fields in one draw of a sequence, by field."""
    return {
        name: distribution.value(float(uniforms(recipe.seed, f"dataset.{name}", number, attempt + 1)[attempt]))
        for name, distribution in recipe.distributions.items()
    }


def varied(recipe: Recipe, values: dict[str, Any], where: str, **others: Any) -> Scene:
    """Return the recipe's scene with drawn values, and others, which follows from its files and flights.

    Raises:
        InputError: It begins with `where`: a value is not valid, a file cannot be read, a flight cannot be flown.
    """
    scene = recipe.described(values, where, **others)
    try:
        scene.scenario  # noqa: B018  # reads files, flies flights
    except InputError as error:
        raise error.of(drawn_words(values, where)) from None
    return scene


def check_extremes(recipe: Recipe) -> None:
    """Check that the extremes of each distribution are valid in the scene, before hours of work."""
    for name, distribution in recipe.distributions.items():
        for value in distribution.extremes:
            varied(recipe, {name: value}, f"sample.{name}")


def split_of(recipe: Recipe) -> dict[str, list[int]]:
    """Return the numbers of the sequences of each split, in order; ratios are met to one sequence."""
    order = np.argsort(uniforms(recipe.seed, "dataset split", 0, recipe.n_sequence), kind="stable")
    total = sum(recipe.ratios.values())
    ends = np.cumsum(list(recipe.ratios.values())) / total * recipe.n_sequence
    edges = [0, *(int(end) for end in np.round(ends))]
    return {
        name: sorted(int(number) for number in order[first:end])
        for name, first, end in zip(recipe.ratios, edges[:-1], edges[1:], strict=True)
    }


def _clips(recipe: Recipe, scene: Scene) -> list[tuple[float, float, list[str]]]:
    """Earliest and latest start of sequences that the same sensors see whole, and these sensors; enough of them.

    Where access plays no part these are the whole scene and all sensors; none where a drawn constellation has too few.
    """
    pool = recipe.pool_of(scene.scenario)
    if recipe.every_frame:
        return [(0.0, scene.duration_s - recipe.clip_s, pool)] if len(pool) >= recipe.n_sensor else []
    seen = [
        (instrument.names[sensor], float(start_s), float(end_s - recipe.clip_s))
        for instrument in scene.scenario.instruments.values()
        for sensor, start_s, end_s in zip(
            instrument.access.row, instrument.access.start_s, instrument.access.end_s, strict=True
        )
        if instrument.names[sensor] in pool and end_s - recipe.clip_s >= start_s
    ]
    edges = sorted({edge for _, *edge_s in seen for edge in edge_s})
    clips = []
    for first_s, last_s in zip(edges, edges[1:] or edges, strict=False):
        names = [name for name, start_s, end_s in seen if start_s <= first_s and last_s <= end_s]
        if len(names) >= recipe.n_sensor:
            clips.append((first_s, last_s, names))
    return clips


def _chosen_clip(
    recipe: Recipe, clips: list[tuple[float, float, list[str]]], number: int, attempt: int
) -> tuple[float, list[str]]:
    """Start and sensors of a sequence: any possible start is as likely, and any choice of sensors."""
    fraction = uniforms(recipe.seed, "dataset start", number, attempt + 1)[attempt]
    lengths = np.array([last_s - first_s for first_s, last_s, _ in clips])
    ends = np.cumsum(lengths if lengths.sum() > 0 else np.ones(len(clips)))
    which = min(int(np.searchsorted(ends, fraction * ends[-1], side="right")), len(clips) - 1)
    first_s, last_s, names = clips[which]
    along = (fraction * ends[-1] - (ends[which] - lengths[which])) if lengths.sum() > 0 else 0.0
    order = np.argsort(uniforms(recipe.seed, f"dataset sensors {attempt}", number, len(names)), kind="stable")
    chosen = {names[i] for i in order[: recipe.n_sensor]}
    return min(first_s + float(along), last_s), [name for name in names if name in chosen]


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
    """Path of a table: "images", "truth", "stars" or "artifacts"."""
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


def video_id(recipe: Recipe, image: int) -> int:
    """Return the number of the video of an image: of its sequence, sensor and band; from 1."""
    view, band = divmod(image - 1, len(recipe.band_names))
    sequence, sensor = view // recipe.n_sensor // recipe.n_frame, view % recipe.n_sensor
    return (sequence * recipe.n_sensor + sensor) * len(recipe.band_names) + band + 1


RECIPE_SEED = "RECSEED"
"""Word of provenance that all files of a data set have: the recipe's seed."""


def dataset_provenance(recipe: Recipe) -> dict[str, Any]:
    """Return the words of provenance that all sequences share: no seeds, and no epoch or name that is drawn.

    The recipe's seed, from which all seeds follow, is RECSEED.
    """
    fields = {"SEED": "seed", "NOISSEED": "noise_seed", "DATEREF": "epoch_utc", "SCENE": "name"}
    drawn = {"seed", "noise_seed", *recipe.distributions}
    words = {name: value for name, value in provenance(recipe.scene).items() if fields.get(name) not in drawn}
    return words | {RECIPE_SEED: recipe.seed}


STAR_CATALOG = "star catalog"
"""Among the inputs: the scene's, whether it came from a file or not; of each kind of sensor with stars of its own."""

Stamp = tuple[int, int] | None


def identity_of(recipe: Recipe, device: str) -> dict[str, Any]:
    """Return all inputs that the bytes of a data set depend on, as plain values for its manifest; any GPU is "cuda"."""
    return {
        "recipe": recipe.to_dict(),
        "inputs": input_checksums_of(recipe),
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
        stat = Path(path).stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size


def input_checksums_of(recipe: Recipe) -> dict[str, str]:
    """Return checksums of all files that sequences may be made from, by path, and of star catalogs."""
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
        *(f"crossing: {name}, {json.dumps(how)}" for name, how in recipe.to_dict().get("crossings", {}).items()),
        f"sequence 0: from {first.scene.frames.start_s:.3f} s on, {', '.join(first.sensors)}{drawn}",
    ]
    return "\n".join(lines)
