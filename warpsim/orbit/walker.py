"""Walker constellations: circular orbits of one altitude and inclination, evenly spread.

The pattern T/P/F has T satellites in P planes of S = T/P and phasing F (J. G. Walker, 1977). Elements are referred to
the GCRS equator and its x axis (not to the equator of date, 0.14 degrees away in 2025); the seed satellite is the
first of the first plane.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, ValidationInfo, field_validator

from warpsim.arrays import F64
from warpsim.config.fields import Group, Integer, Name, Number, Positive, closed_interval, rule_error
from warpsim.config.model import config_model
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.elements import plane_axes
from warpsim.orbit.gravity import Gravity, propagate

if TYPE_CHECKING:
    from warpsim.instant import Epoch


Pattern = Literal["delta", "star"]
Definition = Literal["standard", "paper"]


def _below_planes(value: int, info: ValidationInfo) -> int:
    planes = info.data.get("n_plane")
    if value < 0 or (planes is not None and value >= planes):
        raise rule_error(f"must be in 0..{(planes or 1) - 1} (below n_plane)" if planes else "must be >= 0")
    return value


Phasing = Annotated[Integer, AfterValidator(_below_planes)]
"""Of a pattern, a field after n_plane: less than the number of planes."""


def satellite_names(n_plane: int, n_slot: int, prefix: str) -> list[str]:
    """`sat{plane}{slot}`, counted from 1 ("sat11".."sat47"); `sat{plane:02d}-{slot:02d}` when one passes 9."""
    short = n_plane < 10 and n_slot < 10
    pairs = ((i, j) for i in range(1, n_plane + 1) for j in range(1, n_slot + 1))
    return [f"{prefix}{i}{j}" if short else f"{prefix}{i:02d}-{j:02d}" for i, j in pairs]


def pattern_turns(n_plane: int, n_slot: int, phasing: int) -> F64:
    """Return each satellite's phase along its orbit, in turns ahead of the first one's, 0 <= turns < 1, (n,).

    Slot j of plane i: (j - 1) / S + F (i - 1) / T. Counted in units of 1/T, whole numbers, so that a full turn comes
    out as exactly 0.
    """
    plane, slot = np.divmod(np.arange(n_plane * n_slot), n_slot)
    total = n_plane * n_slot
    return np.asarray((slot * n_plane + phasing * plane) % total / total, np.float64)


@config_model
class Walker:
    """A Walker constellation; arrays run plane by plane, slot by slot."""

    n_satellite: Group
    """T, all satellites."""
    n_plane: Group
    """P, orbital planes; divides n_satellite."""
    phasing: Phasing
    """F, in 0..P-1: a satellite is ahead of its neighbour one plane to the west by F * 360/T degrees."""
    altitude_km: Annotated[Positive, closed_interval(0, 1e6)]
    """Above the equatorial radius, 6378.137 km."""
    inclination_deg: Annotated[Number, closed_interval(0, 180)]
    """To the GCRS equator."""
    pattern: Pattern = "delta"
    """Nodes spread over 360 degrees ("delta") or 180 degrees ("star")."""
    raan0_deg: Number = 0.0
    """Right ascension of the ascending node of the first plane."""
    mean_anomaly0_deg: Number = 0.0
    """Mean anomaly of the first satellite, counted from the ascending node (the orbits are circular)."""
    definition: Definition = "standard"
    """"standard", or "paper": its Eq. 10 leaves F out, so that planes are phased as if F were 1."""
    gravity: Gravity = "j2"
    """What moves the satellites."""
    prefix: Name = "sat"
    """What their names begin with."""
    kind: Literal["walker"] = "walker"

    @field_validator("n_plane")
    @classmethod
    def _divides(cls, value: int, info: ValidationInfo) -> int:
        total = info.data.get("n_satellite")
        if total is not None and total % value:
            raise rule_error(f"must divide n_satellite ({total})")
        return value

    @property
    def n_slot(self) -> int:
        """S, satellites per plane."""
        return self.n_satellite // self.n_plane

    @property
    def names(self) -> list[str]:
        """`sat{plane}{slot}`, counted from 1 ("sat11".."sat47"); `sat{plane:02d}-{slot:02d}` when one passes 9."""
        return satellite_names(self.n_plane, self.n_slot, self.prefix)

    @property
    def raan_deg(self) -> F64:
        """Right ascensions of the ascending nodes [deg], 0 to 360, shape (n_satellite,).

        Paper Eq. 9: 360 (i-1) / P; star patterns: 180 (i-1) / P.
        """
        plane = np.repeat(np.arange(self.n_plane), self.n_slot)
        spread_deg = 360.0 if self.pattern == "delta" else 180.0
        return np.mod(self.raan0_deg + spread_deg * plane / self.n_plane, 360.0)

    @property
    def mean_anomaly_deg(self) -> F64:
        """Mean anomalies at the epoch [deg], 0 to 360, shape (n_satellite,).

        Paper Eq. 10 with the phasing restored: 360 (j-1) / S + 360 F (i-1) / T.
        """
        phasing = self.phasing if self.definition == "standard" else 1
        return np.mod(self.mean_anomaly0_deg + 360.0 * pattern_turns(self.n_plane, self.n_slot, phasing), 360.0)

    @property
    def period_s(self) -> float:
        """Two-body period [s]."""
        radius_m = EARTH_EQUATORIAL_RADIUS_M + 1e3 * self.altitude_km
        return 2.0 * math.pi * math.sqrt(radius_m**3 / EARTH_GM_M3_S2)

    def state(self) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s] at the epoch, GCRS axes, each (n_satellite, 3).

        The velocity is the two-body circular one; under J2 the orbit is then near-circular (by about 10 km).
        """
        radius_m = EARTH_EQUATORIAL_RADIUS_M + 1e3 * self.altitude_km
        speed_m_s = math.sqrt(EARTH_GM_M3_S2 / radius_m)
        node, along = np.radians(self.raan_deg), np.radians(self.mean_anomaly_deg)
        outward, ahead = plane_axes(np.radians(self.inclination_deg), node, along)
        return radius_m * outward, speed_m_s * ahead

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, n_satellite, 3).

        Args:
            epoch: The scene's epoch, at which the angles hold; it sets the pole that J2 acts about.
            time_s: Times [s since epoch], shape (n_time,).
        """
        return propagate(*self.state(), np.asarray(time_s, np.float64), self.gravity, pole_of_date(epoch))
