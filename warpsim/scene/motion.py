"""States of all bodies of a scene: satellites, main targets on their trajectories, and released targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.instant import Instant, instant_after
from warpsim.orbit.constellations import Propagator, states_of
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.gravity import Gravity, propagate
from warpsim.scene.groups import AnyConstellation, Release, TargetGroup
from warpsim.scene.short_form import item_path
from warpsim.streams import uniforms

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

MARGIN_S = 120.0
"""Longest node step where targets begin to move, or end, within a scene; motion goes on for so long beyond."""


@dataclass(frozen=True)
class GroupMotion:
    """Inputs of the motion of a group."""

    path: Propagator
    path_field: str
    releases: tuple[Release | None, ...]
    start_s: float
    exists_s: tuple[float, float]


@dataclass(frozen=True)
class Motion:
    """Motion of all bodies of a scene: satellites first, then the targets group by group."""

    constellation: AnyConstellation
    groups: tuple[GroupMotion, ...]
    epoch: Instant
    duration_s: float
    seed: int

    @cached_property
    def _ends(self) -> I64:
        """Numbers of the bodies behind the satellites, and behind each group."""
        return np.cumsum([len(self.constellation.names), *(len(group.releases) for group in self.groups)])

    def states(self, time_s: F64, bodies: I64 | None = None) -> tuple[F64, F64]:
        """Return positions [m] and velocities [m/s] at times (n_time,), GCRS axes, each (n_time, n_body, 3).

        `bodies` are the numbers, ascending, of those that are asked for, all if left out: others are not propagated.

        A released target's path is its free flight; farther than MARGIN_S before the release, where nobody asks, it is
        the main target's. A target that is not there stays where it was MARGIN_S before it came, or after it went.
        Files of states need to cover what is within the scene only: before and after it motion goes on.

        Raises:
            InputError: A path cannot be propagated.
        """
        own, *members = self._by_part(bodies)
        span_s = 0.0, self.duration_s
        parts = []
        if own is None or len(own):
            parts.append(_states_of(self.constellation, self.epoch, time_s, span_s, "constellation", own))
        for number, (group, some) in enumerate(zip(self.groups, members, strict=True)):
            try:
                if some is None or len(some):
                    parts.append(self._group_states(group, number, time_s, some))
            except InputError as error:
                raise error.within(item_path("groups", number, len(self.groups))) from None
        position, velocity = (np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True))
        return position, velocity

    def _by_part(self, bodies: I64 | None) -> list[I64 | None]:
        """Numbers within the constellation, and within each group; None if all are meant."""
        if bodies is None:
            return [None] * (1 + len(self.groups))
        firsts = np.concatenate([[0], self._ends[:-1]])
        parts = np.split(bodies, np.searchsorted(bodies, self._ends[:-1]))
        return [part - first for part, first in zip(parts, firsts, strict=True)]

    def _group_states(self, group: GroupMotion, number: int, scene_s: F64, some: I64 | None) -> tuple[F64, F64]:
        """States of a group's targets, or some of them; those released at one time are propagated together."""
        epoch = instant_after(self.epoch, group.start_s)
        first_s, last_s = (bound_s - group.start_s for bound_s in group.exists_s)
        within_s = max(first_s, -group.start_s), min(last_s, self.duration_s - group.start_s)
        time_s = np.clip(scene_s - group.start_s, first_s - MARGIN_S, last_s + MARGIN_S)
        is_single = any(release is not None for release in group.releases)
        position, velocity = _states_of(
            group.path, epoch, time_s, within_s, group.path_field, None if is_single else some
        )
        stays = (scene_s < group.exists_s[0] - MARGIN_S) | (scene_s > group.exists_s[1] + MARGIN_S)
        members = np.arange(len(group.releases)) if some is None else some
        chosen = [group.releases[member] for member in members.tolist()]
        releases = list(dict.fromkeys(release for release in chosen if release is not None))
        if is_single:
            position, velocity = (np.repeat(state, len(members), axis=1) for state in (position, velocity))
        gravity: Gravity = getattr(group.path, "gravity", "j2")
        pole = pole_of_date(epoch)
        for release in releases:
            rows = np.array([row for row, other in enumerate(chosen) if other == release])
            carrier = _states_of(group.path, epoch, np.array([release.time_s]), None, group.path_field)
            carrier_m, carrier_m_s = carrier[0][0], carrier[1][0, 0]
            # Each target takes the random numbers of its position in the group, whatever its neighbours are.
            speeds = release.speed_m_s
            velocities = release_velocities(carrier_m_s, len(group.releases) - 1, speeds, self.seed, number)
            start = np.repeat(carrier_m, len(rows), axis=0), velocities[members[rows] - 1]
            free = time_s >= release.time_s - MARGIN_S
            try:
                flown = propagate(*start, time_s[free] - release.time_s, gravity, pole, release.time_s)
            except InputError as error:
                what = f"no flight after the release at {release.time_s:g} s"
                raise error.of(what).within(group.path_field) from None
            for states, own in zip((position, velocity), flown, strict=True):
                states[np.ix_(free, rows)] = own
        velocity[stays] = 0.0
        return position, velocity


def motion_of(
    constellation: AnyConstellation, groups: Sequence[TargetGroup], epoch: Instant, duration_s: float, seed: int
) -> Motion:
    """Return the motion of all bodies of a scene."""
    parts = tuple(
        GroupMotion(group.path, group.path_field, tuple(group.releases), group.start_s, group.span_s)
        for group in groups
    )
    return Motion(constellation, parts, epoch, duration_s, seed)


def _states_of(
    path: Propagator,
    epoch: Instant,
    time_s: F64,
    within_s: tuple[float, float] | None,
    field: str,
    bodies: I64 | None = None,
) -> tuple[F64, F64]:
    """States of a constellation or trajectory; its errors begin with the field that describes it."""
    try:
        return states_of(path, epoch, time_s, within_s, bodies)
    except InputError as error:
        raise error.within(field) from None


def release_velocities(
    main_velocity_m_s: npt.ArrayLike, n: int, speed_m_s: tuple[float, float], seed: int, group: int = 0
) -> F64:
    """Return inertial velocities of released targets [m/s], shape (n, 3).

    Directions relative to the main target are isotropic, speeds uniform from the lowest to the highest (the paper's
    group: 2 to 5 m/s). Target i uses numbers 3i to 3i + 2 of the seed's stream for the group's releases, so a larger
    group begins with the smaller one.
    """
    main = np.asarray(main_velocity_m_s, np.float64)
    if main.shape != (3,) or not np.isfinite(main).all():
        raise InputError("must be a finite 3-vector", "main_velocity_m_s", main.tolist())
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 0:
        raise InputError("must be a whole number >= 0", "n", n)
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**64:
        raise InputError("must be a whole number in 0..2^64 - 1", "seed", seed)
    low, high = (float(value) for value in speed_m_s)
    if not (math.isfinite(high) and 0.0 <= low <= high):
        raise InputError("must be two numbers with 0 <= low <= high", "speed_m_s", speed_m_s)

    uniform = uniforms(int(seed), "group release", group, 3 * int(n)).reshape(int(n), 3)
    z = 2.0 * uniform[:, 0] - 1.0  # equal areas in z: isotropic
    azimuth = 2.0 * math.pi * uniform[:, 1]
    speed = low + (high - low) * uniform[:, 2]
    across = np.sqrt(1.0 - z * z)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    return np.asarray(main + speed[:, None] * direction)
