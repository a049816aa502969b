"""Memory that results use one after the other, as new memory costs page faults: 0.1 to 0.3 ms for an image of 2 MB."""

from __future__ import annotations

import ctypes
import math
import sys
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

POOL_BYTES, POOL_BYTES_CUDA = 256 * 2**20, 8 * 2**30
"""Memory that waits for a result to need it, at most: on the CPU, and on CUDA."""

POOL_BYTES_PINNED = 2 * 2**30
"""The same in pinned host memory, which is worth more: it is made at some 2 GB/s, and copied to at 50."""

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
    """Return the pool of what devices render."""
    where = wp.get_device("cpu") if to_host else devices[0]
    pinned = to_host and devices[0].is_cuda
    if most_bytes is None:
        most_bytes = POOL_BYTES_CUDA if where.is_cuda else POOL_BYTES_PINNED if pinned else POOL_BYTES
    for device in devices:
        if device.is_cuda:
            wp.set_mempool_release_threshold(device, most_bytes)  # else it is given back at each wait
    return Pool(where, pinned, most_bytes)


@cache
def pinned_pool() -> Pool:
    """Return the pool of what is copied from GPUs to the host, of the whole process."""
    return Pool(wp.get_device("cpu"), True, POOL_BYTES_PINNED)


def _aligned(shape: tuple[int, ...]) -> npt.NDArray[np.uint8]:
    """Uninitialised bytes; by NumPy, as it asks for large pages."""
    n_byte = math.prod(shape)
    room = np.empty(n_byte + ALIGNMENT_BYTES, dtype=np.uint8)
    first = -room.ctypes.data % ALIGNMENT_BYTES
    return room[first : first + n_byte].reshape(shape)


_released: deque[wp.array] = deque()
"""Memory on CUDA that its last foreign holder has let go of, while work that reads it may still be queued."""


def release_later(array: wp.array) -> None:
    """Keep memory that CUDA may still read, as work of others may be queued, until `take_released`."""
    if array.device.is_cuda or array.pinned:
        _released.append(array)


def take_released() -> None:
    """Let memory go that others have let go of; what is done with it from now on comes after their work with it.

    A consumer may drop an array while kernels that read it wait on a stream of its own, whichever that is. So its
    memory is not used again before the device has done everything that was asked of it: the device itself waits. For
    pinned memory the host waits, as any device may copy from it. This is done here, rather than where the array died,
    as that may be anywhere: in a destructor, or amid the capture of a graph.
    """
    arrays = [_released.popleft() for _ in range(len(_released))]
    try:
        for device in {str(array.device): array.device for array in arrays if array.device.is_cuda}.values():
            come_after_all(device)
        if any(array.pinned for array in arrays):
            for device in wp.get_cuda_devices():
                wp.synchronize_device(device)
    except BaseException:  # as amid the capture of a graph
        _released.extend(arrays)
        raise


_DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"


def come_after_all(device: wp.Device) -> None:
    """Have a GPU's work from now on come after all that was asked of it before, by anyone and in any stream.

    From now on means: in blocking streams, such as Warp's, PyTorch's default stream, and the one in which memory is
    freed; they come after the null stream, which is made to wait here. It does not come after the others' non-blocking
    streams by itself, so it waits for an event of the whole device. The host waits only where the driver has no such
    events (before CUDA 12.5), or refuses one.
    """
    record, event = _record_of_context(), wp.Event(device)
    if record is None or device.is_capturing or record(device.context, event.cuda_event) != 0:
        wp.synchronize_device(device)
    else:
        with device.context_guard:  # the null stream is that of the thread's context
            device.null_stream.wait_event(event)


@cache
def _record_of_context() -> Callable[[Any, Any], int] | None:
    """Return the driver's cuCtxRecordEvent(context, event), 0 if it went well; None where the driver has none."""
    try:
        record = ctypes.CDLL(_DRIVER).cuCtxRecordEvent
    except (OSError, AttributeError):
        return None
    record.argtypes, record.restype = (ctypes.c_void_p, ctypes.c_void_p), ctypes.c_int
    return record
