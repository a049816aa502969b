"""Tables of point spread functions on a device: effective PSFs of patterns, edge tables of Gaussians."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.canvas import mask_table
from warpsim_kernels.deposit_gaussian import GAUSSIAN_SIMD_WIDTH, EdgeTable, GaussianPsf
from warpsim_kernels.psf import TABLE_SIMD_WIDTH, TablePsf

from warpsim.arrays import F64
from warpsim.optics.cell_table import BLOCK_PX, CellTable, n_side_block
from warpsim.optics.epsf_table import EpsfTable

ALIGNED = 16
"""Floats of a cache line: tables begin with one."""


def upload_tables(tables: Sequence[EpsfTable | CellTable], device: Any) -> tuple[wp.array, wp.array]:
    """Put tables on a device.

    Returns:
        The tables' structs (TablePsf), shape (n_table,), and the flat array of fractions and envelopes.
    """
    structs: list[Any] = []
    parts: list[npt.NDArray[np.float32]] = []
    start = 0
    for table in tables:
        struct, fraction = _polynomials(table) if isinstance(table, CellTable) else _nodes(table)
        source = table.nodes if isinstance(table, CellTable) else table
        struct.start, struct.envelope = start, start + fraction.size
        struct.mirrored = int(source.mirrored)
        struct.reach_row_px, struct.reach_column_px = source.reach_px
        struct.pixel_aspect = source.pixel_aspect
        struct.wing_px3, struct.wing_next_px2, struct.wing_aspect_px2, struct.wing_last_px4 = source.wing
        struct.n_envelope = len(source.envelope)
        struct.tail_px3 = source.tail_px3
        structs.append(struct)
        parts += [fraction.ravel(), source.envelope]
        parts.append(np.zeros(-sum(map(len, parts[-2:])) % ALIGNED, dtype=np.float32))
        start += sum(map(len, parts[-3:]))
    flat = wp.array(np.concatenate(parts), dtype=wp.float32, device=device)
    return wp.array(structs, dtype=TablePsf, device=device), flat


def _nodes(table: EpsfTable) -> tuple[Any, npt.NDArray[np.float32]]:
    """Return the struct of a table of nodes, and the fractions in the order in which stamps are drawn."""
    fraction, zero_pixel = by_block(table)
    struct: Any = TablePsf()
    struct.n_row, struct.n_block, struct.n_phase, struct.block_px = fraction.shape
    struct.row_per_px, struct.column_per_px = table.per_px
    struct.zero_row, struct.zero_phase, struct.zero_pixel = table.zero[0], table.per_px[1] // 2, zero_pixel
    return struct, fraction


def _polynomials(table: CellTable) -> tuple[Any, npt.NDArray[np.float32]]:
    """Return the struct of a table of polynomials, and their coefficients."""
    struct: Any = TablePsf()
    struct.n_block, struct.n_row = table.coefficient.shape[2:4]
    struct.block_px = BLOCK_PX
    struct.row_per_px, struct.column_per_px = table.n_cell
    struct.zero_row, struct.zero_pixel = table.zero
    return struct, table.coefficient


def by_block(table: EpsfTable) -> tuple[npt.NDArray[np.float32], int]:
    """Return a table in the order in which stamps are drawn.

    Returns:
        Pixel fractions (n_row, n_block, n_phase, TABLE_SIMD_WIDTH), and the index of the source's own pixel in all
        blocks: the pixels of a small stamp lie about the middle of one. Phase 0 is the first node that an interpolation
        takes for a source half a pixel from the pixel's centre; there are as many as it takes at most.
    """
    per_px, zero = table.per_px[1], table.zero[1]
    n_side = n_side_block(table)
    zero_pixel = n_side * TABLE_SIMD_WIDTH + TABLE_SIMD_WIDTH // 2
    pixel = np.arange((2 * n_side + 1) * TABLE_SIMD_WIDTH).reshape(-1, TABLE_SIMD_WIDTH) - zero_pixel
    phase = np.arange(per_px + table.n_point) - per_px // 2 - (table.n_point // 2 - 1)
    node = phase[:, None] + per_px * pixel[:, None, :]
    column = np.clip((np.abs(node) if table.mirrored else node) + zero, 0, table.fraction.shape[1] - 1)
    return table.fraction[:, column], zero_pixel


def overlapping(flat: wp.array, length: int) -> wp.array:
    """Return the same memory as an array of vectors of `length` floats, one from every float on."""
    return wp.array(
        ptr=flat.ptr,
        dtype=wp.types.vector(length=length, dtype=wp.float32),
        shape=(max(flat.size - length + 1, 0),),
        strides=(4,),
        device=flat.device,
        deleter=lambda address, size: flat.ptr,  # keeps the memory as long as this array is held
    )


STEPS_PER_SIGMA = 64
"""Cubic interpolation errs by 0.013 / 64^4 = 8e-10 of the light, and far out, at z sigma, by 0.023 (z / 64)^4 of what
is there: 6e-6 at z = 8.2."""
MOST_SIGMA = 8.5
"""Stamps end before: 1e-15 of the light lies beyond 8 sigma."""
LEAST_FRACTION = 1e-25
"""Smaller ones are zero: products of such numbers are slow on CPUs."""
LEAST_STEPS = 4
"""Per pixel, for the widest Gaussians."""


@lru_cache(maxsize=64)
def axis_table(sigma_px: float) -> tuple[npt.NDArray[np.float32], int, int, int]:
    """Pixel fractions, by offset of the edge nearest to the source, and how to read them.

    Args:
        sigma_px: Standard deviation [px].

    Returns:
        Fractions (2 n_step + 4, n_pixel), read-only; the row of the offset k / per_px is n_step + 1 + k, and the pixel
        after the edge is n_pixel / 2. Then n_step, per_px, n_pixel.
    """
    per_px = max(math.ceil(STEPS_PER_SIGMA / sigma_px), LEAST_STEPS)
    n_step = math.ceil(min(0.5, (MOST_SIGMA + 0.5) * sigma_px) * per_px)
    half = math.ceil(MOST_SIGMA * sigma_px) + 2
    offset_px = np.arange(-n_step - 1, n_step + 3) / per_px
    edge = (offset_px[:, None] + np.arange(-half, half + 1)) / sigma_px
    tail = _tail(np.abs(edge))
    low, high = edge[:, :-1], edge[:, 1:]
    between = np.where(low * high > 0.0, np.abs(tail[:, 1:] - tail[:, :-1]), 1.0 - tail[:, 1:] - tail[:, :-1])
    fraction = np.where(between < LEAST_FRACTION, 0.0, between).astype(np.float32)
    fraction.setflags(write=False)
    return fraction, n_step, per_px, 2 * half


def _tail(z: F64) -> F64:
    """Part of a unit Gaussian beyond z standard deviations."""
    tail = np.zeros_like(z)
    near = z < 12.0
    tail[near] = [0.5 * math.erfc(value) for value in z[near] * math.sqrt(0.5)]
    return tail


def upload_gaussians(sigmas_px: Sequence[tuple[float, float]], device: Any) -> tuple[wp.array, wp.array]:
    """Put tables on a device.

    Args:
        sigmas_px: Of each band, along columns [pixel widths] and along rows [pixel heights].
        device: Where they are put.

    Returns:
        The bands' structs (GaussianPsf), shape (n_band,), and the flat array of mask_table and fractions, float32.
    """
    # The mask is a margin, too: vectors may begin before a table and end behind it.
    mask = np.array(mask_table(GAUSSIAN_SIMD_WIDTH), dtype=np.float32)
    starts, parts, n = {}, [mask], len(mask)
    for sigma_px in sorted({sigma for pair in sigmas_px for sigma in pair}):
        fraction = axis_table(sigma_px)[0]
        starts[sigma_px] = n
        parts.append(fraction.ravel())
        n += fraction.size
    flat = wp.array(np.concatenate([*parts, mask]), dtype=wp.float32, device=device)
    structs = []
    for pair in sigmas_px:
        psf: Any = GaussianPsf()
        psf.sigma_px = wp.vec2(*pair)
        psf.columns, psf.rows = (_edge_table(sigma_px, starts[sigma_px]) for sigma_px in pair)
        structs.append(psf)
    return wp.array(structs, dtype=GaussianPsf, device=device), flat


def _edge_table(sigma_px: float, start: int) -> Any:
    _, n_step, per_px, n_pixel = axis_table(sigma_px)
    table: Any = EdgeTable()
    table.start = start + (n_step + 1) * n_pixel + n_pixel // 2
    table.n_pixel = n_pixel
    table.n_step = n_step
    table.per_px = per_px
    return table
