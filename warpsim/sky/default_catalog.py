"""The catalog that ships with warpsim, unpacked from `hip_gaia_ir_v2.npz`, and the choice of its stars for some bands.

The file holds magnitude, colour and flags of every star, and astrometry for those of Hipparcos; catalogs/README.md
describes its columns and how it was made.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from warpsim_catalogs import path

from warpsim.arrays import F64
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.sky.photometric_bands import FLUX_MEASURED, FLUX_NONE, flux_of_magnitude_jy
from warpsim.sky.positions import J2000_JYEAR
from warpsim.sky.stars import Stars
from warpsim.sky.stellar_spectrum import check_band
from warpsim.sky.stellar_templates import DWARF, GIANT, colour, colour_temperature_k
from warpsim.sky.visible_stars import FAIR, UNCERTAIN

FILE = "hip_gaia_ir_v2.npz"

HIPPARCOS_FLAG, HP_FLAG, GIANT_FLAG, FAIR_FLAG, INFRARED_FLAG, HIGH_HIP_FLAG = (1 << bit for bit in range(6))
"""Bits of the column `flags`: Hipparcos astrometry; the magnitude is Hp, not G; giant; fair; one of the brightest at
8.3 um; the Hipparcos number is HIGH_HIP or more."""

HIGH_HIP = 1 << 16
NO_COLOUR = -(1 << 15)
"""Value of the column `bp_rp_mmag` for a star without a colour."""

_NAME = "hip-gaia-ir v2"

_PROVENANCE = (
    "G and BP-RP of Gaia DR3, Hp and V-I of Hipparcos-2, infrared fluxes predicted from them by stellar templates. "
    "Gaia-derived data: CC BY-SA 3.0 IGO, ESA/Gaia/DPAC; Hipparcos: ESA 1997, van Leeuwen 2007."
)

N_STAR = 177_860
"""Stars of the default catalog for a band, as many as the paper's has."""

INFRARED_UM = 2.5
"""Stars for bands below are chosen by brightness in the band, not at 8.3 um."""


@dataclass(frozen=True)
class HipGaiaStars:
    """Stars of Hipparcos or Gaia at J2000, one row each, sorted by declination; shape (n,) each."""

    hip: NDArray[np.int64]
    """Hipparcos number; 0 for none."""

    ra_deg: F64
    """ICRS: by Hipparcos astrometry if there is any, or else where Gaia saw the star in 2016."""

    dec_deg: F64
    pm_ra_mas_yr: F64
    """cos(dec) included; 0 without Hipparcos astrometry, like pm_dec_mas_yr."""

    pm_dec_mas_yr: F64
    parallax_mas: F64
    """NaN without Hipparcos astrometry."""

    g_mag: F64
    """G, where Gaia gives the magnitude; NaN elsewhere."""

    hp_mag: F64
    """Hp, where Hipparcos does; NaN elsewhere."""

    temperature_k: F64
    """Colour temperature [K]; NaN for stars without a colour."""

    luminosity: NDArray[np.int8]
    """Luminosity class: 0 dwarf, 1 giant."""

    quality: NDArray[np.int64]
    """Of the infrared light: 1 uncertain, 2 fair."""

    bp_rp_mag: F64
    """BP-RP, of either catalog in the shipped file, of Gaia alone in the union; NaN where unknown."""

    infrared: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool))
    """Whether the star is one of the 177,860 brightest at 8.3 um; empty in the union."""

    source_id: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """Gaia DR3 source that gives the magnitude, 0 where Hipparcos does; empty in the shipped file."""

    def catalog(self, name: str, id: NDArray[Any], spell_id: tuple[str, str] = ("", "")) -> Stars:
        """Return the stars of a catalog: G and Hp are its fluxes."""
        flux_jy = {"G": flux_of_magnitude_jy("G", self.g_mag), "Hp": flux_of_magnitude_jy("Hp", self.hp_mag)}
        return Stars._made(
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
            flux_flag={
                band: np.where(np.isnan(values), FLUX_NONE, FLUX_MEASURED).astype(np.uint8)
                for band, values in flux_jy.items()
            },
            id=id,
            spell_id=spell_id,
            filled=True,
        )

    def magnitude_in(self, band: Band | str) -> F64:
        """Magnitude in a band with a zero point, shape (n,), predicted from G, or from Hp where G is NaN."""
        by_g, by_hp = (
            magnitude - colour(given, band, self.luminosity, self.temperature_k)
            for given, magnitude in (("G", self.g_mag), ("Hp", self.hp_mag))
        )
        return np.where(np.isnan(self.g_mag), by_hp, by_g)


def default_stars() -> HipGaiaStars:
    """Read the shipped stars: the brightest at 8.3 um, and all others brighter than G = 9."""
    with path(FILE).open("rb") as stream, np.load(stream, allow_pickle=False) as columns:
        return unpacked({key: columns[key] for key in columns.files})


def unpacked(packed: Mapping[str, NDArray[Any]]) -> HipGaiaStars:
    """Return the stars of the columns of the shipped file."""
    flags = packed["flags"].astype(np.int64)
    has_hip, by_hp = (flags & HIPPARCOS_FLAG) != 0, (flags & HP_FLAG) != 0

    def from_hip_rows(key: str, fill: float, scale: float) -> F64:
        """Spread a column of the Hipparcos stars over all rows."""
        values = np.full(len(flags), fill)
        values[has_hip] = packed[key] * scale
        return values

    magnitude = packed["mag_mmag"] * 1e-3
    luminosity = np.where(flags & GIANT_FLAG, GIANT, DWARF)
    bp_rp_mag = np.where(packed["bp_rp_mmag"] == NO_COLOUR, np.nan, packed["bp_rp_mmag"] * 1e-3)
    high_hip = np.where(flags & HIGH_HIP_FLAG, HIGH_HIP, 0)
    return HipGaiaStars(
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
        bp_rp_mag=bp_rp_mag,
        infrared=(flags & INFRARED_FLAG) != 0,
    )


def embedded_stars() -> tuple[Stars, NDArray[np.int64]]:
    """Return all shipped stars, and the rows of the 177,860 brightest at 8.3 um."""
    stars = default_stars()
    return stars.catalog(_NAME, stars.hip, ("HIP ", "HGI ")), np.flatnonzero(stars.infrared)


def visible_bands(bands: Iterable[Band | str]) -> tuple[frozenset[Band], bool]:
    """Return the bands up to INFRARED_UM, and whether there are others, or none at all."""
    known = {as_band(band) for band in bands}
    for band in known:
        check_band(band)
    visible = frozenset(band for band in known if band.half_power_um[1] <= INFRARED_UM)
    return visible, len(visible) < len(known) or not known


def brightest_rows(stars: Stars, bands: Iterable[Band], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows of the N_STAR brightest stars in each of some bands, and other rows, in order."""
    chosen = np.zeros(len(stars), dtype=bool)
    chosen[others] = True
    for band in bands:
        chosen[np.argpartition(-stars.irradiance_w_cm2(band), N_STAR)[:N_STAR]] = True
    return np.flatnonzero(chosen)
