"""Fresh Gaussian noise, gain, clipping and uint16 in one pass over each row, written so that LLVM vectorises it.

A 64-bit key per row and frame (SplitMix64), a 32-bit avalanche hash of the pixel pair, and both outputs of Box-Muller
with polynomials for logarithm, sine and cosine; the first goes to the left half of the row, the second to the right.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange, uint32, uint64
from numpy import float32, int32


@njit
def mixed(z):
    """One step of SplitMix64."""
    z = uint64(z + uint64(0x9E3779B97F4A7C15))
    z = uint64((z ^ (z >> uint64(30))) * uint64(0xBF58476D1CE4E5B9))
    z = uint64((z ^ (z >> uint64(27))) * uint64(0x94D049BB133111EB))
    return uint64(z ^ (z >> uint64(31)))


@njit(inline="always")
def hashed(v):
    """A 32-bit avalanche hash."""
    v = uint32((v ^ (v >> uint32(16))) * uint32(0x21F0AAAD))
    v = uint32((v ^ (v >> uint32(15))) * uint32(0xD35A2D97))
    return uint32(v ^ (v >> uint32(15)))


@njit(inline="always")
def log_of_mantissa(m):
    """Natural logarithm of 1 to 2, to 2e-7."""
    s = (m - float32(1)) / (m + float32(1))
    s2 = s * s
    p = float32(2.0 / 11.0)
    p = p * s2 + float32(2.0 / 9.0)
    p = p * s2 + float32(2.0 / 7.0)
    p = p * s2 + float32(2.0 / 5.0)
    p = p * s2 + float32(2.0 / 3.0)
    return s * (p * s2 + float32(2.0))


@njit(inline="always")
def sine(t):
    """Sine of -pi/2 to pi/2."""
    t2 = t * t
    p = float32(2.7557319e-6) * t2 - float32(1.9841270e-4)
    p = p * t2 + float32(8.3333333e-3)
    p = p * t2 - float32(1.6666667e-1)
    return t + t * t2 * p


@njit(inline="always")
def cosine(t):
    """Cosine of -pi/2 to pi/2."""
    t2 = t * t
    p = float32(-2.7557319e-7) * t2 + float32(2.4801587e-5)
    p = p * t2 - float32(1.3888889e-3)
    p = p * t2 + float32(4.1666667e-2)
    p = p * t2 - float32(0.5)
    return float32(1) + t2 * p


@njit(parallel=True, fastmath=True)
def read_out(image, frame, offset, gain, largest, counts):
    """Counts of an image in units of the noise; rows in parallel."""
    n_row, n_col = image.shape
    n_pair = (n_col + 1) // 2
    for row in prange(n_row):
        key = mixed(uint64(frame) * uint64(1 << 20) + uint64(row))
        low, high = uint32(key), uint32(key >> uint64(32))
        first, second = np.empty(n_pair, float32), np.empty(n_pair, float32)
        angle = np.empty(n_pair, np.uint32)
        for pair in range(n_pair):
            bits = hashed(uint32(uint32(pair) * uint32(0x9E3779B9) + low))
            angle[pair] = hashed(uint32(uint32(pair) * uint32(0x85EBCA77) + high))
            first[pair] = float32(int32((bits >> uint32(8)) + uint32(1))) * float32(1.0 / 16777216.0)
        # The bits of a float32: its exponent, and its mantissa made a number from 1 to 2.
        parts = first.view(np.int32)
        for pair in range(n_pair):
            second[pair] = float32((parts[pair] >> int32(23)) - int32(127))
            parts[pair] = (parts[pair] & int32(0x007FFFFF)) | int32(0x3F800000)
        for pair in range(n_pair):
            logarithm = second[pair] * float32(0.6931471805599453) + log_of_mantissa(first[pair])
            radius = np.sqrt(max(float32(-2) * logarithm, float32(0)))
            # Half a turn from 24 bits, and which half from the highest.
            turn = angle[pair]
            part = float32(int32((turn & uint32(0x7FFFFFFF)) >> uint32(7))) * float32(0.5 / 16777216.0) - float32(0.25)
            radius *= float32(1) - float32(2) * float32(int32(turn >> uint32(31)))
            t = part * float32(6.283185307179586)
            first[pair], second[pair] = radius * cosine(t), radius * sine(t)
        for pair in range(n_pair):
            value = (image[row, pair] + first[pair]) * float32(gain) + float32(offset)
            counts[row, pair] = np.uint16(int32(min(max(value, float32(0)), float32(largest))))
        for pair in range(n_col - n_pair):
            value = (image[row, n_pair + pair] + second[pair]) * float32(gain) + float32(offset)
            counts[row, n_pair + pair] = np.uint16(int32(min(max(value, float32(0)), float32(largest))))
