"""Hipparcos (I/239, ESA 1997) and its new reduction (I/311, van Leeuwen 2007): Hp, V, and B and Ic by the colours."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.readers.angles import Pair, angle_deg, epoch_of_place, place_deg
from warpsim.sky.readers.photometry import (
    band_flux_jy,
    count_note,
    predicted_quality,
    real_colours,
    real_magnitudes,
    star_names,
)
from warpsim.sky.readers.survey import Survey, SurveyStars
from warpsim.sky.stellar_templates import GIANT, colour, colour_temperature_k
from warpsim.sky.visible_photometry import hipparcos_v_mag
from warpsim.sky.visible_stars import SAME_TEMPERATURE, by_hipparcos
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]

EPOCH_JYEAR = 1991.25

COOL_GIANT_K = 4000.0
REDDEST_B_MINUS_V_MAG = 1.45
"""Beyond, B-V says nothing of a star's temperature."""

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
    v_minus_i = _v_minus_i(table, null=(0.0,))
    v_mag = hipparcos_v_mag(table.number("Hpmag", unit="mag"), v_minus_i, b_minus_v)  # V is not in the table
    return _stars(table, place, v_mag, b_minus_v, v_minus_i)


def _stars(
    table: ColumnTable, place: tuple[Array, Array, str], v_mag: Array, b_minus_v: Array, v_minus_i: Array
) -> SurveyStars:
    ra_deg, dec_deg, ra_name = place
    b_minus_v, v_minus_i = real_colours(b_minus_v), real_colours(v_minus_i)
    hp_mag = real_magnitudes(table.number("Hpmag", unit="mag"))
    parallax_mas, motion = table.number("Plx", unit="mas"), _motion(table)
    seen = by_hipparcos(hp_mag, v_minus_i, b_minus_v, parallax_mas, np.hypot(*motion))
    by_v_i = colour_temperature_k(v_minus_i, "V-I", seen.luminosity)
    by_b_v = colour_temperature_k(b_minus_v, "B-V", seen.luminosity)
    guessed = (seen.temperature_k != by_v_i) & ~np.isnan(by_v_i)  # V-I of faint red dwarfs
    magnitudes = {
        "Hp": hp_mag,
        "V": real_magnitudes(v_mag),
        "B": v_mag + b_minus_v,
        # V-I as listed is bluer than V-Ic by 0.03 to 0.1 mag, of M giants more: the template that has it on average
        # tells V-Ic.
        "Ic": np.where(guessed, np.nan, v_mag - _v_minus_ic(by_v_i, seen.luminosity)),
    }
    has_b_v, has_v_i = ~np.isnan(b_minus_v), ~np.isnan(v_minus_i)
    has_flux = np.any(~np.isnan(list(magnitudes.values())), axis=0)
    # B-V of cool giants says nothing.
    differ = (np.abs(by_b_v / by_v_i - 1.0) > SAME_TEMPERATURE) & ~(
        (seen.luminosity == GIANT) & (by_v_i < COOL_GIANT_K)
    )
    doubtful = guessed | differ | (~has_v_i & (b_minus_v > REDDEST_B_MINUS_V_MAG))
    return SurveyStars(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        flux_jy={band: band_flux_jy(band, values) for band, values in magnitudes.items()},
        pm_ra_mas_yr=motion[0],
        pm_dec_mas_yr=motion[1],
        parallax_mas=parallax_mas,
        temperature_k=seen.temperature_k,
        luminosity=seen.luminosity,
        quality=predicted_quality(has_flux, has_b_v | has_v_i, doubtful),
        id=star_names(table, "HIP ", "HIP"),
        epoch_jyear=epoch_of_place(ra_name, EPOCH_JYEAR),
        notes=(
            *count_note(guessed, "have a guessed V-I: temperature from the absolute magnitude"),
            *count_note(has_flux & has_b_v & ~has_v_i, "have B-V as their only colour"),
            *count_note(has_flux & ~has_b_v & ~has_v_i, "have no colour"),
            *count_note(~has_flux, "have no magnitude, so no flux"),
        ),
    )


def _v_minus_ic(temperature_k: Array, luminosity: NDArray[np.int8]) -> Array:
    """V-Ic of the templates [mag]; NaN in, NaN out."""
    return np.where(np.isnan(temperature_k), np.nan, colour("V", "Ic", luminosity, temperature_k))


def _motion(table: ColumnTable) -> tuple[Array, Array]:
    """Proper motions [mas/yr], in right ascension with cos(dec)."""
    return table.number("pmRA", unit="mas / yr"), table.number("pmDE", unit="mas / yr")


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
