"""What a run will write, and what of it is already there.

The unit of work is a sensor. Its receipt holds the checksums of its files, and is written when they have their final
names. All receipts and the manifest carry the key of the run: a hash of everything that the files depend on.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warpsim.arguments import chosen_names
from warpsim.errors import InputError
from warpsim.files import partial_path, read_json, sha256_of, write_json
from warpsim.render.renderer import Renderer
from warpsim.scene.inputs import input_checksums
from warpsim.scene.scene import Scene

_PARTS = ".warpsim-parts"


@dataclass(frozen=True)
class Plan:
    """What a run will write."""

    scene: Scene
    folder: Path
    bands: list[str]
    frames_of: dict[str, list[int]]
    """Frames of each sensor: those asked for in which it has access."""
    key: str
    """Hash of all that the files depend on."""
    tables: tuple[str, ...] = ("truth",)
    """Tables beside the images: "truth" (targets), and "stars" when wanted."""

    @property
    def n_image(self) -> int:
        """Images of the whole run."""
        return sum(len(numbers) for numbers in self.frames_of.values()) * len(self.bands)

    @property
    def parts(self) -> Path:
        """Folder of what a run needs while it is unfinished."""
        return self.folder / _PARTS

    @property
    def manifest_path(self) -> Path:
        """Written last: its presence means that the run is complete."""
        return self.folder / "manifest.json"

    def table_path(self, table: str) -> Path:
        """A table of all sensors."""
        return self.folder / f"{table}.fits"

    @property
    def names(self) -> list[str]:
        """Names of all files of the finished run."""
        cubes = [path.name for sensor in self.frames_of for path in self.cube_paths(sensor)]
        tables = [self.table_path(table).name for table in self.tables]
        return [*cubes, *tables, self.sheet_path.name, self.manifest_path.name]

    @property
    def sheet_path(self) -> Path:
        """The contact sheet."""
        return self.folder / "contact_sheet.png"

    def cube_paths(self, sensor: str) -> list[Path]:
        """The cubes of a sensor, by band."""
        return [self.folder / f"{sensor}_{band}.fits" for band in self.bands]

    def part_paths(self, sensor: str) -> list[Path]:
        """The tables of one sensor, until all are there."""
        return [self.parts / f"{sensor}_{table}.fits" for table in self.tables]

    def receipt_path(self, sensor: str) -> Path:
        """The receipt of a sensor."""
        return self.parts / f"{sensor}.json"


def make_plan(
    renderer: Renderer,
    folder: Path,
    frames: Sequence[int] | None,
    sensors: Sequence[str] | None,
    bands: Sequence[str] | None,
    stars: bool,
    every_frame: bool = False,
) -> Plan:
    """Decide what a run writes; None means all of the scene.

    Raises:
        InputError: A bad name or number, or no access at all.
    """
    import warpsim

    scene = renderer.scene
    numbers = renderer.checked_frames(range(scene.frames.count) if frames is None else frames)
    if not numbers:
        raise InputError("frames: must name at least one")
    # Frames of a cube and files of a run are written once each, however often they are named.
    numbers = list(dict.fromkeys(numbers))
    sensor_list = list(dict.fromkeys(chosen_names("sensors", sensors, scene.sensor_names)))
    band_list = list(dict.fromkeys(chosen_names("bands", bands, list(scene.bands))))
    times = scene.frame_time_s(numbers)
    always = np.ones(len(times), dtype=bool)
    seen = {sensor: always if every_frame else scene.has_access(sensor, times) for sensor in sensor_list}
    frames_of = {
        sensor: [number for number, ok in zip(numbers, has_access, strict=True) if ok]
        for sensor, has_access in seen.items()
        if has_access.any()
    }
    if not frames_of:
        raise InputError(
            "frames: no sensor has access to the main target in any of them; `warpsim access` lists when, "
            "`warpsim check` says why not, --every-frame renders all the same"
        )
    device = "cuda" if renderer.device.is_cuda else "cpu"
    tables = ("truth", "stars") if stars else ("truth",)
    facts = [scene.to_dict(), input_checksums(scene), renderer.catalog.checksum, frames_of, band_list, device, tables]
    facts.append(warpsim.__version__)
    key = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return Plan(scene, folder, band_list, frames_of, key, tables)


def is_complete(plan: Plan) -> bool:
    """True when the folder holds this very run, whole and undamaged."""
    manifest = read_json(plan.manifest_path)
    return _has_key(plan, manifest) and _files_match(plan.folder, manifest["files"])


@contextlib.contextmanager
def working_on(plan: Plan, overwrite: bool) -> Iterator[None]:
    """Make the folder ready for the plan, keeping what an unfinished or damaged run of it left, and lock it.

    Raises:
        InputError: The folder holds a different run and overwrite is not set, or files that warpsim did not write, or
            another run is writing to it.
    """
    plan.parts.mkdir(exist_ok=True)
    with (plan.parts / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{plan.folder}: another run is writing to it") from None
        try:
            _make_room(plan, overwrite)
        except InputError:
            if [path.name for path in plan.parts.iterdir()] == ["lock"]:
                shutil.rmtree(plan.parts)
            raise
        write_json({"key": plan.key, "files": dict.fromkeys(plan.names)}, plan.parts / "run.json")
        _restore_receipts(plan)
        yield
        shutil.rmtree(plan.parts)


def has_receipt(plan: Plan, sensor: str) -> bool:
    """True when the sensor's files are there and undamaged."""
    receipt = read_json(plan.receipt_path(sensor))
    return _has_key(plan, receipt) and _files_match(plan.folder, receipt["files"])


