"""Commanded camera axes on the host, without pointing errors: the float64 twin of the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.directions import normalised
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.quaternion import rotated
from warpsim.scene.pointing import Up
from warpsim.scene.pointing_table import DirectionRows
from warpsim.scene.tracks import Tracks
from warpsim.sky.apparent import apparent_direction
from warpsim.target.attitude_table import AttitudeRows

Mask = npt.NDArray[np.bool_]

NEAREST_M = 1e-3
"""Tracks are good to 1 mm: a body nearer than that has no direction."""
UP_LOST_RAD = 1e-9


@dataclass(frozen=True, eq=False)
class PointingLaw:
    """Pointing law: the direction that a boresight tracks, and the roll of the image about it."""

    kind: str
    """track, fixed, scan or attitude."""
    up: Up
    turn: F64
    """What roll and offset make of camera axes that look straight at it, or of the body's axes, shape (3, 3)."""
    targets: range = range(0)
    """track: indices of the targets, whose mean direction is tracked."""
    direction: F64 | None = None
    """fixed: unit vector, ICRS or (forward, right, zenith) of the satellite, (3,); or one for each time, (n, 3)."""
    local: bool = False
    """fixed: whether the direction is in the satellite's local frame."""
    roll_rad: float | F64 = 0.0
    """fixed: roll of a row of a table, or one for each time, (n,)."""


@dataclass(frozen=True)
class CommandedAxes:
    """Commanded axes of a camera at some times."""

    axes: F64
    """Rows x (right), y (down), z (boresight), ICRS axes, shape (n, 3, 3)."""
    up_replaced: Mask
    """Whether `up` is along the line of sight, so that a fallback direction is used, shape (n,)."""
    boresight_replaced: Mask
    """Whether what is tracked had no direction, so that the camera looks along its motion, shape (n,)."""


@dataclass(frozen=True)
class SatelliteState:
    """State of a satellite at some times."""

    time_s: F64
    """After the epoch [s], shape (n,)."""
    position_m: F64
    """Geocentric [m], shape (n, 3)."""
    velocity_m_s: F64
    """Geocentric [m/s], shape (n, 3)."""
    since_middle_s: F64
    """After the middle of the exposure [s], shape (n,): the targets that exist then are tracked in all of it."""

    def rows(self, some: Mask | npt.NDArray[np.int64]) -> SatelliteState:
        """Return the state at some of the times."""
        return SatelliteState(
            self.time_s[some], self.position_m[some], self.velocity_m_s[some], self.since_middle_s[some]
        )


def satellite_state(tracks: Tracks, satellite: int, time_s: F64, since_middle_s: npt.ArrayLike = 0.0) -> SatelliteState:
    """Return the state of a satellite at times after the epoch and the middle of exposures [s], shape (n,)."""
    since_s = np.broadcast_to(np.asarray(since_middle_s, dtype=np.float64), time_s.shape)
    return SatelliteState(time_s, *tracks.satellites[satellite].state(time_s), since_s)


