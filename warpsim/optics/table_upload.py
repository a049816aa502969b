"""Share tables on a device: one flat array for all bands, and a struct for each that says where its parts are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.psf import TablePsf, table_functions

from warpsim.optics.share_table import ShareTable

MOST_LANES = 8


def upload_tables(tables: Sequence[ShareTable], device: Any) -> tuple[wp.array, wp.array]:
    """Put tables on a device.

    Returns:
        The tables' structs (TablePsf), shape (n_table,), and the flat array of shares and envelopes, float32.
    """
    structs, parts, start = [], [], 0
    for table in tables:
        struct: Any = TablePsf()
        struct.start = start
        struct.n_row, struct.n_column = table.share.shape
        struct.row_per_px, struct.column_per_px = table.per_px
        struct.zero_row, struct.zero_column = table.zero
        struct.mirrored = int(table.mirrored)
        struct.reach_row_px, struct.reach_column_px = table.reach_px
        struct.pixel_aspect = table.pixel_aspect
        struct.wing_px3, struct.wing_next_px2, struct.wing_aspect_px2, struct.wing_last_px4 = table.wing
        struct.envelope = start + table.share.size
        struct.n_envelope = len(table.envelope)
        struct.tail_px3 = table.tail_px3
        structs.append(struct)
        parts += [table.share.ravel(), table.envelope]
        start += table.share.size + len(table.envelope)
    parts.append(np.zeros(MOST_LANES, dtype=np.float32))  # what a load at the end may reach
    flat = wp.array(np.concatenate(parts), dtype=wp.float32, device=device)
    return wp.array(structs, dtype=TablePsf, device=device), flat


def lanes_of(flat: wp.array, n_point: int) -> wp.array:
    """The same memory as an array of vectors, one from every float on: neighbours in a row come in one load."""
    n_lane = table_functions(n_point).n_lane
    return wp.array(
        ptr=flat.ptr,
        dtype=wp.types.vector(length=n_lane, dtype=wp.float32),
        shape=(flat.size - n_lane + 1,),
        strides=(4,),
        device=flat.device,
    )
