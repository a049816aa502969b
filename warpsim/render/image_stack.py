"""Images of a render call as one array with named axes.

Warp arrays have at most four axes; images have five: (frame, sensor, band, row, column). `ImageStack` adds the fifth
as a view: nothing is copied on the way to NumPy, DLPack or the CUDA array interface.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.launches import to_numpy, wait_on_current_stream
from warpsim.pool import release_later


class ImageStack:
    """Images with the axes (frame, sensor, band, row, column).

    Args:
        array: Warp array of shape (frame * sensor, band, row, column), contiguous.
        n_frame: Frames.
        n_sensor: Sensors.
        ready: Event after which the images are complete; None where they are already.
    """

    _is_lent = False

    def __init__(self, array: wp.array, n_frame: int, n_sensor: int, ready: wp.Event | None = None) -> None:
        self._array, self.ready = array, ready
        self.shape: tuple[int, ...] = (n_frame, n_sensor, *array.shape[1:])

    @property
    def array(self) -> wp.array:
        """The Warp array itself, shape (frame * sensor, band, row, column).

        On CUDA it may still be written to; what is asked of the device's current stream from now on comes after that.
        """
        wait_on_current_stream(self.ready, self.device)
        return self._array

    def wait(self) -> None:
        """Return when the images are complete."""
        if self.ready is not None:
            wp.synchronize_event(self.ready)

    def part(self, first: int, end: int) -> ImageStack:
        """Return some consecutive frames, which share the memory."""
        n_sensor = self.shape[1]
        return ImageStack(self._array[first * n_sensor : end * n_sensor], end - first, n_sensor, self.ready)

    @property
    def dtype(self) -> Any:
        """Warp scalar type: uint16 for counts, float32 for signal."""
        return self._array.dtype

    @property
    def device(self) -> wp.Device:
        """Device of the images."""
        return self._array.device

    @property
    def ndim(self) -> int:
        """Five."""
        return len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"ImageStack(shape={self.shape}, dtype={self.dtype.__name__}, device={self.device})"

    def numpy(self) -> npt.NDArray[Any]:
        """NumPy array of all five axes: a view on the CPU, a copy from CUDA (which waits for the device)."""
        return to_numpy(self.array).reshape(self.shape)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.array(self.numpy(), dtype=dtype, copy=copy)

    def __getitem__(self, key: Any) -> Any:
        if self.device.is_cuda:
            first, end, rest = frames_of_key(key, len(self))
            if first < end and (first, end) != (0, len(self)):
                return self.part(first, end).numpy()[rest]
        return self.numpy()[key]

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        if not self.device.is_cuda:
            raise AttributeError("__cuda_array_interface__: the images are on the CPU")
        self._is_lent = True
        own = self.array.__cuda_array_interface__
        stream = wp.get_stream(self.device).cuda_stream or 1  # 1: the default stream
        return {**own, "shape": self.shape, "strides": None, "version": 3, "stream": int(stream)}

    def __del__(self) -> None:
        if self._is_lent:
            release_later(self._array)

    def __dlpack__(
        self,
        *,
        stream: int | None = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[int, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """A capsule of all five axes, for `from_dlpack` of PyTorch, JAX, CuPy and NumPy; the memory is shared.

        What the consumer makes of it can be written to, and keeps the memory from being used again. On CUDA the
        consumer's stream waits for Warp's; memory that a consumer has let go of serves the renderer again once the
        device has done what was asked of it until then. Pinned host memory looks like any other: who copies from it
        asynchronously must hold it until that is done.

        Args:
            stream: On CUDA, the consumer's stream as the standard numbers them (None and 1: the default stream; 2: that
                of the thread; -1: do not wait); on the CPU None.
            max_version: The newest DLPack that the consumer knows.
            dl_device: Where the consumer wants the images: where they are, or on the CPU, which copies them from CUDA.
            copy: True: always copy. False: never, rather fail. None: only to the CPU.

        Raises:
            BufferError: Another device, a copy that copy=False forbids, or a stream on the CPU.
        """
        here = self.__dlpack_device__()
        requested = here if dl_device is None else (int(dl_device[0]), int(dl_device[1]))
        if requested not in (here, (CPU, 0)):
            raise BufferError(
                f"dl_device: must be {here}, where the images are, or {(CPU, 0)}, the CPU, got {requested}"
            )
        if requested == here and not copy:
            wait_for_images(self.array, stream)
            return capsule(self._array, self.shape, max_version)
        if copy is False:
            raise BufferError(f"copy: must not be False to bring images from device {here} to {requested}")
        if requested == (CPU, 0):
            return capsule(wp.array(to_numpy(self.array), dtype=self.dtype, device="cpu"), self.shape, max_version)
        copied = wp.clone(self.array)
        wait_for_images(copied, stream)
        return capsule(copied, self.shape, max_version)

    def __dlpack_device__(self) -> tuple[int, int]:
        return device_of(self._array)


def frames_of_key(key: Any, n_frame: int) -> tuple[int, int, Any]:
    """Return the frames that an index into images needs, first and end, and the index into these alone.

    Args:
        key: As NumPy takes it; where its first axis is neither a number nor a slice all frames are needed.
        n_frame: Frames that there are.
    """
    head, *rest = key if isinstance(key, tuple) and key else (key,)
    if isinstance(head, int | np.integer) and not isinstance(head, bool) and -n_frame <= head < n_frame:
        first = int(head) % n_frame
        return first, first + 1, (0, *rest)
    if isinstance(head, slice):
        chosen = range(n_frame)[head]
        if chosen:
            ends = sorted((chosen[0], chosen[-1]))
            return ends[0], ends[1] + 1, (slice(None, None, chosen.step), *rest)
    return 0, n_frame, key


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


def device_of(array: wp.array) -> tuple[int, int]:
    """Kind and number of the device, as DLPack has them; pinned memory is the CPU's."""
    return (CUDA, array.device.ordinal) if array.device.is_cuda else (CPU, 0)


def capsule(array: wp.array, shape: tuple[int, ...], max_version: tuple[int, int] | None = None) -> Any:
    """A capsule of a contiguous Warp array, as an array of another shape."""
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
