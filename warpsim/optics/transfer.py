"""Modulation transfer: how sharp an image is, for the count of nodes along a streak."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def annular_transfer(frequency: F64, obscuration: float) -> F64:
    """Transfer function of an annular pupil: its autocorrelation (O'Neill 1956, J. Opt. Soc. Am. 46, 285).

    Args:
        frequency: Spatial frequency over the cut-off 1 / (lambda F), from 0 to 1.
        obscuration: Diameter of the central obscuration over that of the pupil.
    """
    overlap = _common_area(2.0 * frequency, 1.0, 1.0)
    if obscuration > 0.0:
        overlap -= 2.0 * _common_area(2.0 * frequency, 1.0, obscuration)
        overlap += _common_area(2.0 * frequency, obscuration, obscuration)
    return np.asarray(overlap / (np.pi * (1.0 - obscuration**2)))


def _common_area(distance: F64, one: float, other: float) -> F64:
    """Area that two discs of radii one >= other share."""
    d = np.clip(distance, one - other + 1e-12, one + other)
    at_other = np.arccos(np.clip((d**2 + other**2 - one**2) / (2.0 * d * other), -1.0, 1.0))
    at_one = np.arccos(np.clip((d**2 + one**2 - other**2) / (2.0 * d * one), -1.0, 1.0))
    kite = 0.5 * np.sqrt(
        np.maximum((one + other - d) * (d + other - one) * (d + one - other) * (d + one + other), 0.0)
    )
    lens = other**2 * at_other + one**2 * at_one - kite
    return np.asarray(np.where(distance <= one - other, np.pi * other**2, lens))


@lru_cache(maxsize=64)
def airy_blur_lamf(obscuration: float) -> float:
    """Sigma [lambda F] of the widest Gaussian whose transfer function is nowhere below that of an Airy pattern."""
    frequency = np.linspace(0.002, 0.998, 499)
    transfer = annular_transfer(frequency, obscuration)
    return float(np.min(np.sqrt(-2.0 * np.log(transfer)) / (2.0 * np.pi * frequency)))
