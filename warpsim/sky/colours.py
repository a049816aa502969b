"""Colours of stars: from visible and near-infrared photometry to the MSX bands, and from one band to the others.

Fitted to bright stars measured at 9 um by AKARI (zero point 56.26 Jy, nearly MSX A). The scatter quoted is robust:
1.48 times the median absolute deviation; dusty stars (AGB, Be, post-AGB, carbon) deviate by 1-5 mag.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.radiometry.bands import BANDS
from warpsim.sky.catalog_columns import BAND_NAMES

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Relation:
    """Magnitude minus [A] as a polynomial in a colour: [A] = magnitude - sum of c_k colour^k."""

    magnitude: str
    colour: str
    coefficients: tuple[float, ...]
    """Constant first."""

    colour_range: tuple[float, float]
    """Where the fit holds [mag]; colours outside are clipped to it."""

    scatter_mag: float

    def magnitude_a(self, magnitude: Array, colour: Array) -> tuple[Array, NDArray[np.bool_]]:
        """[A] magnitude, shape (n,), and whether the colour lay outside the range; NaN in, NaN out."""
        clipped = np.clip(colour, *self.colour_range)
        term = np.zeros_like(clipped)
        for coefficient in reversed(self.coefficients):
            term = term * clipped + coefficient
        return magnitude - term, (clipped != colour) & ~np.isnan(colour)


RELATIONS: Mapping[str, Relation] = {
    "G": Relation("G", "BP-RP", (-0.268, 2.287, -0.2565, 0.0189), (-0.26, 6.7), 0.15),
    "Hp": Relation("Hp", "V-I", (-0.0695, 2.8869, -0.3278, 0.0427, -0.0011), (-0.27, 5.3), 0.16),
    "V": Relation("V", "B-V", (-0.0135, 2.738, -0.551, 0.194), (-0.40, 1.45), 0.11),
    "VK": Relation("V", "V-K", (0.052, 0.970, 0.017), (-0.8, 10.0), 0.12),
    "K": Relation("K", "J-K", (0.039, -0.113, 0.285), (-0.35, 2.3), 0.12),
}
"""By the magnitude they start from; "VK" starts from V and K."""

N_CLASS = 6
CLASS_EDGES_K = (5250.0, 4500.0, 3850.0, 3500.0, 2800.0)
"""Colour temperatures [K] that part the colour classes 0 (hot) to 5 (red)."""

CLASS_TEMPERATURE_K = np.array([7000.0, 4850.0, 4150.0, 3650.0, 3100.0, 2600.0])
"""A typical colour temperature of each class [K]."""

# Colours at the temperatures between classes (and a few more), approximate: +/- 150 K.
_TEMPERATURE_NODES_K = np.array([2200.0, 2800.0, 3500.0, 3850.0, 4500.0, 5250.0, 5772.0, 7000.0, 9600.0, 20000.0])
_COLOUR_NODES: Mapping[str, tuple[float, ...]] = {
    "BP-RP": (7.0, 5.0, 2.6, 2.0, 1.4, 1.0, 0.82, 0.46, 0.0, -0.35),
    "V-I": (5.5, 4.5, 2.4, 1.8, 1.2, 0.8, 0.70, 0.43, 0.0, -0.25),
    "V-K": (11.0, 9.0, 4.7, 3.75, 2.55, 1.85, 1.50, 0.90, 0.0, -0.70),
    "J-K": (2.2, 1.45, 1.15, 1.0, 0.72, 0.50, 0.37, 0.18, 0.0, -0.18),
    "B-V": (1.9, 1.75, 1.62, 1.5, 1.1, 0.82, 0.65, 0.34, 0.0, -0.22),
}

# Magnitude of each band relative to A by colour class. Medians of measured colours of bright stars; B1 and B2 rest on
# few (the CO band), +/- 0.15 mag.
_MAG_MINUS_A: Mapping[str, tuple[float, ...]] = {
    "A": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "B1": (0.0, 0.10, 0.25, 0.30, 0.35, 0.35),
    "B2": (0.0, 0.10, 0.25, 0.30, 0.35, 0.35),
    "C": (0.02, 0.0, -0.01, -0.02, -0.03, -0.05),
    "D": (0.01, 0.0, 0.0, -0.03, -0.10, -0.40),
    "E": (0.0, 0.0, 0.0, -0.05, -0.19, -0.85),
}
UNKNOWN_COLOUR_CLASS = 1
"""Stars without a colour are taken for K giants, the most numerous in these bands."""


def colour_temperature_k(colour: ArrayLike, kind: str) -> Array:
    """Colour temperature [K] of a colour "BP-RP", "V-I", "V-K", "J-K" or "B-V" [mag]; NaN in, NaN out."""
    nodes = np.array(_COLOUR_NODES[kind])
    return np.asarray(np.interp(np.asarray(colour, dtype=np.float64), nodes[::-1], _TEMPERATURE_NODES_K[::-1]))


def colour_class(temperature_k: Array) -> NDArray[np.int64]:
    """Colour class 0 (hot) to 5 (red) of colour temperatures [K]; UNKNOWN_COLOUR_CLASS where NaN."""
    number = N_CLASS - 1 - np.searchsorted(CLASS_EDGES_K[::-1], np.nan_to_num(temperature_k), side="left")
    return np.where(np.isnan(temperature_k), UNKNOWN_COLOUR_CLASS, number)


def magnitude_minus_a(band: str, classes: NDArray[np.int64]) -> Array:
    """Magnitude in a band minus that in A of stars of the given classes [mag]."""
    return np.array(_MAG_MINUS_A[band])[classes]


def flux_from_magnitude_a(magnitude_a: Array, classes: NDArray[np.int64]) -> dict[str, Array]:
    """Predicted flux densities [Jy] in all bands from [A] and the colour class."""
    return {
        band: BANDS[band].zero_mag_jy * 10.0 ** (-0.4 * (magnitude_a + magnitude_minus_a(band, classes)))
        for band in BAND_NAMES
    }
