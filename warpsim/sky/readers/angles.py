"""Positions in tables of surveys: degrees, sexagesimal text, or hours, minutes and seconds in columns of their own."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.space_motion import J2000_JYEAR
from warpsim.tables.columns import MISSING, ColumnTable, is_number, plain_name

Array = NDArray[np.float64]
Pair = tuple[str, str]

POSITIONS: tuple[Pair, ...] = (
    ("RAJ2000", "DEJ2000"),
    ("RA_ICRS", "DE_ICRS"),
    ("RAdeg", "DEdeg"),
    ("ra", "dec"),
    ("RA", "DE"),
    ("clon", "clat"),  # sexagesimal text of IRSA
)
"""Usual names of right ascension and declination, J2000 or ICRS, in the order of preference."""

PARTS = "parts"
"""What position_deg() calls a position in columns RAh, RAm, RAs, DE-, DEd, DEm, DEs."""

_NUMBER = re.compile(r"\d+(\.\d*)?|\.\d+")


def position_deg(table: ColumnTable, *pairs: Pair, radians: bool = False) -> tuple[Array, Array, str]:
    """Right ascension and declination [deg] of the first pair of columns that the table has; NaN where missing.

    After the pairs (POSITIONS if left out) come the parts of the CDS: RAh, RAm, RAs (or RAds, tenths of a second), DE-,
    DEd, DEm, DEs. With them comes the table's own name of the right ascension, or PARTS.
    """
    pairs = pairs or POSITIONS
    for right_ascension, declination in pairs:
        ra_name, dec_name = table.find(right_ascension), table.find(declination)
        if ra_name is not None and dec_name is not None:
            ra_deg = angle_deg(table, ra_name, hours=True, radians=radians)
            if not radians:
                note_position(table, ra_name, dec_name)
            return ra_deg, angle_deg(table, dec_name, radians=radians), ra_name
    if has_parts(table):
        return *_parts_deg(table), PARTS
    names = ", ".join(f"{ra} and {dec}" for ra, dec in pairs)
    rule = f"must have the columns of a position ({names}, or RAh, RAm, RAs, DE-, DEd, DEm, DEs)"
    raise InputError(rule, value=table.names, form="s")


def note_position(table: ColumnTable, ra_name: str, dec_name: str) -> None:
    """Keep the names of the columns of a position where these hold numbers in degrees."""
    columns = [table.table[name] for name in (ra_name, dec_name)]
    if all(column.dtype.kind == "f" and str(column.unit) in ("None", "deg") for column in columns):
        table.position = ra_name, dec_name


def has_parts(table: ColumnTable) -> bool:
    """Return whether the table has positions in the parts of the CDS."""
    return bool(table.find("RAh") and table.find("DEd", "decd"))


def epoch_of_position(ra_name: str, survey_epoch_jyear: float) -> float:
    """Julian year of a position: VizieR's own _RAJ2000, _RA.icrs and RAJ2000 are at 2000.0, proper motion applied."""
    computed = ra_name.startswith("_") or plain_name(ra_name) == "raj2000"
    return J2000_JYEAR if computed else survey_epoch_jyear


def angle_deg(table: ColumnTable, name: str, *, hours: bool = False, radians: bool = False) -> Array:
    """A column of angles [deg], numbers or text that sexagesimal_deg() reads; NaN where missing, or without the column.

    `radians` says whether numbers whose column states no unit are radians, not degrees.
    """
    own_name = table.find(name)
    if own_name is None:
        return np.full(len(table), np.nan)
    if table.table[own_name].dtype.kind == "U":
        texts = table.text(own_name)
        if not all(is_number(text) or text.lower() in MISSING for text in texts.tolist()):
            return sexagesimal_deg(texts, own_name, hours)
    if radians and table.table[own_name].unit is None:
        return np.degrees(table.number(own_name))
    return table.number(own_name, unit="deg")


def sexagesimal_deg(texts: NDArray[np.str_], where: str, hours: bool) -> Array:
    """Angles [deg] of texts such as "14 13 22.8", "-00:12:30", "14h13m22.8s", "+19d26m31s" or "213.345", shape (n,).

    One number alone is in degrees, blank texts are NaN. `where` is what an error calls them; `hours` says whether the
    first of two or three numbers counts hours where no letter h or d says so.
    """
    angles = np.full(len(texts), np.nan)
    for row, text in enumerate(texts.tolist()):
        if text.lower() not in MISSING:
            angle = _angle(text, hours)
            if angle is None:
                raise InputError("must be an angle such as 12 34 56.7 or 188.73", where, text, row=row)
            angles[row] = angle
    return angles


def _angle(text: str, hours: bool) -> float | None:
    """Angle [deg] of one text; None if it is none."""
    body = text.lower()
    sign = -1.0 if body.startswith("-") else 1.0  # of the text, not of a number: -00 12 30 is negative
    fields = re.sub(r"[hdms:°'\"]", " ", body.lstrip("+-")).split()
    if not 1 <= len(fields) <= 3 or len(body) - len(body.lstrip("+-")) > 1:
        return None
    if not all(_NUMBER.fullmatch(field) for field in fields) or any("." in field for field in fields[:-1]):
        return None
    numbers = [float(field) for field in fields]
    if any(number > 60.0 for number in numbers[1:]):  # 60 comes from rounding
        return None
    in_hours = "h" in body or (hours and len(fields) > 1 and "d" not in body and "°" not in body)
    angle = sum(number / 60.0**power for power, number in enumerate(numbers))
    return sign * angle * (15.0 if in_hours else 1.0)


def _parts_deg(table: ColumnTable) -> tuple[Array, Array]:
    """Right ascension and declination [deg] of the columns that the CDS splits positions into, shape (n,) each.

    The names say the units, so stated ones are ignored: FITS has no name for tenths of a second.
    """
    seconds = _part(table, 60.0, "RAs") if table.find("RAs") else _part(table, 600.0, "RAds") / 10.0
    ra_hours = _part(table, 24.0, "RAh") + _part(table, 60.0, "RAm") / 60.0 + seconds / 3600.0
    degrees_text = table.text("DEd", "decd")
    degrees = np.abs(_part(table, 90.0, "DEd", "decd"))
    dec = degrees + _part(table, 60.0, "DEm", "decm") / 60.0 + _part(table, 60.0, "DEs", "decs") / 3600.0
    # The sign stands in a column of its own, because a number cannot say -0 degrees; some tables leave it in DEd.
    south = (table.text("DE-", "decsign") == "-") | np.char.startswith(degrees_text, "-")
    return 15.0 * ra_hours, np.where(south, -dec, dec)


def _part(table: ColumnTable, largest: float, *names: str) -> Array:
    """A column of parts, shape (n,): zeros where the table has none (then the part before it has decimals)."""
    name = table.find(*names)
    if name is None:
        return np.zeros(len(table))
    values = table.number(name)
    low = -largest if name == table.find("DEd", "decd") else 0.0  # which may carry the sign
    bad = np.flatnonzero((values > largest) | (values < low))
    if bad.size:
        raise InputError(f"must be in [{low:g}, {largest:g}]", name, values[bad[0]], "g", row=int(bad[0]))
    return values
