"""Catalogs in HATS folders: Parquet files, one for each pixel of a HEALPix grid that is finer where stars are many.

HATS: Hierarchical Adaptive Tiling Scheme, LSST Interdisciplinary Network for Collaboration and Computing; IVOA note 1.0
(2025). A folder holds `hats.properties` and dataset/Norder=K/Dir=D/Npix=N.parquet, pixels in nested order, ICRS.
"""

from __future__ import annotations

import csv
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.directions import unit_vectors
from warpsim.errors import InputError, errors_at
from warpsim.tables.by_astropy import ParquetFile, rows_of_files

_PROPERTIES = ("hats.properties", "properties", "catalog_info.json")
_COLLECTION = "collection.properties"
_CONES_AT_A_TIME = 256
_NAME_KEY, _PRIMARY_KEY = "obs_collection", "hats_primary_table_url"
_PARTITION_INFO, _METADATA = "partition_info.csv", "_metadata"
_PARTITION = re.compile(r"Norder=(\d+)/Dir=\d+/Npix=(\d+)(?:\.\w+)?$")
_FINEST_ORDER = 29


@dataclass(frozen=True)
class HatsTile:
    """The stars in one pixel."""

    order: int
    pixel: int
    """In nested order."""

    path: Path


def is_hats(folder: Path) -> bool:
    """Return whether a folder is one of HATS, or a collection of such."""
    if (folder / _COLLECTION).is_file():
        return True
    parts = (folder / "dataset", folder)
    return any((folder / name).is_file() for name in _PROPERTIES) and any(any(part.glob("Norder=*")) for part in parts)


