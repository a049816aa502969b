"""Tracks of a scene: where everything is, sampled once on the host in float64."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.sampling import make_tracks
from warpsim.orbit.sun import earth_states
from warpsim.orbit.track import PositionFunction, Track
from warpsim.scene.bodies import STOWED_STEP_S, bodies_of

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Tracks:
    """All moving things of a scene on one time grid; GCRS axes, geocentric."""

    sensors: list[Track]
    targets: list[Track]
    sun: Track
    earth_velocity_m_s: F64
    """Barycentric velocity of the Earth at the nodes [m/s], shape (n_node, 3)."""
    earth_barycentric_m: F64
    """Barycentric position of the Earth at the nodes [m], shape (n_node, 3)."""
    earth_heliocentric_m: F64
    """Heliocentric position of the Earth at the nodes [m], shape (n_node, 3)."""
    pole_icrs: F64
    """The pole of date at the epoch: axis of J2 and of the ellipsoid, shape (3,)."""
    carrier: npt.NDArray[np.int64]
    """Row among sensors and targets that each body goes with until its release, its own where there is none."""
    release_s: F64
    """Time of each body's release [s], -inf where there is none."""

    @property
    def start_s(self) -> float:
        """Time of the first node [s]."""
        return self.sensors[0].start_s

    @property
    def step_s(self) -> float:
        """Time between nodes [s]."""
        return self.sensors[0].step_s

    @property
    def n_node(self) -> int:
        """Number of nodes."""
        return self.sensors[0].n_node

    @property
    def error_m(self) -> float:
        """Largest measured interpolation error [m]."""
        return max(track.error_m for track in (*self.sensors, *self.targets))

    def of(self, name: str) -> Track:
        """The track of a sensor or target; before its release that is not where the target is.

        Raises:
            InputError: No such name.
        """
        return self._bodies[self._row(name)]

    def state(self, name: str, time_s: npt.ArrayLike) -> tuple[F64, F64]:
        """Position [m] and velocity [m/s] of a sensor or target, each of the shape of time_s plus (3,).

        Before its release a target is where its main target is.

        Raises:
            InputError: No such name, or a time outside the tracks.
        """
        row = self._row(name)
        time = np.asarray(time_s, dtype=np.float64)
        position, velocity = self._bodies[row].state(time)
        stowed = time < self.release_s[row]
        if stowed.any():
            carried = self._bodies[self.carrier[row]].state(time)
            position, velocity = (
                np.where(stowed[..., None], with_it, alone)
                for with_it, alone in zip(carried, (position, velocity), strict=True)
            )
        return position, velocity

    def position_function(self, name: str) -> PositionFunction:
        """Geocentric positions of a sensor or target [m] as a function of time, (n,) -> (n, 3)."""
        if self.carrier[self._row(name)] == self._row(name):
            return self.of(name).position_at_m
        return lambda time_s: self.state(name, time_s)[0]

    @property
    def _bodies(self) -> list[Track]:
        return [*self.sensors, *self.targets]

    def _row(self, name: str) -> int:
        for row, track in enumerate(self._bodies):
            if track.name == name:
                return row
        known = ", ".join(track.name for track in (self.targets[0], *self.sensors[:3]))
        raise InputError(f"must be a sensor, a target or 'sun' ({known}, ...)", "name", name)


def build_tracks(scene: Scene) -> Tracks:
    """Sample all bodies of a scene on one node grid, with the Sun and the Earth's own motion.

    Raises:
        InputError: A path cannot be followed, because it falls through half the Earth's radius or its file ends, say.
    """
    bodies, epoch = bodies_of(scene), scene.instant
    later = max(bodies.release_s) > 0
    longest_s = STOWED_STEP_S if later else 3600.0
    tracks = make_tracks(bodies.names, bodies.states, scene.duration_s, first_s=bodies.release_s, longest_s=longest_s)
    start_s, step_s, n_node = tracks[0].start_s, tracks[0].step_s, tracks[0].n_node
    nodes_s = start_s + step_s * np.arange(n_node)
    earth = earth_states(epoch, nodes_s)
    sun = Track("sun", start_s, step_s, earth.sun_m, np.gradient(earth.sun_m, step_s, axis=0))
    n_sensor = len(scene.sensor_names)
    return Tracks(
        tracks[:n_sensor],
        tracks[n_sensor:],
        sun,
        earth.velocity_m_s,
        earth.barycentric_m,
        earth.heliocentric_m,
        pole_of_date(epoch),
        np.array(bodies.carrier),
        np.array(bodies.release_s),
    )
