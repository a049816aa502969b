"""Element sets of satellites from files: TLE, 3LE and OMM (CCSDS 502.0-B), detected by content.

Orbit Mean-Elements Messages come as KVN, XML, JSON and CSV, as CelesTrak and Space-Track give them. Each reader turns a
text into (keywords and texts, line or record) per satellite. Keywords that say what SGP4 assumes (TEME, UTC, the Earth,
the theory) may be absent, as they are in JSON and CSV; where they are present they must agree. Units written behind
values are compared with those of the standard.
"""

from __future__ import annotations

import csv
import datetime
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from warpsim.errors import InputError, errors_at
from warpsim.exchange.element_set import (
    MAX_MEAN_MOTION,
    ElementRecord,
    ElementSet,
    bad_record,
    check_model,
    label,
    looks_like_tle,
    plain_designator,
    tidy_name,
    tle_records,
)
from warpsim.exchange.instants import mjd_and_second
from warpsim.exchange.source import read_source, read_xml

Message = tuple[dict[str, str], str, InputError | None]
"""Keyword to text, the line or record of the message, and what is wrong with its layout."""

_FIRST_YEAR = 1957
_UNUSED = {"CLASSIFICATION_TYPE": "U", "OBJECT_ID": "", "EPHEMERIS_TYPE": 0, "ELEMENT_SET_NO": 0, "REV_AT_EPOCH": 0}
"""Keywords that the sgp4 package takes, and that play no part in the motion."""

