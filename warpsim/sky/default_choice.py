"""Choice of the embedded stars for a sensor's bands."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import as_band
from warpsim.sky.stars import Stars
from warpsim.sky.stellar_spectrum import check_band

N_STAR = 177_860
"""Stars of the default catalog for a band, as many as the paper's has."""

INFRARED_UM = 2.5
"""Stars for bands below are chosen by brightness in the band, not at 8.3 um."""


def visible_bands(bands: Iterable[Band | str]) -> tuple[frozenset[Band], bool]:
    """Return the bands up to INFRARED_UM, and whether there are others, or none at all.

    Raises:
        InputError: A band is unknown, or beyond 0.3 to 30 um.
    """
    known = {as_band(band) for band in bands}
    for band in known:
        check_band(band)
    visible = frozenset(band for band in known if band.half_power_um[1] <= INFRARED_UM)
    return visible, len(visible) < len(known) or not known


def brightest_rows(stars: Stars, bands: Iterable[Band], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows of the N_STAR brightest stars in each of some bands, and other rows, in order."""
    chosen = np.zeros(len(stars), dtype=bool)
    chosen[others] = True
    for band in bands:
        chosen[np.argpartition(-stars.irradiance_w_cm2(band), N_STAR)[:N_STAR]] = True
    return np.flatnonzero(chosen)
