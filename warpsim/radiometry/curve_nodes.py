"""Nodes of curves over wavelength: checks, products, polylines of few nodes, and quadrature rules over them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arguments import plain_array
from warpsim.arrays import F64
from warpsim.errors import InputError, errors_at
from warpsim.legendre import gauss_legendre

PRODUCT_ERROR = 1e-6
"""Largest error of the linear pieces that stand for a product of curves, as a fraction of its peak."""

_SAMPLING_PART = 1e-3
"""Part of that error which goes into samples of the product, some 30 for each node that is kept of them."""


LARGEST_SIZE = 1e60
"""Of wavelengths and values: products of some of them are numbers still."""


MOST_NODES = 20_000
"""Nodes of a curve over wavelength; the dust's spectra over those of a band take 0.4 GB."""


def checked_curve(wavelength: ArrayLike, values: ArrayLike, what: str) -> tuple[F64, F64]:
    """Return copies of two or more nodes [um] and values >= 0 of a curve over wavelength; `what` names the values."""
    wavelength_um = _nodes(wavelength, "um", "wavelength_um")
    numbers = _nodes(values, "", what)
    if wavelength_um.shape != numbers.shape:
        rule = f"must be as long as wavelength_um, got {len(numbers)} and {len(wavelength_um)} nodes"
        raise InputError(rule, what)
    if wavelength_um[0] <= 0.0:
        raise InputError("must be > 0", "wavelength_um", wavelength_um[0], "g")
    falls = np.flatnonzero(np.diff(wavelength_um) <= 0.0)
    if falls.size:
        k = int(falls[0])
        raise InputError(f"must increase, got {wavelength_um[k]:g} then {wavelength_um[k + 1]:g}", "wavelength_um")
    if numbers.min() < 0.0:
        raise InputError("must be >= 0", what, numbers.min(), "g")
    return wavelength_um, numbers


def _nodes(values: ArrayLike, unit: str, where: str) -> F64:
    """Copy to a float64 vector of at least two finite values in a unit."""
    vector = plain_array(values, unit, where).copy()
    if vector.ndim != 1 or vector.size < 2:
        raise InputError(f"must be a vector of at least 2 nodes, got shape {vector.shape}", where)
    if vector.size > MOST_NODES:
        raise InputError(f"must have at most {MOST_NODES:,} nodes, got {vector.size:,}", where)
    if not np.isfinite(vector).all():
        node = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise InputError(f"must be finite, got {vector[node]} at node {node}", where)
    if (size := float(np.abs(vector).max())) > LARGEST_SIZE:
        raise InputError(f"must be at most {LARGEST_SIZE:g} in size", where, size, "g")
    return vector


def half_power_um(wavelength_um: F64, response: F64) -> tuple[float, float]:
    """Return the outermost wavelengths at which the response is half its peak, or the ends if it stays above."""
    above = np.flatnonzero(response >= 0.5)
    low, high = int(above[0]), int(above[-1])
    low_um, high_um = float(wavelength_um[low]), float(wavelength_um[high])
    if low > 0:
        low_um = float(np.interp(0.5, response[low - 1 : low + 1], wavelength_um[low - 1 : low + 1]))
    if high < len(response) - 1:
        falling = slice(high + 1, high - 1 if high else None, -1)
        high_um = float(np.interp(0.5, response[falling], wavelength_um[falling]))
    return low_um, high_um


