"""A published catalog as its reader sees it: the columns that tell it, and the stars it makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog_columns import J2000_JYEAR
from warpsim.tables.columns import ColumnTable

Array = NDArray[np.float64]


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

    convert: Callable[[ColumnTable], SurveyStars]

    def fits(self, table: ColumnTable) -> bool:
        """Whether the table has all the columns needed."""
        return all(table.find(*names) for names in self.needs)


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
    """Of the places as they stand in the survey."""

    notes: tuple[str, ...] = ()
    """What was done to the numbers, a phrase each, for the provenance: "F12 divided by 1.43"."""
