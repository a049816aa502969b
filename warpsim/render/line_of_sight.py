"""Lines of sight: where in space the light of a pixel came from, where light from a position falls, and states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from warpsim.arguments import plain_array
from warpsim.arrays import F64
from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.orbit.earth import itrs_to_gcrs
from warpsim.orbit.sun import earth_states
from warpsim.render.descriptions import STATE_NAMES
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.sky.apparent import apparent_direction

Axes = Literal["gcrs", "itrs"]


@dataclass(frozen=True)
class LineOfSight:
    """Straight lines from a sensor, geocentric, along which light came.

    What was `r` metres away was at origin_m + r * direction when its light left, at time_s - r / c. Aberration by the
    sensor's motion is taken out; the geocentric frame is that of the tracks, so that light takes exactly r / c.
    """

    sensor: str
    time_s: F64
    """When the light came in, after the scene's epoch [s], (n,): in the middle of the exposure of its row."""
    origin_m: F64
    """Position of the sensor then [m], (n, 3)."""
    direction: F64
    """Unit vectors from the sensor, (n, 3)."""
    range_m: F64 | None = None
    """How far away the light came from [m], (n,); None where that is not known."""
    axes: Axes = "gcrs"
    """GCRS, or the Earth-fixed axes (ITRS) of time_s."""
    pole_icrs: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Axis of the Earth's oblateness, GCRS axes: the pole of date at the scene's epoch."""

    @property
    def emission_time_s(self) -> F64:
        """When the light left, after the scene's epoch [s], (n,).

        Raises:
            InputError: The range is not known.
        """
        return self.time_s - self._range_m / SPEED_OF_LIGHT_M_S

    @property
    def position_m(self) -> F64:
        """Where the light left [m], (n, 3).

        Raises:
            InputError: The range is not known.
        """
        return np.asarray(self.origin_m + self._range_m[:, None] * self.direction)

    @property
    def _range_m(self) -> F64:
        if self.range_m is None:
            raise InputError("give it to line_of_sight to have positions", "range_m")
        return self.range_m


@dataclass(frozen=True)
class ViewGeometry:
    """Camera and state of the sensor of an image.

    Rows that are read one after the other have times of their own: the sensor's state is that of then, and the camera's
    axes are the commanded ones of then with the error of pointing that the image has.
    """

    scenario: Scenario
    instrument: Instrument
    sensor: str
    time_s: float
    axes_icrs: F64
    """Camera axes as rows, (3, 3)."""

    def line_of_sight(self, xy_px: npt.ArrayLike, range_m: npt.ArrayLike | None, axes: str) -> LineOfSight:
        """As `FrameSet.line_of_sight` says."""
        if axes not in get_args(Axes):
            raise InputError(f"must be one of {', '.join(get_args(Axes))}", "axes", axes)
        points = _vectors("xy_px", xy_px, 2, "pix")
        time_s, camera_axes = self._rows(points[:, 1])
        origin, earth, barycentric = self._states(time_s)
        seen = np.einsum("nj,nji->ni", self._camera.direction(points), camera_axes)
        direction = apparent_direction(apparent_direction(seen, -barycentric), earth)
        distance = None if range_m is None else _ranges(range_m, len(points))
        if axes == "itrs":
            to_gcrs = itrs_to_gcrs(self.scenario.epoch, time_s)
            origin, direction = (np.einsum("nj,nji->ni", vectors, to_gcrs) for vectors in (origin, direction))
        x, y, z = self.scenario.tracks.pole_icrs.tolist()
        chosen: Axes = "itrs" if axes == "itrs" else "gcrs"
        return LineOfSight(self.sensor, time_s, origin, direction, distance, chosen, (x, y, z))

    def sensor_states(self, y_px: npt.ArrayLike) -> tuple[F64, F64]:
        """Return times of rows after the epoch [s], (n,), and states of the sensor then, (n, 10), as STATE_NAMES."""
        time_s, camera_axes = self._rows(np.asarray(y_px, dtype=np.float64))
        return time_s, sensor_states(self.instrument, self.sensor, time_s, camera_axes)

    def project(self, position_m: npt.ArrayLike) -> tuple[F64, npt.NDArray[np.bool_]]:
        """As `FrameSet.project` says."""
        positions = _vectors("position_m", position_m, 3, "m")
        xy = np.tile(np.asarray(self._camera.centre_px), (len(positions), 1))
        for _ in range(_N_ROW_STEP if self._line_time_s else 1):
            time_s, camera_axes = self._rows(np.nan_to_num(xy[:, 1]))
            origin, earth, barycentric = self._states(time_s)
            away = positions - origin
            length = np.linalg.norm(away, axis=-1, keepdims=True)
            if not (length > 0.0).all():
                raise InputError("must not be that of the sensor", "position_m")
            seen = apparent_direction(apparent_direction(away / length, -earth), barycentric)
            xy, in_front = self._camera.project(np.einsum("nj,nij->ni", seen, camera_axes), np.eye(3))
        return xy, in_front

    @property
    def _camera(self) -> Camera:
        return self.instrument.sensor.camera

    @property
    def _line_time_s(self) -> float:
        return self.instrument.sensor.detector.line_time_s

    def _rows(self, y_px: F64) -> tuple[F64, F64]:
        """Times of rows after the epoch [s], (n,), and the camera's axes then, (n, 3, 3)."""
        if not self._line_time_s:
            return np.full(y_px.shape, self.time_s), np.broadcast_to(self.axes_icrs, (*y_px.shape, 3, 3))
        inside = np.clip(y_px, -0.5, self._camera.n_row - 0.5)
        time_s = self.time_s + (inside - self._camera.centre_px[1]) * self._line_time_s
        sensor = self.instrument.index(self.sensor)
        commanded = self.instrument.commanded_axes(sensor, np.append(time_s, self.time_s)).axes
        return time_s, self.axes_icrs @ commanded[-1].T @ commanded[:-1]

    def _states(self, time_s: F64) -> tuple[F64, F64, F64]:
        """Position of the sensor, and barycentric velocities of the Earth and of the sensor, (n, 3) each."""
        times_s, index = np.unique(time_s, return_inverse=True)  # mostly one
        position, velocity = self.instrument.state(self.sensor, times_s)
        earth = np.asarray(earth_states(self.scenario.epoch, times_s).velocity_m_s)
        return position[index], earth[index], (earth + velocity)[index]


