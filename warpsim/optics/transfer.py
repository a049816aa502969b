"""The modulation transfer function of a pupil."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def annular_transfer(frequency: F64, obscuration: float) -> F64:
    """Return the transfer function of an annular pupil: its autocorrelation (O'Neill 1956, J. Opt. Soc. Am. 46, 285).

    Args:
        frequency: Spatial frequency over the cut-off 1 / (lambda F); 0 is returned beyond 1.
        obscuration: Diameter of the central obscuration over that of the pupil.
    """
    whole = _disk_overlap(frequency, 1.0)
    if obscuration == 0.0:
        return whole
    hole = _disk_overlap(frequency, obscuration, obscuration)
    return (whole + hole - 2.0 * _disk_overlap(frequency, 1.0, obscuration)) / (1.0 - obscuration**2)


def _disk_overlap(half_distance: F64, a: float, b: float | None = None) -> F64:
    """Return the area over pi that disks of radii a >= b share at a distance."""
    b = a if b is None else b
    d = 2.0 * np.maximum(half_distance, 1e-300)
    from_a = np.arccos(np.clip((d * d + a * a - b * b) / (2.0 * d * a), -1.0, 1.0))
    from_b = np.arccos(np.clip((d * d + b * b - a * a) / (2.0 * d * b), -1.0, 1.0))
    kite = np.maximum((a + b - d) * (d + a - b) * (d - a + b) * (d + a + b), 0.0)
    return np.asarray((a * a * from_a + b * b * from_b - 0.5 * np.sqrt(kite)) / np.pi)
