"""Ballistic arcs: free flight between two geodetic points in a given time, as a path of a scene.

The end points are WGS84 geodetic at their own times, so the end point has turned with the Earth during the flight. The
arc takes the short way about the Earth's centre. Two-body arcs are Lambert's solution; with J2 (or J2 to J4) Newton's
method corrects its start velocity until the flight hits the end point (shooting).
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import Number, Positive, closed_interval, rule_error
from warpsim.config.model import config_model
from warpsim.constants import DAY_S, EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2
from warpsim.errors import InputError, errors_at
from warpsim.exchange.geodetic import geodetic_to_itrs_m
from warpsim.instant import Instant, instant, instant_of, years_ahead
from warpsim.orbit.earth import geodetic_altitude_m, geodetic_to_gcrs_m, pole_of_date
from warpsim.orbit.elements import LARGEST_SPEED_M_S, entries
from warpsim.orbit.gravity import Gravity, propagate
from warpsim.orbit.two_body import lambert

if TYPE_CHECKING:
    from warpsim.instant import Epoch


DEFAULT_EPOCH_UTC = "2000-01-01T12:00:00"
"""The instant of time 0 of an arc that is used by itself and states none."""

LONGEST_ARC_S = 31 * DAY_S
"""Longest flight: as a scene's; it is integrated step by step, some times over."""

_SAME_EPOCH_S = 1e-6
# Newton stops here; the result misses the end point by the rounding of the propagation, some 1e-8 m.
_MISS_M = 1e-6
_WORST_MISS_M = 1e-4  # taken where rounding keeps Newton from _MISS_M (long or nearly 180-degree arcs)
_NUDGE_M_S = 1e-2  # difference step of the shooting; its error only slows Newton down
_SAMPLE_S = 10.0
_MOST_SAMPLES = 1_000_000
_GROUND_SLACK_KM = 5.0  # the effect of J2 on a long arc


def _utc_text(value: Any) -> Any:
    if hasattr(value, "utc") and hasattr(value, "isot"):
        return str(value.utc.isot)
    if not isinstance(value, str):
        raise rule_error("must be an ISO 8601 UTC instant")
    try:
        instant(value)
    except InputError:
        raise rule_error("must be an ISO 8601 UTC instant like 2025-03-20T12:00:00") from None
    return value


Longitude = Annotated[Number, closed_interval(-360, 360)]
Latitude = Annotated[Number, closed_interval(-90, 90)]
LonLat = Annotated[tuple[Longitude, Latitude], BeforeValidator(entries)]
UtcText = Annotated[str, BeforeValidator(_utc_text)]


