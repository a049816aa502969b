"""Temperature, luminosity class and quality of stars by visible photometry, of Gaia or of Hipparcos; their magnitudes.

The quality says how well the infrared light follows: FAIR stars are within 0.15 mag (one standard deviation; within
0.45 mag in 99 %), UNCERTAIN ones may be off by a magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.arrays import F64
from warpsim.sky.stellar_templates import (
    DWARF,
    GIANT,
    colour,
    colour_temperature_k,
    luminosity_class,
)

UNCERTAIN, FAIR = 1, 2
"""Values of StarCatalog.quality."""

FAIR_BP_RP_MAG = (-0.4, 3.6)
FAIR_GIANT_BP_RP_MAG = 2.3
"""Colours of stars whose infrared light follows from them. Redder giants may be dusty or carbon stars: of bright ones a
fourth is off by more than 0.45 mag."""

SAME_STAR_MAG = 0.2
"""Hp and G of one star differ as its colour tells, within 0.01 mag. Where they do not by as much, one of them has the
light of two stars, or the star varies."""

FAIR_HP_MAG = 4.5
"""Fainter stars that Gaia does not list with a colour are close pairs, or fainter than G = 10."""

SAME_TEMPERATURE = 0.04
"""Largest difference of the temperatures by V-I and by B-V of a star whose colours are trusted, as a ratio minus 1."""

RED_V_I_MAG = 1.3
FAINT_DWARF_HP_MAG = 7.0
"""Dwarfs as red and as faint, at 10 pc, have a V-I that Hipparcos guessed for many; their absolute magnitude tells the
temperature better (the infrared light within 0.18 mag, instead of 0.24)."""

# Main sequence (Mamajek 2022, see catalogs/README.md), brighter by 0.2 mag, which puts the middle of Hipparcos' stars,
# some of them pairs, upon it: Hp at 10 pc [mag] and temperature [K] of M dwarfs.
_DWARF_HP_MAG = (6.89, 7.54, 8.05, 8.67, 9.07, 9.49, 10.04, 10.42, 10.95, 11.85, 12.33, 13.26, 13.80, 14.86, 16.37)
_DWARF_K = (4600, 4300, 4100, 3850, 3770, 3660, 3560, 3470, 3430, 3270, 3210, 3110, 3060, 2930, 2740)

GAIA_ZERO_MAG = {"G": 25.6873668671, "BP": 25.3385422158, "RP": 24.7478955012}
"""Magnitude of one electron per second (Riello et al. 2021, A&A 649, A3; DR3)."""

_HP_MINUS_V_MAG = np.array([-0.03, 0.01, 0.034, 0.081, 0.105, 0.132, 0.143, 0.133, 0.101, 0.084, 0.051, 0.005, -0.086])
_AT_V_MINUS_I_MAG = np.array([-0.25, 0.0, 0.10, 0.30, 0.50, 0.70, 0.90, 1.15, 1.45, 1.80, 2.25, 2.75, 4.0])
_AT_B_MINUS_V_MAG = np.array([-0.22, 0.0, 0.09, 0.29, 0.46, 0.64, 0.86, 1.06, 1.29, 1.43, 1.51, 1.60, 1.81])
"""Medians over 2,300 nearby stars; scatter 0.01 to 0.03 mag, 0.05 beyond V-I = 2.5."""


@dataclass(frozen=True)
class VisibleStars:
    """What visible photometry tells of stars; shape (n,) each."""

    temperature_k: F64
    """Colour temperature [K]; NaN for stars without a colour."""

    luminosity: NDArray[np.int8]
    """DWARF or GIANT."""

    quality: NDArray[np.int64]
    """UNCERTAIN or FAIR."""


def by_gaia(
    g_mag: ArrayLike, bp_rp_mag: ArrayLike, parallax_mas: ArrayLike, pm_mas_yr: ArrayLike, hp_mag: ArrayLike
) -> VisibleStars:
    """Stars with G and BP-RP, and Hp of the same star where it is known; all but G may be NaN."""
    bp_rp = np.asarray(bp_rp_mag, dtype=np.float64)
    luminosity = luminosity_class(g_mag, bp_rp, parallax_mas, pm_mas_yr)
    temperature_k = colour_temperature_k(bp_rp, "BP-RP", luminosity)
    reddest = np.where(luminosity == GIANT, FAIR_GIANT_BP_RP_MAG, FAIR_BP_RP_MAG[1])
    fair = (bp_rp > FAIR_BP_RP_MAG[0]) & (bp_rp < reddest)  # of a NaN, not
    excess = np.asarray(hp_mag) - np.asarray(g_mag) - colour("Hp", "G", luminosity, temperature_k)
    fair &= ~(np.abs(excess) > SAME_STAR_MAG)
    return VisibleStars(temperature_k, luminosity.astype(np.int8), np.where(fair, FAIR, UNCERTAIN))


def by_hipparcos(
    hp_mag: ArrayLike, v_i_mag: ArrayLike, b_v_mag: ArrayLike, parallax_mas: ArrayLike, pm_mas_yr: ArrayLike
) -> VisibleStars:
    """Stars with Hp and V-I, or B-V where V-I is unknown; all but Hp may be NaN."""
    hp, v_i, b_v, parallax = (
        np.asarray(values, dtype=np.float64) for values in (hp_mag, v_i_mag, b_v_mag, parallax_mas)
    )
    luminosity = luminosity_class(hp, np.where(np.isnan(v_i), b_v, v_i), parallax, pm_mas_yr)
    by_v_i = colour_temperature_k(v_i, "V-I", luminosity)
    by_b_v = colour_temperature_k(b_v, "B-V", luminosity)
    temperature_k = np.where(np.isnan(by_v_i), by_b_v, by_v_i)
    fair = np.abs(by_b_v / by_v_i - 1.0) < SAME_TEMPERATURE  # of a NaN, not

    with np.errstate(invalid="ignore", divide="ignore"):
        absolute_mag = hp + 5.0 * np.log10(parallax / 100.0)
        faint = (luminosity == DWARF) & (absolute_mag > FAINT_DWARF_HP_MAG) & (v_i > RED_V_I_MAG)
    temperature_k = np.where(faint, np.interp(absolute_mag, _DWARF_HP_MAG, _DWARF_K), temperature_k)
    reddest_k = colour_temperature_k(FAIR_GIANT_BP_RP_MAG, "BP-RP", GIANT)
    # B-V of cool giants says nothing, so that they cannot be told by two colours.
    cool_giant = (luminosity == GIANT) & (by_v_i < 4000.0) & (by_v_i > reddest_k)
    fair = (fair | cool_giant) & (hp < FAIR_HP_MAG)
    return VisibleStars(temperature_k, luminosity.astype(np.int8), np.where(fair, FAIR, UNCERTAIN))


def gaia_bp_rp_mag(g_mag: F64, bp_rp_mag: F64) -> tuple[F64, F64]:
    """BP and RP from G and BP - RP [mag], shape (n,) each; NaN in, NaN out.

    The photocurrents of BP and RP add up to that of G times an excess that depends on the colour (Riello et al. 2021,
    A&A 649, A3, table 2). For 480,000 stars of G < 10 the median error is below 0.01 mag up to BP - RP = 4, and 0.02
    beyond.
    """
    x = bp_rp_mag
    excess = np.where(
        x < 0.5,
        1.154360 + x * (0.033772 + x * 0.032277),
        np.where(x < 4.0, 1.162004 + x * (0.011464 + x * (0.049255 - x * 0.005879)), 1.057572 + x * 0.140537),
    )
    bp_over_rp = 10.0 ** (-0.4 * (x - GAIA_ZERO_MAG["BP"] + GAIA_ZERO_MAG["RP"]))
    rp_over_g = excess / (1.0 + bp_over_rp)
    rp_mag = g_mag - GAIA_ZERO_MAG["G"] + GAIA_ZERO_MAG["RP"] - 2.5 * np.log10(rp_over_g)
    return rp_mag + x, rp_mag


def hipparcos_v_mag(hp_mag: F64, v_minus_i_mag: F64, b_minus_v_mag: F64) -> F64:
    """V from Hp and V-I, or B-V where V-I is NaN [mag], shape (n,); Hp itself without a colour."""
    by_v_i = np.interp(v_minus_i_mag, _AT_V_MINUS_I_MAG, _HP_MINUS_V_MAG)
    by_b_v = np.interp(b_minus_v_mag, _AT_B_MINUS_V_MAG, _HP_MINUS_V_MAG)
    difference = np.where(np.isnan(v_minus_i_mag), by_b_v, by_v_i)
    return hp_mag - np.where(np.isnan(difference), 0.0, difference)
