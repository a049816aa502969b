"""Curves over wavelength, linear between their nodes, and quadratures of products of them over a band."""

from __future__ import annotations

import math
from importlib.resources.abc import Traversable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.radiometry.band import Band
from warpsim.radiometry.curve_nodes import piecewise_rule

Array = NDArray[np.float64]

N_EXACT = 3
"""Gauss nodes per piece: exact for a product of up to five linear factors, as of a response per photon (two: response
and wavelength), a spectrum and a reflectance."""


class Curve(NamedTuple):
    """Values over wavelength, linear between nodes and constant beyond the ends."""

    wavelength_um: Array
    """Nodes [um], shape (n,), increasing; read-only."""

    value: Array
    """Values there, shape (n,); read-only."""

    def at(self, wavelength_um: ArrayLike) -> Array:
        """Values at wavelengths [um] of any shape."""
        return np.asarray(np.interp(np.asarray(wavelength_um, dtype=np.float64), self.wavelength_um, self.value))


def read_curves(file: Traversable) -> tuple[Curve, ...]:
    """Curves of a shipped CSV file: a line of names, then wavelengths [um] and the values of each curve."""
    with file.open(encoding="ascii") as text:
        wavelength_um, *columns = np.loadtxt(text, delimiter=",", skiprows=1, unpack=True)
    for array in (wavelength_um, *columns):
        array.setflags(write=False)
    return tuple(Curve(wavelength_um, values) for values in columns)


def band_rule(
    band: Band, *splits_um: Array, n_node: int = N_EXACT, max_log_width: float = math.inf
) -> tuple[Array, Array]:
    """Return the Gauss-Legendre rule over a band: sum(weight_um * f(wavelength_um)) integrates energy response times f.

    Exact where f is a polynomial of degree 2 n_node - 3 in each piece, between neighbours among the nodes of the band
    and the wavelengths given. Pieces wider than max_log_width in ln(wavelength) are cut into equal parts.
    """
    first_um, last_um = band.lit_um
    edge_um = np.unique(np.concatenate([band.wavelength_um, *splits_um]))
    edge_um = edge_um[(edge_um >= first_um) & (edge_um <= last_um)]
    node_um, weight_um = piecewise_rule(edge_um, n_node, max_log_width)
    weight_um = weight_um * band.energy_response(node_um)
    used = weight_um > 0.0
    return node_um[used], weight_um[used]
