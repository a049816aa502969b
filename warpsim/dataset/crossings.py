"""Distractors of data sets: groups of targets on paths that cross the field of a sensor of each sequence.

What they are, a satellite or an asteroid, is the scene's: their group has shape, surface, temperature and class. Only
their path is drawn: at the time of one frame they are where one pixel of one sensor looks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np

from warpsim.arrays import F64
from warpsim.config.distributions import IN_ORDER
from warpsim.config.fields import Number, Positive, closed_interval
from warpsim.config.model import config_model
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.orbit.earth import earth_clearance_m
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.streams import uniforms

LOWEST_M = 150e3
"""Least height of a distractor [m]."""

EDGE = 0.05
"""Part of the array on each side that no crossing is aimed at."""

MOST_TRIES = 200
"""Draws of a path before it is given up: lines of sight may end at the Earth, or below orbits."""

TOO_LATE_S = 1e-4
"""From the end of a scene: light takes longer."""

_PER_TRY = 8
"""Uniform numbers of a draw."""


@config_model
class Crossing:
    """How a group of targets crosses the field of a sensor.

    Args:
        range_km: Least and largest distance from the sensor as it crosses [km], drawn evenly in the logarithm.
        speed_km_s: Least and largest speed there, geocentric [km/s], in any direction; on circular orbits of any
            inclination when left out.
        probability: Of being there at all in a sequence; else the targets are absent.
    """

    range_km: Annotated[tuple[Positive, Positive], IN_ORDER]
    speed_km_s: Annotated[tuple[Positive, Positive], IN_ORDER] | None = None
    probability: Annotated[Number, closed_interval(0, 1)] = 1.0


def check_crossings(scene: Scene, crossings: Mapping[str, Crossing]) -> None:
    """Check that there are such groups, which have a trajectory to replace, and are there all the time."""
    groups = {group.name: group for group in scene.groups}
    for name in crossings:
        if name not in groups:
            raise InputError(f"must name a group of the scene ({', '.join(groups)})", "crossings", name)
        group = groups[name]
        if group.trajectory is None or group.start_s > 0.0 or group.exists_s is not None:
            rule = "must have a trajectory, which is replaced, and no orbits, start_s or exists_s"
            raise InputError(rule, f"crossings.{name}")


def crossing_changes(
    scene: Scene, crossings: Mapping[str, Crossing], sensors: Sequence[str], time_s: F64, seed: int, number: int
) -> dict[str, Any]:
    """Return changes of a scene, as `Scene.replace` takes them, that let groups cross fields of sensors.

    Args:
        scene: The scene of a sequence.
        crossings: How, by group.
        sensors: Sensors, of one of which each group crosses the field.
        time_s: Times of the frames, at one of which it does [s].
        seed: Seed of the draws.
        number: Of the sequence.

    Raises:
        InputError: No draw of a group is above the Earth and in sight.
    """
    changes: dict[str, Any] = {}
    names = [group.name for group in scene.groups]
    for name, crossing in crossings.items():
        u = uniforms(seed, f"dataset crossing {name}", number, 1 + MOST_TRIES * _PER_TRY)
        field = f"groups__{names.index(name)}"
        if u[0] >= crossing.probability:
            # Groups must be there for some time: so they come when no light of theirs can reach a frame any more.
            changes[f"{field}__exists_s"] = [scene.duration_s - TOO_LATE_S, scene.duration_s]
            continue
        tries = (_path(scene.scenario, crossing, sensors, time_s, row) for row in u[1:].reshape(-1, _PER_TRY))
        path = next((found for found in tries if found is not None), None)
        if path is None:
            rule = f"no path in {MOST_TRIES} draws that is in sight and above {LOWEST_M / 1e3:g} km; change range_km"
            raise InputError(rule, f"crossings.{name}")
        changes[f"{field}__trajectory"] = path
    return changes


def _path(scenario: Scenario, crossing: Crossing, sensors: Sequence[str], time_s: F64, u: F64) -> dict[str, Any] | None:
    """Free flight through where a pixel looks; None where that is hidden by the Earth, or not above it."""
    sensor = sensors[int(u[0] * len(sensors))]
    at_s = float(time_s[int(u[1] * len(time_s))])
    instrument = scenario.instrument_of(sensor)
    camera = instrument.sensor.camera
    xy_px = (EDGE + (1.0 - 2.0 * EDGE) * u[2:4]) * [camera.n_col, camera.n_row] - 0.5
    (direction,) = camera.direction(xy_px[None], scenario.view_axes(sensor, [at_s])[0])
    own_m = instrument.state(sensor, np.array([at_s]))[0].reshape(3)
    near_km, far_km = crossing.range_km
    position_m = own_m + 1e3 * near_km * (far_km / near_km) ** u[4] * direction
    radius_m = float(np.linalg.norm(position_m))
    in_sight = earth_clearance_m(own_m, position_m, scenario.tracks.pole_icrs) > 0.0
    if radius_m < EARTH_EQUATORIAL_RADIUS_M + LOWEST_M or not in_sight:
        return None
    velocity_m_s = _direction(position_m / radius_m, crossing.speed_km_s is None, u[5], u[6])
    if crossing.speed_km_s is None:
        velocity_m_s *= math.sqrt(EARTH_GM_M3_S2 / radius_m)
    else:
        low, high = crossing.speed_km_s
        velocity_m_s *= 1e3 * (low + (high - low) * u[7])
    state = {"position_m": position_m.tolist(), "velocity_m_s": velocity_m_s.tolist(), "time_s": at_s}
    return {"kind": "state_vector", **state}


def _direction(up: F64, is_level: bool, turn: float, height: float) -> F64:
    """A unit vector: any, or any that is level."""
    east = np.cross([0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0], up)
    east /= np.linalg.norm(east)
    sine = 0.0 if is_level else 2.0 * height - 1.0
    angle = 2.0 * math.pi * turn
    level = math.cos(angle) * east + math.sin(angle) * np.cross(up, east)
    return np.asarray(sine * up + math.sqrt(1.0 - sine**2) * level)
