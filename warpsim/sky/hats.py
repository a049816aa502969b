"""Catalogs in HATS folders: Parquet files, one for each pixel of a HEALPix grid that is finer where stars are many.

HATS: Hierarchical Adaptive Tiling Scheme, LSST Interdisciplinary Network for Collaboration and Computing; IVOA note 1.0
(2025). A folder holds `hats.properties` and dataset/Norder=K/Dir=D/Npix=N.parquet, pixels in nested order, ICRS.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.sky.hats_partitions import (
    PARTITION_INFO,
    HatsTile,
    check_apart,
    check_listed,
    check_metadata,
    read_partition_info,
    text_of,
    tiles_in,
)
from warpsim.tables.by_astropy import ParquetFile

_PROPERTIES = ("hats.properties", "properties", "catalog_info.json")
_COLLECTION = "collection.properties"
_CONES_AT_A_TIME = 256
_NAME_KEY, _PRIMARY_KEY = "obs_collection", "hats_primary_table_url"


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
        found = tiles_in(base)
        if not found:
            raise InputError("must hold partitions Norder=K/Dir=D/Npix=N.parquet").of(self.folder)
        check_apart(found, self.folder)
        self._listed = read_partition_info(self.folder / PARTITION_INFO)
        if self._listed:
            check_listed(found, self._listed, self.folder)
        else:
            check_metadata(base)
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
        return np.array([_n_row_of(tile.path) for tile in self.tiles], dtype=np.int64)

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
        return maybe[self._are_near(centre[maybe], reach_rad[maybe], direction, radius_rad)]

    @staticmethod
    def _are_near(
        centre: NDArray[np.float64],
        reach_rad: NDArray[np.float64],
        direction: NDArray[np.float64],
        radius_rad: NDArray[np.float64],
    ) -> NDArray[np.bool_]:
        near = np.zeros(len(centre), dtype=np.bool_)
        for start in range(0, len(direction), _CONES_AT_A_TIME):
            some = slice(start, start + _CONES_AT_A_TIME)
            cosine = centre @ direction[some].T
            near |= (np.arccos(np.clip(cosine, -1.0, 1.0)) - radius_rad[some]).min(axis=1) <= reach_rad
        return near

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
    pairs = (line.split("=", 1) for line in text_of(path).splitlines() if "=" in line and line[:1] != "#")
    return {key.strip(): value.strip() for key, value in pairs}


def _n_row_of(path: Path) -> int:
    try:
        return len(ParquetFile(path))
    except InputError as error:
        raise error.of(path) from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})").of(path) from None
