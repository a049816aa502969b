"""States of all bodies of a scene: satellites, main targets, and released ones; and when their velocities jump."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from warpsim.arrays import F64, I64
from warpsim.errors import errors_at
from warpsim.instant import Instant, instant_after
from warpsim.orbit.constellations import ListedSatellites, MixedConstellation, Propagator, states_of
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.gravity import Gravity, propagate
from warpsim.scene.groups import AnyConstellation, Release, TargetGroup
from warpsim.scene.short_form import item_path
from warpsim.scene.targets import SceneTarget
from warpsim.streams import uniforms

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
            if some is None or len(some):
                with errors_at(item_path("groups", number, len(self.groups))):
                    parts.append(self._group_states(group, number, time_s, some))
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
            with errors_at(group.path_field, f"no flight after the release at {release.time_s:g} s"):
                flown = propagate(*start, time_s[free] - release.time_s, gravity, pole, release.time_s)
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
    with errors_at(field):
        return states_of(path, epoch, time_s, within_s, bodies)


def release_velocities(
    main_velocity_m_s: F64, n: int, speed_m_s: tuple[float, float], seed: int, group: int = 0
) -> F64:
    """Return inertial velocities of released targets [m/s], shape (n, 3).

    Directions relative to the main target are isotropic, speeds uniform from the lowest to the highest (the paper's
    group: 2 to 5 m/s). Target i uses numbers 3i to 3i + 2 of the seed's stream for the group's releases, so a larger
    group begins with the smaller one.
    """
    low, high = speed_m_s
    uniform = uniforms(seed, "group release", group, 3 * n).reshape(n, 3)
    z = 2.0 * uniform[:, 0] - 1.0  # equal areas in z: isotropic
    azimuth = 2.0 * math.pi * uniform[:, 1]
    speed = low + (high - low) * uniform[:, 2]
    across = np.sqrt(1.0 - z * z)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    return np.asarray(main_velocity_m_s + speed[:, None] * direction)


def breakpoints_s(
    constellation: AnyConstellation,
    groups: Sequence[TargetGroup],
    targets: Sequence[SceneTarget],
    epoch: Instant,
    duration_s: float,
) -> dict[str, list[float]]:
    """Return the times at which the velocity of each satellite and target may jump, ascending [s after the epoch].

    Only those within the scene, and only those that are known: of paths that have `breaks_s(epoch)`, releases, and the
    ends of a target's existence. Until its release a target's are those of its group's main target.
    """
    found = dict(_path_breaks(constellation, constellation.names, epoch))
    paths = [_group_breaks(group, epoch) for group in groups]
    mains = {target.group: target.name for target in reversed(targets)}
    for target in targets:
        own = paths[target.group].get(target.name, [])
        if target.is_released:
            carried = paths[target.group].get(mains[target.group], [])
            own = [time_s for time_s in carried if time_s < target.release_s] + [target.release_s]
        found[target.name] = [*own, *target.exists_s]
    return {name: sorted({time for time in times if 0 < time < duration_s}) for name, times in found.items()}


def _group_breaks(group: TargetGroup, epoch: Instant) -> dict[str, list[float]]:
    """Breakpoints of the paths of a group, by target [s after the scene's epoch]."""
    names = group.names if group.orbits is not None else group.names[:1]
    breaks = _path_breaks(group.path, names, instant_after(epoch, group.start_s))
    return {name: [time_s + group.start_s for time_s in times] for name, times in breaks}


def _path_breaks(path: object, names: Sequence[str], epoch: Instant) -> Iterator[tuple[str, list[float]]]:
    """Breakpoints by name in a path or constellation; objects of one part have them in common."""
    if isinstance(path, MixedConstellation):
        for item in path.parts:
            yield from _path_breaks(item, item.names, epoch)
    elif isinstance(path, ListedSatellites):
        for satellite in path.satellites:
            yield from _path_breaks(satellite.orbit, [satellite.name], epoch)
    else:
        breaks_s = getattr(path, "breaks_s", None)
        yield from ((name, [] if breaks_s is None else breaks_s(epoch)) for name in names)
