"""Byte layouts from the description that the CDS and the AAS journals put beside a table ("Byte-by-byte ...")."""

from __future__ import annotations

import fnmatch
import re
from typing import Literal

from warpsim.errors import InputError
from warpsim.tables.fixed_width import ByteField, Layout

_TITLE = re.compile(r"^\s*Byte-(?:by|per)-byte Description of file:\s*(?P<files>.*)$", re.IGNORECASE)
_ROW = re.compile(
    r"^\s*(?:(?P<first>\d+)\s*-)?\s*(?P<last>\d+)\s+(?P<format>[AIFEDL]\d+(?:\.\d+)?)\s+(?P<unit>\S+)\s+(?P<name>\S+)"
    r"(?:\s+(?P<text>.*))?$"
)
_NULL = re.compile(r"^\*?\s*(?:[\[\]]\S*[\[\]])?\s*\?(?:=(?P<null>\S+))?")
_RULE = re.compile(r"^[-=]{20,}\s*$")

_LONGEST_LINE = 100_000

# The names of these say the unit, and astropy knows no name for a tenth of a second.
_PARTS = {"RAh", "RAm", "RAs", "RAds", "DE-", "DEd", "DEm", "DEs"}


def layout_from_readme(text: str, file_name: str) -> Layout:
    """Layout of a file as a CDS ReadMe describes it.

    Columns that the ReadMe leaves unnamed, and those that repeat a format, are not read.

    Args:
        text: The ReadMe.
        file_name: The data file's name, without folder and ".gz".

    Raises:
        InputError: It describes no file, or not this one and several others.
    """
    sections: list[tuple[list[str], list[re.Match[str]]]] = []
    for line in text.splitlines():
        title = _TITLE.match(line)
        row = _ROW.match(line)
        if title:
            sections.append((title["files"].replace(",", " ").split(), []))
        elif row and sections:
            sections[-1][1].append(row)
    sections = [section for section in sections if section[1]]
    if not sections:
        raise InputError("must hold a byte-by-byte description")
    named = [rows for files, rows in sections if any(fnmatch.fnmatch(file_name, name) for name in files)]
    if not named and len(sections) > 1:
        described = ", ".join(name for files, _ in sections for name in files)
        raise InputError(f"must describe {file_name}", value=described, form="s")
    rows = (named or [sections[0][1]])[0]
    fields = tuple(_field(row) for row in rows if row["name"] != "---")
    needed = [field.last_byte for field, row in zip(fields, _named(rows), strict=True) if not _optional(row)]
    longest = max(field.last_byte for field in fields)
    return Layout(fields, shortest=max(needed, default=1), length=longest)


def split_self_described(text: str) -> int | None:
    """Number of lines before the data of a table that holds its own description; None if it holds none."""
    lines = text.split("\n")
    if not any(_TITLE.match(line) for line in lines[:2000]):
        return None
    rules = [number for number, line in enumerate(lines, start=1) if _RULE.match(line)]
    return rules[-1] if rules else None


def _named(rows: list[re.Match[str]]) -> list[re.Match[str]]:
    return [row for row in rows if row["name"] != "---"]


def _optional(row: re.Match[str]) -> bool:
    """Return whether the bytes may be missing: texts, and numbers that may be blank."""
    return row["format"][0] in "AL" or bool(_NULL.match(row["text"] or ""))


def _field(row: re.Match[str]) -> ByteField:
    kind: Literal["number", "whole", "text"] = "number"
    if row["format"][0] in "AL":
        kind = "text"
    elif row["format"][0] == "I":
        kind = "whole"
    null = _NULL.match(row["text"] or "")
    unit = "" if row["unit"] == "---" or row["name"] in _PARTS or kind == "text" else row["unit"]
    try:
        null_value = float(null["null"]) if null and null["null"] else None
    except ValueError:  # dashes or a text
        null_value = None
    last = int(row["last"])
    first = int(row["first"] or last)
    if not 1 <= first <= last <= _LONGEST_LINE:
        rule = f"bytes must grow from 1 to at most {_LONGEST_LINE}, got {first}-{last}"
        raise InputError(rule).of(f"column {row['name']}")
    return ByteField(row["name"], first, last, kind, unit, null_value)
