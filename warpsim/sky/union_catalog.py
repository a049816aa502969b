"""The union of Hipparcos-2 and Gaia DR3 to G = 10: every star the default catalog was cut from, in full precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import FLUX_NONE, FLUX_PREDICTED, J2000_JYEAR
from warpsim.sky.colours import RELATIONS, colour_class, colour_temperature_k, flux_from_magnitude_a
from warpsim.sky.hip_gaia import HIPPARCOS_EPOCH_JYEAR, Hipparcos, match, read_gaia, read_hipparcos
from warpsim.sky.space_motion import rigorous_motion
from warpsim.sky.star_columns import StarColumns

Array = NDArray[np.float64]

GAIA_BRIGHT_LIMIT_MAG = 3.5
"""Gaia saturates: stars as bright as this in G take their magnitude from Hipparcos."""

_UNKNOWN, _UNCERTAIN, _FAIR = 0, 1, 2  # values of StarCatalog.quality

_NAME = "hip-gaia-ir union"
_PROVENANCE = (
    "hip-gaia-ir union: 8.3 um magnitudes predicted from Gaia DR3 (G, BP-RP) and Hipparcos-2 (Hp, V-I), other bands "
    "from the colour. Gaia-derived data: CC BY-SA 3.0 IGO, ESA/Gaia/DPAC; Hipparcos: ESA 1997, van Leeuwen 2007."
)


@dataclass(frozen=True)
class UnionStars:
    """Stars of both catalogs at J2000, one row each, sorted by declination; shape (n,) each."""

    hip: NDArray[np.int64]
    """Hipparcos number; 0 for none."""

    source_id: NDArray[np.int64]
    """Gaia DR3 source that gives the magnitude; 0 where Hipparcos does."""

    ra_deg: Array
    """ICRS: by Hipparcos astrometry if there is any, or else where Gaia saw the star in 2016."""

    dec_deg: Array
    pm_ra_mas_yr: Array
    """cos(dec) included; 0 without Hipparcos astrometry."""

    pm_dec_mas_yr: Array
    parallax_mas: Array
    """NaN without Hipparcos astrometry."""

    magnitude_a: Array
    """Predicted [A]; NaN for stars without a colour."""

    temperature_k: Array
    """Colour temperature [K]; NaN for stars without a colour."""

    clipped: NDArray[np.bool_]
    """Whether the colour lies outside the range of its relation."""

    disputed: NDArray[np.bool_]
    """Whether Gaia's star at this place was taken for a companion, and none for the star itself."""


