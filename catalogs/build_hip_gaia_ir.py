"""Build `hip-gaia-ir v1`: 177,860 stars with predicted 8.3 um magnitudes, the brightest of warpsim's union catalog.

    pip install '.[catalogs]'                       # in warpsim's source tree
    python catalogs/build_hip_gaia_ir.py            # writes catalogs/warpsim_catalogs/hip_gaia_ir_v1.npz

`warpsim.sky.union_catalog` joins Hipparcos-2 and Gaia DR3; this packs what the shipped table keeps of it. The inputs
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

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.colours import colour_class
from warpsim.sky.union_catalog import UnionStars, union_stars

N_STAR = 177_860
OUTPUT = Path(__file__).parent / "warpsim_catalogs" / "hip_gaia_ir_v1.npz"

DEG_MAS = 3.6e6

# Bits of the `flags` column; bits 0-2 hold the colour class.
SOURCE_HIPPARCOS, SOURCE_GAIA, SOURCE_BOTH = 1, 2, 3
FLAG_SOURCE_SHIFT = 3
FLAG_GAIA_MAGNITUDE = 1 << 5
FLAG_COLOUR_CLIPPED = 1 << 6
FLAG_DISPUTED = 1 << 7


def pack(stars: UnionStars) -> dict[str, NDArray[np.generic]]:
    """Return the columns of the table: all rows sorted by declination, then the Hipparcos columns of its rows."""
    brightest = np.argsort(stars.magnitude_a, kind="stable")[:N_STAR]  # NaN comes last
    ra_mas = np.rint(stars.ra_deg[brightest] * DEG_MAS).astype(np.int64) % round(360 * DEG_MAS)
    dec_mas = np.rint(stars.dec_deg[brightest] * DEG_MAS).astype(np.int64)
    order = np.lexsort((brightest, ra_mas, dec_mas))
    row = brightest[order]

    has_hip, has_gaia = stars.hip[row] != 0, stars.source_id[row] != 0
    source = np.where(has_gaia, np.where(has_hip, SOURCE_BOTH, SOURCE_GAIA), SOURCE_HIPPARCOS)
    flags = colour_class(stars.temperature_k[row]) + (source << FLAG_SOURCE_SHIFT) + has_gaia * FLAG_GAIA_MAGNITUDE
    flags = flags + stars.clipped[row] * FLAG_COLOUR_CLIPPED + stars.disputed[row] * FLAG_DISPUTED
    hip_row = row[has_hip]
    return {
        "ra_mas": narrow(ra_mas[order], "<u4"),
        "dec_mas": narrow(dec_mas[order], "<i4"),
        "mag_a_mmag": narrow(np.rint(stars.magnitude_a[row] * 1000.0), "<i2"),
        "flags": narrow(flags, "|u1"),
        "hip": narrow(stars.hip[hip_row], "<u4"),
        "hip_pm_ra_mas_yr": narrow(np.rint(stars.pm_ra_mas_yr[hip_row]), "<i2"),
        "hip_pm_dec_mas_yr": narrow(np.rint(stars.pm_dec_mas_yr[hip_row]), "<i2"),
        "hip_parallax_tenth_mas": narrow(np.rint(stars.parallax_mas[hip_row] * 10.0), "<i2"),
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
    try:
        columns = pack(union_stars())
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
