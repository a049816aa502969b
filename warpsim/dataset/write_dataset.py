"""Write a data set into a folder, resumable after an interruption at any moment."""

from __future__ import annotations

import importlib.util
import json
import shutil
import time
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from platform import python_version
from typing import Any

from warpsim.arguments import whole_number
from warpsim.dataset.execution import run_tasks
from warpsim.dataset.layout import (
    ANNOTATIONS,
    COCO,
    SEQUENCES,
    check_extremes,
    dataset_provenance,
    identity_of,
    shards_of,
    split_of,
    writers_of,
)
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.shard import Task, shard_texts
from warpsim.dataset.writers import array_shapes, create_store, store_path
from warpsim.errors import InputError
from warpsim.files import read_json, sha256_of
from warpsim.labels.coco import coco_categories, write_coco_parts
from warpsim.labels.table import write_parquet
from warpsim.output.formats import FORMATS, PREVIEWS
from warpsim.output.output_folder import CHECKPOINTS, MANIFEST, CheckpointRecord, OutputFolder
from warpsim.output.summary import left_out_rows, response_facts
from warpsim.output.wording import progress_bar
from warpsim.render.device import default_device, n_usable_cpu
from warpsim.scene.scene import Scene


@dataclass(frozen=True)
class DatasetReport:
    """Report of a run."""

    folder: Path
    n_sequence: int
    n_image: int
    n_byte: int
    """Of images and tables, but for annotations and the like."""
    n_shard: int
    n_shard_written: int
    """Less than n_shard when an earlier run had written some."""
    total_s: float

    def text(self) -> str:
        """One line for a person."""
        words = (
            f"{self.n_image:,} images of {self.n_sequence:,} sequences, {self.n_byte / 1e6:,.1f} MB in {self.folder}"
        )
        line = f"{words} after {self.total_s:.1f} s"
        if self.n_shard_written == 0:
            return f"{line}; all were there already"
        kept = self.n_shard - self.n_shard_written
        return line + (f"; {kept} of {self.n_shard} shards kept from before" if kept else "")


def write_dataset(
    recipe: Recipe | Scene | str,
    folder: str | Path,
    executor: Executor | None = None,
    n_worker: int | None = None,
    device: Any = None,
    overwrite: bool = False,
    progress: bool = False,
) -> DatasetReport:
    """Write a data set: images, tables, annotations and a manifest (docs/datasets.md has the layout).

    Running it again writes what has no valid checkpoint record. The files do not depend on the
    workers, their order, or interruptions.

    Args:
        recipe: The recipe; a scene stands for one that samples nothing. A name or path is loaded.
        folder: Where to write; made when missing.
        executor: Any executor of `concurrent.futures`, whose workers must see the folder under the same path.
        n_worker: Processes on this machine where no executor is given; as many as cores, or 1 on a GPU, when left out.
            With 1 this process does the work. With more, a script must start its work under
            `if __name__ == "__main__":`, as always with `multiprocessing`.
        device: Warp device of each worker.
        overwrite: Replace a different data set that the folder holds.
        progress: Draw a progress bar on standard error; where that is no terminal, print a line each 30 s.

    Returns:
        Report of the run.

    Raises:
        InputError: The recipe asks for what cannot be, or the folder cannot be written, is in use, or holds another
            data set or files of these names that are not of warpsim.
        OSError: Writing failed on the way (a full disk), or workers were lost; the same call goes on from there.
    """
    begin = time.perf_counter()
    if not isinstance(recipe, Recipe):
        recipe = Recipe(scene=recipe) if isinstance(recipe, Scene) else Recipe.load(recipe)
    alias = str(default_device(device))
    if executor is not None and n_worker is not None:
        raise InputError("must be left out with an executor, which has workers of its own", "n_worker", n_worker)
    if n_worker is None:
        n_worker = 1 if alias.startswith("cuda") else n_usable_cpu()
    n_worker = whole_number("n_worker", n_worker, 1)
    _check_packages(recipe)
    check_extremes(recipe)
    output = OutputFolder(Path(folder).absolute(), identity_of(recipe, alias))
    dataset = _Dataset(recipe, alias, executor, n_worker, progress)
    output.write(dataset, overwrite)
    shards = read_json(output.manifest_path)["shards"]
    n_byte = sum(record["bytes"] for record in shards.values())
    total_s = time.perf_counter() - begin
    n_written = dataset.n_shard_written
    return DatasetReport(output.path, recipe.n_sequence, recipe.n_image, n_byte, len(shards), n_written, total_s)


