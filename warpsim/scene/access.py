"""Access of sensors to targets: when all constraints hold, by tracks, rules and cameras."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from warpsim.optics.camera import Camera
from warpsim.orbit.access import access_intervals, margins
from warpsim.orbit.intervals import Intervals
from warpsim.orbit.rules import AccessConstraints, FieldOfView, MarginFunction
from warpsim.scene.camera_axes import apparent_mean, satellite_state
from warpsim.scene.tracks import Tracks

F64 = npt.NDArray[np.float64]
Custom = Mapping[str, MarginFunction]
AxesOf = Callable[[int, F64], F64]
"""Index of the sensor, time_s (n,) -> camera axes, (n, 3, 3)."""

ACCESS_STEP_S = 10.0
"""Step of the scan for access [s]."""


@dataclass(frozen=True, eq=False)
class Watchers:
    """Some sensors of one kind, as access needs them."""

    satellites: tuple[int, ...]
    """Indices of their satellites."""
    camera: Camera
    axes: AxesOf
    """Commanded axes, by the index among these sensors."""
    camera_breaks_s: Sequence[Sequence[float]]
    """For each sensor, times at which its camera jumps, or turns at another rate [s]."""
    followed: tuple[int, ...]
    """Indices of the targets that cameras follow."""


def target_intervals(
    tracks: Tracks,
    watchers: Watchers,
    target: int,
    rules: AccessConstraints,
    breaks_s: Mapping[str, Sequence[float]],
    duration_s: float,
    custom: Custom | None = None,
    step_s: float = ACCESS_STEP_S,
) -> Intervals:
    """Return when sensors can observe a target; rows are indices of the sensors.

    Args:
        tracks: Of the scene.
        watchers: The sensors.
        target: Index of the target.
        rules: What must hold besides a free line of sight and the target's existence.
        breaks_s: Times at which satellites and targets change their motion at once, by name.
        duration_s: Length of the scene [s].
        custom: Further rules by name.
        step_s: Step of the scan [s].
    """
    with_cameras = rules.in_fov or bool(custom)
    key = (watchers.satellites, target, rules, duration_s, step_s)
    known = _KNOWN.setdefault(tracks, {})
    if not with_cameras and key in known:
        return known[key]
    followed = watchers.followed if with_cameras else ()
    bodies = [tracks.targets[index].name for index in (target, *followed)]
    common = [time_s for name in bodies for time_s in breaks_s[name]]
    own = [breaks_s[tracks.satellites[index].name] for index in watchers.satellites]
    cameras = watchers.camera_breaks_s if with_cameras else [()] * len(own)
    found = access_intervals(
        [tracks.satellites[index] for index in watchers.satellites],
        tracks.position_function(target),
        tracks.sun.position_at_m,
        rules,
        tracks.pole_icrs,
        duration_s,
        step_s,
        custom=custom,
        fov=field_of_view(tracks, watchers, target),
        breaks_s=[sorted({*common, *sensor, *camera}) for sensor, camera in zip(own, cameras, strict=True)],
        followed_m=[tracks.position_function(index) for index in followed if index != target],
    )
    rows, starts, ends = zip(*found, strict=True) if found else ((), (), ())
    intervals = Intervals(np.array(rows, dtype=np.int64), np.array(starts, float), np.array(ends, float))
    first_s, last_s = tracks.exists_s[target]
    if first_s > 0.0 or last_s < duration_s:
        there = Intervals.whole(len(watchers.satellites), max(first_s, 0.0), max(min(last_s, duration_s), 0.0))
        intervals = intervals.shared(there)
    if not with_cameras:
        known[key] = intervals
    return intervals


_KNOWN: weakref.WeakKeyDictionary[Tracks, dict[Hashable, Intervals]] = weakref.WeakKeyDictionary()
"""Intervals that were found for tracks that somebody holds, where cameras play no part."""


def field_of_view(tracks: Tracks, watchers: Watchers, target: int) -> FieldOfView:
    """Return how the sensors' cameras stand, and in which apparent direction they have a target."""

    def direction(sensor: int, time_s: F64) -> F64:
        return apparent_mean(tracks, [target], satellite_state(tracks, watchers.satellites[sensor], time_s))

    return FieldOfView(watchers.camera, watchers.axes, direction)


def target_margins(
    tracks: Tracks,
    watchers: Watchers,
    target: int,
    rules: AccessConstraints,
    time_s: F64,
    custom: Custom | None = None,
) -> dict[str, F64]:
    """Return the signed margin of every rule, each (n_sensor, n_time)."""
    sensors_m = np.stack([tracks.satellites[index].position_at_m(time_s) for index in watchers.satellites])
    return margins(
        sensors_m,
        tracks.position_function(target)(time_s),
        tracks.sun.position_at_m(time_s),
        rules,
        tracks.pole_icrs,
        time_s=time_s,
        custom=custom,
        fov=field_of_view(tracks, watchers, target),
    )
