"""Tracks of a scene: where everything is, sampled once on the host in float64."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.orbit.earth import pole_of_date
from warpsim.orbit.gravity import propagate
from warpsim.orbit.group import release_velocities
from warpsim.orbit.sun import earth_position_m, earth_velocity_m_s, sun_position_m
from warpsim.orbit.track import Track, choose_step_s, node_grid, sample_tracks

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
        """The track of a sensor or target.

        Raises:
            InputError: No such name.
        """
        for track in (*self.sensors, *self.targets):
            if track.name == name:
                return track
        known = ", ".join(track.name for track in (self.targets[0], *self.sensors[:3]))
        raise InputError(f"name: must be a sensor, a target or 'sun' ({known}, ...), got {name!r}")


def build_tracks(scene: Scene) -> Tracks:
    """Propagate satellites and targets of a scene and sample them on one node grid.

    Satellites and the main target's arc use the arc's gravity model, J2 unless told otherwise; released targets start
    from the main target's state at the epoch.

    Raises:
        InputError: A path cannot be propagated, because it falls to the Earth's centre, say.
    """
    arc, epoch = scene.trajectory, scene.epoch
    pole = pole_of_date(epoch)
    satellites = scene.constellation.state()
    main_position, main_velocity = (part[0] for part in arc.state(np.zeros(1)))
    velocities = release_velocities(main_velocity, len(scene.target_names) - 1, scene.release.speed_m_s, scene.seed)
    # The main target's own start state is the arc's: one propagation serves the whole group.
    target_velocity = np.concatenate([main_velocity[None], velocities])
    target_position = np.broadcast_to(main_position, target_velocity.shape)
    start = np.concatenate([satellites[0], target_position]), np.concatenate([satellites[1], target_velocity])

    def state(time_s: F64) -> tuple[F64, F64]:
        return propagate(*start, time_s, arc.gravity, pole)

    try:
        step_s = choose_step_s(state, scene.duration_s)
    except InputError as error:
        raise InputError(f"trajectory, constellation: no motion over {scene.duration_s:g} s: {error}") from None
    start_s, n_node = node_grid(scene.duration_s, step_s)
    names = [*scene.sensor_names, *scene.target_names]
    tracks = sample_tracks(names, state, start_s, step_s, n_node)
    nodes_s = start_s + step_s * np.arange(n_node)
    sun_m = sun_position_m(epoch, nodes_s)
    sun = Track("sun", start_s, step_s, sun_m, np.gradient(sun_m, step_s, axis=0))
    n_sensor = len(scene.sensor_names)
    earth = earth_velocity_m_s(epoch, nodes_s), *earth_position_m(epoch, nodes_s)
    return Tracks(tracks[:n_sensor], tracks[n_sensor:], sun, *earth, pole)
