"""A published catalog as its reader sees it: the columns that tell it, and the stars made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.photometric_bands import flux_of_magnitude_jy
from warpsim.sky.readers.angles import epoch_of_position, position_deg
from warpsim.sky.space_motion import J2000_JYEAR
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]
Quality = NDArray[np.int64]
Flags = NDArray[np.bool_]
Position = tuple[Array, Array, str]

UNKNOWN, UNCERTAIN, FAIR, GOOD, EXCELLENT = range(5)
"""Values of StarCatalog.quality."""

EXCELLENT_ERROR = 0.10
"""Relative error of a flux up to which a measurement is excellent."""

LARGEST_MAG = 40.0
LARGEST_COLOUR_MAG = 8.0
"""A colour beyond is none, but a code for a missing one."""

SATURATED_K_MAG = 4.0
"""2MASS saturates above this brightness: magnitudes are from the wings of the image, and good to 0.2-0.4 mag."""


@dataclass
class SurveyStars:
    """Stars of a survey, by the names and units of StarCatalog.from_arrays; every array is (n,)."""

    ra_deg: Array
    dec_deg: Array
    flux_jy: dict[str, Array]
    """By photometric band; NaN where there is none, or only an upper limit."""

    limit_jy: dict[str, Array] = field(default_factory=dict)
    """Upper limits [Jy], NaN where there is none."""

    flux_flag: dict[str, NDArray[Any]] | None = None
    """1 measured, 2 predicted; measured where left out."""

    pm_ra_mas_yr: Array | None = None
    pm_dec_mas_yr: Array | None = None
    parallax_mas: Array | None = None
    temperature_k: Array | None = None
    luminosity: NDArray[Any] | None = None
    quality: NDArray[Any] | None = None
    id: NDArray[np.str_] | None = None
    epoch_jyear: float = J2000_JYEAR
    """Of the positions as they stand in the survey."""

    notes: tuple[str, ...] = ()
    """What was done to the numbers, a phrase each, for the provenance: "F12 divided by 1.43"."""


@dataclass(frozen=True)
class Survey:
    """A published catalog, known by the names of its columns."""

    name: str
    """Short name, as the argument `format` takes it: "akari-irc"."""

    title: str
    reference: str
    """CDS number and paper, for the provenance."""

    needs: tuple[tuple[str, ...], ...]
    """Columns that tell it from other tables: for each, the spellings in use; one of them must be there."""

    light: Callable[[ColumnTable], dict[str, Any]]
    """Fluxes, their quality, notes, and motions where there are any, by the names of SurveyStars."""

    epoch_jyear: float | Callable[[ColumnTable], tuple[float, str]] = J2000_JYEAR
    """Julian year of the positions; a function of the table returns it and what tells it."""

    position: Callable[[ColumnTable], Position] = position_deg
    """ICRS position [deg], and the name of the column of right ascension."""

    id_columns: tuple[str, ...] = ()
    id_prefix: str = ""
    """Put before names that do not begin with it."""

    telling: tuple[str, ...] = ()
    """Columns that hardly any other table has: one that has them, and lacks a needed one, looks like the survey."""

    def fits(self, table: ColumnTable) -> bool:
        """Return whether the table has all the columns needed."""
        return all(table.find(*names) for names in self.needs)

    def convert(self, table: ColumnTable, epoch_jyear: float | None = None) -> SurveyStars:
        """Return the stars of the survey's table, at an epoch that is stated, or else by the table."""
        ra_deg, dec_deg, ra_name = self.position(table)
        light = self.light(table)
        if epoch_jyear is None:
            epoch_jyear, *notes = self.epoch(table)
            if "pm_ra_mas_yr" in light and epoch_of_position(ra_name, epoch_jyear) != epoch_jyear:
                epoch_jyear = J2000_JYEAR
            else:
                light["notes"] = (*light.get("notes", ()), *filter(None, notes))
        return SurveyStars(ra_deg, dec_deg, id=self._names(table), epoch_jyear=epoch_jyear, **light)

    def epoch(self, table: ColumnTable) -> tuple[float] | tuple[float, str]:
        """Return the Julian year of the table's positions, and a note of what tells it where it is not known before."""
        return (self.epoch_jyear,) if isinstance(self.epoch_jyear, float) else self.epoch_jyear(table)

    def _names(self, table: ColumnTable) -> NDArray[np.str_] | None:
        """Names of the stars, "IRAS 06429-1639"; None without a column of them."""
        if table.find(*self.id_columns) is None:
            return None
        names, prefix = table.text(*self.id_columns).tolist(), self.id_prefix
        return np.array([name if not name or name.startswith(prefix) else prefix + name for name in names], np.str_)


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


def flag_letters(table: ColumnTable, position: int, *names: str) -> NDArray[np.str_]:
    """Letter of one band in a column of flags with a letter a band, shape (n,); "" where it is missing."""
    return np.array([text[position : position + 1] for text in table.text(*names).tolist()], dtype=np.str_)


def count_note(mask: Flags, what: str) -> tuple[str, ...]:
    """A note "3 of 10 stars ...", or none if it is true of no star."""
    n_star = int(np.count_nonzero(mask))
    return (f"{n_star} of {len(mask)} stars {what}",) if n_star else ()
