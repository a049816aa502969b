"""Access of sensors to targets, as signed margins (>= 0 where a constraint holds) and as time intervals.

The Earth must never be in the way; other constraints are those of AccessConstraints and custom ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.orbit.access_constraints import AccessConstraints as AccessConstraints
from warpsim.orbit.access_constraints import (
    AccessGeometry,
    CameraGeometry,
    Constraint,
    MarginFunction,
    active_constraints,
    earth_margin_km,
)
from warpsim.orbit.earth import grazing_altitude_m as grazing_altitude_m
from warpsim.orbit.intervals import Intervals, find_intervals
from warpsim.orbit.scan import Scan, break_times_s, pass_times_s, scan_times_s
from warpsim.orbit.track import PositionFunction, Track, TrackStack

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_CHEAPER_THAN_THE_EARTH = ("range_km", "min_range_km", "elevation_deg", "max_elevation_deg")
_PAIRS_PER_CHUNK = 200_000  # (sensor, time) pairs held at once: about 100 MB of temporaries


class AccessInterval(NamedTuple):
    """One uninterrupted access."""

    sensor: int
    """Index into the sensors given."""
    start_s: float
    end_s: float


def margins(
    sensor_m: ArrayLike,
    target_m: ArrayLike,
    sun_m: ArrayLike,
    constraints: AccessConstraints,
    pole_icrs: ArrayLike,
    *,
    time_s: ArrayLike = np.nan,
    custom: Mapping[str, MarginFunction] | None = None,
    fov: CameraGeometry | None = None,
) -> dict[str, F64]:
    """Return the signed margin of each active constraint, >= 0 where it holds.

    Args:
        sensor_m: Sensor positions, geocentric, GCRS axes [m], (n_sensor, n_time, 3).
        target_m: Target positions [m], (n_time, 3) or broadcastable.
        sun_m: Sun positions [m], (n_time, 3) or broadcastable.
        constraints: The constraints.
        pole_icrs: Unit vector of the ellipsoid's axis, the pole of date, (3,).
        time_s: Times [s], (n_time,), for custom constraints and the field of view.
        custom: Custom constraints: functions of an AccessGeometry by name.
        fov: Camera and axes, for the constraint in_fov.

    Returns:
        Arrays of the broadcast shape, (n_sensor, n_time): "earth_km" (lowest altitude on the segment) always, and
        those asked for of "range_km", "min_range_km", "elevation_deg", "max_elevation_deg", "solar_exclusion_deg",
        "grazing_altitude_km", "background_altitude_km", "target_sunlit", "fov_deg" and the custom ones.

    Raises:
        InputError: A custom constraint gives another shape, or NaN; in_fov without fov.
    """
    sensor, target, sun = (np.asarray(x, np.float64) for x in (sensor_m, target_m, sun_m))
    number = np.arange(sensor.shape[0] if sensor.ndim == 3 else 1)[:, None]
    pole, times = np.asarray(pole_icrs, np.float64), np.asarray(time_s, np.float64)
    view = AccessGeometry(sensor, target, sun, pole, times, number, fov)
    found = {item.name: item.margin(view) for item in active_constraints(constraints, custom)}
    return {"earth_km": 1e-3 * view.grazing_altitude_m} | {
        name: np.array(np.broadcast_to(margin, view.shape)) for name, margin in found.items()
    }


def access_intervals(
    sensors: Sequence[Track] | Sequence[PositionFunction],
    target_position_m: PositionFunction,
    sun_position_m: PositionFunction,
    constraints: AccessConstraints,
    pole_icrs: ArrayLike,
    duration_s: float,
    step_s: float = 10.0,
    *,
    custom: Mapping[str, MarginFunction] | None = None,
    fov: CameraGeometry | None = None,
    breaks_s: Sequence[Sequence[float]] | None = None,
    tracked_m: Sequence[PositionFunction] = (),
) -> list[AccessInterval]:
    """Return all intervals within [0, duration_s] in which every constraint holds, by sensor, then time.

    Constraint by constraint, cheap ones first: the next is evaluated within the intervals of those before. A scan at
    step_s, denser about close passes and with both sides of breakpoints, finds the changes; local extrema of a margin
    that could cross zero between scan points are searched out, so windows (and gaps) shorter than a step are found as
    well, down to milliseconds. Jumps of a margin that breaks_s does not name can hide one. Ends are bisected to 1 ms
    and clipped to the scenario.

    Args:
        sensors: Tracks of one node grid (the fast choice), or one function of position per sensor.
        target_position_m: The target's positions.
        sun_position_m: The Sun's positions; a track costs less than the ephemeris itself.
        constraints: The constraints.
        pole_icrs: Pole of date, (3,).
        duration_s: Length of the scenario [s], > 0.
        step_s: Scan step [s], > 0; a twentieth of the fastest orbit or less.
        custom: Custom constraints: functions of an AccessGeometry by name.
        fov: Camera and axes, for the constraint in_fov.
        breaks_s: For each sensor, times at which the motion of it, its camera or the target has a jump or kink [s]:
            the new motion holds from the breakpoint on.
        tracked_m: Positions of other targets that cameras track: cameras turn fast where these pass close to a sensor.

    Raises:
        InputError: A length is not > 0; a custom constraint gives another shape, or NaN; in_fov without fov.
    """
    time_s = scan_times_s(duration_s, step_s)
    active = constraints_by_cost(constraints, custom)
    pole = np.asarray(pole_icrs, np.float64)
    breaks_s = breaks_s if breaks_s is not None else [()] * len(sensors)
    intervals: list[AccessInterval] = []
    chunk = max(1, _PAIRS_PER_CHUNK // (len(time_s) + 3 * max(map(len, breaks_s), default=0)))
    for first in range(0, len(sensors), chunk):
        rows = slice(first, first + chunk)
        bodies = _ScanPositions(sensors[rows], target_position_m, sun_position_m, time_s)
        bodies.add_breakpoints(breaks_s[rows])
        for passed in (target_position_m, *tracked_m):
            bodies.add_passes(passed)
        within = Intervals.whole(len(sensors[rows]), 0.0, float(time_s[-1]))
        found = _chunk_intervals(bodies, active, within, pole, first, fov)
        ends = zip(found.row.tolist(), found.start_s.tolist(), found.end_s.tolist(), strict=True)
        intervals += [AccessInterval(first + row, start, end) for row, start, end in ends]
    return intervals


def _chunk_intervals(
    bodies: _ScanPositions,
    active: Sequence[Constraint],
    within: Intervals,
    pole: F64,
    first: int,
    fov: CameraGeometry | None,
) -> Intervals:
    """Return the intervals in which all constraints hold, for some sensors.

    Args:
        bodies: Positions of these sensors, the target and the Sun.
        active: The constraints, cheap ones first.
        within: Intervals to search.
        pole: Pole of date, (3,).
        first: Number of the first of these sensors.
        fov: Camera and axes, for the constraint in_fov.
    """

    def at(row: I64, time_s: F64) -> AccessGeometry:
        return _pairs(*bodies.positions_m(row, time_s), pole, time_s, first + row, fov)

    def at_point(point: I64) -> AccessGeometry:
        scan = bodies.scan
        return _pairs(*bodies.scanned_m(point), pole, scan.time_s[point], first + scan.row[point], fov)

    found = within
    for constraint in active:
        found = find_intervals(_margin_of(constraint, at), _margin_of(constraint, at_point), bodies.scan, found)
    return found


def constraints_by_cost(
    constraints: AccessConstraints, custom: Mapping[str, MarginFunction] | None = None
) -> list[Constraint]:
    """Return all active constraints, the Earth's margin too, cheap ones first."""
    active = [Constraint("earth_km", earth_margin_km), *active_constraints(constraints, custom)]
    return sorted(active, key=lambda constraint: constraint.name not in _CHEAPER_THAN_THE_EARTH)


