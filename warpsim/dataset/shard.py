"""Work of a worker: render a shard, write its images, tables and annotations, return its checkpoint record."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from warpsim.dataset.layout import (
    COCO,
    ImageKey,
    Sequence,
    Shard,
    Stamp,
    dataset_provenance,
    draw_sequence,
    folder_of,
    identity_of,
    image_id,
    image_keys,
    input_files,
    stamp_of,
    table_path,
    video_id,
)
from warpsim.dataset.read_dataset import Columns, image_rows
from warpsim.dataset.recipe import SHARDED, Recipe
from warpsim.dataset.writers import bytes_per_view, planes_of, shard_writer
from warpsim.errors import InputError
from warpsim.files import read_json, sha256_of, write_json
from warpsim.instant import utc_dates
from warpsim.labels.coco import BETWEEN, coco_categories, coco_texts, satnet_record
from warpsim.labels.table import label_table, write_parquet
from warpsim.optics.wcs import lens_keywords, tan_keywords
from warpsim.output.output_folder import PARTS, CheckpointRecord, OutputFolder, current_record, difference
from warpsim.output.summary import joined_tables, left_out_rows
from warpsim.render.descriptions import STATE_NAMES, STATE_UNITS
from warpsim.render.frameset import FrameSet
from warpsim.render.line_of_sight import sensor_states
from warpsim.render.renderer import Renderer
from warpsim.scene.provenance import provenance

if TYPE_CHECKING:
    from astropy.table import Table

BYTES_PER_CALL = 64 * 2**20
"""Size of images held in memory at a time, with all requested planes."""

IMAGE_UNITS = {
    "time_s": "s",
    "nei_w_cm2": "W / cm2",
    "sei_w_cm2": "W / cm2",
    **{name: unit for name, unit in STATE_UNITS.items() if name.startswith("sensor_")},
}


Locate = Callable[[Sequence, ImageKey], tuple[str, str]]
"""File and item of an image."""


def _rows(recipe: Recipe, sequence: Sequence, position: int, frames: FrameSet, locate: Locate) -> dict[str, Table]:
    keys = image_keys(recipe, sequence, position, frames)
    ids = np.array([image_id(recipe, key) for key in keys], dtype=np.int64)
    truth = label_table(frames, recipe.least_nei, recipe.masks, recipe.least_box_px)
    rows = {"images": _image_table(sequence, frames, keys, locate), "truth": truth}
    _put_keys_first(rows["images"], ids, sequence.number)
    _put_keys_first(truth, np.repeat(ids, len(sequence.scenario.targets)), sequence.number)
    if recipe.stars:
        rows["stars"] = frames.stars
        rows["stars"].add_column(np.full(len(frames.stars), sequence.number), index=0, name="sequence")
    if recipe.artifacts:
        rows["artifacts"] = frames.artifacts
        id_of = {(key.frame, key.sensor, key.band): number for key, number in zip(keys, ids.tolist(), strict=True)}
        found = zip(*(rows["artifacts"][name].tolist() for name in ("frame", "sensor", "band")), strict=True)
        _put_keys_first(rows["artifacts"], np.array([id_of[key] for key in found], dtype=np.int64), sequence.number)
    return rows


def _image_table(sequence: Sequence, frames: FrameSet, keys: list[ImageKey], locate: Locate) -> Table:
    """One row per image: file, time, sensor, band and WCS."""
    from astropy.table import Table

    instrument = frames.instrument
    camera = instrument.sensor.camera
    locations = [locate(sequence, key) for key in keys]
    lens = lens_keywords(camera)
    axes = frames.axes_icrs
    n_band = len(frames.bands)
    wcs = [json.dumps(tan_keywords(axes[f, s], camera) | lens) for f, s in np.ndindex(axes.shape[:2])]
    dates = utc_dates(sequence.scene.epoch_utc, frames.time_s)
    n_view = len(wcs)
    levels = [instrument.levels[key.band] for key in keys]
    table = Table(
        {
            "file": [file for file, _ in locations],
            "item": [item for _, item in locations],
            "frame": np.array([key.frame for key in keys], dtype=np.int64),
            "time_s": np.repeat(frames.time_s, len(keys) // len(frames.frames)),
            "date_obs": np.repeat(dates, len(keys) // len(frames.frames)),
            "sensor": [key.sensor for key in keys],
            "band": [key.band for key in keys],
            "width": np.full(len(keys), camera.n_col, dtype=np.int32),
            "height": np.full(len(keys), camera.n_row, dtype=np.int32),
            "nei_w_cm2": [level.nei_w_cm2 for level in levels],
            "sei_w_cm2": [level.sei_w_cm2 for level in levels],
            "blank_counts": [float(level.blank_counts) for level in levels],
            "counts_per_nei": [float(level.counts_per_nei) for level in levels],
            "wcs": np.repeat(np.array(wcs, dtype=object), n_band) if n_view else [],
        }
    )
    states = [sensor_states(instrument, name, frames.time_s, axes[:, s]) for s, name in enumerate(frames.sensors)]
    for number, name in enumerate(STATE_NAMES):
        table[f"sensor_{name}"] = np.repeat(np.stack([state[:, number] for state in states], axis=1), n_band)
    for name, unit in IMAGE_UNITS.items():
        table[name].unit = unit
    table.meta |= provenance(sequence.scene)
    return table


def _put_keys_first(table: Table, image_ids: Any, sequence: int) -> None:
    table.add_column(image_ids, index=0, name="image_id")
    table.add_column(np.full(len(table), sequence, dtype=np.int64), index=1, name="sequence")


_FACTS = {
    "id": "image_id", "file_name": "file", "item": "item", "width": "width", "height": "height",
    "sequence": "sequence", "frame": "frame", "frame_id": "frame", "time_s": "time_s", "date_obs": "date_obs",
    "sensor": "sensor", "band": "band",
}  # fmt: skip
"""What COCO's file says of an image, and the columns of the table of images that know it."""


