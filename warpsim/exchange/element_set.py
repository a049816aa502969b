"""One satellite's SGP4 mean elements, independent of the file format."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from astropy.time import Time


@dataclass(frozen=True, eq=False, slots=True)
class ElementSet:
    """Mean elements ready for SGP4."""

    name: str
    """As in the file, "" where it gives none."""
    norad_id: int | None
    """Catalog number; None where an OMM gives none."""
    international_designator: str
    """Launch year, number and piece, "1998-067A"; as in the file where it is written otherwise, "" where absent."""
    satrec: Any
    """The initialised `sgp4.api.Satrec`, with the constants of WGS72."""
    location: str
    """Line or record of the source: `line 3`."""

    @property
    def label(self) -> str:
        """Label for messages."""
        return label(self.name, self.norad_id)

    @property
    def epoch_jd_utc(self) -> tuple[float, float]:
        """Epoch as a two-part Julian date of UTC [d]."""
        return float(self.satrec.jdsatepoch), float(self.satrec.jdsatepochF)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Inputs of SGP4: epoch, drag and mean elements."""
        sat = self.satrec
        elements = sat.bstar, sat.ndot, sat.nddot, sat.ecco, sat.argpo, sat.inclo, sat.mo, sat.no_kozai, sat.nodeo
        return *self.epoch_jd_utc, *elements

    @property
    def epoch(self) -> Time:
        """Epoch (UTC)."""
        from astropy.time import Time

        return Time(*self.epoch_jd_utc, format="jd", scale="utc")


def label(name: str, norad_id: int | None) -> str:
    """`ISS (ZARYA), 25544`: what is known of name and number, for messages."""
    return ", ".join(text for text in (name, "" if norad_id is None else f"{norad_id:05d}") if text)


def tidy_name(text: str) -> str:
    """A name without outer blanks and without characters that would break a line of text."""
    return "".join(c if c.isprintable() else "?" for c in text.strip())


def plain_designator(text: str) -> str:
    """`98067A` of element sets as `1998-067A`; anything else without its outer blanks."""
    text = text.strip()
    if len(text) >= 6 and text[:5].isdigit() and text[5:].isalpha():
        return f"{'19' if int(text[:2]) >= 57 else '20'}{text[:2]}-{text[2:]}"
    return text


def is_finite_model(satrec: Any) -> bool:
    """Return whether SGP4 could be initialised: elements far out of any orbit leave NaN or infinities behind."""
    return all(math.isfinite(value) for value in (satrec.a, satrec.no_kozai, satrec.mdot, satrec.argpdot, satrec.bstar))
