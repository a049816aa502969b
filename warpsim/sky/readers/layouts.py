"""Byte layouts of catalog files that archives give without a ReadMe."""

from __future__ import annotations

from warpsim.tables.fixed_width import ByteField, Layout


def _right_ascension(first_byte: int, seconds: ByteField) -> tuple[ByteField, ...]:
    return (
        ByteField("RAh", first_byte, first_byte + 1, "whole", "h", largest=23),
        ByteField("RAm", first_byte + 2, first_byte + 3, "whole", "min", largest=59),
        seconds,
    )


def _declination(first_byte: int, seconds: ByteField) -> tuple[ByteField, ...]:
    # The sign has a column of its own: a number cannot say -0 degrees.
    return (
        ByteField("DE-", first_byte, first_byte, "sign"),
        ByteField("DEd", first_byte + 1, first_byte + 2, "whole", "deg", largest=90),
        ByteField("DEm", first_byte + 3, first_byte + 4, "whole", "arcmin", largest=59),
        seconds,
    )


def _msx_irac() -> Layout:
    """V/98 `msx.dat`, version 4.2.1. Bytes 1-21 and 93-132 hold names and other surveys' data, and are not read."""
    fluxes = tuple(
        ByteField(f"FSIII{band}", 133 + 9 * k, 141 + 9 * k, unit="Jy")
        for k, band in enumerate(("A", "B1", "B2", "C", "D", "E"))
    )
    fields = (
        *_right_ascension(22, ByteField("RAs", 26, 31, unit="s", largest=60)),
        *_declination(32, ByteField("DEs", 37, 41, unit="arcsec", largest=60)),
        ByteField("pmRA", 53, 61),  # seconds of time per century, which no unit name says
        ByteField("pmDE", 62, 70),  # arcsec per century
        ByteField("SpType", 83, 85, "text"),
        ByteField("Vmag", 88, 92, unit="mag"),
        *fluxes,
    )
    return Layout(fields, shortest=186, length=186, longest=400, name="msx-irac")


def _msx_psc_v1() -> Layout:
    """V/107, version 1.2: a23, 2 f9.4, 2 f4.1, f5.1, i3, then 45 bytes a band, then 3 x 6 flags."""
    fields = [
        ByteField("MSX5C", 1, 23, "text"),
        ByteField("RAdeg", 25, 33, unit="deg"),
        ByteField("DEdeg", 35, 43, unit="deg"),
    ]
    marks = [(24, " "), (34, " "), (44, " "), (49, " "), (54, " "), (60, " ")]
    for k, band in enumerate(("B1", "B2", "A", "C", "D", "E")):  # as VizieR has them: by wavelength but for A
        start = 64 + 45 * k  # of the blank before the flux
        fields.append(ByteField(band, start + 1, start + 12, unit="Jy"))
        fields.append(ByteField(f"q_{band}", start + 14, start + 14, "whole", largest=4))
        marks += [(start, " "), (start + 13, " "), (start + 15, " ")]
    return Layout(tuple(fields), shortest=333, length=354, longest=360, marks=tuple(marks), name="msx-psc-v1")


def _iras_psc() -> Layout:
    """II/125 `main.dat`, version 2.0; positions of B1950."""
    bands = ("12", "25", "60", "100")
    fields = (
        ByteField("IRAS", 1, 11, "text"),
        *_right_ascension(12, ByteField("RAds", 16, 18, "whole", largest=600)),  # tenths of a second
        *_declination(19, ByteField("DEs", 24, 25, "whole", "arcsec", largest=60)),
        *(ByteField(f"Fnu_{band}", 37 + 9 * k, 45 + 9 * k, unit="Jy") for k, band in enumerate(bands)),
        *(ByteField(f"q_Fnu_{band}", 73 + k, 73 + k, "whole", largest=3) for k, band in enumerate(bands)),
        *(ByteField(f"e_Fnu_{band}", 81 + 3 * k, 83 + 3 * k, "whole", unit="%") for k, band in enumerate(bands)),
        ByteField("Var", 117, 118, "whole", unit="%"),
        ByteField("Confuse", 120, 120, "text"),
    )
    return Layout(fields, shortest=139, length=157, longest=170, name="iras-psc")