def shard_texts(recipe: Recipe, folder: Path, shard: Shard, checksum: str | None) -> tuple[str, str, str]:
    """Return the COCO texts of a shard's images, annotations and videos; made again unless stored whole."""
    path = _texts_path(folder, shard)
    if path.is_file() and sha256_of(path) == checksum:
        images, annotations, videos = read_json(path)
        return images, annotations, videos
    return _texts(recipe, folder, shard)


def _texts_path(folder: Path, shard: Shard) -> Path:
    return folder / PARTS / COCO / f"{shard.name}.json"


def _texts(recipe: Recipe, folder: Path, shard: Shard) -> tuple[str, str, str]:
    texts = zip(*coco_texts(_images(recipe, folder, shard), coco_categories(recipe.scenario)), strict=True)
    images, annotations, videos = (BETWEEN.join(filter(None, items)) for items in texts)
    return images, annotations, videos


def _images(recipe: Recipe, folder: Path, shard: Shard) -> Iterator[tuple[dict[str, Any], Columns]]:
    """Each image of a shard, and the columns of its targets."""
    for number in shard.sequences[:1] if recipe.format in SHARDED else shard.sequences:
        tables = [folder / table_path(recipe, shard, number, name) for name in ("images", "truth")]
        for row, labels in image_rows(*tables):
            facts = {ours: row[name] for ours, name in _FACTS.items()}
            yield facts | {"video_id": video_id(recipe, row["image_id"])}, labels


def write_satnet(frames: FrameSet, rows: dict[str, Table], folder: Path) -> None:
    """Write SatNet annotations of images into their sequence's folder: Annotations/SENSOR_BAND.FRAME.json."""
    home = folder / "Annotations"
    home.mkdir(parents=True, exist_ok=True)
    ids = np.asarray(rows["truth"]["image_id"])
    for image in rows["images"]:
        frame, sensor, band = int(image["frame"]), str(image["sensor"]), str(image["band"])
        labels = rows["truth"][ids == image["image_id"]]
        dirname, _, filename = str(image["file"]).rpartition("/")
        file = {"dirname": dirname, "filename": filename, "date_obs": str(image["date_obs"]), **rows["images"].meta}
        record = satnet_record(frames, frame, sensor, band, labels, file)
        write_json(record, home / f"{sensor}_{band}.{frame:06d}.json")


@dataclass(frozen=True)
class Task:
    """Input of a worker; small, and plain enough for any transport."""

    folder: str
    """Folder of the data set, which holds the recipe."""
    key: str
    shard: Shard
    device: str
    n_thread: int | None


def write_shard(task: Task) -> CheckpointRecord:
    """Render and write a shard; runs on a worker.

    Raises:
        InputError: The drawn values are not valid in the scene, a package is missing, or this worker would write other
            files than the run was started for.
        OSError: Writing failed, or the run is over.
    """
    work = work_of_run(Path(task.folder), task.key, task.device, task.n_thread)
    shard, output = task.shard, work.output
    with output.scratch(shard.name) as scratch:
        sequences = _write_files(work, task, scratch)
        files = sorted(path.relative_to(scratch).as_posix() for path in scratch.rglob("*") if path.is_file())
        facts: dict[str, Any] = {"sequences": sequences}
        if work.recipe.coco:
            current_record(output.path, output.key)  # texts of another run are not to be replaced
            path = _texts_path(output.path, shard)
            write_json(_texts(work.recipe, scratch, shard), path)
            facts["texts"] = sha256_of(path)
        return output.move_in(shard.name, scratch, files, **facts)


