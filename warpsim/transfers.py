"""Arrays from devices to the host, on streams that are named, after the events that they hang on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

PINNED_FROM_BYTES = 2**22
"""Smaller arrays are copied to ordinary memory: pinned memory costs more to make and free than they take."""


def to_numpy(array: wp.array) -> npt.NDArray[Any]:
    """Return an array on the host: a view on the CPU; from CUDA a copy, in the order of the device's current stream.

    Warp's own `numpy` changes the current stream of the whole process while it copies.
    """
    if not array.device.is_cuda:
        return np.asarray(array.numpy())
    n_byte = array.size * wp.types.type_size_in_bytes(array.dtype)
    host = wp.empty(array.shape, dtype=array.dtype, device="cpu", pinned=n_byte >= PINNED_FROM_BYTES)
    stream = wp.get_stream(array.device)
    wp.copy(host, array, stream=stream)
    wp.synchronize_stream(stream)
    return np.asarray(host.numpy())


def wait_on_current_stream(ready: wp.Event | None, device: wp.Device) -> None:
    """Have what is asked of a device's current stream from now on come after an event; without one do nothing.

    The current stream may be another one with each call: somebody may have set it since the event was recorded.
    """
    if ready is not None:
        wp.get_stream(device).wait_event(ready)


def host_arrays(arrays: Iterable[wp.array]) -> list[wp.array]:
    """Return arrays in host memory that are like others: pinned for those of GPUs, themselves on the CPU."""
    return [
        wp.empty(array.shape, dtype=array.dtype, device="cpu", pinned=True) if array.device.is_cuda else array
        for array in arrays
    ]
