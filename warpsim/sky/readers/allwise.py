"""AllWISE (II/328): W1 to W4 where they are not saturated, and the magnitudes of 2MASS that come with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.readers.angles import place_deg
from warpsim.sky.readers.photometry import (
    EXCELLENT,
    FAIR,
    GOOD,
    SATURATED_K_MAG,
    UNCERTAIN,
    UNKNOWN,
    Flags,
    Quality,
    band_flux_jy,
    count_note,
    flag_letters,
    need,
    predicted_quality,
    real_magnitudes,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 2010.5

SATURATED_MAG = {1: 8.0, 2: 7.0, 3: 3.8, 4: -0.4}
"""Stars brighter than this saturate (WISE All-Sky Explanatory Supplement, VI.3.d)."""

_QUALITY = {"A": EXCELLENT, "B": GOOD, "C": FAIR}
"""By the letter of ph_qual: signal to noise of 10, 3 and 2. U is an upper limit; X and Z are no measurements."""

_LIMIT = "U"
_FLAGS, _ARTEFACTS = ("qph", "ph_qual"), ("ccf", "cc_flags")


def _convert(table: ColumnTable) -> SurveyStars:
    need(table, *_FLAGS)  # without it a limit would pass for a measurement
    ra_deg, dec_deg, _ = place_deg(table)
    wise = {number: _filter(table, number) for number in SATURATED_MAG}
    near_infrared = {
        "J": _near_infrared(table, "Jmag", "j_m_2mass", "e_Jmag", "j_msig_2mass"),
        "H": _near_infrared(table, "Hmag", "h_m_2mass", "e_Hmag", "h_msig_2mass"),
        "Ks": _near_infrared(table, "Kmag", "k_m_2mass", "e_Kmag", "k_msig_2mass"),
    }
    magnitudes = near_infrared | {f"W{number}": found.magnitude for number, found in wise.items()}
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={band: band_flux_jy(band, values) for band, values in magnitudes.items()},
        limit_jy={band: band_flux_jy(band, wise[number].limit_mag) for band, number in (("C", 3), ("E", 4))},
        quality=_quality(magnitudes, wise),
        id=star_names(table, "WISEA ", "AllWISE", "designation"),
        epoch_jyear=EPOCH_JYEAR,
        notes=(
            "apparent motions not used: they contain the parallax",
            *(note for number, found in wise.items() for note in _saturation_note(number, found)),
        ),
    )


@dataclass(frozen=True)
class _Filter:
    """What the survey says of a filter, shape (n,) each."""

    magnitude: Array
    """NaN where it was not measured, or is saturated."""

    limit_mag: Array
    """The star is no brighter; NaN for none."""

    quality: Quality
    saturated: Flags


def _quality(magnitudes: Mapping[str, Array], wise: Mapping[int, _Filter]) -> Quality:
    """That of W3; without it, of a prediction from shorter waves, or else of W4."""
    known = {band: ~np.isnan(real_magnitudes(values)) for band, values in magnitudes.items()}
    shorter = np.any([known[band] for band in ("J", "H", "Ks", "W1", "W2")], axis=0)
    wise_colour = known["W1"] | known["W2"]
    saturated = (magnitudes["Ks"] < SATURATED_K_MAG) & ~wise_colour
    predicted = predicted_quality(shorter, wise_colour | (known["J"] & known["Ks"]), saturated)
    return np.where(known["W3"], wise[3].quality, np.where(shorter, predicted, wise[4].quality))


def _saturation_note(number: int, found: _Filter) -> tuple[str, ...]:
    return count_note(found.saturated, f"with W{number} < {SATURATED_MAG[number]:g} saturated, not used")


def _filter(table: ColumnTable, number: int) -> _Filter:
    """What the table says of a filter, W1 to W4."""
    values = table.number(f"W{number}mag", f"w{number}mpro", unit="mag")
    letter = flag_letters(table, number - 1, *_FLAGS)
    saturated = values < SATURATED_MAG[number]
    star_mag = np.where(np.isin(letter, list(_QUALITY)) & ~saturated, values, np.nan)
    limit_mag = np.where((letter == _LIMIT) & ~saturated, values, np.nan)
    quality = np.select([letter == known for known in _QUALITY], list(_QUALITY.values()), UNKNOWN)
    # Capitals are spurious detections or swamped by an artefact; small letters are slightly affected.
    spoilt = np.char.isupper(flag_letters(table, number - 1, *_ARTEFACTS))
    quality = np.where(spoilt, UNCERTAIN, quality)
    return _Filter(star_mag, limit_mag, np.where(np.isnan(star_mag), UNKNOWN, quality), saturated)


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
