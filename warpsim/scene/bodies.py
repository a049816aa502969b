"""What moves in a scene: satellites, main targets on their trajectories, and what they release."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.gravity import Gravity, propagate
from warpsim.orbit.group import release_velocities
from warpsim.orbit.paths import Moving, states_of
from warpsim.scene.parts import TargetGroup

if TYPE_CHECKING:
    from warpsim.instant import Epoch
    from warpsim.scene.scene import Scene

F64 = npt.NDArray[np.float64]

STOWED_STEP_S = 120.0
"""Longest node step of a scene with later releases; so far before its release a target's own path is needed."""


@dataclass(frozen=True)
class Bodies:
    """All moving things, sensors first; GCRS axes."""

    scene: Scene
    names: list[str]
    carrier: list[int]
    """Row of the main target that each body goes with until its release, its own row where there is none."""
    release_s: list[float]
    """Time of release [s], -inf for what is never released."""

    def states(self, time_s: F64) -> tuple[F64, F64]:
        """Positions [m] and velocities [m/s] at times (n_time,), each (n_time, n_body, 3).

        A released target's path is its free flight; earlier than STOWED_STEP_S before the release, where nobody asks,
        it is the main target's. Files of states need to cover the scene only: before and after it motion goes on.
        """
        scene = self.scene
        within_s = 0.0, scene.duration_s
        parts = [_states_of("constellation", scene.constellation, scene.instant, time_s, within_s)]
        parts += [_group_states(group, number, scene, time_s) for number, group in enumerate(scene.groups_of_targets)]
        position, velocity = (np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True))
        return position, velocity


def bodies_of(scene: Scene) -> Bodies:
    """The moving things of a scene."""
    n_sensor = len(scene.sensor_names)
    carrier, release_s = list(range(n_sensor)), [-np.inf] * n_sensor
    for group in scene.groups_of_targets:
        main = len(carrier)
        for release in group.releases:
            carrier.append(main)
            release_s.append(-np.inf if release is None else release.time_s)
    return Bodies(scene, [*scene.sensor_names, *scene.target_names], carrier, release_s)


def _states_of(
    where: str, orbit: Moving, epoch: Epoch, time_s: F64, within_s: tuple[float, float] | None = None
) -> tuple[F64, F64]:
    """States of a constellation or trajectory; its errors begin with the field that describes it."""
    try:
        return states_of(orbit, epoch, time_s, within_s)
    except InputError as error:
        raise error.of(where) from None


def _group_states(group: TargetGroup, number: int, scene: Scene, time_s: F64) -> tuple[F64, F64]:
    """States of a group's targets, the main one first; those released at one time are propagated together."""
    where = "trajectory" if number == 0 else f"groups[{number - 1}].trajectory"
    releases = group.releases
    main_r, main_v = _states_of(where, group.trajectory, scene.instant, time_s, (0.0, scene.duration_s))
    position, velocity = (np.repeat(state, len(releases), axis=1) for state in (main_r, main_v))
    gravity: Gravity = getattr(group.trajectory, "gravity", "j2")
    pole = pole_of_date(scene.instant)
    for release in dict.fromkeys(releases[1:]):
        assert release is not None
        rows = np.array([row for row, other in enumerate(releases) if other == release])
        carrier_r, carrier_v = _states_of(where, group.trajectory, scene.instant, np.array([release.time_s]))
        # Each target takes the random numbers of its place in the group, whatever its neighbours are.
        velocities = release_velocities(carrier_v[0, 0], len(releases) - 1, release.speed_m_s, scene.seed, number)
        start = np.repeat(carrier_r[0], len(rows), axis=0), velocities[rows - 1]
        free = time_s >= release.time_s - STOWED_STEP_S
        try:
            flown = propagate(*start, time_s[free] - release.time_s, gravity, pole, release.time_s)
        except InputError as error:
            raise error.of(f"no flight after the release at {release.time_s:g} s").within(where) from None
        for states, own in zip((position, velocity), flown, strict=True):
            states[np.ix_(free, rows)] = own
    return position, velocity
