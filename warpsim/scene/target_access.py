"""Access of sensors to targets: intervals, margins, and all pairs at the times of frames."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64, I64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.optics.camera import Camera
from warpsim.orbit.access import access_intervals, constraints_by_cost, margins
from warpsim.orbit.access_constraints import AccessConstraints, AccessGeometry, CameraGeometry, MarginFunction
from warpsim.orbit.intervals import Intervals
from warpsim.scene.camera_axes import apparent_mean, satellite_state
from warpsim.scene.tracks import Tracks

Custom = Mapping[str, MarginFunction]
AxesOf = Callable[[int, F64], F64]
"""Index of the sensor, time_s (n,) -> camera axes, (n, 3, 3)."""

ACCESS_STEP_S = 10.0
"""Step of the scan for access [s]."""


@dataclass(frozen=True, eq=False)
class Observers:
    """Sensors of one kind as observers of targets."""

    satellites: tuple[int, ...]
    """Indices of their satellites."""
    camera: Camera
    axes: AxesOf
    """Commanded axes, by the index among these sensors."""
    camera_breaks_s: Sequence[Sequence[float]]
    """For each sensor, times at which its camera jumps, or turns at another rate [s]."""
    tracked: tuple[int, ...]
    """Indices of the targets that cameras track."""


def target_intervals(
    tracks: Tracks,
    observers: Observers,
    target: int,
    rules: AccessConstraints,
    breaks_s: Mapping[str, Sequence[float]],
    duration_s: float,
    custom: Custom | None = None,
    step_s: float = ACCESS_STEP_S,
) -> Intervals:
    """Return the intervals in which sensors can observe a target; rows are indices of the sensors."""
    with_cameras = rules.in_fov or bool(custom)
    key = (observers.satellites, target, rules, duration_s, step_s)
    known = _KNOWN.setdefault(tracks, {})
    if not with_cameras and key in known:
        return known[key]
    tracked = observers.tracked if with_cameras else ()
    bodies = [tracks.targets[index].name for index in (target, *tracked)]
    common = [time_s for name in bodies for time_s in breaks_s[name]]
    own = [breaks_s[tracks.satellites[index].name] for index in observers.satellites]
    cameras = observers.camera_breaks_s if with_cameras else [()] * len(own)
    found = access_intervals(
        [tracks.satellites[index] for index in observers.satellites],
        tracks.position_function(target),
        tracks.sun.position_at_m,
        rules,
        tracks.pole_icrs,
        duration_s,
        step_s,
        custom=custom,
        fov=field_of_view(tracks, observers, target),
        breaks_s=[sorted({*common, *sensor, *camera}) for sensor, camera in zip(own, cameras, strict=True)],
        tracked_m=[tracks.position_function(index) for index in tracked if index != target],
    )
    rows, starts, ends = zip(*found, strict=True) if found else ((), (), ())
    intervals = Intervals(np.array(rows, dtype=np.int64), np.array(starts, float), np.array(ends, float))
    first_s, last_s = tracks.exists_s[target]
    if first_s > 0.0 or last_s < duration_s:
        begin_s, end_s = first_light_s(tracks, observers.satellites, target), min(last_s, duration_s)
        reached = np.flatnonzero(begin_s <= end_s)
        intervals = intervals.intersection(Intervals(reached, begin_s[reached], np.full(len(reached), end_s)))
    if not with_cameras:
        known[key] = intervals
    return intervals


def first_light_s(tracks: Tracks, satellites: Sequence[int], target: int) -> F64:
    """Return when the first light of a target reaches satellites [s], (n_satellite,); 0 if it is there before."""
    first_s = float(tracks.exists_s[target][0])
    time_s = np.full(len(satellites), max(first_s, 0.0))
    if first_s > 0.0:
        target_m = tracks.target_state(target, np.array([first_s]))[0][0]
        for _ in range(2):  # a satellite moves by v / c of the way meanwhile: 2e-5, then 1e-9
            sensor_m = [tracks.satellites[i].position_at_m(time_s[k : k + 1])[0] for k, i in enumerate(satellites)]
            time_s = first_s + np.linalg.norm(sensor_m - target_m, axis=1) / SPEED_OF_LIGHT_M_S
    return time_s


_KNOWN: weakref.WeakKeyDictionary[Tracks, dict[Hashable, Intervals]] = weakref.WeakKeyDictionary()
"""Intervals that were found for tracks that somebody holds, where cameras play no part."""


def field_of_view(tracks: Tracks, observers: Observers, target: int) -> CameraGeometry:
    """Return the axes of the sensors' cameras and the apparent direction of a target."""

    def direction(sensor: int, time_s: F64) -> F64:
        return apparent_mean(tracks, [target], satellite_state(tracks, observers.satellites[sensor], time_s))

    return CameraGeometry(observers.camera, observers.axes, direction)


