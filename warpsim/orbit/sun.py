"""The Sun and the Earth's motion from ERFA's analytical ephemeris: no files, good to 11 km and 5 mm/s (1900-2100).

Positions are geometric (no light time, no aberration): the Sun's position 8 minutes ago differs by less than 0.01
arcsec of barycentric motion, while annual aberration belongs to the camera stage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import ASTRONOMICAL_UNIT_M, DAY_S
from warpsim.instant import tdb_jd

if TYPE_CHECKING:
    from warpsim.instant import Epoch

F64 = NDArray[np.float64]


class EarthStates(NamedTuple):
    """States of the Earth, and of the Sun from it; GCRS (ICRS) axes, each of the shape of the times plus (3,)."""

    sun_m: F64
    """The Sun's geometric geocentric position [m]."""
    sun_velocity_m_s: F64
    """The Sun's geocentric velocity [m/s]."""
    velocity_m_s: F64
    """The Earth's barycentric velocity [m/s]; with a satellite's added, the observer's for stellar aberration."""
    barycentric_m: F64
    """The Earth's barycentric position [m], for an observer's parallax."""
    heliocentric_m: F64
    """The Earth's heliocentric position [m], for the deflection of starlight by the Sun."""


def earth_states(epoch: Epoch, time_s: ArrayLike) -> EarthStates:
    """Return the states of Earth and Sun at times [s since epoch], any shape."""
    import erfa

    heliocentric, barycentric = erfa.epv00(*tdb_jd(epoch, time_s))
    return EarthStates(
        -heliocentric["p"] * ASTRONOMICAL_UNIT_M,
        -heliocentric["v"] * (ASTRONOMICAL_UNIT_M / DAY_S),
        np.asarray(barycentric["v"] * (ASTRONOMICAL_UNIT_M / DAY_S)),
        np.asarray(barycentric["p"]) * ASTRONOMICAL_UNIT_M,
        np.asarray(heliocentric["p"]) * ASTRONOMICAL_UNIT_M,
    )
