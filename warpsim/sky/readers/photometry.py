"""What the surveys' readers share in photometry: magnitudes to fluxes, quality, and flags a letter a band."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.catalog_table import flux_of_magnitude_jy
from warpsim.sky.photometric_bands import photometric_bands
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]
Quality = NDArray[np.int64]
Flags = NDArray[np.bool_]

UNKNOWN, UNCERTAIN, FAIR, GOOD, EXCELLENT = range(5)
"""Values of StarCatalog.quality."""

EXCELLENT_ERROR = 0.10
"""Relative error of a flux up to which a measurement is excellent."""

LARGEST_MAG = 40.0
LARGEST_COLOUR_MAG = 8.0
"""A colour beyond is none, but a code for a missing one."""

SATURATED_K_MAG = 4.0
"""2MASS saturates above this brightness: magnitudes are from the wings of the image, and good to 0.2-0.4 mag."""


def magnitude(flux_jy: Array, band: str) -> Array:
    """Magnitude of a flux density in a photometric band; NaN where the flux is not positive."""
    return -2.5 * np.log10(positive(flux_jy) / photometric_bands()[band].zero_mag_jy)


def band_flux_jy(band: str, magnitudes: Array) -> Array:
    """Flux density in a photometric band [Jy] of a star of the given magnitude in it; NaN in, NaN out."""
    return flux_of_magnitude_jy(band, real_magnitudes(magnitudes))


def positive(values: Array) -> Array:
    """Values above zero, NaN elsewhere: archives write nulls as -999.9 or 0, which single precision alters."""
    return np.where(values > 0.0, values, np.nan)


def real_magnitudes(values: Array) -> Array:
    """Magnitudes that a star can have, NaN elsewhere: archives write 99.999 or -99 for a missing one."""
    return np.where(np.abs(values) < LARGEST_MAG, values, np.nan)


def real_colours(values: Array) -> Array:
    """Colours that a star can have, NaN elsewhere."""
    return np.where(np.abs(values) < LARGEST_COLOUR_MAG, values, np.nan)


def predicted_quality(has_flux: Flags, has_colour: Flags, is_doubtful: Flags) -> Quality:
    """Quality of an infrared flux predicted from shorter waves.

    FAIR with a colour that is not in doubt, UNKNOWN without any flux, UNCERTAIN otherwise.
    """
    return np.where(has_flux, np.where(has_colour & ~is_doubtful, FAIR, UNCERTAIN), UNKNOWN)


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


def count_note(mask: Flags, what: str) -> tuple[str, ...]:
    """A note "3 of 10 stars ...", or none if it is true of no star."""
    n_star = int(np.count_nonzero(mask))
    return (f"{n_star} of {len(mask)} stars {what}",) if n_star else ()
