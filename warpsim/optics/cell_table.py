"""Tables of pixel fractions as polynomials, fitted to tables of nodes: what most patterns are drawn with.

The offset of a source in its pixel is cut into cells. In each of them the fraction that a pixel collects is a
polynomial of the offset up to a total degree, in Chebyshev's basis: the least-squares fit to the table of nodes,
interpolated in float64 at Lobatto's points, ends and corners of cells among them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray
from warpsim_kernels.table_layout import TABLE_SIMD_WIDTH, n_term_of

from warpsim.arrays import F64
from warpsim.optics.epsf_table import EpsfTable, lagrange_weights

N_MORE = 2
"""Points per axis of a fit, beyond the degree: there Chebyshev's next polynomial, which a fit leaves out first, is
largest; the middle of a cell is among them."""

MARGIN = 1.25
"""Largest error anywhere over that at the points of a fit, for errors of degrees beyond the next."""

BLOCK_PX: int = TABLE_SIMD_WIDTH // 2
"""Pixels from a block of TABLE_SIMD_WIDTH pixels to the next: they overlap, so that a stamp needs few of them."""

ROUNDING = 1e-7
"""Error that float32 coefficients, terms and sums may add."""

CORE_PX = 2
"""Pixels to each side of the source's own on which the number of cells is judged."""

CELLS_PER_NODE = {3: 1.0, 5: 0.3, 7: 0.15}
"""Cells per pixel over nodes per pixel, by degree, that are tried first."""

MOST_CELLS = 512
"""Cells per pixel, beyond which none are tried."""


@dataclass(frozen=True, slots=True, eq=False)
class CellTable:
    """Polynomials of the fraction that each pixel of a stamp collects, by the cell that the source lies in."""

    nodes: EpsfTable
    """The table that they are fitted to, without its fractions: reach, envelope and wing are its own."""

    degree: int
    """Total degree."""

    n_cell: tuple[int, int]
    """Cells per pixel along rows and columns; even, so that the reach and the pixel's middle lie between cells."""

    coefficient: NDArray[np.float32]
    """Shape (n_cell_row, n_cell_column, n_block, n_row, n_term, TABLE_SIMD_WIDTH); cells of dy >= 0 if mirrored."""

    zero: tuple[int, int]
    """The source's own pixel: its row, and its column counted from the first of the first block."""

    error: float
    """Bound of the absolute error per unit flux, that of the nodes included."""

    @property
    def n_byte(self) -> int:
        """Bytes of the polynomials."""
        return self.coefficient.nbytes


def side_pixels(table: EpsfTable) -> tuple[int, int]:
    """Pixels to each side of the source's own that a table can serve, along rows and columns."""
    return math.ceil(table.reach_px[0] + 0.5), math.ceil(table.reach_px[1] + 0.5)


