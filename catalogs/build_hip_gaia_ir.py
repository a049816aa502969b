"""Build `hip-gaia-ir v2`: the brightest stars at 8.3 um and in the visible, of warpsim's union catalog.

    pip install '.[catalogs]'                       # in warpsim's source tree
    python catalogs/build_hip_gaia_ir.py            # writes catalogs/warpsim_catalogs/hip_gaia_ir_v2.npz

`warpsim.sky.hip_gaia` joins Hipparcos-2 and Gaia DR3; this packs what the shipped table keeps of it. The inputs
are checked by sha256, and building again gives the same bytes: the container is a zip file with stored
(uncompressed) entries and a fixed date, so no zlib version enters. catalogs/README.md tells what the columns mean.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.default_catalog import (
    FAIR_FLAG,
    FILE,
    GIANT_FLAG,
    HIGH_HIP,
    HIGH_HIP_FLAG,
    HIPPARCOS_FLAG,
    HP_FLAG,
    INFRARED_FLAG,
    NO_COLOUR,
    HipGaiaStars,
    unpacked,
)
from warpsim.sky.hip_gaia import union_stars
from warpsim.sky.stellar_templates import GIANT, colour
from warpsim.sky.visible_stars import FAIR

Columns = dict[str, NDArray[Any]]

N_INFRARED = 177_860
"""As many as the paper's catalog has."""

FAINTEST_G_MAG = 9.0
OUTPUT = Path(__file__).parent / "warpsim_catalogs" / FILE

DEG_MAS = 3.6e6


def table(stars: HipGaiaStars) -> Columns:
    """Return the columns of the table: the brightest in the infrared, and all that are bright in G."""
    everything = pack(stars, np.arange(len(stars.hip)))
    seen = unpacked(everything)
    # Sorted as the table is, so that ties between equal stars are broken in the same way everywhere.
    brightest = np.argsort(np.round(seen.magnitude_in("A"), 9), kind="stable")[:N_INFRARED]
    infrared = np.zeros(len(seen.hip), dtype=bool)
    infrared[brightest] = True
    g_mag = seen.magnitude_in("G")
    columns = chosen(everything, infrared | (g_mag < FAINTEST_G_MAG))
    flags = everything["flags"] | np.where(infrared, INFRARED_FLAG, 0).astype(np.uint8)
    columns["flags"] = flags[infrared | (g_mag < FAINTEST_G_MAG)]
    return columns


def pack(stars: HipGaiaStars, row: NDArray[np.int64]) -> Columns:
    """Return the columns of stars: all rows sorted by declination, then the Hipparcos columns of its rows."""
    ra_mas = np.rint(stars.ra_deg[row] * DEG_MAS).astype(np.int64) % round(360 * DEG_MAS)
    dec_mas = np.rint(stars.dec_deg[row] * DEG_MAS).astype(np.int64)
    order = np.lexsort((row, ra_mas, dec_mas))
    row = row[order]

    by_hp = np.isnan(stars.g_mag[row])
    luminosity, temperature_k = stars.luminosity[row], stars.temperature_k[row]
    # Stars of Hipparcos have the BP-RP that stands for their temperature.
    bp_rp_mag = np.where(by_hp, colour("BP", "RP", luminosity, temperature_k), stars.bp_rp_mag[row])
    bp_rp_mmag = np.where(np.isnan(temperature_k), NO_COLOUR, np.rint(bp_rp_mag * 1000.0))
    hip = stars.hip[row]
    flags = (hip > 0) * HIPPARCOS_FLAG + by_hp * HP_FLAG + (luminosity == GIANT) * GIANT_FLAG
    flags = flags + (stars.quality[row] == FAIR) * FAIR_FLAG + (hip >= HIGH_HIP) * HIGH_HIP_FLAG
    hip_row = row[hip > 0]
    return {
        "ra_mas": narrow(ra_mas[order], "<u4"),
        "dec_mas": narrow(dec_mas[order], "<i4"),
        "mag_mmag": narrow(np.rint(np.where(by_hp, stars.hp_mag[row], stars.g_mag[row]) * 1000.0), "<i2"),
        "bp_rp_mmag": narrow(bp_rp_mmag, "<i2"),
        "flags": narrow(flags, "|u1"),
        "hip": narrow(hip[hip > 0] % HIGH_HIP, "<u2"),
        "hip_pm_ra_mas_yr": narrow(np.rint(stars.pm_ra_mas_yr[hip_row]), "<i2"),
        "hip_pm_dec_mas_yr": narrow(np.rint(stars.pm_dec_mas_yr[hip_row]), "<i2"),
        "hip_parallax_tenth_mas": narrow(np.rint(stars.parallax_mas[hip_row] * 10.0), "<i2"),
    }


def chosen(columns: Columns, keep: NDArray[np.bool_]) -> Columns:
    """Return the rows of a table that are to be kept."""
    of_hipparcos = keep[(columns["flags"] & HIPPARCOS_FLAG) != 0]
    return {name: values[of_hipparcos if name.startswith("hip") else keep] for name, values in columns.items()}


def narrow(values: NDArray[Any], dtype: str) -> NDArray[Any]:
    """Convert whole numbers to a smaller type; refuse if any would change."""
    result = values.astype(dtype)
    if not np.array_equal(result.astype(np.float64), values.astype(np.float64)):
        raise SystemExit(f"a value does not fit in {dtype}: {values.min()} ... {values.max()}")
    return result


def npz_bytes(columns: Columns) -> bytes:
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


def describe(columns: Columns) -> str:
    """Return the figures that catalogs/README.md quotes."""
    stars = unpacked(columns)
    mag_a = stars.magnitude_in("A")[stars.infrared]
    has_hip, by_hp = stars.hip > 0, np.isnan(stars.g_mag)
    fair = stars.quality == FAIR
    return "\n".join(
        [
            f"stars {len(has_hip)}, of them the {int(stars.infrared.sum())} brightest at 8.3 um, to {mag_a.max():.3f}",
            f"Hipparcos only {np.sum(has_hip & by_hp)}, Gaia only {np.sum(~has_hip)}, both {np.sum(has_hip & ~by_hp)}",
            f"giants {np.sum(stars.luminosity == GIANT)}, without colour {np.sum(np.isnan(stars.temperature_k))}",
            f"fair {np.sum(fair)}, of the infrared ones {np.sum(fair & stars.infrared)}",
        ]
    )


def main(arguments: list[str] | None = None) -> int:
    """Build the table and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="file to write (default: %(default)s)")
    output: Path = parser.parse_args(arguments).output
    try:
        columns = table(union_stars())
    except InputError as error:
        raise SystemExit(str(error)) from None
    data = npz_bytes(columns)
    partial = output.with_name(output.name + ".part")
    partial.write_bytes(data)
    partial.replace(output)
    print(describe(columns))
    print(f"{output}: {len(data)} bytes, sha256 {hashlib.sha256(data).hexdigest()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
