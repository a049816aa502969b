"""Folders that are written in parts: one run at a time, and checksums that say which parts are whole."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import Any

from warpsim.errors import InputError
from warpsim.files import sha256_of

_SUFFIXES = "fits|png|tif|exr|npy|gif|mp4|json|parquet|tar"
_SUFFIXES = "fits|png|tif|exr|npy|gif|mp4|json|parquet|tar"
_OURS = re.compile(rf"([\w.+-]+/)*[\w.+-]+\.({_SUFFIXES})|([\w.+-]+/)+c(/\d+)+", re.ASCII)
"""Names of files that warpsim writes: by their endings, and shards of Zarr arrays."""


@contextlib.contextmanager
def locked(folder: Path, parts: Path) -> Iterator[None]:
    """Hold the lock of a folder that one run at a time writes to.

    Args:
        folder: The folder, for the message.
        parts: Folder of what an unfinished run needs; made when missing. The lock lies there.

    Raises:
        InputError: Another run holds it.
    """
    path = parts / "lock"
    while True:
        parts.mkdir(exist_ok=True)
        with path.open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(f"{folder}: another run is writing to it") from None
            if not _is_there(lock.fileno(), path):  # the run before has just removed it
                continue
            yield
            return


def _is_there(number: int, path: Path) -> bool:
    """Whether an open file still is the one of that name."""
    try:
        return os.path.samestat(os.fstat(number), path.stat())
    except FileNotFoundError:
        return False


def has_key(record: Any, key: str) -> bool:
    """True for a manifest or a receipt of the run with this key."""
    return isinstance(record, dict) and record.get("key") == key and isinstance(record.get("files"), dict)


def is_record(record: Any) -> bool:
    """True for what looks like a manifest or receipt of any run: a key, and plain names of files below the folder."""
    if not isinstance(record, dict) or not isinstance(record.get("files"), dict):
        return False
    return bool(re.fullmatch("[0-9a-f]{64}", str(record.get("key")))) and all(map(is_plain_name, record["files"]))


def is_plain_name(name: str) -> bool:
    """True for the relative path of a file as warpsim writes them, without a way out of its folder."""
    return bool(_OURS.fullmatch(name)) and not {"..", "."} & set(PurePosixPath(name).parts)


def files_match(folder: Path, checksums: Mapping[str, str]) -> bool:
    """True when all files are there and have the checksums that were written down."""
    paths = {folder / name: checksum for name, checksum in checksums.items()}
    return all(path.is_file() and sha256_of(path) == checksum for path, checksum in paths.items())


def which_match(folder: Path, records: Mapping[str, Mapping[str, str]]) -> dict[str, bool]:
    """Which of several sets of files match their checksums; read side by side, as hashing does not hold the GIL."""
    with ThreadPoolExecutor() as pool:
        matches = pool.map(lambda checksums: files_match(folder, checksums), records.values())
        return dict(zip(records, matches, strict=True))
