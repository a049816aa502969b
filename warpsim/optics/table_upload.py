"""Effective PSF tables on a device: one flat array for all bands, and a struct for each with the index of its parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.psf import TABLE_SIMD_WIDTH, TablePsf

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
