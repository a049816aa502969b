"""Files that astropy reads, with what it warns and raises turned into errors of one line."""

from __future__ import annotations

import importlib
import io
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError, one_line
from warpsim.tables.astropy_calls import quietly
from warpsim.tables.cells import MISSING, cells_of, decoded, is_number
from warpsim.tables.delimited import check_cells
from warpsim.tables.lines import check_last_line, lines_of

if TYPE_CHECKING:
    from astropy.table import Table

_NUMBER_TYPES = ("int", "float", "double", "real", "long", "uint", "i", "f", "d", "r", "l")
_NULLS = [(text, "0") for text in ("null", "NULL", "")]
"""What stands for a missing value in ECSV: "null" in Gaia's bulk files."""

_ECSV_COLUMN = re.compile(rb"^#\s*-\s*\{name:\s*(?P<name>.+?),.*?datatype:\s*(?P<type>\w+)")


def read_fits(data: bytes) -> Table:
    """The table of a FITS file; of several, the first, with a warning."""
    from astropy.table import Table

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            table = Table.read(io.BytesIO(data), format="fits")
            said = None
        except Exception as error:  # astropy raises many kinds for a broken file
            table, said = None, one_line(error)
    # Where data are missing astropy warns, and may go on.
    if any(word in str(warning.message) for warning in caught for word in ("truncated", "Error validating header")):
        raise InputError("ends early: the FITS data are cut off")
    several = next((str(warning.message) for warning in caught if "multiple tables" in str(warning.message)), None)
    if several is not None:
        warn_of_several(_n_fits_tables(data), "FITS file")
    if table is None:
        if said == "No table found":
            raise InputError("must hold a table, got FITS without one (it may be cut off)")
        raise InputError(f"cannot be read as a table: FITS: {said}")
    return table


def read_votable(data: bytes, what: str = "a table") -> Table:
    """First table of a VOTable; `what` says in messages what it must be a table of."""
    from astropy.io.votable import parse_single_table

    status = _query_status(data)
    if status is not None and status[0] == "ERROR":
        raise InputError(f"must be {what}, got an error from the archive: {status[1]}")
    if b"</VOTABLE" not in data.upper()[-200:] and not re.search(rb"</\w+:VOTABLE", data[-200:], re.IGNORECASE):
        raise InputError("ends early: the VOTable is not closed")
    if not re.search(rb"<(\w+:)?TABLE[\s>]", data):
        raise InputError("must hold a table, got a VOTable without one")
    if status is not None and status[0] == "OVERFLOW":
        warnings.warn("the VOTable holds a part only: the archive stopped at its row limit", stacklevel=2)

    n_table = len(re.findall(rb"<(?:\w+:)?TABLE[\s>]", data))
    if n_table > 1:
        warn_of_several(n_table, "VOTable")

    def parse() -> Table:
        return parse_single_table(io.BytesIO(data), verify="ignore").to_table(use_names_over_ids=True)

    return quietly(parse, "VOTable")


def warn_of_several(n_table: int, what: str) -> None:
    """Warn that only one of several tables is read."""
    warnings.warn(f"the {what} holds {n_table} tables, and only the first is read; save the others apart", stacklevel=2)


def _n_fits_tables(data: bytes) -> int:
    from astropy.io import fits

    with fits.open(io.BytesIO(data)) as hdus:
        return sum(isinstance(hdu, fits.BinTableHDU | fits.TableHDU) for hdu in hdus)


def read_parquet(data: bytes) -> Table:
    """A Parquet file, through pyarrow alone: astropy's own reader needs pandas too."""
    try:
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise InputError("cannot be read: Parquet needs the package pyarrow (pip install pyarrow)") from None
    if not data.endswith(b"PAR1"):
        raise InputError("ends early: the Parquet data are cut off")
    return quietly(lambda: _table_of_arrow(parquet.read_table(io.BytesIO(data))), "Parquet")


def _table_of_arrow(source: Any) -> Table:
    """Table of pyarrow's, with units and meta where astropy wrote the file; nulls are masked."""
    from astropy.table import MaskedColumn, Table
    from astropy.table.meta import get_header_from_yaml

    yaml = (source.schema.metadata or {}).get(b"table_meta_yaml")
    header = get_header_from_yaml(yaml.decode().split("\n")) if yaml else {"datatype": []}
    units = {column["name"]: column.get("unit") for column in header["datatype"]}
    meta = {key: value for key, value in header.get("meta", {}).items() if not key.startswith("__")}
    table = Table(meta=meta)
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


