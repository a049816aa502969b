"""Apparent directions on the host: parallax, deflection by the Sun, aberration by the observer's motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.constants import ASTRONOMICAL_UNIT_M, SPEED_OF_LIGHT_M_S
from warpsim.directions import normalised
from warpsim.errors import InputError

SUN_SCHWARZSCHILD_AU = 1.97412574336e-8
_MAS_RAD = np.pi / 180 / 3.6e6


def apparent_direction(
    direction_icrs: npt.ArrayLike,
    velocity_m_s: npt.ArrayLike,
    *,
    parallax_mas: npt.ArrayLike | None = None,
    barycentric_m: npt.ArrayLike | None = None,
    heliocentric_m: npt.ArrayLike | None = None,
) -> F64:
    """Unit vectors as a moving observer sees them: aberration, and what else is asked for.

    The steps of the star stage, in its order: annual parallax, deflection of light by the Sun (Klioner 2003, AJ 125,
    1580, Eq. 70 for a source at infinity; as in ERFA's ldsun, the bending fades within 5 arcmin of the Sun's centre),
    special-relativistic aberration (Eq. 10 without potential).

    Args:
        direction_icrs: Barycentric unit vectors, shape (n, 3) or (3,).
        velocity_m_s: Barycentric velocity of the observer, ICRS axes [m/s], shape (3,) or (n, 3).
        parallax_mas: Parallaxes [mas], shape (n,) or a number; unknown (NaN) and negative ones count as 0. Needs
            barycentric_m. No parallax when left out.
        barycentric_m: Barycentric position of the observer [m], shape (3,) or (n, 3).
        heliocentric_m: Heliocentric position of the observer [m], shape (3,) or (n, 3). No deflection when left out:
            4 mas at 90 degrees from the Sun, 10 mas at 45.

    Returns:
        Unit vectors of the same shape as direction_icrs.

    Raises:
        InputError: A value is not finite, the speed reaches that of light, or parallaxes come without a position.
    """
    direction = _vectors(direction_icrs, "direction_icrs")
    if not np.any(direction, axis=-1).all():
        raise InputError("must not be 0", "direction_icrs")
    velocity = _vectors(velocity_m_s, "velocity_m_s")
    beta = velocity / SPEED_OF_LIGHT_M_S
    speed2 = np.sum(beta * beta, axis=-1, keepdims=True)
    if (speed2 >= 1).any():
        raise InputError(f"must be below the speed of light, got {np.sqrt(speed2.max()):g} c", "velocity_m_s")
    if parallax_mas is not None:
        if barycentric_m is None:
            raise InputError("needs barycentric_m, the observer's position", "parallax_mas")
        parallax = np.asarray(parallax_mas, dtype=np.float64)
        if parallax.shape not in ((), direction.shape[:-1]):
            raise InputError(f"must have shape {direction.shape[:-1]}", "parallax_mas", parallax.shape)
        if np.isinf(parallax).any():
            raise InputError("must not be infinite", "parallax_mas")
        parallax_rad = np.fmax(parallax, 0.0) * _MAS_RAD
        shift_au = _vectors(barycentric_m, "barycentric_m") / ASTRONOMICAL_UNIT_M
        direction = normalised(direction - parallax_rad[..., None] * shift_au)
    if heliocentric_m is not None:
        from_sun_au = _vectors(heliocentric_m, "heliocentric_m") / ASTRONOMICAL_UNIT_M
        if not np.any(from_sun_au, axis=-1).all():
            raise InputError("must not be 0", "heliocentric_m")
        direction = _deflected(direction, from_sun_au)
    inverse_gamma = np.sqrt(1 - speed2)
    along = np.sum(direction * beta, axis=-1, keepdims=True)
    return normalised(direction * inverse_gamma + beta * (1 + along / (1 + inverse_gamma)))


def _deflected(direction: F64, from_sun_au: F64) -> F64:
    """Directions after the Sun has bent the light, for an observer at from_sun_au."""
    distance_au = np.linalg.norm(from_sun_au, axis=-1, keepdims=True)
    away = from_sun_au / distance_au
    cosine = np.sum(direction * away, axis=-1, keepdims=True)
    bend = SUN_SCHWARZSCHILD_AU / distance_au / np.maximum(1 + cosine, 1e-6 / np.maximum(distance_au**2, 1))
    return normalised(direction + bend * (away - cosine * direction))


def _vectors(values: Any, where: str) -> F64:
    try:
        vectors = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"must be numbers, got {type(values).__name__}", where) from None
    if vectors.shape[-1:] != (3,):
        raise InputError(f"must end in an axis of 3, got shape {vectors.shape}", where)
    if not np.isfinite(vectors).all():
        raise InputError("must be finite", where)
    return vectors