_REQUIRED = {
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "CENTER_NAME": ("EARTH",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP/SGP4", "SGP"),
    "EPHEMERIS_TYPE": ("0", "2", "3"),
}
"""What these keywords must say if they are there. Ephemeris types 0, 2 and 3 are SGP4 and its deep-space part."""


class _Element(NamedTuple):
    low: float
    high: float
    rule: str
    units: tuple[str, ...] = ()


_ANGLE = _Element(-360.0, 360.0, "must be in [-360, 360] deg", ("deg",))
_ORDINARY = "must be a number of ordinary size"
_ELEMENTS = {
    "MEAN_MOTION": _Element(
        1e-9, MAX_MEAN_MOTION, f"must be in (0, {MAX_MEAN_MOTION:g}] revolutions per day", ("rev/day",)
    ),
    "ECCENTRICITY": _Element(0.0, math.nextafter(1.0, 0.0), "must be in [0, 1)"),
    "INCLINATION": _Element(0.0, 180.0, "must be in [0, 180] deg", ("deg",)),
    "RA_OF_ASC_NODE": _ANGLE,
    "ARG_OF_PERICENTER": _ANGLE,
    "MEAN_ANOMALY": _ANGLE,
    "BSTAR": _Element(-1e3, 1e3, "must be in [-1000, 1000]", ("1/er",)),
    "MEAN_MOTION_DOT": _Element(-1e30, 1e30, _ORDINARY, ("rev/day**2", "rev/day^2")),
    "MEAN_MOTION_DDOT": _Element(-1e30, 1e30, _ORDINARY, ("rev/day**3", "rev/day^3")),
}
_OPTIONAL = ("MEAN_MOTION_DOT", "MEAN_MOTION_DDOT")  # SGP4 does not use them

_NORAD_ID = re.compile(r"\d{1,9}", re.ASCII)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def read_element_records(path: str | os.PathLike[str]) -> list[ElementRecord]:
    """Find the element sets of a file, in its order, without parsing their numbers. The content says the format."""
    source = read_source(path)
    source.check_kind()
    with errors_at("", source.file):
        return element_records(source.text)


def element_records(text: str) -> list[ElementRecord]:
    """Find the element sets of a text, as `read_element_records` does.

    Raises:
        InputError: It is of no format of element sets, or broken as a whole (JSON, XML), or has none.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    start = text.lstrip()
    first = start.split("\n", 1)[0]
    if start.startswith("<"):
        messages = _read_xml(text)
    elif start.startswith(("[", "{")):
        messages = _read_json(text)
    elif re.search(r"^\s*CCSDS_OMM_VERS\s*=", text, re.MULTILINE):
        messages = _read_kvn(text)
    elif "," in first and "MEAN_MOTION" in first.upper():
        messages = _read_csv(text)
    elif looks_like_tle(text):
        return list(tle_records(text))
    else:
        raise InputError("must hold element sets, as TLE or as OMM in KVN, XML, JSON or CSV")
    records = [_record(fields, location, error) for fields, location, error in messages]
    if not records:
        raise InputError("holds no element sets")
    return records


def _record(fields: Mapping[str, str], location: str, error: InputError | None) -> ElementRecord:
    name, number = tidy_name(fields.get("OBJECT_NAME", "")), fields.get("NORAD_CAT_ID", "").strip()
    norad_id = int(number) if _NORAD_ID.fullmatch(number) else None
    if error is not None:
        return bad_record(error, location, name, norad_id)
    designator = plain_designator(tidy_name(fields.get("OBJECT_ID", "")))

    def parse() -> ElementSet:
        """Satellite of the message; its errors begin with the location, the object's name and its number."""
        with errors_at("", location), errors_at("", label(name, norad_id)):
            if number and norad_id is None:
                raise InputError("must be up to nine digits", "NORAD_CAT_ID", number)
            if not (name or number):
                raise InputError("OBJECT_NAME or NORAD_CAT_ID is required")
            return ElementSet(name, norad_id, _satrec(fields, norad_id), location)

    return ElementRecord(name, norad_id, designator, location, parse)


def _satrec(fields: Mapping[str, str], norad_id: int | None) -> Any:
    """The initialised `sgp4.api.Satrec` of a message's fields, which are checked."""
    from sgp4 import omm
    from sgp4.api import Satrec

    for keyword, known in _REQUIRED.items():
        value = fields.get(keyword, "").strip()
        if value and value.upper() not in known:
            raise InputError(f"must be {' or '.join(known)}", keyword, value)
    epoch = _epoch(fields).isoformat(timespec="microseconds")
    numbers = {keyword: _number(fields, keyword) for keyword in _ELEMENTS}
    # The catalog number plays no part in the motion, and the package holds none beyond the alpha-5 scheme.
    number = norad_id if norad_id is not None and norad_id <= 339_999 else 0
    satrec = Satrec()
    omm.initialize(satrec, {**_UNUSED, **numbers, "EPOCH": epoch, "NORAD_CAT_ID": number})
    check_model(satrec)
    return satrec


def _number(fields: Mapping[str, str], keyword: str) -> float:
    text = fields.get(keyword, "").strip()
    if not text:
        if keyword in _OPTIONAL:
            return 0.0
        raise InputError("is required", keyword)
    if not _NUMBER.fullmatch(text):
        raise InputError("must be a number", keyword, text)
    value, element = float(text), _ELEMENTS[keyword]
    if not element.low <= value <= element.high:
        raise InputError(element.rule, keyword, text)
    return value


def _epoch(fields: Mapping[str, str]) -> datetime.datetime:
    text = fields.get("EPOCH", "").strip()
    if not text:
        raise InputError("is required", "EPOCH")
    try:
        day, second = mjd_and_second(text, first_year=_FIRST_YEAR)
    except InputError:
        rule = f"must be a UTC instant like 2025-06-01T12:34:56.789, years {_FIRST_YEAR} to 2099"
        raise InputError(rule, "EPOCH", text) from None
    return datetime.datetime(1858, 11, 17) + datetime.timedelta(day, second)


def _read_kvn(text: str) -> Iterator[Message]:
    """Messages one behind the other, each begun by CCSDS_OMM_VERS (or by OBJECT_NAME, where that is not repeated)."""
    fields: dict[str, str] = {}
    first, fault = 1, None
    for number, line in enumerate(text.split("\n"), 1):
        line = line.strip()
        if not line or line.startswith(("COMMENT", "USER_DEFINED")) or line in ("META_START", "META_STOP"):
            continue
        keyword, equals, value = (part.strip() for part in line.partition("="))
        if not equals:
            fault = fault or InputError("must be KEYWORD = value", value=line).of(f"line {number}")
            continue
        if keyword == "CCSDS_OMM_VERS" or (keyword == "OBJECT_NAME" and keyword in fields):
            if "EPOCH" in fields or "OBJECT_NAME" in fields or fault:
                yield fields, f"line {first}", fault
            fields, first, fault = {}, number, None
        unit = re.search(r"\s*\[([^\]]*)\]$", value)
        if unit:
            value = value[: unit.start()]
        fault = fault or _add_field(fields, keyword, value, unit[1] if unit else "", f"line {number}")
    yield fields, f"line {first}", fault


def _read_xml(text: str) -> Iterator[Message]:
    """`<omm>` elements, alone or in an `<ndm>`, with or without a namespace."""
    root = read_xml(text)
    messages = [root] if root.tag == "omm" else root.find("omm")
    if not messages:
        raise InputError(f"must hold <omm> elements, got <{root.tag}>")
    for message in messages:
        fields: dict[str, str] = {}
        fault = None
        for leaf in message.leaves():
            if leaf is not message and leaf.tag not in ("COMMENT", "USER_DEFINED"):
                unit, location = leaf.attributes.get("units", ""), f"line {leaf.line}"
                fault = fault or _add_field(fields, leaf.tag, leaf.text.strip(), unit, location)
        yield fields, f"line {message.line}", fault


def _add_field(fields: dict[str, str], keyword: str, value: str, unit: str, location: str) -> InputError | None:
    """Add a field; return what is wrong where it is not given once, in the unit of the standard."""
    if keyword in fields:
        return InputError("is given twice", keyword).of(location)
    known = _ELEMENTS[keyword].units if keyword in _ELEMENTS else ()
    if unit and known and unit.strip().lower() not in known:
        return InputError(f"must be in {known[0]}", keyword, unit).of(location)
    fields[keyword] = value
    return None


def _read_json(text: str) -> Iterator[Message]:
    """A list of objects, or one object; numbers may be numbers or texts."""
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"is not valid JSON: {error.msg}").of(f"line {error.lineno}") from None
    except (RecursionError, ValueError):
        raise InputError("is not valid JSON: nested too deep, or a number too long") from None
    for record, item in enumerate(data if isinstance(data, list) else [data], 1):
        location = f"record {record}"
        if not isinstance(item, dict):
            yield {}, location, InputError("must be an object of keywords", value=item).of(location)
            continue
        nested = next(((key, value) for key, value in item.items() if isinstance(value, bool | list | dict)), None)
        fault = None if nested is None else InputError("must be a number or a text", *nested).of(location)
        given = {keyword: "" if value is None else value for keyword, value in item.items()}
        fields = {keyword: value if isinstance(value, str) else repr(value) for keyword, value in given.items()}
        yield fields, location, fault


def _read_csv(text: str) -> Iterator[Message]:
    """A header of keywords, then a line per satellite."""
    rows = csv.reader(text.split("\n"), strict=True)
    header: list[str] = []
    try:
        for row in rows:
            location = f"line {rows.line_num}"
            if not any(cell.strip() for cell in row):
                continue
            if not header:
                header = [cell.strip().upper() for cell in row]
                if len(set(header)) != len(header):
                    raise InputError("column names must be different").of(location)
                continue
            fault = None
            if len(row) != len(header):
                fault = InputError(f"must have {len(header)} values, as the header has", value=len(row)).of(location)
            yield dict(zip(header, row, strict=False)), location, fault
    except csv.Error as error:
        raise InputError(f"is not valid CSV: {error}").of(f"line {rows.line_num}") from None
