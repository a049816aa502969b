"""Parquet files through pyarrow alone (astropy's own reader needs pandas too): some columns, a row group at a time."""

from __future__ import annotations

import importlib
import io
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError, one_line
from warpsim.tables.by_astropy import quietly
from warpsim.tables.columns import ColumnTable

if TYPE_CHECKING:
    from astropy.table import Table


class ParquetFile:
    """A Parquet file, by its name or its bytes, of which so far only the description of its columns is read."""

    def __init__(self, source: Path | bytes) -> None:
        try:
            parquet = importlib.import_module("pyarrow.parquet")
        except ImportError:
            raise InputError("cannot be read: Parquet needs the package pyarrow (pip install pyarrow)") from None
        with source.open("rb") if isinstance(source, Path) else io.BytesIO(source) as stream:
            stream.seek(0, 2)
            stream.seek(max(stream.tell() - 4, 0))
            if stream.read() != b"PAR1":
                raise InputError("ends early: the Parquet data are cut off")
        try:
            self._file = parquet.ParquetFile(source if isinstance(source, Path) else io.BytesIO(source))
        except Exception as error:  # pyarrow raises many kinds for a broken file
            raise InputError(f"cannot be read as a table: Parquet: {one_line(error)}") from None

    def __len__(self) -> int:
        return int(self._file.metadata.num_rows)

    @property
    def described(self) -> Any:
        """What pyarrow knows of the row groups."""
        return self._file.metadata

    @property
    def names(self) -> tuple[str, ...]:
        """Columns."""
        return tuple(self._file.schema_arrow.names)

    def header(self) -> ColumnTable:
        """Return a table of all columns, without rows."""
        return self._table(self._file.schema_arrow.empty_table())

    def whole(self) -> ColumnTable:
        """Return the table of all columns and rows."""
        return self._table(quietly(self._file.read, "Parquet"))

    def tables(
        self, names: Iterable[str], within: Mapping[str, tuple[float, float]] | None = None
    ) -> Iterator[tuple[int, ColumnTable]]:
        """Yield the first row and a table of some columns of each row group.

        Args:
            names: Of the columns; no others are read.
            within: Smallest and largest number of columns: groups whose statistics lie outside are passed over.
        """
        wanted = set(names)
        # astropy keeps the masks of columns so.
        columns = [name for name in self.names if name in wanted or name.removesuffix(".mask") in wanted]
        first = 0
        for group in range(self._file.metadata.num_row_groups):
            described = self._file.metadata.row_group(group)
            if not _lies_outside(described, within or {}):
                read = quietly(partial(self._file.read_row_group, group, columns=columns), "Parquet")
                yield first, self._table(read)
            first += described.num_rows

    def _table(self, source: Any) -> ColumnTable:
        return ColumnTable(quietly(lambda: _table_of_arrow(source), "Parquet"), all_names=self.names)


def rows_of_files(path: Path) -> dict[str, int]:
    """Rows by name of file that a `_metadata` lists; those of its own, without a name, are left out.

    Raises:
        InputError: It cannot be read.
    """
    described = ParquetFile(path).described
    rows: dict[str, int] = {}
    for number in range(described.num_row_groups):
        group = described.row_group(number)
        name = group.column(0).file_path if group.num_columns else ""
        if name:
            rows[name] = rows.get(name, 0) + int(group.num_rows)
    return rows


def _lies_outside(group: Any, within: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether no row of a row group has a number in the range of its column, by the group's statistics."""
    for number in range(group.num_columns):
        column = group.column(number)
        if column.path_in_schema in within:
            low, high = within[column.path_in_schema]
            statistics = column.statistics
            known = statistics is not None and statistics.has_min_max
            # Text has its own order.
            if known and isinstance(statistics.max, int | float) and (statistics.max < low or statistics.min > high):
                return True
    return False


def _table_of_arrow(source: Any) -> Table:
    """Table of pyarrow's, with units and meta where astropy wrote the file; nulls are masked."""
    from astropy.table import MaskedColumn, Table
    from astropy.table.meta import get_header_from_yaml

    yaml = (source.schema.metadata or {}).get(b"table_meta_yaml")
    header = get_header_from_yaml(yaml.decode().split("\n")) if yaml else {"datatype": []}
    units = {column["name"]: column.get("unit") for column in header["datatype"]}
    table = Table(meta={key: value for key, value in header.get("meta", {}).items() if not key.startswith("__")})
    masks = {f"{name}.mask" for name in source.column_names}  # astropy's masked columns keep their masks so
    for name in (name for name in source.column_names if name not in masks):
        missing = np.asarray(source[name].is_null())
        given = np.asarray(source[name].drop_null())
        values = np.zeros(len(missing), dtype=given.dtype)
        values[~missing] = given
        if f"{name}.mask" in source.column_names:
            missing = missing | np.asarray(source[f"{name}.mask"])
        table[name] = MaskedColumn(values, mask=missing) if missing.any() else values
        table[name].unit = units.get(name)
    return table
