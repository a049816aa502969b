"""A custom table: which of its columns holds what, in which unit; tables of astropy to stars and back."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import BAND_NAMES, COLOUR, NUMBER_UNITS, checked_columns
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
    sloan_g,
)
from warpsim.sky.positions import J2000_JYEAR
from warpsim.sky.readers.survey import angle_deg, has_parts, note_position, position_deg, real_colours, real_magnitudes
from warpsim.sky.star_photometry import StarPhotometry
from warpsim.sky.stars import Stars
from warpsim.tables.columns import ColumnTable, plain_name

if TYPE_CHECKING:
    from astropy.table import Table

_ANGLES = ("ra_deg", "dec_deg")
_OTHERS = (COLOUR, "id", "spectral_type", "epoch_jyear")
_SHORT = ", ".join(
    [*NUMBER_UNITS, "flux_<band>_jy", "mag_<band>", "flux_<band>_flag", "flux_<band>_limit_jy", *_OTHERS]
)


def known_columns() -> tuple[str, ...]:
    """Names that the argument `columns` knows; a table that uses them needs no such argument."""
    bands = photometric_bands()
    return (*NUMBER_UNITS, *_brightnesses(), *map(flag_column, bands), *map(limit_column, bands), *_OTHERS)


def _brightnesses() -> tuple[str, ...]:
    return tuple(name(band) for name in (flux_column, magnitude_column) for band in photometric_bands())


def own_columns(table: ColumnTable) -> dict[str, str]:
    """The table's columns that go by warpsim's names, whatever their case, and one of B-V."""
    names = {name.lower(): name for name in reversed(table.table.colnames)}
    names |= {name: name for name in table.table.colnames}  # spelled just so
    spelled = {column: column if column in names else column.lower() for column in known_columns()}
    found = {column: names[name] for column, name in spelled.items() if name in names}
    b_v = table.find(COLOUR, "B-V")
    return found if b_v is None else {**found, COLOUR: b_v}


def set_sloan_apart(table: ColumnTable, spoken_of: Iterable[str]) -> None:
    """Rename columns of Sloan's g, which would be found as Gaia's G, unless they are spoken of by name."""
    named = {re.sub(r"\s*\[[^\]]*\]$", "", str(column)) for column in spoken_of}  # units apart
    for name in set(sloan_g(table.table.colnames)) - named:
        table.rename(name, f"{name} (Sloan's, not Gaia's)")


def is_own(columns: Mapping[str, str], table: ColumnTable) -> bool:
    """Return whether columns hold positions (in one column each, or in the CDS's parts) and a brightness."""
    in_parts = has_parts(table) and not columns.keys() & set(_ANGLES)
    has_place = in_parts or all(name in columns for name in _ANGLES)
    return has_place and not columns.keys().isdisjoint(_brightnesses())


def check_columns(columns: Mapping[str, str], table: ColumnTable) -> dict[str, str]:
    """The argument `columns`, with the table's own spelling of its columns, and what goes by warpsim's names already.

    A column may be followed by its unit, "F8 [mJy]", where the file does not state one.

    Raises:
        InputError: It knows no such name, names a column that the file has not or another unit than the file, or leaves
            out positions or every brightness.
    """
    checked: dict[str, str] = {}
    for given, column in columns.items():
        name = known_name(given)
        if name is None:
            hint = "a colour but B-V is no column, give both magnitudes; " if "-" in str(given) else ""
            raise InputError(f"{hint}must be of {_SHORT}", "columns", given)
        own_name = column_named(table, name, str(column))
        if name in _ANGLES and plain_name(own_name) in ("rah", "ded", "decd") and has_parts(table):
            rule = (
                f"{own_name} is one of RAh, RAm, RAs, DE-, DEd, DEm, DEs; leave ra_deg and dec_deg out, and positions "
                "are made of all of them"
            )
            raise InputError(rule).of(name).within("columns")
        if own_name in checked.values():
            rule = f"must be a column of its own, got {own_name!r} a second time"
            raise InputError(rule).of(name).within("columns")
        checked[name] = own_name
    bands, by_colour = brightness_columns(checked), COLOUR in checked
    if by_colour and "B" in bands:
        raise InputError(f"must be one of {bands['B']} and {COLOUR}, got both", "columns")
    # What the argument does not speak of, and the table names as warpsim does.
    spoken_of = {name for band in photometric_bands() for name in _names_of(band) if checked.keys() & _names_of(band)}
    checked |= {
        name: column
        for name, column in own_columns(table).items()
        if name not in checked and name not in spoken_of and column not in checked.values()
    }
    if by_colour and "V" not in brightness_columns(checked):
        raise InputError(f"must name mag_V or flux_V_jy with {COLOUR}: B is V + (B-V)", "columns")
    if not is_own(checked, table):
        raise InputError(f"must name ra_deg, dec_deg and a flux or magnitude, got {', '.join(checked)}", "columns")
    return checked


def known_name(name: Any) -> str | None:
    """The column that the argument `columns` means by a name; None if it knows no such name."""
    other = {"B-V": COLOUR, magnitude_column("K"): magnitude_column("Ks"), flux_column("K"): flux_column("Ks")}
    name = other.get(name, name)
    return name if name in known_columns() else None


def column_named(table: ColumnTable, name: str, column: str) -> str:
    """The table's own spelling of the column that is to be `name`, given as "F8", or with a unit as "F8 [mJy]"."""
    own_name = _own_name(table, column)
    if own_name is None:
        raise InputError(f"must be a column of the file ({table.names})", value=column).of(name).within("columns")
    return own_name


def _names_of(band: str) -> set[str]:
    return {flux_column(band), magnitude_column(band), flag_column(band), limit_column(band)}


def _own_name(table: ColumnTable, column: str) -> str | None:
    """The table's spelling of a column, given as "F8" or with a unit as "F8 [mJy]"; None if it has no such column."""
    own_name = column if column in table.table.colnames else table.find(column)
    with_unit = re.fullmatch(r"(.*\S)\s*\[(.+)\]", column)
    if own_name is not None and (with_unit is None or column in table.table.colnames):
        return own_name
    own_name = None if with_unit is None else _own_name(table, with_unit[1])
    if own_name is not None and with_unit is not None:
        from astropy.units import Unit

        try:
            unit = Unit(with_unit[2])
        except ValueError:
            raise InputError("must be in a unit known", value=with_unit[2]).of(column).within("columns") from None
        stated = table.table[own_name].unit
        if stated is not None and stated != unit:
            raise InputError(f"must be in the unit that the file states, {stated}").of(column).within("columns")
        table.table[own_name].unit = unit
    return own_name


def arrays_of_columns(table: ColumnTable, columns: Mapping[str, str]) -> dict[str, Any]:
    """Arguments of StarCatalog.from_arrays from a table's columns, by warpsim's names for them.

    Units of columns are converted; a column without one is in the unit of warpsim's name for it. Right ascension and
    declination may be sexagesimal text.
    """
    meta = {str(key).lower(): value for key, value in table.table.meta.items()}  # FITS turns keys to capitals
    arrays = _arrays_named(table, columns)
    if not any(name in columns for name in _ANGLES):
        arrays["ra_deg"], arrays["dec_deg"], _ = position_deg(table)
    epoch_jyear = meta.get("epoch_jyear", J2000_JYEAR)
    return {"epoch_jyear": epoch_jyear, "provenance": str(meta.get("provenance", "")), **arrays}


def merge_columns(arrays: dict[str, Any], table: ColumnTable, columns: Mapping[str, str]) -> None:
    """Put a table's columns, by warpsim's names for them, in the place of what a survey's reader made of the table."""
    named = _arrays_named(table, columns)
    for band in named["flux_jy"]:
        for of_band in ("flux_flag", "limit_jy"):
            arrays.get(of_band, {}).pop(band, None)
    for name, values in named.items():
        arrays[name] = {**arrays.get(name, {}), **values} if isinstance(values, dict) else values


def _arrays_named(table: ColumnTable, columns: Mapping[str, str]) -> dict[str, Any]:
    """Arguments of StarCatalog.from_arrays that columns are named for."""
    arrays: dict[str, Any] = {"flux_jy": {}, "flux_flag": {}, "limit_jy": {}}
    for name, column in columns.items():
        if name in _ANGLES:
            arrays[name] = angle_deg(table, column, hours=name == "ra_deg")
            if name == "dec_deg" and "ra_deg" in columns:
                note_position(table, columns["ra_deg"], column)
        elif name in NUMBER_UNITS:
            arrays[name] = table.number(column, unit=NUMBER_UNITS[name])
        elif name in ("id", "spectral_type"):
            arrays[name] = table.text(column)
        elif name == "epoch_jyear":
            epochs = np.unique(table.number(column))
            if len(epochs) > 1 or np.isnan(epochs).any():
                raise InputError(f"must be the same year in all rows, got {epochs[0]:g} and {epochs[-1]:g}", column)
            arrays[name] = float(epochs[0]) if len(epochs) else J2000_JYEAR
    for band, name in brightness_columns(columns).items():
        if name == flux_column(band):
            arrays["flux_jy"][band] = table.number(columns[name], unit="Jy")
        else:
            magnitudes = real_magnitudes(table.number(columns[name], unit="mag"))
            arrays["flux_jy"][band] = flux_of_magnitude_jy(band, magnitudes)
        if flag_column(band) in columns:
            arrays["flux_flag"][band] = table.number(columns[flag_column(band)])
    if COLOUR in columns and "V" in arrays["flux_jy"] and "B" not in arrays["flux_jy"]:
        b_v_mag = real_colours(table.number(columns[COLOUR], unit="mag"))
        arrays["flux_jy"]["B"] = flux_of_colour_jy(arrays["flux_jy"]["V"], b_v_mag)
    for band in photometric_bands():
        if limit_column(band) in columns:
            arrays["limit_jy"][band] = table.number(columns[limit_column(band)], unit="Jy")
    return arrays


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
