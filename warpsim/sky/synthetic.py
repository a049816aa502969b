"""Synthetic stars by the density of the true sky over galactic latitude and its number counts at 8.3 um.

Star k is the (k+1)-th brightest of one endless sky per seed: a catalog of n stars holds its n brightest, and a larger
one begins with the same stars. All four of its random numbers depend on seed, sky and k only.

Two skies, densities in stars per square degree at galactic latitude b, fitted to 10-15 %:

- "astrometric": 2.85 / (|sin b| + 0.40)^1.5 down to 0.116 Jy, as the default catalog, which is picked in the visible;
- "infrared": 2.0 / (|sin b| + 0.05)^1.5 down to 0.1 Jy, as infrared surveys (MSX, IRAS) see it.

Counts N(<m) grow by 0.5 dex per magnitude up to magnitude 2 and by 0.33 dex beyond, at every latitude alike; that is
measured down to magnitude 7 (0.09 Jy) and carried on below. Longitude plays no part: the true plane differs by a
factor of four between inner and outer Galaxy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arguments import check_memory
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS
from warpsim.sky.photometric_bands import FLUX_PREDICTED
from warpsim.sky.positions import J2000_JYEAR, position_of
from warpsim.sky.stars import Stars
from warpsim.sky.stellar_templates import GIANT
from warpsim.streams import uniforms

LARGEST_N_STAR = 100_000_000
"""10 GB of memory, and 15 GB while it is made."""
_STAR_BYTES = 150

_SKY_DEG2 = 4.0 * math.pi * math.degrees(1.0) ** 2
_LARGEST_SEED = 2**63 - 1

_CHUNK_STARS = 1 << 17
"""Stars drawn at once, from a stream of their own. Part of what a seed means: another number gives another sky."""

# Rows are the galactic axes in ICRS: the pole at RA 192.85948, Dec 27.12825, longitude of the ascending node 32.93192
# degrees, taken as exact (ESA 1997, SP-1200 vol. 1, eq. 1.5.11). It differs from the FK5 axes by 0.02 arcsec.
GALACTIC_OF_ICRS = np.array(
    [
        [-0.0548755604162153685, -0.8734370902348850488, -0.4838350155487132268],
        [+0.4941094278755836735, -0.4448296299600111781, +0.7469822444972188905],
        [-0.8676661490190047012, -0.1980763734312015282, +0.4559837761750669223],
    ]
)

# Number counts.
_BREAK_MAG, _FLOOR_MAG = 2.0, -6.0
_BRIGHT_SLOPE, _FAINT_SLOPE = 0.5, 0.33  # dex per magnitude

CLASS_TEMPERATURE_K = np.array([7000.0, 4850.0, 4150.0, 3650.0, 3100.0, 2600.0])
"""Colour temperature of each colour class [K], 0 (hot) to 5 (red): of stars above 5250, 4500, 3850, 3500 and 2800 K,
and below."""

# Fraction of the colour classes by [A], measured in the default catalog: the bright stars are late M.
_CLASS_EDGES_MAG = (2.0, 4.0, 5.0, 6.0)
_CLASS_SHARE = (
    (0.012, 0.043, 0.067, 0.128, 0.605, 0.145),
    (0.025, 0.088, 0.137, 0.205, 0.540, 0.005),
    (0.046, 0.161, 0.230, 0.283, 0.280, 0.000),
    (0.082, 0.240, 0.332, 0.309, 0.037, 0.000),
    (0.131, 0.321, 0.434, 0.113, 0.001, 0.000),
)


@dataclass(frozen=True)
class SyntheticSky:
    """Density n(b) = scale_per_deg2 / (|sin b| + softening)^1.5 of stars brighter than limit_jy."""

    scale_per_deg2: float
    softening: float
    limit_jy: float
    """At 8.3 um [Jy]."""

    @property
    def n_star(self) -> float:
        """Stars brighter than limit_jy over the whole sky: the mean density over |sin b| times the area of the sky."""
        near, far = self._roots()
        return _SKY_DEG2 * self.scale_per_deg2 * 2.0 * (near - far)

    def count(self, magnitude_a: float) -> float:
        """Stars brighter than an [A] magnitude over the whole sky."""
        at_break = self._count_at_break()
        slope = _FAINT_SLOPE if magnitude_a > _BREAK_MAG else _BRIGHT_SLOPE
        return at_break * math.pow(10.0, slope * (magnitude_a - _BREAK_MAG))

    def magnitude_a(self, count: F64) -> F64:
        """[A] magnitude that so many stars are brighter than, shape (n,); the floor for the very first."""
        dex = np.log10(count / self._count_at_break())
        return np.maximum(_BREAK_MAG + dex / np.where(dex > 0.0, _FAINT_SLOPE, _BRIGHT_SLOPE), _FLOOR_MAG)

    def abs_sin_latitude(self, u: F64) -> F64:
        """Map uniform numbers to |sin b|, by inverting the integral of n(b); the same on every machine."""
        near, far = self._roots()
        root = near - u * (near - far)
        return np.clip(1.0 / (root * root) - self.softening, 0.0, 1.0)

    def _roots(self) -> tuple[float, float]:
        """The integral of (s + softening)^-1.5 is -2 (s + softening)^-0.5: those powers at s = 0 and 1."""
        return 1.0 / math.sqrt(self.softening), 1.0 / math.sqrt(1.0 + self.softening)

    def _count_at_break(self) -> float:
        return self.n_star * math.pow(10.0, _FAINT_SLOPE * (_BREAK_MAG - _magnitude_of_flux(self.limit_jy)))


SYNTHETIC_SKIES = {
    "astrometric": SyntheticSky(scale_per_deg2=2.85, softening=0.40, limit_jy=0.116),
    "infrared": SyntheticSky(scale_per_deg2=2.0, softening=0.05, limit_jy=0.1),
}


def synthetic_stars(n_star: int | None, limit_jy: float | None, sky: str, seed: int) -> Stars:
    """Make the brightest stars of a synthetic sky, brightest first, without proper motions.

    Sine, logarithm and power differ between machines in the last bit. Positions are rounded to 0.1 mas and fluxes to
    float32: about one position in a million may still fall on the other side, by 0.1 mas.
    """
    if not isinstance(sky, str) or sky not in SYNTHETIC_SKIES:
        raise InputError(f"must be {' or '.join(map(repr, SYNTHETIC_SKIES))}", "sky", sky)
    model = SYNTHETIC_SKIES[sky]
    seed = _checked_integer(seed, "seed", 0, _LARGEST_SEED)
    n = _checked_n_star(model, n_star, limit_jy)
    check_memory(_STAR_BYTES * n, f"{n:,} synthetic stars")

    ra_deg, dec_deg, temperature_k, flux_jy = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for chunk, start in enumerate(range(0, n, _CHUNK_STARS)):
        rows = slice(start, min(start + _CHUNK_STARS, n))
        n_row = rows.stop - rows.start
        u = uniforms(seed, f"synthetic {sky} sky", chunk, 4 * n_row).reshape(n_row, 4)
        ra_deg[rows], dec_deg[rows] = _places(model, u[:, 0], u[:, 1])
        magnitude_a = model.magnitude_a(np.arange(rows.start, rows.stop) + u[:, 2])
        temperature_k[rows] = CLASS_TEMPERATURE_K[_colour_classes(magnitude_a, u[:, 3])]
        flux_jy[rows] = (BANDS["A"].zero_mag_jy * 10.0 ** (-0.4 * magnitude_a)).astype(np.float32)

    # What is the same for all stars takes no memory.
    still: F64 = np.broadcast_to(0.0, (n,))
    depth = f"the {n} brightest stars, down to {flux_jy[-1]:.4g} Jy at 8.3 um"
    return Stars._made(
        ra_deg=ra_deg,
        dec_deg=dec_deg,
        pm_ra_mas_yr=still,
        pm_dec_mas_yr=still,
        parallax_mas=np.broadcast_to(np.nan, (n,)),
        temperature_k=temperature_k,
        luminosity=np.broadcast_to(np.int8(GIANT), (n,)),
        quality=np.broadcast_to(np.int64(0), (n,)),
        epoch_jyear=J2000_JYEAR,
        name=f"synthetic {sky}",
        provenance=f"synthetic, by warpsim: {sky} sky, seed {seed}, {depth}",
        flux_jy={"A": flux_jy},
        flux_flag={"A": np.broadcast_to(np.uint8(FLUX_PREDICTED), (n,))},
        id=np.broadcast_to(np.int64(0), (n,)),
        spell_id=("", "SYN "),
        filled=True,
    )


def _places(model: SyntheticSky, u_latitude: F64, u_longitude: F64) -> tuple[F64, F64]:
    """Right ascension and declination [deg], rounded to 0.1 mas, of two uniform numbers per star."""
    south = u_latitude < 0.5
    sin_b = model.abs_sin_latitude(2.0 * np.where(south, u_latitude, u_latitude - 0.5))
    sin_b = np.where(south, -sin_b, sin_b)
    cos_b, longitude_rad = np.sqrt((1.0 - sin_b) * (1.0 + sin_b)), 2.0 * math.pi * u_longitude
    galactic = (cos_b * np.cos(longitude_rad), cos_b * np.sin(longitude_rad), sin_b)
    # Sums in a fixed order; a matrix product leaves theirs to the linear algebra library.
    icrs = [
        sum(component * axis[k] for component, axis in zip(galactic, GALACTIC_OF_ICRS, strict=True)) for k in range(3)
    ]
    ra_deg, dec_deg = position_of(*icrs)
    per_deg = 3.6e7  # 0.1 mas
    return np.rint(ra_deg * per_deg) % (360.0 * per_deg) / per_deg, np.rint(dec_deg * per_deg) / per_deg


def _colour_classes(magnitude_a: F64, u: F64) -> NDArray[np.int64]:
    """Colour classes drawn by the shares at each magnitude, shape (n,)."""
    upper = np.cumsum(_CLASS_SHARE, axis=1)[:, :-1]
    return np.asarray(
        np.sum(u[:, None] >= upper[np.searchsorted(_CLASS_EDGES_MAG, magnitude_a)], axis=1), dtype=np.int64
    )


def _magnitude_of_flux(flux_jy: float) -> float:
    """[A] magnitude of a flux density [Jy]."""
    return -2.5 * math.log10(flux_jy / BANDS["A"].zero_mag_jy)


def _checked_n_star(model: SyntheticSky, n_star: Any, limit_jy: Any) -> int:
    """How many stars: as given, or those brighter than limit_jy."""
    if (n_star is None) == (limit_jy is None):
        raise InputError(f"exactly one must be given, got {n_star!r} and {limit_jy!r}", "n_star, limit_jy")
    if n_star is not None:
        return _checked_integer(n_star, "n_star", 1, LARGEST_N_STAR)
    try:
        flux_jy = float(limit_jy)
    except (TypeError, ValueError):
        raise InputError("must be a number", "limit_jy", limit_jy) from None
    if not (math.isfinite(flux_jy) and flux_jy > 0.0):
        raise InputError("must be finite and > 0", "limit_jy", limit_jy)
    n = model.count(_magnitude_of_flux(flux_jy))
    if not 1.0 <= n <= LARGEST_N_STAR:
        raise InputError(f"must leave 1 to {LARGEST_N_STAR} stars, got {flux_jy:g}, which leaves {n:.3g}", "limit_jy")
    return math.floor(n)


def _checked_integer(value: Any, where: str, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
        raise InputError(f"must be a whole number from {low} to {high}", where, value)
    return int(value)
