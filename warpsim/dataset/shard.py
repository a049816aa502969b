"""Work of a worker: render a shard, write it, move its files to their final paths, return its checkpoint record."""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from warpsim.dataset.annotations import keep_texts, write_satnet
from warpsim.dataset.identity import Stamp, difference, identity_of, input_files, key_of, stamp_of
from warpsim.dataset.image_tables import ShardTables
from warpsim.dataset.layout import CHECKPOINTS, PARTS, PLANNED, RUN, WORK, Shard, folder_of
from warpsim.dataset.planes import bytes_per_view, planes_of
from warpsim.dataset.previews import sequence_animations
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence, draw_sequence
from warpsim.dataset.writers import ShardWriter, shard_writer
from warpsim.errors import InputError
from warpsim.files import read_json, sha256_of, write_json
from warpsim.output.checkpoints import is_record
from warpsim.render.frameset import FrameSet
from warpsim.render.renderer import Renderer

BYTES_PER_CALL = 64 * 2**20
"""Size of images held in memory at a time, with all requested planes."""

LEAST_FREE_BYTES = 2**20
"""A disk with less room is full."""

FINISH = "finish"
"""Name of the plan of the files that describe all shards."""

CheckpointRecord = dict[str, Any]
"""What a worker says of a shard: key, shard, files with their checksums, sequences with what was drawn."""


@dataclass(frozen=True)
class Task:
    """Input of a worker; small, and plain enough for any transport."""

    folder: str
    """Folder of the data set, which holds the recipe."""
    key: str
    shard: Shard
    device: str
    n_thread: int | None


def checkpoint_path(folder: Path, shard: Shard) -> Path:
    """Path of the checkpoint record of a shard."""
    return folder / PARTS / CHECKPOINTS / f"{shard.name}.json"


def planned_path(folder: Path, name: str) -> Path:
    """Path of the list of planned files, by which a later run knows them."""
    return folder / PARTS / PLANNED / f"{name}.json"


def write_shard(task: Task) -> CheckpointRecord:
    """Render and write a shard; runs on a worker.

    The files get their final names when all of them are complete, and the record comes last.

    Raises:
        InputError: The drawn values are not valid in the scene, a package is missing, or this worker would write other
            files than the run was started for.
        OSError: Writing failed, or the run is over.
    """
    folder, shard = Path(task.folder), task.shard
    work = work_of_run(folder, task.key, task.device, task.n_thread)
    with _scratch(folder, shard) as scratch, _naming_a_full_disk(folder):
        sequences = _write_files(work, task, scratch)
        files = sorted(path.relative_to(scratch).as_posix() for path in scratch.rglob("*") if path.is_file())
        checksums = {name: sha256_of(scratch / name) for name in files}
        sizes = {name: (scratch / name).stat().st_size for name in files}
        _record_of_run(folder, task.key)
        _check_foreign(folder, shard, files)
        write_json({"key": task.key, "files": checksums}, planned_path(folder, shard.name), lasting=True)
        for name in files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (scratch / name).replace(folder / name)
    record: CheckpointRecord = {
        "key": task.key,
        "shard": shard.name,
        "files": checksums,
        "sequences": sequences,
        "bytes": sum(sizes.values()),
    }
    if work.recipe.coco:
        record["texts"] = keep_texts(work.recipe, folder, shard)
    write_json(record, checkpoint_path(folder, shard), lasting=True)
    return record


@dataclass(frozen=True)
class Work:
    """State that a worker keeps between shards of a run."""

    recipe: Recipe
    renderer: Renderer
    """Of the recipe's own scene; those of sequences share its stars."""
    inputs: dict[str, Stamp]
    """Stamps of all files that the recipe names, by path."""

    def check_inputs(self) -> None:
        """Check that no file was changed since.

        Raises:
            InputError: One was.
        """
        for path, stamp in self.inputs.items():
            if stamp_of(path) != stamp:
                raise InputError("was changed while the data set was written").of(path)


