"""AKARI/IRC all-sky survey (II/297): 9 and 18 um, bands S9W and L18W."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.readers.angles import place_deg
from warpsim.sky.readers.photometry import (
    UNCERTAIN,
    UNKNOWN,
    Quality,
    count_note,
    measured_quality,
    positive,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 2007.0
"""Middle of the survey, May 2006 to August 2007."""

_VALID = 3.0  # q_S09, q_S18
_NULLS = (-999.9, float(np.float32(-999.9)))
_EDGE_BIT = 8
_EDGE_LETTERS = tuple("89abcdef")  # hexadecimal digits with that bit: measured at the image's edge, flux too low


def _convert(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, _ = place_deg(table)
    flux_9_jy, quality_9 = _filter(table, "09")
    flux_18_jy, quality_18 = _filter(table, "18")
    no_flux = np.isnan(flux_9_jy) & np.isnan(flux_18_jy)
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={"S9W": flux_9_jy, "L18W": flux_18_jy},
        quality=np.where(quality_9 == UNKNOWN, quality_18, quality_9),
        id=star_names(table, "AKARI-IRC-V1 J", "objName"),
        epoch_jyear=EPOCH_JYEAR,
        notes=count_note(no_flux, "have no flux of quality 3, so no flux"),
    )


def _filter(table: ColumnTable, um: str) -> tuple[Array, Quality]:
    """Flux density in a filter [Jy], NaN where it was not measured, and its quality, shape (n,) each."""
    names = (f"S{um}", f"flux{um}")
    flux_jy = positive(table.number(*names, unit="Jy", null=_NULLS))
    valid_names = (f"q_S{um}", f"fqual{um}")
    valid = table.needed(*valid_names) if table.find(*names) else table.number(*valid_names)
    flux_jy = np.where(valid == _VALID, flux_jy, np.nan)
    error_jy = table.number(f"e_S{um}", f"ferr{um}", unit="Jy")
    quality = measured_quality(positive(error_jy) / flux_jy)
    quality = np.where(np.isin(np.char.lower(table.text(f"f{um}", f"flags{um}")), _EDGE_LETTERS), UNCERTAIN, quality)
    return flux_jy, np.where(np.isnan(flux_jy), UNKNOWN, quality)


SURVEYS = (
    Survey(
        name="akari-irc",
        title="AKARI/IRC all-sky survey point source catalogue",
        reference="II/297 (Ishihara et al. 2010, A&A 514, A1)",
        needs=(("S09", "flux09"), ("q_S09", "fqual09")),
        convert=_convert,
    ),
)
