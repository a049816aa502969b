"""Checkpoints of folders that are written in parts: a lock for one run at a time, and checksums of complete parts."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path, PurePosixPath
from typing import Any

from warpsim.errors import InputError
from warpsim.files import check_empty, partial_path, prepare_folder, sha256_of

_SUFFIXES = "fits|png|tif|exr|npy|gif|mp4|json|parquet|tar"
_OURS = re.compile(rf"([\w.+-]+/)*[\w.+-]+\.({_SUFFIXES})|([\w.+-]+/)+c(/\d+)+", re.ASCII)
"""Names of files that warpsim writes: by their endings, and shards of Zarr arrays."""


LOCK = "lock"


@contextlib.contextmanager
def locked(folder: Path, parts: Path) -> Iterator[None]:
    """Lock a folder that one run at a time writes to.

    Args:
        folder: The folder, for the message.
        parts: Folder of what an unfinished run needs; made when missing. It holds the lock file.

    Raises:
        InputError: Another run holds it, the file system knows no locks, or there is a link among the parts.
    """
    check_no_link(parts, parts / LOCK)
    with _open_lock(folder, parts):
        for home, folders, files in os.walk(parts):  # others' late workers may change it meanwhile
            check_no_link(*(Path(home, name) for name in (*folders, *files)))
        yield
    with contextlib.suppress(OSError):  # is not empty, or gone
        parts.rmdir()  # network file systems keep a removed lock for as long as it is open


def check_no_link(*paths: Path) -> None:
    """Check that files are written and removed here and nowhere else.

    Raises:
        InputError: One of the paths is a symbolic link.
    """
    link = next(filter(Path.is_symlink, paths), None)
    if link is not None:
        raise InputError("must not be a link: the files behind it may be others'").of(link)


@contextlib.contextmanager
def _open_lock(folder: Path, parts: Path) -> Iterator[None]:
    path = parts / LOCK
    while True:
        parts.mkdir(exist_ok=True)
        try:
            lock = path.open("w")
        except FileNotFoundError:  # the run before has just removed the folder
            continue
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError("another run is writing to it").of(folder) from None
            except OSError as error:
                raise InputError(f"cannot be locked against other runs: {error.strerror}").of(folder) from None
            if _is_there(lock.fileno(), path):  # not so if the run before has just removed it
                yield
                return


def _is_there(number: int, path: Path) -> bool:
    """Return whether an open file is still the one at that path."""
    try:
        return os.path.samestat(os.fstat(number), path.stat())
    except FileNotFoundError:
        return False


def clear(parts: Path, with_lock: bool = True) -> None:
    """Remove what an unfinished run needed; call it while its lock is held."""
    for path in parts.iterdir():
        if path.name != LOCK:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    if with_lock:
        (parts / LOCK).unlink(missing_ok=True)  # last: from now on others may come
        with contextlib.suppress(OSError):
            parts.rmdir()


@contextlib.contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A folder to write to within `.NAME.partial` beside a folder; it becomes that folder at the end.

    It is removed on an error; what a killed process left is removed by the next one.

    Raises:
        InputError: The folder holds something, cannot be written, or another process is writing it.
    """
    check_empty(folder)
    prepare_folder(folder.parent)
    parts = partial_path(folder)
    with locked(folder, parts):
        clear(parts, with_lock=False)
        try:
            made = parts / folder.name
            made.mkdir()
            yield made
            check_empty(folder)
            made.replace(folder)
        finally:
            clear(parts)


def remove_files(folder: Path, names: Iterable[str]) -> None:
    """Remove files of a run, by their names below its folder, and the folders that are empty then."""
    homes: set[Path] = set()
    for name in names:
        if not (folder / name).parent.resolve().is_relative_to(folder.resolve()):
            continue  # by way of a link that is not ours
        (folder / name).unlink(missing_ok=True)
        homes |= set((folder / name).parents) - {folder, *folder.parents}
    for home in sorted(homes, key=lambda path: len(path.parts), reverse=True):
        with contextlib.suppress(OSError):  # is missing, or holds what is not ours
            home.rmdir()


def has_key(record: Any, key: str) -> bool:
    """True for a manifest or a checkpoint record of the run with this key."""
    return isinstance(record, dict) and record.get("key") == key and isinstance(record.get("files"), dict)


def is_record(record: Any) -> bool:
    """True for a manifest or checkpoint record of any run: a key, and plain names of files below the folder."""
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
    """Return which of several sets of files match their checksums; threads, as hashing releases the GIL."""
    with ThreadPoolExecutor() as pool:
        matches = pool.map(lambda checksums: files_match(folder, checksums), records.values())
        return dict(zip(records, matches, strict=True))
