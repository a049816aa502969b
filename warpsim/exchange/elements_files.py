"""Element sets of satellites from files: TLE, 3LE and OMM, told apart by content."""

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
        InputError: The file cannot be read, or breaks a rule: file, line or record, object, rule and value.
    """
    where = os.fspath(path)
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}").of(where) from None
    except ValueError:
        raise InputError("is not UTF-8 text").of(where) from None
    return parse_element_sets(text, where)


def parse_element_sets(text: str, where: str) -> list[ElementSet]:
    """Read all element sets of a text; `where` begins messages.

    Raises:
        InputError: As `read_element_sets`.
    """
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    layout = layout_of(text)
    if layout is not None:
        sets = [element_set(fields, place) for fields, place in READERS[layout](text, where)]
    elif looks_like_tle(text):
        sets = parse_tle(text, where)
    else:
        raise InputError("must hold element sets, as TLE or as OMM in KVN, XML, JSON or CSV").of(where)
    if not sets:
        raise InputError("holds no element sets").of(where)
    return sets
