"""Orbit Mean-Elements Messages (CCSDS 502.0-B) as SGP4 element sets: from keywords and values to a satellite.

The readers of the four layouts are in `omm_layouts.py`; what they hand over is a dict of texts per satellite. Keywords
that say what SGP4 assumes (TEME, UTC, the Earth, the theory) may be absent, as CelesTrak and Space-Track leave them out
of JSON and CSV; where they are present they must agree.
"""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from warpsim.errors import InputError
from warpsim.exchange.element_set import (
    ElementSet,
    is_finite_model,
    label,
    plain_designator,
    tidy_name,
)
from warpsim.exchange.tle_lines import MAX_MEAN_MOTION

_DEGREE = math.pi / 180.0
_REV_PER_DAY = 2.0 * math.pi / 1440.0  # in radians per minute
_DAY_MIN = 1440.0
_SGP4_DAY_ZERO = datetime.date(1949, 12, 31).toordinal()

_REQUIRED = {
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "CENTER_NAME": ("EARTH",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4", "SGP"),
    "EPHEMERIS_TYPE": ("0", "2", "3"),
}
"""What these keywords must say if they are there. Ephemeris types 0, 2 and 3 are SGP4 and its deep-space part."""


class _Range(NamedTuple):
    low: float
    high: float
    rule: str


_ANY = _Range(-1e30, 1e30, "must be a number of ordinary size")
_ANGLE = _Range(-360.0, 360.0, "must be in [-360, 360] deg")
_RANGES = {
    "MEAN_MOTION": _Range(1e-9, MAX_MEAN_MOTION, f"must be in (0, {MAX_MEAN_MOTION:g}] revolutions per day"),
    "ECCENTRICITY": _Range(0.0, math.nextafter(1.0, 0.0), "must be in [0, 1)"),
    "INCLINATION": _Range(0.0, 180.0, "must be in [0, 180] deg"),
    "RA_OF_ASC_NODE": _ANGLE,
    "ARG_OF_PERICENTER": _ANGLE,
    "MEAN_ANOMALY": _ANGLE,
    "BSTAR": _Range(-1e3, 1e3, "must be in [-1000, 1000]"),
    "MEAN_MOTION_DOT": _ANY,
    "MEAN_MOTION_DDOT": _ANY,
}
_OPTIONAL = ("MEAN_MOTION_DOT", "MEAN_MOTION_DDOT")  # SGP4 does not use them

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_EPOCH = re.compile(
    r"(\d{4})-(?:(\d\d)-(\d\d)|(\d{3}))[T ](\d\d):(\d\d):(\d\d(?:\.\d*)?)Z?", re.ASCII
)  # calendar date or day of the year


def element_set(fields: Mapping[str, str], location: str) -> ElementSet:
    """Make a satellite of one message's keywords.

    Args:
        fields: Keyword to text; keywords that SGP4 does not need are not looked at.
        location: Line or record of the message, which errors begin with.

    Raises:
        InputError: Location, object, keyword, rule and value.
    """
    try:
        name, norad_id = _identity(fields)
        satrec = _satrec(fields, name, norad_id)
    except InputError as error:
        raise error.of(location) from None
    return ElementSet(name, norad_id, plain_designator(tidy_name(fields.get("OBJECT_ID", ""))), satrec, location)


def _identity(fields: Mapping[str, str]) -> tuple[str, int | None]:
    name, number = tidy_name(fields.get("OBJECT_NAME", "")), fields.get("NORAD_CAT_ID", "").strip()
    if number and not re.fullmatch(r"\d{1,9}", number, re.ASCII):
        raise InputError("must be up to nine digits", "NORAD_CAT_ID", number).of(name)
    if not (name or number):
        raise InputError("OBJECT_NAME or NORAD_CAT_ID is required")
    return name, int(number) if number else None


def _satrec(fields: Mapping[str, str], name: str, norad_id: int | None) -> Any:
    """The initialised `sgp4.api.Satrec`; errors begin with the object's name and number."""
    from sgp4.api import WGS72, Satrec

    try:
        for keyword, known in _REQUIRED.items():
            value = fields.get(keyword, "").strip()
            if value and value.upper() not in known:
                raise InputError(f"must be {' or '.join(known)}", keyword, value)
        epoch_d = _days_since_1950(fields)
        value_of = {keyword: _number(fields, keyword) for keyword in _RANGES}
        satrec = Satrec()
        # The number plays no part in the motion, and the package holds none beyond the alpha-5 scheme.
        number = norad_id if norad_id is not None and norad_id <= 339_999 else 0
        satrec.sgp4init(
            WGS72, "i", number, epoch_d,
            value_of["BSTAR"],
            value_of["MEAN_MOTION_DOT"] * _REV_PER_DAY / _DAY_MIN,
            value_of["MEAN_MOTION_DDOT"] * _REV_PER_DAY / _DAY_MIN**2,
            value_of["ECCENTRICITY"],
            value_of["ARG_OF_PERICENTER"] * _DEGREE,
            value_of["INCLINATION"] * _DEGREE,
            value_of["MEAN_ANOMALY"] * _DEGREE,
            value_of["MEAN_MOTION"] * _REV_PER_DAY,
            value_of["RA_OF_ASC_NODE"] * _DEGREE,
        )  # fmt: skip
        if not is_finite_model(satrec):
            raise InputError("SGP4 cannot be started from these elements")
    except InputError as error:
        raise error.of(label(name, norad_id)) from None
    return satrec


def _number(fields: Mapping[str, str], keyword: str) -> float:
    text = fields.get(keyword, "").strip()
    if not text:
        if keyword in _OPTIONAL:
            return 0.0
        raise InputError("is required", keyword)
    if not _NUMBER.fullmatch(text):
        raise InputError("must be a number", keyword, text)
    value, allowed = float(text), _RANGES[keyword]
    if not allowed.low <= value <= allowed.high:
        raise InputError(allowed.rule, keyword, text)
    return value


def _days_since_1950(fields: Mapping[str, str]) -> float:
    """SGP4's epoch: days after 1949 December 31.0 UTC, good to 3e-7 s."""
    text = fields.get("EPOCH", "").strip()
    if not text:
        raise InputError("is required", "EPOCH")
    rule = "must be a UTC instant like 2025-06-01T12:34:56.789, years 1957 to 2099"
    wrong = InputError(rule, "EPOCH", text)
    match = _EPOCH.fullmatch(text)
    if match is None:
        raise wrong
    year, month, day, day_of_year, hour, minute, second = match.groups()
    if not (1957 <= int(year) < 2100 and int(hour) < 24 and int(minute) < 60 and float(second) < 61.0):
        raise wrong
    try:
        if day_of_year:
            date = datetime.date(int(year), 1, 1) + datetime.timedelta(days=int(day_of_year) - 1)
        else:
            date = datetime.date(int(year), int(month), int(day))
    except ValueError:
        raise wrong from None
    if date.year != int(year):  # day 0, or day 366 of a common year
        raise wrong
    seconds = 3600.0 * int(hour) + 60.0 * int(minute) + float(second)
    return (date.toordinal() - _SGP4_DAY_ZERO) + seconds / 86400.0