@config_model
class BallisticArc:
    """Free flight between two geodetic points; solved on first use, and once for an epoch.

    Times count from the epoch, at which the flight starts; states outside [0, duration_s] continue the free flight.
    """

    start_lon_lat_deg: LonLat
    """East longitude and WGS84 geodetic latitude at time 0."""
    end_lon_lat_deg: LonLat
    """East longitude and WGS84 geodetic latitude at time duration_s."""
    duration_s: Positive
    """Time of flight, up to 31 days."""
    endpoint_altitude_km: Number
    """Height of both ends above the WGS84 ellipsoid."""
    gravity: Gravity = "j2"
    """What moves it: J2, J2 to J4, or the point mass alone."""
    epoch_utc: UtcText | None = None
    """The instant of time 0, which sets the Earth's orientation; when left out, the scene's epoch, or
    2000-01-01T12:00:00 where the arc is used by itself."""
    kind: Literal["ballistic_arc"] = "ballistic_arc"

    @model_validator(mode="after")
    def _ends_differ(self) -> BallisticArc:
        start, end = (geodetic_to_itrs_m(*point, 0.0) for point in (self.start_lon_lat_deg, self.end_lon_lat_deg))
        if np.linalg.norm(start - end) < 1.0:
            raise InputError("must differ from start_lon_lat_deg", "end_lon_lat_deg")
        if not self.endpoint_altitude_km > -100.0:
            rule = "must be > -100 (heights are above WGS84)"
            raise InputError(rule, "endpoint_altitude_km", self.endpoint_altitude_km, "g")
        if self.duration_s > LONGEST_ARC_S:
            raise InputError(f"must be at most {LONGEST_ARC_S:.0f} (31 days)", "duration_s", self.duration_s, ".9g")
        return self

    @functools.cached_property
    def epoch(self) -> Instant:
        """The instant of time 0."""
        return instant(self.epoch_utc or DEFAULT_EPOCH_UTC)

    def flight(self, epoch: Epoch | None = None) -> BallisticArc:
        """Return the arc that starts at an epoch, its own if none is given: the same object for equal arcs.

        Raises:
            InputError: The arc states another epoch.
        """
        own = start = self.epoch
        if epoch is not None:
            with years_ahead():
                start = epoch if isinstance(epoch, Instant) else instant_of(epoch)
        apart_s = abs((own.tt.jd1 - start.tt.jd1) + (own.tt.jd2 - start.tt.jd2)) * DAY_S
        if self.epoch_utc is not None and apart_s > _SAME_EPOCH_S:
            rule = f"must be left out, or be when the flight starts ({start.isot})"
            raise InputError(rule, "epoch_utc", self.epoch_utc)
        return _flight_of(replace(self, epoch_utc=None), start)

    @functools.cached_property
    def end_points_m(self) -> tuple[F64, F64]:
        """Start and end points [m], GCRS axes, each (3,), Earth rotation included."""
        lon, lat = np.transpose([self.start_lon_lat_deg, self.end_lon_lat_deg])
        times_s = np.array([0.0, self.duration_s])
        ends = geodetic_to_gcrs_m(lon, lat, 1e3 * self.endpoint_altitude_km, self.epoch, times_s)
        ends.setflags(write=False)  # callers share them
        return ends[0], ends[1]

    @functools.cached_property
    def pole_icrs(self) -> F64:
        """Unit vector of the pole that J2 acts about, shape (3,)."""
        return pole_of_date(self.epoch)

    @functools.cached_property
    def start_velocity_m_s(self) -> F64:
        """Velocity at time 0 [m/s], GCRS axes, shape (3,).

        Raises:
            InputError: When the ends are 180 degrees apart, the flight would pass through the Earth (duration too
                short or too long for free flight), start faster than 1e6 m/s, or the shooting does not converge.
        """
        start, end = self.end_points_m
        duration_s = self.duration_s
        with errors_at("", f"no arc between the end points in {duration_s:g} s"):
            velocity, _ = lambert(start, end, duration_s)
        self._check_above_ground(start, velocity)
        if (speed_m_s := float(np.linalg.norm(velocity))) > LARGEST_SPEED_M_S:
            rule = f"gives a start speed of {speed_m_s:.3g} m/s, must be at most {LARGEST_SPEED_M_S:g} m/s"
            raise InputError(f"{duration_s:g} s {rule}", "duration_s")
        solved = velocity if self.gravity == "two_body" else self._shoot(start, end, velocity)
        solved.setflags(write=False)
        return solved

    def _check_above_ground(self, start: F64, velocity: F64) -> None:
        """Refuse conics through the Earth; the two-body one decides, as J2 moves it by kilometres at most."""
        duration_s = self.duration_s
        times_s = np.linspace(0.0, duration_s, min(max(65, math.ceil(duration_s / _SAMPLE_S) + 1), _MOST_SAMPLES))
        path = propagate(start[None], velocity[None], times_s, "two_body", self.pole_icrs)[0][:, 0]
        lowest_km = float(geodetic_altitude_m(path, self.pole_icrs).min()) / 1e3
        if lowest_km < min(self.endpoint_altitude_km, 0.0) - _GROUND_SLACK_KM:
            raise InputError(f"{duration_s:g} s gives a flight {-lowest_km:.0f} km below the ground", "duration_s")

    def _shoot(self, start: F64, end: F64, velocity: F64) -> F64:
        """Newton on the start velocity; the derivative comes from three nudged paths flown beside the nominal one."""
        gravity, duration_s = self.gravity, np.array([self.duration_s])
        nudges = np.vstack([np.zeros(3), _NUDGE_M_S * np.eye(3)])
        miss_m = math.inf
        for _ in range(12):
            ends = propagate(np.tile(start, (4, 1)), velocity + nudges, duration_s, gravity, self.pole_icrs)[0][0]
            miss = end - ends[0]
            miss_m = float(np.linalg.norm(miss))
            if miss_m < _MISS_M:
                return velocity
            velocity = velocity + np.linalg.solve((ends[1:] - ends[0]).T / _NUDGE_M_S, miss)
        if miss_m < _WORST_MISS_M:
            return velocity
        raise InputError(f"the arc does not converge on its end point, last miss {miss_m:.3g} m")

    def state(self, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s], GCRS axes, each of the shape of time_s plus (3,).

        Args:
            time_s: Times [s since the epoch], any shape and order, also before 0 and after duration_s.
        """
        time = np.asarray(time_s, np.float64)
        start, velocity = self.end_points_m[0], self.start_velocity_m_s
        states = propagate(start[None], velocity[None], time.ravel(), self.gravity, self.pole_icrs)
        return states[0].reshape(*time.shape, 3), states[1].reshape(*time.shape, 3)

    def states(self, epoch: Epoch, time_s: ArrayLike) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s], GCRS axes, each (n_time, 1, 3), of the flight from that epoch.

        Raises:
            InputError: The arc states another epoch, or as `start_velocity_m_s`.
        """
        position, velocity = self.flight(epoch).state(np.asarray(time_s, np.float64))
        return position[:, None], velocity[:, None]

    def position_m(self, time_s: ArrayLike) -> F64:
        """Return positions [m], GCRS axes, of the shape of time_s plus (3,)."""
        return self.state(time_s)[0]

    @functools.cached_property
    def apogee_altitude_km(self) -> float:
        """Largest height of the flight above the equatorial radius, 6378.137 km (the paper: 825.45)."""
        duration_s, gravity = self.duration_s, self.gravity
        times_s = np.linspace(0.0, duration_s, max(3, math.ceil(duration_s / _SAMPLE_S) + 1))
        position, velocity = self.state(times_s)
        radius = np.linalg.norm(position, axis=1)
        top = int(np.argmax(radius))
        if 0 < top < len(times_s) - 1:
            # Newton on r.v = 0 along the free flight from the highest sample.
            near_r, near_v, dt = position[top : top + 1], velocity[top : top + 1], 0.0
            for _ in range(6):
                r, v = (x[0, 0] for x in propagate(near_r, near_v, np.array([dt]), gravity, self.pole_icrs))
                d = float(np.linalg.norm(r))
                dt -= float(r @ v) / (float(v @ v) - EARTH_GM_M3_S2 / d)
            radius[top] = d
        return float(radius.max() - EARTH_EQUATORIAL_RADIUS_M) / 1e3

    @property
    def start_speed_m_s(self) -> float:
        """Speed at time 0 [m/s], inertial."""
        return float(np.linalg.norm(self.start_velocity_m_s))

    @property
    def range_angle_deg(self) -> float:
        """Angle at the Earth's centre between the inertial end points [deg]."""
        start, end = self.end_points_m
        return math.degrees(math.atan2(float(np.linalg.norm(np.cross(start, end))), float(start @ end)))


@functools.lru_cache(maxsize=256)
def _flight_of(arc: BallisticArc, epoch: Instant) -> BallisticArc:
    """The arc that starts at an epoch: it is solved once."""
    flight = replace(arc)
    flight.__dict__["epoch"] = epoch
    return flight
