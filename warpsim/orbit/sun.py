"""The Sun and the Earth's motion from ERFA's analytical ephemeris: no files, good to 11 km and 5 mm/s (1900-2100).

Positions are geometric (no light time, no aberration): the Sun's position 8 minutes ago differs by less than 0.01
arcsec of barycentric motion, while annual aberration belongs to the camera stage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import ASTRONOMICAL_UNIT_M, DAY_S
from warpsim.instant import tdb_jd

if TYPE_CHECKING:
    from warpsim.instant import Epoch

F64 = NDArray[np.float64]


class EarthStates(NamedTuple):
    """Positions of the Earth, and of the Sun from it; ICRS axes, each of the shape of the times plus (3,)."""

    sun_m: F64
    """The Sun's geometric geocentric position [m]."""
    velocity_m_s: F64
    """The Earth's barycentric velocity [m/s]."""
    barycentric_m: F64
    """The Earth's barycentric position [m]."""
    heliocentric_m: F64
    """The Earth's heliocentric position [m]."""


def earth_states(epoch: Epoch, time_s: ArrayLike) -> EarthStates:
    """Return the results of the functions below by one evaluation of the ephemeris.

    Args:
        epoch: The scene's epoch.
        time_s: Times [s since epoch], any shape.
    """
    import erfa

    heliocentric, barycentric = erfa.epv00(*tdb_jd(epoch, time_s))
    return EarthStates(
        -heliocentric["p"] * ASTRONOMICAL_UNIT_M,
        np.asarray(barycentric["v"] * (ASTRONOMICAL_UNIT_M / DAY_S)),
        np.asarray(barycentric["p"]) * ASTRONOMICAL_UNIT_M,
        np.asarray(heliocentric["p"]) * ASTRONOMICAL_UNIT_M,
    )


def sun_state(epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
    """Return the Sun's geocentric position [m] and velocity [m/s], GCRS axes, each of the shape of time_s plus (3,)."""
    import erfa

    heliocentric: Any = erfa.epv00(*tdb_jd(epoch, time_s))[0]
    return -heliocentric["p"] * ASTRONOMICAL_UNIT_M, -heliocentric["v"] * (ASTRONOMICAL_UNIT_M / DAY_S)


def sun_position_m(epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return the Sun's geometric geocentric position [m], GCRS axes, of the shape of time_s plus (3,).

    Args:
        epoch: The scene's epoch.
        time_s: Times [s since epoch], any shape.
    """
    return sun_state(epoch, time_s)[0]


def earth_velocity_m_s(epoch: Epoch, time_s: ArrayLike) -> F64:
    """Return the Earth's barycentric velocity [m/s], ICRS axes, of the shape of time_s plus (3,).

    With a satellite's geocentric velocity added, it is the observer's velocity for stellar aberration.
    """
    return earth_states(epoch, time_s).velocity_m_s


def earth_position_m(epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
    """Return the Earth's barycentric and heliocentric position [m], ICRS axes, each of the shape of time_s plus (3,).

    The first gives an observer's parallax, the second the deflection of starlight by the Sun.
    """
    states = earth_states(epoch, time_s)
    return states.barycentric_m, states.heliocentric_m
