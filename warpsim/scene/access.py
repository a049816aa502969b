"""Access and eclipses of a scene: its tracks, rules and cameras put before the judges in `orbit/`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.orbit.access import AccessInterval, access_intervals, margins
from warpsim.orbit.eclipse import eclipses, sunlit_fraction
from warpsim.orbit.rules import AccessConstraints, FieldOfView, MarginFunction
from warpsim.scene.bends import access_breaks_s
from warpsim.scene.view_axes import apparent_mean, tracked_targets

if TYPE_CHECKING:
    from astropy.table import Table

    from warpsim.scene.scene import Scene

F64 = npt.NDArray[np.float64]
Custom = Mapping[str, MarginFunction]


def intervals_of(
    scene: Scene, target: str, sensors: Sequence[str], rules: AccessConstraints, custom: Custom | None, step_s: float
) -> list[AccessInterval]:
    """Intervals in which sensors can observe a target; numbers of sensors count in the list given."""
    tracks, with_cameras = scene.tracks, rules.in_fov or bool(custom)
    first, count = tracked_targets(scene) if with_cameras else (0, 0)
    followed = [name for name in scene.target_names[first : first + count] if name != target]
    return access_intervals(
        [tracks.of(name) for name in sensors],
        tracks.position_function(target),
        tracks.sun.position_at_m,
        rules,
        tracks.pole_icrs,
        scene.duration_s,
        step_s,
        custom=custom,
        fov=field_of_view(scene, target, sensors),
        breaks_s=access_breaks_s(scene, target, sensors, with_cameras),
        followed_m=[tracks.position_function(name) for name in followed],
    )


def access_table(
    scene: Scene,
    intervals: Sequence[AccessInterval],
    target: str,
    sensors: Sequence[str],
    rules: AccessConstraints,
    custom: Custom | None,
) -> Table:
    """Intervals as a table that says what they are of."""
    rows = [(sensors[i], start_s, end_s, end_s - start_s) for i, start_s, end_s in intervals]
    in_force = {name: value for name, value in asdict(rules).items() if value is not None and value is not False}
    meta = {"target": target, "epoch_utc": scene.epoch_utc, "rules": in_force, "custom_rules": list(custom or {})}
    return _table_of_times(rows, ("sensor", "start_s", "end_s", "duration_s"), meta)


def margins_of(
    scene: Scene, time_s: F64, target: str, sensors: Sequence[str], rules: AccessConstraints, custom: Custom | None
) -> dict[str, F64]:
    """Signed margins of all rules, each (n_sensor, n_time)."""
    places = np.stack([scene.position_m(name, time_s) for name in sensors])
    return margins(
        places,
        scene.position_m(target, time_s),
        scene.position_m("sun", time_s),
        rules,
        scene.tracks.pole_icrs,
        time_s=time_s,
        custom=custom,
        fov=field_of_view(scene, target, sensors),
    )


def field_of_view(scene: Scene, target: str, sensors: Sequence[str]) -> FieldOfView:
    """How the sensors' cameras stand, and in which apparent direction they have the target."""
    tracks = scene.tracks

    def direction(number: int, time_s: F64) -> F64:
        return apparent_mean(tracks, [target], time_s, *tracks.of(sensors[number]).state(time_s))

    return FieldOfView(scene.camera, lambda number, time_s: scene.view_axes(sensors[number], time_s), direction)


def eclipse_table(scene: Scene, name: str, step_s: float) -> Table:
    """Passages of a sensor or target through the Earth's shadow."""
    _check_body(scene, name)
    tracks = scene.tracks
    found = eclipses(
        tracks.position_function(name), tracks.sun.position_at_m, tracks.pole_icrs, scene.duration_s, step_s
    )
    rows = [(*eclipse, eclipse.end_s - eclipse.start_s) for eclipse in found]
    names = ("start_s", "umbra_start_s", "umbra_end_s", "end_s", "duration_s")
    return _table_of_times(rows, names, {"name": name, "epoch_utc": scene.epoch_utc})


def sunlit_fraction_of(scene: Scene, name: str, time_s: npt.ArrayLike) -> F64:
    """Share of the Sun's disc that a sensor or target sees."""
    _check_body(scene, name)
    times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
    return sunlit_fraction(scene.position_m(name, times), scene.position_m("sun", times), scene.tracks.pole_icrs)


def _check_body(scene: Scene, name: str) -> None:
    if name not in scene.sensor_names and name not in scene.target_names:
        known = ", ".join([scene.target_names[0], *scene.sensor_names[:3]])
        raise InputError(f"must be a sensor or a target ({known}, ...)", "name", name)


def chosen_target(scene: Scene, name: str | None) -> str:
    """The target asked for, the main target if none is.

    Raises:
        InputError: No such target.
    """
    if name is None:
        return scene.target_names[0]
    if name not in scene.target_names:
        raise InputError(f"must be a target of the scene ({_some(scene.target_names)})", "target", name)
    return name


def chosen_sensors(scene: Scene, names: Sequence[str] | None) -> list[str]:
    """The sensors asked for, all if none are.

    Raises:
        InputError: No such sensor, or one twice.
    """
    if names is None:
        return scene.sensor_names
    chosen = [names] if isinstance(names, str) else list(names)
    known = set(scene.sensor_names)
    for name in chosen:
        if name not in known:
            raise InputError(f"must be sensors of the scene ({_some(scene.sensor_names)})", "sensors", name)
    if not chosen or len(set(chosen)) < len(chosen):
        raise InputError(f"must be one or more without repeats, got {', '.join(chosen) or 'none'}", "sensors")
    return chosen


def _some(names: Sequence[str]) -> str:
    """The first names of a list, for messages."""
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def chosen_rules(scene: Scene, rules: AccessConstraints | None) -> AccessConstraints:
    """The rules given, the scene's own if none are.

    Raises:
        InputError: Something else is given.
    """
    if rules is None:
        return scene.access_rules
    if not isinstance(rules, AccessConstraints):
        raise InputError(f"must be AccessConstraints, got {type(rules).__name__}", "rules")
    return rules


def _table_of_times(rows: Sequence[tuple[Any, ...]], names: Sequence[str], meta: dict[str, Any]) -> Table:
    """A table whose columns in seconds say so."""
    from astropy.table import Table

    table = Table(rows=rows or None, names=names, dtype=[float if name.endswith("_s") else str for name in names])
    table.meta.update(meta)
    for name in names:
        if name.endswith("_s"):
            table[name].unit = "s"
            table[name].info.format = ".3f"
    return table
