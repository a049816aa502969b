"""Numbers of stars by magnitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.sky.catalog import StarCatalog


def magnitude_counts(catalog: StarCatalog, band: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return whole magnitudes without gaps, and the number of stars from each to below the next.

    Stars without light in the band are not counted.

    Args:
        catalog: The stars.
        band: Name of the band.

    Raises:
        InputError: The band is unknown.
    """
    magnitude = catalog.magnitude(band)
    # 1e-9 mag: a magnitude of 3 exactly belongs to 3, whatever the rounding of its flux.
    whole = np.floor(magnitude[np.isfinite(magnitude)] + 1e-9).astype(np.int64)
    if not len(whole):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    return np.arange(whole.min(), whole.max() + 1), np.bincount(whole - whole.min())
