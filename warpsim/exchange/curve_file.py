"""Files of curves over wavelength: responses of filters and detectors, reflectances of surfaces."""

from __future__ import annotations

import hashlib
import re
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from warpsim.arrays import F64
from warpsim.errors import InputError, errors_at
from warpsim.radiometry.curve_nodes import checked_curve
from warpsim.tables.columns import ColumnTable, plain_name
from warpsim.tables.read_table import read_table

WAVELENGTHS = ("wavelength", "wavelen", "wave", "wl", "lambda", "lam")
"""Names of a column of wavelengths, without case, punctuation and unit."""

_SPELLINGS = {
    "um": ("um", "μm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"),
    "nm": ("nm", "nanometer", "nanometers", "nanometre", "nanometres"),
    "Angstrom": ("aa", "å", "angstrom", "angstroms"),
    "m": ("m",),
    "%": ("%", "percent", "pct"),
}
"""Spellings of units without case, by astropy's names of them; both micro signs have one lower case."""

_UNITS = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings}

_IN_BRACKETS = re.compile(r"(?P<name>.+?)[\s_]*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]")
_AT_END = re.compile(rf"(?P<name>.+?)(?:[\s_]+|(?=%))(?P<unit>A|(?i:{'|'.join(_UNITS)}))")


class CurveFile(NamedTuple):
    """A curve as its file gives it."""

    wavelength_um: F64
    """Nodes [um], shape (n,), increasing; read-only."""

    value: F64
    """Values there, >= 0, as fractions where the file gives per cent; read-only."""

    sha256: str
    """Of the bytes of the file that this was read from."""


def read_curve(path: str, column: str | None = None) -> CurveFile:
    """Read a curve over wavelength: a table of two columns or more (CSV, ECSV, FITS, VOTable, text).

    The wavelengths are in a column called so (`wavelength`, `lambda`, ...); their unit is stated by the file, or by the
    column's name as in `wavelength_um` or `Wavelength [nm]`. Values in per cent, as in `QE [%]`, become fractions. A
    file that has changed is read again.

    Args:
        path: File name.
        column: Name of the column of values; needed where there are several.

    Raises:
        InputError: The file cannot be read, states no unit of wavelength, or breaks a rule of a curve (increasing
            wavelengths > 0, values >= 0, all finite); the text begins with its name.
    """
    try:
        state = Path(path).stat()
        with errors_at("", path):
            return _read(path, column, state.st_mtime_ns, state.st_size)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}").of(path) from None


@lru_cache(maxsize=64)
def _read(path: str, column: str | None, mtime_ns: int, size: int) -> CurveFile:
    data = Path(path).read_bytes()
    table = read_table(Path(path), what="a table of a curve over wavelength", data=data)
    name, unit = _wavelength_column(table)
    values_name = _value_column(table, name, column)
    given, values = table.number(name), _fractions(table, values_name)
    try:
        checked_curve(given, values, values_name)
        wavelength_um, values = checked_curve(given * _um_per(unit), values, values_name)
    except InputError as error:
        column = values_name if error.field == values_name else name
        raise InputError(error.rule, f"column {column}", error.value, "g") from None
    for array in (wavelength_um, values):
        array.setflags(write=False)
    return CurveFile(wavelength_um, values, hashlib.sha256(data).hexdigest())


def _wavelength_column(table: ColumnTable) -> tuple[str, str]:
    """Name of the column of wavelengths, and its unit."""
    for name in table.table.colnames:
        stem, unit = _split(name)
        if plain_name(stem) not in WAVELENGTHS:
            continue
        stated: Any = table.table[name].unit
        if stated is not None:
            table.table[name].unit = None
            return name, str(stated)
        if unit is None:
            rule = "must state its unit: in the file, or in its name as in wavelength_um or wavelength_nm"
            raise InputError(rule, f"column {name}")
        return name, unit
    found = ", ".join(table.table.colnames)
    raise InputError("must have a column of wavelengths, such as wavelength_um", value=found, form="s")


def _split(name: str) -> tuple[str, str | None]:
    """Name of a column without its unit, and the unit as written; None where it names none."""
    text = name.strip()
    match = _IN_BRACKETS.fullmatch(text) or _AT_END.fullmatch(text)
    return (text, None) if match is None else (match["name"], match["unit"])


def _value_column(table: ColumnTable, wavelength: str, column: str | None) -> str:
    """Name of the column of values: the one asked for, or the only other one."""
    others = [name for name in table.table.colnames if name != wavelength]
    if column is not None:
        found = table.find(column)
        if found is None or found == wavelength:
            raise InputError(f"must be a column of the file ({', '.join(others)})", "column", column)
        return str(found)
    if len(others) != 1:
        rule = "must have one column of values, or column must say which"
        raise InputError(rule, value=", ".join(others) or "none", form="s")
    return str(others[0])


def _known_unit(text: str) -> str:
    """Name of a unit for astropy, the text itself where it is no spelling known; the case distinguishes mm from Mm."""
    text = text.strip()
    return "Angstrom" if text == "A" else _UNITS.get(text.casefold(), text)


def _um_per(unit: str) -> float:
    from astropy.units import Unit

    try:
        return float(Unit(_known_unit(unit)).to("um"))
    except (TypeError, ValueError):  # no unit, or none of length
        raise InputError(f"unknown unit {unit!r}; must be a length such as um, nm or Angstrom") from None


def _fractions(table: ColumnTable, name: str) -> F64:
    """Values of a column; per cent become fractions, other units stay."""
    stated: Any = table.table[name].unit
    table.table[name].unit = None
    values = table.number(name)
    unit = _split(name)[1] if stated is None else str(stated)
    return values / 100.0 if _known_unit(unit or "") == "%" else values
