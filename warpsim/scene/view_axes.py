"""Commanded camera axes on the host: where cameras look, without their jitter. The twin of the stage aim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.directions import normalised, unit_vectors
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.scene.pointing import FixedPointing, TrackPointing
from warpsim.sky.apparent import apparent_direction

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene
    from warpsim.scene.tracks import Tracks

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

NEAREST_M = 1e-3
"""Tracks are good to 1 mm: a body nearer than that has no direction."""
UP_LOST_RAD = 1e-9


@dataclass(frozen=True)
class CommandedAxes:
    """Where a sensor's camera is told to look at some times."""

    axes: F64
    """Rows x (right), y (down), z (boresight), ICRS axes, shape (n, 3, 3)."""
    up_replaced: Mask
    """Whether `up` lay along the line of sight, so that another direction took its place, shape (n,)."""
    boresight_replaced: Mask
    """Whether what is tracked had no direction, so that the camera looks along its motion, shape (n,)."""


def tracked_targets(scene: Scene) -> tuple[int, int]:
    """First and number of the targets that cameras follow; no target when they follow none.

    Raises:
        InputError: There is no such target.
    """
    pointing, names = scene.pointing, scene.target_names
    if not isinstance(pointing, TrackPointing):
        return 0, 0
    if pointing.track == "main":
        return 0, 1
    first = 0
    for number, group in enumerate(scene.groups_of_targets):
        if pointing.track == ("group" if number == 0 else group.name):
            return first, len(group.names)
        first += len(group.names)
    if pointing.track not in names:
        groups = "".join(f", {group.name!r}" for group in scene.groups)
        raise InputError(f"must be 'main', 'group'{groups} or a target's name", "pointing.track", pointing.track)
    return names.index(pointing.track), 1


