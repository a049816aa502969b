"""Polynomials of absorbed Earth infrared on plane elements and spheres over the height above the ground.

The kernels' side of it is heat_series.py.
"""

from __future__ import annotations

from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
from warpsim_kernels.albedo_series import damping

from warpsim.target.earth_radiation import NEAR_LIMB_SINE, nodes_for, view_factor

F64 = npt.NDArray[np.float64]

HEAT_ERRORS: MappingProxyType[int, tuple[float, float]] = MappingProxyType(
    {6: (3e-3, 5e-2), 10: (1e-3, 3e-2), 14: (5e-4, 2e-2)}
)
"""Degree of the polynomials, and their worst errors: near the Earth (`NEAR_LIMB_SINE`), and out to the Moon's distance.

Fractions as in `earth_radiation.NODE_ERRORS`, but from the ground itself. The worst are single faces; round bodies are
better.
"""

N_HEIGHT = 257
"""Rows of the table: being linear between them costs 3e-5."""

_N_NODE = 400


def heat_method(error: float, limb_sine: float) -> tuple[int, int]:
    """Return the fastest method for absorbed Earth infrared whose worst error is at most `error`.

    Args:
        error: As a fraction of the largest value that the term has for a body, see `earth_radiation.NODE_ERRORS`.
        limb_sine: Smallest Earth's radius over distance from its centre.

    Returns:
        Degree of the polynomials, 0 if they are not good enough, and nodes of the rule used then.

    Raises:
        InputError: No method is as good as that.
    """
    for degree, (near, anywhere) in HEAT_ERRORS.items():
        if (near if limb_sine >= NEAR_LIMB_SINE else anywhere) <= error:
            return degree, 1
    return 0, nodes_for("thermal", error)


def heat_tables(degree: int, device: Any = None) -> Any:
    """Tables of polynomials of an even degree as the kernels' struct; empty ones for degree 0."""
    import warp as wp
    from warpsim_kernels.heat_series import HeatTables

    element, sphere = coefficient_tables(degree) if degree else (np.zeros((0, 0)), np.zeros((0, 0)))
    tables: Any = HeatTables()
    tables.element = wp.array(element, dtype=wp.float64, device=device)
    tables.sphere = wp.array(sphere, dtype=wp.float64, device=device)
    return tables


@cache
def coefficient_tables(degree: int) -> tuple[F64, F64]:
    """Coefficients by height, (N_HEIGHT, degree / 2 + 1) each: of a plane element's even part, and a unit sphere's.

    The element's are Chebyshev's in the squared cosine, so that the largest error is near the least there can be.
    """
    limb_rad = np.pi / 4 + np.arcsin(np.linspace(-1.0, 1.0, N_HEIGHT) / np.sqrt(2.0))  # sine - cosine in even steps
    limb_sine = np.maximum(np.sin(limb_rad), 1e-6)[:, None]
    turn = (np.arange(_N_NODE) + 0.5) * np.pi / _N_NODE
    cosine = np.sqrt((1.0 + np.cos(turn)) / 2.0)
    even = view_factor(cosine, limb_sine) / limb_sine**2 - cosine / 2.0
    order = np.arange(degree // 2 + 1)
    series = 2.0 / _N_NODE * even @ np.cos(turn[:, None] * order)
    series[:, 0] /= 2.0
    powers = np.polynomial.Polynomial([-1.0, 2.0])  # from Chebyshev's argument to the squared cosine
    basis = [np.polynomial.Chebyshev.basis(int(j)).convert(kind=np.polynomial.Polynomial)(powers).coef for j in order]
    element = series @ np.stack([np.pad(row, (0, len(order) - len(row))) for row in basis])
    return element, element @ _sphere_matrix(degree)


def _sphere_matrix(degree: int) -> F64:
    """Matrix from an element's even powers to those of a sphere, weighted by the cosine to each element's normal.

    Harmonics of degree l are damped by A_l, as the cosine of incidence damps light (Funk and Hecke).
    """
    rows = []
    for power in range(0, degree + 1, 2):
        harmonics = np.polynomial.legendre.poly2leg(np.eye(power + 1)[power])
        damped = harmonics * [damping(order) for order in range(power + 1)]
        kept = np.polynomial.legendre.leg2poly(damped)[::2]
        rows.append(np.pad(kept, (0, degree // 2 + 1 - len(kept))))
    return np.stack(rows)
