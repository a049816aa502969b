"""Tables as Parquet files, with units and descriptions, for pyarrow, pandas, Polars, DuckDB and others."""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError
from warpsim.files import plain_number, whole_file
from warpsim.labels.column_meanings import DESCRIPTIONS

if TYPE_CHECKING:
    from astropy.table import Table

META_KEY = b"warpsim"
"""Key of the file's metadata that holds the table's meta, as JSON."""


def write_parquet(table: Table, path: str | Path, meta: Mapping[str, Any] | None = None) -> None:
    """Write a table, whole or not at all; the same table gives the same bytes.

    Texts are coded by a dictionary, but for those of columns of Python objects. Each column carries its unit and what
    it means in the metadata of its field (keys `unit` and `description`); the table's meta is JSON in the file's
    metadata, key `warpsim`. Masked values are nulls.

    Args:
        table: Truth, stars, labels, or any table whose columns hold one number or text, or a fixed number of numbers.
        path: File to write; replaced if it is there.
        meta: Added to the table's meta; what JSON can hold.

    Raises:
        InputError: pyarrow is not installed, or a value of meta is nothing for JSON.
    """
    arrow, parquet = _pyarrow(path)
    fields, arrays = [], []
    for name in table.colnames:
        array = _array(arrow, table[name])
        arrays.append(array)
        fields.append(arrow.field(name, array.type, metadata=_field_meta(table[name])))
    try:
        text = json.dumps({**table.meta, **(meta or {})}, sort_keys=True, default=plain_number)
    except TypeError as error:
        raise InputError(str(error), "meta").of(path) from None
    schema = arrow.schema(fields, metadata={META_KEY: text.encode()})
    with whole_file(Path(path)) as partial:
        parquet.write_table(arrow.Table.from_arrays(arrays, schema=schema), partial, compression="zstd")


def read_parquet(path: str | Path) -> Table:
    """Read a table that `write_parquet` wrote, with units, descriptions and meta.

    Raises:
        InputError: pyarrow is not installed, or the file cannot be read.
    """
    from astropy.table import MaskedColumn, Table

    arrow, parquet = _pyarrow(path)
    try:
        source = parquet.read_table(Path(path))
    except (OSError, arrow.ArrowException) as error:
        raise InputError(f"cannot be read: {str(error).splitlines()[0]}").of(path) from None
    table = Table(meta=json.loads((source.schema.metadata or {}).get(META_KEY, b"{}")))
    for field, column in zip(source.schema, source.columns, strict=True):
        values, missing = _values(arrow, column.combine_chunks(), field.type)
        table[field.name] = MaskedColumn(values, mask=missing) if missing.any() else values
        meta = field.metadata or {}
        table[field.name].unit = meta[b"unit"].decode() if b"unit" in meta else None
        table[field.name].info.description = meta[b"description"].decode() if b"description" in meta else None
    return table


def _pyarrow(path: str | Path) -> tuple[Any, Any]:
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError:
        text = f"{path}: needs pyarrow, which the extra `parquet` brings: pip install 'warpsim[parquet]'"
        raise InputError(text) from None


def _array(arrow: Any, column: Any) -> Any:
    """A column as pyarrow has it."""
    missing = np.ma.getmaskarray(column) if hasattr(column, "mask") else None
    values = np.asarray(column)
    if values.dtype.kind == "O":
        return arrow.array(values.tolist(), arrow.string(), mask=missing)
    if values.dtype.kind in "US":
        return arrow.array(values.astype(np.str_), arrow.string(), mask=missing).dictionary_encode()
    if values.dtype.byteorder == ">":  # tables that were read from FITS
        values = values.astype(values.dtype.newbyteorder("="))
    if values.ndim == 1:
        return arrow.array(values, mask=missing)
    flat = arrow.array(values.reshape(-1))
    return arrow.FixedSizeListArray.from_arrays(flat, int(np.prod(values.shape[1:])))


def _values(arrow: Any, array: Any, kind: Any) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Values of a column, of any kind where they are missing, and where they are."""
    missing = np.asarray(array.is_null())
    if arrow.types.is_fixed_size_list(kind):
        return np.asarray(array.flatten()).reshape(len(array), kind.list_size), missing
    if arrow.types.is_dictionary(kind):
        names = np.array([*array.dictionary.to_pylist(), ""], dtype=np.str_)  # the last one where it is missing
        return names[np.asarray(array.indices.fill_null(len(names) - 1))], missing
    if arrow.types.is_string(kind):
        return np.array(array.to_pylist(), dtype=object), missing
    if missing.any():
        array = array.fill_null(False if arrow.types.is_boolean(kind) else 0)
    return np.asarray(array), missing


def _field_meta(column: Any) -> dict[str, str]:
    meta = {}
    if column.unit is not None:
        meta["unit"] = str(column.unit)
    description = column.info.description or DESCRIPTIONS.get(column.info.name)
    if description:
        meta["description"] = str(description)
    return meta
