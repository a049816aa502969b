"""Effective PSF tables: how point spread functions are drawn at the least cost, and a small store of tables."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar, cast

import numpy as np
from warpsim_kernels.table_layout import CELL_DEGREES, TableLayout, n_term_of

from warpsim.errors import InputError
from warpsim.optics.airy import airy_table, airy_table_shapes
from warpsim.optics.cell_table import CELLS_PER_NODE, CellTable, cell_bytes, cell_table, cells_for
from warpsim.optics.epsf_table import LARGEST_N_NODE, POINTS, EpsfTable
from warpsim.optics.image_table import SplineImage, image_table, image_table_shape, spline_of
from warpsim.optics.pattern import FIRST_DARK_RING, AiryPattern
from warpsim.optics.psf import PsfAiry, PsfTable

ERROR_RANGE = (6e-7, 1e-2)
"""Fraction of the flux per pixel; float32 fractions, weights and sums allow no less."""
DEFAULT_ERROR = 6e-7

NODE_PART, NODE_POINTS = 0.6, 8
"""Part of the error that the nodes may have to which polynomials are fitted, and their points per axis."""

LARGEST_CELL_BYTES = 24_000_000
"""Largest size of the polynomials of a pattern."""

LEAST_OVER_GUESS = 4.0
"""That size over the guess from the nodes per pixel, at least: 4 to 15 for patterns of 0.1 to 10 px."""

STORE_BYTES = 256 * 2**20
"""Tables kept for the next renderer; the largest single one has 48 MB, polynomials for 20 bands some 160 MB."""

TabulatedPsf = PsfAiry | PsfTable

Table = TypeVar("Table", EpsfTable, CellTable)


_STORE: OrderedDict[tuple[object, ...], EpsfTable | CellTable] = OrderedDict()
"""The tables used last, up to STORE_BYTES."""
_LOCK = threading.Lock()


def _stored(key: tuple[object, ...], make: Callable[[], Table]) -> Table:
    """The table of a key, made where it is not at hand."""
    with _LOCK:
        if key in _STORE:
            _STORE.move_to_end(key)
            return cast(Table, _STORE[key])
    table = make()
    with _LOCK:
        _STORE[key] = table
        while len(_STORE) > 1 and sum(kept.n_byte for kept in _STORE.values()) > STORE_BYTES:
            _STORE.popitem(last=False)
    return table


@dataclass(frozen=True, slots=True)
class TableAccuracy:
    """Accuracy required of tables."""

    error: float = DEFAULT_ERROR
    """Largest error per pixel and unit flux."""

    n_point: int | None = None
    """Points per axis of an interpolation between nodes; None: chosen by cost."""

    degree: int | None = None
    """Total degree of the polynomials that are drawn, 0: nodes; None: the lowest that does, or nodes with n_point."""


def epsf_table(
    psf: TabulatedPsf, pixel_aspect: float = 1.0, error: float = DEFAULT_ERROR, n_point: int | None = None
) -> EpsfTable:
    """Return the table of pixel fractions of a point spread function; it is built once, as long as it is in use."""
    n_point = cheapest_points([psf], pixel_aspect, error) if n_point is None else n_point
    _check(pixel_aspect, error, n_point)
    return _nodes(psf, pixel_aspect, error, n_point, np.float32)


def _nodes(psf: TabulatedPsf, pixel_aspect: float, error: float, n_point: int, real: type) -> EpsfTable:
    def make() -> EpsfTable:
        if isinstance(psf, PsfAiry):
            return airy_table(_airy_pattern(psf), pixel_aspect, error, n_point, real)
        return image_table(_spline(psf, pixel_aspect), error, n_point, real)

    return _stored((psf, pixel_aspect, error, n_point, real), make)


def fitted_nodes(psf: TabulatedPsf, pixel_aspect: float, error: float) -> EpsfTable | None:
    """Return the table of nodes that polynomials are fitted to; None where there is none."""
    try:
        return _nodes(psf, pixel_aspect, NODE_PART * error, NODE_POINTS, np.float64)
    except InputError:
        return None


def polynomials(psf: TabulatedPsf, pixel_aspect: float, error: float, degree: int) -> CellTable:
    """Return the polynomials that a point spread function is drawn with; they are fitted once, as long as in use."""
    _check(pixel_aspect, error, NODE_POINTS)

    def make() -> CellTable:
        nodes, n_cell = fitted_nodes(psf, pixel_aspect, error), _cells(psf, pixel_aspect, error, degree)
        table = None if nodes is None or n_cell is None else cell_table(nodes, degree, error, n_cell)
        if table is None:
            raise InputError(f"an error of {error:g} needs too many cells; allow more").of("psf tables")
        with _LOCK:  # nodes are needed no more
            _STORE.pop((psf, pixel_aspect, NODE_PART * error, NODE_POINTS, np.float64), None)
        return table

    return _stored((psf, pixel_aspect, error, degree, "cells"), make)


def drawn_tables(
    psfs: Sequence[TabulatedPsf], pixel_aspect: float, accuracy: TableAccuracy
) -> tuple[TableLayout, list[EpsfTable | CellTable]]:
    """Return the tables that patterns are drawn with by one kernel, and their layout; made once, as long as in use."""
    layout, error = cheapest_layout(psfs, pixel_aspect, accuracy), accuracy.error
    if layout.degree:
        return layout, [polynomials(psf, pixel_aspect, error, layout.degree) for psf in psfs]
    return layout, [epsf_table(psf, pixel_aspect, error, layout.n_point) for psf in psfs]


def cheapest_layout(
    psfs: Sequence[TabulatedPsf], pixel_aspect: float = 1.0, accuracy: TableAccuracy | None = None
) -> TableLayout:
    """Return what the tables of patterns hold that are drawn with one kernel.

    Polynomials of the lowest degree that does not fill too many cells; where all do, nodes with the points per axis
    with which drawing costs least. Polynomials draw most patterns 1.1 to 1.3 times as fast
    (benchmarks/test_deposit.py), and some below 0.1 px or above 10 px, or with errors of 1e-3 and more, up to 15 %
    slower.
    """
    accuracy = accuracy or TableAccuracy()
    _check(pixel_aspect, accuracy.error, POINTS[0])
    if accuracy.degree:
        return TableLayout(accuracy.degree)
    if accuracy.degree is None and accuracy.n_point is None:
        degree = _lowest_degree(psfs, pixel_aspect, accuracy.error)
        if degree:
            return TableLayout(degree)
    return TableLayout(0, accuracy.n_point or cheapest_points(psfs, pixel_aspect, accuracy.error))


def _lowest_degree(psfs: Sequence[TabulatedPsf], pixel_aspect: float, error: float) -> int:
    """Return the lowest degree with which polynomials are not too large, as fewer terms are faster; 0 where none is."""
    degree: int
    for degree in CELL_DEGREES:
        if all(_have_cells(psf, pixel_aspect, error, degree) for psf in psfs):
            return degree
    return 0


@lru_cache(maxsize=256)
def _have_cells(psf: TabulatedPsf, pixel_aspect: float, error: float, degree: int) -> bool:
    """Return whether the polynomials of a degree are not too large; a guess first, as fits take time."""
    (n_row, n_column), per_px = _node_shapes(psf, pixel_aspect, error)[NODE_POINTS]
    is_airy, nodes_per_px2 = isinstance(psf, PsfAiry), per_px[0] * per_px[1]
    n_pixel = (4 if is_airy else 1) * n_row * n_column / nodes_per_px2  # an Airy pattern's nodes are a quadrant
    n_cell = CELLS_PER_NODE[degree] ** 2 * nodes_per_px2 / (2 if is_airy else 1)  # and its cells a half
    guess_bytes = 2 * 4 * n_term_of(degree) * n_cell * n_pixel  # blocks of pixels overlap by half
    if LEAST_OVER_GUESS * guess_bytes > LARGEST_CELL_BYTES:
        return False
    nodes, cells = fitted_nodes(psf, pixel_aspect, error), _cells(psf, pixel_aspect, error, degree)
    return nodes is not None and cells is not None and cell_bytes(nodes, degree, cells) <= LARGEST_CELL_BYTES


@lru_cache(maxsize=256)
def _cells(psf: TabulatedPsf, pixel_aspect: float, error: float, degree: int) -> tuple[int, int] | None:
    """Return the cells per pixel that a degree takes, along rows and columns; None if there is no table of nodes."""
    nodes = fitted_nodes(psf, pixel_aspect, error)
    return None if nodes is None else cells_for(nodes, degree, error)


def cheapest_points(psfs: Sequence[TabulatedPsf], pixel_aspect: float = 1.0, error: float = DEFAULT_ERROR) -> int:
    """Return the points per axis with which drawing costs least, for patterns that are drawn with one kernel."""
    _check(pixel_aspect, error, POINTS[0])
    costs = {}
    for n_point in POINTS:
        sizes = [_node_counts(psf, pixel_aspect, error, n_point) for psf in psfs]
        if all(1.1 * n_node <= LARGEST_N_NODE for n_node, _ in sizes):
            costs[n_point] = sum(_cost_ns(n_point, n_node, n_hot) for n_node, n_hot in sizes)
    if not costs:
        raise InputError(f"an error of {error:g} needs more than {LARGEST_N_NODE} nodes; allow more").of("psf tables")
    return min(costs, key=lambda n_point: costs[n_point])


def _cost_ns(n_point: int, n_node: int, n_hot: int) -> float:
    """Time per pixel, from measurements on a CPU; tables beyond the caches cost more, above all their middle.

    n_hot counts the nodes that the stamps of faint sources read. Between two points per axis there is so little
    arithmetic that the time is that of the reads, as soon as they are too many for the first cache.
    """
    reads = max(0.0, n_hot - N_NODE_FIRST_CACHE) / 5e4 if n_point == 2 else 0.0
    return (4.5 + 0.17 * n_point**2) * (1.0 + n_node / 4e6 + n_hot / 1e6 + reads)


N_NODE_FIRST_CACHE = 12_000
"""Nodes of 48 kB."""

HOT_PX = 4.0
"""Half-width of most stamps."""


@lru_cache(maxsize=64)
def _node_shapes(
    psf: TabulatedPsf, pixel_aspect: float, error: float
) -> dict[int, tuple[tuple[int, int], tuple[int, int]]]:
    """Return shape and nodes per pixel of the tables of each order, by estimate."""
    if isinstance(psf, PsfAiry):
        return airy_table_shapes(_airy_pattern(psf), pixel_aspect, error)
    return {n: image_table_shape(_spline(psf, pixel_aspect), error, n) for n in POINTS}


def _node_counts(psf: TabulatedPsf, pixel_aspect: float, error: float, n_point: int) -> tuple[int, int]:
    """Return the nodes of a table, and those that most stamps read, a quadrant where the table is one; by estimate."""
    (n_row, n_column), per_px = _node_shapes(psf, pixel_aspect, error)[n_point]
    hot_px2 = int((1 if isinstance(psf, PsfAiry) else 4) * HOT_PX**2)
    return n_row * n_column, min(n_row * n_column, per_px[0] * per_px[1] * hot_px2)


def _airy_pattern(psf: PsfAiry) -> AiryPattern:
    lamf_px = tuple(radius / FIRST_DARK_RING for radius in psf.radii_px)
    return AiryPattern(lamf_px, psf.parts, psf.obscuration, psf.blur_px)


@lru_cache(maxsize=4)
def _spline(psf: PsfTable, pixel_aspect: float) -> SplineImage:
    return spline_of(psf.image, psf.oversample, psf.smear_px, pixel_aspect)


def _check(pixel_aspect: float, error: float, n_point: int) -> None:
    if not 0.1 <= pixel_aspect <= 10.0:
        raise InputError("must be in [0.1, 10]", "pixel_aspect", pixel_aspect).of("psf tables")
    low, high = ERROR_RANGE
    if not low <= error <= high:
        raise InputError(f"must be in [{low:g}, {high:g}]", "error", error).of("psf tables")
    if n_point not in POINTS:
        raise InputError(f"must be one of {', '.join(map(str, POINTS))}", "n_point", n_point).of("psf tables")
