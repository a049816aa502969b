"""The catalog that ships with warpsim, unpacked from `hip_gaia_ir_v2.npz`.

The file holds magnitude, colour and flags of every star, and astrometry for those of Hipparcos; catalogs/README.md
describes its columns and how it was made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from warpsim_catalogs import path

from warpsim.sky.catalog_columns import J2000_JYEAR
from warpsim.sky.star_columns import StarColumns
from warpsim.sky.stellar_templates import DWARF, GIANT, colour_temperature_k
from warpsim.sky.visible_stars import FAIR, UNCERTAIN, measured_flux_jy

Array = NDArray[np.float64]

FILE = "hip_gaia_ir_v2.npz"

HIPPARCOS_FLAG, HP_FLAG, GIANT_FLAG, FAIR_FLAG, INFRARED_FLAG, HIGH_HIP_FLAG = (1 << bit for bit in range(6))
"""Bits of the column `flags`: Hipparcos astrometry; the magnitude is Hp, not G; giant; fair; one of the brightest at
8.3 um; the Hipparcos number is HIGH_HIP or more."""

HIGH_HIP = 1 << 16
NO_COLOUR = -(1 << 15)
"""Value of the column `bp_rp_mmag` for a star without a colour."""

_NAME = "hip-gaia-ir v2"
_PROVENANCE = (
    "hip-gaia-ir v2: G and BP-RP of Gaia DR3, Hp and V-I of Hipparcos-2, infrared fluxes predicted from them by "
    "stellar templates. Gaia-derived data: CC BY-SA 3.0 IGO, ESA/Gaia/DPAC; Hipparcos: ESA 1997, van Leeuwen 2007."
)


@dataclass(frozen=True)
class DefaultStars:
    """The shipped stars at J2000, sorted by declination; shape (n,) each."""

    hip: NDArray[np.int64]
    """Hipparcos number; 0 for none."""

    ra_deg: Array
    dec_deg: Array
    pm_ra_mas_yr: Array
    """cos(dec) included; 0 without Hipparcos astrometry, like pm_dec_mas_yr."""

    pm_dec_mas_yr: Array
    parallax_mas: Array
    """NaN without Hipparcos astrometry."""

    g_mag: Array
    """G, where Gaia gives the magnitude; NaN elsewhere."""

    hp_mag: Array
    """Hp, where Hipparcos does; NaN elsewhere."""

    temperature_k: Array
    """Colour temperature [K]; NaN for stars without a colour."""

    luminosity: NDArray[np.int8]
    """Luminosity class: 0 dwarf, 1 giant."""

    quality: NDArray[np.int64]
    """Of the infrared light: 1 uncertain, 2 fair."""

    infrared: NDArray[np.bool_]
    """Whether the star is one of the 177,860 brightest at 8.3 um."""


def default_stars() -> DefaultStars:
    """Read the shipped stars: the brightest at 8.3 um, and all others brighter than G = 9."""
    with path(FILE).open("rb") as stream, np.load(stream, allow_pickle=False) as columns:
        return unpacked({key: columns[key] for key in columns.files})


def unpacked(packed: Mapping[str, NDArray[Any]]) -> DefaultStars:
    """Return the stars of the columns of the shipped file."""
    flags = packed["flags"].astype(np.int64)
    has_hip, by_hp = (flags & HIPPARCOS_FLAG) != 0, (flags & HP_FLAG) != 0

    def from_hip_rows(key: str, fill: float, scale: float) -> Array:
        """Spread a column of the Hipparcos stars over all rows."""
        values = np.full(len(flags), fill)
        values[has_hip] = packed[key] * scale
        return values

    magnitude = packed["mag_mmag"] * 1e-3
    luminosity = np.where(flags & GIANT_FLAG, GIANT, DWARF)
    bp_rp_mag = np.where(packed["bp_rp_mmag"] == NO_COLOUR, np.nan, packed["bp_rp_mmag"] * 1e-3)
    high_hip = np.where(flags & HIGH_HIP_FLAG, HIGH_HIP, 0)
    return DefaultStars(
        hip=from_hip_rows("hip", 0.0, 1.0).astype(np.int64) + high_hip,
        ra_deg=packed["ra_mas"] / 3.6e6,
        dec_deg=packed["dec_mas"] / 3.6e6,
        pm_ra_mas_yr=from_hip_rows("hip_pm_ra_mas_yr", 0.0, 1.0),
        pm_dec_mas_yr=from_hip_rows("hip_pm_dec_mas_yr", 0.0, 1.0),
        parallax_mas=from_hip_rows("hip_parallax_tenth_mas", np.nan, 0.1),
        g_mag=np.where(by_hp, np.nan, magnitude),
        hp_mag=np.where(by_hp, magnitude, np.nan),
        temperature_k=colour_temperature_k(bp_rp_mag, "BP-RP", luminosity),
        luminosity=luminosity.astype(np.int8),
        quality=np.where(flags & FAIR_FLAG, FAIR, UNCERTAIN),
        infrared=(flags & INFRARED_FLAG) != 0,
    )


def default_columns() -> tuple[StarColumns, NDArray[np.int64]]:
    """Return the columns of all shipped stars, and the rows of the 177,860 brightest at 8.3 um."""
    stars = default_stars()
    flux_jy, flux_flag = measured_flux_jy(stars.g_mag, stars.hp_mag)
    columns = StarColumns(
        ra_deg=stars.ra_deg,
        dec_deg=stars.dec_deg,
        pm_ra_mas_yr=stars.pm_ra_mas_yr,
        pm_dec_mas_yr=stars.pm_dec_mas_yr,
        parallax_mas=stars.parallax_mas,
        temperature_k=stars.temperature_k,
        luminosity=stars.luminosity,
        quality=stars.quality,
        epoch_jyear=J2000_JYEAR,
        name=_NAME,
        provenance=_PROVENANCE,
        flux_jy=flux_jy,
        flux_flag=flux_flag,
        id=stars.hip,
        spell_id=("HIP ", "HGI "),
    )
    return columns, np.flatnonzero(stars.infrared)