_N_ROW_STEP = 8
"""Steps in which the row of a position is found: each leaves the movement from row to row of the error."""


def _vectors(where: str, values: Any, size: int, unit: str) -> F64:
    """Vectors, (n, size), of one vector or several, or a Quantity of them."""
    vectors = plain_array(values, unit, where)
    if vectors.ndim not in (1, 2) or vectors.shape[-1] != size:
        raise InputError(f"must have shape (n, {size}) or ({size},), got {vectors.shape}", where)
    if not np.isfinite(vectors).all():
        raise InputError("must be finite", where)
    return np.atleast_2d(vectors)


def _ranges(range_m: Any, count: int) -> F64:
    """Ranges of so many lines, one for all or one each."""
    values = plain_array(range_m, "m", "range_m")
    if values.shape not in ((), (count,)):
        raise InputError(f"must be one number, or {count} of them, got shape {values.shape}", "range_m")
    if not (np.isfinite(values) & (values >= 0.0)).all():
        raise InputError("must be finite and at least 0", "range_m")
    return np.broadcast_to(values, (count,))


def sensor_states(instrument: Instrument, sensor: str, time_s: F64, axes_icrs: F64) -> F64:
    """Return states of a sensor: position [m], velocity [m/s], quaternion of the rotation from GCRS to camera axes.

    Args:
        instrument: Its kind.
        sensor: Its name.
        time_s: Times after the epoch [s], (n,).
        axes_icrs: Camera axes then, as rows, (n, 3, 3).

    Returns:
        Shape (n, 10), as STATE_NAMES has them; quaternions scalar last, their scalar not negative.
    """
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_matrix(axes_icrs).as_quat(canonical=True)
    return np.concatenate([*instrument.state(sensor, time_s), attitude], axis=-1)


def target_states(scenario: Scenario, time_s: F64, range_m: F64) -> F64:
    """Return states of targets when the light left that comes in at a time.

    Args:
        scenario: The scenario.
        time_s: When it comes in, after the epoch [s], (n, n_target).
        range_m: From how far away, likewise; NaN where a target is absent.

    Returns:
        Shape (n, n_target, 10), as STATE_NAMES has them, of the rotation from GCRS to body axes; NaN for absent ones.
    """
    from scipy.spatial.transform import Rotation

    left_s = time_s - range_m / SPEED_OF_LIGHT_M_S
    found = np.full((*time_s.shape, len(STATE_NAMES)), np.nan)
    for target, attitude in enumerate(scenario.attitudes):
        (there,) = np.nonzero(np.isfinite(left_s[:, target]))
        if len(there):
            times = left_s[there, target]
            turned = Rotation.from_quat(attitude.at(times)).inv().as_quat(canonical=True)
            found[there, target] = np.concatenate([*scenario.tracks.target_state(target, times), turned], axis=-1)
    return found
