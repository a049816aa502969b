"""Memory that the threads of a block share: access that Warp's tiles lack.

A shared tile as an array, whose elements single threads read and write, and a barrier. Between what one thread writes
and another reads there must be a barrier, which all threads of the block must reach. On the CPU a block is one thread,
but with `warp.config.enable_cpu_blocks`.

Arrays of Warp count negative indices from the end and may have gaps. What is read and written most goes without.
"""

import functools
from typing import Any, NamedTuple

import warp as wp


@wp.func_native(snippet="WP_TILE_SYNC();")
def wait_for_block():
    """Wait until all threads of the block are here, and what they wrote is there."""


@wp.func_native(snippet="return WP_TILE_THREAD_IDX;")
def thread_of_block() -> int:
    """Number of this thread in its block; 0 on the CPU, which the compiler knows there."""


@functools.cache
def address_function(dtype: Any, length: int) -> Any:
    """Function that returns the address of a shared tile; `wp.array(ptr=...)` makes an array of it."""

    @wp.func_native(snippet="return (wp::uint64)tile.data.ptr;")
    def address(tile: wp.tile(dtype=dtype, shape=(length,), storage="shared")) -> wp.uint64:
        """Address of the first element."""

    return address


class ElementFunctions(NamedTuple):
    """Functions by which single threads read and write a shared tile of floats; elements are counted from 0."""

    element: Any
    """(tile, i: uint32) -> float."""

    add_to: Any
    """(tile, i: int, more: float): add to an element, which no other thread may do at the time."""


@functools.cache
def element_functions(length: int) -> ElementFunctions:
    """The functions of tiles of a length."""

    @wp.func_native(snippet="return tile.data.ptr[i];")
    def element(tile: wp.tile(dtype=float, shape=(length,), storage="shared"), i: wp.uint32) -> float:
        """Element i."""

    @wp.func_native(snippet="tile.data.ptr[i] += more;")
    def add_to(tile: wp.tile(dtype=float, shape=(length,), storage="shared"), i: int, more: float):
        """Add to element i."""

    return ElementFunctions(element, add_to)


@wp.func_native(snippet="return array.data[i];")
def load(array: wp.array[float], i: int) -> float:
    """Element i, from 0 on, of an array without gaps."""


@wp.func_native(snippet="array.data[i] = value;")
def store(array: wp.array[wp.uint16], i: wp.uint64, value: wp.uint16):
    """Set element i, from 0 on, of an array without gaps."""