class _Work(NamedTuple):
    """State that a worker keeps between shards of a run."""

    output: OutputFolder
    recipe: Recipe
    renderer: Renderer
    """Of the recipe's own scene; those of sequences share its stars."""
    inputs: dict[str, Stamp]
    """Stamps of all files that the recipe names, by path."""


@lru_cache(maxsize=1)
def work_of_run(folder: Path, key: str, device: str, n_thread: int | None) -> _Work:
    """Return the work of a run, from its record in the folder; OSError if the run is over.

    InputError: Here it would give other files, as versions differ, or input files.
    """
    record = current_record(folder, key)
    recipe = Recipe.from_dict(record["recipe"])
    inputs = {path: stamp_of(path) for path in input_files(recipe)}
    output = OutputFolder(folder, identity_of(recipe, device))
    if output.key != key:
        differs = difference({name: record.get(name) for name in output.identity}, output.identity)
        raise InputError(f"this worker would write other files than the run was started for ({differs})").of(folder)
    return _Work(output, recipe, Renderer(recipe.scene, device, n_thread), inputs)


def _write_files(work: _Work, task: Task, scratch: Path) -> list[dict[str, Any]]:
    """Write all files of a shard; return the drawn values of each sequence."""
    recipe, shard = work.recipe, task.shard
    drawn = []
    parts: dict[str, list[Table]] = defaultdict(list)
    with closing(shard_writer(recipe, shard, scratch)) as writer:
        for position, number in enumerate(shard.sequences):
            sequence = draw_sequence(recipe, number)
            for frames in _rendered(recipe, sequence, work.renderer.with_scene(sequence.scene)):
                rows = _rows(recipe, sequence, position, frames, writer.locate)
                for name, table in rows.items():
                    parts[name].append(table)
                writer.add(sequence, position, frames, planes_of(recipe, frames), rows)
                if recipe.satnet:
                    write_satnet(frames, rows, scratch / folder_of(shard, number))
            if recipe.format not in SHARDED or number == shard.sequences[-1]:
                _write_tables(recipe, shard, number, parts, scratch)
                parts.clear()
            for path, stamp in work.inputs.items():  # sequences read them anew
                if stamp_of(path) != stamp:
                    raise InputError("was changed while the data set was written").of(path)
            drawn.append(_sequence_record(recipe, sequence, shard))
        writer.finish()
    return drawn


def _write_tables(recipe: Recipe, shard: Shard, sequence: int, parts: dict[str, list[Table]], scratch: Path) -> None:
    for name, some in parts.items():
        path = scratch / table_path(recipe, shard, sequence, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_parquet(joined_tables(some), path, {"table": name, **dataset_provenance(recipe)})


def _rendered(recipe: Recipe, sequence: Sequence, renderer: Renderer) -> Iterator[FrameSet]:
    """Frames of a sequence, some at a time, kind of sensor by kind."""
    n_target = len(sequence.scenario.targets)
    for kind, sensors in sequence.by_kind.items():
        instrument = sequence.scenario.instruments[kind]
        n_frame = max(1, BYTES_PER_CALL // (len(sensors) * bytes_per_view(recipe, instrument, n_target)))
        for first in range(0, recipe.n_frame, n_frame):
            numbers = range(first, min(first + n_frame, recipe.n_frame))
            bands = recipe.bands_of(instrument)
            yield renderer.render(numbers, sensors, bands, recipe.signal, recipe.stars)


def _sequence_record(recipe: Recipe, sequence: Sequence, shard: Shard) -> dict[str, Any]:
    """What was drawn, and the element sets that the sequence's scene does without and the recipe's does not."""
    known = {(one["part"], one["location"]) for one in left_out_rows(recipe.scenario)}
    more = [one for one in left_out_rows(sequence.scenario) if (one["part"], one["location"]) not in known]
    return {
        "sequence": sequence.number,
        "split": shard.split,
        "shard": shard.name,
        "sensors": sequence.sensors,
        "epoch_utc": sequence.scene.epoch_utc,
        "start_s": sequence.scene.frames.start_s,
        "seed": sequence.scene.seed,
        "attempt": sequence.attempt,
        "values": sequence.values,
        **({"left_out": more} if more else {}),
    }