def target_margins(
    tracks: Tracks,
    observers: Observers,
    target: int,
    rules: AccessConstraints,
    time_s: F64,
    custom: Custom | None = None,
) -> dict[str, F64]:
    """Return the signed margin of every constraint, each (n_sensor, n_time)."""
    sensors_m = np.stack([tracks.satellites[index].position_at_m(time_s) for index in observers.satellites])
    return margins(
        sensors_m,
        tracks.position_function(target)(time_s),
        tracks.sun.position_at_m(time_s),
        rules,
        tracks.pole_icrs,
        time_s=time_s,
        custom=custom,
        fov=field_of_view(tracks, observers, target),
    )


Mask = npt.NDArray[np.bool_]

_PAIRS_AT_ONCE = 100_000  # (time, sensor, target) held at once: some 50 MB of temporaries


def can_observe(tracks: Tracks, observers: Observers, rules: AccessConstraints, time_s: F64) -> Mask:
    """Return whether sensors can observe each target at given times, (n_time, n_sensor, n_target)."""
    seen = np.empty((len(time_s), len(observers.satellites), len(tracks.targets)), dtype=bool)
    for target in range(len(tracks.targets)):
        seen[..., target] = tracks.exist(target, time_s)[:, None]
    if not seen.size:
        return seen
    n_time = max(1, _PAIRS_AT_ONCE // seen[0].size)
    for first in range(0, len(time_s), n_time):
        part = slice(first, first + n_time)
        seen[part] = _observable(_Pairs(tracks, observers, time_s[part]), rules, seen[part])
    return seen


class _Pairs:
    """Geometry of (time, sensor, target) at some times."""

    def __init__(self, tracks: Tracks, observers: Observers, time_s: F64) -> None:
        self._tracks, self._observers, self._time_s = tracks, observers, time_s
        self._sensor_m = np.stack([tracks.satellites[index].position_at_m(time_s) for index in observers.satellites])
        self._target_m = np.stack([tracks.target_state(index, time_s)[0] for index in range(len(tracks.targets))])
        self._sun_m = tracks.sun.position_at_m(time_s)
        self._unique_s, self._axes = np.unique(time_s), dict[int, F64]()

    def view(self, time: I64, sensor: I64, target: I64, fov: CameraGeometry | None = None) -> AccessGeometry:
        """Geometry of pairs, as rows of one time each."""
        return AccessGeometry(
            self._sensor_m[sensor, time][:, None],
            self._target_m[target, time][:, None],
            self._sun_m[time][:, None],
            self._tracks.pole_icrs,
            self._time_s[time][:, None],
            sensor[:, None],
            fov,
        )

    def frame_margin_deg(self, time: I64, sensor: I64, target: I64) -> F64:
        """Angle of targets from the edge of the frame [deg], each target with its own apparent direction."""
        margin = np.empty(len(target))
        for one in np.unique(target):
            rows = np.flatnonzero(target == one)
            direction = field_of_view(self._tracks, self._observers, int(one)).direction
            fov = CameraGeometry(self._observers.camera, self._axes_at, direction)
            margin[rows] = self.view(time[rows], sensor[rows], target[rows], fov).frame_margin_deg[:, 0]
        return margin

    def _axes_at(self, sensor: int, time_s: F64) -> F64:
        """Commanded axes at some of the times; found once for all of them."""
        if sensor not in self._axes:
            self._axes[sensor] = self._observers.axes(sensor, self._unique_s)
        return self._axes[sensor][np.searchsorted(self._unique_s, time_s)]


def _observable(pairs: _Pairs, rules: AccessConstraints, exist: Mask) -> Mask:
    """Return where every constraint holds, among the pairs in which the target exists."""
    time, sensor, target = np.nonzero(exist)
    for constraint in constraints_by_cost(rules):
        if constraint.name == "fov_deg":
            margin = pairs.frame_margin_deg(time, sensor, target)
        else:
            view = pairs.view(time, sensor, target)
            margin = np.broadcast_to(constraint.margin(view), view.shape)[:, 0]
        holds = margin >= 0.0
        time, sensor, target = time[holds], sensor[holds], target[holds]
    seen = np.zeros_like(exist)
    seen[time, sensor, target] = True
    return seen