def _pairs(
    sensor_m: F64, target_m: F64, sun_m: F64, pole: F64, time_s: F64, number: I64, fov: CameraGeometry | None
) -> AccessGeometry:
    """Geometry of single (sensor, time) pairs, as rows of one time each."""
    return AccessGeometry(
        sensor_m[:, None], target_m[:, None], sun_m[:, None], pole, time_s[:, None], number[:, None], fov
    )


def _margin_of(constraint: Constraint, view: Callable[..., AccessGeometry]) -> Callable[..., F64]:
    """Margin of a constraint at pairs of sensor and time, or at points of the scan."""

    def margin(*pairs: Any) -> F64:
        geometry = view(*pairs)
        return np.broadcast_to(constraint.margin(geometry), geometry.shape)[:, 0]

    return margin


class _ScanPositions:
    """Positions of some sensors, the target and the Sun: at the points of a scan, and at any time."""

    def __init__(
        self,
        sensors: Sequence[Track] | Sequence[PositionFunction],
        target_m: PositionFunction,
        sun_m: PositionFunction,
        time_s: F64,
    ) -> None:
        self._sensors, self._target_m, self._sun_m = _SensorPositions(sensors), target_m, sun_m
        self.scan = Scan.uniform(len(sensors), time_s)
        n_grid = self.scan.grid.size
        self._scanned_m = tuple(
            np.broadcast_to(position, (len(sensors), len(time_s), 3)).reshape(n_grid, 3)
            for position in (self._sensors.on_grid_m(time_s), target_m(time_s), sun_m(time_s))
        )

    def add_breakpoints(self, breaks_s: Sequence[Sequence[float]]) -> None:
        """Add both sides of each sensor's breakpoints to the scan."""
        if any(map(len, breaks_s)):
            self._add(*break_times_s(self.scan, breaks_s))

    def add_passes(self, passed_m: PositionFunction) -> None:
        """Add times about close passes of the sensors and a body to the scan."""
        scan = self.scan
        sensor, target, _ = self.scanned_m(slice(None))
        passed = target if passed_m is self._target_m else passed_m(scan.time_s)
        self._add(*pass_times_s(
            scan.row, scan.time_s, passed - sensor, lambda row, t: passed_m(t) - self._sensors.at_m(row, t)
        ))  # fmt: skip

    def scanned_m(self, point: I64 | slice) -> tuple[F64, F64, F64]:
        """Positions of sensors, target and Sun at points of the scan [m], (n, 3) each."""
        number = self.scan.number[point]
        sensor, target, sun = (position[number] for position in self._scanned_m)
        return sensor, target, sun

    def positions_m(self, row: I64, time_s: F64) -> tuple[F64, F64, F64]:
        """Positions of sensors, target and Sun at pairs of sensor and time (n,) [m], (n, 3) each."""
        return self._sensors.at_m(row, time_s), self._target_m(time_s), self._sun_m(time_s)

    def _add(self, after: I64, time_s: F64) -> None:
        """Add points to the scan."""
        if len(after):
            new = self.positions_m(self.scan.row[after], time_s)
            self._scanned_m = tuple(np.concatenate(pair) for pair in zip(self._scanned_m, new, strict=True))
            self.scan = self.scan.inserted(after, time_s)


