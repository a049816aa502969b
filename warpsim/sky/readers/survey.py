"""What a survey's reader works with: its table with forgiving column names, and the stars it makes of it."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.sky.catalog_columns import J2000_JYEAR, number_column

if TYPE_CHECKING:
    from astropy.table import Table

Array = NDArray[np.float64]


MISSING = ("", "nan", "null", "none", "-", "--", "---", "~", "n/a")
"""Texts, in small letters, that stand for a missing number."""


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

    convert: Callable[[SurveyTable], SurveyStars]

    def fits(self, table: SurveyTable) -> bool:
        """Whether the table has all the columns needed."""
        return all(table.find(*names) for names in self.needs)


@dataclass
class SurveyStars:
    """Stars of a survey, by the names and units of StarCatalog.from_arrays; every array is (n,)."""

    ra_deg: Array
    dec_deg: Array
    flux_jy: dict[str, Array]
    """NaN where there is none, or only an upper limit."""

    limit_jy: dict[str, Array] = field(default_factory=dict)
    """Upper limits [Jy], NaN where there is none."""

    flux_flag: dict[str, NDArray[Any]] | None = None
    """1 measured, 2 predicted by a colour relation; measured where left out."""

    pm_ra_mas_yr: Array | None = None
    pm_dec_mas_yr: Array | None = None
    parallax_mas: Array | None = None
    temperature_k: Array | None = None
    quality: NDArray[Any] | None = None
    id: NDArray[np.str_] | None = None
    epoch_jyear: float = J2000_JYEAR
    """Of the places as they stand in the survey."""

    notes: tuple[str, ...] = ()
    """What was done to the numbers, a phrase each, for the provenance: "F12 divided by 1.43"."""


class SurveyTable:
    """A table whose columns are found by any of several names, whatever their case and punctuation.

    Archives rename columns as they export them: B-V, B_V and b_v are one name here.
    """

    def __init__(self, table: Table) -> None:
        self.table = table
        self._names: Mapping[str, str] = {plain_name(name): name for name in reversed(table.colnames)}

    def __len__(self) -> int:
        return len(self.table)

    def find(self, *names: str) -> str | None:
        """The table's own name of the first of these columns that it has; one spelled just so goes first."""
        for name in names:
            if name in self.table.colnames:
                return name
            if plain_name(name) in self._names:
                return self._names[plain_name(name)]
        return None

    def number(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> Array:
        """A column of numbers in a unit, shape (n,); NaN where masked, one of `null`, or where there is no such column.

        A column that states another unit is converted; one that states none is taken to be in `unit`.

        Raises:
            InputError: It holds no numbers, or is in a unit that does not convert.
        """
        name = self.find(*names)
        if name is None:
            return np.full(len(self), np.nan)
        values = number_column(self.table, name, unit)
        return np.where(np.isin(values, null), np.nan, values) if null else values

    def needed(self, *names: str, unit: str = "", null: tuple[float, ...] = ()) -> Array:
        """Like number(), of a column that must be there."""
        if self.find(*names) is None:
            raise InputError(f"must have the column {' or '.join(names)}, got {', '.join(self.table.colnames)}")
        return self.number(*names, unit=unit, null=null)

    def text(self, *names: str) -> NDArray[np.str_]:
        """A column as text without blanks at the ends, shape (n,); "" where masked or where there is no such column."""
        name = self.find(*names)
        if name is None:
            return np.full(len(self), "")
        column: Any = self.table[name]
        if column.ndim != 1:
            raise InputError(f"{name} must hold one value a row, got shape {column.shape}")
        texts = np.char.strip(np.asarray(getattr(column, "unmasked", column)).astype(np.str_))
        mask = getattr(column, "mask", None)
        return texts if mask is None else np.where(np.asarray(mask), "", texts)


def plain_name(name: str) -> str:
    """A column name without case and punctuation; the name itself where nothing else is in it."""
    return re.sub(r"[\W_]", "", name.casefold()) or name


def is_number(text: str | bytes) -> bool:
    """Whether a text is a number; Python's 1_0 is none."""
    try:
        float(text)
    except ValueError:
        return False
    return ("_" if isinstance(text, str) else b"_") not in text  # type: ignore[operator]
