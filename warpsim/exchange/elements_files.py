"""Element sets of satellites from files: TLE, 3LE and OMM, detected by content."""

from __future__ import annotations

import os
from pathlib import Path

from warpsim.errors import InputError
from warpsim.exchange.element_set import ElementSet
from warpsim.exchange.omm import element_set
from warpsim.exchange.omm_layouts import READERS, layout_of
from warpsim.exchange.tle_lines import looks_like_tle, parse_tle


def read_element_sets(path: str | os.PathLike[str]) -> list[ElementSet]:
    """Read all element sets of a file, in its order.

    Args:
        path: Two-line element sets with or without name lines, or Orbit Mean-Elements Messages as KVN, XML, JSON or
            CSV (the layouts of CelesTrak and Space-Track). The content decides, not the file's name.

    Raises:
        InputError: The file cannot be read, or is not valid: file, line or record, object, rule and value.
    """
    try:
        return parse_element_sets(_text_of(Path(path)))
    except InputError as error:
        raise error.of(path) from None


def _text_of(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError("is not UTF-8 text") from None


def parse_element_sets(text: str) -> list[ElementSet]:
    """Read all element sets of a text.

    Raises:
        InputError: As `read_element_sets`, without a file.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    layout = layout_of(text)
    if layout is not None:
        sets = [element_set(fields, location) for fields, location in READERS[layout](text)]
    elif looks_like_tle(text):
        sets = parse_tle(text)
    else:
        raise InputError("must hold element sets, as TLE or as OMM in KVN, XML, JSON or CSV")
    if not sets:
        raise InputError("holds no element sets")
    return sets
