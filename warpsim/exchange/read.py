"""Files of orbits and attitudes, whatever their format: it is told by the content."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable

from warpsim.errors import InputError
from warpsim.exchange.ccsds_message import is_ccsds
from warpsim.exchange.ccsds_read import read_aem, read_oem
from warpsim.exchange.records import AttitudeSegment, EphemerisSegment
from warpsim.exchange.source import Source, read_source
from warpsim.exchange.stk_read import is_stk, read_stk_attitude, read_stk_ephemeris


def read_ephemeris(path: str | os.PathLike[str], object: str | None = None) -> list[EphemerisSegment]:
    """Segments of an orbit file: CCSDS OEM (text or XML), STK .e, or a table (CSV, ECSV).

    Args:
        path: The file.
        object: Name or number of the object wanted; None reads all.

    Raises:
        InputError: One line: file, line, rule, value.
    """
    return ephemeris_of(read_source(path), object)


def ephemeris_of(source: Source, object: str | None = None) -> list[EphemerisSegment]:
    """Like read_ephemeris(), of a file that has been read."""
    if is_ccsds(source):
        segments = read_oem(source)
    elif is_stk(source):
        segments = read_stk_ephemeris(source)
    else:
        from warpsim.exchange.table_read import read_ephemeris_table

        segments = read_ephemeris_table(source)
    if object is None:
        return segments
    chosen = [s for s in segments if object in (s.object_name, s.object_id, plain_name(s.object_name))]
    if not chosen:
        known = ", ".join(dict.fromkeys(s.object_name for s in segments))
        raise InputError(f"{source.file}: object: must be one of {known}, got {object!r}")
    return chosen


def read_attitude(path: str | os.PathLike[str]) -> list[AttitudeSegment]:
    """Segments of an attitude file: CCSDS AEM (text or XML), STK .a, or a table (CSV, ECSV).

    Raises:
        InputError: One line: file, line, rule, value.
    """
    return attitude_of(read_source(path))


def attitude_of(source: Source) -> list[AttitudeSegment]:
    """Like read_attitude(), of a file that has been read."""
    if is_ccsds(source):
        return read_aem(source)
    if is_stk(source):
        return read_stk_attitude(source)
    from warpsim.exchange.table_read import read_attitude_table

    return read_attitude_table(source)


def plain_name(name: str) -> str:
    """A name that can be a sensor's and a file's: letters, digits, `_ . -`, others replaced by `_`."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name).lstrip("_.-")
    return plain or "object"


def unique_names(names: Iterable[str]) -> list[str]:
    """Plain names; one that comes again gets `_2`, `_3`, ..."""
    result: list[str] = []
    for name in map(plain_name, names):
        number, candidate = 1, name
        while candidate in result:
            number += 1
            candidate = f"{name}_{number}"
        result.append(candidate)
    return result
