"""Hipparcos (I/239, ESA 1997) and its new reduction (I/311, van Leeuwen 2007): band A from the visible."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import FLUX_PREDICTED
from warpsim.sky.colours import colour_temperature_k
from warpsim.sky.readers.angles import Pair, angle_deg, epoch_of_place, place_deg
from warpsim.sky.readers.photometry import count_note, predicted_flux_a_jy, star_names
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 1991.25

_PLACES: tuple[Pair, ...] = (
    ("RA_ICRS", "DE_ICRS"),
    ("RAdeg", "DEdeg"),
    ("RArad", "DErad"),
    ("RAhms", "DEdms"),
    ("ra", "dec"),
    ("RAJ2000", "DEJ2000"),
)


def _convert_1997(table: ColumnTable) -> SurveyStars:
    ra_deg, dec_deg, ra_name = place_deg(table, *_PLACES)
    if epoch_of_place(ra_name, EPOCH_JYEAR) == EPOCH_JYEAR:
        # 263 stars without a solution have a rough place only, of the same epoch, in sexagesimal text.
        unsolved = np.isnan(ra_deg)
        ra_deg = np.where(unsolved, angle_deg(table, "RAhms", hours=True), ra_deg)
        dec_deg = np.where(unsolved, angle_deg(table, "DEdms"), dec_deg)
    v_mag = table.number("Vmag", unit="mag")
    return _stars(table, (ra_deg, dec_deg, ra_name), v_mag, table.number("B-V", unit="mag"), _v_minus_i(table))


def _convert_2007(table: ColumnTable) -> SurveyStars:
    place = place_deg(table, *_PLACES, radians=_in_radians(table))
    b_minus_v = table.number("B-V", unit="mag", null=(0.0,))
    # V is not in the table; Hp stands for it beside B-V (they differ by less than 0.2 mag).
    return _stars(table, place, table.number("Hpmag", unit="mag"), b_minus_v, _v_minus_i(table, null=(0.0,)))


def _stars(
    table: ColumnTable, place: tuple[Array, Array, str], v_mag: Array, b_minus_v: Array, v_minus_i: Array
) -> SurveyStars:
    ra_deg, dec_deg, ra_name = place
    flux_jy, quality = predicted_flux_a_jy("Hp", table.number("Hpmag", unit="mag"), v_minus_i)
    flux_b_v_jy, quality_b_v = predicted_flux_a_jy("V", v_mag, b_minus_v)
    use_b_v = np.isnan(flux_jy)
    flux_jy, quality = np.where(use_b_v, flux_b_v_jy, flux_jy), np.where(use_b_v, quality_b_v, quality)
    temperature_k = colour_temperature_k(v_minus_i, "V-I")
    temperature_k = np.where(np.isnan(temperature_k), colour_temperature_k(b_minus_v, "B-V"), temperature_k)
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={"A": flux_jy},
        flux_flag={"A": np.full(len(table), FLUX_PREDICTED)},
        pm_ra_mas_yr=table.number("pmRA", unit="mas / yr"),
        pm_dec_mas_yr=table.number("pmDE", unit="mas / yr"),
        parallax_mas=table.number("Plx", unit="mas"),
        temperature_k=temperature_k,
        quality=quality,
        id=star_names(table, "HIP ", "HIP"),
        epoch_jyear=epoch_of_place(ra_name, EPOCH_JYEAR),
        notes=(
            "A from Hp and V-I",
            *count_note(use_b_v & ~np.isnan(flux_jy), "have no V-I: A from B-V"),
            *count_note(np.isnan(flux_jy), "have no colour, so no flux"),
        ),
    )


def _v_minus_i(table: ColumnTable, null: tuple[float, ...] = ()) -> Array:
    return table.number("V-I", unit="mag", null=null)


def _in_radians(table: ColumnTable) -> bool:
    """Whether RArad and DErad are in radians: VizieR exports degrees under these names, and CSV loses the unit."""
    return not (
        np.any(np.abs(table.number("DErad")) > math.pi / 2.0) or np.any(np.abs(table.number("RArad")) > 2.0 * math.pi)
    )


SURVEYS = (
    Survey(
        name="hipparcos",
        title="Hipparcos catalogue",
        reference="I/239 (ESA 1997, SP-1200)",
        needs=(("HIP",), ("Hpmag",), ("Vmag",)),
        convert=_convert_1997,
    ),
    Survey(
        name="hipparcos-2",
        title="Hipparcos, the new reduction",
        reference="I/311 (van Leeuwen 2007, A&A 474, 653)",
        needs=(("HIP",), ("Hpmag",), ("RArad", "e_RArad", "Sn")),
        convert=_convert_2007,
    ),
)
