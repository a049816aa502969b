"""Surveys of magnitudes from 1.2 to 22 um: AllWISE, where it is not saturated, and 2MASS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.readers.survey import (
    EXCELLENT,
    FAIR,
    GOOD,
    SATURATED_K_MAG,
    UNCERTAIN,
    UNKNOWN,
    Flags,
    Quality,
    Survey,
    band_flux_jy,
    count_note,
    flag_letters,
    predicted_quality,
    real_magnitudes,
)
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

SATURATED_MAG = {1: 8.0, 2: 7.0, 3: 1.0, 4: -0.4}
"""Magnitudes from which W1 to W4 are used. Stars saturate from there in W1, W2 and W4, and from 3.8 in W3 (WISE All-Sky
Explanatory Supplement, VI.3.d), whose wings are fitted well enough for 0.05 mag up to magnitude 1: three times better
than what shorter waves tell."""

_QUALITY = {"A": EXCELLENT, "B": GOOD, "C": FAIR}
"""By the letter of ph_qual: signal to noise of 10, 3 and 2. U is an upper limit; X and Z are no measurements."""

_LIMIT = "U"
_WISE_FLAGS, _WISE_ARTEFACTS = ("qph", "ph_qual"), ("ccf", "cc_flags")


class _Filter(NamedTuple):
    """What AllWISE says of a filter, shape (n,) each."""

    magnitude: Array
    """NaN where it was not measured, or is saturated."""

    limit_mag: Array
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


def _allwise_quality(magnitudes: Mapping[str, Array], wise: Mapping[int, _Filter]) -> Quality:
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
    limit_mag = np.where((letter == _LIMIT) & ~saturated, values, np.nan)
    quality = np.select([letter == known for known in _QUALITY], list(_QUALITY.values()), UNKNOWN)
    # Capitals are spurious detections or swamped by an artefact; small letters are slightly affected.
    quality = np.where(np.char.isupper(flag_letters(table, number - 1, *_WISE_ARTEFACTS)), UNCERTAIN, quality)
    return _Filter(star_mag, limit_mag, np.where(np.isnan(star_mag), UNKNOWN, quality), saturated)


def _near_infrared(table: ColumnTable, vizier: str, irsa: str, vizier_error: str, irsa_error: str) -> Array:
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


def _twomass_filter(table: ColumnTable, names: tuple[str, str], position: int) -> tuple[Array, Flags]:
    """Magnitude, NaN where it was not measured, and whether it is poor, shape (n,) each."""
    letter = flag_letters(table, position, *_FLAGS)
    artefact = flag_letters(table, position, *_ARTEFACTS)
    star_mag = np.where(np.isin(letter, _NO_MEASUREMENT), np.nan, table.needed(*names, unit="mag"))
    return star_mag, np.isin(letter, _POOR) | ~np.isin(artefact, ("", "0"))


SURVEYS = (
    Survey(
        name="allwise",
        title="AllWISE source catalog",
        reference="II/328 (Cutri et al. 2013)",
        needs=(("W3mag", "w3mpro"), _WISE_FLAGS),
        light=_allwise,
        epoch_jyear=2010.5,
        id_columns=("AllWISE", "designation"),
        id_prefix="WISEA ",
        telling=("W3mag", "w3mpro"),
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
