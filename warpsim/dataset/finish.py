"""Final files of a complete data set: stores, annotations, the table of sequences, the manifest."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from warpsim.dataset.annotations import shard_texts
from warpsim.dataset.layout import ANNOTATIONS, SEQUENCES, shards_of
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import split_of
from warpsim.files import sha256_of
from warpsim.labels.coco import coco_categories, write_coco_parts
from warpsim.output.manifest import python_version, response_facts
from warpsim.output.output_folder import FINISH, CheckpointRecord, OutputFolder


def finish(recipe: Recipe, output: OutputFolder, records: dict[str, CheckpointRecord]) -> dict[str, Any]:
    """Write what describes all shards; return the manifest."""
    folder = output.path
    output.plan(FINISH, dict.fromkeys(planned_names(recipe)))
    files = [*_write_stores(recipe, folder, output.parts), *_write_annotations(recipe, folder, records)]
    files.append(_write_sequences(recipe, folder, records))
    return {
        "key": output.key,
        **output.identity,
        "python": python_version(),
        "splits": split_of(recipe),
        "responses": {name: response_facts(band) for name, band in recipe.scene.scenario.bands.items()},
        "files": {path.relative_to(folder).as_posix(): sha256_of(path) for path in files},
        "shards": {shard.name: records[shard.name] for shard in shards_of(recipe)},
    }


def planned_names(recipe: Recipe) -> list[str]:
    """Names of the files that describe all shards, but for the manifest."""
    names = [SEQUENCES, *(f"{ANNOTATIONS}/{split}.json" for split in (recipe.ratios if recipe.coco else ()))]
    if recipe.format == "zarr":
        from warpsim.dataset.zarr_store import array_shapes, store_path

        parts = ("", *(f"{name}/" for name in array_shapes(recipe)))
        names += [f"{store_path(split)}/{part}zarr.json" for split in recipe.ratios for part in parts]
    return names


def _write_stores(recipe: Recipe, folder: Path, parts: Path) -> list[Path]:
    """The descriptions of Zarr groups; the shards' files are there.

    They are made elsewhere and moved: what there is of an earlier try is replaced, file by file.
    """
    if recipe.format != "zarr":
        return []
    from warpsim.dataset.zarr_store import create_store, store_path

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
    """COCO's annotations of each split."""
    paths = []
    for split in recipe.ratios if recipe.coco else ():
        path = folder / ANNOTATIONS / f"{split}.json"
        path.parent.mkdir(exist_ok=True)
        info = {"description": recipe.scene.description or recipe.scene.name, "split": split}
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

    from warpsim.labels.table import write_parquet

    rows = sorted((row for record in records.values() for row in record["sequences"]), key=lambda row: row["sequence"])
    columns: dict[str, Any] = {
        name: [row[name] for row in rows] for name in ("sequence", "split", "shard", "start_s", "seed", "attempt")
    }
    columns["sensors"] = [",".join(row["sensors"]) for row in rows]
    for name in recipe.distributions:
        values = [row["values"][name] for row in rows]
        plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
        columns[name] = (
            values if plain else [value if isinstance(value, str) else json.dumps(value) for value in values]
        )
    table = Table(columns)
    table["start_s"].unit = "s"
    path = folder / SEQUENCES
    write_parquet(table, path, {"table": "sequences"})
    return path
