"""Share tables for point spread functions: which order of interpolation is cheapest, and a small store of tables."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from warpsim.errors import InputError
from warpsim.optics.airy import airy_table, airy_table_shapes
from warpsim.optics.image_table import image_table, image_table_shape
from warpsim.optics.pattern import FIRST_DARK_RING, AiryPattern
from warpsim.optics.psf import PsfAiry, PsfTable
from warpsim.optics.share_table import LARGEST_N_NODE, POINTS, ShareTable
from warpsim.optics.spline_image import SplineImage, spline_of

ERROR_RANGE = (6e-7, 1e-2)
"""Fraction of the flux per pixel; float32 shares, weights and sums allow no less."""
DEFAULT_ERROR = 6e-7

STORE_BYTES = 128 * 2**20
"""Tables kept for the next renderer; the largest single one has 48 MB."""

TabulatedPsf = PsfAiry | PsfTable


class _Store:
    """The tables used last, up to STORE_BYTES."""

    def __init__(self) -> None:
        self._tables: OrderedDict[tuple[object, ...], ShareTable] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, key: tuple[object, ...]) -> ShareTable | None:
        with self._lock:
            if key in self._tables:
                self._tables.move_to_end(key)
            return self._tables.get(key)

    def put(self, key: tuple[object, ...], table: ShareTable) -> None:
        with self._lock:
            self._tables[key] = table
            while len(self._tables) > 1 and sum(kept.n_byte for kept in self._tables.values()) > STORE_BYTES:
                self._tables.popitem(last=False)


_STORE = _Store()


@dataclass(frozen=True, slots=True)
class TableAccuracy:
    """How good tables have to be."""

    error: float = DEFAULT_ERROR
    """Largest error per pixel and unit flux."""

    n_point: int | None = None
    """Points per axis of the interpolation; None is the cheapest."""


def share_table(
    psf: TabulatedPsf, pixel_aspect: float = 1.0, error: float = DEFAULT_ERROR, n_point: int | None = None
) -> ShareTable:
    """Return the table of pixel shares of a point spread function; it is built once, as long as it is in use.

    Args:
        psf: Pattern, lengths in pixel widths.
        pixel_aspect: Height of a pixel over its width.
        error: Largest error per pixel and unit flux, 6e-7 to 0.01.
        n_point: Points per axis of the interpolation, 2, 4, 6 or 8; None is the cheapest.

    Raises:
        InputError: A value breaks its rule, or the table would be too large.
    """
    n_point = cheapest_points([psf], pixel_aspect, error) if n_point is None else n_point
    _check(pixel_aspect, error, n_point)
    key = psf, pixel_aspect, error, n_point
    table = _STORE.get(key)
    if table is None:
        if isinstance(psf, PsfAiry):
            table = airy_table(_airy_pattern(psf), pixel_aspect, error, n_point)
        else:
            table = image_table(_spline(psf, pixel_aspect), error, n_point)
        _STORE.put(key, table)
    return table


def cheapest_points(psfs: Sequence[TabulatedPsf], pixel_aspect: float = 1.0, error: float = DEFAULT_ERROR) -> int:
    """Return the points per axis with which drawing costs least, for patterns that are drawn with one kernel.

    Raises:
        InputError: No order does with tables that are not too large.
    """
    _check(pixel_aspect, error, POINTS[0])
    costs = {}
    for n_point in POINTS:
        sizes = [_shapes(psf, pixel_aspect, error)[n_point] for psf in psfs]
        if all(1.1 * n_row * n_col <= LARGEST_N_NODE for n_row, n_col, _ in sizes):
            costs[n_point] = sum(_cost_ns(n_point, n_row * n_col, n_hot) for n_row, n_col, n_hot in sizes)
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
def _shapes(psf: TabulatedPsf, pixel_aspect: float, error: float) -> dict[int, tuple[int, int, int]]:
    """Return rows, columns and hot nodes of the tables of each order, by estimate."""
    if isinstance(psf, PsfAiry):
        shapes = airy_table_shapes(_airy_pattern(psf), pixel_aspect, error)
    else:
        shapes = {n: image_table_shape(_spline(psf, pixel_aspect), error, n) for n in POINTS}
    return {
        n: (*shape, min(shape[0] * shape[1], per_px[0] * per_px[1] * _hot_px2(psf)))
        for n, (shape, per_px) in shapes.items()
    }


def _hot_px2(psf: TabulatedPsf) -> int:
    """Area of the table that most stamps read [px2]: a quadrant where the table is one."""
    return int(HOT_PX**2) if isinstance(psf, PsfAiry) else int(4 * HOT_PX**2)


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
