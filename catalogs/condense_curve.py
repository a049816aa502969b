"""Condense a spectral response to few nodes, linear between them, that keep its in-band integrals.

Nodes are taken from the published ones, greedily: as long as an integral is off by more than the tolerance, or the
response at any published wavelength by more than its own, a node is added where that error is largest. With all
published nodes there is no error, so it ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpsim.radiometry.bands import RADIATION_2_M_K

Array = NDArray[np.float64]
Curve = tuple[Array, Array]

BLACKBODY_K = (200, 250, 300, 400, 500, 700, 1000, 1500, 2000, 3000, 4000, 5000, 6000, 8000, 10000, 15000, 20000, 30000)
"""Temperatures of the blackbodies whose in-band integrals are kept [K]."""

_MAX_PLANCK_EXPONENT = 20.0
"""Largest h c / (lambda k T) at the upper half-power wavelength; colder blackbodies have no light there to speak of."""

INTEGRAL_TOLERANCE = 1e-3
"""Of an in-band integral, the errors of all pieces taken as positive."""

RESPONSE_TOLERANCE = 0.01
"""Of the response at any published wavelength, as a fraction of the peak."""

FLOOR = 1e-4
"""Response below this fraction of the peak is left out at both ends: it is below what was measured."""

_N_PART = 4
"""Points of the integrals per published interval."""


def blackbodies(upper_um: float) -> dict[str, float]:
    """Return the temperatures [K] of the blackbodies with light in a band, by name ("300 K")."""
    coldest_k = RADIATION_2_M_K * 1e6 / (_MAX_PLANCK_EXPONENT * upper_um)
    return {f"{temperature_k} K": float(temperature_k) for temperature_k in BLACKBODY_K if temperature_k >= coldest_k}


def planck(wavelength_um: Array, temperature_k: Array | float) -> Array:
    """Spectral radiance of a blackbody, in any unit, at wavelengths [um]."""
    return np.asarray(wavelength_um**-5.0 / np.expm1(RADIATION_2_M_K * 1e6 / (wavelength_um * temperature_k)))


def trim(curve: Curve) -> Curve:
    """Cut a response to where it is above the floor, and one node more at each end, of response 0."""
    wavelength_um, response = curve
    lit = np.flatnonzero(response >= FLOOR * response.max())
    low, high = max(lit[0] - 1, 0), min(lit[-1] + 1, len(response) - 1)
    kept = response[low : high + 1].copy()
    if lit[0] > 0:
        kept[0] = 0.0
    if lit[-1] < len(response) - 1:
        kept[-1] = 0.0
    return wavelength_um[low : high + 1], kept


def condense(curve: Curve, per_photon: bool, temperatures_k: Sequence[float], spectra: Sequence[Curve]) -> Curve:
    """Return fewer nodes of a response, of peak 1, that keep its in-band integrals.

    Args:
        curve: Wavelengths [um] and responses.
        per_photon: Whether the response is by photon; by energy otherwise.
        temperatures_k: Blackbodies whose integrals are kept [K].
        spectra: Wavelengths [um] and spectral irradiances of stars whose integrals are kept, too.
    """
    wavelength_um, response = trim(curve)
    n = len(wavelength_um)
    part = np.arange((n - 1) * _N_PART + 1) / _N_PART
    fine_um = np.interp(part, np.arange(n), wavelength_um)
    width_um = np.gradient(fine_um)
    by_energy = fine_um if per_photon else np.ones_like(fine_um)
    weight = [planck(fine_um, temperature_k) for temperature_k in temperatures_k]
    weight += [np.interp(fine_um, *spectrum) for spectrum in spectra]
    weights = np.array(weight) * width_um * by_energy
    weights /= (weights @ np.interp(fine_um, wavelength_um, response))[:, None]

    kept = {0, n - 1, int(np.argmax(response)), int(np.argmax(response * (wavelength_um if per_photon else 1.0)))}
    while True:
        nodes = sorted(kept)
        error = np.interp(fine_um, wavelength_um[nodes], response[nodes]) - np.interp(fine_um, wavelength_um, response)
        added = _worst_node(error, weights, response.max(), nodes)
        if added is None:
            return wavelength_um[nodes], response[nodes] / response.max()
        kept.add(added)


def _worst_node(error: Array, weights: Array, peak: float, nodes: list[int]) -> int | None:
    """Published node to add next, or None if all is within the tolerances."""
    at_node = np.abs(error[::_N_PART])
    if at_node.max() > RESPONSE_TOLERANCE * peak:
        return int(np.argmax(at_node))
    starts = np.array(nodes[:-1]) * _N_PART
    piece = np.abs(np.add.reduceat(weights * error, starts, axis=1))
    total = piece.sum(axis=1)
    worst = int(np.argmax(total))
    if total[worst] <= INTEGRAL_TOLERANCE:
        return None
    first = int(np.argmax(piece[worst]))
    low, high = nodes[first], nodes[first + 1]
    return low + int(np.argmax((at_node * weights[worst, ::_N_PART])[low : high + 1]))
