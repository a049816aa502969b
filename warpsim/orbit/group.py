"""Released groups: secondary targets that leave a main target with small random velocities."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.streams import uniforms

F64 = NDArray[np.float64]


def release_velocities(
    main_velocity_m_s: ArrayLike, n: int, speed_m_s: tuple[float, float], seed: int, group: int = 0
) -> F64:
    """Return inertial velocities of released targets [m/s], shape (n, 3).

    Directions relative to the main target are isotropic, speeds uniform. Target i uses numbers 3i to 3i + 2 of the
    seed's stream for releases, so a larger group begins with the smaller one.

    Args:
        main_velocity_m_s: Velocity of the main target at release [m/s], shape (3,).
        n: Number of released targets, >= 0.
        speed_m_s: Lowest and highest relative speed [m/s], 0 <= low <= high (the paper's group: 2 to 5).
        seed: Whole number, 0 <= seed < 2^64.
        group: Number of the group; each has its random stream.
    """
    main = np.asarray(main_velocity_m_s, np.float64)
    if main.shape != (3,) or not np.isfinite(main).all():
        raise InputError("must be a finite 3-vector", "main_velocity_m_s", main.tolist())
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 0:
        raise InputError("must be a whole number >= 0", "n", n)
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**64:
        raise InputError("must be a whole number in 0..2^64 - 1", "seed", seed)
    low, high = (float(value) for value in speed_m_s)
    if not (math.isfinite(high) and 0.0 <= low <= high):
        raise InputError("must be two numbers with 0 <= low <= high", "speed_m_s", speed_m_s)

    uniform = uniforms(int(seed), "group release", group, 3 * int(n)).reshape(int(n), 3)
    z = 2.0 * uniform[:, 0] - 1.0  # equal areas in z: isotropic
    azimuth = 2.0 * math.pi * uniform[:, 1]
    speed = low + (high - low) * uniform[:, 2]
    across = np.sqrt(1.0 - z * z)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    return np.asarray(main + speed[:, None] * direction)