def n_side_block(table: EpsfTable) -> int:
    """Blocks of TABLE_SIMD_WIDTH pixels to each side of the one that has the source's own pixel in its middle."""
    return -(-(side_pixels(table)[1] + 1 - BLOCK_PX) // (2 * BLOCK_PX))


def cell_bytes(table: EpsfTable, degree: int, n_cell: tuple[int, int]) -> int:
    """Return the size of the polynomials [B]."""
    n_cells = n_cell[0] * n_cell[1] // (2 if table.mirrored else 1)
    n_block = _n_column(table) // BLOCK_PX - 1
    return int(4 * n_cells * (2 * side_pixels(table)[0] + 1) * n_block * TABLE_SIMD_WIDTH * n_term_of(degree))


def _n_column(table: EpsfTable) -> int:
    """Return the pixels of a row of all blocks; the last begins with the last BLOCK_PX that a stamp may need."""
    return int((2 * n_side_block(table) + 1) * TABLE_SIMD_WIDTH + BLOCK_PX)


def cells_for(table: EpsfTable, degree: int, error: float) -> tuple[int, int] | None:
    """Return the cells per pixel with which polynomials keep an error about the source's pixel; None for too many.

    Args:
        table: What they are fitted to.
        degree: Total degree.
        error: Largest error per unit flux, that of the nodes included.
    """
    most = error - table.error - ROUNDING
    if most <= 0.0:
        return None
    # Nodes are as dense as the pattern is sharp; by experience, and not too many to begin with.
    n = 2 * max(1, int(0.5 * CELLS_PER_NODE[degree] * table.per_px[1]))
    for _ in range(6):
        n_row = 2 * math.ceil(0.5 * n * table.pixel_aspect)
        if max(n, n_row) > MOST_CELLS:
            return None
        found = MARGIN * _core_error(table, degree, (n_row, n))
        if found <= most:
            return n_row, n
        n = max(n + 2, 2 * math.ceil(0.5 * n * min(8.0, (found / most) ** (1.0 / (degree + 1)))))
    return None


def cell_table(table: EpsfTable, degree: int, error: float, n_cell: tuple[int, int]) -> CellTable | None:
    """Fit polynomials to a table of nodes; None where more than MOST_CELLS would be needed."""
    while max(n_cell) <= MOST_CELLS:
        zero = side_pixels(table)[0], n_side_block(table) * TABLE_SIMD_WIDTH + TABLE_SIMD_WIDTH // 2
        coefficient, found = _all_fitted(table, degree, n_cell, zero)
        found = table.error + MARGIN * found + ROUNDING
        if found <= error:
            blocks = sliding_window_view(coefficient, TABLE_SIMD_WIDTH, axis=3)[:, :, :, ::BLOCK_PX].swapaxes(2, 3)
            shape_only = replace(table, fraction=table.fraction[:0])
            return CellTable(shape_only, degree, n_cell, np.ascontiguousarray(blocks), zero, found)
        n_cell = n_cell[0] + 2, n_cell[1] + 2
    return None


def _all_fitted(
    table: EpsfTable, degree: int, n_cell: tuple[int, int], zero: tuple[int, int]
) -> tuple[NDArray[np.float32], float]:
    """Return what _fitted does, of all cells that a table of polynomials holds and all its pixels."""
    rows = np.arange(-zero[0], zero[0] + 1)
    if not table.mirrored:
        cells = np.arange(n_cell[0]), np.arange(n_cell[1])
        return _fitted(table, degree, n_cell, cells, (rows, np.arange(_n_column(table)) - zero[1]))
    # Cells of dx < 0 are those of dx > 0 with the columns, and what is odd in dx, turned about.
    side = _n_column(table) - 1 - zero[1]
    cells = np.arange(n_cell[0] // 2, n_cell[0]), np.arange(n_cell[1] // 2, n_cell[1])
    right, found = _fitted(table, degree, n_cell, cells, (rows, np.arange(-side, side + 1)))
    odd = np.array([(-1) ** i for j in range(degree + 1) for i in range(degree + 1 - j)], np.float32)
    left = right[:, ::-1, :, ::-1] * odd
    return np.concatenate([left, right], axis=1)[:, :, :, side - zero[1] :], found


def _core_error(table: EpsfTable, degree: int, n_cell: tuple[int, int]) -> float:
    """Return the largest error of fits for pixels about the source, in cells in the middle and by the pixel's edge."""
    side = [min(CORE_PX, pixels) for pixels in side_pixels(table)]
    cells = [np.unique(np.clip([n // 2, n // 2 + 1, n - 3, n - 2, n - 1], 0, n - 1)) for n in n_cell]
    if not table.mirrored:
        cells = [np.union1d(some, n - 1 - some) for some, n in zip(cells, n_cell, strict=True)]
        side = [min(2 * CORE_PX, pixels) for pixels in side_pixels(table)]
    steps = np.arange(-side[0], side[0] + 1), np.arange(-side[1], side[1] + 1)
    return _fitted(table, degree, n_cell, (cells[0], cells[1]), steps)[1]


def _fitted(
    table: EpsfTable,
    degree: int,
    n_cell: tuple[int, int],
    cells: tuple[NDArray[np.int64], NDArray[np.int64]],
    steps: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> tuple[NDArray[np.float32], float]:
    """Return coefficients, shape (cell row, cell column, row, column, n_term), and the largest error at the points."""
    points, basis, fit = _fit(degree)
    n = len(points)
    offsets = ((cells[axis][:, None] + 0.5 * (points + 1.0)) / n_cell[axis] - 0.5 for axis in (0, 1))
    (row, down, row_served), (column, across, column_served) = (
        _nodes_and_weights(table, axis, offset, steps[axis]) for axis, offset in enumerate(offsets)
    )
    first, end = int(row.min()), int(row.max()) + table.n_point
    lines = _interpolated(np.ascontiguousarray(table.fraction[first:end].T, dtype=np.float64), column, across).T
    coefficient = np.empty((len(cells[0]), len(cells[1]), len(steps[0]), len(steps[1]), fit.shape[1]), np.float32)
    worst = 0.0
    for cell in range(len(cells[0])):
        rows = _interpolated(lines, row[cell] - first, down[:, cell])
        rows = rows.reshape(len(steps[0]), n, len(cells[1]), len(steps[1]), n)
        sample = rows.transpose(2, 0, 3, 1, 4).reshape(-1, n * n)
        fitted = (sample @ fit).astype(np.float32)
        kept = column_served[:, None, :] & row_served[cell][None, :, None]
        off = np.abs(fitted.astype(np.float64) @ basis.T - sample).max(axis=1).reshape(kept.shape)
        worst = max(worst, float(off.max(where=kept, initial=0.0)))
        coefficient[cell] = fitted.reshape(coefficient.shape[1:])
    return coefficient, worst


def _interpolated(values: F64, node: NDArray[np.int64], weight: F64) -> F64:
    """Interpolate along axis 0 of values (n_node, n) from nodes on, with weights (n_point, ...); shape (n_node, n)."""
    first = node.ravel()
    factor = weight.reshape(len(weight), -1, 1)
    total: F64 = values[first]
    total *= factor[0]
    for k in range(1, len(factor)):
        part = values[first + k]
        part *= factor[k]
        total += part
    return total


def _nodes_and_weights(
    table: EpsfTable, axis: int, offset_px: F64, step: NDArray[np.int64]
) -> tuple[NDArray[np.int64], F64, NDArray[np.bool_]]:
    """Return the interpolation of a table along an axis: first nodes, weights, and the pixels that the table serves.

    Offsets of the source's own pixel are (cell, point), steps the pixels from there; nodes are (cell, step, point),
    weights (n_point, cell, step, point), the mask is (cell, step).
    """
    offset = offset_px[:, None, :] + step[:, None]
    served = np.abs(offset[..., offset.shape[2] // 2]) < table.reach_px[axis]
    position = (np.abs(offset) if table.mirrored else offset) * table.per_px[axis] + table.zero[axis]
    before, n_node = table.n_point // 2 - 1, table.fraction.shape[axis]
    node = np.clip(np.floor(position).astype(np.int64), before, n_node - table.n_point + before)
    weight = lagrange_weights(np.clip(position - node, 0.0, 1.0), table.n_point)
    return node - before, np.stack(weight), served


@lru_cache(maxsize=8)
def _fit(degree: int) -> tuple[F64, F64, F64]:
    """Return points in [-1, 1], the basis at all pairs of them (n_pair, n_term), and the fit's matrix (n_pair, n_term).

    Pairs and terms run along columns fastest.
    """
    n = degree + N_MORE
    points = -np.cos(np.pi * np.arange(n) / (n - 1))
    value: F64 = chebvander(points, degree).astype(np.float64)
    pairs = [(j, i) for j in range(degree + 1) for i in range(degree + 1 - j)]
    basis: F64 = np.stack([np.outer(value[:, j], value[:, i]).ravel() for j, i in pairs], axis=1)
    return points, basis, np.ascontiguousarray(np.linalg.pinv(basis).T, dtype=np.float64)
