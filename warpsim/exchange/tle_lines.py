"""Two-line element sets, with or without a line for the name (3LE), checked column by column.

Columns are those of the format's definition (F. R. Hoots and R. L. Roehrich, Spacetrack Report No. 3, 1980; CelesTrak's
"NORAD Two-Line Element Set Format"). The `sgp4` package computes with what it is given, so everything is checked first:
length, checksum, blanks, digits and ranges. Catalog numbers beyond 99999 are in the alpha-5 scheme (A0000 = 100000).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from warpsim.errors import NO_VALUE, InputError
from warpsim.exchange.element_set import ElementSet, is_finite_model, plain_designator, tidy_name

LENGTH = 69
MAX_MEAN_MOTION = 18.0
"""Revolutions per day; at 17.1 an orbit is down on the ground."""

_LONGEST_NAME = 24  # a line that begins "1 " or "2 " and is no longer than this is a name


class _Field(NamedTuple):
    first: int
    """Column, counted from 1."""
    last: int
    name: str
    pattern: str
    rule: str


_BLANK = "must be blank"
_NUMBER = "must be five digits, or a letter (not I or O) and four digits"
_POWER = "must be a sign, five digits, a sign and a digit, like ' 38792-4'"

_THREE_DIGITS = r"(?:  \d| \d\d|\d{3})"
_ANGLE = rf"{_THREE_DIGITS}\.\d{{4}}"
_CATALOG_NUMBER = r"    \d|   \d\d|  \d{3}| \d{4}|\d{5}|[A-HJ-NP-Z]\d{4}"

_LINE_1 = (
    _Field(1, 2, "line number", "1 ", "must be '1 '"),
    _Field(3, 7, "catalog number", _CATALOG_NUMBER, _NUMBER),
    _Field(8, 8, "classification", "[ A-Z]", "must be a letter"),
    _Field(9, 9, "column", " ", _BLANK),
    _Field(10, 17, "international designator", "[ -~]{8}", "must be printable"),
    _Field(18, 18, "column", " ", _BLANK),
    _Field(19, 20, "epoch year", r"\d\d", "must be two digits"),
    _Field(21, 32, "epoch day", rf"{_THREE_DIGITS}\.\d{{8}}", "must be a day of the year like 264.51782528"),
    _Field(33, 33, "column", " ", _BLANK),
    _Field(34, 43, "first derivative of mean motion", r"[ +0-]\.\d{8}", "must be a number like ' .00001764'"),
    _Field(44, 44, "column", " ", _BLANK),
    _Field(45, 52, "second derivative of mean motion", r"[ +-]\d{5}[+-]\d", _POWER),
    _Field(53, 53, "column", " ", _BLANK),
    _Field(54, 61, "drag term B*", r"[ +-]\d{5}[+-]\d", _POWER),
    _Field(62, 62, "column", " ", _BLANK),
    _Field(63, 63, "ephemeris type", "[ 023]", "must be 0 (SGP4); other theories, like SGP4-XP (4), are not supported"),
    _Field(64, 64, "column", " ", _BLANK),
    _Field(65, 68, "element set number", r"[ \d]{3}[\d ]", "must be digits"),
    _Field(69, 69, "checksum", r"\d", "must be a digit"),
)

_LINE_2 = (
    _Field(1, 2, "line number", "2 ", "must be '2 '"),
    _Field(3, 7, "catalog number", _CATALOG_NUMBER, _NUMBER),
    _Field(8, 8, "column", " ", _BLANK),
    _Field(9, 16, "inclination", _ANGLE, "must be degrees like ' 51.6439'"),
    _Field(17, 17, "column", " ", _BLANK),
    _Field(18, 25, "right ascension of the node", _ANGLE, "must be degrees like '211.2001'"),
    _Field(26, 26, "column", " ", _BLANK),
    _Field(27, 33, "eccentricity", r"\d{7}", "must be seven digits"),
    _Field(34, 34, "column", " ", _BLANK),
    _Field(35, 42, "argument of perigee", _ANGLE, "must be degrees like ' 17.6667'"),
    _Field(43, 43, "column", " ", _BLANK),
    _Field(44, 51, "mean anomaly", _ANGLE, "must be degrees like ' 85.6398'"),
    _Field(52, 52, "column", " ", _BLANK),
    _Field(53, 63, "mean motion", r"[ \d]\d\.\d{8}", "must be revolutions per day like '15.50103472'"),
    _Field(64, 68, "revolution number", r"[ \d]{5}", "must be digits"),
    _Field(69, 69, "checksum", r"\d", "must be a digit"),
)


def _whole(fields: tuple[_Field, ...]) -> re.Pattern[str]:
    return re.compile("".join(f"({field.pattern})" for field in fields), re.ASCII)


_WHOLE_1, _WHOLE_2 = _whole(_LINE_1), _whole(_LINE_2)


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


def parse_tle(text: str) -> list[ElementSet]:
    """Read all element sets of a text.

    Args:
        text: Lines 1 and 2 of each satellite, each pair behind a name line or not; a name may begin with "0 ".
            Blank lines and lines that begin with "#" are skipped.

    Raises:
        InputError: Line, object, column, rule and value.
    """
    sets = []
    lines = _numbered_lines(text)
    name = ""
    for number, line in lines:
        if not _is_line(line):
            if name:
                raise _Location(number).error(f"must be line 1 of the set named {name!r}", value=line)
            name = tidy_name(line.removeprefix("0 "))
            continue
        location = _Location(number, name)
        if line[0] != "1":
            raise location.error("has no line 1 before it")
        second = next(lines, None)
        if second is None or not (_is_line(second[1]) and second[1][0] == "2"):
            raise location.error("must be followed by line 2 of its set")
        sets.append(_element_set(name, line, second[1], number, second[0]))
        name = ""
    if name:
        raise InputError("ends with a name without lines", value=name)
    return sets


def _numbered_lines(text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.split("\n"), 1):
        line = line.rstrip()
        if line and not line.startswith("#"):
            yield number, line


def _is_line(line: str) -> bool:
    return line[:2] in ("1 ", "2 ") and len(line.rstrip()) > _LONGEST_NAME


def _element_set(name: str, line_1: str, line_2: str, number_1: int, number_2: int) -> ElementSet:
    place_1 = _Location(number_1, name, tidy_name(line_1[2:7]))
    place_2 = place_1._replace(line=number_2)
    first = _checked(line_1, _LINE_1, _WHOLE_1, place_1)
    second = _checked(line_2, _LINE_2, _WHOLE_2, place_2)
    if first[1] != second[1]:
        raise place_2.error(f"must be that of line {number_1}, {first[1]!r}", "catalog number", second[1])
    day = float(first[7])
    if not 1.0 <= day < 367.0:
        raise place_1.error("must be in [1, 367)", "epoch day", day, "g")
    if not float(second[3]) <= 180.0:
        raise place_2.error("must be in [0, 180] deg", "inclination", second[3].strip(), "s")
    for index in (5, 9, 11):
        if not float(second[index]) <= 360.0:
            raise place_2.error("must be in [0, 360] deg", _LINE_2[index].name, second[index].strip(), "s")
    if not 0.0 < float(second[13]) <= MAX_MEAN_MOTION:
        rule = f"must be in (0, {MAX_MEAN_MOTION:g}] revolutions per day"
        raise place_2.error(rule, "mean motion", second[13].strip(), "s")
    return _initialised(name, line_1, line_2, place_1)


def _checked(line: str, fields: tuple[_Field, ...], whole: re.Pattern[str], location: _Location) -> tuple[str, ...]:
    """The fields of a line, in order."""
    if len(line) != LENGTH:
        raise location.error(f"must have {LENGTH} characters", value=len(line))
    match = whole.fullmatch(line)
    if match is None:
        for field in fields:
            text = line[field.first - 1 : field.last]
            if not re.fullmatch(field.pattern, text, re.ASCII):
                columns = f"{field.first}" if field.first == field.last else f"{field.first}-{field.last}"
                kind = f"column {columns}" if field.name == "column" else f"{field.name} (column {columns})"
                raise location.error(field.rule, kind, text)
    tally = sum(int(c) if c.isdigit() else c == "-" for c in line[: LENGTH - 1]) % 10
    if line[-1] != str(tally):
        raise location.error(f"must be {tally}, the sum of the line", f"checksum (column {LENGTH})", line[-1], "s")
    return tuple(line[field.first - 1 : field.last] for field in fields)


def _initialised(name: str, line_1: str, line_2: str, location: _Location) -> ElementSet:
    from sgp4.alpha5 import from_alpha5
    from sgp4.api import Satrec

    number = line_1[2:7].strip().rjust(5, "0")
    # The package takes a catalog number by its digits; blanks before them are legal, but not to every reader.
    satrec = Satrec.twoline2rv(f"1 {number}{line_1[7:]}", f"2 {number}{line_2[7:]}")
    if not is_finite_model(satrec):
        raise location.error("SGP4 cannot be started from these elements")
    norad_id = from_alpha5(number)
    return ElementSet(name, norad_id, plain_designator(line_1[9:17]), satrec, f"line {location.line}")