@lru_cache(maxsize=1)
def work_of_run(folder: Path, key: str, device: str, n_thread: int | None) -> Work:
    """Return the work of a run, from its record in the folder.

    Raises:
        InputError: Here it would give other files: versions differ, or input files.
        OSError: The run is over.
    """
    record = _record_of_run(folder, key)
    recipe = Recipe.from_dict(record["recipe"])
    inputs = {path: stamp_of(path) for path in input_files(recipe)}
    identity = identity_of(recipe, device)
    if key_of(identity) != key:
        differs = difference({name: record.get(name) for name in identity}, identity)
        raise InputError(f"this worker would write other files than the run was started for ({differs})").of(folder)
    return Work(recipe, Renderer(recipe.scene, device, n_thread), inputs)


def _record_of_run(folder: Path, key: str) -> dict[str, Any]:
    """Return the record of a run while the folder is locked for it; a late worker finds none."""
    record = read_json(folder / PARTS / RUN)
    if not isinstance(record, dict) or record.get("key") != key:
        raise OSError(f"{folder}: no longer belongs to this run")
    return record


def _check_foreign(folder: Path, shard: Shard, names: list[str]) -> None:
    """Check that files of a shard may be written: existing ones are of an earlier attempt."""
    records = [read_json(path) for path in (planned_path(folder, shard.name), checkpoint_path(folder, shard))]
    known = {name for record in records if is_record(record) for name in record["files"]}
    for name in names:
        if name not in known and (folder / name).exists():
            raise InputError("is there already, and warpsim did not write it").of(folder / name)


@contextmanager
def _scratch(folder: Path, shard: Shard) -> Iterator[Path]:
    """A folder of this worker for incomplete files."""
    path = folder / PARTS / WORK / f"{shard.name}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    path.parent.mkdir(exist_ok=True)  # not its parents: without them the run is over
    path.mkdir()
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def _naming_a_full_disk(folder: Path) -> Iterator[None]:
    """Report a full disk: NumPy's own error only counts written items."""
    try:
        yield
    except OSError as error:
        if error.errno is None and shutil.disk_usage(folder).free < LEAST_FREE_BYTES:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder)) from error
        raise


def _write_files(work: Work, task: Task, scratch: Path) -> list[dict[str, Any]]:
    """Write all files of a shard; return the drawn values of each sequence."""
    recipe = work.recipe
    writer = shard_writer(recipe, task.shard, scratch)
    tables = ShardTables(recipe, task.shard, scratch, writer.locate)
    drawn = []
    try:
        for position, number in enumerate(task.shard.sequences):
            sequence = draw_sequence(recipe, number)
            folder = scratch / folder_of(task.shard, number)
            renderer = work.renderer.with_scene(sequence.scene)
            _write_sequence(recipe, sequence, position, renderer, writer, tables, folder)
            work.check_inputs()  # sequences read them anew
            drawn.append(_sequence_record(sequence, task.shard))
        tables.close()
        writer.finish()
    except BaseException:
        writer.abandon()
        raise
    return drawn


def _write_sequence(
    recipe: Recipe,
    sequence: Sequence,
    position: int,
    renderer: Renderer,
    writer: ShardWriter,
    tables: ShardTables,
    folder: Path,
) -> None:
    """Render a sequence, some frames at a time, and write its images and tables."""
    writer.begin(sequence, position)
    with sequence_animations(recipe, sequence, folder) as add_to_animations:
        for frames in _rendered(recipe, sequence, renderer):
            rows = tables.add(sequence, position, frames)
            writer.add(frames, planes_of(recipe, frames), rows["truth"])
            if recipe.satnet:
                write_satnet(frames, rows, folder)
            add_to_animations(frames)
    writer.end()
    tables.end_sequence(sequence)


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


def _sequence_record(sequence: Sequence, shard: Shard) -> dict[str, Any]:
    return {
        "sequence": sequence.number,
        "split": shard.split,
        "shard": shard.name,
        "sensors": sequence.sensors,
        "start_s": sequence.scene.frames.start_s,
        "seed": sequence.scene.seed,
        "attempt": sequence.attempt,
        "values": sequence.values,
    }
