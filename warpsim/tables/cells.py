"""Cells of text: their encoding, how delimiters part them, and which of them are numbers."""

from __future__ import annotations

import csv

MISSING = ("", "nan", "null", "none", "-", "--", "---", "~", "n/a")
"""Texts, in small letters, that stand for a missing number."""


def is_number(text: str | bytes) -> bool:
    """Return whether a text is a number; Python's 1_0 is none."""
    try:
        float(text)
    except ValueError:
        return False
    return ("_" if isinstance(text, str) else b"_") not in text  # type: ignore[operator]


def cells_of(line: str, delimiter: str) -> list[str]:
    """Cells of a line; quoted cells may hold the delimiter."""
    if '"' not in line:
        return line.split() if delimiter == " " else line.split(delimiter)
    text = line.strip() if delimiter == " " else line
    try:
        return next(csv.reader([text], delimiter=delimiter, skipinitialspace=delimiter != "\t"))
    except (csv.Error, StopIteration):  # control characters: no row of a table
        return [text]


def decoded(line: bytes) -> str:
    """Text of a line: UTF-8, or Latin-1 in older files."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")
