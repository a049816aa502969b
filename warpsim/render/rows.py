"""Rows of bytes with arrays as their columns, so that one copy moves all that belongs to some views."""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Mapping
from typing import Any

import warp as wp

ALIGNMENT_BYTES = 8
"""Of every column, the most that a Warp type asks for."""


class RowLayout:
    """Arrays side by side in rows of bytes.

    Args:
        columns: Warp type and shape within a row of each array.
    """

    def __init__(self, columns: Mapping[str, tuple[Any, tuple[int, ...]]]) -> None:
        self._columns: dict[str, tuple[Any, tuple[int, ...], int]] = {}
        self.n_byte = 0
        """Bytes of a row."""
        for name, (dtype, shape) in columns.items():
            self._columns[name] = (dtype, shape, self.n_byte)
            n_byte = math.prod(shape) * wp.types.type_size_in_bytes(dtype)
            self.n_byte += -(-n_byte // ALIGNMENT_BYTES) * ALIGNMENT_BYTES

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def columns(self, rows: wp.array) -> dict[str, wp.array]:
        """All arrays in rows of bytes, shape (n_row, n_byte); nothing is copied, and the arrays keep the rows alive."""
        return {name: self.column(rows, name) for name in self._columns}

    def column(self, rows: wp.array, name: str) -> wp.array:
        """One of the arrays, shape (n_row, ...)."""
        dtype, inner, offset = self._columns[name]
        shape = (rows.shape[0], *inner)
        if math.prod(shape) == 0:
            return wp.empty(shape, dtype=dtype, device=rows.device)
        strides = [wp.types.type_size_in_bytes(dtype)]
        for length in reversed(inner[1:]):
            strides.append(strides[-1] * length)
        steps = (self.n_byte, *reversed(strides[: len(inner)]))
        keep = functools.partial(_let_go, rows)
        return wp.array(
            ptr=rows.ptr + offset, dtype=dtype, shape=shape, strides=steps, device=rows.device, deleter=keep
        )


def _let_go(rows: wp.array, address: int, n_byte: int) -> None:
    """Called when a column goes; until then, as its deleter, it has held the rows."""


def copy_rows(to: wp.array, to_first: int, source: wp.array, first: int, n_row: int, stream: Any = None) -> None:
    """Copy consecutive rows between contiguous arrays whose rows are alike, of any devices."""
    if not n_row or not source.size:
        return
    length = source.size // source.shape[0]
    if to.device.is_cpu and source.device.is_cpu:
        step = length * wp.types.type_size_in_bytes(source.dtype)  # a quarter of the Python that wp.copy is
        ctypes.memmove(to.ptr + to_first * step, source.ptr + first * step, n_row * step)
    else:
        wp.copy(to, source, to_first * length, first * length, n_row * length, stream=stream)