def _hipparcos() -> Layout:
    """I/239 `hip_main.dat`; columns stand in fixed bytes between bars."""
    fields = (
        ByteField("HIP", 9, 14, "whole"),
        ByteField("RAhms", 18, 28, "text"),  # all there is of 263 stars without an astrometric solution
        ByteField("DEdms", 30, 40, "text"),
        ByteField("Vmag", 42, 46, unit="mag"),
        ByteField("RAdeg", 52, 63, unit="deg"),
        ByteField("DEdeg", 65, 76, unit="deg", largest=90),
        ByteField("Plx", 80, 86, unit="mas"),
        ByteField("pmRA", 88, 95, unit="mas/yr"),
        ByteField("pmDE", 97, 104, unit="mas/yr"),
        ByteField("B-V", 246, 251, unit="mag"),
        ByteField("V-I", 261, 264, unit="mag"),
        ByteField("Hpmag", 275, 281, unit="mag"),
        ByteField("HD", 391, 396, "whole"),
        ByteField("SpType", 436, 447, "text"),
    )
    bars = (2, 15, 17, 29, 41, 47, 49, 51, 64, 77, 79, 87, 96, 105, 252, 265, 274, 282)
    marks = tuple((byte, "|") for byte in bars)
    return Layout(fields, shortest=390, length=449, longest=470, marks=marks, name="hipparcos")


def _hipparcos_2() -> Layout:
    """I/311 `hip2.dat`; positions in radians."""
    fields = (
        ByteField("HIP", 1, 6, "whole"),
        ByteField("RArad", 16, 28, unit="rad", largest=6.2832),
        ByteField("DErad", 30, 42, unit="rad", largest=1.5708),
        ByteField("Plx", 44, 50, unit="mas"),
        ByteField("pmRA", 52, 59, unit="mas/yr"),
        ByteField("pmDE", 61, 68, unit="mas/yr"),
        ByteField("Hpmag", 130, 136, unit="mag"),
        ByteField("B-V", 153, 158, unit="mag"),
        ByteField("V-I", 166, 171, unit="mag"),
    )
    blanks = (7, 11, 13, 15, 29, 43, 51, 60, 69, 76, 83, 90, 97, 104, 129, 137, 152, 159, 165)
    marks = tuple((byte, " ") for byte in blanks)
    return Layout(fields, shortest=171, length=276, longest=290, marks=marks, name="hipparcos-2")


def _akari_irc() -> Layout:
    """II/297 `irc.dat`, version 1."""
    fields = (
        ByteField("objID", 2, 10, "whole"),
        ByteField("objName", 12, 25, "text"),
        ByteField("RAdeg", 27, 35, unit="deg", largest=360),
        ByteField("DEdeg", 37, 45, unit="deg", largest=90),
        ByteField("S09", 70, 80, unit="Jy", null=-999.9),
        ByteField("S18", 81, 91, unit="Jy", null=-999.9),
        ByteField("e_S09", 92, 101, unit="Jy", null=-1000),
        ByteField("e_S18", 102, 111, unit="Jy", null=-1000),
        ByteField("q_S09", 113, 113, "whole", largest=3),
        ByteField("q_S18", 115, 115, "whole", largest=3),
        ByteField("f09", 120, 120, "text"),
        ByteField("f18", 125, 125, "text"),
        ByteField("X09", 161, 162, "whole", null=-1),
        ByteField("X18", 164, 165, "whole", null=-1),
    )
    blanks = (11, 26, 36, 112, 114, 116, 121, 126)
    marks = tuple((byte, " ") for byte in blanks)
    return Layout(fields, shortest=165, length=196, longest=210, marks=marks, name="akari-irc")


LAYOUTS: tuple[Layout, ...] = (
    _msx_irac(),
    _msx_psc_v1(),
    _iras_psc(),
    _hipparcos(),
    _hipparcos_2(),
    _akari_irc(),
)

FILE_NAMES = {
    "msx.dat": "msx-irac",
    "hip_main.dat": "hipparcos",
    "hip2.dat": "hipparcos-2",
    "irc.dat": "akari-irc",
}
"""Surveys by their archive's file name: what a file is taken for whose lines follow no layout, to say what is wrong."""


def likely_layout(file_name: str, survey: str | None) -> Layout | None:
    """The layout that a text without columns should follow: that of the survey asked for, or of the file's name."""
    name = survey or FILE_NAMES.get(file_name.lower().removesuffix(".gz"))
    return next((layout for layout in LAYOUTS if layout.name == name), None)
