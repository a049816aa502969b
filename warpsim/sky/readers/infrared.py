"""Surveys in the infrared: MSX, IRAS and AKARI."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import BAND_NAMES
from warpsim.sky.photometric_bands import FLUX_PREDICTED, photometric_bands
from warpsim.sky.readers.angles import Pair, position_deg
from warpsim.sky.readers.survey import (
    FAIR,
    GOOD,
    UNCERTAIN,
    UNKNOWN,
    Position,
    Quality,
    Survey,
    band_flux_jy,
    count_note,
    measured_quality,
    positive,
)
from warpsim.tables.columns import ColumnTable, plain_name

Array = NDArray[np.float64]

# --- MSX: the Infrared Astrometric Catalog, and the Point Source Catalog ---

_MAS_PER_TIME_S = 15_000.0  # a second of right ascension is 15 arcsec
_CENTURY_YR = 100.0
_PER_CENTURY = ("sha", "arcsecha", "s100yr", "arcsec100yr", "scy", "arcseccy", "scentury", "arcseccentury")
"""Units of the catalog as archives spell them, without case and punctuation; ha is the CDS's hundred years."""

_NONE, _PSC_LIMIT, _EXCELLENT = 0, 1, 4
"""Flux quality of the Point Source Catalog: none, upper limit, and from fair (2) to excellent."""

_PSC_POSITIONS: tuple[Pair, ...] = (("RAJ2000", "DEJ2000"), ("RAdeg", "DEdeg"), ("ra", "dec"))


def _msx_irac(table: ColumnTable) -> dict[str, Any]:
    # Per century, and in right ascension the rate of the angle itself, in seconds of time.
    pm_ra = _rate(table, "pmRA", "0.01 s / yr") / _CENTURY_YR * _MAS_PER_TIME_S
    flux_jy = {band: table.number(f"FSIII{band}", unit="Jy", null=(0.0,)) for band in BAND_NAMES}
    known = np.any([np.isfinite(values) for values in flux_jy.values()], axis=0)
    visible_jy = band_flux_jy("V", table.number("Vmag", unit="mag"))
    return {
        "flux_jy": flux_jy | {"V": visible_jy},
        "flux_flag": {band: np.full(len(table), FLUX_PREDICTED) for band in BAND_NAMES},
        "pm_ra_mas_yr": pm_ra * np.cos(np.radians(position_deg(table)[1])),
        "pm_dec_mas_yr": _rate(table, "pmDE", "0.01 arcsec / yr") / _CENTURY_YR * 1000.0,
        "quality": np.where(known, FAIR, np.where(np.isnan(visible_jy), UNKNOWN, UNCERTAIN)),
        "notes": (
            "infrared fluxes are the catalog's predictions",
            "pmRA times 150 cos(dec), pmDE times 10: per century to mas/yr",
        ),
    }


def _rate(table: ColumnTable, name: str, unit: str) -> Array:
    """A proper motion in the catalog's own unit, per century; NaN where there is none.

    Archives spell that unit in ways astropy does not know: such a spelling is taken for it.
    """
    own_name = table.find(name)
    if own_name is None:
        return table.number(name)
    from astropy.units import UnrecognizedUnit

    stated = table.table[own_name].unit
    if isinstance(stated, UnrecognizedUnit):
        if plain_name(str(stated)) not in _PER_CENTURY:
            raise InputError(f"must be in {unit} or the like", own_name, str(stated), "s")
        unit = ""
    return table.number(name, unit=unit)


def _msx_psc(table: ColumnTable) -> dict[str, Any]:
    flux_jy, limit_jy, best = {}, {}, np.zeros(len(table))
    for band in BAND_NAMES:
        if table.find(band) is None:
            continue
        # Without its quality a flux may be a limit: a table with the flux must have the quality.
        quality = table.needed(f"q_{band}")
        bad = np.flatnonzero((quality < _NONE) | (quality > _EXCELLENT))
        if bad.size:
            raise InputError("must be in [0, 4]", f"q_{band}", quality[bad[0]], "g", row=int(bad[0]))
        given = table.number(band, unit="Jy", null=(0.0,))
        flux_jy[band] = np.where(quality > _PSC_LIMIT, given, np.nan)
        # Some releases mark limits by a minus sign.
        limit_jy[band] = np.where(quality == _PSC_LIMIT, np.abs(given), np.nan)
        best = np.fmax(best, np.where(np.isnan(flux_jy[band]), 0.0, quality))
    return {
        "flux_jy": flux_jy,
        "limit_jy": limit_jy,
        "quality": best.astype(np.int64),
        "notes": ("quality is that of the best band", "fluxes of quality 1 are upper limits"),
    }


