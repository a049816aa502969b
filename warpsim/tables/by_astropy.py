"""Files that astropy or pyarrow reads, with what they warn and raise turned into errors of one line.

Parquet is read through pyarrow alone (astropy's own reader needs pandas too): some columns, a row group at a time.
"""

from __future__ import annotations

import html
import importlib
import io
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError, one_line
from warpsim.tables.checked_files import CUT_OFF, checked_fits
from warpsim.tables.columns import ColumnTable, Part

if TYPE_CHECKING:
    from astropy.table import Table


def quietly(read: Callable[[], Any], what: str) -> Table:
    """Result of a reader of astropy's, without its warnings; what it raises becomes an InputError of one line."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read()
    except Exception as error:  # readers of foreign formats raise many kinds for a broken file
        raise InputError(f"cannot be read as a table: {what}: {one_line(error)}") from None


def cds_unit(text: str) -> Any:
    """Unit as the CDS spells it; one that astropy does not know is kept, and converts to nothing."""
    from astropy.units import Unit

    return Unit(text.strip(), format="cds", parse_strict="silent")


def read_by_name(path: Path, format: str) -> Table:
    """A file in any of astropy's formats."""
    from astropy.table import Table

    return quietly(lambda: Table.read(path, format=format), f"format {format!r}")


def fits_tables(data: bytes) -> list[Part]:
    """The tables of a FITS file, by the names of their HDUs."""
    from astropy.io import fits

    data = checked_fits(data)
    with _whole_fits():
        hdus = fits.open(io.BytesIO(data))
        tables = [(k, hdu) for k, hdu in enumerate(hdus) if isinstance(hdu, fits.BinTableHDU | fits.TableHDU)]
        named = [(k, hdu.name, tuple(hdu.columns.names)) for k, hdu in tables]
    if not named:
        raise InputError("must hold a table, got FITS without one (it may be cut off)")
    return [Part(name, columns, partial(_read_fits, data, k)) for k, name, columns in named]


def _read_fits(data: bytes, hdu: int) -> ColumnTable:
    from astropy.io import fits
    from astropy.table import Table

    with _whole_fits():
        table = Table.read(io.BytesIO(data), format="fits", hdu=hdu)
        header = fits.getheader(io.BytesIO(data), hdu).tostring("\n")
    return ColumnTable(table, header=header)


@contextmanager
def _whole_fits() -> Iterator[None]:
    """Errors of astropy in one line, and of missing data, of which it may only warn."""
    failed = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        except Exception as error:  # astropy raises many kinds for a broken file
            failed = InputError(f"cannot be read as a table: FITS: {one_line(error)}")
    texts = " ".join(str(warning.message) for warning in caught)
    if "truncated" in texts or "Error validating header" in texts:
        raise InputError(CUT_OFF) from None
    if failed is not None:
        raise failed from None


_TABLE = re.compile(rb"<(?:\w+:)?TABLE\b([^>]*?)(?:/>|>(.*?)</(?:\w+:)?TABLE\s*>)", re.DOTALL)
_FIELD = re.compile(rb"<(?:\w+:)?FIELD\b[^>]*>", re.DOTALL)
_DATA = re.compile(rb"<(?:\w+:)?DATA\b.*?</(?:\w+:)?DATA\s*>", re.DOTALL)


def votable_tables(data: bytes, what: str = "a table") -> list[Part]:
    """The tables of a VOTable, found without parsing them; `what` says in messages what it must be a table of."""
    status, text = _query_status(data)
    if status == "ERROR":
        raise InputError(f"must be {what}, got an error from the archive: {text}")
    if re.search(rb"<!ENTITY", data.partition(b"<VOTABLE")[0]):
        raise InputError("must declare no entities of its own")
    if not re.search(rb"</(\w+:)?VOTABLE", data[-200:], re.IGNORECASE):
        raise InputError("ends early: the VOTable is not closed")
    found = list(_TABLE.finditer(data))
    if not found:
        raise InputError("must hold a table, got a VOTable without one")
    if status == "OVERFLOW":
        warnings.warn("the VOTable holds a part only: the archive stopped at its row limit", stacklevel=2)
    parts = []
    for match in found:
        fields = [_attribute(field[0], "name") for field in _FIELD.finditer(_DATA.sub(b"", match[2] or b""))]
        name = _attribute(match[1], "name") or _attribute(match[1], "ID")
        parts.append(Part(name, tuple(fields), partial(_read_votable, data, found, match)))
    return parts


def _attribute(element: bytes, name: str) -> str:
    """Value of an attribute in the text of an element's tag; "" without it."""
    match = re.search(rb"(?<!\w)" + name.encode() + rb"\s*=\s*(\"[^\"]*\"|'[^']*')", element)
    return html.unescape(match[1][1:-1].decode("utf-8", "replace")) if match else ""


def _read_votable(data: bytes, tables: list[re.Match[bytes]], one: re.Match[bytes]) -> ColumnTable:
    """One table of a VOTable: the others are cut out before astropy parses the rest."""
    from astropy.io.votable import parse_single_table

    pieces, start = [], 0
    for table in tables:
        if table is not one:
            pieces.append(data[start : table.start()])
            start = table.end()
    alone = b"".join([*pieces, data[start:]])

    def parse() -> Table:
        return parse_single_table(io.BytesIO(alone), verify="ignore").to_table(use_names_over_ids=True)

    header = _DATA.sub(b"", alone).decode("utf-8", "replace")
    return ColumnTable(quietly(parse, "VOTable"), header=header)


def _query_status(data: bytes) -> tuple[str, str]:
    """Status of an archive's answer: the value and text of the last INFO named QUERY_STATUS; two blanks without one."""
    found = "", ""
    for match in re.finditer(rb"<INFO\b([^>]*QUERY_STATUS[^>]*?)(/>|>(.*?)</INFO>)", data, re.DOTALL):
        value = re.search(rb"value\s*=\s*[\"'](\w+)", match[1])
        if value:
            found = value[1].decode().upper(), " ".join((match[3] or b"").decode("utf-8", "replace").split())[:200]
    return found


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

        `within` are smallest and largest number of columns: groups whose statistics lie outside are passed over.
        """
        required = set(names)
        # astropy keeps the masks of columns so.
        columns = [name for name in self.names if name in required or name.removesuffix(".mask") in required]
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
