"""Images of a render call as one array with named axes.

Warp arrays have at most four axes; images have five: (frame, sensor, band, row, column). `ImageStack` adds the fifth
as a view: nothing is copied on the way to NumPy, DLPack or the CUDA array interface.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.render.dlpack import CPU, capsule, device_of, release_later, wait_for_images
from warpsim.transfers import to_numpy


class ImageStack:
    """Images with the axes (frame, sensor, band, row, column).

    Args:
        array: Warp array of shape (frame * sensor, band, row, column), contiguous.
        n_frame: Frames.
        n_sensor: Sensors.
    """

    _is_lent = False

    def __init__(self, array: wp.array, n_frame: int, n_sensor: int) -> None:
        self.array = array
        """The Warp array itself, shape (frame * sensor, band, row, column)."""
        self.shape: tuple[int, ...] = (n_frame, n_sensor, *array.shape[1:])

    @property
    def dtype(self) -> Any:
        """Warp scalar type: uint16 for counts, float32 for signal."""
        return self.array.dtype

    @property
    def device(self) -> wp.Device:
        """Where the images are."""
        return self.array.device

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
        return self.numpy()[key]

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        if not self.device.is_cuda:
            raise AttributeError("__cuda_array_interface__: the images are on the CPU")
        self._is_lent = True
        stream = wp.get_stream(self.device).cuda_stream or 1  # 1: the default stream
        own = self.array.__cuda_array_interface__
        return {**own, "shape": self.shape, "strides": None, "version": 3, "stream": int(stream)}

    def __del__(self) -> None:
        if self._is_lent:
            release_later(self.array)

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
        wanted = here if dl_device is None else (int(dl_device[0]), int(dl_device[1]))
        if wanted not in (here, (CPU, 0)):
            raise BufferError(f"dl_device: must be {here}, where the images are, or {(CPU, 0)}, the CPU, got {wanted}")
        if wanted == here and not copy:
            wait_for_images(self.array, stream)
            return capsule(self.array, self.shape, max_version)
        if copy is False:
            raise BufferError(f"copy: must not be False to bring images from device {here} to {wanted}")
        if wanted == (CPU, 0):
            return capsule(wp.array(to_numpy(self.array), dtype=self.dtype, device="cpu"), self.shape, max_version)
        copied = wp.clone(self.array)
        wait_for_images(copied, stream)
        return capsule(copied, self.shape, max_version)

    def __dlpack_device__(self) -> tuple[int, int]:
        return device_of(self.array)
