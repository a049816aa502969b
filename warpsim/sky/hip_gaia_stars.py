"""Stars of Hipparcos and Gaia joined: what the union and the shipped table cut from it have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import J2000_JYEAR
from warpsim.sky.star_columns import StarColumns
from warpsim.sky.visible_stars import measured_flux_jy

Array = NDArray[np.float64]

_PROVENANCE = (
    "G and BP-RP of Gaia DR3, Hp and V-I of Hipparcos-2, infrared fluxes predicted from them by stellar templates. "
    "Gaia-derived data: CC BY-SA 3.0 IGO, ESA/Gaia/DPAC; Hipparcos: ESA 1997, van Leeuwen 2007."
)


@dataclass(frozen=True)
class HipGaiaStars:
    """Stars of either catalog at J2000, one row each, sorted by declination; shape (n,) each."""

    hip: NDArray[np.int64]
    """Hipparcos number; 0 for none."""

    ra_deg: Array
    """ICRS: by Hipparcos astrometry if there is any, or else where Gaia saw the star in 2016."""

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

    def columns(self, name: str, id: NDArray[Any], spell_id: tuple[str, str] = ("", "")) -> StarColumns:
        """Return the columns of a catalog: G and Hp are its fluxes."""
        flux_jy, flux_flag = measured_flux_jy(self.g_mag, self.hp_mag)
        return StarColumns(
            ra_deg=self.ra_deg,
            dec_deg=self.dec_deg,
            pm_ra_mas_yr=self.pm_ra_mas_yr,
            pm_dec_mas_yr=self.pm_dec_mas_yr,
            parallax_mas=self.parallax_mas,
            temperature_k=self.temperature_k,
            luminosity=self.luminosity,
            quality=self.quality,
            epoch_jyear=J2000_JYEAR,
            name=name,
            provenance=f"{name}: {_PROVENANCE}",
            flux_jy=flux_jy,
            flux_flag=flux_flag,
            id=id,
            spell_id=spell_id,
            filled=True,
        )
