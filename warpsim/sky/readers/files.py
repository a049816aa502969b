"""Files that make up a catalog: one, a list of them, a folder, or the partitions of a HATS folder."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import NamedTuple

from warpsim.errors import InputError
from warpsim.sky.hats import HatsFolder, hats_name, is_hats
from warpsim.sky.region import Cone

FileNames = str | PathLike[str] | Sequence[str | PathLike[str]]

SUFFIXES = (".parquet", ".parq", ".fits", ".fit", ".vot", ".xml", ".ecsv", ".csv", ".tsv", ".txt", ".dat", ".tbl")
"""Of the files of a folder that are read; they may be followed by ".gz"."""


class CatalogFile(NamedTuple):
    """A file of a catalog, and rows of those that are passed over."""

    path: Path
    n_row: int | None = None
    """Rows that it must hold, where that is known."""

    n_before: int = 0
    """Rows passed over before it."""

    n_behind: int = 0
    """Rows passed over behind it, if it is the last."""


def catalog_files(path: FileNames, region: Sequence[Cone] = ()) -> list[CatalogFile]:
    """The files that a path stands for, or several; of a HATS folder those that a region touches.

    Raises:
        InputError: No path, a list of none, or a folder without any such file.
    """
    if isinstance(path, list | tuple):
        if not path:
            raise InputError("must name at least one file", "path")
        return [file for one in path for file in catalog_files(one, region)]
    try:
        where = fspath(path)  # type: ignore[arg-type]
    except TypeError:
        where = None
    if not isinstance(where, str) or "\0" in where:
        raise InputError(f"must be a file name, got {type(path).__name__}", "path")
    folder = Path(where)
    if not folder.is_dir():
        return [CatalogFile(folder)]
    if is_hats(folder):
        return _files_of_hats(HatsFolder(folder), region)
    files = sorted(file for file in folder.iterdir() if file.is_file() and _is_table(file))
    if not files:
        raise InputError(f"must hold files of stars ({', '.join(SUFFIXES)}), or be a HATS folder").of(where)
    return [CatalogFile(file) for file in files]


def _files_of_hats(hats: HatsFolder, region: Sequence[Cone]) -> list[CatalogFile]:
    # Where no tile is near, the first one tells the columns of no stars.
    chosen = set((hats.near(region) or hats.tiles[:1]) if region else hats.tiles)
    files, n_over = [], 0
    for tile, n_row in zip(hats.tiles, hats.n_row.tolist(), strict=True):
        if tile in chosen:
            files.append(CatalogFile(tile.path, n_row, n_over))
        n_over = 0 if tile in chosen else n_over + n_row
    return [*files[:-1], files[-1]._replace(n_behind=n_over)]


def folder_name(path: FileNames) -> str | None:
    """Return the name of the catalog in a folder, of HATS the one that it says; None of anything else."""
    if isinstance(path, list | tuple):
        return None
    folder = Path(fspath(path))  # type: ignore[arg-type]
    if not folder.is_dir():
        return None
    return hats_name(folder) if is_hats(folder) else folder.absolute().name


def _is_table(file: Path) -> bool:
    return not file.name.startswith((".", "_")) and file.name.lower().removesuffix(".gz").endswith(SUFFIXES)


def is_parquet(file: Path) -> bool:
    """Return whether a file begins as Parquet does."""
    try:
        with file.open("rb") as stream:
            return stream.read(4) == b"PAR1"
    except OSError:
        return False  # the reader says what is wrong
