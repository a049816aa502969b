"""The folder of a run or a data set: one lock, checkpoint records, a manifest, and nothing of others ever touched.

Work is divided into shards: a sensor of a run, some sequences of a data set. The files of a shard are made in a folder
below PARTS; complete, they are recorded with their checksums and moved to their final paths. The manifest comes last.
So a folder whose run was killed at any moment holds no half file under a final name, and the same command makes what
has no record, or not all of its files.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import itertools
import json
import os
import shutil
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from warpsim.errors import InputError
from warpsim.files import partial_path, prepare_folder, read_json, sha256_of, write_json
from warpsim.output.checkpoints import check_no_link, clear, has_key, is_record, locked, remove_files, which_match

PARTS = ".warpsim-parts"
"""Folder of what a run needs while it is unfinished."""

RUN = "run.json"
"""In PARTS: the run that the folder is locked for."""

FINISH = "finish.json"
"""There: names of the files to come that describe all shards."""

CHECKPOINTS, WORK, GROWING = "checkpoints", "work", "growing"
"""Folders there: checkpoint records of shards, incomplete files, and those that grow."""

MANIFEST = "manifest.json"

LEAST_FREE_BYTES = 2**20
"""A disk with less room is full."""

CheckpointRecord = dict[str, Any]
"""What is known of a shard: key, shard, files with their checksums, and more facts."""


class Job(Protocol):
    """What is written into a folder."""

    @property
    def claimed_names(self) -> list[str]:
        """Files and folders that must be the job's own, relative to the folder."""

    def records_of(self, folder: OutputFolder, manifest: dict[str, Any]) -> dict[str, CheckpointRecord]:
        """Return the checkpoint records of a finished run of this job, of which some file is damaged or missing."""

    def write_missing(self, folder: OutputFolder, records: dict[str, CheckpointRecord]) -> None:
        """Write the shards without a record, and add their records."""

    def finish(self, folder: OutputFolder, records: dict[str, CheckpointRecord]) -> dict[str, Any]:
        """Write the files that describe all shards, once they are planned; return the manifest."""


