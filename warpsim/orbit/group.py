"""Released groups: secondary targets that leave a main target with small random velocities."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError

F64 = NDArray[np.float64]

# A word of its own in the 128-bit key keeps these draws apart from any other use of the same seed.
_STREAM = 0x47524F5550  # "GROUP"


def release_velocities(main_velocity_m_s: ArrayLike, n: int, speed_m_s: tuple[float, float], seed: int) -> F64:
    """Return inertial velocities of released targets [m/s], shape (n, 3).

    Directions relative to the main target are isotropic, speeds uniform. The bits are the raw words of NumPy's
    Philox, whose stream is frozen (NEP 19 promises that for bit generators; the methods of `Generator`, such as
    `uniform`, may change between releases), turned into uniforms here. Target i uses words 3i to 3i + 2, so a larger
    group begins with the smaller one.

    Args:
        main_velocity_m_s: Velocity of the main target at release [m/s], shape (3,).
        n: Number of released targets, >= 0.
        speed_m_s: Lowest and highest relative speed [m/s], 0 <= low <= high (the paper's group: 2 to 5).
        seed: Whole number, 0 <= seed < 2^64.
    """
    main = np.asarray(main_velocity_m_s, np.float64)
    if main.shape != (3,) or not np.isfinite(main).all():
        raise InputError(f"main_velocity_m_s: must be a finite 3-vector, got {main.tolist()}")
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 0:
        raise InputError(f"n: must be a whole number >= 0, got {n!r}")
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**64:
        raise InputError(f"seed: must be a whole number in 0..2^64 - 1, got {seed!r}")
    low, high = (float(value) for value in speed_m_s)
    if not (math.isfinite(high) and 0.0 <= low <= high):
        raise InputError(f"speed_m_s: must be two numbers with 0 <= low <= high, got {speed_m_s!r}")

    words = np.random.Philox(key=int(seed) | (_STREAM << 64)).random_raw(3 * int(n)).reshape(int(n), 3)
    uniform = (words >> np.uint64(11)).astype(np.float64) * 2.0**-53  # the top 53 bits: [0, 1)
    z = 2.0 * uniform[:, 0] - 1.0  # equal areas in z: isotropic
    azimuth = 2.0 * math.pi * uniform[:, 1]
    speed = low + (high - low) * uniform[:, 2]
    across = np.sqrt(1.0 - z * z)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    return np.asarray(main + speed[:, None] * direction)
