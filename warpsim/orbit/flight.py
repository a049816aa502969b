"""Free flight between two geodetic points in a given time: the solution of a ballistic arc for an epoch.

The end points are WGS84 geodetic at their own times, so the end point has turned with the Earth during the flight. The
arc takes the short way about the Earth's centre. Two-body arcs are Lambert's solution; with J2 (or J2 to J4) Newton's
method corrects its start velocity until the flight hits the end point (shooting).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.instant import Instant
from warpsim.orbit.earth import geodetic_altitude_m, geodetic_to_gcrs_m, pole_of_date
from warpsim.orbit.gravity import Gravity, propagate
from warpsim.orbit.lambert import lambert

F64 = NDArray[np.float64]

# Newton stops here; the result misses the end point by the rounding of the propagation, some 1e-8 m.
_MISS_M = 1e-6
_WORST_MISS_M = 1e-4  # taken where rounding keeps Newton from _MISS_M (long or nearly 180-degree arcs)
_NUDGE_M_S = 1e-2  # difference step of the shooting; its error only slows Newton down
_SAMPLE_S = 10.0
_GROUND_SLACK_KM = 5.0  # the effect of J2 on a long arc


@dataclass(frozen=True)
class FlightTask:
    """Boundary conditions of a flight, independent of its epoch."""

    start_lon_lat_deg: tuple[float, float]
    """East longitude and WGS84 geodetic latitude at time 0."""
    end_lon_lat_deg: tuple[float, float]
    """East longitude and WGS84 geodetic latitude at time duration_s."""
    duration_s: float
    endpoint_altitude_km: float
    """Height of both ends above the WGS84 ellipsoid."""
    gravity: Gravity


class Flight:
    """A flight that starts at an epoch; its start velocity is solved for on first use, and then kept.

    Times count from the epoch; states outside [0, duration_s] continue the free flight. Make one with `flight_of`.
    """

    def __init__(self, task: FlightTask, epoch: Instant) -> None:
        self.task, self.epoch = task, epoch

    @functools.cached_property
    def end_points_m(self) -> tuple[F64, F64]:
        """Start and end points [m], GCRS axes, each (3,), Earth rotation included."""
        task = self.task
        lon, lat = np.transpose([task.start_lon_lat_deg, task.end_lon_lat_deg])
        times_s = np.array([0.0, task.duration_s])
        ends = geodetic_to_gcrs_m(lon, lat, 1e3 * task.endpoint_altitude_km, self.epoch, times_s)
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
                short or too long for free flight), or the shooting does not converge.
        """
        start, end = self.end_points_m
        duration_s = self.task.duration_s
        try:
            velocity, _ = lambert(start, end, duration_s)
        except InputError as error:
            raise error.of(f"no arc between the end points in {duration_s:g} s") from None
        self._check_above_ground(start, velocity)
        solved = velocity if self.task.gravity == "two_body" else self._shoot(start, end, velocity)
        solved.setflags(write=False)
        return solved

    def _check_above_ground(self, start: F64, velocity: F64) -> None:
        """Refuse conics through the Earth; the two-body one decides, as J2 moves it by kilometres at most."""
        duration_s = self.task.duration_s
        times_s = np.linspace(0.0, duration_s, max(65, math.ceil(duration_s / _SAMPLE_S) + 1))
        path = propagate(start[None], velocity[None], times_s, "two_body", self.pole_icrs)[0][:, 0]
        lowest_km = float(geodetic_altitude_m(path, self.pole_icrs).min()) / 1e3
        if lowest_km < min(self.task.endpoint_altitude_km, 0.0) - _GROUND_SLACK_KM:
            raise InputError(f"{duration_s:g} s gives a flight {-lowest_km:.0f} km below the ground", "duration_s")

    def _shoot(self, start: F64, end: F64, velocity: F64) -> F64:
        """Newton on the start velocity; the derivative comes from three nudged paths flown beside the nominal one."""
        gravity, duration_s = self.task.gravity, np.array([self.task.duration_s])
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
            time_s: Times [s since the epoch], any shape and order, also before 0 and after the end.

        Raises:
            InputError: As `start_velocity_m_s`.
        """
        time = np.asarray(time_s, np.float64)
        start, velocity = self.end_points_m[0], self.start_velocity_m_s
        states = propagate(start[None], velocity[None], time.ravel(), self.task.gravity, self.pole_icrs)
        return states[0].reshape(*time.shape, 3), states[1].reshape(*time.shape, 3)

    @functools.cached_property
    def apogee_altitude_km(self) -> float:
        """Largest height of the flight above the equatorial radius, 6378.137 km (the paper: 825.45)."""
        duration_s, gravity = self.task.duration_s, self.task.gravity
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
def flight_of(task: FlightTask, epoch: Instant) -> Flight:
    """Return the flight that starts at an epoch, the same object for the same task and epoch: it is solved once."""
    return Flight(task, epoch)
