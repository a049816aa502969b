"""AKARI/IRC all-sky survey (II/297): 9 and 18 um, bands S9W and L18W."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.readers.angles import place_deg
from warpsim.sky.readers.photometry import (
    UNCERTAIN,
    UNKNOWN,
    Quality,
    band_flux_jy,
    count_note,
    magnitude,
    measured_quality,
    positive,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 2007.0
"""Middle of the survey, May 2006 to August 2007."""

ZERO_MAG_JY = {"09": 56.26, "18": 12.0}
"""Flux density of magnitude 0, as the catalog quotes fluxes (Tanabe et al. 2008, PASJ 60, S375)."""

OFFSET_18_MAG = 0.05
"""Stars without dust have [9] - [18] = 0.05, whatever their type: an offset of the calibration, taken from [18]."""

_VALID = 3.0  # q_S09, q_S18
_NULLS = (-999.9, float(np.float32(-999.9)))
_EDGE_BIT = 8
_EDGE_LETTERS = tuple("89abcdef")  # hexadecimal digits with that bit: measured at the image's edge, flux too low


def _convert(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, _ = place_deg(table)
    mag_9, quality_9 = _filter(table, "09")
    mag_18, quality_18 = _filter(table, "18")
    mag_18 = mag_18 + OFFSET_18_MAG
    doubtful = count_note(np.isnan(mag_9) & np.isnan(mag_18), "have no flux of quality 3, so no flux")
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={"S9W": band_flux_jy("S9W", mag_9), "L18W": band_flux_jy("L18W", mag_18)},
        quality=np.where(quality_9 == UNKNOWN, quality_18, quality_9),
        id=star_names(table, "AKARI-IRC-V1 J", "objName"),
        epoch_jyear=EPOCH_JYEAR,
        notes=(f"{OFFSET_18_MAG} mag added to [18]: calibration offset", *doubtful),
    )


def _filter(table: ColumnTable, um: str) -> tuple[Array, Quality]:
    """Magnitude in a filter, NaN where it was not measured, and its quality, shape (n,) each."""
    names = (f"S{um}", f"flux{um}")
    flux_jy = table.number(*names, unit="Jy", null=_NULLS)
    valid_names = (f"q_S{um}", f"fqual{um}")
    valid = table.needed(*valid_names) if table.find(*names) else table.number(*valid_names)
    star_mag = np.where(valid == _VALID, magnitude(flux_jy, ZERO_MAG_JY[um]), np.nan)
    error_jy = table.number(f"e_S{um}", f"ferr{um}", unit="Jy")
    quality = measured_quality(positive(error_jy) / positive(flux_jy))
    quality = np.where(np.isin(np.char.lower(table.text(f"f{um}", f"flags{um}")), _EDGE_LETTERS), UNCERTAIN, quality)
    return star_mag, np.where(np.isnan(star_mag), UNKNOWN, quality)


SURVEYS = (
    Survey(
        name="akari-irc",
        title="AKARI/IRC all-sky survey point source catalogue",
        reference="II/297 (Ishihara et al. 2010, A&A 514, A1)",
        needs=(("S09", "flux09"), ("q_S09", "fqual09")),
        convert=_convert,
    ),
)
