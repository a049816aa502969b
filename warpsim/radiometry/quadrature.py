"""Quadrature rules over a piecewise-linear spectral response: a dense composite one, and Gauss rules of few nodes."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def piecewise_rule(edge: Array, n_node: int, max_log_width: float = math.inf) -> tuple[Array, Array]:
    """Gauss-Legendre rule on each piece between neighbouring edges.

    Args:
        edge: Where the pieces meet, shape (n,), increasing.
        n_node: Quadrature nodes per piece.
        max_log_width: Pieces wider than this in ln(edge) are cut into equal parts; edges must then be > 0.

    Returns:
        Nodes and weights, shape (m,) each.
    """
    if math.isfinite(max_log_width):
        n_part = np.maximum(np.ceil(np.diff(np.log(edge)) / max_log_width), 1).astype(int)
        pieces = zip(edge[:-1], edge[1:], n_part, strict=True)
        edge = np.concatenate([*(np.linspace(left, right, n + 1)[:-1] for left, right, n in pieces), edge[-1:]])
    abscissa, weight = _legendre(n_node)
    half_width = np.diff(edge)[:, None] / 2.0
    return (edge[:-1, None] + half_width * (1.0 + abscissa)).ravel(), (half_width * weight).ravel()


@functools.cache
def _legendre(n: int) -> tuple[Array, Array]:
    return np.polynomial.legendre.leggauss(n)


def response_rule(
    wavelength_um: Array, response: Array, n_node: int, max_log_width: float = math.inf
) -> tuple[Array, Array]:
    """Gauss-Legendre rule on every linear piece of a response.

    Exact where the integrand is a polynomial of degree 2 n_node - 2 (the response takes one degree).

    Args:
        wavelength_um: Nodes of the response [um], shape (n,), increasing.
        response: Its values, shape (n,), >= 0.
        n_node: Quadrature nodes per piece.
        max_log_width: As of piecewise_rule().

    Returns:
        Wavelengths [um] and weights times response [um], shape (m,) each; nodes without weight are left out.
    """
    node_um, weight_um = piecewise_rule(wavelength_um, n_node, max_log_width)
    weight_um = weight_um * np.interp(node_um, wavelength_um, response)
    used = weight_um > 0.0
    return node_um[used], weight_um[used]


def gauss_rule(node: Array, weight: Array, n: int) -> tuple[Array, Array]:
    """Gauss rule of n nodes for the measure that puts positive weights on many nodes.

    It integrates polynomials of degree 2n - 1 as the given rule does. The recurrence of the measure's orthonormal
    polynomials comes from the Lanczos process (Gautschi, *Orthogonal Polynomials: Computation and Approximation*, 2004,
    section 2.2.3), nodes and weights from the eigenvalues and eigenvectors of its Jacobi matrix (Golub and Welsch 1969,
    Math. Comp. 23, 221).

    Args:
        node: Nodes of the measure, shape (m,), more than n of them distinct.
        weight: Its weights, shape (m,), > 0.
        n: Number of nodes.

    Returns:
        Nodes in increasing order and weights > 0, shape (n,) each.
    """
    # On [-1, 1] the recurrence coefficients are of order 1, whatever the unit and width.
    centre, half_width = (node.max() + node.min()) / 2.0, (node.max() - node.min()) / 2.0
    scaled = (node - centre) / half_width
    total = weight.sum()
    basis = np.empty((n, len(scaled)))  # rows: sqrt(weight) times the polynomials of degree 0, 1, ...
    diagonal, beside = np.empty(n), np.empty(n - 1)
    basis[0] = np.sqrt(weight / total)
    for k in range(n):
        raised = scaled * basis[k]
        diagonal[k] = basis[k] @ raised
        if k + 1 < n:
            for _ in range(2):  # plain Lanczos loses orthogonality to rounding; projecting twice keeps it
                raised -= (basis[: k + 1] @ raised) @ basis[: k + 1]
            beside[k] = np.linalg.norm(raised)
            basis[k + 1] = raised / beside[k]
    jacobi = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    root, vector = np.linalg.eigh(jacobi)
    return centre + half_width * root, total * vector[0] ** 2
