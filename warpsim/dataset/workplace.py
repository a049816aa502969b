"""The folder of a data set: what of it is already there, and room for the rest.

Each shard has a receipt with the checksums of its files. While a run is unfinished receipts lie in `.warpsim-parts`;
the manifest takes them up, and is written last.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpsim.dataset.layout import MANIFEST, PARTS, RUN, SEQUENCES, shards_of, top_names
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.shard import Receipt, receipt_path
from warpsim.errors import InputError
from warpsim.files import partial_path, read_json, write_json
from warpsim.output.receipts import has_key, is_record, locked, which_match


@dataclass(frozen=True)
class Workplace:
    """A data set's folder."""

    folder: Path
    recipe: Recipe
    key: str
    """Hash of all that the files depend on."""

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
    def held(self, overwrite: bool) -> Iterator[dict[str, Receipt]]:
        """Hold the folder for a run: receipts of the shards that are there. At the end only the data set is left.

        Raises:
            InputError: The folder holds another data set and overwrite is not set, or files that warpsim did not write,
                or another run is writing to it.
        """
        with locked(self.folder, self.parts):
            try:
                self._make_room(overwrite)
            except InputError:
                if [path.name for path in self.parts.iterdir()] == ["lock"]:
                    shutil.rmtree(self.parts)
                raise
            write_json({"key": self.key, "files": {}}, self.parts / RUN)
            self._take_up_manifest()
            yield self._receipts()
            shutil.rmtree(self.parts)

    def _receipts(self) -> dict[str, Receipt]:
        """Receipts of the shards whose files are there and undamaged, by the shard's name."""
        found = {}
        for shard in shards_of(self.recipe):
            receipt = read_json(receipt_path(self.folder, shard))
            if has_key(receipt, self.key) and receipt.get("shard") == shard.name:
                found[shard.name] = receipt
        whole = which_match(self.folder, {name: receipt["files"] for name, receipt in found.items()})
        return {name: receipt for name, receipt in found.items() if whole[name]}

    def _shard_records(self, manifest: Any) -> dict[str, dict[str, str]]:
        shards = manifest.get("shards")
        if not isinstance(shards, dict) or not all(has_key(receipt, manifest["key"]) for receipt in shards.values()):
            return {}
        return {name: receipt["files"] for name, receipt in shards.items()}

    def _take_up_manifest(self) -> None:
        """Of a complete data set with a damaged or missing file, keep the receipts."""
        manifest = read_json(self.manifest_path)
        if not has_key(manifest, self.key):
            return
        for shard in shards_of(self.recipe):
            if receipt := manifest.get("shards", {}).get(shard.name):
                write_json(receipt, _made(receipt_path(self.folder, shard)))
        self.manifest_path.unlink()

    def _make_room(self, overwrite: bool) -> None:
        """See that the data set's files are ours to write: remove another one, if wanted, never foreign files."""
        paths = [self.manifest_path, self.parts / RUN]
        paths += [path for folder in ("receipts", "planned") for path in (self.parts / folder).glob("*.json")]
        runs = [record for record in map(read_json, paths) if is_record(record)]
        ours = {name for run in runs for name in _names(run)} | ({MANIFEST} if runs else set())
        others = [run for run in runs if run["key"] != self.key]
        if others and not overwrite:
            raise InputError(
                f"{self.folder}: holds a different data set or run (other recipe, scene, catalog, device or version); "
                "choose another folder or pass --overwrite"
            )
        for name in top_names(self.recipe):
            if (self.folder / name).exists() and not any(f"{known}/".startswith(f"{name}/") for known in ours):
                raise InputError(f"{self.folder / name}: is there already, and warpsim did not write it")
        for run in others:
            self._remove(run)
        if others:
            self.manifest_path.unlink(missing_ok=True)
            for name in ("receipts", "planned"):
                shutil.rmtree(self.parts / name, ignore_errors=True)
        shutil.rmtree(self.parts / "work", ignore_errors=True)
        for name in (SEQUENCES, MANIFEST):
            partial_path(self.folder / name).unlink(missing_ok=True)

    def _remove(self, run: dict[str, Any]) -> None:
        """Remove the files of another run, and the folders that are empty then."""
        homes: set[Path] = set()
        for name in _names(run):
            if not (self.folder / name).parent.resolve().is_relative_to(self.folder.resolve()):
                continue  # by way of a link that is not ours
            (self.folder / name).unlink(missing_ok=True)
            homes |= set((self.folder / name).parents) - {self.folder, *self.folder.parents}
        for home in sorted(homes, key=lambda path: len(path.parts), reverse=True):
            with contextlib.suppress(OSError):  # is missing, or holds what is not ours
                home.rmdir()


def _names(run: dict[str, Any]) -> list[str]:
    """Files that a manifest or receipt says were written."""
    shards = run.get("shards")
    receipts = [record for record in shards.values() if is_record(record)] if isinstance(shards, dict) else []
    return [*run["files"], *(name for receipt in receipts for name in receipt["files"])]


def _made(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