def write_receipt(plan: Plan, sensor: str) -> None:
    """Say that the sensor's files are complete."""
    written = [*plan.cube_paths(sensor), *plan.part_paths(sensor)]
    checksums = {str(path.relative_to(plan.folder)): sha256_of(path) for path in written}
    write_json({"key": plan.key, "files": checksums}, plan.receipt_path(sensor))


def _has_key(plan: Plan, item: Any) -> bool:
    """True for a manifest or receipt of this plan."""
    return isinstance(item, dict) and item.get("key") == plan.key and isinstance(item.get("files"), dict)


def _files_match(folder: Path, checksums: dict[str, str]) -> bool:
    paths = {folder / name: checksum for name, checksum in checksums.items()}
    return all(path.is_file() and sha256_of(path) == checksum for path, checksum in paths.items())


def _make_room(plan: Plan, overwrite: bool) -> None:
    """See that the plan's files are ours to write: remove a different run, if that is wanted, never foreign files."""
    records = [_record(path) for path in (plan.manifest_path, *plan.parts.glob("*.json"))]
    runs = [record for record in records if record is not None]
    if any(run["key"] != plan.key for run in runs) and not overwrite:
        raise InputError(
            f"{plan.folder}: holds a different run (other scene, catalog, frames, bands, tables, device or version); "
            "choose another folder or pass --overwrite"
        )
    ours = {name for run in runs for name in run["files"]} | ({plan.manifest_path.name} if runs else set())
    for name in plan.names:
        if (plan.folder / name).exists() and name not in ours:
            raise InputError(f"{plan.folder / name}: is there already, and warpsim did not write it")
    stale = {name for run in runs if run["key"] != plan.key for name in run["files"]}
    for name in stale:
        (plan.folder / name).unlink(missing_ok=True)
    if stale:
        plan.manifest_path.unlink(missing_ok=True)
        for path in plan.parts.iterdir():
            if path.name != "lock":
                path.unlink()
    for name in plan.names:
        partial_path(plan.folder / name).unlink(missing_ok=True)


def _record(path: Path) -> Any:
    """What a manifest or receipt says, None unless warpsim wrote it: a key, and plain names of files of a run."""
    record = read_json(path)
    if not isinstance(record, dict) or not isinstance(record.get("files"), dict):
        return None
    if not re.fullmatch("[0-9a-f]{64}", str(record.get("key"))):
        return None
    plain = re.compile(rf"({re.escape(_PARTS)}/)?[A-Za-z0-9_.-]+\.(fits|png|json)")
    return record if all(plain.fullmatch(name) for name in record["files"]) else None


def _restore_receipts(plan: Plan) -> None:
    """Of a complete run with a damaged or missing file, keep the sensors that are whole."""
    from astropy.table import Table

    manifest = _record(plan.manifest_path)
    if manifest is None:
        return
    checksums = manifest["files"]

    def whole(paths: list[Path]) -> bool:
        return _files_match(plan.folder, {path.name: checksums.get(path.name, "") for path in paths})

    paths = [plan.table_path(table) for table in plan.tables]
    if whole(paths):
        tables = [Table.read(path) for path in paths]
        for sensor in plan.frames_of:
            if whole(plan.cube_paths(sensor)):
                for table, part in zip(tables, plan.part_paths(sensor), strict=True):
                    rows = np.asarray(table["sensor"]).astype(str) == sensor
                    table[rows].write(part, format="fits", overwrite=True)
                write_receipt(plan, sensor)
    plan.manifest_path.unlink()