@dataclass
class _Dataset:
    """The work of a data set; a shard is some sequences."""

    recipe: Recipe
    device: str
    executor: Executor | None
    n_worker: int
    progress: bool
    n_shard_written: int = 0

    @property
    def claimed_names(self) -> list[str]:
        """Top-level entries."""
        return [*self.recipe.ratios, ANNOTATIONS, SEQUENCES, MANIFEST]

    def records_of(self, folder: OutputFolder, manifest: dict[str, Any]) -> dict[str, CheckpointRecord]:
        """Return the records in the manifest."""
        shards = manifest.get("shards")
        return shards if isinstance(shards, dict) else {}

    def write_missing(self, folder: OutputFolder, records: dict[str, CheckpointRecord]) -> None:
        """Write the missing shards, and collect their records."""
        missing = [shard for shard in shards_of(self.recipe) if shard.name not in records]
        self.n_shard_written = len(missing)
        n_thread = None if self.executor is None and self.n_worker == 1 else 1
        tasks = [Task(str(folder.path), folder.key, shard, self.device, n_thread) for shard in missing]
        n_sequence = {shard.name: len(shard.sequences) for shard in missing}
        for name in (CHECKPOINTS, COCO):
            (folder.parts / name).mkdir(exist_ok=True)
        with progress_bar(self.recipe.n_sequence, self.progress, "sequences") as advance:
            advance(self.recipe.n_sequence - sum(n_sequence.values()))

            def done(record: CheckpointRecord) -> None:
                records[record["shard"]] = record
                advance(n_sequence[record["shard"]])

            run_tasks(tasks, self.executor, self.n_worker, done)

    def finish(self, folder: OutputFolder, records: dict[str, CheckpointRecord]) -> dict[str, Any]:
        """Write what describes all shards."""
        recipe = self.recipe
        folder.plan_finish(dict.fromkeys(_planned_names(recipe)))
        files = [
            *_write_stores(recipe, folder.path, folder.parts),
            *_write_annotations(recipe, folder.path, records),
            _write_sequences(recipe, folder.path, records),
        ]
        return {
            "key": folder.key,
            "provenance": dataset_provenance(recipe),
            **folder.identity,
            "python": python_version(),
            "splits": split_of(recipe),
            "responses": {name: response_facts(band) for name, band in recipe.scene.scenario.bands.items()},
            "left_out": left_out_rows(recipe.scenario),
            "files": {path.relative_to(folder.path).as_posix(): sha256_of(path) for path in files},
            "shards": {shard.name: records[shard.name] for shard in shards_of(recipe)},
        }


def _check_packages(recipe: Recipe) -> None:
    """Check that the packages that write the files are installed, before the work."""
    for form in filter(None, (FORMATS.get(recipe.format), PREVIEWS.get(recipe.preview or ""))):
        form.check()
    for package in writers_of(recipe):
        if importlib.util.find_spec(package) is None:
            raise InputError("pip install 'warpsim[datasets]'", f"data sets need {package}, which is not installed")


def _planned_names(recipe: Recipe) -> list[str]:
    """Names of the files that describe all shards, but for the manifest."""
    names = [SEQUENCES, *(f"{ANNOTATIONS}/{split}.json" for split in (recipe.ratios if recipe.coco else ()))]
    if recipe.format == "zarr":
        parts = ("", *(f"{name}/" for name in array_shapes(recipe)))
        names += [f"{store_path(split)}/{part}zarr.json" for split in recipe.ratios for part in parts]
    return names


def _write_stores(recipe: Recipe, folder: Path, parts: Path) -> list[Path]:
    """The descriptions of Zarr groups; the shards' files are there.

    They are made elsewhere and moved: what there is of an earlier try is replaced, file by file.
    """
    if recipe.format != "zarr":
        return []
    paths = []
    for split, numbers in split_of(recipe).items():
        if numbers:
            made = parts / "stores" / split
            shutil.rmtree(made, ignore_errors=True)
            create_store(recipe, split, made)
            for source in sorted(made.rglob("zarr.json")):
                path = folder / store_path(split) / source.relative_to(made)
                source.replace(path)
                paths.append(path)
    return paths


def _write_annotations(recipe: Recipe, folder: Path, records: dict[str, CheckpointRecord]) -> list[Path]:
    paths = []
    for split in recipe.ratios if recipe.coco else ():
        path = folder / ANNOTATIONS / f"{split}.json"
        path.parent.mkdir(exist_ok=True)
        info = {"description": recipe.scene.description or recipe.scene.name, "split": split}
        info |= dataset_provenance(recipe)
        texts = (
            shard_texts(recipe, folder, shard, records[shard.name].get("texts"))
            for shard in shards_of(recipe)
            if shard.split == split
        )
        write_coco_parts(path, texts, coco_categories(recipe.scenario), info)
        paths.append(path)
    return paths


def _write_sequences(recipe: Recipe, folder: Path, records: dict[str, CheckpointRecord]) -> Path:
    """The table of sequences: one column for each sampled field."""
    from astropy.table import Table

    rows = sorted((row for record in records.values() for row in record["sequences"]), key=lambda row: row["sequence"])
    own = ("sequence", "split", "shard", "epoch_utc", "start_s", "seed", "attempt")
    columns: dict[str, Any] = {name: [row[name] for row in rows] for name in own}
    columns["sensors"] = [",".join(row["sensors"]) for row in rows]
    for name in (field for field in recipe.distributions if field not in columns):
        values = [row["values"][name] for row in rows]
        plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
        columns[name] = (
            values if plain else [value if isinstance(value, str) else json.dumps(value) for value in values]
        )
    table = Table(columns)
    table["start_s"].unit = "s"
    path = folder / SEQUENCES
    write_parquet(table, path, {"table": "sequences", **dataset_provenance(recipe)})
    return path
