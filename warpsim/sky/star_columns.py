"""The columns of a star catalog, checked: what every maker of catalogs hands over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StarColumns:
    """Columns of a catalog, which break no rule; the fields are those of StarCatalog, every array is (n,)."""

    ra_deg: Array
    dec_deg: Array
    pm_ra_mas_yr: Array
    pm_dec_mas_yr: Array
    parallax_mas: Array
    temperature_k: Array
    luminosity: NDArray[np.int8]
    quality: NDArray[np.int64]
    epoch_jyear: float
    name: str
    provenance: str
    flux_jy: Mapping[str, Array]
    """Flux density [Jy] by photometric band, those that the catalog has; NaN where unknown."""

    flux_flag: Mapping[str, NDArray[np.uint8]]
    """What the fluxes are, for the same bands: 0 unknown, 1 measured, 2 predicted by the catalog."""

    id: NDArray[Any]
    """Names, or whole numbers that spell_id spells out."""

    spell_id: tuple[str, str] = ("", "")
    """Prefix of a whole number in id, and prefix of the row where that number is 0: ("HIP ", "HGI ")."""

    filled: bool = False
    """Whether the other fluxes are to be predicted from the spectrum."""

    type_temperature_k: Array | None = None
    """Temperatures of a dwarf and of a giant of the star's spectral type [K], (n, 2), NaN without a type: for stars of
    whose temperature neither temperature_k nor a colour gives."""

    limit_jy: Mapping[str, Array] = field(default_factory=dict)
    """Upper limits of predicted fluxes by band [Jy], NaN for none."""
