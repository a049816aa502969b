"""Files of orbits and attitudes; their format is detected by the content."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator

import numpy as np

from warpsim.errors import InputError
from warpsim.exchange.ccsds_message import is_ccsds
from warpsim.exchange.ccsds_read import read_aem, read_oem
from warpsim.exchange.segments import AttitudeSegment, EphemerisSegment, plain_name
from warpsim.exchange.source import SourceFile, read_source
from warpsim.exchange.stk_read import is_stk, read_stk_attitude, read_stk_ephemeris

_TLE = re.compile(r"^1 ([A-Z\d ][\d ]{4})[ A-Z] .{50,}\n2 \1 .{50,}$", re.MULTILINE)


def read_ephemeris(path: str | os.PathLike[str], object: str | None = None) -> list[EphemerisSegment]:
    """Segments of an orbit file: CCSDS OEM (text or XML), STK .e, or a table (CSV, ECSV).

    Args:
        path: The file.
        object: Name or number of the object; None reads all.

    Raises:
        InputError: One line: file, line, rule, value.
    """
    return ephemeris_of(read_source(path), object)


def ephemeris_of(source: SourceFile, object: str | None = None) -> list[EphemerisSegment]:
    """Like read_ephemeris(), of a file that has been read."""
    with np.errstate(over="ignore"):  # infinity is refused with its line
        if is_ccsds(source):
            segments = read_oem(source)
        elif is_stk(source):
            segments = read_stk_ephemeris(source)
        else:
            from warpsim.exchange.table_read import read_ephemeris_table

            with _hint_at_elements(source, "states"):
                segments = read_ephemeris_table(source)
    if object is None:
        return segments
    chosen = [s for s in segments if object in (s.object_name, s.object_id, plain_name(s.object_name))]
    if not chosen:
        known = ", ".join(dict.fromkeys(s.object_name for s in segments))
        raise InputError(f"must be one of {known}", "object", object).of(source.file)
    return chosen


def read_attitude(path: str | os.PathLike[str]) -> list[AttitudeSegment]:
    """Segments of an attitude file: CCSDS AEM (text or XML), STK .a, or a table (CSV, ECSV).

    Raises:
        InputError: One line: file, line, rule, value.
    """
    return attitude_of(read_source(path))


def attitude_of(source: SourceFile) -> list[AttitudeSegment]:
    """Like read_attitude(), of a file that has been read."""
    with np.errstate(over="ignore"):
        if is_ccsds(source):
            return read_aem(source)
        if is_stk(source):
            return read_stk_attitude(source)
        from warpsim.exchange.table_read import read_attitude_table

        with _hint_at_elements(source, "attitudes"):
            return read_attitude_table(source)


@contextlib.contextmanager
def _hint_at_elements(source: SourceFile, requested: str) -> Iterator[None]:
    """Explain that a file holds element sets, where it is no table."""
    try:
        yield
    except InputError:
        if _TLE.search(source.text) or "MEAN_MOTION" in source.text:
            text = f"must hold {requested}, got element sets, which TleOrbit and TleSatellites read"
            raise source.error(0, text) from None
        raise
