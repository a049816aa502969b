"""A custom table: which of its columns holds what, in which unit; byte layouts of catalog files without a ReadMe."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import COLOUR, NUMBER_UNITS
from warpsim.sky.photometric_bands import (
    brightness_columns,
    flag_column,
    flux_column,
    flux_of_colour_jy,
    flux_of_magnitude_jy,
    limit_column,
    magnitude_column,
    photometric_bands,
    sloan_g,
)
from warpsim.sky.readers.survey import angle_deg, has_parts, note_position, position_deg, real_colours, real_magnitudes
from warpsim.sky.space_motion import J2000_JYEAR
from warpsim.tables.columns import ColumnTable, plain_name
from warpsim.tables.fixed_width import ByteField, Layout

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


def _right_ascension(first_byte: int, seconds: ByteField) -> tuple[ByteField, ...]:
    return (
        ByteField("RAh", first_byte, first_byte + 1, "whole", "h", largest=23),
        ByteField("RAm", first_byte + 2, first_byte + 3, "whole", "min", largest=59),
        seconds,
    )


def _declination(first_byte: int, seconds: ByteField) -> tuple[ByteField, ...]:
    # The sign has a column of its own: a number cannot say -0 degrees.
    return (
        ByteField("DE-", first_byte, first_byte, "sign"),
        ByteField("DEd", first_byte + 1, first_byte + 2, "whole", "deg", largest=90),
        ByteField("DEm", first_byte + 3, first_byte + 4, "whole", "arcmin", largest=59),
        seconds,
    )


def _msx_irac() -> Layout:
    """V/98 `msx.dat`, version 4.2.1. Bytes 1-21 and 93-132 hold names and other surveys' data, and are not read."""
    fluxes = tuple(
        ByteField(f"FSIII{band}", 133 + 9 * k, 141 + 9 * k, unit="Jy")
        for k, band in enumerate(("A", "B1", "B2", "C", "D", "E"))
    )
    fields = (
        *_right_ascension(22, ByteField("RAs", 26, 31, unit="s", largest=60)),
        *_declination(32, ByteField("DEs", 37, 41, unit="arcsec", largest=60)),
        ByteField("pmRA", 53, 61),  # seconds of time per century, which no unit name says
        ByteField("pmDE", 62, 70),  # arcsec per century
        ByteField("SpType", 83, 85, "text"),
        ByteField("Vmag", 88, 92, unit="mag"),
        *fluxes,
    )
    return Layout(fields, shortest=186, length=186, longest=400, name="msx-irac")


def _msx_psc_v1() -> Layout:
    """V/107, version 1.2: a23, 2 f9.4, 2 f4.1, f5.1, i3, then 45 bytes a band, then 3 x 6 flags."""
    fields = [
        ByteField("MSX5C", 1, 23, "text"),
        ByteField("RAdeg", 25, 33, unit="deg"),
        ByteField("DEdeg", 35, 43, unit="deg"),
    ]
    marks = [(24, " "), (34, " "), (44, " "), (49, " "), (54, " "), (60, " ")]
    for k, band in enumerate(("B1", "B2", "A", "C", "D", "E")):  # as VizieR has them: by wavelength but for A
        start = 64 + 45 * k  # of the blank before the flux
        fields.append(ByteField(band, start + 1, start + 12, unit="Jy"))
        fields.append(ByteField(f"q_{band}", start + 14, start + 14, "whole", largest=4))
        marks += [(start, " "), (start + 13, " "), (start + 15, " ")]
    return Layout(tuple(fields), shortest=333, length=354, longest=360, marks=tuple(marks), name="msx-psc-v1")


def _iras_psc() -> Layout:
    """II/125 `main.dat`, version 2.0; positions of B1950."""
    bands = ("12", "25", "60", "100")
    fields = (
        ByteField("IRAS", 1, 11, "text"),
        *_right_ascension(12, ByteField("RAds", 16, 18, "whole", largest=600)),  # tenths of a second
        *_declination(19, ByteField("DEs", 24, 25, "whole", "arcsec", largest=60)),
        *(ByteField(f"Fnu_{band}", 37 + 9 * k, 45 + 9 * k, unit="Jy") for k, band in enumerate(bands)),
        *(ByteField(f"q_Fnu_{band}", 73 + k, 73 + k, "whole", largest=3) for k, band in enumerate(bands)),
        *(ByteField(f"e_Fnu_{band}", 81 + 3 * k, 83 + 3 * k, "whole", unit="%") for k, band in enumerate(bands)),
        ByteField("Var", 117, 118, "whole", unit="%"),
        ByteField("Confuse", 120, 120, "text"),
    )
    return Layout(fields, shortest=139, length=157, longest=170, name="iras-psc")


