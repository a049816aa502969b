"""SGP4 mean elements of satellites, and the format of two lines, with or without a line for the name (3LE).

Columns are those of the format's definition (F. R. Hoots and R. L. Roehrich, Spacetrack Report No. 3, 1980; CelesTrak's
"NORAD Two-Line Element Set Format"). The `sgp4` package computes with what it is given, so everything is checked first:
length, checksum, blanks, digits and ranges. Catalog numbers beyond 99999 are in the alpha-5 scheme (A0000 = 100000).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from warpsim.errors import NO_VALUE, InputError

LENGTH = 69
MAX_MEAN_MOTION = 18.0
"""Revolutions per day; at 17.1 an orbit is down on the ground."""

_LONGEST_NAME = 24  # a line that begins "1 " or "2 " and is no longer than this is a name


@dataclass(frozen=True, eq=False, slots=True)
class ElementSet:
    """Mean elements ready for SGP4, whatever the format of the file."""

    name: str
    """As in the file, "" where it gives none."""
    norad_id: int | None
    """Catalog number; None where an OMM gives none."""
    satrec: Any
    """The initialised `sgp4.api.Satrec`, with the constants of WGS72."""
    location: str
    """Line or record of the source: `line 3`."""

    @property
    def epoch_jd_utc(self) -> tuple[float, float]:
        """Epoch as a two-part Julian date of UTC [d]."""
        return float(self.satrec.jdsatepoch), float(self.satrec.jdsatepochF)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Inputs of SGP4: epoch, drag and mean elements."""
        sat = self.satrec
        elements = sat.bstar, sat.ndot, sat.nddot, sat.ecco, sat.argpo, sat.inclo, sat.mo, sat.no_kozai, sat.nodeo
        return *self.epoch_jd_utc, *elements


@dataclass(frozen=True, eq=False, slots=True)
class ElementRecord:
    """An element set as it stands in its source: known by name and number, parsed on demand."""

    name: str
    norad_id: int | None
    """Catalog number; None where there is none, or none that can be read."""
    designator: str
    """Launch year, number and piece, "1998-067A"; as in the file where it is written otherwise, "" where absent."""
    location: str
    """Line or record of the source: `line 3`."""
    parse: Callable[[], ElementSet]
    """Return the checked set; InputError where it is not valid."""


def bad_record(error: InputError, location: str, name: str = "", norad_id: int | None = None) -> ElementRecord:
    """Record of what is no element set; parsing it raises the error."""

    def parse() -> ElementSet:
        raise error

    return ElementRecord(name, norad_id, "", location, parse)


def label(name: str, norad_id: int | None) -> str:
    """`ISS (ZARYA), 25544`: what is known of name and number, for messages."""
    return ", ".join(text for text in (name, "" if norad_id is None else f"{norad_id:05d}") if text)


def tidy_name(text: str) -> str:
    """A name without outer blanks and without characters that would break a line of text."""
    return "".join(c if c.isprintable() else "?" for c in text.strip())


def plain_designator(text: str) -> str:
    """`98067A` of element sets as `1998-067A`; anything else without its outer blanks."""
    text = text.strip()
    if len(text) >= 6 and text.isascii() and text[:5].isdigit() and text[5:].isalpha():
        return f"{'19' if int(text[:2]) >= 57 else '20'}{text[:2]}-{text[2:]}"
    return text


def check_model(satrec: Any) -> None:
    """Raise unless SGP4 could be initialised: elements far out of any orbit leave NaN or infinities behind."""
    if not all(map(math.isfinite, (satrec.a, satrec.no_kozai, satrec.mdot, satrec.argpdot, satrec.bstar))):
        raise InputError("SGP4 cannot be started from these elements")


class _Field(NamedTuple):
    first: int
    """Column, counted from 1."""
    last: int
    name: str
    pattern: str
    rule: str

    def text(self, line: str) -> str:
        return line[self.first - 1 : self.last]


