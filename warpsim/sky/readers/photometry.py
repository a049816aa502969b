"""What the surveys' readers share in photometry: magnitudes to MSX fluxes, quality, and flags a letter a band."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.radiometry.bands import BANDS
from warpsim.sky.colours import RELATIONS
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]
Quality = NDArray[np.int64]

UNKNOWN, UNCERTAIN, FAIR, GOOD, EXCELLENT = range(5)
"""Values of StarCatalog.quality."""

EXCELLENT_ERROR = 0.10
"""Relative error of a flux up to which a measurement is excellent."""

LARGEST_MAG = 40.0
LARGEST_STRAY_MAG = 2.0
"""A colour farther than this beyond a relation's range is no colour, but a code for a missing one."""

SATURATED_K_MAG = 4.0
"""2MASS saturates above this brightness: magnitudes are from the wings of the image, and good to 0.2-0.4 mag."""


def magnitude(flux_jy: Array, zero_mag_jy: float) -> Array:
    """Magnitude of a flux density against that of magnitude 0; NaN where the flux is not positive."""
    return -2.5 * np.log10(positive(flux_jy) / zero_mag_jy)


def band_flux_jy(band: str, magnitudes: Array) -> Array:
    """Flux density in an MSX band [Jy] of a star of the given magnitude in it; NaN in, NaN out."""
    return BANDS[band].zero_mag_jy * 10.0 ** (-0.4 * real_magnitudes(magnitudes))


def positive(values: Array) -> Array:
    """Values above zero, NaN elsewhere: archives write nulls as -999.9 or 0, which single precision alters."""
    return np.where(values > 0.0, values, np.nan)


def real_magnitudes(values: Array) -> Array:
    """Magnitudes that a star can have, NaN elsewhere: archives write 99.999 or -99 for a missing one."""
    return np.where(np.abs(values) < LARGEST_MAG, values, np.nan)


def predicted_flux_a_jy(relation: str, magnitudes: Array, colour: Array) -> tuple[Array, Quality]:
    """Flux density in A [Jy] by one of RELATIONS, and its quality, shape (n,) each.

    The quality is FAIR, UNCERTAIN where the colour was clipped, UNKNOWN (with a flux of NaN) where one is missing.
    """
    low, high = RELATIONS[relation].colour_range
    colour = np.where((colour > low - LARGEST_STRAY_MAG) & (colour < high + LARGEST_STRAY_MAG), colour, np.nan)
    magnitude_a, clipped = RELATIONS[relation].magnitude_a(real_magnitudes(magnitudes), colour)
    quality = np.where(clipped, UNCERTAIN, FAIR)
    return band_flux_jy("A", magnitude_a), np.where(np.isnan(magnitude_a), UNKNOWN, quality)


def measured_quality(relative_error: Array) -> Quality:
    """EXCELLENT where the error is known and at most EXCELLENT_ERROR, GOOD elsewhere."""
    return np.where(relative_error <= EXCELLENT_ERROR, EXCELLENT, GOOD)


def flag_letters(table: ColumnTable, place: int, *names: str) -> NDArray[np.str_]:
    """Letter of one band in a column of flags with a letter a band, shape (n,); "" where it is missing."""
    return np.array([text[place : place + 1] for text in table.text(*names).tolist()], dtype=np.str_)


def need(table: ColumnTable, *names: str) -> None:
    """Raise InputError unless the table has one of these columns."""
    if table.find(*names) is None:
        found = ", ".join(table.table.colnames)
        raise InputError(f"must have the column {' or '.join(names)}", value=found, form="s")


def star_names(table: ColumnTable, prefix: str, *names: str) -> NDArray[np.str_] | None:
    """Names of the stars with the survey's prefix, "IRAS 06429-1639"; None without such a column."""
    if table.find(*names) is None:
        return None
    texts = [text if not text or text.startswith(prefix) else f"{prefix}{text}" for text in table.text(*names).tolist()]
    return np.array(texts, dtype=np.str_)


def count_note(mask: NDArray[np.bool_], what: str) -> tuple[str, ...]:
    """A note "3 of 10 stars ...", or none if it is true of no star."""
    n_star = int(np.count_nonzero(mask))
    return (f"{n_star} of {len(mask)} stars {what}",) if n_star else ()
