"""Bounds of the work and memory that a scene asks for, looked at before any of it begins."""

from __future__ import annotations

from collections.abc import Sequence

from warpsim.errors import InputError
from warpsim.scene.checks import known_names
from warpsim.scene.groups import MOST_TARGETS, AnyConstellation, TargetGroup
from warpsim.scene.sensors import Frames, Sensor
from warpsim.scene.short_form import with_paths
from warpsim.target.temperature import HeatBalance

LONGEST_TRACKS_S = 2e8
"""Longest scene times number of bodies: 1 GB of orbit nodes at most, and below 2 GB while they are made."""

LONGEST_SCENE_S = 31 * 86_400.0
"""Longest scene: free flight is integrated step by step, some ten seconds of work for a month."""

LONGEST_HEAT_S = 3e7
"""Longest scene, with HEAT_BALANCE_S, times number of heat balances: a microsecond of work for each second."""

HEAT_BALANCE_S = 700.0
"""Time of a scene [s] whose work is that of beginning a heat balance."""

MOST_VIEWS = 100_000_000
"""Frames times sensors of a kind: access is asked for every one, and numbers of frames take 4 bytes each in a report,
8 and their text in a run."""

MOST_BANDS = 100
"""Bands of all sensors: `warpsim check` takes 40 ms for one."""


def check_bounds(
    constellation: AnyConstellation,
    sensors: Sequence[Sensor],
    groups: Sequence[TargetGroup],
    frames: Frames,
    duration_s: float,
) -> None:
    """Check that a scene asks for no more than can be done; satellites and targets in files do not count.

    Raises:
        InputError: It does; the text names the field.
    """
    satellites = known_names(constellation)
    _check_bodies(len(satellites or []), groups, duration_s)
    n_sensor = 1 if satellites is None else len(satellites)
    for path, sensor in with_paths("sensors", sensors):
        n_frame = (sensor.frames or frames).count
        if n_frame * n_sensor > MOST_VIEWS:
            rule = f"must be so few that frames times satellites are at most {MOST_VIEWS:,}, got {n_frame:,} for"
            raise InputError(f"{rule} {n_sensor:,}", "frames.count").within(path if sensor.frames else "")
    n_band = sum(len(sensor.bands) for sensor in sensors)
    if n_band > MOST_BANDS:
        raise InputError(f"must be at most {MOST_BANDS} in all sensors, got {n_band}", "bands")


def _check_bodies(n_satellite: int, groups: Sequence[TargetGroup], duration_s: float) -> None:
    """Check the number of satellites and targets, and of heat balances among them."""
    n_target, heat_s = 0, 0.0
    for path, group in with_paths("groups", groups):
        n_orbit = None if group.orbits is None else len(known_names(group.orbits) or [])
        for entry, spec in enumerate(group.targets):
            n = spec.count if n_orbit is None else n_orbit
            n_target += n
            if isinstance(spec.temperature, HeatBalance):
                heat_s += n * (duration_s + HEAT_BALANCE_S)
            if heat_s > LONGEST_HEAT_S:
                rule = (
                    f"{n:,} heat balances over {duration_s:g} s are too much work: those of a scene times its length "
                    f"and {HEAT_BALANCE_S:g} s must be at most {LONGEST_HEAT_S:g} s"
                )
                raise InputError(rule, f"targets[{entry}].count").within(path)
        if n_target > MOST_TARGETS:
            raise InputError(f"must be at most {MOST_TARGETS:,} single targets in a scene", "targets").within(path)
    n_body = n_satellite + n_target
    if duration_s > LONGEST_SCENE_S and n_body * duration_s <= LONGEST_TRACKS_S:
        rule = f"must be at most {LONGEST_SCENE_S:g} (31 days); longer ones are several scenes"
        raise InputError(rule, "duration_s", duration_s, "g")
    if n_body * duration_s > LONGEST_TRACKS_S:
        raise InputError(
            f"{duration_s:g} s are too long for {n_body} satellites and targets: their product must be at most "
            f"{LONGEST_TRACKS_S:g} s",
            "duration_s",
        )
