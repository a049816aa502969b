"""Star catalogs on their way out: files in warpsim's own columns, and the report of `warpsim catalog`."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.files import check_new_file, whole_file, write_fits_table
from warpsim.output.wording import counted
from warpsim.radiometry.bands import as_band
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.catalog_columns import BAND_NAMES
from warpsim.sky.photometric_bands import FLUX_FILLED, FLUX_MEASURED, FLUX_NONE, FLUX_PREDICTED
from warpsim.sky.positions import J2000_JYEAR
from warpsim.sky.star_counts import magnitude_counts
from warpsim.sky.synthetic import GALACTIC_OF_ICRS

FORMAT_OF_SUFFIX = {
    ".fits": "fits",
    ".fit": "fits",
    ".ecsv": "ascii.ecsv",
    ".vot": "votable",
    ".xml": "votable",
    ".csv": "ascii.csv",
}
"""astropy's names of the formats."""

_WITHOUT_META = ("votable", "ascii.csv")

WHOLE_SKY_DEG2 = 4 * np.pi * np.degrees(1) ** 2
GALACTIC_ZONES_DEG = (0, 2, 6, 15, 30, 60, 90)
SMALL_FIELD_DEG = 60.0
"""Catalogs within a smaller circle than this are described by the circle, others by zones of galactic latitude."""
MOST_WARNINGS = 8

_QUALITY_WORDS = ("unknown", "uncertain", "fair", "good", "excellent")
_LABEL, _WIDTH = 13, 100
_BANDS_PER_TABLE = 9


def write_catalog(catalog: StarCatalog, path: str | Path, overwrite: bool = False) -> StarCatalog:
    """Write a catalog as a table that StarCatalog.read() takes as it is; whole or not at all.

    CSV and VOTable keep no epoch: there the stars are moved to J2000.0, which readers assume.

    Args:
        catalog: The stars.
        path: File whose suffix (FORMAT_OF_SUFFIX) says the format.
        overwrite: Whether an existing file is replaced.

    Returns:
        The catalog as written.

    Raises:
        InputError: The suffix is of no known format, or the file exists and is not to be replaced.
    """
    path = Path(path)
    check_new_file(path, tuple(FORMAT_OF_SUFFIX), overwrite)
    format = FORMAT_OF_SUFFIX[path.suffix.lower()]
    if format in _WITHOUT_META:
        catalog = catalog.at_epoch(J2000_JYEAR)
    table = catalog.to_table()
    with whole_file(path) as partial:
        if format == "fits":
            write_fits_table(table, partial)
            return catalog
        # Binary VOTables are a third of the size of those of text.
        options = {"tabledata_format": "binary2"} if format == "votable" else {}
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*W03: Implicitly generating an ID")
            table.write(partial, format=format, overwrite=True, **options)
    return catalog


def catalog_report(catalog: StarCatalog, told: Sequence[str] = ()) -> str:
    """Return a page on a catalog: origin, warnings of its reading, density, motions, fluxes by band, counts."""
    lines = [f"{catalog.name}: {counted(len(catalog), 'star')}, positions at J{catalog.epoch_jyear}"]
    lines += _paragraph("provenance", catalog.provenance or "not stated")
    lines += [line for text in _one_each(told) for line in _paragraph("warning", text)]
    if len(catalog):
        lines += [*_density_lines(catalog), *_motion_lines(catalog)]
        lines += _paragraph("quality", _quality_text(catalog.quality))
        lines += ["", *_band_lines(catalog), "", *_magnitude_lines(catalog)]
    return "\n".join(lines)


def _density_lines(catalog: StarCatalog) -> list[str]:
    """Stars per square degree: over the sky and by galactic latitude, or within the field that holds all of them."""
    middle = catalog.direction_icrs.mean(axis=0)
    length = float(np.linalg.norm(middle))
    axis = middle / length if length > 0 else np.array([0.0, 0.0, 1.0])
    away = np.linalg.norm(catalog.direction_icrs - axis, axis=1)
    radius_deg = float(np.degrees(2 * np.arcsin(min(1.0, away.max() / 2))))
    if radius_deg < SMALL_FIELD_DEG:
        ra_deg, dec_deg = np.degrees(np.arctan2(axis[1], axis[0])) % 360, np.degrees(np.arcsin(axis[2]))
        text = f"all within {radius_deg:.3g} deg of ({ra_deg:.3f}, {dec_deg:+.3f}) deg"
        area_deg2 = WHOLE_SKY_DEG2 * np.sin(np.radians(radius_deg) / 2) ** 2
        if area_deg2 > 0 and len(catalog) > 1:
            text += f": {_density(len(catalog) / area_deg2)} per deg2"
        return _paragraph("density", text)
    edges = np.array(GALACTIC_ZONES_DEG, dtype=np.float64)
    sin_edges = np.sin(np.radians(edges))
    sin_latitude = np.abs(catalog.direction_icrs @ GALACTIC_OF_ICRS[2])
    counts, _ = np.histogram(np.minimum(sin_latitude, 1.0), sin_edges)
    per_deg2 = counts / (WHOLE_SKY_DEG2 * np.diff(sin_edges))
    zones = ", ".join(
        f"{low:g}-{high:g}: {_density(n)}" for low, high, n in zip(edges, edges[1:], per_deg2, strict=False)
    )
    mean = _density(len(catalog) / WHOLE_SKY_DEG2)
    text = f"{mean} per deg2 over the whole sky; by galactic latitude [deg] {zones}"
    return _paragraph("density", text)


