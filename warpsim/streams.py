"""Random numbers of scenes on the host: one stream per purpose and item, the same on every machine.

The raw bits of NumPy's Philox are guaranteed never to change (NEP 19), unlike the methods of `Generator`, so the
conversion to uniforms is done here.
"""

from __future__ import annotations

import zlib
from statistics import NormalDist

import numpy as np
import numpy.typing as npt


def uniforms(seed: int, purpose: str, item: int, n: int) -> npt.NDArray[np.float64]:
    """N uniform numbers in (0, 1) that depend only on seed, purpose and item; shape (n,)."""
    key = (zlib.crc32(purpose.encode()) << 32) | item
    bits = np.random.Philox(key=(np.uint64(seed & (2**64 - 1)), np.uint64(key))).random_raw(n)
    return (np.right_shift(bits, np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


def normals(seed: int, purpose: str, item: int, n: int) -> npt.NDArray[np.float64]:
    """N unit normal deviates that depend only on seed, purpose and item; shape (n,)."""
    inverse = NormalDist().inv_cdf
    return np.array([inverse(float(u)) for u in uniforms(seed, purpose, item, n)])
