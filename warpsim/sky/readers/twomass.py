"""2MASS point sources (II/246): J, H and Ks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.readers.angles import place_deg
from warpsim.sky.readers.photometry import (
    SATURATED_K_MAG,
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

EPOCH_JYEAR = 2000.0
"""Observed from June 1997 to February 2001; there are no proper motions."""

_J, _H, _K = ("Jmag", "j_m"), ("Hmag", "h_m"), ("Kmag", "k_m")
_FLAGS, _ARTEFACTS = ("Qflg", "ph_qual"), ("Cflg", "cc_flg")
_J_LETTER, _H_LETTER, _K_LETTER = 0, 1, 2  # positions in the flags
_NO_MEASUREMENT = ("U", "X")  # an upper limit, a detection without a brightness
_POOR = ("E", "F")


def _convert(table: ColumnTable) -> SurveyStars:
    need(table, *_FLAGS)  # without it a limit would pass for a measurement
    ra_deg, dec_deg, _ = place_deg(table)
    j_mag, poor_j = _filter(table, _J, _J_LETTER)
    k_mag, poor_k = _filter(table, _K, _K_LETTER)
    h_mag, _ = _filter(table, _H, _H_LETTER) if table.find(*_H) else (np.full(len(table), np.nan), poor_k)
    has_j, has_h, has_k = (~np.isnan(real_magnitudes(values)) for values in (j_mag, h_mag, k_mag))
    measured = has_j | has_h | has_k
    doubtful = poor_j | poor_k | (k_mag < SATURATED_K_MAG)
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={band: band_flux_jy(band, values) for band, values in (("J", j_mag), ("H", h_mag), ("Ks", k_mag))},
        quality=predicted_quality(measured, has_j & has_k, doubtful),
        id=star_names(table, "2MASS J", "2MASS", "designation"),
        epoch_jyear=EPOCH_JYEAR,
        notes=(
            *count_note(measured & ~(has_j & has_k), "were not measured in both J and K, so have no colour"),
            *count_note(~measured, "were not measured, so have no flux"),
        ),
    )


def _filter(table: ColumnTable, names: tuple[str, str], place: int) -> tuple[Array, NDArray[np.bool_]]:
    """Magnitude, NaN where it was not measured, and whether it is poor, shape (n,) each."""
    letter = flag_letters(table, place, *_FLAGS)
    artefact = flag_letters(table, place, *_ARTEFACTS)
    star_mag = np.where(np.isin(letter, _NO_MEASUREMENT), np.nan, table.needed(*names, unit="mag"))
    return star_mag, np.isin(letter, _POOR) | ~np.isin(artefact, ("", "0"))


SURVEYS = (
    Survey(
        name="2mass",
        title="2MASS all-sky catalog of point sources",
        reference="II/246 (Cutri et al. 2003)",
        needs=(_J, _K, ("2MASS", *_FLAGS)),
        convert=_convert,
    ),
)
