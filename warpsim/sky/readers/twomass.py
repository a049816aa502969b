"""2MASS point sources (II/246): band A from K and J-K."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import FLUX_PREDICTED
from warpsim.sky.colours import colour_temperature_k
from warpsim.sky.readers.angles import place_deg
from warpsim.sky.readers.photometry import (
    FAIR,
    SATURATED_K_MAG,
    UNCERTAIN,
    count_note,
    flag_letters,
    need,
    predicted_flux_a_jy,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 2000.0
"""Observed from June 1997 to February 2001; there are no proper motions."""

_J, _K = ("Jmag", "j_m"), ("Kmag", "k_m")
_FLAGS, _ARTEFACTS = ("Qflg", "ph_qual"), ("Cflg", "cc_flg")
_J_LETTER, _K_LETTER = 0, 2  # places in the flags, which go J, H, K
_NO_MEASUREMENT = ("U", "X")  # an upper limit, a detection without a brightness
_POOR = ("E", "F")


def _convert(table: ColumnTable) -> SurveyStars:
    need(table, *_FLAGS)  # without it a limit would pass for a measurement
    ra_deg, dec_deg, _ = place_deg(table)
    j_mag, poor_j = _filter(table, _J, _J_LETTER)
    k_mag, poor_k = _filter(table, _K, _K_LETTER)
    flux_jy, quality = predicted_flux_a_jy("K", k_mag, j_mag - k_mag)
    uncertain = poor_j | poor_k | (k_mag < SATURATED_K_MAG)
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={"A": flux_jy},
        flux_flag={"A": np.full(len(table), FLUX_PREDICTED)},
        temperature_k=colour_temperature_k(j_mag - k_mag, "J-K"),
        quality=np.where(uncertain & (quality == FAIR), UNCERTAIN, quality),
        id=star_names(table, "2MASS J", "2MASS", "designation"),
        epoch_jyear=EPOCH_JYEAR,
        notes=("A from K and J-K", *count_note(np.isnan(flux_jy), "were not measured in J and K, so have no flux")),
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
