"""The catalog that ships with warpsim, unpacked from `hip_gaia_ir_v1.npz`.

The file holds an [A] magnitude, a colour class and flags for every star, and astrometry for those of Hipparcos;
catalogs/README.md describes its columns and how it was made.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from warpsim_catalogs import path

from warpsim.sky.catalog_columns import FLUX_PREDICTED, J2000_JYEAR
from warpsim.sky.colours import CLASS_TEMPERATURE_K, flux_from_magnitude_a
from warpsim.sky.star_columns import StarColumns

_UNCERTAIN, _FAIR = 1, 2  # values of StarCatalog.quality

_NAME = "hip-gaia-ir v1"
_PROVENANCE = (
    "hip-gaia-ir v1: 8.3 um magnitudes predicted from Gaia DR3 (G, BP-RP) and Hipparcos-2 (Hp, V-I), other bands from "
    "the colour class. Gaia-derived data: CC BY-SA 3.0 IGO, ESA/Gaia/DPAC; Hipparcos: ESA 1997, van Leeuwen 2007."
)


def default_columns() -> StarColumns:
    """Return the columns of the shipped catalog."""
    with path("hip_gaia_ir_v1.npz").open("rb") as stream, np.load(stream, allow_pickle=False) as columns:
        packed = {key: columns[key] for key in columns.files}
    flags = packed["flags"].astype(np.int64)
    colour_class, source = flags & 7, (flags >> 3) & 3
    uncertain = (flags >> 6) != 0  # colour outside the relation, or a disputed match
    has_hip = source != 2
    mag_a = packed["mag_a_mmag"] * 1e-3

    def from_hip_rows(key: str, fill: float, scale: float) -> NDArray[np.float64]:
        """Spread a column of the Hipparcos stars over all rows."""
        values = np.full(len(flags), fill)
        values[has_hip] = packed[key] * scale
        return values

    hip = from_hip_rows("hip", 0.0, 1.0).astype(np.int64)
    flux_jy = flux_from_magnitude_a(mag_a, colour_class)
    return StarColumns(
        ra_deg=packed["ra_mas"] / 3.6e6,
        dec_deg=packed["dec_mas"] / 3.6e6,
        pm_ra_mas_yr=from_hip_rows("hip_pm_ra_mas_yr", 0.0, 1.0),
        pm_dec_mas_yr=from_hip_rows("hip_pm_dec_mas_yr", 0.0, 1.0),
        parallax_mas=from_hip_rows("hip_parallax_tenth_mas", np.nan, 0.1),
        quality=np.where(uncertain, _UNCERTAIN, _FAIR),
        epoch_jyear=J2000_JYEAR,
        name=_NAME,
        provenance=_PROVENANCE,
        temperature_k=CLASS_TEMPERATURE_K[colour_class],
        luminosity=np.full(len(flags), 1, dtype=np.int8),
        flux_jy=flux_jy,
        flux_flag=dict.fromkeys(flux_jy, np.full(len(flags), FLUX_PREDICTED, dtype=np.uint8)),
        id=hip,
        spell_id=("HIP ", "HGI "),
    )