def _hipparcos() -> Layout:
    """I/239 `hip_main.dat`; columns stand in fixed bytes between bars."""
    fields = (
        ByteField("HIP", 9, 14, "whole"),
        ByteField("RAhms", 18, 28, "text"),  # all there is of 263 stars without an astrometric solution
        ByteField("DEdms", 30, 40, "text"),
        ByteField("Vmag", 42, 46, unit="mag"),
        ByteField("RAdeg", 52, 63, unit="deg"),
        ByteField("DEdeg", 65, 76, unit="deg", largest=90),
        ByteField("Plx", 80, 86, unit="mas"),
        ByteField("pmRA", 88, 95, unit="mas/yr"),
        ByteField("pmDE", 97, 104, unit="mas/yr"),
        ByteField("B-V", 246, 251, unit="mag"),
        ByteField("V-I", 261, 264, unit="mag"),
        ByteField("Hpmag", 275, 281, unit="mag"),
        ByteField("HD", 391, 396, "whole"),
        ByteField("SpType", 436, 447, "text"),
    )
    bars = (2, 15, 17, 29, 41, 47, 49, 51, 64, 77, 79, 87, 96, 105, 252, 265, 274, 282)
    marks = tuple((byte, "|") for byte in bars)
    return Layout(fields, shortest=390, length=449, longest=470, marks=marks, name="hipparcos")


def _hipparcos_2() -> Layout:
    """I/311 `hip2.dat`; positions in radians."""
    fields = (
        ByteField("HIP", 1, 6, "whole"),
        ByteField("RArad", 16, 28, unit="rad", largest=6.2832),
        ByteField("DErad", 30, 42, unit="rad", largest=1.5708),
        ByteField("Plx", 44, 50, unit="mas"),
        ByteField("pmRA", 52, 59, unit="mas/yr"),
        ByteField("pmDE", 61, 68, unit="mas/yr"),
        ByteField("Hpmag", 130, 136, unit="mag"),
        ByteField("B-V", 153, 158, unit="mag"),
        ByteField("V-I", 166, 171, unit="mag"),
    )
    blanks = (7, 11, 13, 15, 29, 43, 51, 60, 69, 76, 83, 90, 97, 104, 129, 137, 152, 159, 165)
    marks = tuple((byte, " ") for byte in blanks)
    return Layout(fields, shortest=171, length=276, longest=290, marks=marks, name="hipparcos-2")


def _akari_irc() -> Layout:
    """II/297 `irc.dat`, version 1."""
    fields = (
        ByteField("objID", 2, 10, "whole"),
        ByteField("objName", 12, 25, "text"),
        ByteField("RAdeg", 27, 35, unit="deg", largest=360),
        ByteField("DEdeg", 37, 45, unit="deg", largest=90),
        ByteField("S09", 70, 80, unit="Jy", null=-999.9),
        ByteField("S18", 81, 91, unit="Jy", null=-999.9),
        ByteField("e_S09", 92, 101, unit="Jy", null=-1000),
        ByteField("e_S18", 102, 111, unit="Jy", null=-1000),
        ByteField("q_S09", 113, 113, "whole", largest=3),
        ByteField("q_S18", 115, 115, "whole", largest=3),
        ByteField("f09", 120, 120, "text"),
        ByteField("f18", 125, 125, "text"),
        ByteField("X09", 161, 162, "whole", null=-1),
        ByteField("X18", 164, 165, "whole", null=-1),
    )
    blanks = (11, 26, 36, 112, 114, 116, 121, 126)
    marks = tuple((byte, " ") for byte in blanks)
    return Layout(fields, shortest=165, length=196, longest=210, marks=marks, name="akari-irc")


LAYOUTS: tuple[Layout, ...] = (
    _msx_irac(),
    _msx_psc_v1(),
    _iras_psc(),
    _hipparcos(),
    _hipparcos_2(),
    _akari_irc(),
)

FILE_NAMES = {
    "msx.dat": "msx-irac",
    "hip_main.dat": "hipparcos",
    "hip2.dat": "hipparcos-2",
    "irc.dat": "akari-irc",
}
"""Surveys by their archive's file name: what a file is taken for whose lines follow no layout, to say what is wrong."""


def likely_layout(file_name: str, survey: str | None) -> Layout | None:
    """The layout that a text without columns should follow: that of the survey asked for, or of the file's name."""
    name = survey or FILE_NAMES.get(file_name.lower().removesuffix(".gz"))
    return next((layout for layout in LAYOUTS if layout.name == name), None)