def union_stars() -> UnionStars:
    """Join the two catalogs.

    Gaia gives the magnitude of a star where it has a colour and is fainter than GAIA_BRIGHT_LIMIT_MAG; Hipparcos that
    of all other stars it has. Gaia stars that are neither in Hipparcos nor have a colour stay, with a place only; the
    brighter ones among them do not, since Hipparcos has their light in that of the star beside them.

    Raises:
        InputError: The packages of the extra `catalogs` are not installed, or not of the version known.
    """
    star, gaia = read_hipparcos(), read_gaia()
    partner, disputed = match(star, gaia)

    faint, has_colour = gaia.g_mag > GAIA_BRIGHT_LIMIT_MAG, ~np.isnan(gaia.bp_rp_mag)
    gaia_row = np.flatnonzero(faint & (has_colour | (partner < 0)))
    represented = np.zeros(len(star.hip), dtype=bool)
    represented[partner[gaia_row][partner[gaia_row] >= 0]] = True
    star_only = np.flatnonzero(~represented)
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

    gaia_mag_a, gaia_clipped = RELATIONS["G"].magnitude_a(gaia.g_mag[gaia_row], gaia.bp_rp_mag[gaia_row])
    gaia_temperature_k = colour_temperature_k(gaia.bp_rp_mag[gaia_row], "BP-RP")
    star_mag_a, star_temperature_k, star_clipped = hipparcos_magnitude_a(star)
    magnitude_a = of_gaia_first(gaia_mag_a, star_mag_a)
    columns = {
        "hip": np.where(has_star, star.hip[of_star], 0),
        "source_id": np.concatenate([gaia.source_id[gaia_row], np.zeros(len(star_only), dtype=np.int64)]),
        "ra_deg": np.where(has_star, star_ra_deg[of_star], of_gaia_first(gaia.ra_deg[gaia_row], star_ra_deg)),
        "dec_deg": np.where(has_star, star_dec_deg[of_star], of_gaia_first(gaia.dec_deg[gaia_row], star_dec_deg)),
        "pm_ra_mas_yr": of_hipparcos(star_pm_ra, 0.0),
        "pm_dec_mas_yr": of_hipparcos(star_pm_dec, 0.0),
        "parallax_mas": of_hipparcos(star.parallax_mas, np.nan),
        "magnitude_a": magnitude_a,
        "temperature_k": of_gaia_first(gaia_temperature_k, star_temperature_k),
        "clipped": np.concatenate([gaia_clipped, star_clipped[star_only]]) & ~np.isnan(magnitude_a),
        "disputed": np.concatenate([np.zeros(len(gaia_row), dtype=bool), disputed[star_only]]),
    }
    order = np.lexsort((columns["ra_deg"], columns["dec_deg"]))
    return UnionStars(**{key: values[order] for key, values in columns.items()})


def hipparcos_magnitude_a(star: Hipparcos) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Predict [A] and colour temperature [K] from Hp and V-I, or from B-V where V-I is missing; tell clipped colours.

    V is not in Hipparcos-2: with B-V, Hp stands for it (they differ by less than 0.2 mag).
    """
    has_v_i = ~np.isnan(star.v_i_mag)
    by_v_i, clipped_v_i = RELATIONS["Hp"].magnitude_a(star.hp_mag, star.v_i_mag)
    by_b_v, clipped_b_v = RELATIONS["V"].magnitude_a(star.hp_mag, star.b_v_mag)
    temperature_k = np.where(
        has_v_i, colour_temperature_k(star.v_i_mag, "V-I"), colour_temperature_k(star.b_v_mag, "B-V")
    )
    return np.where(has_v_i, by_v_i, by_b_v), temperature_k, np.where(has_v_i, clipped_v_i, clipped_b_v)


def union_columns() -> StarColumns:
    """Return the columns of the union as a catalog.

    Raises:
        InputError: The packages of the extra `catalogs` are not installed, or not of the version known.
    """
    stars = union_stars()
    known = ~np.isnan(stars.magnitude_a)
    flux_jy = flux_from_magnitude_a(stars.magnitude_a, colour_class(stars.temperature_k))
    flag = np.where(known, FLUX_PREDICTED, FLUX_NONE).astype(np.uint8)
    fair = np.where(stars.clipped | stars.disputed, _UNCERTAIN, _FAIR)
    names = [
        f"HIP {hip}" if hip else f"Gaia DR3 {source}"
        for hip, source in zip(stars.hip.tolist(), stars.source_id.tolist(), strict=True)
    ]
    return StarColumns(
        ra_deg=stars.ra_deg,
        dec_deg=stars.dec_deg,
        pm_ra_mas_yr=stars.pm_ra_mas_yr,
        pm_dec_mas_yr=stars.pm_dec_mas_yr,
        parallax_mas=stars.parallax_mas,
        temperature_k=stars.temperature_k,
        luminosity=np.full(len(known), -1, dtype=np.int8),
        quality=np.where(known, fair, _UNKNOWN),
        epoch_jyear=J2000_JYEAR,
        name=_NAME,
        provenance=_PROVENANCE,
        flux_jy=flux_jy,
        flux_flag=dict.fromkeys(flux_jy, flag),
        id=np.array(names, dtype=np.str_),
    )