def _psc_survey(name: str, version: str, reference: str, *needs: tuple[str, ...]) -> Survey:
    return Survey(
        name,
        f"MSX Point Source Catalog, version {version}",
        reference,
        needs=(("A",), ("q_A",), *needs),
        light=_msx_psc,
        epoch_jyear=1996.6,  # middle of the cryogenic observations, May 1996 to February 1997; no proper motions
        position=lambda table: position_deg(table, *_PSC_POSITIONS),
        id_columns=("MSX6C", "MSX5C", "MSX6C_ID", "MSX5C_ID", "name"),
        telling=("MSX6C", "MSX5C", "MSX6C_ID", "MSX5C_ID", "q_A"),
    )


# --- IRAS: flux densities are quoted for a spectrum of 1 / frequency, as the bands are: no colour correction ---

IRAS_EPOCH_JYEAR = 1983.5
_BAND_UM = {"IRAS12": 12, "IRAS25": 25}
_LIMIT_BANDS = {"IRAS12": "C", "IRAS25": "E"}
"""Upper limits hold for predictions in the neighbouring MSX band, at equal magnitude."""

_LIMIT, _MODERATE, _HIGH = 1.0, 2.0, 3.0  # q_Fnu

_J2000_POSITIONS: tuple[Pair, ...] = (("RAJ2000", "DEJ2000"), ("RA_ICRS", "DE_ICRS"), ("ra", "dec"), ("RA", "DE"))
_B1950_POSITIONS: tuple[Pair, ...] = (
    ("RA1950", "DE1950"),
    ("ra1950", "dec1950"),
    ("RAB1950", "DEB1950"),
    ("RAdeg", "DEdeg"),  # of II/156 and II/275: B1950, unlike elsewhere
)


def _iras_position(table: ColumnTable) -> Position:
    ra_deg, dec_deg, ra_name = position_deg(table, *_J2000_POSITIONS, *_B1950_POSITIONS)
    if _is_b1950(table):
        table.position = None
        ra_deg, dec_deg = icrs_of_b1950_deg(ra_deg, dec_deg)
    return ra_deg, dec_deg, ra_name


def _is_b1950(table: ColumnTable) -> bool:
    """Return whether the positions are of B1950, as those in parts are."""
    return not any(table.find(ra) and table.find(dec) for ra, dec in _J2000_POSITIONS)


def _iras(table: ColumnTable) -> dict[str, Any]:
    flux_jy, limit_jy, quality = {}, {}, {}
    for band, um in _BAND_UM.items():
        quoted_jy = positive(table.number(f"Fnu_{um}", unit="Jy"))
        flag_names = (f"q_Fnu_{um}", f"fqual_{um}")
        # Without its flag a flux may be an upper limit: a table with the flux must have the flag.
        flag = table.needed(*flag_names) if table.find(f"Fnu_{um}") else table.number(*flag_names)
        flux_jy[band] = np.where(flag >= _MODERATE, quoted_jy, np.nan)
        zero_jy = photometric_bands()[band].zero_mag_jy
        limit_mag = -2.5 * np.log10(np.where(flag == _LIMIT, quoted_jy, np.nan) / zero_jy)
        limit_jy[_LIMIT_BANDS[band]] = band_flux_jy(_LIMIT_BANDS[band], limit_mag)
        error_percent = positive(table.number(f"e_Fnu_{um}", f"relunc_{um}", unit="%"))
        quality[band] = np.where(flag == _HIGH, measured_quality(error_percent / 100.0), GOOD)
    quality_25 = np.where(np.isnan(flux_jy["IRAS25"]), UNKNOWN, quality["IRAS25"])
    carried = f"positions carried from FK4 B1950, epoch {IRAS_EPOCH_JYEAR}, to ICRS"
    return {
        "flux_jy": flux_jy,
        "limit_jy": limit_jy,
        "quality": np.where(np.isnan(flux_jy["IRAS12"]), quality_25, quality["IRAS12"]),
        "notes": (carried,) if _is_b1950(table) else (),
    }