def read_by_name(path: Path, format: str) -> Table:
    """A file in any other of astropy's formats."""
    from astropy.table import Table

    return quietly(lambda: Table.read(path, format=format), f"format {format!r}")


def read_ecsv(data: bytes) -> tuple[Table, NDArray[np.int64]]:
    """An ECSV file, and the line of each row, counted from 1."""
    from astropy.table import Table

    lines = lines_of(data, skip=(b"#",))
    check_last_line(lines)
    if not len(lines):
        raise InputError("ends early: the ECSV header names columns, but no line with their names follows")
    delimiter = "," if re.search(rb"^#\s*delimiter:\s*'?,", data[:100_000], re.MULTILINE) else " "
    rows = [decoded(line) for line in lines.text]
    names = cells_of(rows[0], delimiter)
    check_cells(rows, lines.number, delimiter, len(names))
    types = {
        match["name"].strip(b"'\""): match["type"] for match in map(_ECSV_COLUMN.match, data.split(b"\n")) if match
    }

    def locate() -> None:
        for column, name in enumerate(names):
            if types.get(name.encode(), b"").decode().startswith(_NUMBER_TYPES[:6]):
                cells = [cells_of(row, delimiter)[column] for row in rows[1:]]
                _check_numbers(name, cells, lines.number[1:])

    text = data.decode("utf-8", errors="replace")
    return quietly(
        lambda: Table.read(text.split("\n"), format="ascii.ecsv", fill_values=_NULLS), "ECSV", locate
    ), lines.number[1:]


def read_ipac(data: bytes) -> tuple[Table, NDArray[np.int64]]:
    """An IPAC table, and the line of each row, counted from 1."""
    from astropy.table import Table

    body = lines_of(data, skip=(b"\\", b"|"))
    header = [line for line in lines_of(data, skip=(b"\\",)).text if line.startswith(b"|")]
    if len(header) < 2 or header[0].count(b"|") < 3:
        raise InputError(
            "cannot be read as a table: IPAC table: two lines of names and types between bars must begin it"
        )
    check_last_line(body if len(body) else lines_of(data))
    bars = [column for column, byte in enumerate(header[0]) if byte == ord("|")]
    for number, row in zip(body.number.tolist(), body.text, strict=True):
        if len(row) <= bars[-2]:  # a stripped last column may be shorter than its title
            text = f"must reach the last column, which begins at byte {bars[-2] + 2}, got {len(row)} bytes"
            raise InputError(text).of(f"line {number}")
    names, types = ([cell.strip() for cell in decoded(line).split("|")[1:-1]] for line in header[:2])

    def locate() -> None:
        for column, (name, kind) in enumerate(zip(names, types, strict=False)):
            if kind.lower().startswith(_NUMBER_TYPES):
                cells = [decoded(row[bars[column] + 1 : bars[column + 1]]) for row in body.text]
                _check_numbers(name, cells, body.number)

    text = data.decode("utf-8", errors="replace")
    return quietly(lambda: Table.read(text.split("\n"), format="ascii.ipac"), "IPAC table", locate), body.number


def _check_numbers(name: str, cells: list[str], line_of_row: NDArray[np.int64]) -> None:
    for row, cell in enumerate(cells):
        text = cell.strip().strip('"')
        if text.lower() not in MISSING and not is_number(text):
            raise InputError("must be a number", value=text).of(f"column {name}").of(f"line {line_of_row[row]}")


def _query_status(data: bytes) -> tuple[str, str] | None:
    """Status of an archive's answer: the value and text of the last INFO named QUERY_STATUS."""
    found = None
    for match in re.finditer(rb"<INFO\b([^>]*QUERY_STATUS[^>]*?)(/>|>(.*?)</INFO>)", data, re.DOTALL):
        value = re.search(rb"value\s*=\s*[\"'](\w+)", match[1])
        if value:
            found = (value[1].decode().upper(), " ".join((match[3] or b"").decode("utf-8", "replace").split())[:200])
    return found
