"""A published catalog as its reader sees it: the columns that tell it, its positions, and the stars made of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.sky.photometric_bands import flux_of_magnitude_jy
from warpsim.sky.positions import J2000_JYEAR
from warpsim.tables.columns import MISSING, ColumnTable, is_number, plain_name

Quality = NDArray[np.int64]
Flags = NDArray[np.bool_]
Position = tuple[F64, F64, str]

UNKNOWN, UNCERTAIN, FAIR, GOOD, EXCELLENT = range(5)
"""Values of StarCatalog.quality."""

EXCELLENT_ERROR = 0.10
"""Relative error of a flux up to which a measurement is excellent."""

LARGEST_MAG = 40.0
LARGEST_COLOUR_MAG = 8.0
"""A colour beyond is none, but a code for a missing one."""

SATURATED_K_MAG = 4.0
"""2MASS saturates above this brightness: magnitudes are from the wings of the image, and good to 0.2-0.4 mag."""

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


def position_deg(table: ColumnTable, *pairs: Pair, radians: bool = False) -> tuple[F64, F64, str]:
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


def angle_deg(table: ColumnTable, name: str, *, hours: bool = False, radians: bool = False) -> F64:
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


def sexagesimal_deg(texts: NDArray[np.str_], where: str, hours: bool) -> F64:
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


def _parts_deg(table: ColumnTable) -> tuple[F64, F64]:
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


def _part(table: ColumnTable, largest: float, *names: str) -> F64:
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


@dataclass(frozen=True)
class Survey:
    """A published catalog, known by the names of its columns."""

    name: str
    """Short name, as the argument `format` takes it: "akari-irc"."""

    title: str
    reference: str
    """CDS number and paper, for the provenance."""

    needs: tuple[tuple[str, ...], ...]
    """Columns that tell it from other tables: for each, the spellings in use; one of them must be there."""

    light: Callable[[ColumnTable], dict[str, Any]]
    """Fluxes (NaN for none, or a limit), quality, motions where there are any: by the names of checked_columns(); notes
    for the provenance, a phrase each: "F12 divided by 1.43"."""

    epoch_jyear: float | Callable[[ColumnTable], tuple[float, str]] = J2000_JYEAR
    """Julian year of the positions; a function of the table returns it and what tells it."""

    position: Callable[[ColumnTable], Position] = position_deg
    """ICRS position [deg], and the name of the column of right ascension."""

    id_columns: tuple[str, ...] = ()
    id_prefix: str = ""
    """Put before names that do not begin with it."""

    telling: tuple[str, ...] = ()
    """Columns that hardly any other table has (left out: the first needed): one that has them, and lacks a needed one,
    looks like the survey."""

    def fits(self, table: ColumnTable) -> bool:
        """Return whether the table has all the columns needed."""
        return all(table.find(*names) for names in self.needs)

    def convert(self, table: ColumnTable, epoch_jyear: float | None = None) -> dict[str, Any]:
        """Return arguments of checked_columns() by the survey's table, and `notes`: a phrase for each thing done.

        The epoch is the one stated, or else the table's.
        """
        ra_deg, dec_deg, ra_name = self.position(table)
        light = self.light(table)
        if epoch_jyear is None:
            known = self.epoch_jyear
            epoch_jyear, note = (known, "") if isinstance(known, float) else known(table)
            if "pm_ra_mas_yr" in light and epoch_of_position(ra_name, epoch_jyear) != epoch_jyear:
                epoch_jyear = J2000_JYEAR
            elif note:
                light["notes"] = (*light["notes"], note)
        return {"ra_deg": ra_deg, "dec_deg": dec_deg, "id": self._names(table), "epoch_jyear": epoch_jyear, **light}

    def _names(self, table: ColumnTable) -> NDArray[np.str_] | None:
        """Names of the stars, "IRAS 06429-1639"; None without a column of them."""
        if table.find(*self.id_columns) is None:
            return None
        names, prefix = table.text(*self.id_columns).tolist(), self.id_prefix
        return np.array([name if not name or name.startswith(prefix) else prefix + name for name in names], np.str_)


def band_flux_jy(band: str, magnitudes: F64) -> F64:
    """Flux density in a photometric band [Jy] of a star of the given magnitude in it; NaN in, NaN out."""
    return flux_of_magnitude_jy(band, real_magnitudes(magnitudes))


def positive(values: F64) -> F64:
    """Values above zero, NaN elsewhere: archives write nulls as -999.9 or 0, which single precision alters."""
    return np.where(values > 0.0, values, np.nan)


def real_magnitudes(values: F64) -> F64:
    """Magnitudes that a star can have, NaN elsewhere: archives write 99.999 or -99 for a missing one."""
    return np.where(np.abs(values) < LARGEST_MAG, values, np.nan)


def real_colours(values: F64) -> F64:
    """Colours that a star can have, NaN elsewhere."""
    return np.where(np.abs(values) < LARGEST_COLOUR_MAG, values, np.nan)


def predicted_quality(has_flux: Flags, has_colour: Flags, is_doubtful: Flags) -> Quality:
    """Quality of an infrared flux predicted from shorter waves.

    FAIR with a colour that is not in doubt, UNKNOWN without any flux, UNCERTAIN otherwise.
    """
    return np.where(has_flux, np.where(has_colour & ~is_doubtful, FAIR, UNCERTAIN), UNKNOWN)


def measured_quality(relative_error: F64) -> Quality:
    """EXCELLENT where the error is known and at most EXCELLENT_ERROR, GOOD elsewhere."""
    return np.where(relative_error <= EXCELLENT_ERROR, EXCELLENT, GOOD)


def flag_letters(table: ColumnTable, position: int, *names: str) -> NDArray[np.str_]:
    """Letter of one band in a column of flags with a letter a band, shape (n,); "" where it is missing."""
    return np.array([text[position : position + 1] for text in table.text(*names).tolist()], dtype=np.str_)


def count_note(mask: Flags, what: str) -> tuple[str, ...]:
    """A note "3 of 10 stars ...", or none if it is true of no star."""
    n_star = int(np.count_nonzero(mask))
    return (f"{n_star} of {len(mask)} stars {what}",) if n_star else ()
