"""Collect measured photometry of stars near and far into `tests/data/star_photometry.csv`.

    pip install '.[catalogs]'
    pip download --no-deps exosims==3.6.6
    python catalogs/collect_star_photometry.py exosims-3.6.6-py3-none-any.whl

The stars are ExoCat-1 (Turnbull 2015, nearby Hipparcos stars) and the planet hosts of the NASA Exoplanet Archive, two
tables that the package EXOSIMS (BSD-3-Clause) carries. V, 2MASS and WISE photometry are theirs; G and BP-RP are
those of Gaia DR3, Hp, B-V, V-I, parallax and proper motion those of Hipparcos-2, as in `warpsim.sky.hip_gaia`.

Only photometry that can be trusted is kept, the rest is left blank: magnitudes with an error below 0.06 mag, that are
neither limits nor blended, and fainter than where the survey saturates (FAINTER_THAN_MAG). Stars with a companion
within 8 arcsec and 4 mag (Washington Double Star Catalog, given for ExoCat) are left out.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import re
import sys
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from astropy.table import Table
from numpy.typing import NDArray

from warpsim.sky.hip_gaia import GAIA_EPOCH_JYEAR, Gaia, Hipparcos, close_pairs, match, read_gaia, read_hipparcos

Array = NDArray[np.float64]

OUTPUT = Path(__file__).parents[1] / "tests" / "data" / "star_photometry.csv"
EXOSIMS_SHA256 = "09238a29e7df461d2f65327bcf03f5521f0165992c43d97a6bfc79280637ad29"
EXOCAT = "EXOSIMS/StarCatalog/mission_exocat.votable"
HOSTS = "EXOSIMS/PlanetPopulation/planets_2019.05.31_11.18.02.votable"

BANDS = ("J", "H", "Ks", "W1", "W2", "W3", "W4")
EXOCAT_COLUMNS = ("st_j2m", "st_h2m", "st_ks2m", "st_wise1", "st_wise2", "st_wise3", "st_wise4")
HOST_COLUMNS = ("st_j", "st_h", "st_k", "st_wise1", "st_wise2", "st_wise3", "st_wise4")
FAINTER_THAN_MAG = {"J": 4.5, "H": 4.5, "Ks": 4.5, "W1": 4.5, "W2": 6.3, "W3": 3.8, "W4": -0.4}
LARGEST_ERROR_MAG = 0.06
HOST_RADIUS_ARCSEC = 3.0
"""Hosts without a Hipparcos number are those of Gaia this near at its epoch, within 0.3 mag in G."""

COLUMNS = ("hip", "source", "ra_deg", "dec_deg", "parallax_mas", "pm_mas_yr", "G", "BP-RP", "Hp", "B-V", "V-I", "V")


def main(arguments: list[str] | None = None) -> int:
    """Collect the photometry and write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("wheel", type=Path, help="exosims-3.6.6-py3-none-any.whl")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="file to write (default: %(default)s)")
    options = parser.parse_args(arguments)
    if hashlib.sha256(options.wheel.read_bytes()).hexdigest() != EXOSIMS_SHA256:
        raise SystemExit(f"{options.wheel}: not the wheel of exosims 3.6.6")
    stars, gaia = read_hipparcos(), read_gaia()
    partner, _ = match(stars, gaia)
    of_star = np.full(len(stars.hip), -1)
    of_star[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    with zipfile.ZipFile(options.wheel) as wheel:
        exocat, hosts = _votable(wheel, EXOCAT), _votable(wheel, HOSTS)
    rows = exocat_rows(exocat, stars, gaia, of_star) + host_rows(hosts, stars, gaia, of_star)
    known: dict[Any, dict[str, Any]] = {}
    for row in rows:  # the first of a star stays
        known.setdefault(row["hip"] or (row["ra_deg"], row["dec_deg"]), row)
    ordered = sorted(known.values(), key=lambda row: (row["dec_deg"], row["ra_deg"]))
    write(ordered, options.output)
    print(f"{options.output}: {len(ordered)} stars, {options.output.stat().st_size} bytes")
    return 0


def exocat_rows(table: Table, stars: Hipparcos, gaia: Gaia, of_star: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Return the rows of ExoCat's single stars that Gaia has."""
    separation_arcsec, fainter_mag = _numbers(table, "wds_sep"), _numbers(table, "wds_deltamag")
    double = (separation_arcsec < 8.0) & (fainter_mag < 4.0)
    photometry = _photometry(table, EXOCAT_COLUMNS, blends=True)
    v_mag = _numbers(table, "st_vmag")
    rows = []
    for k in np.flatnonzero(~double).tolist():
        star = _star_row(stars, str(table["hip_name"][k]))
        if star >= 0 and of_star[star] >= 0:
            measured = {"V": v_mag[k]} | {band: photometry[band][k] for band in BANDS}
            rows.append(_row("ExoCat", star, int(of_star[star]), stars, gaia, measured))
    return rows


def host_rows(table: Table, stars: Hipparcos, gaia: Gaia, of_star: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Return the rows of planet hosts that Gaia has."""
    _, first = np.unique(np.asarray(table["pl_hostname"]).astype(str), return_index=True)  # a row per planet
    table = table[first]
    photometry = _photometry(table, HOST_COLUMNS, blends=False)
    v_mag = _numbers(table, "st_vj")
    by_place = _by_place(table, gaia)
    rows = []
    for k in range(len(table)):
        star = _star_row(stars, str(table["hip_name"][k]))
        of_gaia = int(of_star[star]) if star >= 0 else int(by_place[k])
        if of_gaia >= 0:
            measured = {"V": v_mag[k]} | {band: photometry[band][k] for band in BANDS}
            row = _row("hosts", star, of_gaia, stars, gaia, measured)
            if star < 0:
                row["parallax_mas"] = _numbers(table, "st_plx")[k]
            rows.append(row)
    return rows


def write(rows: list[dict[str, Any]], output: Path) -> None:
    """Write rows that have a colour and a magnitude in the infrared."""
    digits = {"ra_deg": 5, "dec_deg": 5, "parallax_mas": 2, "pm_mas_yr": 0}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *BANDS])
    for row in rows:
        if np.isnan(row["BP-RP"]) or all(np.isnan(row[band]) for band in BANDS):
            continue
        cells = [row["hip"] or "", row["source"]]
        for name in (*COLUMNS[2:], *BANDS):
            value = row[name]
            cells.append("" if np.isnan(value) else f"{value:.{digits.get(name, 3)}f}")
        writer.writerow(cells)
    output.parent.mkdir(exist_ok=True)
    output.write_text(text.getvalue(), encoding="ascii")


def _row(
    source: str, star: int, of_gaia: int, stars: Hipparcos, gaia: Gaia, measured: dict[str, Any]
) -> dict[str, Any]:
    """Join what the catalogs know of a star; star -1 is one that Hipparcos does not have."""
    row: dict[str, Any] = {"hip": int(stars.hip[star]) if star >= 0 else 0, "source": source}
    row |= {"ra_deg": gaia.ra_deg[of_gaia], "dec_deg": gaia.dec_deg[of_gaia]}
    row |= {"G": gaia.g_mag[of_gaia], "BP-RP": gaia.bp_rp_mag[of_gaia]}
    of_hipparcos = {"parallax_mas": "parallax_mas", "Hp": "hp_mag", "B-V": "b_v_mag", "V-I": "v_i_mag"}
    row |= {name: getattr(stars, field)[star] if star >= 0 else np.nan for name, field in of_hipparcos.items()}
    row["pm_mas_yr"] = np.hypot(stars.pm_ra_mas_yr[star], stars.pm_dec_mas_yr[star]) if star >= 0 else np.nan
    return row | measured


def _by_place(table: Table, gaia: Gaia) -> NDArray[np.int64]:
    """Row in Gaia of each host by its position at Gaia's epoch; -1 for none."""
    years = GAIA_EPOCH_JYEAR - 2000.0
    dec_deg = _numbers(table, "dec")
    pm_ra, pm_dec = (np.nan_to_num(_numbers(table, key)) / 3.6e6 for key in ("gaia_pmra", "gaia_pmdec"))
    ra_deg = _numbers(table, "ra") + years * pm_ra / np.cos(np.radians(dec_deg))
    found = np.full(len(table), -1)
    host, row, arcsec = close_pairs(ra_deg, dec_deg + years * pm_dec, gaia.ra_deg, gaia.dec_deg)
    same = np.abs(_numbers(table, "gaia_gmag")[host] - gaia.g_mag[row]) < 0.3
    farthest_first = np.argsort(-arcsec)
    kept = farthest_first[(same & (arcsec < HOST_RADIUS_ARCSEC))[farthest_first]]
    found[host[kept]] = row[kept]
    return found


def _photometry(table: Table, columns: tuple[str, ...], blends: bool) -> dict[str, Array]:
    """Magnitudes by band, NaN where they cannot be trusted."""
    result = {}
    for band, column in zip(BANDS, columns, strict=True):
        magnitude = _numbers(table, column)
        good = (_numbers(table, f"{column}err") < LARGEST_ERROR_MAG) & (_numbers(table, f"{column}lim") == 0)
        good &= magnitude > FAINTER_THAN_MAG[band]
        if blends:
            good &= _numbers(table, f"{column}blend") == 0
        result[band] = np.where(good, magnitude, np.nan)
    return result


def _star_row(stars: Hipparcos, name: str) -> int:
    """Row in Hipparcos of a name such as "HIP 57 A"; -1 for none."""
    found = re.match(r"HIP\s+(\d+)", name)
    if not found:
        return -1
    row = int(np.searchsorted(stars.hip, int(found[1])))
    return row if row < len(stars.hip) and stars.hip[row] == int(found[1]) else -1


def _numbers(table: Table, column: str) -> Array:
    """Return a column as numbers, NaN where masked."""
    values = np.ma.asarray(table[column]).astype(np.float64)
    return np.asarray(np.ma.filled(values, np.nan))


def _votable(wheel: zipfile.ZipFile, name: str) -> Table:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the archive's spelling of units
        return Table.read(io.BytesIO(wheel.read(name)), format="votable")


if __name__ == "__main__":
    sys.exit(main())
