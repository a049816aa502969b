"""Memory that results use one after the other, as new memory costs page faults: 0.1 to 0.3 ms for an image of 2 MB."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.render.dlpack import take_released

POOL_BYTES, POOL_BYTES_CUDA = 256 * 2**20, 8 * 2**30
"""Memory that waits for a result to need it, at most: on the CPU, and on CUDA."""

ALIGNMENT_BYTES = 64
"""Host memory begins at a multiple: JAX shares no other, but copies it."""

ROW_BYTES = 4096
"""Blocks of 2 GiB and more are whole rows of so many bytes."""


class Pool:
    """Arrays whose memory comes back once their last holder has gone: the array, its slices, NumPy and DLPack views.

    Args:
        device: Where the arrays are.
        pinned: Whether host memory is pinned, for copies from CUDA that overlap with its work.
        most_bytes: Memory kept for later arrays; what comes back beyond it is freed.
    """

    def __init__(self, device: wp.Device, pinned: bool = False, most_bytes: int = POOL_BYTES) -> None:
        self.device, self.most_bytes = device, most_bytes
        self._pinned = pinned
        # A block may come back at any moment, even within the methods here: arrays die where the garbage collector
        # runs. Appending to a deque needs no lock; only `new` looks at what is there.
        self._returned: deque[wp.array] = deque()

    @property
    def n_byte(self) -> int:
        """Bytes that wait."""
        return sum(int(block.size) for block in tuple(self._returned))

    def new(self, shape: tuple[int, ...], dtype: Any) -> wp.array:
        """An uninitialised array; nobody else holds its memory."""
        n_byte = math.prod(shape) * wp.types.type_size_in_bytes(dtype)
        if n_byte == 0:
            return wp.empty(shape, dtype=dtype, device=self.device)
        take_released()
        block = self._block(n_byte)
        return wp.array(
            ptr=block.ptr,
            dtype=dtype,
            shape=shape,
            device=self.device,
            pinned=self._pinned,
            deleter=lambda address, size: self._take_back(block),
        )

    def _take_back(self, block: wp.array) -> None:
        self._returned.append(block)
        while self.n_byte > self.most_bytes:
            try:
                self._returned.popleft()  # the one that has waited longest
            except IndexError:
                return

    def _block(self, n_byte: int) -> wp.array:
        """A block that waits and is large enough, but not twice as large; else a new one."""
        for _ in range(len(self._returned)):
            try:
                block = self._returned.popleft()
            except IndexError:
                break
            if n_byte <= block.size <= 2 * n_byte:
                return block
            self._returned.append(block)
        # No axis of an array is longer than 2**31 - 1.
        shape = (n_byte,) if n_byte < 2**31 else (-(-n_byte // ROW_BYTES), ROW_BYTES)
        if self.device.is_cpu and not self._pinned:
            return wp.array(_aligned(shape), dtype=wp.uint8, device=self.device, copy=False)
        return wp.empty(shape, dtype=wp.uint8, device=self.device, pinned=self._pinned)


def pool_of(devices: Sequence[wp.Device], to_host: bool, most_bytes: int | None) -> Pool:
    """Return the pool of what devices render.

    Args:
        devices: They share the work.
        to_host: Whether results are in host memory, pinned where the devices are GPUs.
        most_bytes: Memory kept for later arrays; chosen by the device when left out.
    """
    where = wp.get_device("cpu") if to_host else devices[0]
    if most_bytes is None:
        most_bytes = POOL_BYTES_CUDA if where.is_cuda else POOL_BYTES
    for device in devices:
        if device.is_cuda:
            wp.set_mempool_release_threshold(device, most_bytes)  # else it is given back at each wait
    return Pool(where, to_host and devices[0].is_cuda, most_bytes)


def _aligned(shape: tuple[int, ...]) -> npt.NDArray[np.uint8]:
    """Uninitialised bytes; by NumPy, as it asks for large pages."""
    n_byte = math.prod(shape)
    room = np.empty(n_byte + ALIGNMENT_BYTES, dtype=np.uint8)
    first = -room.ctypes.data % ALIGNMENT_BYTES
    return room[first : first + n_byte].reshape(shape)
