"""Kinds of paths: the one list of allowed kinds of a scene's `[trajectory]` and of orbits within constellations.

Parts are distinguished by their field `kind`. Each has `states(epoch, time_s)`, which gives positions [m] and
velocities [m/s] in GCRS axes, (n_time, n_object, 3), with one object here. Constellations have `names` as well.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.elements import KeplerOrbit, StateVector
from warpsim.orbit.ephemeris import EphemerisOrbit, EphemerisSatellites
from warpsim.orbit.tle import TleOrbit, TleSatellites
from warpsim.orbit.walker import Walker

if TYPE_CHECKING:
    from warpsim.instant import Epoch

F64 = NDArray[np.float64]

Orbit = Annotated[
    BallisticArc | StateVector | KeplerOrbit | TleOrbit | EphemerisOrbit,
    Field(discriminator="kind"),
]
"""The path of one object."""

SimpleConstellation = Walker | TleSatellites | EphemerisSatellites
"""Constellations that hold no other parts; `constellations.Constellation` adds those that do."""


class Propagator(Protocol):
    """Source of states: an orbit, a trajectory or a constellation."""

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_object, 3)."""
        ...


def states_of(
    propagator: Propagator, epoch: Epoch, time_s: ArrayLike, within_s: tuple[float, float] | None = None
) -> tuple[F64, F64]:
    """States of a propagator, of which only those within a span matter, if one is given.

    What knows its motion for a limited time only has `states_within(epoch, time_s, within_s)`: it must cover the span,
    and before and after it the motion goes on freely.
    """
    limited = None if within_s is None else getattr(propagator, "states_within", None)
    if limited is None:
        return propagator.states(epoch, time_s)
    position, velocity = limited(epoch, time_s, within_s)
    return position, velocity
