"""Regions of the sky: cones about places."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.directions import unit_vectors
from warpsim.errors import InputError

Cone = tuple[float, float, float]
"""Right ascension, declination and radius [deg]."""


def checked_region(region: Any) -> tuple[Cone, ...]:
    """One cone or several, (ra_deg, dec_deg, radius_deg), as a tuple of cones."""
    rule = "must be (ra_deg, dec_deg, radius_deg) with -90 <= dec_deg <= 90 and 0 < radius_deg <= 180, or several"
    try:
        cones = np.array(() if region is None else region, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(rule, value=region) from None
    cones = cones.reshape(-1, 3) if cones.size in (0, 3) else cones
    if cones.ndim != 2 or cones.shape[1] != 3 or not np.isfinite(cones).all():
        raise InputError(rule, value=region)
    if (np.abs(cones[:, 1]) > 90.0).any() or (cones[:, 2] <= 0.0).any() or (cones[:, 2] > 180.0).any():
        raise InputError(rule, value=region)
    return tuple((float(ra), float(dec), float(radius)) for ra, dec, radius in cones.tolist())


def dec_range_deg(region: Sequence[Cone]) -> tuple[float, float]:
    """Smallest and largest declination in any of some cones [deg], by a hair more."""
    return min(dec - radius for _, dec, radius in region) - 1e-9, max(dec + radius for _, dec, radius in region) + 1e-9


def within_cones(
    ra_deg: NDArray[np.float64], dec_deg: NDArray[np.float64], region: Sequence[Cone]
) -> NDArray[np.bool_]:
    """Return whether each place lies in any of some cones, their edges included, shape (n,)."""
    inside = np.zeros(len(ra_deg), dtype=np.bool_)
    place = unit_vectors(ra_deg, dec_deg)
    for ra, dec, radius in region:
        axis = unit_vectors(np.array([ra]), np.array([dec]))[0]
        # By the chord: a cosine says nothing of arc seconds.
        inside |= np.linalg.norm(place - axis, axis=1) <= 2.0 * np.sin(0.5 * np.radians(radius)) * (1.0 + 1e-15)
    return inside
