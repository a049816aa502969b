"""AllWISE (II/328): W3 and W4 to bands C and E, and K with J-K to A where W3 is of no use.

W1 and W2 are not used: they saturate at magnitudes 8 and 7, and the stars that matter here are brighter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import FLUX_PREDICTED
from warpsim.sky.colours import colour_temperature_k
from warpsim.sky.readers.angles import place_deg
from warpsim.sky.readers.photometry import (
    EXCELLENT,
    FAIR,
    GOOD,
    SATURATED_K_MAG,
    UNCERTAIN,
    UNKNOWN,
    Quality,
    band_flux_jy,
    count_note,
    flag_letters,
    need,
    predicted_flux_a_jy,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 2010.5

SATURATED_MAG = {3: 3.8, 4: -0.4}
"""W3 and W4 brighter than this saturate (WISE All-Sky Explanatory Supplement, VI.3.d)."""

_QUALITY = {"A": EXCELLENT, "B": GOOD, "C": FAIR}
"""By the letter of ph_qual: signal to noise of 10, 3 and 2. U is an upper limit; X and Z are no measurements."""

_LIMIT = "U"
_FLAGS, _ARTEFACTS = ("qph", "ph_qual"), ("ccf", "cc_flags")


def _convert(table: ColumnTable) -> SurveyStars:
    need(table, *_FLAGS)  # without it a limit would pass for a measurement
    ra_deg, dec_deg, _ = place_deg(table)
    mag_3, limit_3, quality_3, saturated_3 = _filter(table, 3)
    mag_4, limit_4, quality_4, _ = _filter(table, 4)

    j_mag = _near_infrared(table, "Jmag", "j_m_2mass", "e_Jmag", "j_msig_2mass")
    k_mag = _near_infrared(table, "Kmag", "k_m_2mass", "e_Kmag", "k_msig_2mass")
    flux_a_jy, quality_a = predicted_flux_a_jy("K", k_mag, j_mag - k_mag)
    quality_a = np.where((k_mag < SATURATED_K_MAG) & (quality_a == FAIR), UNCERTAIN, quality_a)
    has_3 = ~np.isnan(mag_3)
    flux_a_jy = np.where(has_3, np.nan, flux_a_jy)
    quality = np.where(np.isnan(flux_a_jy), quality_4, quality_a)
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={"A": flux_a_jy, "C": band_flux_jy("C", mag_3), "E": band_flux_jy("E", mag_4)},
        limit_jy={"C": band_flux_jy("C", limit_3), "E": band_flux_jy("E", limit_4)},
        flux_flag={"A": np.full(len(table), FLUX_PREDICTED)},
        temperature_k=colour_temperature_k(j_mag - k_mag, "J-K"),
        quality=np.where(has_3, quality_3, quality),
        id=star_names(table, "WISEA ", "AllWISE", "designation"),
        epoch_jyear=EPOCH_JYEAR,
        notes=(
            "apparent motions not used: they contain the parallax",
            *count_note(saturated_3, f"with W3 < {SATURATED_MAG[3]} saturated, not used"),
        ),
    )


def _filter(table: ColumnTable, number: int) -> tuple[Array, Array, Quality, NDArray[np.bool_]]:
    """Magnitude in W3 or W4, brightness limit [mag], quality and whether it is saturated, shape (n,) each."""
    values = table.number(f"W{number}mag", f"w{number}mpro", unit="mag")
    letter = flag_letters(table, number - 1, *_FLAGS)
    saturated = values < SATURATED_MAG[number]
    star_mag = np.where(np.isin(letter, list(_QUALITY)) & ~saturated, values, np.nan)
    limit_mag = np.where((letter == _LIMIT) & ~saturated, values, np.nan)
    quality = np.select([letter == known for known in _QUALITY], list(_QUALITY.values()), UNKNOWN)
    # Capitals are spurious detections or swamped by an artefact; small letters are slightly affected.
    spoilt = np.char.isupper(flag_letters(table, number - 1, *_ARTEFACTS))
    quality = np.where(spoilt, UNCERTAIN, quality)
    return star_mag, limit_mag, np.where(np.isnan(star_mag), UNKNOWN, quality), saturated


def _near_infrared(table: ColumnTable, vizier: str, irsa: str, vizier_error: str, irsa_error: str) -> Array:
    """A 2MASS magnitude, NaN where it is a limit: those have no error."""
    values = table.number(vizier, irsa, unit="mag")
    if table.find(vizier_error, irsa_error) is None:
        return values
    return np.where(np.isnan(table.number(vizier_error, irsa_error, unit="mag")), np.nan, values)


SURVEYS = (
    Survey(
        name="allwise",
        title="AllWISE source catalog",
        reference="II/328 (Cutri et al. 2013)",
        needs=(("W3mag", "w3mpro"), _FLAGS),
        convert=_convert,
    ),
)
