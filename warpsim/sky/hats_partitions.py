"""Partitions of a HATS folder: the files that are there, and the lists of those that should be."""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from warpsim.errors import InputError
from warpsim.tables.by_astropy import rows_of_files

PARTITION_INFO = "partition_info.csv"
_METADATA = "_metadata"
_PARTITION = re.compile(r"Norder=(\d+)/Dir=\d+/Npix=(\d+)(?:\.\w+)?$")
_FINEST_ORDER = 29


@dataclass(frozen=True)
class HatsTile:
    """The stars in one pixel."""

    order: int
    pixel: int
    """In nested order."""

    path: Path


def tiles_in(base: Path) -> list[HatsTile]:
    """Return the partitions in a folder, in no order."""
    found = []
    for path in base.glob("Norder=*/Dir=*/Npix=*"):
        if match := _PARTITION.search(path.as_posix()):
            order, pixel = int(match[1]), int(match[2])
            if order > _FINEST_ORDER or pixel >= 12 * 4**order:
                rule = f"must be a pixel of HEALPix: Norder 0 to {_FINEST_ORDER}, Npix 0 to 12 x 4^Norder - 1"
                raise InputError(rule).of(path)
            files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
            found += [HatsTile(order, pixel, file) for file in files]
    return found


def check_apart(tiles: Sequence[HatsTile], folder: Path) -> None:
    """Raise where two partitions hold the same part of the sky: their stars would be there twice."""
    spans = set()
    for tile in tiles:
        size = 4 ** (_FINEST_ORDER - tile.order)
        whole = tile.path.parent if tile.path.parent.name.startswith("Npix=") else tile.path
        spans.add((tile.pixel * size, -size, str(whole.relative_to(folder))))
    in_order = sorted(spans)
    for (start, minus_size, one), (next_start, _, other) in itertools.pairwise(in_order):
        if next_start < start - minus_size:
            raise InputError(f"must hold no pixel twice, got {one} and {other}").of(folder)


def read_partition_info(path: Path) -> dict[tuple[int, int], int | None]:
    """Return rows by order and pixel as a list has them, None where it lacks them; none without a list."""
    if not path.is_file():
        return {}
    table = csv.DictReader(text_of(path).splitlines(), skipinitialspace=True)
    listed: dict[tuple[int, int], int | None] = {}
    try:
        names = [(name or "").strip() for name in table.fieldnames or ()]
        table.fieldnames = names
        if not {"Norder", "Npix"} <= set(names):
            raise InputError("must have the columns Norder and Npix", value=", ".join(names) or "none", form="s")
        for row in table:
            try:
                order, pixel = (_whole(row, name) for name in ("Norder", "Npix"))
                listed[order, pixel] = _whole(row, "num_rows") if "num_rows" in names else None
            except InputError as error:
                raise error.of(f"line {table.line_num}") from None
    except csv.Error as error:
        raise InputError(f"cannot be read as a table: {error}").of(path) from None
    except InputError as error:
        raise error.of(path) from None
    if not listed:
        raise InputError("must list partitions, got none").of(path)
    return listed


def _whole(row: Mapping[str, str | None], name: str) -> int:
    text = (row[name] or "").strip()
    if not re.fullmatch(r"\d{1,18}", text, re.ASCII):
        raise InputError("must be a whole number >= 0", name, text)
    return int(text)


def check_listed(tiles: Sequence[HatsTile], listed: Mapping[tuple[int, int], int | None], folder: Path) -> None:
    """Raise unless the partitions are those of `partition_info.csv`; one of no rows needs no file."""
    there = {(tile.order, tile.pixel) for tile in tiles}
    missing = sorted(key for key, n_row in listed.items() if n_row != 0 and key not in there)
    if missing:
        order, pixel = missing[0]
        of_all = f"({len(missing):,} of {len(listed):,} are missing)"
        raise InputError(f"must hold Norder={order}, Npix={pixel}, which {PARTITION_INFO} lists {of_all}").of(folder)
    if others := sorted(there - listed.keys()):
        order, pixel = others[0]
        raise InputError(f"must list Norder={order}, Npix={pixel}, which is there ({len(others):,} such)").of(
            folder / PARTITION_INFO
        )


def check_metadata(base: Path) -> None:
    """Raise where files are missing that `_metadata` lists; an empty one needs not be there."""
    path = base / _METADATA
    if not path.is_file():
        return
    try:
        listed = rows_of_files(path)
    except InputError as error:
        raise error.of(path) from None
    missing = sorted(name for name, n_row in listed.items() if n_row and not (base / name).is_file())
    if missing:
        of_all = f"({len(missing):,} of {len(listed):,} are missing)"
        raise InputError(f"must hold {missing[0]}, which {_METADATA} lists {of_all}").of(base)


def text_of(path: Path) -> str:
    """Return the text of a file in UTF-8."""
    try:
        return path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("must be text in UTF-8").of(path) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})").of(path) from None