class _SensorPositions:
    """Positions of some sensors: at the times of a grid, and of pairs of sensor and time."""

    def __init__(self, sensors: Sequence[Track] | Sequence[PositionFunction]) -> None:
        self._stack: TrackStack | None = None
        self._functions: list[PositionFunction] = []
        tracks = [sensor for sensor in sensors if isinstance(sensor, Track)]
        if len(tracks) == len(sensors):
            self._stack = TrackStack(tracks)
        else:
            self._functions = [s.position_at_m if isinstance(s, Track) else s for s in sensors]

    def on_grid_m(self, time_s: F64) -> F64:
        """Positions of all at times (n,) [m], (n_sensor, n, 3)."""
        if self._stack is not None:
            return self._stack.positions_m(time_s)
        return np.stack([position(time_s) for position in self._functions])

    def at_m(self, row: I64, time_s: F64) -> F64:
        """Positions of pairs of sensor and time (n,) [m], (n, 3)."""
        if self._stack is not None:
            return self._stack.position_m(row, time_s)
        position = np.empty((len(row), 3))
        order = np.argsort(row, kind="stable")
        edge = np.searchsorted(row[order], np.arange(len(self._functions) + 1))
        for number in np.unique(row):
            rows = order[edge[number] : edge[number + 1]]
            position[rows] = self._functions[number](time_s[rows])
        return position
