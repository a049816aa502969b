"""Tracks of a scene: positions of all bodies, sampled once on the host in float64."""

from __future__ import annotations

import math
import weakref
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.config.model import parts_with_files
from warpsim.errors import InputError
from warpsim.instant import Instant
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.node_steps import make_tracks
from warpsim.orbit.sun import earth_states
from warpsim.orbit.track import PositionFunction, Track
from warpsim.scene.groups import AnyConstellation, TargetGroup
from warpsim.scene.motion import MARGIN_S, motion_of
from warpsim.scene.targets import SceneTarget

LONGEST_STEP_S = 3600.0
"""Longest node step."""


@dataclass(frozen=True, eq=False, repr=False)
class Tracks:
    """Tracks of all bodies of a scene, each with its own nodes; GCRS axes, geocentric."""

    satellites: list[Track]
    targets: list[Track]
    sun: Track
    """Its nodes are those of the satellites and targets with the longest step."""
    earth_velocity_m_s: F64
    """Barycentric velocity of the Earth at the Sun's nodes [m/s], shape (n_node, 3)."""
    earth_barycentric_m: F64
    """Barycentric position of the Earth at the Sun's nodes [m], shape (n_node, 3)."""
    earth_heliocentric_m: F64
    """Heliocentric position of the Earth at the Sun's nodes [m], shape (n_node, 3)."""
    pole_icrs: F64
    """The pole of date at the epoch: axis of J2 and of the ellipsoid, shape (3,)."""
    carrier: npt.NDArray[np.int64]
    """Index of the target that each target goes with until its release, its own where there is none, (n_target,)."""
    release_s: F64
    """Time of each target's release [s], -inf where there is none, (n_target,)."""
    exists_s: F64
    """From when to when each target is there [s], (n_target, 2)."""

    def __repr__(self) -> str:
        sizes = f"{len(self.satellites)} satellites, {len(self.targets)} targets"
        return f"Tracks({sizes}, nodes every {self.steps} s)"

    @property
    def start_s(self) -> float:
        """Time from which on there are states of all bodies [s]."""
        return max(track.start_s for track in (*self.satellites, *self.targets))

    @property
    def step_s(self) -> float:
        """Shortest time between nodes [s]."""
        return min(track.step_s for track in (*self.satellites, *self.targets))

    @property
    def longest_step_s(self) -> float:
        """Longest time between nodes [s], that of the Sun's."""
        return self.sun.step_s

    @property
    def steps(self) -> str:
        """Times between nodes [s], for people: "12", or "1.5 to 12"."""
        shortest_s, longest_s = self.step_s, self.longest_step_s
        return f"{longest_s:g}" if shortest_s == longest_s else f"{shortest_s:g} to {longest_s:g}"

    @property
    def error_m(self) -> float:
        """Largest measured interpolation error [m]."""
        return max(track.error_m for track in (*self.satellites, *self.targets))

    def of(self, name: str) -> Track:
        """Return the track of a satellite or target; before its release that is not where the target is.

        Raises:
            InputError: No such name.
        """
        body = self._index(name)
        return (*self.satellites, *self.targets)[body]

    def state(self, name: str, time_s: npt.ArrayLike) -> tuple[F64, F64]:
        """Return position [m] and velocity [m/s] of a satellite or target, each of the shape of time_s plus (3,).

        Before its release a target is where its main target is.

        Raises:
            InputError: No such name, or a time outside the tracks.
        """
        body = self._index(name) - len(self.satellites)
        return self.satellites[body].state(time_s) if body < 0 else self.target_state(body, time_s)

    def target_state(self, target: int, time_s: npt.ArrayLike) -> tuple[F64, F64]:
        """Return the state of a target by its index, as `state` does."""
        time = np.asarray(time_s, dtype=np.float64)
        position, velocity = self.targets[target].state(time)
        carried = time < self.release_s[target]
        if carried.any():
            with_main = self.targets[self.carrier[target]].state(time)
            position, velocity = (
                np.where(carried[..., None], main, own)
                for main, own in zip(with_main, (position, velocity), strict=True)
            )
        return position, velocity

    def position_function(self, target: int) -> PositionFunction:
        """Return geocentric positions of a target [m] as a function of time, (n,) -> (n, 3)."""
        if self.carrier[target] == target:
            return self.targets[target].position_at_m
        return lambda time_s: self.target_state(target, time_s)[0]

    def exist(self, target: int, time_s: F64) -> npt.NDArray[np.bool_]:
        """Return whether a target is there, of the shape of time_s."""
        first_s, last_s = self.exists_s[target]
        return np.asarray((time_s >= first_s) & (time_s <= last_s))

    def _index(self, name: str) -> int:
        for index, track in enumerate((*self.satellites, *self.targets)):
            if track.name == name:
                return index
        known = ", ".join(track.name for track in (*self.targets[:1], *self.satellites[:3]))
        raise InputError(f"must be a sensor, a target or 'sun' ({known}, ...)", "name", name)


_KNOWN: weakref.WeakValueDictionary[Hashable, Tracks] = weakref.WeakValueDictionary()
"""Live tracks by their inputs."""


def build_tracks(
    constellation: AnyConstellation,
    groups: Sequence[TargetGroup],
    targets: Sequence[SceneTarget],
    epoch: Instant,
    duration_s: float,
    seed: int,
) -> Tracks:
    """Sample all bodies of a scene, with the Sun and the Earth's own motion.

    Live tracks are returned again where all their inputs are the same. The seed is that of the releases.

    Raises:
        InputError: A path cannot be propagated, because it falls through half the Earth's radius or its file ends, say.
    """
    motion = motion_of(constellation, groups, epoch, duration_s, seed)
    names = (*constellation.names, *(target.name for target in targets))
    paths = (constellation, *(group.path for group in groups))
    checksums = tuple(part.checksum for part, _ in parts_with_files(paths))
    key = (motion, names, checksums)
    known = _KNOWN.get(key)
    if known is not None:
        return known
    n_satellite = len(names) - len(targets)
    mains = {target.group: number for number, target in reversed(list(enumerate(targets)))}
    carrier = [mains[target.group] if target.is_released else number for number, target in enumerate(targets)]
    release_s = np.array([target.release_s for target in targets], dtype=np.float64)
    exists_s = np.array([target.exists_s for target in targets], dtype=np.float64).reshape(-1, 2)
    # From when to when a path must be good: what ends with the scene, or before it begins, has no end within it.
    counted_s = np.where((exists_s > 0.0) & (exists_s < duration_s), exists_s, [-math.inf, math.inf])
    counted_s[:, 0] = np.maximum(counted_s[:, 0], release_s)
    changes = bool((release_s > 0).any() or np.isfinite(counted_s).any())  # within the scene
    tracks = make_tracks(
        names,
        motion.states,
        duration_s,
        counted_s=np.concatenate([np.full((n_satellite, 2), [-math.inf, math.inf]), counted_s]),
        longest_s=MARGIN_S if changes else LONGEST_STEP_S,
        some_states=motion.states,
    )
    longest = max(tracks, key=lambda track: track.step_s)
    earth = earth_states(epoch, longest.node_s)
    found = Tracks(
        tracks[:n_satellite],
        tracks[n_satellite:],
        Track("sun", longest.start_s, longest.step_s, earth.sun_m, np.gradient(earth.sun_m, longest.step_s, axis=0)),
        earth.velocity_m_s,
        earth.barycentric_m,
        earth.heliocentric_m,
        pole_of_date(epoch),
        np.array(carrier, dtype=np.int64),
        release_s,
        exists_s,
    )
    _KNOWN[key] = found
    return found
