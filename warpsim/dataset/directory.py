"""Directory of a data set: its state, its lock, and cleaning before a run.

Each shard has a checkpoint record with the checksums of its files. While a run is unfinished the records are in
`.warpsim-parts`; the manifest includes them, and is written last.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from warpsim.dataset.identity import Identity, difference, key_of
from warpsim.dataset.layout import (
    CHECKPOINTS,
    COCO,
    MANIFEST,
    PARTS,
    PLANNED,
    RUN,
    SEQUENCES,
    WORK,
    shards_of,
    top_names,
)
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.shard import FINISH, CheckpointRecord, checkpoint_path, planned_path
from warpsim.errors import InputError
from warpsim.files import partial_path, read_json, write_json
from warpsim.output.checkpoints import clear, has_key, is_record, locked, remove_files, which_match


@dataclass(frozen=True)
class DatasetDirectory:
    """Directory of a data set."""

    folder: Path
    recipe: Recipe
    identity: Identity
    """All that the files depend on."""

    @cached_property
    def key(self) -> str:
        """Hash of the identity."""
        return key_of(self.identity)

    @property
    def parts(self) -> Path:
        """Folder of what a run needs while it is unfinished."""
        return self.folder / PARTS

    @property
    def manifest_path(self) -> Path:
        """Written last: its presence means that the data set is complete."""
        return self.folder / MANIFEST

    def is_complete(self) -> bool:
        """True when the folder holds this very data set, whole and undamaged."""
        manifest = read_json(self.manifest_path)
        if not has_key(manifest, self.key) or not self._shard_records(manifest):
            return False
        records = {"": manifest["files"], **self._shard_records(manifest)}
        return all(which_match(self.folder, records).values())

    @contextlib.contextmanager
    def locked_for_run(self, overwrite: bool) -> Iterator[dict[str, CheckpointRecord]]:
        """Lock the folder for a run; yield the checkpoint records of complete shards; clean up at the end.

        A run that failed before it wrote anything leaves nothing.

        Raises:
            InputError: The folder holds another data set and overwrite is not set, or files that warpsim did not write,
                or another run is writing to it.
        """
        self._check_no_rendered_run()
        with locked(self.folder, self.parts):
            try:
                self._make_room(overwrite)
                write_json({"key": self.key, "files": {}, **self.identity}, self.parts / RUN, lasting=True)
                self._take_up_manifest()
                yield self._checkpoints()
            except BaseException:
                if not self._has_begun():
                    with contextlib.suppress(OSError):  # it must not hide the reason
                        clear(self.parts)
                raise
            clear(self.parts)

    def _has_begun(self) -> bool:
        """Return whether any record of complete or planned files exists."""
        return any(any((self.parts / name).glob("*.json")) for name in (CHECKPOINTS, PLANNED))

    def _checkpoints(self) -> dict[str, CheckpointRecord]:
        """Checkpoint records of the shards whose files are there and undamaged, by the shard's name."""
        found = {}
        for shard in shards_of(self.recipe):
            record = read_json(checkpoint_path(self.folder, shard))
            if has_key(record, self.key) and record.get("shard") == shard.name:
                found[shard.name] = record
        whole = which_match(self.folder, {name: record["files"] for name, record in found.items()})
        return {name: record for name, record in found.items() if whole[name]}

    def _shard_records(self, manifest: Any) -> dict[str, dict[str, str]]:
        shards = manifest.get("shards")
        if not isinstance(shards, dict) or not all(has_key(record, manifest["key"]) for record in shards.values()):
            return {}
        return {name: record["files"] for name, record in shards.items()}

    def _take_up_manifest(self) -> None:
        """Turn the manifest of a data set with a damaged or missing file back into checkpoint records."""
        manifest = read_json(self.manifest_path)
        if not has_key(manifest, self.key):
            return
        for name in (CHECKPOINTS, PLANNED):
            (self.parts / name).mkdir(exist_ok=True)
        for shard in shards_of(self.recipe):
            if record := manifest.get("shards", {}).get(shard.name):
                write_json(record, checkpoint_path(self.folder, shard), lasting=True)
        # Without the manifest nothing else knows of the files that describe all shards.
        record = {"key": self.key, "files": manifest["files"]}
        write_json(record, planned_path(self.folder, FINISH), lasting=True)
        self.manifest_path.unlink()

    def _check_no_rendered_run(self) -> None:
        """Refuse a folder that holds a run of `render_to_folder`, finished or not."""
        for path in (self.manifest_path, self.parts / RUN):
            if is_record(record := read_json(path)) and "recipe" not in record:
                raise InputError("holds a rendered run, no data set; choose another folder").of(self.folder)

    def _make_room(self, overwrite: bool) -> None:
        """Make room for the data set: remove another one, if requested, never foreign files."""
        paths = [self.manifest_path, self.parts / RUN]
        paths += [path for folder in (CHECKPOINTS, PLANNED) for path in (self.parts / folder).glob("*.json")]
        runs = [record for record in map(read_json, paths) if is_record(record)]
        others = [run for run in runs if run["key"] != self.key]
        theirs = [name for run in others for name in _names(run)]
        if theirs and not overwrite:
            raise InputError(
                f"holds a different data set or run ({self._what_differs(others)}); choose another folder or pass "
                "--overwrite",
            ).of(self.folder)
        self._check_foreign(runs)
        if others:
            (self.parts / RUN).unlink(missing_ok=True)  # first: its workers may still be there, and end without it
            remove_files(self.folder, theirs)
            self.manifest_path.unlink(missing_ok=True)
            for name in (CHECKPOINTS, PLANNED, COCO):
                shutil.rmtree(self.parts / name, ignore_errors=True)
        shutil.rmtree(self.parts / WORK, ignore_errors=True)
        for name in (SEQUENCES, MANIFEST):
            partial_path(self.folder / name).unlink(missing_ok=True)

    def _what_differs(self, others: list[dict[str, Any]]) -> str:
        """Short description of the first difference."""
        for run in others:
            if "recipe" in run:
                return difference({name: run.get(name) for name in self.identity}, self.identity) or "other key"
        return "other recipe, inputs, device or versions"

    def _check_foreign(self, runs: list[dict[str, Any]]) -> None:
        """Check that existing files of the data set's names were written by one of these runs."""
        if self.manifest_path.exists() and not is_record(read_json(self.manifest_path)):
            raise InputError("is damaged, or not of warpsim; choose another folder, or empty this one").of(
                self.manifest_path
            )
        ours = {name for run in runs for name in _names(run)} | {MANIFEST}
        for name in top_names(self.recipe):
            if (self.folder / name).is_symlink():
                raise InputError("must not be a link: the files behind it may be others'").of(self.folder / name)
            if (self.folder / name).exists() and not any(f"{known}/".startswith(f"{name}/") for known in ours):
                raise InputError("is there already, and warpsim did not write it").of(self.folder / name)


def _names(run: dict[str, Any]) -> list[str]:
    """Files that a manifest or checkpoint record says were written."""
    shards = run.get("shards")
    records = [record for record in shards.values() if is_record(record)] if isinstance(shards, dict) else []
    return [*run["files"], *(name for record in records for name in record["files"])]
