"""Coastlines, for maps and globes."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

_PER_DEG = 100
_BREAK = 32767


@functools.cache
def coastlines_deg() -> NDArray[np.float64]:
    """Return longitude and latitude of the world's coastlines [deg], shape (n, 2), read-only; NaN between two lines.

    Natural Earth, 1:110 million (public domain); 0.005 deg and some 10 km.
    """
    from warpsim_catalogs import path

    with path("coastlines_v1.npy").open("rb") as file:
        points = np.load(file)
    degrees = np.where(points == _BREAK, np.nan, points / _PER_DEG)
    degrees.flags.writeable = False
    return degrees
