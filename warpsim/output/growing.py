"""Files that only grow, and a journal of how far each has come: work that goes on in the middle after a kill."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

BLOCK_BYTES = 2**22


class GrowingFiles:
    """A folder of files that are appended to, step by step.

    The journal beside it has a line for each step: the caller's facts of it, and the SHA-256 of what each file grew
    by, after a checksum of the line itself. After a kill the steps that are whole are kept, and the files are cut to
    where these end.

    Args:
        folder: Folder of files and journal; made when missing.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "files"
        """Where the files are."""
        self._folder, self._journal = folder, folder / "journal"
        self._sizes: dict[str, int] = {}
        self.path.mkdir(parents=True, exist_ok=True)
        self.steps: list[dict[str, Any]] = []
        """The caller's facts of each whole step."""
        self._resume()

    def end_step(self, facts: dict[str, Any]) -> None:
        """Write down that a step is complete."""
        grown = {}
        sizes = self._current_sizes()
        for name, size in sizes.items():
            if size > (first := self._sizes.get(name, 0)):
                grown[name] = [first, size, self._checksum(name, first, size)]
        text = json.dumps({"grown": grown, "facts": facts}).encode()
        with self._journal.open("ab") as file:
            file.write(b"%s %s\n" % (hashlib.sha256(text).hexdigest().encode(), text))
        self._sizes = sizes
        self.steps.append(facts)

    def remove(self) -> None:
        """Remove the folder and its journal."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _resume(self) -> None:
        """Keep the whole steps of an earlier process, and cut off what came after them."""
        journal = self._journal.read_bytes() if self._journal.exists() else b""
        n_kept = 0
        for n_byte, step in whole_steps(journal):
            if any(self._checksum(name, *ends) != sha for name, (*ends, sha) in step["grown"].items()):
                break
            n_kept += n_byte
            self._sizes |= {name: end for name, (_, end, _) in step["grown"].items()}
            self.steps.append(step["facts"])
        for name in self._current_sizes():
            if name in self._sizes:
                os.truncate(self.path / name, self._sizes[name])
            else:
                (self.path / name).unlink()
        if journal:
            os.truncate(self._journal, n_kept)

    def _current_sizes(self) -> dict[str, int]:
        files = sorted(path for path in self.path.rglob("*") if path.is_file())
        return {path.relative_to(self.path).as_posix(): path.stat().st_size for path in files}

    def _checksum(self, name: str, first: int, end: int) -> str | None:
        """SHA-256 of a part of a file; None where the file has no such part."""
        path, checksum = self.path / name, hashlib.sha256()
        if not path.is_file() or path.stat().st_size < end:
            return None
        with path.open("rb") as file:
            file.seek(first)
            for begin in range(first, end, BLOCK_BYTES):
                checksum.update(file.read(min(BLOCK_BYTES, end - begin)))
        return checksum.hexdigest()


def whole_steps(journal: bytes) -> Iterator[tuple[int, dict[str, Any]]]:
    """Return the steps of a journal, or of its lines from one on, up to the first line that is not whole.

    Args:
        journal: Its bytes; the process that writes it may be amid a line.

    Returns:
        Of each step the bytes of its line; `grown`, first and end byte and SHA-256 by file; `facts`, the caller's.
    """
    for line in journal.splitlines(keepends=True):
        checksum, _, text = line.partition(b" ")
        if not text.endswith(b"\n") or hashlib.sha256(text.removesuffix(b"\n")).hexdigest().encode() != checksum:
            return
        yield len(line), json.loads(text)