def photon_um(wavelength_um: F64, response: F64, per_photon: bool) -> float:
    """Return photon response times wavelength over energy response [um], both of peak 1."""
    if not per_photon:  # response / wavelength has its peak at a node
        node = np.argmax(response / wavelength_um)
        return float(wavelength_um[node] / response[node])
    # Response times wavelength is a parabola in each piece; its vertex may be the peak.
    slope = np.diff(response) / np.diff(wavelength_um)
    start = response[:-1] - slope * wavelength_um[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex_um = np.clip(np.nan_to_num(-0.5 * start / slope), wavelength_um[:-1], wavelength_um[1:])
    return float(max(np.max(response * wavelength_um), np.max((start + slope * vertex_um) * vertex_um)))


def product_of_curves(curves: Sequence[tuple[ArrayLike, ArrayLike]]) -> tuple[F64, F64]:
    """Return nodes [um] and values of a product of curves as a user gives them; see product()."""
    checked = []
    for number, curve in enumerate(curves):
        try:
            wavelength, values = curve
            checked.append(checked_curve(wavelength, values, "values"))
        except (TypeError, ValueError) as error:
            if not isinstance(error, InputError):
                error = InputError("must be a pair of wavelengths and values")
            raise error.within(f"curves[{number}]") from None
    if not checked:
        raise InputError("must be at least one", "curves")
    with errors_at("curves"):
        return product(checked, [f"curves[{number}]" for number in range(len(checked))])


def product(curves: Sequence[tuple[F64, F64]], names: Sequence[str]) -> tuple[F64, F64]:
    """Return few nodes [um] and values of a product of curves, within PRODUCT_ERROR, where all of them have values."""
    first = max(range(len(curves)), key=lambda k: curves[k][0][0])
    last = min(range(len(curves)), key=lambda k: curves[k][0][-1])
    low_um, high_um = curves[first][0][0], curves[last][0][-1]
    if low_um >= high_um:
        raise InputError(f"must overlap, got {names[last]} to {high_um:g} um and {names[first]} from {low_um:g} um")
    nodes = np.unique(np.concatenate([wavelength_um for wavelength_um, _ in curves]))
    nodes = nodes[(nodes >= low_um) & (nodes <= high_um)]
    values = np.stack([np.interp(nodes, *curve) for curve in curves])
    peak = max(values.prod(axis=0).max(), _middles(values).prod(axis=0).max())
    if peak == 0.0:
        zero = [name for name, own in zip(names, values, strict=True) if own.max() == 0.0]
        where = f"{low_um:g} to {high_um:g} um" + (f", where {' and '.join(zero)} is 0" if zero else "")
        raise InputError(f"must have a product above 0, got 0 everywhere from {where}")
    fine = _sampled(nodes, values, _SAMPLING_PART * PRODUCT_ERROR * peak)
    result = np.prod([np.interp(fine, *curve) for curve in curves], axis=0)
    kept = thinned(fine, result, (1.0 - _SAMPLING_PART) * PRODUCT_ERROR * peak)
    return fine[kept], result[kept]


def _middles(values: F64) -> F64:
    """Values in the middle of pieces, along the last axis."""
    return 0.5 * (values[..., 1:] + values[..., :-1])


def _sampled(nodes: F64, values: F64, error: float) -> F64:
    """Nodes with further ones between, whose chords stay within an error of the product of linear curves.

    A chord is off by an eighth of the second derivative at most: over pairs of factors, their steps times the others.
    """
    largest = np.maximum(values[:, 1:], values[:, :-1])
    steps = np.abs(np.diff(values)) / np.where(largest > 0.0, largest, 1.0)
    off = (np.sum(steps, axis=0) ** 2 - np.sum(steps**2, axis=0)) / 8.0 * largest.prod(axis=0)
    n_part = np.maximum(np.ceil(np.sqrt(off / error)), 1).astype(int)
    parts = [np.linspace(nodes[k], nodes[k + 1], n + 1)[:-1] for k, n in enumerate(n_part)]
    return np.concatenate([*parts, nodes[-1:]])


def thinned(x: F64, y: F64, error: float) -> list[int]:
    """Return rows of a polyline, first and last included, whose chords pass all its nodes within an error in y."""
    abscissa, ordinate = x.tolist(), y.tolist()
    kept, low, high = [0], -math.inf, math.inf  # slopes of the chords that pass all nodes since the last row kept
    for row in range(1, len(abscissa)):
        width, rise = abscissa[row] - abscissa[kept[-1]], ordinate[row] - ordinate[kept[-1]]
        if not low <= rise / width <= high:
            kept.append(row - 1)
            width, rise = abscissa[row] - abscissa[row - 1], ordinate[row] - ordinate[row - 1]
            low, high = -math.inf, math.inf
        low, high = max(low, (rise - error) / width), min(high, (rise + error) / width)
    return [*kept, len(abscissa) - 1]


def piecewise_rule(edge: F64, n_node: int, max_log_width: float = math.inf) -> tuple[F64, F64]:
    """Return nodes and weights of the Gauss-Legendre rule on each piece between neighbouring edges.

    Pieces wider than max_log_width in ln(edge) are cut into equal parts.
    """
    if math.isfinite(max_log_width):
        n_part = np.maximum(np.ceil(np.diff(np.log(edge)) / max_log_width), 1).astype(int)
        pieces = zip(edge[:-1], edge[1:], n_part, strict=True)
        edge = np.concatenate([*(np.linspace(left, right, n + 1)[:-1] for left, right, n in pieces), edge[-1:]])
    abscissa, weight = gauss_legendre(n_node)
    width = np.diff(edge)[:, None]
    return (edge[:-1, None] + width * (1.0 + abscissa) / 2.0).ravel(), (width * weight).ravel()


def response_rule(wavelength_um: F64, response: F64, n_node: int, max_log_width: float = math.inf) -> tuple[F64, F64]:
    """Return wavelengths [um] and weights times response [um] of a rule on every linear piece of a response.

    Exact for polynomials of degree 2 n_node - 2 (the response takes one degree); nodes without weight are left out.
    """
    node_um, weight_um = piecewise_rule(wavelength_um, n_node, max_log_width)
    weight_um = weight_um * np.interp(node_um, wavelength_um, response)
    used = weight_um > 0.0
    return node_um[used], weight_um[used]


def gauss_rule(node: F64, weight: F64, n: int) -> tuple[F64, F64]:
    """Return the n nodes, ascending, and weights of the Gauss rule for positive weights on many nodes.

    It integrates polynomials of degree 2n - 1 as the given rule does. The recurrence of the measure's orthonormal
    polynomials comes from the Lanczos process (Gautschi, *Orthogonal Polynomials: Computation and Approximation*, 2004,
    section 2.2.3), nodes and weights from its Jacobi matrix (Golub and Welsch 1969, Math. Comp. 23, 221).
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
