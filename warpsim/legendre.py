"""Gauss-Legendre rules and the Legendre series through their nodes."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64


@cache
def gauss_legendre(count: int) -> tuple[F64, F64]:
    """Nodes on [-1, 1] and weights of sum 1, shape (count,) each; of an odd number of nodes one is exactly 0."""
    node, weight = np.polynomial.legendre.leggauss(count)
    if count % 2:
        node[count // 2] = 0.0
    weight *= 0.5
    for array in (node, weight):
        array.setflags(write=False)  # callers share them
    return node, weight


@cache
def series_matrix(count: int) -> F64:
    """Return the matrix from values at the nodes to coefficients of P_0 ... P_(count-1), shape (count, count).

    The series passes through the values, and its first coefficient is their mean by the rule.
    """
    node, weight = gauss_legendre(count)
    degree = np.arange(count)
    return np.asarray(((2 * degree + 1) * np.polynomial.legendre.legvander(node, count - 1)).T * weight)


def series_at(coefficients: F64, t: npt.ArrayLike) -> F64:
    """Values of series, coefficients (..., n), at times (m,) in [-1, 1]; (..., m)."""
    count = coefficients.shape[-1]
    return np.asarray(coefficients @ np.polynomial.legendre.legvander(np.asarray(t, np.float64), count - 1).T)