_THREE_DIGITS = r"(?:  \d| \d\d|\d{3})"
_ANGLE = rf"{_THREE_DIGITS}\.\d{{4}}"
_CATALOG_NUMBER = r"    \d|   \d\d|  \d{3}| \d{4}|\d{5}|[A-HJ-NP-Z]\d{4}"
_NUMBER = "must be five digits, or a letter (not I or O) and four digits"
_POWER = "must be a sign, five digits, a sign and a digit, like ' 38792-4'"
_CHECKSUM = _Field(LENGTH, LENGTH, "checksum", r"\d", "must be a digit")

_LINE_1 = (
    _Field(1, 2, "line number", "1 ", "must be '1 '"),
    _Field(3, 7, "catalog number", _CATALOG_NUMBER, _NUMBER),
    _Field(8, 8, "classification", "[ A-Z]", "must be a letter"),
    _Field(10, 17, "international designator", "[ -~]{8}", "must be printable"),
    _Field(19, 20, "epoch year", r"\d\d", "must be two digits"),
    _Field(21, 32, "epoch day", rf"{_THREE_DIGITS}\.\d{{8}}", "must be a day of the year like 264.51782528"),
    _Field(34, 43, "first derivative of mean motion", r"[ +0-]\.\d{8}", "must be a number like ' .00001764'"),
    _Field(45, 52, "second derivative of mean motion", r"[ +-]\d{5}[ +-]\d", _POWER),
    _Field(54, 61, "drag term B*", r"[ +-]\d{5}[ +-]\d", _POWER),
    _Field(63, 63, "ephemeris type", "[ 023]", "must be 0 (SGP4); other theories, like SGP4-XP (4), are not supported"),
    _Field(65, 68, "element set number", r"[ \d]{3}[\d ]", "must be digits"),
    _CHECKSUM,
)
_LINE_2 = (
    _Field(1, 2, "line number", "2 ", "must be '2 '"),
    _Field(3, 7, "catalog number", _CATALOG_NUMBER, _NUMBER),
    _Field(9, 16, "inclination", _ANGLE, "must be degrees like ' 51.6439'"),
    _Field(18, 25, "right ascension of the node", _ANGLE, "must be degrees like '211.2001'"),
    _Field(27, 33, "eccentricity", r"\d{7}", "must be seven digits"),
    _Field(35, 42, "argument of perigee", _ANGLE, "must be degrees like ' 17.6667'"),
    _Field(44, 51, "mean anomaly", _ANGLE, "must be degrees like ' 85.6398'"),
    _Field(53, 63, "mean motion", r"[ \d]\d\.\d{8}", "must be revolutions per day like '15.50103472'"),
    _Field(64, 68, "revolution number", r"[ \d]{5}", "must be digits"),
    _CHECKSUM,
)
"""Fields of the lines; columns between them are blank."""

_MAXIMUM = {
    "inclination": (180.0, "must be in [0, 180] deg"),
    "right ascension of the node": (360.0, "must be in [0, 360] deg"),
    "argument of perigee": (360.0, "must be in [0, 360] deg"),
    "mean anomaly": (360.0, "must be in [0, 360] deg"),
    "mean motion": (MAX_MEAN_MOTION, f"must be in (0, {MAX_MEAN_MOTION:g}] revolutions per day"),
}


class _Location(NamedTuple):
    """Line and object, for messages."""

    line: int
    name: str = ""
    number: str = ""

    def error(self, rule: str, field: str = "", value: Any = NO_VALUE, form: str = "") -> InputError:
        known = ", ".join(item for item in (self.name, self.number) if item)
        return InputError(rule, field, value, form).of(known).of(f"line {self.line}")


def looks_like_tle(text: str) -> bool:
    """Return whether some line could be the first or second of an element set."""
    return any(_is_line(line) for line in text.splitlines())


