"""DLPack capsules of images with any number of axes, on the CPU and on CUDA, without a copy.

Warp's own capsules have at most four axes, and NumPy's are of the CPU only. A capsule is made here by NumPy, over an
array that stands for the memory and is never read, and then gets its address. So it is NumPy's code, which
knows about threads, pending exceptions and the end of the interpreter, that hands the memory back.
"""

from __future__ import annotations

import ctypes
from collections import deque
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.device_order import come_after_all

CPU, CUDA = 1, 2
"""Kinds of device in DLPack."""


class _DLTensor(ctypes.Structure):
    """The head of DLPack's DLTensor: as much as is changed."""

    _fields_ = (("data", ctypes.c_void_p), ("device_type", ctypes.c_int32), ("device_id", ctypes.c_int32))


_VERSIONED_HEAD = 32
"""Bytes before the tensor in DLManagedTensorVersioned: version, context, deleter, flags."""

_NAMES = {b"dltensor": 0, b"dltensor_versioned": _VERSIONED_HEAD}
"""Names of capsules, and the byte offset of the tensor in what they hold."""

# Prototypes of our own: others set those of ctypes.pythonapi.
_is_valid = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.py_object, ctypes.c_char_p)(("PyCapsule_IsValid", ctypes.pythonapi))
_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


class _Memory:
    """Memory of a Warp array that others hold; the array lives as long."""

    def __init__(self, array: wp.array, shape: tuple[int, ...]) -> None:
        self._array = array
        self.__array_interface__ = {
            "version": 3,
            "shape": shape,
            "typestr": np.dtype(wp.dtype_to_numpy(array.dtype)).str,
            "data": (array.ptr or 0, False),
        }

    def __del__(self) -> None:
        release_later(self._array)


_released: deque[wp.array] = deque()
"""Memory on CUDA that its last foreign holder has let go of, while work that reads it may still be queued."""


def release_later(array: wp.array) -> None:
    """Keep memory that CUDA may still read, as work of others may be queued, until `take_released`."""
    if array.device.is_cuda or array.pinned:
        _released.append(array)


def device_of(array: wp.array) -> tuple[int, int]:
    """Kind and number of the device, as DLPack has them; pinned memory is the CPU's."""
    return (CUDA, array.device.ordinal) if array.device.is_cuda else (CPU, 0)


def capsule(array: wp.array, shape: tuple[int, ...], max_version: tuple[int, int] | None = None) -> Any:
    """A capsule of a contiguous Warp array, as an array of another shape.

    Args:
        array: Kept alive until the consumer has let go of the capsule's memory.
        shape: Axes that the consumer sees.
        max_version: The newest version of DLPack that the consumer knows; None: one before 1.0.
    """
    stand_in: npt.NDArray[Any] = np.asarray(_Memory(array, shape))
    made = stand_in.__dlpack__() if max_version is None else stand_in.__dlpack__(max_version=max_version)
    for name, offset in _NAMES.items():
        if _is_valid(made, name):
            tensor = _DLTensor.from_address(_pointer(made, name) + offset)
            tensor.device_type, tensor.device_id = device_of(array)
    return made


def wait_for_images(array: wp.array, stream: int | None) -> None:
    """Make a consumer's stream wait for what Warp's stream has still to do with the array.

    Args:
        array: The images.
        stream: As DLPack's standard for Python says: None and 1 the default stream, 2 that of the thread, -1 no
            waiting, else a handle. On the CPU None.

    Raises:
        BufferError: A stream on the CPU.
    """
    if not array.device.is_cuda:
        if stream not in (None, -1):
            raise BufferError(f"stream: must be None for images on the CPU, got {stream!r}")
        return
    array.__dlpack__(stream=stream)  # Warp orders the streams, and makes a capsule that is not needed


def take_released() -> None:
    """Let memory go that others have let go of; what is done with it from now on comes after their work with it.

    A consumer may drop an array while kernels that read it wait on a stream of its own, whichever that is. So its
    memory is not used again before the device has done everything that was asked of it: the device itself waits. For
    pinned memory the host waits, as any device may copy from it. This is done here, rather than where the array died,
    as that may be anywhere: in a destructor, or amid the capture of a graph.
    """
    arrays = [_released.popleft() for _ in range(len(_released))]
    try:
        for device in {array.device for array in arrays if array.device.is_cuda}:
            come_after_all(device)
        if any(array.pinned for array in arrays):
            for device in wp.get_cuda_devices():
                wp.synchronize_device(device)
    except BaseException:  # as amid the capture of a graph
        _released.extend(arrays)
        raise
