"""Lines of sight: where in space the light of a pixel came from, and where light from a position falls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.orbit.earth import itrs_to_gcrs
from warpsim.orbit.sun import earth_states
from warpsim.scene.scenario import Scenario
from warpsim.sky.apparent import apparent_direction

F64 = npt.NDArray[np.float64]
Axes = Literal["gcrs", "itrs"]


@dataclass(frozen=True)
class LineOfSight:
    """Straight lines from a sensor, geocentric, along which light came.

    What was `r` metres away was at origin_m + r * direction when its light left, at time_s - r / c. Aberration by the
    sensor's motion is taken out; the geocentric frame is that of the tracks, so that light takes exactly r / c.
    """

    sensor: str
    time_s: float
    """When the light came in, after the scene's epoch [s]."""
    origin_m: F64
    """Position of the sensor then [m], (n, 3)."""
    direction: F64
    """Unit vectors from the sensor, (n, 3)."""
    range_m: F64 | None = None
    """How far away the light came from [m], (n,); None where that is not known."""
    axes: Axes = "gcrs"
    """GCRS, or the Earth-fixed axes (ITRS) of time_s."""

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
    """Camera and state of the sensor of an image."""

    scenario: Scenario
    camera: Camera
    sensor: str
    time_s: float
    axes_icrs: F64
    """Camera axes as rows, (3, 3)."""
    position_m: F64
    velocity_m_s: F64
    """Barycentric."""

    def line_of_sight(self, xy_px: npt.ArrayLike, range_m: npt.ArrayLike | None, axes: str) -> LineOfSight:
        """As `FrameSet.line_of_sight` says."""
        if axes not in get_args(Axes):
            raise InputError(f"must be one of {', '.join(get_args(Axes))}", "axes", axes)
        points = np.atleast_2d(np.asarray(xy_px, dtype=np.float64))
        seen = self.camera.direction(points, self.axes_icrs)
        direction = apparent_direction(apparent_direction(seen, -self.velocity_m_s), self._earth_velocity_m_s)
        origin = np.tile(self.position_m, (len(points), 1))
        distance = None if range_m is None else _ranges(range_m, len(points))
        if axes == "itrs":
            to_gcrs = itrs_to_gcrs(self.scenario.epoch, self.time_s)
            origin, direction = origin @ to_gcrs, direction @ to_gcrs
            return LineOfSight(self.sensor, self.time_s, origin, direction, distance, "itrs")
        return LineOfSight(self.sensor, self.time_s, origin, direction, distance)

    def project(self, position_m: npt.ArrayLike) -> tuple[F64, npt.NDArray[np.bool_]]:
        """As `FrameSet.project` says."""
        away = np.atleast_2d(np.asarray(position_m, dtype=np.float64)) - self.position_m
        length = np.linalg.norm(away, axis=-1, keepdims=True)
        if not (np.isfinite(length) & (length > 0.0)).all():
            raise InputError("must be finite, and not that of the sensor", "position_m")
        seen = apparent_direction(apparent_direction(away / length, -self._earth_velocity_m_s), self.velocity_m_s)
        return self.camera.project(seen, self.axes_icrs)

    @property
    def _earth_velocity_m_s(self) -> F64:
        return np.asarray(earth_states(self.scenario.epoch, self.time_s).velocity_m_s)


def _ranges(range_m: Any, count: int) -> F64:
    """Ranges of so many lines, one for all or one each."""
    values = np.asarray(range_m, dtype=np.float64)
    if values.shape not in ((), (count,)):
        raise InputError(f"must be one number, or {count} of them, got shape {values.shape}", "range_m")
    if not (np.isfinite(values) & (values >= 0.0)).all():
        raise InputError("must be finite and at least 0", "range_m")
    return np.broadcast_to(values, (count,))
