"""State of a run's folder: complete sensors, leftovers of other runs, and foreign files.

A sensor's checkpoint record holds the checksums of its files, and is written when they have their final names.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from warpsim.errors import InputError
from warpsim.files import partial_path, read_json, sha256_of, write_json
from warpsim.output.checkpoints import clear, files_match, has_key, is_record, locked, remove_files
from warpsim.output.plan import PARTS, RunPlan


def is_complete(plan: RunPlan) -> bool:
    """True when the folder holds this very run, whole and undamaged."""
    manifest = read_json(plan.manifest_path)
    return has_key(manifest, plan.key) and files_match(plan.folder, manifest["files"])


@contextlib.contextmanager
def working_on(plan: RunPlan, overwrite: bool) -> Iterator[None]:
    """Prepare and lock the folder for the plan, keeping the complete parts of an unfinished or damaged run.

    Raises:
        InputError: The folder holds a different run and overwrite is not set, or files that warpsim did not write, or
            another run is writing to it.
    """
    with locked(plan.folder, plan.parts):
        try:
            _make_room(plan, overwrite)
        except InputError:
            if [path.name for path in plan.parts.iterdir()] == ["lock"]:
                clear(plan.parts)
            raise
        write_json({"key": plan.key, "files": dict.fromkeys(plan.names)}, plan.parts / "run.json")
        _restore_checkpoints(plan)
        yield
        clear(plan.parts)


def has_checkpoint(plan: RunPlan, sensor: str) -> bool:
    """True when the sensor's files are there and undamaged."""
    record = read_json(plan.checkpoint_path(sensor))
    return has_key(record, plan.key) and files_match(plan.folder, record["files"])


def write_checkpoint(plan: RunPlan, sensor: str) -> None:
    """Write the checkpoint record of a sensor with complete files."""
    parts = [str(path.relative_to(plan.folder)) for path in plan.part_paths(sensor)]
    checksums = {name: sha256_of(plan.folder / name) for name in [*plan.image_names(sensor), *parts]}
    write_json({"key": plan.key, "files": checksums}, plan.checkpoint_path(sensor))


def _make_room(plan: RunPlan, overwrite: bool) -> None:
    """Make room for the plan's files: remove a different run, if that is requested, never foreign files."""
    records = map(read_json, (plan.manifest_path, *plan.parts.glob("*.json")))
    runs = [record for record in records if is_record(record)]
    if any("recipe" in run for run in runs):
        raise InputError("holds a data set, no rendered run; choose another folder").of(plan.folder)
    if any(run["key"] != plan.key for run in runs) and not overwrite:
        raise InputError(
            "holds a different run (other scene, catalog, frames, bands, tables, formats, device or version); choose "
            "another folder or pass --overwrite",
        ).of(plan.folder)
    ours = {name for run in runs for name in run["files"]} | ({plan.manifest_path.name} if runs else set())
    foreign = next(_foreign(plan.folder, plan.names, ours), None)
    if foreign is not None:
        raise InputError("is there already, and warpsim did not write it").of(foreign)
    stale = {name for run in runs if run["key"] != plan.key for name in run["files"]}
    _remove_unfinished(plan.folder, stale)
    remove_files(plan.folder, stale)
    if stale:
        plan.manifest_path.unlink(missing_ok=True)
        for path in plan.parts.iterdir():
            if path.name != "lock":
                path.unlink()
    _remove_unfinished(plan.folder, plan.names)


def _foreign(folder: Path, names: Iterable[str], ours: set[str]) -> Iterator[Path]:
    """Paths of existing files of these names that warpsim did not write."""
    for name in names:
        if (folder / name).exists() and name not in ours:
            yield folder / name
    for top in _folders(names):
        path = folder / top
        if path.exists() and not path.is_dir():
            yield path
        elif path.suffix == ".zarr" and path.is_dir():  # replaced as a whole
            found = (item for item in path.rglob("*") if not item.is_dir())
            yield from (item for item in found if item.relative_to(folder).as_posix() not in ours)


def _folders(names: Iterable[str]) -> set[str]:
    """Folders of a run's files, other than that of its parts."""
    return {name.split("/")[0] for name in names if "/" in name} - {PARTS}


def _remove_unfinished(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        if (folder / name).parent.is_dir():
            partial_path(folder / name).unlink(missing_ok=True)
    for top in _folders(names):
        shutil.rmtree(partial_path(folder / top), ignore_errors=True)


def _restore_checkpoints(plan: RunPlan) -> None:
    """Restore the checkpoints of whole sensors of a complete run with a damaged or missing file."""
    from astropy.table import Table

    manifest = read_json(plan.manifest_path)
    if not is_record(manifest):
        return
    checksums = manifest["files"]

    def whole(names: list[str]) -> bool:
        return files_match(plan.folder, {name: checksums.get(name, "") for name in names})

    paths = [plan.table_path(table) for table in plan.tables]
    if whole([path.name for path in paths]):
        tables = [Table.read(path) for path in paths]
        for sensor in plan.frames_of:
            if whole(plan.image_names(sensor)):
                for table, part in zip(tables, plan.part_paths(sensor), strict=True):
                    rows = np.asarray(table["sensor"]).astype(str) == sensor
                    table[rows].write(part, format="fits", overwrite=True)
                write_checkpoint(plan, sensor)
    plan.manifest_path.unlink()
