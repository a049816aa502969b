"""Files that appear whole or not at all, and their checksums."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from warpsim.errors import InputError

PARTIAL_SUFFIX = ".partial"


def partial_path(path: Path) -> Path:
    """The name that a file has until it is whole."""
    return path.with_name(f".{path.name}{PARTIAL_SUFFIX}")


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary name beside path to write to; renamed to path at the end, removed on an error."""
    partial = partial_path(path)
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_json(data: Any, path: Path) -> None:
    """Write JSON, whole or not at all."""
    with whole_file(path) as partial:
        partial.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")


def read_json(path: Path) -> Any:
    """The content of a JSON file, None when it is missing or broken."""
    try:
        return json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return None


def prepare_folder(folder: Path) -> None:
    """Make the folder and see that it can be written.

    Raises:
        InputError: It cannot; nothing is left behind.
    """
    probe = folder / f".probe{PARTIAL_SUFFIX}"
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        for parent in made:
            if parent.exists():
                parent.rmdir()
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
