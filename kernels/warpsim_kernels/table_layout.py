"""Contents of tables of patterns: polynomials in cells of the source's pixel, or nodes. Needs no Warp."""

from typing import NamedTuple

TABLE_SIMD_WIDTH = 8
"""Pixels of a row that lie next to each other in a table of pixel fractions, and are drawn at a time."""

CELL_DEGREES = (3, 5, 7)
"""Total degrees of polynomials."""


class TableLayout(NamedTuple):
    """Contents of the tables of a kernel."""

    degree: int
    """Total degree of polynomials in cells, one of CELL_DEGREES; 0: nodes."""

    n_point: int = 0
    """Points per axis of the interpolation between nodes."""


def n_term_of(degree: int) -> int:
    """Return the number of terms of a polynomial of two variables up to a total degree."""
    return (degree + 1) * (degree + 2) // 2
