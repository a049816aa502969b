"""The four layouts of Orbit Mean-Elements Messages: KVN, XML, JSON and CSV, as CelesTrak and Space-Track give them.

Each reader turns a text into (keywords and texts, line or record) per satellite; `omm.py` checks what they say. Units
written behind values are compared with those of the standard.
"""

from __future__ import annotations

import csv
import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator

from warpsim.errors import InputError

Message = tuple[dict[str, str], str]
"""Keyword to text, and the line or record of the message."""

_UNITS = {
    "MEAN_MOTION": ("rev/day",),
    "INCLINATION": ("deg",),
    "RA_OF_ASC_NODE": ("deg",),
    "ARG_OF_PERICENTER": ("deg",),
    "MEAN_ANOMALY": ("deg",),
    "BSTAR": ("1/er",),
    "MEAN_MOTION_DOT": ("rev/day**2", "rev/day^2"),
    "MEAN_MOTION_DDOT": ("rev/day**3", "rev/day^3"),
}


def layout_of(text: str) -> str | None:
    """Detect "kvn", "xml", "json" or "csv" by the beginning of a text; None for none of them."""
    start = text.lstrip()
    if start.startswith("<"):
        return "xml"
    if start.startswith(("[", "{")):
        return "json"
    first = start.split("\n", 1)[0]
    if re.search(r"^\s*CCSDS_OMM_VERS\s*=", text, re.MULTILINE):
        return "kvn"
    if "," in first and "MEAN_MOTION" in first.upper():
        return "csv"
    return None


def read_kvn(text: str) -> Iterator[Message]:
    """Messages one behind the other, each begun by CCSDS_OMM_VERS (or by OBJECT_NAME, where that is not repeated)."""
    fields: dict[str, str] = {}
    first = 1
    for number, line in enumerate(text.split("\n"), 1):
        line = line.strip()
        if not line or line.startswith(("COMMENT", "USER_DEFINED")) or line in ("META_START", "META_STOP"):
            continue
        keyword, equals, value = (part.strip() for part in line.partition("="))
        if not equals:
            raise InputError("must be KEYWORD = value", value=line).of(f"line {number}")
        if keyword == "CCSDS_OMM_VERS" or (keyword == "OBJECT_NAME" and keyword in fields):
            if "EPOCH" in fields or "OBJECT_NAME" in fields:
                yield fields, f"line {first}"
            fields, first = {}, number
        if keyword in fields:
            raise InputError("is given twice", keyword).of(f"line {number}")
        unit = re.search(r"\s*\[([^\]]*)\]$", value)
        if unit:
            value = value[: unit.start()]
            _check_unit(keyword, unit[1], f"line {number}")
        fields[keyword] = value
    yield fields, f"line {first}"


def read_xml(text: str) -> Iterator[Message]:
    """`<omm>` elements, alone or in an `<ndm>`, with or without a namespace."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError("must be plain XML without DOCTYPE or ENTITY")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        line, column = error.position
        raise InputError(f"is not valid XML at column {column + 1}").of(f"line {line}") from None
    except ValueError as error:
        raise InputError(f"is not valid XML: {error}") from None
    messages = [element for element in root.iter() if _tag(element) == "omm"]
    if not messages:
        raise InputError(f"must hold <omm> elements, got <{_tag(root)}>")
    for record, message in enumerate(messages, 1):
        location = f"record {record}"
        fields: dict[str, str] = {}
        for element in message.iter():
            keyword = _tag(element)
            if len(element) or keyword in ("COMMENT", "USER_DEFINED"):
                continue
            if keyword in fields:
                raise InputError("is given twice", keyword).of(location)
            _check_unit(keyword, element.get("units", ""), location)
            fields[keyword] = (element.text or "").strip()
        yield fields, location


def read_json(text: str) -> Iterator[Message]:
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
            raise InputError("must be an object of keywords", value=item).of(location)
        for keyword, value in item.items():
            if isinstance(value, bool | list | dict):
                raise InputError("must be a number or a text", keyword, value).of(location)
        yield {key: _json_text(value) for key, value in item.items()}, location


def read_csv(text: str) -> Iterator[Message]:
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
            if len(row) != len(header):
                raise InputError(f"must have {len(header)} values, as the header has", value=len(row)).of(location)
            yield dict(zip(header, row, strict=True)), location
    except csv.Error as error:
        raise InputError(f"is not valid CSV: {error}").of(f"line {rows.line_num}") from None


READERS = {"kvn": read_kvn, "xml": read_xml, "json": read_json, "csv": read_csv}


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _json_text(value: object) -> str:
    return "" if value is None else value if isinstance(value, str) else repr(value)


def _check_unit(keyword: str, unit: str, location: str) -> None:
    known = _UNITS.get(keyword)
    if unit and known and unit.strip().lower() not in known:
        raise InputError(f"must be in {known[0]}", keyword, unit).of(location)
