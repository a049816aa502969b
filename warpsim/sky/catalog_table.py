"""Tables of stars: columns of an astropy Table to those of a catalog, and back."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import COLOUR, NUMBER_UNITS, Array, StarColumns, checked_columns
from warpsim.sky.photometric_bands import (
    brightness_columns,
    check_flux_columns,
    flag_column,
    flux_column,
    flux_of_colour_jy,
    flux_of_magnitude_jy,
    limit_column,
    magnitude_column,
    photometric_bands,
)
from warpsim.sky.space_motion import J2000_JYEAR
from warpsim.tables.columns import ColumnTable, number_column

if TYPE_CHECKING:
    from astropy.table import Table


def columns_of_table(table: Table, name: str | None = None) -> StarColumns:
    """Columns held by an astropy Table as StarCatalog.from_table() lists them."""
    known = set(table.colnames)
    check_flux_columns(table.colnames)
    fluxes = brightness_columns(table.colnames)
    missing = [key for key in ("ra_deg", "dec_deg") if key not in known]
    if not fluxes:
        missing.append(f"flux_X_jy or mag_X with X one of {', '.join(photometric_bands())}")
    if missing:
        found = ", ".join(table.colnames) or "no columns"
        raise InputError(f"must have the column {' and '.join(missing)}", "table", found, "s")
    meta = {str(key).lower(): value for key, value in table.meta.items()}  # FITS turns keys to capitals

    def numbers_by_band(column: Any, unit: str) -> dict[str, Array]:
        return {band: number_column(table, column(band), unit) for band in photometric_bands() if column(band) in known}

    def texts(key: str) -> NDArray[np.str_] | None:
        return ColumnTable(table).text(key) if key in known else None

    magnitudes = numbers_by_band(magnitude_column, "mag")
    flux_jy = {
        band: flux_of_magnitude_jy(band, magnitudes[band]) if band in magnitudes else number_column(table, column, "Jy")
        for band, column in fluxes.items()
    }
    if COLOUR in known and "V" in flux_jy and "B" not in flux_jy:
        flux_jy["B"] = flux_of_colour_jy(flux_jy["V"], number_column(table, COLOUR, "mag"))
    checked = checked_columns(
        {key: number_column(table, key, unit) for key, unit in NUMBER_UNITS.items() if key in known},
        flux_jy,
        {band: flags for band, flags in numbers_by_band(flag_column, "").items() if band in fluxes},
        texts("id"),
        spectral_type=texts("spectral_type"),
        limit_jy=numbers_by_band(limit_column, "Jy"),
        epoch_jyear=meta.get("epoch_jyear", J2000_JYEAR),
        name=name or str(meta.get("name", "stars")),
        provenance=str(meta.get("provenance", "")),
    )
    return replace(checked, filled=checked.filled or meta.get("filled") is True)


def table_of(columns: StarColumns) -> Table:
    """Return columns as an astropy Table that columns_of_table() reads back; their names must be spelled out."""
    from astropy.table import Table

    table = Table(meta={"name": columns.name, "epoch_jyear": columns.epoch_jyear, "provenance": columns.provenance})
    table.meta["filled"] = columns.filled

    def put(key: str, values: NDArray[Any]) -> None:
        table[key] = values
        table[key].unit = NUMBER_UNITS.get(key) or None

    for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas"):
        put(key, getattr(columns, key))
    bands = sorted(columns.flux_jy, key=list(photometric_bands()).index)
    for band in bands:
        table[flux_column(band)] = columns.flux_jy[band]
        table[flux_column(band)].unit = "Jy"
    put("quality", columns.quality)
    table["id"] = columns.id
    put("temperature_k", columns.temperature_k)
    put("luminosity", columns.luminosity.astype(np.int16))  # VOTable has no shorter signed numbers
    for band in bands:
        table[flag_column(band)] = columns.flux_flag[band]
    for band, limit_jy in columns.limit_jy.items():
        table[limit_column(band)] = limit_jy
        table[limit_column(band)].unit = "Jy"
    return table