def _motion_lines(catalog: StarCatalog) -> list[str]:
    """Numbers of stars with proper motion and with parallax; the fastest star."""
    speed_mas_yr = np.hypot(catalog.pm_ra_mas_yr, catalog.pm_dec_mas_yr)
    n_moving, n_parallax = np.count_nonzero(speed_mas_yr), np.count_nonzero(np.isfinite(catalog.parallax_mas))
    text = f"{counted(n_moving, 'star')} with proper motion"
    if n_moving:
        fastest = int(np.argmax(speed_mas_yr))
        text += f", the fastest {catalog.id[fastest]}, {speed_mas_yr[fastest] / 1e3:.3f} arcsec/yr"
    return _paragraph("motion", f"{text}; {n_parallax:,} with parallax")


def _quality_text(quality: NDArray[np.int64]) -> str:
    values, counts = np.unique(quality, return_counts=True)
    known = range(len(_QUALITY_WORDS))
    words = [_QUALITY_WORDS[value] if value in known else "not a known value" for value in values]
    return ", ".join(f"{value} ({word}) {n:,}" for value, word, n in zip(values, words, counts, strict=True))


def _band_lines(catalog: StarCatalog) -> list[str]:
    """A table: for each band, where its fluxes are from, and their range."""
    lines = [
        f"  {'band':6} {'um':>6} {'measured':>10} {'predicted':>10} {'unknown':>10} {'flux [Jy]':>24} {'magnitude':>16}"
    ]
    for band in _bands_of(catalog):
        flag, flux_jy = catalog.flux_flag(band), catalog.flux_jy(band)
        kinds = ([FLUX_MEASURED], [FLUX_PREDICTED, FLUX_FILLED], [FLUX_NONE])
        counts = [np.count_nonzero(np.isin(flag, of_kind)) for of_kind in kinds]
        line = f"  {band:6} {as_band(band).isophotal_um:6.2f} " + " ".join(f"{n:10,}" for n in counts)
        bright = flux_jy > 0
        if bright.any():
            magnitude = catalog.magnitude(band)[bright] + 0.0  # -0 becomes 0
            flux_range = f"{flux_jy[bright].min():.4g} to {flux_jy[bright].max():.4g}"
            line += f" {flux_range:>24} {f'{magnitude.min():.2f} to {magnitude.max():.2f}':>16}"
        n_dark = np.count_nonzero(flux_jy == 0)
        lines.append(line + (f"   {n_dark:,} of flux 0" if n_dark else ""))
    return lines


def _magnitude_lines(catalog: StarCatalog) -> list[str]:
    """Tables: stars by band and whole magnitude, magnitudes without any left out."""
    counts: dict[str, dict[int, int]] = {}
    for band in _bands_of(catalog):
        magnitudes, n_star = magnitude_counts(catalog, band)
        if len(magnitudes):
            counts[band] = dict(zip(magnitudes.tolist(), n_star.tolist(), strict=True))
    if not counts:
        return ["  no star has a flux"]
    lines: list[str] = []
    for first in range(0, len(counts), _BANDS_PER_TABLE):
        of_bands = dict(list(counts.items())[first : first + _BANDS_PER_TABLE])
        lines += [""] * bool(lines) + [f"  {'magnitude':12}" + "".join(f"{band:>9}" for band in of_bands)]
        for magnitude in sorted(set().union(*of_bands.values())):
            row = [of_band.get(magnitude, 0) for of_band in of_bands.values()]
            if any(row):
                lines.append(f"  {f'{magnitude} to {magnitude + 1}':12}" + "".join(f"{n:9,}" for n in row))
    return lines


def _bands_of(catalog: StarCatalog) -> list[str]:
    """The MSX bands, and those in which the catalog has fluxes."""
    return [*BAND_NAMES, *(band for band in catalog.bands if band not in BAND_NAMES)]


def _one_each(told: Sequence[str]) -> list[str]:
    """Warnings without repetition, each on one line; of many, the first few."""
    texts = list(dict.fromkeys(" ".join(text.split()) for text in told))
    more = len(texts) - MOST_WARNINGS
    return texts if more <= 0 else [*texts[:MOST_WARNINGS], f"{more} more"]


def _paragraph(label: str, text: str) -> list[str]:
    indent = " " * _LABEL
    return textwrap.wrap(
        f"  {label:{_LABEL - 2}}{text}",
        _WIDTH,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _density(per_deg2: float) -> str:
    return f"{per_deg2:,.0f}" if per_deg2 >= 100 else f"{per_deg2:.3g}"
