"""Directions as unit vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64


def unit_vectors(lon_deg: ArrayLike, lat_deg: ArrayLike) -> F64:
    """Unit vectors at longitude (from x towards y) and latitude [deg], as right ascension and declination; (..., 3)."""
    lon_rad, lat_rad = np.radians(lon_deg), np.radians(lat_deg)
    across = np.cos(lat_rad)
    parts = np.broadcast_arrays(across * np.cos(lon_rad), across * np.sin(lon_rad), np.sin(lat_rad))
    return np.stack(parts, axis=-1)


def normalised(vectors: ArrayLike) -> F64:
    """Vectors (..., 3) at length 1; those of length 0 stay 0."""
    array = np.asarray(vectors, np.float64)
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    return np.asarray(array / np.where(length > 0, length, 1.0))


def perpendicular(vectors: ArrayLike) -> F64:
    """Some vector at right angles to each of vectors (..., 3), not of unit length."""
    array = np.asarray(vectors, np.float64)
    return np.cross(array, np.eye(3)[np.argmin(np.abs(array), axis=-1)])
