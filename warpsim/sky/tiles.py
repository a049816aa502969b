"""Stars of a HATS folder, read tile by tile as they are needed, and dropped when others are needed more."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.hats import HatsFolder
from warpsim.sky.readers.read import StarsOfFile, read_files
from warpsim.sky.readers.read_options import CatalogFile, ReadOptions

STARS_KEPT = 1_000_000
"""Stars of tiles that are kept besides those needed: about 300 MB."""

MOST_STARS = 20_000_000
"""Stars needed at a time: about 6 GB."""


class StarTiles:
    """Stars of a HATS folder.

    Args:
        folder: Its name.
        options: How its files are read, checked.

    Attributes:
        hats: The partitions.
        epoch_jyear: Julian year of the positions by which stars are in their tiles.
        first_row: Row of the first star of each tile among all of the folder, and their number behind, (n_tile + 1,).

    Raises:
        InputError: It is no such folder, or the first of its files cannot be read.
    """

    def __init__(self, folder: Path, options: ReadOptions) -> None:
        self.hats = HatsFolder(folder)
        self.first_row = np.concatenate([[0], np.cumsum(self.hats.n_row)])
        self._options = replace(options, name=self.hats.name)
        self._lock = threading.Lock()  # renderers of scenes alike share the tiles
        self._read: dict[int, StarsOfFile] = {}
        """By tile, those used last at the end."""

        self.epoch_jyear = self._part(0).stars.epoch_jyear

    def __len__(self) -> int:
        return int(self.first_row[-1])

    @property
    def checksum(self) -> str:
        """SHA-256 of the names and sizes of all files, in hexadecimal: to read them would take minutes."""
        digest = hashlib.sha256()
        for tile in self.hats.tiles:
            digest.update(f"{tile.path.relative_to(self.hats.folder)} {tile.path.stat().st_size}\n".encode())
        return digest.hexdigest()

    def chosen(self, needed: Iterable[int]) -> tuple[int, ...]:
        """Return the tiles needed and those used before that may be kept, in ascending order.

        Raises:
            InputError: The tiles needed have more than MOST_STARS stars.
        """
        wanted = set(needed)
        n_star = int(sum(self.hats.n_row[tile] for tile in wanted))
        if n_star > MOST_STARS:
            rule = f"must need at most {MOST_STARS:,} stars at a time; render fewer at once"
            raise InputError(rule, "frames", f"{n_star:,} in {len(wanted)} tiles", "s")
        room = STARS_KEPT
        kept = set()
        with self._lock:
            others = [tile for tile in self._read if tile not in wanted]
        for tile in reversed(others):
            room -= int(self.hats.n_row[tile])
            if room < 0:
                break
            kept.add(tile)
        return tuple(sorted(wanted | kept))

    def catalog(self, tiles: Sequence[int]) -> tuple[StarCatalog, NDArray[np.int64]]:
        """Return the stars of some tiles, and the row of each in the folder; other tiles are dropped."""
        with self._lock:
            parts = [self._part(tile) for tile in tiles]
            wanted = set(tiles)
            self._read = {tile: part for tile, part in self._read.items() if tile in wanted}
        catalog = StarCatalog._of_files(parts) if parts else self.no_stars()
        rows = [np.arange(self.first_row[tile], self.first_row[tile + 1]) for tile in tiles]
        return catalog, np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)

    def no_stars(self) -> StarCatalog:
        """Return the catalog of no tile."""
        return StarCatalog.from_arrays([], [], {}, name=self.hats.name)

    def _part(self, tile: int) -> StarsOfFile:
        part = self._read.pop(tile, None)
        if part is None:
            path = self.hats.tiles[tile].path
            part = read_files([CatalogFile(path)], self._options, int(self.first_row[tile]))
            n_star, n_row = len(part.stars), int(self.hats.n_row[tile])
            if n_star != n_row:
                rule = f"must hold {n_row:,} stars with a position, as the folder says, got {n_star:,}"
                raise InputError(rule).of(path)
        self._read[tile] = part
        return part
