"""Tables of stars: columns of an astropy Table to those of a catalog, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import BAND_NAMES, NUMBER_UNITS, checked_columns
from warpsim.sky.photometric_bands import (
    brightness_columns,
    check_flux_columns,
    flag_column,
    flux_column,
    limit_column,
    photometric_bands,
)
from warpsim.sky.readers.own_table import arrays_of_columns, known_columns
from warpsim.sky.star_photometry import StarPhotometry
from warpsim.sky.stars import Stars
from warpsim.tables.columns import ColumnTable

if TYPE_CHECKING:
    from astropy.table import Table


def stars_of_table(table: Table, name: str | None = None) -> Stars:
    """The stars of an astropy Table as StarCatalog.from_table() lists them."""
    check_flux_columns(table.colnames)
    missing = [key for key in ("ra_deg", "dec_deg") if key not in table.colnames]
    if not brightness_columns(table.colnames):
        missing.append(f"flux_X_jy or mag_X with X one of {', '.join(photometric_bands())}")
    if missing:
        found = ", ".join(table.colnames) or "no columns"
        raise InputError(f"must have the column {' and '.join(missing)}", "table", found, "s")
    meta = {str(key).lower(): value for key, value in table.meta.items()}  # FITS turns keys to capitals
    arrays = arrays_of_columns(ColumnTable(table), {key: key for key in known_columns() if key in table.colnames})
    return checked_columns(**arrays, name=name or str(meta.get("name", "stars")), filled=meta.get("filled") is True)


def table_of(stars: Stars, photometry: StarPhotometry) -> Table:
    """Return stars as an astropy Table that stars_of_table() reads back."""
    from astropy.table import Table

    flux_jy = {**photometry.given_jy, **{band: stars.flux_jy(band) for band in BAND_NAMES}}
    flux_flag = {**photometry.given_flag, **{band: stars.flux_flag(band) for band in BAND_NAMES}}
    bands = sorted(flux_jy, key=list(photometric_bands()).index)
    columns: dict[str, Any] = {
        **{key: getattr(stars, key) for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas")},
        **{flux_column(band): flux_jy[band] for band in bands},
        "quality": stars.quality,
        "id": stars.id,
        "temperature_k": stars.temperature_k,
        "luminosity": stars.luminosity.astype(np.int16),  # VOTable has no shorter signed numbers
        **{flag_column(band): flux_flag[band] for band in bands},
        **{limit_column(band): limit_jy for band, limit_jy in photometry.limit_jy.items()},
    }
    units = {key: NUMBER_UNITS.get(key, "Jy" if key.endswith("_jy") else "") for key in columns}
    meta = {"name": stars.name, "epoch_jyear": stars.epoch_jyear, "provenance": stars.provenance}
    meta["filled"] = photometry.filled
    return Table(columns, units={key: unit for key, unit in units.items() if unit}, meta=meta)
