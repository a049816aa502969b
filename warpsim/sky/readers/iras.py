"""IRAS: the Point Source Catalog (II/125) and the Faint Source Catalog (II/156), bands IRAS12 and IRAS25.

IRAS quotes flux densities for a spectrum that falls as 1 / frequency. So do the bands: no colour correction is needed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.readers.angles import PARTS, Pair, place_deg
from warpsim.sky.readers.photometry import (
    GOOD,
    UNKNOWN,
    band_flux_jy,
    magnitude,
    measured_quality,
    positive,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 1983.5

_BAND_UM = {"IRAS12": 12, "IRAS25": 25}
_LIMIT_BANDS = {"IRAS12": "C", "IRAS25": "E"}
"""Upper limits hold for predictions in the neighbouring MSX band, at equal magnitude."""

_LIMIT, _MODERATE, _HIGH = 1.0, 2.0, 3.0  # q_Fnu

_J2000_PLACES: tuple[Pair, ...] = (
    ("RAJ2000", "DEJ2000"),
    ("RA_ICRS", "DE_ICRS"),
    ("ra", "dec"),
    ("RA", "DE"),
)
_B1950_PLACES: tuple[Pair, ...] = (
    ("RA1950", "DE1950"),
    ("ra1950", "dec1950"),
    ("RAB1950", "DEB1950"),
    ("RAdeg", "DEdeg"),  # of II/156 and II/275: B1950, unlike elsewhere
)


def _convert(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, ra_name = place_deg(table, *_J2000_PLACES, *_B1950_PLACES)
    notes: list[str] = []
    if ra_name == PARTS or any(table.find(ra) == ra_name for ra, _ in _B1950_PLACES):
        ra_deg, dec_deg = icrs_of_b1950_deg(ra_deg, dec_deg)
        notes.append(f"places carried from FK4 B1950, epoch {EPOCH_JYEAR}, to ICRS")

    flux_jy, limit_jy, quality = {}, {}, {}
    for band, um in _BAND_UM.items():
        quoted_jy = positive(table.number(f"Fnu_{um}", unit="Jy"))
        flag_names = (f"q_Fnu_{um}", f"fqual_{um}")
        # Without its flag a flux may be an upper limit: a table with the flux must have the flag.
        flag = table.needed(*flag_names) if table.find(f"Fnu_{um}") else table.number(*flag_names)
        flux_jy[band] = np.where(flag >= _MODERATE, quoted_jy, np.nan)
        limit_mag = magnitude(np.where(flag == _LIMIT, quoted_jy, np.nan), band)
        limit_jy[_LIMIT_BANDS[band]] = band_flux_jy(_LIMIT_BANDS[band], limit_mag)
        error_percent = positive(table.number(f"e_Fnu_{um}", f"relunc_{um}", unit="%"))
        quality[band] = np.where(flag == _HIGH, measured_quality(error_percent / 100.0), GOOD)

    quality_25 = np.where(np.isnan(flux_jy["IRAS25"]), UNKNOWN, quality["IRAS25"])
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy=flux_jy,
        limit_jy=limit_jy,
        quality=np.where(np.isnan(flux_jy["IRAS12"]), quality_25, quality["IRAS12"]),
        id=star_names(table, "IRAS ", "IRAS", "pscname", "fscname"),
        epoch_jyear=EPOCH_JYEAR,
        notes=tuple(notes),
    )


def icrs_of_b1950_deg(ra_deg: Array, dec_deg: Array, epoch_jyear: float = EPOCH_JYEAR) -> tuple[Array, Array]:
    """Carry places from FK4, equinox B1950, as observed at an epoch, to ICRS; no proper motion is applied.

    Args:
        ra_deg: Right ascension [deg], shape (n,); NaN passes.
        dec_deg: Declination [deg].
        epoch_jyear: Year of observation: FK4 turns slowly against ICRS.

    Returns:
        Right ascension and declination [deg], ICRS, at the same epoch, shape (n,) each.

    Raises:
        InputError: A declination beyond the poles.
    """
    from astropy import units as u
    from astropy.coordinates import FK4, SkyCoord
    from astropy.time import Time

    bad = np.flatnonzero(np.abs(dec_deg) > 90.0)
    if bad.size:
        raise InputError("must be in [-90, 90]", "declination", dec_deg[bad[0]], "g", row=int(bad[0]))
    frame = FK4(equinox=Time("B1950"), obstime=Time(epoch_jyear, format="jyear"))
    place = SkyCoord(ra_deg * u.deg, dec_deg * u.deg, frame=frame).icrs
    return np.asarray(place.ra.deg), np.asarray(place.dec.deg)


SURVEYS = (
    Survey(
        name="iras-psc",
        title="IRAS Point Source Catalog, or Faint Source Catalog",
        reference="II/125 (1988, NASA RP-1190), II/156A (Moshir et al. 1990)",
        needs=(("Fnu_12",), ("q_Fnu_12", "fqual_12")),
        convert=_convert,
    ),
)
