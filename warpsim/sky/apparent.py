"""Apparent directions on the host: aberration of starlight by the observer's motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError


def apparent_direction(direction_icrs: npt.ArrayLike, velocity_m_s: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Unit vectors as a moving observer sees them (special-relativistic aberration).

    Light deflection by the Sun is left out: below 0.01 arcsec beyond 60 degrees from it.

    Args:
        direction_icrs: Unit vectors, shape (n, 3) or (3,).
        velocity_m_s: Barycentric velocity of the observer, ICRS axes [m/s], shape (3,) or (n, 3).

    Returns:
        Unit vectors of the same shape as direction_icrs.

    Raises:
        InputError: A value is not finite, or the speed reaches that of light.
    """
    direction = np.asarray(direction_icrs, dtype=np.float64)
    beta = np.asarray(velocity_m_s, dtype=np.float64) / SPEED_OF_LIGHT_M_S
    if direction.shape[-1:] != (3,) or beta.shape[-1:] != (3,):
        raise InputError(
            f"direction_icrs, velocity_m_s: must end in an axis of 3, got {direction.shape} and {beta.shape}"
        )
    if not (np.isfinite(direction).all() and np.isfinite(beta).all()):
        raise InputError("direction_icrs, velocity_m_s: must be finite")
    speed2 = np.sum(beta * beta, axis=-1, keepdims=True)
    if (speed2 >= 1).any():
        raise InputError(f"velocity_m_s: must be below the speed of light, got {np.sqrt(speed2.max()):g} c")
    inverse_gamma = np.sqrt(1 - speed2)
    along = np.sum(direction * beta, axis=-1, keepdims=True)
    moved = direction * inverse_gamma + beta * (1 + along / (1 + inverse_gamma))
    return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))