def tle_records(text: str) -> Iterator[ElementRecord]:
    """Find the element sets of a text, each pair of lines behind a name line or not; what is none is a bad record.

    A name may begin with "0 ". Blank lines and lines that begin with "#" are skipped.
    """
    numbered = ((number, line.rstrip()) for number, line in enumerate(text.split("\n"), 1))
    lines = [(number, line) for number, line in numbered if line and not line.startswith("#")]
    name = ""
    index = 0
    while index < len(lines):
        number, line = lines[index]
        index += 1
        if not _is_line(line):
            if name:
                error = _Location(number).error(f"must be line 1 of the set named {name!r}", value=line)
                yield bad_record(error, f"line {number}", name)
            name = tidy_name(line.removeprefix("0 "))
            continue
        location = _Location(number, name)
        if line[0] != "1":
            yield bad_record(location.error("has no line 1 before it"), f"line {number}", name, _number(line))
        elif index == len(lines) or lines[index][1][0] != "2" or not _is_line(lines[index][1]):
            error = location.error("must be followed by line 2 of its set")
            yield bad_record(error, f"line {number}", name, _number(line))
        else:
            parse = partial(_element_set, name, line, lines[index][1], number, lines[index][0])
            yield ElementRecord(name, _number(line), plain_designator(line[9:17]), f"line {number}", parse)
            index += 1
        name = ""
    if name:
        yield bad_record(InputError("ends with a name without lines", value=name), f"line {lines[-1][0]}", name)


def _number(line: str) -> int | None:
    """Catalog number of a line; None where it is not valid."""
    from sgp4.alpha5 import from_alpha5

    text = line[2:7]
    return int(from_alpha5(text.strip().rjust(5, "0"))) if re.fullmatch(_CATALOG_NUMBER, text, re.ASCII) else None


def _is_line(line: str) -> bool:
    return line[:2] in ("1 ", "2 ") and len(line.rstrip()) > _LONGEST_NAME


def _element_set(name: str, line_1: str, line_2: str, number_1: int, number_2: int) -> ElementSet:
    from sgp4.alpha5 import from_alpha5
    from sgp4.api import Satrec

    at_1 = _Location(number_1, name, tidy_name(line_1[2:7]))
    at_2 = at_1._replace(line=number_2)
    first, second = _checked(line_1, _LINE_1, at_1), _checked(line_2, _LINE_2, at_2)
    if first["catalog number"] != second["catalog number"]:
        rule = f"must be that of line {number_1}, {first['catalog number']!r}"
        raise at_2.error(rule, "catalog number", second["catalog number"])
    day = float(first["epoch day"])
    if not 1.0 <= day < 367.0:
        raise at_1.error("must be in [1, 367)", "epoch day", day, "g")
    for field, (most, rule) in _MAXIMUM.items():
        value = float(second[field])
        if not value <= most or (field == "mean motion" and value == 0.0):
            raise at_2.error(rule, field, second[field].strip(), "s")
    number = first["catalog number"].strip().rjust(5, "0")
    # The package takes a catalog number by its digits; blanks before them are legal, but not to every reader.
    satrec = Satrec.twoline2rv(f"1 {number}{line_1[7:]}", f"2 {number}{line_2[7:]}")
    try:
        check_model(satrec)
    except InputError as error:
        raise at_1.error(error.rule) from None
    return ElementSet(name, from_alpha5(number), satrec, f"line {number_1}")


def _checked(line: str, fields: tuple[_Field, ...], location: _Location) -> dict[str, str]:
    from sgp4.io import compute_checksum

    if len(line) != LENGTH:
        raise location.error(f"must have {LENGTH} characters", value=len(line))
    column = 1
    for field in fields:
        for blank in range(column, field.first):
            if line[blank - 1] != " ":
                raise location.error("must be blank", f"column {blank}", line[blank - 1])
        text, column = field.text(line), field.last + 1
        if not re.fullmatch(field.pattern, text, re.ASCII):
            columns = f"{field.first}" if field.first == field.last else f"{field.first}-{field.last}"
            raise location.error(field.rule, f"{field.name} (column {columns})", text)
    tally = compute_checksum(line)
    if line[-1] != str(tally):
        raise location.error(f"must be {tally}, the sum of the line", f"checksum (column {LENGTH})", line[-1], "s")
    return {field.name: field.text(line) for field in fields}
