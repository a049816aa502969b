"""NumPy's files (.npy) of others: an array no larger than the file, without objects."""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from warpsim.errors import InputError, one_line


def npy_array(data: bytes) -> NDArray[Any]:
    """The array in the bytes of a file.

    Raises:
        InputError: The header is damaged, or asks for more than the file holds.
    """
    stream = io.BytesIO(data)
    try:
        version = npy.read_magic(stream)
        read_header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, by_column, dtype = read_header(stream)
        size = math.prod(shape) * dtype.itemsize
        if dtype.hasobject or min(shape, default=0) < 0 or size > len(data) - stream.tell():
            raise ValueError(f"{len(data):,} bytes do not hold an array of shape {shape} of {dtype}")
        flat = np.frombuffer(data, dtype, math.prod(shape), stream.tell())
        return flat.reshape(shape, order="F" if by_column else "C").copy()
    except Exception as error:  # the header is parsed as Python's text, with all its kinds of errors
        raise InputError(f"cannot be read as a NumPy array: {one_line(error)}") from None