@dataclass(frozen=True)
class OutputFolder:
    """Folder of a run or a data set."""

    path: Path
    identity: dict[str, Any]
    """All that the bytes of the files depend on, as plain values; that of a data set has a `recipe`."""

    @cached_property
    def key(self) -> str:
        """SHA-256 of the identity."""
        return hashlib.sha256(json.dumps(self.identity, sort_keys=True).encode()).hexdigest()

    @property
    def parts(self) -> Path:
        """Folder of what a run needs while it is unfinished."""
        return self.path / PARTS

    @property
    def manifest_path(self) -> Path:
        """Written last: its presence means that the folder is complete."""
        return self.path / MANIFEST

    def checkpoint_path(self, shard: str) -> Path:
        """Path of the checkpoint record of a shard."""
        return self.parts / CHECKPOINTS / f"{shard}.json"

    def growing_path(self, shard: str) -> Path:
        """Folder of the files of a shard that grow; of this very run."""
        return self.parts / GROWING / self.key[:16] / shard

    def write(self, job: Job, overwrite: bool) -> None:
        """Do a job, or what an earlier run has left of it.

        Raises:
            InputError: The folder cannot be written, is in use, holds another run and overwrite is not set, files of
                others under names of the job, or files of others alone.
            OSError: Writing failed on the way; the same job goes on from there.
        """
        if self.is_complete():
            self._tidy()
            return
        claimed = job.claimed_names  # before the folder: an error where some are no names of files
        prepare_folder(self.path)
        try:
            with self._locked_for(job, claimed, overwrite) as records:
                job.write_missing(self, records)
                write_json(job.finish(self, records), self.manifest_path, lasting=True)
        except OSError as error:
            raise OSError(f"{self.path}: writing failed, the same command goes on from here: {error}") from error

    def is_complete(self) -> bool:
        """True when the folder holds this very run, whole and undamaged."""
        manifest = read_json(self.manifest_path)
        if not has_key(manifest, self.key):
            return False
        shards = manifest.get("shards", {})
        if not isinstance(shards, dict) or not all(has_key(record, self.key) for record in shards.values()):
            return False
        records = {"": manifest["files"], **{name: record["files"] for name, record in shards.items()}}
        return all(which_match(self.path, records).values())

    @contextlib.contextmanager
    def scratch(self, shard: str) -> Iterator[Path]:
        """Make a folder of this process for the incomplete files of a shard; remove it at last."""
        path = self.parts / WORK / f"{shard}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
        path.parent.mkdir(exist_ok=True)  # not its parents: without them the run is over
        path.mkdir()
        try:
            with self.naming_full_disk():
                yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)

    @contextlib.contextmanager
    def naming_full_disk(self) -> Iterator[None]:
        """Report a full disk as such: NumPy's own error only counts written items."""
        try:
            yield
        except OSError as error:
            if error.errno is None and shutil.disk_usage(self.path).free < LEAST_FREE_BYTES:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path)) from error
            raise

    def move_in(self, shard: str, scratch: Path, names: Sequence[str], **facts: Any) -> CheckpointRecord:
        """Give the complete files of a shard their final paths; return its record, with more facts, which is written.

        The record comes first: by it a later run knows the files, however many have their paths by then.

        Raises:
            InputError: One of the paths is taken by a file of somebody else, or leads through a link.
            OSError: The run is over, or the files cannot be moved.
        """
        checksums = {name: sha256_of(scratch / name) for name in names}
        n_byte = sum((scratch / name).stat().st_size for name in names)
        current_record(self.path, self.key)
        records = [read_json(path) for path in (self.checkpoint_path(shard), self.parts / FINISH)]
        known = {name for record in records if is_record(record) for name in record["files"]}
        for name in names:
            check_no_link(*(self.path / folder for folder in Path(name).parents if folder != Path()))
            if name not in known and (self.path / name).exists():
                raise InputError("is there already, and warpsim did not write it").of(self.path / name)
        record = {"key": self.key, "shard": shard, "files": checksums, "bytes": n_byte, **facts}
        self._write_record(record)
        for name in names:
            (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            (scratch / name).replace(self.path / name)
        return record

    def plan_finish(self, files: dict[str, Any]) -> None:
        """Write down which files that describe all shards are about to be written."""
        write_json({"key": self.key, "files": files}, self.parts / FINISH, lasting=True)

    def _write_record(self, record: CheckpointRecord) -> None:
        path = self.checkpoint_path(record["shard"])
        path.parent.mkdir(exist_ok=True)  # not its parents: without them the run is over
        write_json(record, path, lasting=True)

    @contextlib.contextmanager
    def _locked_for(self, job: Job, claimed: list[str], overwrite: bool) -> Iterator[dict[str, CheckpointRecord]]:
        """Lock the folder; yield the records of complete shards; clean up at the end, or if nothing was begun."""
        self._check_kind()
        with locked(self.path, self.parts):
            try:
                self._make_room(claimed, overwrite)
                write_json({"key": self.key, "files": {}, **self.identity}, self.parts / RUN, lasting=True)
                self._take_up_manifest(job)
                yield self._checkpoints()
            except BaseException:
                if not self._has_begun():
                    with contextlib.suppress(OSError):  # it must not hide the reason
                        clear(self.parts)
                raise
            clear(self.parts)

    def _check_kind(self) -> None:
        """Check that a data set does not replace a rendered run, or the other way round."""
        kinds = ("rendered run", "data set")
        own = kinds["recipe" in self.identity]
        for path in (self.manifest_path, self.parts / RUN):
            if is_record(record := read_json(path)) and own != (there := kinds["recipe" in record]):
                raise InputError(f"holds a {there}, no {own}; choose another folder").of(self.path)

    def _make_room(self, claimed: list[str], overwrite: bool) -> None:
        """Make room: remove a different run, if requested, never foreign files."""
        paths = [self.manifest_path, self.parts / RUN, self.parts / FINISH, *self.parts.glob(f"{CHECKPOINTS}/*.json")]
        runs = [record for record in map(read_json, paths) if is_record(record)]
        others = [run for run in runs if run["key"] != self.key]
        theirs = [name for run in others for name in _names(run)]
        growing = [path for path in self._journals() if self.key[:16] not in path.parts]
        if (theirs or growing) and not overwrite:
            described = (run for run in others if self.identity.keys() & run.keys())
            pairs = ({name: run.get(name) for name in self.identity} for run in described)
            differs = next((difference(there, self.identity) for there in pairs), None)
            kind = "data set" if "recipe" in self.identity else "run"
            raise InputError(
                f"holds a different {kind} ({differs or 'other inputs, device or versions'}); choose another folder or "
                "pass --overwrite"
            ).of(self.path)
        self._check_foreign(claimed, {name for run in runs for name in _names(run)} | ({MANIFEST} if runs else set()))
        if not (runs or self._journals()):
            self._check_empty()
        if others or growing:
            (self.parts / RUN).unlink(missing_ok=True)  # first: its workers may still be there, and end without it
            remove_files(self.path, theirs)
            self.manifest_path.unlink(missing_ok=True)
            clear(self.parts, with_lock=False)
        shutil.rmtree(self.parts / WORK, ignore_errors=True)
        for name in claimed:
            if "/" not in name:
                partial_path(self.path / name).unlink(missing_ok=True)

    def _check_empty(self) -> None:
        """Check that a folder without a run holds nothing: files are not to be scattered among those of others."""
        names = sorted(path.name for path in self.path.iterdir() if not path.name.startswith("."))
        if names:
            rule = f"is not empty (it holds {names[0]}), and warpsim did not write it; choose a new or an empty folder"
            raise InputError(rule).of(self.path)

    def _check_foreign(self, claimed: list[str], ours: set[str]) -> None:
        """Check that what exists of the claimed names was written by earlier runs."""
        if self.manifest_path.exists() and not is_record(read_json(self.manifest_path)):
            rule = "is there already, and warpsim did not write it, or it is damaged; choose another folder"
            raise InputError(rule).of(self.manifest_path)
        known = ours | {folder.as_posix() for name in ours for folder in Path(name).parents}
        for name in claimed:
            path = self.path / name
            folders = [self.path / folder for folder in Path(name).parents if folder != Path()]
            check_no_link(path, *folders)
            taken = path if path.exists() and name not in known else next(filter(Path.is_file, folders), None)
            if taken is not None:
                raise InputError("is there already, and warpsim did not write it").of(taken)

    def _take_up_manifest(self, job: Job) -> None:
        """Turn the manifest of a run with a damaged or missing file back into checkpoint records."""
        manifest = read_json(self.manifest_path)
        if not has_key(manifest, self.key):
            return
        for record in job.records_of(self, manifest).values():
            self._write_record(record)
        # Without the manifest nothing else knows of the files that describe all shards.
        self.plan_finish(manifest["files"])
        self.manifest_path.unlink()

    def _checkpoints(self) -> dict[str, CheckpointRecord]:
        """Return the records of the shards whose files are there and undamaged."""
        read = {path.stem: read_json(path) for path in self.parts.glob(f"{CHECKPOINTS}/*.json")}
        found = {shard: record for shard, record in read.items() if has_key(record, self.key)}
        whole = which_match(self.path, {name: record["files"] for name, record in found.items()})
        return {name: record for name, record in found.items() if whole[name]}

    def _has_begun(self) -> bool:
        """Return whether anything is there that a later run can go on from."""
        recorded = any(self.parts.glob(f"{CHECKPOINTS}/*.json"))
        return recorded or (self.parts / FINISH).exists() or bool(self._journals())

    def _journals(self) -> list[Path]:
        """Return the journals of growing files, of any run, that hold something."""
        return [path for path in (self.parts / GROWING).glob("*/*/journal") if path.stat().st_size > 0]

    def _tidy(self) -> None:
        """Remove what is left of a run that was killed at its very end; ignore failures."""
        if self.parts.exists():
            with contextlib.suppress(InputError, OSError), locked(self.path, self.parts):
                if self.is_complete():
                    clear(self.parts)


def current_record(folder: Path, key: str) -> dict[str, Any]:
    """Return the record of the run that a folder is locked for, which must have this key.

    Raises:
        OSError: It is another one, or none: a late worker has nothing to do here any more.
    """
    record = read_json(folder / PARTS / RUN)
    if not has_key(record, key):
        raise OSError(f"{folder}: no longer belongs to this run")
    return dict(record)


def _names(run: dict[str, Any]) -> list[str]:
    """Files that a manifest or checkpoint record says were written."""
    shards = run.get("shards")
    records = [record for record in shards.values() if is_record(record)] if isinstance(shards, dict) else []
    return [*run["files"], *(name for record in records for name in record["files"])]


def difference(there: Any, here: Any, path: str = "") -> str | None:
    """Describe the first field in which two identities differ; None where they do not."""
    if isinstance(there, dict) and isinstance(here, dict):
        names = {f"{path}.{name}".removeprefix("."): name for name in dict.fromkeys([*there, *here])}
        items = (difference(there.get(name), here.get(name), inner) for inner, name in names.items())
        return next(filter(None, items), None)
    if isinstance(there, list) and isinstance(here, list):
        pairs = enumerate(itertools.zip_longest(there, here))
        return next(filter(None, (difference(a, b, f"{path}[{i}]") for i, (a, b) in pairs)), None)
    return None if there == here else f"{path.removeprefix('recipe.')}: {_shown(there)} there, {_shown(here)} here"


def _shown(value: Any) -> str:
    if value is None:
        return "not set"
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
