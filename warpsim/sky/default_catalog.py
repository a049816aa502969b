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

from warpsim.sky.hip_gaia_stars import HipGaiaStars
from warpsim.sky.star_columns import StarColumns
from warpsim.sky.stellar_templates import DWARF, GIANT, colour_temperature_k
from warpsim.sky.visible_stars import FAIR, UNCERTAIN

Array = NDArray[np.float64]

FILE = "hip_gaia_ir_v2.npz"

HIPPARCOS_FLAG, HP_FLAG, GIANT_FLAG, FAIR_FLAG, INFRARED_FLAG, HIGH_HIP_FLAG = (1 << bit for bit in range(6))
"""Bits of the column `flags`: Hipparcos astrometry; the magnitude is Hp, not G; giant; fair; one of the brightest at
8.3 um; the Hipparcos number is HIGH_HIP or more."""

HIGH_HIP = 1 << 16
NO_COLOUR = -(1 << 15)
"""Value of the column `bp_rp_mmag` for a star without a colour."""

_NAME = "hip-gaia-ir v2"


@dataclass(frozen=True)
class DefaultStars(HipGaiaStars):
    """The shipped stars."""

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
    return stars.columns(_NAME, stars.hip, ("HIP ", "HGI ")), np.flatnonzero(stars.infrared)