def image_turn(scene: Scene) -> F64:
    """What roll and offset make of camera axes that look straight at what they follow, shape (3, 3).

    First the roll, right-handed about the line of sight; then the shortest turn that puts it offset_px from the centre.
    """
    pointing, camera = scene.pointing, scene.camera
    roll = np.radians(pointing.roll_deg)
    rolled = np.array([[np.cos(roll), np.sin(roll), 0.0], [-np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    offset_px = pointing.offset_px if isinstance(pointing, TrackPointing) else (0.0, 0.0)
    return np.asarray(_shortest_turn(offset_px, camera) @ rolled)


def _shortest_turn(offset_px: tuple[float, float], camera: Camera) -> F64:
    """The shortest turn from the boresight to the direction that falls offset_px from it, in camera axes."""
    (x, y, z), *_ = camera.direction(np.add(camera.centre_px, offset_px)[None])
    across = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])  # cross product with (0, 0, 1) x (x, y, z)
    return np.asarray(np.eye(3) + across + across @ across / (1.0 + z))


def fixed_direction(pointing: FixedPointing) -> F64:
    """Unit vector of a fixed direction: ICRS, or (forward, right, zenith) of the satellite, shape (3,)."""
    return unit_vectors(*(pointing.ra_dec_deg or pointing.azimuth_elevation_deg or (0.0, 0.0)))


def commanded_axes(scene: Scene, sensor: str, time_s: npt.ArrayLike) -> CommandedAxes:
    """Camera axes of a sensor at times after the epoch [s], shape (n,).

    Raises:
        InputError: No such sensor, or a time outside the scene or the table of directions.
    """
    if sensor not in scene.sensor_names:
        raise InputError("must be a sensor of the scene", "sensor", sensor)
    times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
    number, pointing, tracks = scene.sensor_names.index(sensor), scene.pointing, scene.tracks
    place, velocity = tracks.sensors[number].state(times)
    zenith, normal = normalised(place), normalised(np.cross(place, velocity))
    forward = np.cross(normal, zenith)

    roll = np.zeros(len(times))
    local = False
    if isinstance(pointing, TrackPointing):
        first, count = tracked_targets(scene)
        boresight = apparent_mean(tracks, scene.target_names[first : first + count], times, place, velocity)
    elif isinstance(pointing, FixedPointing):
        boresight = np.broadcast_to(fixed_direction(pointing), (len(times), 3))
        local = pointing.ra_dec_deg is None
    else:
        sights = scene.sights
        assert sights is not None  # by the kind
        sights.check_sensor(number, sensor, times)
        boresight, roll = sights.at(number, times)
        local = sights.local
    if local:
        boresight = normalised(np.einsum("ni,nij->nj", boresight, np.stack([forward, -normal, zenith], axis=1)))

    no_sight = np.linalg.norm(boresight, axis=-1) < 0.5
    boresight = np.where(no_sight[:, None], forward, boresight)
    boresight = np.where((np.linalg.norm(boresight, axis=-1) < 0.5)[:, None], zenith, boresight)
    up, spare = {
        "zenith": (zenith, normal),
        "north": (np.broadcast_to([0.0, 0.0, 1.0], zenith.shape), np.broadcast_to([1.0, 0.0, 0.0], zenith.shape)),
        "orbit_normal": (normal, zenith),
    }[pointing.up]
    axes, up_lost = _camera_axes(boresight, up, spare)
    cosine, sine = np.cos(roll)[:, None], np.sin(roll)[:, None]
    x, y = axes[:, 0], axes[:, 1]
    rolled = np.stack([cosine * x + sine * y, cosine * y - sine * x, axes[:, 2]], axis=1)
    return CommandedAxes(np.asarray(image_turn(scene) @ rolled), up_lost, no_sight)


def apparent_mean(tracks: Tracks, names: Sequence[str], times: F64, place: F64, velocity: F64) -> F64:
    """Mean apparent direction of targets, light time and aberration included; 0 where there is none.

    Args:
        tracks: Of the scene.
        names: Names of the targets.
        times: Times after the epoch [s], shape (n,).
        place: Geocentric position of the observer [m], shape (n, 3).
        velocity: Its geocentric velocity [m/s], shape (n, 3).
    """
    earth_velocity = _earth_velocity(tracks, times)
    towards = np.zeros_like(place)
    for name in names:
        emitted = times
        for _ in range(3):
            vector = tracks.state(name, emitted)[0] - place
            distance = np.linalg.norm(vector, axis=-1)
            emitted = times - distance / SPEED_OF_LIGHT_M_S
        here = distance <= NEAREST_M
        vector[here] = [1.0, 0.0, 0.0]  # any direction: it is not used
        barycentric = apparent_direction(normalised(vector), -earth_velocity)
        seen = apparent_direction(barycentric, earth_velocity + velocity)
        towards += np.where(here[:, None], 0.0, seen)
    towards[np.linalg.norm(towards, axis=-1) < 1e-9] = 0.0
    return normalised(towards)


def _earth_velocity(tracks: Tracks, times: F64) -> F64:
    """Barycentric velocity of the Earth, linear between nodes as in the kernels, shape (n, 3)."""
    phase = (times - tracks.start_s) / tracks.step_s
    node = np.clip(np.floor(phase).astype(np.int64), 0, tracks.n_node - 2)
    before, after = tracks.earth_velocity_m_s[node], tracks.earth_velocity_m_s[node + 1]
    return np.asarray(before + (after - before) * (phase - node)[:, None])


def _camera_axes(boresight: F64, up: F64, spare: F64) -> tuple[F64, Mask]:
    """Axes with y away from `up`, and where it lies along the boresight, so that the spare serves."""

    def across(direction: F64) -> tuple[F64, Mask]:
        part = direction - boresight * np.sum(boresight * direction, axis=-1, keepdims=True)
        length = np.linalg.norm(direction, axis=-1)
        return part, np.linalg.norm(part, axis=-1) <= UP_LOST_RAD * length

    best, up_lost = across(up)
    second, spare_lost = across(spare)
    axis = np.where(np.abs(boresight[:, :1]) > 0.7, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    second = np.where(spare_lost[:, None], across(axis)[0], second)
    y = -normalised(np.where(up_lost[:, None], second, best))
    return np.stack([np.cross(y, boresight), y, boresight], axis=1), up_lost


