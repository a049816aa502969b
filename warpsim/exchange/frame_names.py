"""Names that file formats give to frames, as warpsim's own."""

from __future__ import annotations

import re

from warpsim.errors import InputError
from warpsim.exchange.segments import FRAMES, Frame

_CCSDS: dict[str, Frame] = {
    "GCRF": "GCRF",
    "GCRS": "GCRF",
    "ICRF": "GCRF",
    "ICRS": "GCRF",
    "EME2000": "EME2000",
    "J2000": "EME2000",
    "TEME": "TEME",
    "TEMEOFDATE": "TEME",
    "TOD": "TOD",
    "TOD_EARTH": "TOD",
    "MOD": "MOD",
    "MOD_EARTH": "MOD",
}
_ITRF = re.compile(r"ITR[FS]([-_ ]?\d{2,4})?")
_ICRF = re.compile(r"ICRF[-_ ]?[123]")

_STK: dict[str, Frame] = {
    "icrf": "GCRF",
    "j2000": "EME2000",
    "fixed": "ITRF",
    "temeofdate": "TEME",
    "trueofdate": "TOD",
    "meanofdate": "MOD",
}

CCSDS_NAME: dict[Frame, str] = {
    "GCRF": "GCRF",
    "EME2000": "EME2000",
    "ITRF": "ITRF2000",
    "TEME": "TEME",
    "TOD": "TOD",
    "MOD": "MOD",
}
"""What writers of CCSDS files call the frames; realisations of ITRF agree within centimetres."""

STK_NAME: dict[Frame, str] = {
    "GCRF": "ICRF",
    "EME2000": "J2000",
    "ITRF": "Fixed",
    "TEME": "TEMEOfDate",
    "TOD": "TrueOfDate",
    "MOD": "MeanOfDate",
}


def ccsds_frame(name: str) -> Frame | None:
    """The frame of a CCSDS name, also in a table's metadata; None where it is none that is read."""
    capital = name.strip().upper()
    if _ITRF.fullmatch(capital):
        return "ITRF"
    if _ICRF.fullmatch(capital):
        return "GCRF"
    return _CCSDS.get(capital)


def known_ccsds_frame(name: str) -> Frame:
    """Like ccsds_frame().

    Raises:
        InputError: The frame is not read.
    """
    frame = ccsds_frame(name)
    if frame is None:
        raise InputError(f"must be one of {', '.join(FRAMES)} (or ICRF, J2000, ITRF-97, ...)", value=name)
    return frame


def known_stk_frame(name: str) -> Frame:
    """The frame of STK's name of a coordinate system.

    Raises:
        InputError: The frame is not read.
    """
    frame = _STK.get(name.strip().lower())
    if frame is None:
        raise InputError(f"must be one of {', '.join(STK_NAME.values())}", value=name)
    return frame