def icrs_of_b1950_deg(ra_deg: Array, dec_deg: Array, epoch_jyear: float = IRAS_EPOCH_JYEAR) -> tuple[Array, Array]:
    """Carry positions from FK4, equinox B1950, as observed at an epoch, to ICRS; no proper motion is applied.

    FK4 turns slowly against ICRS, so that the epoch counts. NaN passes.
    """
    from astropy import units as u
    from astropy.coordinates import FK4, SkyCoord
    from astropy.time import Time

    bad = np.flatnonzero(np.abs(dec_deg) > 90.0)
    if bad.size:
        raise InputError("must be in [-90, 90]", "declination", dec_deg[bad[0]], "g", row=int(bad[0]))
    frame = FK4(equinox=Time("B1950"), obstime=Time(epoch_jyear, format="jyear"))
    position = SkyCoord(ra_deg * u.deg, dec_deg * u.deg, frame=frame).icrs
    return np.asarray(position.ra.deg), np.asarray(position.dec.deg)


# --- AKARI/IRC: 9 and 18 um ---

_VALID = 3.0  # q_S09, q_S18
_NULLS = (-999.9, float(np.float32(-999.9)))
_EDGE_LETTERS = tuple("89abcdef")  # hexadecimal digits with bit 8: measured at the image's edge, flux too low


def _akari(table: ColumnTable) -> dict[str, Any]:
    flux_9_jy, quality_9 = _akari_filter(table, "09")
    flux_18_jy, quality_18 = _akari_filter(table, "18")
    no_flux = np.isnan(flux_9_jy) & np.isnan(flux_18_jy)
    return {
        "flux_jy": {"S9W": flux_9_jy, "L18W": flux_18_jy},
        "quality": np.where(quality_9 == UNKNOWN, quality_18, quality_9),
        "notes": count_note(no_flux, "have no flux of quality 3, so no flux"),
    }


def _akari_filter(table: ColumnTable, um: str) -> tuple[Array, Quality]:
    """Flux density in a filter [Jy], NaN where it was not measured, and its quality, shape (n,) each."""
    names = (f"S{um}", f"flux{um}")
    flux_jy = positive(table.number(*names, unit="Jy", null=_NULLS))
    valid_names = (f"q_S{um}", f"fqual{um}")
    valid = table.needed(*valid_names) if table.find(*names) else table.number(*valid_names)
    flux_jy = np.where(valid == _VALID, flux_jy, np.nan)
    quality = measured_quality(positive(table.number(f"e_S{um}", f"ferr{um}", unit="Jy")) / flux_jy)
    quality = np.where(np.isin(np.char.lower(table.text(f"f{um}", f"flags{um}")), _EDGE_LETTERS), UNCERTAIN, quality)
    return flux_jy, np.where(np.isnan(flux_jy), UNKNOWN, quality)


SURVEYS = (
    Survey(
        name="msx-irac",
        title="MSX Infrared Astrometric Catalog, version 4.2.1",
        reference="V/98 (Egan and Price 1996, AJ 112, 2862)",
        needs=(("FSIIIA",),),
        light=_msx_irac,
        telling=("FSIIIA",),
    ),
    _psc_survey("msx-psc", "2.3", "V/114 (Egan et al. 2003, AFRL-VS-TR-2003-1589)"),
    _psc_survey("msx-psc-v1", "1.2", "V/107 (Egan et al. 1999, AFRL-VS-TR-1999-1522)", ("MSX5C", "MSX5C_ID")),
    Survey(
        name="iras-psc",
        title="IRAS Point Source Catalog, or Faint Source Catalog",
        reference="II/125 (1988, NASA RP-1190), II/156A (Moshir et al. 1990)",
        needs=(("Fnu_12",), ("q_Fnu_12", "fqual_12")),
        light=_iras,
        epoch_jyear=IRAS_EPOCH_JYEAR,
        position=_iras_position,
        id_columns=("IRAS", "pscname", "fscname"),
        id_prefix="IRAS ",
        telling=("Fnu_12", "Fnu_25"),
    ),
    Survey(
        name="akari-irc",
        title="AKARI/IRC all-sky survey point source catalogue",
        reference="II/297 (Ishihara et al. 2010, A&A 514, A1)",
        needs=(("S09", "flux09"), ("q_S09", "fqual09")),
        light=_akari,
        epoch_jyear=2007.0,  # middle of the survey, May 2006 to August 2007
        id_columns=("objName",),
        id_prefix="AKARI-IRC-V1 J",
        telling=("S09", "flux09"),
    ),
)
