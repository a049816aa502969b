"""Surveys in the infrared: MSX, IRAS and AKARI; AllWISE, where it is not saturated, and 2MASS (1.2 to 22 um)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.sky.catalog_columns import BAND_NAMES
from warpsim.sky.photometric_bands import FLUX_PREDICTED, photometric_bands
from warpsim.sky.readers.survey import (
    EXCELLENT,
    FAIR,
    GOOD,
    SATURATED_K_MAG,
    UNCERTAIN,
    UNKNOWN,
    Flags,
    Pair,
    Position,
    Quality,
    Survey,
    band_flux_jy,
    count_note,
    flag_letters,
    measured_quality,
    position_deg,
    positive,
    predicted_quality,
    real_magnitudes,
)
from warpsim.tables.columns import ColumnTable, plain_name

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


def _rate(table: ColumnTable, name: str, unit: str) -> F64:
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


def icrs_of_b1950_deg(ra_deg: F64, dec_deg: F64, epoch_jyear: float = IRAS_EPOCH_JYEAR) -> tuple[F64, F64]:
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


def _akari_filter(table: ColumnTable, um: str) -> tuple[F64, Quality]:
    """Flux density in a filter [Jy], NaN where it was not measured, and its quality, shape (n,) each."""
    names = (f"S{um}", f"flux{um}")
    flux_jy = positive(table.number(*names, unit="Jy", null=_NULLS))
    valid_names = (f"q_S{um}", f"fqual{um}")
    valid = table.needed(*valid_names) if table.find(*names) else table.number(*valid_names)
    flux_jy = np.where(valid == _VALID, flux_jy, np.nan)
    quality = measured_quality(positive(table.number(f"e_S{um}", f"ferr{um}", unit="Jy")) / flux_jy)
    quality = np.where(np.isin(np.char.lower(table.text(f"f{um}", f"flags{um}")), _EDGE_LETTERS), UNCERTAIN, quality)
    return flux_jy, np.where(np.isnan(flux_jy), UNKNOWN, quality)


# --- AllWISE and 2MASS: 1.2 to 22 um ---

SATURATED_MAG = {1: 8.0, 2: 7.0, 3: 1.0, 4: -0.4}
"""Magnitudes from which W1 to W4 are used. Stars saturate from there in W1, W2 and W4, and from 3.8 in W3 (WISE All-Sky
Explanatory Supplement, VI.3.d), whose wings are fitted well enough for 0.05 mag up to magnitude 1: three times better
than what shorter waves tell."""

_QUALITY = {"A": EXCELLENT, "B": GOOD, "C": FAIR}
"""By the letter of ph_qual: signal to noise of 10, 3 and 2. U is an upper limit; X and Z are no measurements."""

_UPPER_LIMIT = "U"
_WISE_FLAGS, _WISE_ARTEFACTS = ("qph", "ph_qual"), ("ccf", "cc_flags")


class _Filter(NamedTuple):
    """What AllWISE says of a filter, shape (n,) each."""

    magnitude: F64
    """NaN where it was not measured, or is saturated."""

    limit_mag: F64
    """The star is no brighter; NaN for none."""

    quality: Quality
    saturated: Flags


def _allwise(table: ColumnTable) -> dict[str, Any]:
    table.need(*_WISE_FLAGS)  # without it a limit would pass for a measurement
    wise = {number: _wise_filter(table, number) for number in SATURATED_MAG}
    magnitudes = {
        "J": _near_infrared(table, "Jmag", "j_m_2mass", "e_Jmag", "j_msig_2mass"),
        "H": _near_infrared(table, "Hmag", "h_m_2mass", "e_Hmag", "h_msig_2mass"),
        "Ks": _near_infrared(table, "Kmag", "k_m_2mass", "e_Kmag", "k_msig_2mass"),
        **{f"W{number}": found.magnitude for number, found in wise.items()},
    }
    notes = [
        note
        for number, found in wise.items()
        for note in count_note(found.saturated, f"with W{number} < {SATURATED_MAG[number]:g} saturated, not used")
    ]
    return {
        "flux_jy": {band: band_flux_jy(band, values) for band, values in magnitudes.items()},
        "limit_jy": {band: band_flux_jy(band, wise[number].limit_mag) for band, number in (("C", 3), ("E", 4))},
        "quality": _allwise_quality(magnitudes, wise),
        "notes": ("apparent motions not used: they contain the parallax", *notes),
    }


def _allwise_quality(magnitudes: Mapping[str, F64], wise: Mapping[int, _Filter]) -> Quality:
    """That of W3; without it, of a prediction from shorter waves, or else of W4."""
    known = {band: ~np.isnan(real_magnitudes(values)) for band, values in magnitudes.items()}
    shorter = np.any([known[band] for band in ("J", "H", "Ks", "W1", "W2")], axis=0)
    wise_colour = known["W1"] | known["W2"]
    saturated = (magnitudes["Ks"] < SATURATED_K_MAG) & ~wise_colour
    predicted = predicted_quality(shorter, wise_colour | (known["J"] & known["Ks"]), saturated)
    return np.where(known["W3"], wise[3].quality, np.where(shorter, predicted, wise[4].quality))


def _wise_filter(table: ColumnTable, number: int) -> _Filter:
    """What the table says of a filter, W1 to W4."""
    values = table.number(f"W{number}mag", f"w{number}mpro", unit="mag")
    letter = flag_letters(table, number - 1, *_WISE_FLAGS)
    saturated = values < SATURATED_MAG[number]
    star_mag = np.where(np.isin(letter, list(_QUALITY)) & ~saturated, values, np.nan)
    limit_mag = np.where((letter == _UPPER_LIMIT) & ~saturated, values, np.nan)
    quality = np.select([letter == known for known in _QUALITY], list(_QUALITY.values()), UNKNOWN)
    # Capitals are spurious detections or swamped by an artefact; small letters are slightly affected.
    quality = np.where(np.char.isupper(flag_letters(table, number - 1, *_WISE_ARTEFACTS)), UNCERTAIN, quality)
    return _Filter(star_mag, limit_mag, np.where(np.isnan(star_mag), UNKNOWN, quality), saturated)


def _near_infrared(table: ColumnTable, vizier: str, irsa: str, vizier_error: str, irsa_error: str) -> F64:
    """A 2MASS magnitude of AllWISE, NaN where it is a limit: those have no error."""
    values = table.number(vizier, irsa, unit="mag")
    if table.find(vizier_error, irsa_error) is None:
        return values
    return np.where(np.isnan(table.number(vizier_error, irsa_error, unit="mag")), np.nan, values)


_J, _H, _K = ("Jmag", "j_m"), ("Hmag", "h_m"), ("Kmag", "k_m")
_FLAGS, _ARTEFACTS = ("Qflg", "Qfl", "ph_qual"), ("Cflg", "cc_flg")
_J_LETTER, _H_LETTER, _K_LETTER = 0, 1, 2  # positions in the flags
_NO_MEASUREMENT = ("U", "X")  # an upper limit, a detection without a brightness
_POOR = ("E", "F")


def _twomass(table: ColumnTable) -> dict[str, Any]:
    table.need(*_FLAGS)  # without it a limit would pass for a measurement
    j_mag, poor_j = _twomass_filter(table, _J, _J_LETTER)
    k_mag, poor_k = _twomass_filter(table, _K, _K_LETTER)
    h_mag = _twomass_filter(table, _H, _H_LETTER)[0] if table.find(*_H) else np.full(len(table), np.nan)
    has_j, has_h, has_k = (~np.isnan(real_magnitudes(values)) for values in (j_mag, h_mag, k_mag))
    measured = has_j | has_h | has_k
    doubtful = poor_j | poor_k | (k_mag < SATURATED_K_MAG)
    return {
        "flux_jy": {band: band_flux_jy(band, values) for band, values in (("J", j_mag), ("H", h_mag), ("Ks", k_mag))},
        "quality": predicted_quality(measured, has_j & has_k, doubtful),
        "notes": (
            *count_note(measured & ~(has_j & has_k), "were not measured in both J and K, so have no colour"),
            *count_note(~measured, "were not measured, so have no flux"),
        ),
    }


def _twomass_filter(table: ColumnTable, names: tuple[str, str], position: int) -> tuple[F64, Flags]:
    """Magnitude, NaN where it was not measured, and whether it is poor, shape (n,) each."""
    letter = flag_letters(table, position, *_FLAGS)
    artefact = flag_letters(table, position, *_ARTEFACTS)
    star_mag = np.where(np.isin(letter, _NO_MEASUREMENT), np.nan, table.needed(*names, unit="mag"))
    return star_mag, np.isin(letter, _POOR) | ~np.isin(artefact, ("", "0"))


SURVEYS = (
    Survey(
        name="msx-irac",
        title="MSX Infrared Astrometric Catalog, version 4.2.1",
        reference="V/98 (Egan and Price 1996, AJ 112, 2862)",
        needs=(("FSIIIA",),),
        light=_msx_irac,
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
    ),
    Survey(
        name="allwise",
        title="AllWISE source catalog",
        reference="II/328 (Cutri et al. 2013)",
        needs=(("W3mag", "w3mpro"), _WISE_FLAGS),
        light=_allwise,
        epoch_jyear=2010.5,
        id_columns=("AllWISE", "designation"),
        id_prefix="WISEA ",
    ),
    Survey(
        name="2mass",
        title="2MASS all-sky catalog of point sources",
        reference="II/246 (Cutri et al. 2003)",
        needs=(_J, _K, ("2MASS", *_FLAGS)),
        light=_twomass,
        epoch_jyear=2000.0,  # observed from June 1997 to February 2001; there are no proper motions
        id_columns=("2MASS", "designation"),
        id_prefix="2MASS J",
        telling=("Qflg", "Qfl", "2MASS"),
    ),
)
