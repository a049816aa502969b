"""Access of sensors to targets, as signed margins (>= 0 where a constraint holds) and as time intervals.

The Earth must never be in the way; other constraints are those of AccessConstraints and custom ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64, I64
from warpsim.orbit.access_constraints import (
    AccessConstraints,
    AccessGeometry,
    CameraGeometry,
    Constraint,
    MarginFunction,
    active_constraints,
    earth_margin_km,
)
from warpsim.orbit.intervals import (
    Intervals,
    PairFunction,
    PointFunction,
    Scan,
    break_times_s,
    find_intervals,
    pass_times_s,
    scan_times_s,
)
from warpsim.orbit.track import PositionFunction, Track, TrackStack

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
    """Return the signed margin of each active constraint by name, >= 0 where it holds, (n_sensor, n_time) each.

    "earth_km" (lowest altitude on the segment) is always there, the others are those asked for. Positions are
    geocentric, GCRS axes [m]: sensors (n_sensor, n_time, 3), the others (n_time, 3) or broadcastable; times are for
    custom constraints and the field of view.

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
    breaks_s = breaks_s if breaks_s is not None else [()] * len(sensors)
    intervals: list[AccessInterval] = []
    chunk = max(1, _PAIRS_PER_CHUNK // (len(time_s) + 3 * max(map(len, breaks_s), default=0)))
    for first in range(0, len(sensors), chunk):
        rows = slice(first, first + chunk)
        bodies = _ScanPositions(sensors[rows], target_position_m, sun_position_m, time_s)
        bodies.add_breakpoints(breaks_s[rows])
        for passed in (target_position_m, *tracked_m):
            bodies.add_passes(passed)
        found = Intervals.whole(len(sensors[rows]), 0.0, float(time_s[-1]))
        for constraint in active:
            at = bodies.margin_functions(constraint, np.asarray(pole_icrs, np.float64), first, fov)
            found = find_intervals(*at, bodies.scan, found)
        ends = zip(found.row.tolist(), found.start_s.tolist(), found.end_s.tolist(), strict=True)
        intervals += [AccessInterval(first + row, start, end) for row, start, end in ends]
    return intervals


def constraints_by_cost(
    constraints: AccessConstraints, custom: Mapping[str, MarginFunction] | None = None
) -> list[Constraint]:
    """Return all active constraints, the Earth's margin too, cheap ones first."""
    active = [Constraint("earth_km", earth_margin_km), *active_constraints(constraints, custom)]
    return sorted(active, key=lambda constraint: constraint.name not in _CHEAPER_THAN_THE_EARTH)


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

    def margin_functions(
        self, constraint: Constraint, pole: F64, first: int, fov: CameraGeometry | None
    ) -> tuple[PairFunction, PointFunction]:
        """Margins of a constraint at pairs of sensor and time, and at points of the scan."""

        def margin(positions_m: tuple[F64, F64, F64], time_s: F64, row: I64) -> F64:
            # Single pairs are rows of one time each.
            sensor, target, sun = (position_m[:, None] for position_m in positions_m)
            geometry = AccessGeometry(sensor, target, sun, pole, time_s[:, None], first + row[:, None], fov)
            return np.broadcast_to(constraint.margin(geometry), geometry.shape)[:, 0]

        def at(row: I64, time_s: F64) -> F64:
            return margin(self.positions_m(row, time_s), time_s, row)

        def at_point(point: I64) -> F64:
            return margin(self.scanned_m(point), self.scan.time_s[point], self.scan.row[point])

        return at, at_point

    def scanned_m(self, point: I64 | slice) -> tuple[F64, F64, F64]:
        """Positions of sensors, target and Sun at points of the scan [m], (n, 3) each."""
        number = self.scan.number[point]
        sensor, target, sun = (position[number] for position in self._scanned_m)
        return sensor, target, sun

    def positions_m(self, row: I64, time_s: F64) -> tuple[F64, F64, F64]:
        """Positions of sensors, target and Sun at pairs of sensor and time (n,) [m], (n, 3) each."""
        return self._sensors.at_m(row, time_s), self._target_m(time_s), self._sun_m(time_s)

    def _add(self, after: I64, time_s: F64) -> None:
        if len(after):
            new = self.positions_m(self.scan.row[after], time_s)
            self._scanned_m = tuple(np.concatenate(pair) for pair in zip(self._scanned_m, new, strict=True))
            self.scan = self.scan.inserted(after, time_s)


class _SensorPositions:
    """Positions of some sensors, those of tracks of one node grid side by side."""

    def __init__(self, sensors: Sequence[Track] | Sequence[PositionFunction]) -> None:
        tracks = [sensor for sensor in sensors if isinstance(sensor, Track)]
        self._stack = TrackStack(tracks) if len(tracks) == len(sensors) else None
        self._functions = [sensor.position_at_m if isinstance(sensor, Track) else sensor for sensor in sensors]

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
        for number in np.unique(row):
            position[row == number] = self._functions[number](time_s[row == number])
        return position
