"""Work of a worker: render a shard, write it, move its files to their final paths, return its checkpoint record."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from warpsim.dataset.layout import Shard, Stamp, folder_of, identity_of, input_files, stamp_of
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence, draw_sequence
from warpsim.dataset.shard_tables import ShardTables, keep_texts, write_satnet
from warpsim.dataset.writers import bytes_per_view, planes_of, shard_writer
from warpsim.errors import InputError
from warpsim.files import read_json
from warpsim.output.output_folder import PARTS, RUN, CheckpointRecord, OutputFolder, difference
from warpsim.render.frameset import FrameSet
from warpsim.render.renderer import Renderer

BYTES_PER_CALL = 64 * 2**20
"""Size of images held in memory at a time, with all requested planes."""


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
        record = output.move_in(shard.name, scratch, files) | {"sequences": sequences}
    if work.recipe.coco:
        record["texts"] = keep_texts(work.recipe, output.path, shard)
    output.write_record(record)
    return record


@dataclass(frozen=True)
class Work:
    """State that a worker keeps between shards of a run."""

    output: OutputFolder
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
    record = read_json(folder / PARTS / RUN)
    if not isinstance(record, dict) or record.get("key") != key:
        raise OSError(f"{folder}: no longer belongs to this run")
    recipe = Recipe.from_dict(record["recipe"])
    inputs = {path: stamp_of(path) for path in input_files(recipe)}
    output = OutputFolder(folder, identity_of(recipe, device))
    if output.key != key:
        differs = difference({name: record.get(name) for name in output.identity}, output.identity)
        raise InputError(f"this worker would write other files than the run was started for ({differs})").of(folder)
    return Work(output, recipe, Renderer(recipe.scene, device, n_thread), inputs)


def _write_files(work: Work, task: Task, scratch: Path) -> list[dict[str, Any]]:
    """Write all files of a shard; return the drawn values of each sequence."""
    recipe, shard = work.recipe, task.shard
    drawn = []
    with shard_writer(recipe, shard, scratch) as writer:
        tables = ShardTables(recipe, shard, scratch, writer.locate)
        for position, number in enumerate(shard.sequences):
            sequence = draw_sequence(recipe, number)
            for frames in _rendered(recipe, sequence, work.renderer.with_scene(sequence.scene)):
                rows = tables.add(sequence, position, frames)
                writer.add(sequence, position, frames, planes_of(recipe, frames), rows["truth"])
                if recipe.satnet:
                    write_satnet(frames, rows, scratch / folder_of(shard, number))
            tables.end_sequence(sequence)
            work.check_inputs()  # sequences read them anew
            drawn.append(_sequence_record(sequence, shard))
        tables.close()
        writer.finish()
    return drawn


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
