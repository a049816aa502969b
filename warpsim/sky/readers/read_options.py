"""Files that make up a catalog (one, a list, a folder, HATS partitions), how to read them, and which of their stars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warpsim.errors import InputError, errors_at
from warpsim.sky.hats import HatsFolder, hats_name, is_hats
from warpsim.sky.photometric_bands import check_flux_band, flux_of_magnitude_jy
from warpsim.sky.positions import Cone, checked_jyear, checked_region, within_cones
from warpsim.sky.stars import Stars

FileNames = str | PathLike[str] | Sequence[str | PathLike[str]]

SUFFIXES = (".parquet", ".parq", ".fits", ".fit", ".vot", ".xml", ".ecsv", ".csv", ".tsv", ".txt", ".dat", ".tbl")
"""Of the files of a folder that are read; they may be followed by ".gz"."""


@dataclass(frozen=True)
class ReadOptions:
    """How to read a catalog file, as StarCatalog.read() describes it; all of it may be left out."""

    format: str | None = None
    columns: Mapping[str, str] | None = None
    table: str | int | None = None
    epoch_jyear: float | None = None
    readme: str | PathLike[str] | None = None
    region: Any = ()
    limit: Mapping[str, float] | None = None
    name: str | None = None
    """Of the catalog that a file is a part of; its own where left out."""

    def checked(self) -> ReadOptions:
        """Return the options, the epoch as a number and the region as a list of cones; InputError for a bad one."""
        if not isinstance(self.format, str | None):
            raise InputError("must be a name", "format", self.format)
        if not isinstance(self.readme, str | PathLike | None):
            raise InputError("must be a file name", "readme", self.readme)
        if not isinstance(self.columns, Mapping | None):
            kind = type(self.columns).__name__
            raise InputError(f"must be a mapping such as {{'ra_deg': 'RAJ2000'}}, got {kind}", "columns")
        if not isinstance(self.table, str | int | None) or isinstance(self.table, bool):
            raise InputError("must be a name or a number", "table", self.table)
        with errors_at("region"):
            region = checked_region(self.region)
        options = replace(self, region=region, limit=_checked_limit(self.limit))
        if self.epoch_jyear is None:
            return options
        try:
            return replace(options, epoch_jyear=checked_jyear(self.epoch_jyear))
        except InputError as error:
            raise InputError(error.rule, "epoch_jyear", self.epoch_jyear) from None


def chosen(stars: Stars, options: ReadOptions) -> Stars:
    """The stars within any cone of a region, and not fainter than the limits, in any of their bands."""
    keep = np.ones(len(stars), dtype=np.bool_)
    if options.region:
        keep &= within_cones(stars.ra_deg, stars.dec_deg, options.region)
    if options.limit:
        flux_jy = stars._photometry.given_jy
        if options.limit.keys().isdisjoint(flux_jy):
            rule = f"must name a band of the file, which has {', '.join(flux_jy)}"
            raise InputError(rule, "limit", ", ".join(options.limit), "s")
        limits_jy = {band: flux_of_magnitude_jy(band, np.array(value)) for band, value in options.limit.items()}
        known = [flux_jy[band] >= limit for band, limit in limits_jy.items() if band in flux_jy]
        keep &= np.any(known, axis=0)  # a flux that is not known is no brighter
    return stars if keep.all() else stars._rows(np.flatnonzero(keep))


def _checked_limit(limit: Any) -> dict[str, float] | None:
    if limit is None:
        return None
    rule = "must be a mapping of bands to magnitudes such as {'W3': 8.0}"
    if not isinstance(limit, Mapping) or not limit:
        raise InputError(rule, "limit", limit)
    for band, magnitude in limit.items():
        check_flux_band(band, "limit")
        if (
            isinstance(magnitude, bool)
            or not isinstance(magnitude, int | float | np.number)
            or not np.isfinite(magnitude)
        ):
            raise InputError(rule, "limit", limit)
    return {band: float(magnitude) for band, magnitude in limit.items()}


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
    """Files that a path stands for, or several; of a HATS folder those that a region touches. InputError for none."""
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
    tables = (file for file in folder.iterdir() if file.name.lower().removesuffix(".gz").endswith(SUFFIXES))
    files = sorted(file for file in tables if file.is_file() and not file.name.startswith((".", "_")))
    if not files:
        raise InputError(f"must hold files of stars ({', '.join(SUFFIXES)}), or be a HATS folder").of(where)
    return [CatalogFile(file) for file in files]


def _files_of_hats(hats: HatsFolder, region: Sequence[Cone]) -> list[CatalogFile]:
    # Where no tile is near, the first one names the columns of an empty catalog.
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


def is_parquet(file: Path) -> bool:
    """Return whether a file begins as Parquet does."""
    try:
        with file.open("rb") as stream:
            return stream.read(4) == b"PAR1"
    except OSError:
        return False  # the reader says what is wrong
