"""Images of a render call as one array with named axes.

Warp arrays have at most four axes; images have five: (frame, sensor, band, row, column). `ImageStack` adds the fifth
as a view: nothing is copied on the way to NumPy, DLPack or the CUDA array interface.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp


class ImageStack:
    """Images with the axes (frame, sensor, band, row, column).

    Args:
        array: Warp array of shape (frame * sensor, band, row, column), contiguous.
        n_frame: Frames.
        n_sensor: Sensors.
    """

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
        return np.asarray(self.array.numpy()).reshape(self.shape)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.array(self.numpy(), dtype=dtype, copy=copy)

    def __getitem__(self, key: Any) -> Any:
        return self.numpy()[key]

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        if not self.device.is_cuda:
            raise AttributeError("__cuda_array_interface__: the images are on the CPU")
        return {**self.array.__cuda_array_interface__, "shape": self.shape, "strides": None}

    def __dlpack__(self, **options: Any) -> Any:
        if self.device.is_cuda:
            raise BufferError("DLPack: on CUDA export the four-axis .array, or use the CUDA array interface")
        return self.numpy().__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        return (2, self.device.ordinal) if self.device.is_cuda else (1, 0)
