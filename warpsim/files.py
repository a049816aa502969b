"""Files that appear whole or not at all, and their checksums."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError

if TYPE_CHECKING:
    from astropy.table import Table

PARTIAL_SUFFIX = ".partial"


def partial_path(path: Path) -> Path:
    """Temporary name of a file until it is complete."""
    return path.with_name(f".{path.name}{PARTIAL_SUFFIX}")


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary name beside path to write to; renamed to path at the end, removed on an error."""
    partial = partial_path(path)
    if partial.is_symlink():  # what it leads to is not ours
        partial.unlink()
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name the file in errors of writing."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or str(path) in str(error):
            raise
        if error.errno is not None:
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise OSError(f"{path}: cannot be written: {error}") from None


@contextlib.contextmanager
def whole_file_by_memory(path: Path) -> Iterator[str]:
    """A name in memory for a library that does not report a full disk; its output becomes the file.

    OpenImageIO's writers of PNG and GIF, and that of EXR for small images, return success where nothing could be
    written any more.
    """
    with os.fdopen(os.memfd_create("warpsim"), "rb") as memory:
        yield f"/proc/self/fd/{memory.fileno()}"
        with whole_file(path) as partial, naming(path), partial.open("wb") as file:
            shutil.copyfileobj(memory, file, 2**20)


def check_empty(folder: Path) -> None:
    """Check that a folder is missing or empty.

    Raises:
        InputError: It holds something, or is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError("cannot be written: is not a folder").of(folder)
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError("holds files already; choose another folder, or remove it").of(folder)


def absolute_path(path: str) -> str:
    """A path from the root, without `.` and `..`; but `..` stays where it leads out of a symbolic link."""
    whole = Path(path).absolute()
    plain = os.path.normpath(whole)
    same = ".." not in whole.parts or os.path.realpath(plain) == os.path.realpath(whole)
    return plain if same else str(whole)


def check_new_file(path: Path, suffixes: tuple[str, ...] | None, overwrite: bool) -> None:
    """Check that a file may be written, before the work.

    Raises:
        InputError: The suffix is not one of these (None: any), the folder is missing or cannot be written, or the file
            is there and overwrite not set.
    """
    if suffixes is not None and path.suffix.lower() not in suffixes:
        one = "" if len(suffixes) == 1 else "one of "
        raise InputError(f"must end in {one}{', '.join(suffixes)}").of(path)
    if not path.parent.is_dir():
        raise InputError(f"cannot be written: {path.parent} is not a folder").of(path)
    _check_folder_takes(path)
    if path.is_dir():
        raise InputError("cannot be written: is a folder").of(path)
    if path.exists() and not overwrite:
        raise InputError("is there already; choose another name, or pass --overwrite (overwrite=True)").of(path)


def _check_folder_takes(path: Path) -> None:
    """Check that the file that becomes path can be made; permissions do not show it (file systems of the kernel)."""
    partial = partial_path(path)
    try:
        if not (partial.exists() or partial.is_symlink()):
            partial.touch()
            partial.unlink()
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}").of(path) from None


def write_fits_table(table: Table, path: Path) -> None:
    """Write a table as FITS, whose texts are ASCII: other letters become Python's escapes, a backslash and a number."""
    table = table.copy(copy_data=False)
    for name in table.colnames:
        table[name].info.description = None  # else astropy adds a block of YAML to the header
        if table[name].dtype.kind == "U":
            plain = np.char.decode(np.char.encode(np.asarray(table[name]), "ascii", "backslashreplace"), "ascii")
            table.replace_column(name, plain)
    for key, value in table.meta.items():
        if isinstance(value, str):
            table.meta[key] = value.encode("ascii", "backslashreplace").decode("ascii")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # keywords longer than 8 letters are written as HIERARCH
        table.write(path, format="fits", overwrite=True)


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def plain_number(value: Any) -> Any:
    """NumPy's numbers as Python's: what JSON asks for what it does not know.

    Raises:
        TypeError: It is no number of NumPy.
    """
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"JSON cannot hold a value of type {type(value).__name__}")


def write_json(data: Any, path: Path, lasting: bool = False) -> None:
    """Write JSON, whole or not at all; lasting: also if the power fails the moment after."""
    with whole_file(path) as partial, partial.open("w", encoding="utf-8") as file:
        json.dump(data, file, indent=2)
        file.write("\n")
        if lasting:
            file.flush()
            os.fsync(file.fileno())


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
    if folder.exists() and not folder.is_dir():
        raise InputError("cannot be written: is not a folder").of(folder)
    probe = folder / f".probe-{uuid.uuid4().hex}{PARTIAL_SUFFIX}"  # others may begin at the same time
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        for parent in made:
            with contextlib.suppress(OSError):
                parent.rmdir()
        raise InputError(f"cannot be written: {error.strerror}").of(folder) from None
