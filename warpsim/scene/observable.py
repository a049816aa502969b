"""Whether sensors can observe targets at the times of frames: all pairs at once, constraint by constraint."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from warpsim.orbit.access import constraints_by_cost
from warpsim.orbit.rules import AccessConstraints, AccessGeometry, FieldOfView
from warpsim.scene.access import Watchers, field_of_view
from warpsim.scene.tracks import Tracks

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

_PAIRS_AT_ONCE = 100_000  # (time, sensor, target) held at once: some 50 MB of temporaries


def can_observe(tracks: Tracks, watchers: Watchers, rules: AccessConstraints, time_s: F64) -> Mask:
    """Return whether sensors can observe each target at given times, (n_time, n_sensor, n_target)."""
    seen = np.empty((len(time_s), len(watchers.satellites), len(tracks.targets)), dtype=bool)
    for target in range(len(tracks.targets)):
        seen[..., target] = tracks.exist(target, time_s)[:, None]
    if not seen.size:
        return seen
    n_time = max(1, _PAIRS_AT_ONCE // seen[0].size)
    for first in range(0, len(time_s), n_time):
        part = slice(first, first + n_time)
        seen[part] = _observable(_Pairs(tracks, watchers, time_s[part]), rules, seen[part])
    return seen


class _Pairs:
    """Geometry of (time, sensor, target) at some times."""

    def __init__(self, tracks: Tracks, watchers: Watchers, time_s: F64) -> None:
        self._tracks, self._watchers, self._time_s = tracks, watchers, time_s
        self._sensor_m = np.stack([tracks.satellites[index].position_at_m(time_s) for index in watchers.satellites])
        self._target_m = np.stack([tracks.target_state(index, time_s)[0] for index in range(len(tracks.targets))])
        self._sun_m = tracks.sun.position_at_m(time_s)
        self._axes: dict[int, F64] = {}

    def view(self, time: I64, sensor: I64, target: I64, fov: FieldOfView | None = None) -> AccessGeometry:
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
            fov = FieldOfView(self._watchers.camera, self._axes_at, self._field(int(one)).direction)
            margin[rows] = self.view(time[rows], sensor[rows], target[rows], fov).frame_margin_deg[:, 0]
        return margin

    def _field(self, target: int) -> FieldOfView:
        return field_of_view(self._tracks, self._watchers, target)

    def _axes_at(self, sensor: int, time_s: F64) -> F64:
        """Commanded axes at some of the times; found once for all of them."""
        if sensor not in self._axes:
            self._axes[sensor] = self._watchers.axes(sensor, self._unique_s)
        return self._axes[sensor][np.searchsorted(self._unique_s, time_s)]

    @property
    def _unique_s(self) -> F64:
        return np.unique(self._time_s)


def _observable(pairs: _Pairs, rules: AccessConstraints, exist: Mask) -> Mask:
    """Where every constraint holds, among the pairs in which the target exists."""
    time, sensor, target = np.nonzero(exist)
    for rule in constraints_by_cost(rules):
        if rule.name == "fov_deg":
            margin = pairs.frame_margin_deg(time, sensor, target)
        else:
            view = pairs.view(time, sensor, target)
            margin = np.broadcast_to(rule.margin(view), view.shape)[:, 0]
        holds = margin >= 0.0
        time, sensor, target = time[holds], sensor[holds], target[holds]
    seen = np.zeros_like(exist)
    seen[time, sensor, target] = True
    return seen