class HatsFolder:
    """The partitions of a HATS folder, none of which is read yet.

    Args:
        folder: The catalog, or a collection, whose primary table is taken.

    Raises:
        InputError: It has no partitions, or others than it lists; two overlap, or its pixels are not equatorial.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.properties = _primary_table(folder)
        self.name = _name_of(self.folder, self.properties)
        frame = self.properties.get("hats_frame", "equatorial")
        if frame.lower() not in ("equatorial", "icrs"):
            raise InputError("must be equatorial", "hats_frame", frame).of(self.folder)
        base = self.folder / "dataset" if (self.folder / "dataset").is_dir() else self.folder
        found = _tiles_in(base)
        if not found:
            raise InputError("must hold partitions Norder=K/Dir=D/Npix=N.parquet").of(self.folder)
        _check_apart(found, self.folder)
        self._listed = _read_partition_info(self.folder / _PARTITION_INFO)
        if self._listed:
            _check_listed(found, self._listed, self.folder)
        else:
            _check_metadata(base)
        self._cosine: tuple[float, NDArray[np.float64]] = -1.0, np.zeros(0)
        # In the order of the finest pixels, which is that of the sky whatever their sizes are.
        finest = max(tile.order for tile in found)
        self.tiles = sorted(found, key=lambda one: (one.pixel << 2 * (finest - one.order), str(one.path)))

    @cached_property
    def n_row(self) -> NDArray[np.int64]:
        """Rows of each tile: of `partition_info.csv`, or else of the files' own footers, shape (n_tile,)."""
        keys = [(tile.order, tile.pixel) for tile in self.tiles]
        listed = [self._listed.get(key) for key in keys]
        if len(set(keys)) == len(keys) and None not in listed:
            return np.array(listed, dtype=np.int64)
        n_row = []
        for tile in self.tiles:
            with _reading(tile.path):
                n_row.append(len(ParquetFile(tile.path)))
        return np.array(n_row, dtype=np.int64)

    def near(self, region: Sequence[tuple[float, float, float]]) -> list[HatsTile]:
        """Return the tiles that may hold stars in any of some cones, (ra_deg, dec_deg, radius_deg)."""
        cones = np.array(region, dtype=np.float64)
        rows = self.rows_near(unit_vectors(cones[:, 0], cones[:, 1]), np.radians(cones[:, 2]))
        return [self.tiles[row] for row in rows.tolist()]

    def rows_near(self, direction: NDArray[np.float64], radius_rad: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return which of the tiles may hold stars in any of some cones, in ascending order.

        Args:
            direction: Axes of the cones, unit vectors, shape (n, 3).
            radius_rad: Their radii [rad], shape (n,).
        """
        centre, reach_rad = self._pixels
        # By the widest cone first: most tiles are far from all of them.
        widest_rad = float(radius_rad.max(initial=0.0))
        if self._cosine[0] != widest_rad:  # calls alike follow each other
            self._cosine = widest_rad, np.cos(np.minimum(reach_rad + widest_rad, np.pi))
        maybe = np.flatnonzero((centre @ direction.T).max(axis=1, initial=-1.0) >= self._cosine[1])
        centre, reach_rad = centre[maybe], reach_rad[maybe]
        near = np.zeros(len(maybe), dtype=np.bool_)
        for start in range(0, len(direction), _CONES_AT_A_TIME):
            some = slice(start, start + _CONES_AT_A_TIME)
            cosine = centre @ direction[some].T
            near |= (np.arccos(np.clip(cosine, -1.0, 1.0)) - radius_rad[some]).min(axis=1) <= reach_rad
        return maybe[near]

    @cached_property
    def _pixels(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Centres of the tiles, (n_tile, 3), and radii of circles around them [rad], (n_tile,)."""
        try:
            from astropy_healpix import boundaries_lonlat, healpix_to_lonlat
        except ImportError:
            raise InputError("needs the package astropy-healpix: pip install 'warpsim[healpix]'") from None
        order, pixel = np.array([(tile.order, tile.pixel) for tile in self.tiles]).T
        centre, reach_rad = np.empty((len(order), 3)), np.empty(len(order))
        for one in np.unique(order).tolist():
            rows = np.flatnonzero(order == one)
            lon, lat = healpix_to_lonlat(pixel[rows], 2**one, order="nested")
            edge_lon, edge_lat = boundaries_lonlat(pixel[rows], 4, 2**one, order="nested")
            centre[rows] = unit_vectors(lon.to_value("deg"), lat.to_value("deg"))
            edge = unit_vectors(edge_lon.to_value("deg"), edge_lat.to_value("deg"))
            chord = np.linalg.norm(edge - centre[rows, None, :], axis=-1).max(axis=1)
            reach_rad[rows] = 2.02 * np.arcsin(0.5 * chord)  # corners are farthest; by 1 % more
        return centre, reach_rad


def hats_name(folder: Path) -> str:
    """Return the name of the catalog in a HATS folder: what it says of itself, or else the folder's."""
    return _name_of(*_primary_table(folder))


def _name_of(folder: Path, properties: Mapping[str, str]) -> str:
    return properties.get(_NAME_KEY) or folder.absolute().name


def _primary_table(folder: Path) -> tuple[Path, dict[str, str]]:
    """A catalog's folder, of a collection that of its primary table, and its properties."""
    if (folder / _COLLECTION).is_file():
        url = _read_properties(folder / _COLLECTION).get(_PRIMARY_KEY)
        if not url:
            raise InputError(f"must have the key {_PRIMARY_KEY}").of(folder / _COLLECTION)
        folder = folder / url
    return folder, _read_properties(folder / "hats.properties") or _read_properties(folder / "properties")


def _read_properties(path: Path) -> dict[str, str]:
    """Keys and values of a file of lines "key = value"; none where there is no such file."""
    if not path.is_file():
        return {}
    with _reading(path):
        text = path.read_text("utf-8-sig")
    pairs = (line.split("=", 1) for line in text.splitlines() if "=" in line and line[:1] != "#")
    return {key.strip(): value.strip() for key, value in pairs}


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Name the file in errors of reading it."""
    try:
        yield
    except InputError as error:
        raise error.of(path) from None
    except UnicodeDecodeError:
        raise InputError("must be text in UTF-8").of(path) from None
    except csv.Error as error:
        raise InputError(f"cannot be read as a table: {error}").of(path) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})").of(path) from None


def _tiles_in(base: Path) -> list[HatsTile]:
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


def _check_apart(tiles: Sequence[HatsTile], folder: Path) -> None:
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


def _read_partition_info(path: Path) -> dict[tuple[int, int], int | None]:
    """Return rows by order and pixel as a list has them, None where it lacks them; none without a list."""
    if not path.is_file():
        return {}
    listed: dict[tuple[int, int], int | None] = {}
    with _reading(path):
        table = csv.DictReader(path.read_text("utf-8-sig").splitlines(), skipinitialspace=True)
        names = [(name or "").strip() for name in table.fieldnames or ()]
        table.fieldnames = names
        if not {"Norder", "Npix"} <= set(names):
            raise InputError("must have the columns Norder and Npix", value=", ".join(names) or "none", form="s")
        for row in table:
            with errors_at("", f"line {table.line_num}"):
                order, pixel = (_whole(row, name) for name in ("Norder", "Npix"))
                listed[order, pixel] = _whole(row, "num_rows") if "num_rows" in names else None
        if not listed:
            raise InputError("must list partitions, got none")
    return listed


def _whole(row: Mapping[str, str | None], name: str) -> int:
    text = (row[name] or "").strip()
    if not re.fullmatch(r"\d{1,18}", text, re.ASCII):
        raise InputError("must be a whole number >= 0", name, text)
    return int(text)


def _check_listed(tiles: Sequence[HatsTile], listed: Mapping[tuple[int, int], int | None], folder: Path) -> None:
    """Raise unless the partitions are those of `partition_info.csv`; one of no rows needs no file."""
    there = {(tile.order, tile.pixel) for tile in tiles}
    missing = sorted(key for key, n_row in listed.items() if n_row != 0 and key not in there)
    if missing:
        order, pixel = missing[0]
        of_all = f"({len(missing):,} of {len(listed):,} are missing)"
        raise InputError(f"must hold Norder={order}, Npix={pixel}, which {_PARTITION_INFO} lists {of_all}").of(folder)
    if others := sorted(there - listed.keys()):
        order, pixel = others[0]
        raise InputError(f"must list Norder={order}, Npix={pixel}, which is there ({len(others):,} such)").of(
            folder / _PARTITION_INFO
        )


def _check_metadata(base: Path) -> None:
    """Raise where files are missing that `_metadata` lists; an empty one needs not be there."""
    path = base / _METADATA
    if not path.is_file():
        return
    with _reading(path):
        listed = rows_of_files(path)
    missing = sorted(name for name, n_row in listed.items() if n_row and not (base / name).is_file())
    if missing:
        of_all = f"({len(missing):,} of {len(listed):,} are missing)"
        raise InputError(f"must hold {missing[0]}, which {_METADATA} lists {of_all}").of(base)