def image_turn(roll_deg: float, offset_px: tuple[float, float], camera: Camera) -> F64:
    """Return the rotation by roll and offset of camera axes centred on the tracked direction, shape (3, 3).

    First the roll, right-handed about the line of sight; then the shortest turn that puts it offset_px from the centre.
    """
    roll = np.radians(roll_deg)
    rolled = np.array([[np.cos(roll), np.sin(roll), 0.0], [-np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    (x, y, z), *_ = camera.direction(np.add(camera.centre_px, offset_px)[None])
    across = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])  # cross product with (0, 0, 1) x (x, y, z)
    return np.asarray((np.eye(3) + across + across @ across / (1.0 + z)) @ rolled)


def law_axes(
    law: PointingLaw, rows: DirectionRows | AttitudeRows | None, tracks: Tracks, at: SatelliteState
) -> CommandedAxes:
    """Return the axes that a law gives; rows are those of a scan, or of the attitude of the body."""
    n = len(at.time_s)
    if isinstance(rows, AttitudeRows):
        body = rotated(rows.at(np.clip(at.time_s, *rows.span_s))[:, None], np.eye(3))
        nothing = np.zeros(n, dtype=bool)
        return CommandedAxes(np.asarray(law.turn @ body), nothing, nothing.copy())
    zenith, normal = normalised(at.position_m), normalised(np.cross(at.position_m, at.velocity_m_s))
    forward = np.cross(normal, zenith)
    roll, local = np.broadcast_to(law.roll_rad, (n,)), law.local
    if law.kind == "track":
        boresight = apparent_mean(tracks, law.targets, at)
    elif law.kind == "fixed":
        boresight = np.broadcast_to(np.asarray(law.direction), (n, 3))
    else:
        assert rows is not None  # by the kind
        (boresight, roll), local = rows.scan_at(at.time_s), rows.local
    if local:
        boresight = normalised(np.einsum("ni,nij->nj", boresight, np.stack([forward, -normal, zenith], axis=1)))

    lost = np.linalg.norm(boresight, axis=-1) < 0.5
    boresight = np.where(lost[:, None], forward, boresight)
    boresight = np.where((np.linalg.norm(boresight, axis=-1) < 0.5)[:, None], zenith, boresight)
    up, fallback = {
        "zenith": (zenith, normal),
        "north": (np.broadcast_to([0.0, 0.0, 1.0], zenith.shape), np.broadcast_to([1.0, 0.0, 0.0], zenith.shape)),
        "orbit_normal": (normal, zenith),
    }[law.up]
    axes, up_lost = _camera_axes(boresight, up, fallback)
    cosine, sine = np.cos(roll)[:, None], np.sin(roll)[:, None]
    x, y = axes[:, 0], axes[:, 1]
    rolled = np.stack([cosine * x + sine * y, cosine * y - sine * x, axes[:, 2]], axis=1)
    return CommandedAxes(np.asarray(law.turn @ rolled), up_lost, lost)


def apparent_mean(tracks: Tracks, targets: Sequence[int], at: SatelliteState) -> F64:
    """Return the mean apparent direction of targets, light time and aberration included; 0 where there is none.

    Of several targets those count that exist.
    """
    earth_velocity = _earth_velocity(tracks, at.time_s)
    towards = np.zeros_like(at.position_m)
    for target in targets:
        emitted = at.time_s
        for _ in range(3):
            _check_light_time(tracks, target, emitted, at.time_s)
            vector = tracks.target_state(target, emitted)[0] - at.position_m
            distance = np.linalg.norm(vector, axis=-1)
            emitted = at.time_s - distance / SPEED_OF_LIGHT_M_S
        here = distance <= NEAREST_M
        vector[here] = [1.0, 0.0, 0.0]  # any direction: it is not used
        barycentric = apparent_direction(normalised(vector), -earth_velocity)
        seen = apparent_direction(barycentric, earth_velocity + at.velocity_m_s)
        seen = np.where(here[:, None], 0.0, seen)
        towards += np.where(tracks.exist(target, emitted - at.since_middle_s)[:, None], seen, 0.0)
    towards[np.linalg.norm(towards, axis=-1) < 1e-9] = 0.0
    return normalised(towards)


def _check_light_time(tracks: Tracks, target: int, emitted_s: F64, time_s: F64) -> None:
    """Check that light left a target when its track had begun."""
    start_s = max(tracks.targets[body].start_s for body in (target, int(tracks.carrier[target])))
    early = emitted_s < start_s
    if early.any() and not (time_s < start_s).any():
        worst = int(np.argmax(time_s - emitted_s))
        late_s = float(time_s[worst] - emitted_s[worst])
        rule = (
            f"is too far: its light takes {late_s:.3g} s ({late_s * SPEED_OF_LIGHT_M_S / 1e3:,.0f} km) to the camera "
            f"at {time_s[worst]:g} s, and its track begins at {start_s:g} s"
        )
        raise InputError(rule).of(tracks.targets[target].name)


def _earth_velocity(tracks: Tracks, times: F64) -> F64:
    """Barycentric velocity of the Earth, linear between nodes as in the kernels, shape (n, 3)."""
    phase = (times - tracks.sun.start_s) / tracks.sun.step_s
    node = np.clip(np.floor(phase).astype(np.int64), 0, tracks.sun.n_node - 2)
    before, after = tracks.earth_velocity_m_s[node], tracks.earth_velocity_m_s[node + 1]
    return np.asarray(before + (after - before) * (phase - node)[:, None])


def _camera_axes(boresight: F64, up: F64, fallback: F64) -> tuple[F64, Mask]:
    """Camera axes with y away from `up`, and a mask of where `up` is along the boresight and the fallback is used."""

    def across(direction: F64) -> tuple[F64, Mask]:
        part = direction - boresight * np.sum(boresight * direction, axis=-1, keepdims=True)
        length = np.linalg.norm(direction, axis=-1)
        return part, np.linalg.norm(part, axis=-1) <= UP_LOST_RAD * length

    best, up_lost = across(up)
    second, fallback_lost = across(fallback)
    axis = np.where(np.abs(boresight[:, :1]) > 0.7, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    second = np.where(fallback_lost[:, None], across(axis)[0], second)
    y = -normalised(np.where(up_lost[:, None], second, best))
    return np.stack([np.cross(y, boresight), y, boresight], axis=1), up_lost
