"""The union of Hipparcos-2 and Gaia DR3 to G = 10: every star the default catalog was cut from, in full precision."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import J2000_JYEAR
from warpsim.sky.hip_gaia import (
    GAIA_EPOCH_JYEAR,
    HIPPARCOS_EPOCH_JYEAR,
    Gaia,
    Hipparcos,
    close_pairs,
    match,
    read_gaia,
    read_hipparcos,
)
from warpsim.sky.hip_gaia_stars import HipGaiaStars
from warpsim.sky.space_motion import rigorous_motion
from warpsim.sky.spectral_types import of_spectral_types
from warpsim.sky.star_columns import StarColumns
from warpsim.sky.stellar_templates import GIANT
from warpsim.sky.visible_stars import UNCERTAIN, VisibleStars, by_gaia, by_hipparcos

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

GAIA_BRIGHT_LIMIT_MAG = 4.0
GAIA_RED_BRIGHT_LIMIT_MAG = 3.2
GAIA_RED_BP_RP_MAG = 1.6
"""Gaia saturates: stars as bright as these in G take their magnitude and colour from Hipparcos, whose V-I of red giants
is the worse, so that those change over later."""

COMPOSITE_TYPE = {84345: "M5Ib-II"}
"""Spectral type by Hipparcos number of alpha Herculis: its V-I of 1.13 is no M5 star's, but one of the sum with its
companions (G8III and A9IV), which makes it 3.4 mag too faint in the infrared."""

BESIDE_ARCSEC = 3.0
"""Hipparcos measured the light of closer pairs as that of one star."""

_NAME = "hip-gaia-ir union"


@dataclass(frozen=True)
class UnionStars(HipGaiaStars):
    """Stars of both catalogs."""

    source_id: NDArray[np.int64]
    """Gaia DR3 source that gives the magnitude; 0 where Hipparcos does."""

    bp_rp_mag: Array
    """BP-RP, where Gaia gives the magnitude; elsewhere, and for stars without a colour, NaN."""


def union_stars() -> UnionStars:
    """Join the two catalogs.

    Gaia gives the magnitude of a star where it has a colour and is fainter than GAIA_BRIGHT_LIMIT_MAG; Hipparcos that
    of all other stars it has. Gaia stars that are neither in Hipparcos nor have a colour stay; those as bright as the
    limit, or within BESIDE_ARCSEC of a star that Hipparcos gives, do not: Hipparcos has their light in that star's.

    Raises:
        InputError: The packages of the extra `catalogs` are not installed, or not of the version known.
    """
    star, gaia = read_hipparcos(), read_gaia()
    partner, disputed = match(star, gaia)

    red, has_colour = gaia.bp_rp_mag > GAIA_RED_BP_RP_MAG, ~np.isnan(gaia.bp_rp_mag)
    faint = gaia.g_mag > np.where(red, GAIA_RED_BRIGHT_LIMIT_MAG, GAIA_BRIGHT_LIMIT_MAG)
    gaia_row = np.flatnonzero(faint & (has_colour | (partner < 0)))
    represented = np.zeros(len(star.hip), dtype=bool)
    represented[partner[gaia_row][partner[gaia_row] >= 0]] = True
    star_only = np.flatnonzero(~represented)
    gaia_row = gaia_row[~_beside(star, star_only, gaia, gaia_row)]
    of_star = np.concatenate([partner[gaia_row], star_only])
    has_star = of_star >= 0

    years = J2000_JYEAR - HIPPARCOS_EPOCH_JYEAR
    motion = rigorous_motion(star.ra_deg, star.dec_deg, star.pm_ra_mas_yr, star.pm_dec_mas_yr, years)
    star_ra_deg, star_dec_deg, star_pm_ra, star_pm_dec, _ = motion  # distances change by less than 1e-7

    def of_hipparcos(values: Array, otherwise: float) -> Array:
        """Spread values of the Hipparcos stars over the rows of the union."""
        return np.where(has_star, values[of_star], otherwise)

    def of_gaia_first(gaia_values: Array, star_values: Array) -> Array:
        return np.concatenate([gaia_values, star_values[star_only]])

    n_gaia, n_star = len(gaia_row), len(star_only)
    seen = by_gaia(
        g_mag=gaia.g_mag[gaia_row],
        bp_rp_mag=gaia.bp_rp_mag[gaia_row],
        parallax_mas=of_hipparcos(star.parallax_mas, np.nan)[:n_gaia],
        pm_mas_yr=of_hipparcos(np.hypot(star.pm_ra_mas_yr, star.pm_dec_mas_yr), np.nan)[:n_gaia],
        hp_mag=of_hipparcos(star.hp_mag, np.nan)[:n_gaia],
    )
    others = _by_hipparcos(star, star_only, disputed)
    columns = {
        "hip": np.where(has_star, star.hip[of_star], 0),
        "source_id": np.concatenate([gaia.source_id[gaia_row], np.zeros(len(star_only), dtype=np.int64)]),
        "ra_deg": np.where(has_star, star_ra_deg[of_star], of_gaia_first(gaia.ra_deg[gaia_row], star_ra_deg)),
        "dec_deg": np.where(has_star, star_dec_deg[of_star], of_gaia_first(gaia.dec_deg[gaia_row], star_dec_deg)),
        "pm_ra_mas_yr": of_hipparcos(star_pm_ra, 0.0),
        "pm_dec_mas_yr": of_hipparcos(star_pm_dec, 0.0),
        "parallax_mas": of_hipparcos(star.parallax_mas, np.nan),
        "g_mag": np.concatenate([gaia.g_mag[gaia_row], np.full(n_star, np.nan)]),
        "hp_mag": np.concatenate([np.full(n_gaia, np.nan), star.hp_mag[star_only]]),
        "bp_rp_mag": np.concatenate([gaia.bp_rp_mag[gaia_row], np.full(n_star, np.nan)]),
        "temperature_k": np.concatenate([seen.temperature_k, others.temperature_k]),
        "luminosity": np.concatenate([seen.luminosity, others.luminosity]),
        "quality": np.concatenate([seen.quality, others.quality]),
    }
    order = np.lexsort((columns["ra_deg"], columns["dec_deg"]))
    return UnionStars(**{key: values[order] for key, values in columns.items()})


def _by_hipparcos(star: Hipparcos, rows: Rows, disputed: NDArray[np.bool_]) -> VisibleStars:
    """Return what Hipparcos has of the stars in some rows."""
    seen = by_hipparcos(
        hp_mag=star.hp_mag[rows],
        v_i_mag=star.v_i_mag[rows],
        b_v_mag=star.b_v_mag[rows],
        parallax_mas=star.parallax_mas[rows],
        pm_mas_yr=np.hypot(star.pm_ra_mas_yr[rows], star.pm_dec_mas_yr[rows]),
    )
    for number, kind in COMPOSITE_TYPE.items():
        composite = star.hip[rows] == number
        type_k, seen.luminosity[composite] = of_spectral_types(np.array([kind]))
        seen.temperature_k[composite] = type_k[:, GIANT]
    composite = np.isin(star.hip[rows], list(COMPOSITE_TYPE))
    return replace(seen, quality=np.where(disputed[rows] | composite, UNCERTAIN, seen.quality))


def _beside(star: Hipparcos, star_row: Rows, gaia: Gaia, gaia_row: Rows) -> NDArray[np.bool_]:
    """Whether each of the given Gaia stars lies beside one of the given Hipparcos stars when Gaia saw it."""
    at, years = star_row, GAIA_EPOCH_JYEAR - HIPPARCOS_EPOCH_JYEAR
    motion = rigorous_motion(star.ra_deg[at], star.dec_deg[at], star.pm_ra_mas_yr[at], star.pm_dec_mas_yr[at], years)
    ra_deg, dec_deg, *_ = motion
    _, near, arcsec = close_pairs(ra_deg, dec_deg, gaia.ra_deg[gaia_row], gaia.dec_deg[gaia_row])
    beside = np.zeros(len(gaia_row), dtype=bool)
    beside[near[arcsec < BESIDE_ARCSEC]] = True
    return beside


def union_columns() -> StarColumns:
    """Return the columns of the union as a catalog.

    Raises:
        InputError: The packages of the extra `catalogs` are not installed, or not of the version known.
    """
    stars = union_stars()
    names = [
        f"HIP {hip}" if hip else f"Gaia DR3 {source}"
        for hip, source in zip(stars.hip.tolist(), stars.source_id.tolist(), strict=True)
    ]
    return stars.columns(_NAME, np.array(names, dtype=np.str_))
