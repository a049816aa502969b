"""Geometry of a sensor's view: positions of targets and stars on the image, and of the Earth's limb.

Positions are those of the renderer itself.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.errors import InputError
from warpsim.optics.camera import Camera
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M
from warpsim.plot.figure import checked_time_s
from warpsim.scene.instrument import Instrument
from warpsim.scene.roster import some_names
from warpsim.scene.scenario import Scenario
from warpsim.scene.sensors import Frames
from warpsim.sky.apparent import apparent_direction

if TYPE_CHECKING:
    from warpsim.render.renderer import Renderer

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class CameraView:
    """Geometry of one view, from a rendered frame."""

    camera: Camera
    axes_icrs: F64
    """Camera axes as rows x, y, z, shape (3, 3)."""
    position_m: F64
    """Geocentric position of the sensor, shape (3,)."""
    velocity_m_s: F64
    """Its geocentric velocity, shape (3,)."""
    target_xy_px: F64
    """Pixel positions of the targets, NaN behind the camera and for absent ones, shape (n_target, 2)."""
    occulted: Mask
    """Whether the Earth hides them, shape (n_target,)."""
    not_deployed: Mask
    """Whether they are with their main target still, and so give no light, shape (n_target,)."""
    absent: Mask
    """Whether they do not exist, shape (n_target,)."""
    star_xy_px: F64
    """Pixel positions of the stars whose light reaches the frame, shape (n_star, 2)."""
    star_snr: F64
    """Their irradiance over NEI in the sensor's first band, shape (n_star,)."""

    @property
    def shown(self) -> Mask:
        """Targets in the frame that can be seen: deployed, and not behind the Earth, shape (n_target,)."""
        return ~self.occulted & ~self.not_deployed & ~self.absent & self.in_frame(self.target_xy_px)

    def in_frame(self, xy_px: F64) -> Mask:
        """Return whether points of the image plane lie on the array, shape (n,)."""
        edge = np.array([self.camera.n_col, self.camera.n_row]) - 0.5
        return np.asarray(((xy_px >= -0.5) & (xy_px < edge)).all(axis=1))  # NaN is not

    @property
    def short_side_px(self) -> float:
        """Shorter side of the array, in widths of a pixel."""
        return min(self.camera.n_col, self.camera.n_row * self.camera.pixel_aspect)


def sensor_index(scenario: Scenario, sensor: str) -> tuple[Instrument, int]:
    """Return the kind of a sensor, and its index in it.

    Raises:
        InputError: There is no such sensor; the name of a kind is none where several satellites carry one.
    """
    if sensor not in scenario.sensor_names:
        rule = f"must be a sensor of the scene ({some_names(scenario.sensor_names)})"
        raise InputError(rule, "sensor", sensor)
    instrument = scenario.instrument_of(sensor)
    return instrument, instrument.index(sensor)


def camera_view(scenario: Scenario, sensor: str, time_s: float, renderer: Renderer | None = None) -> CameraView:
    """Render one view and return its geometry.

    Args:
        scenario: The scenario.
        sensor: Name of the sensor.
        time_s: The instant [s after the epoch]; need not be a frame's.
        renderer: Of this scene, to use its catalog and kernels again.

    Raises:
        InputError: No such sensor, or the instant is outside the scene.
    """
    from warpsim.render.renderer import Renderer

    time = checked_time_s(time_s, scenario.scene.duration_s)
    instrument, index = sensor_index(scenario, sensor)
    frames = instrument.frames
    number = round((time - frames.start_s) / frames.interval_s)
    if not 0 <= number < 2**32 or instrument.frame_time_s([number])[0] != time:
        # No frame is at this instant: one scene more, in which the sensor's only frame is there.
        number, moved = 0, _with_frame_at(scenario, instrument, time)
        renderer = renderer.with_scene(moved) if renderer else Renderer(moved)
    elif renderer is None:
        renderer = Renderer(scenario)
    shown = renderer.render([number], [sensor], [instrument.sensor.bands[0]], keep_stars=True)
    truth, stars = shown.truth, shown.stars
    position_m, velocity_m_s = scenario.tracks.state(instrument.satellite_names[index], np.array([time]))
    return CameraView(
        camera=instrument.sensor.camera,
        axes_icrs=shown.axes_icrs[0, 0],
        position_m=position_m[0],
        velocity_m_s=velocity_m_s[0],
        target_xy_px=np.stack([np.asarray(truth["x_px"]), np.asarray(truth["y_px"])], axis=1),
        occulted=np.asarray(truth["occulted"]),
        not_deployed=np.asarray(truth["not_deployed"]),
        absent=np.asarray(truth["absent"]),
        star_xy_px=np.stack([np.asarray(stars["x_px"]), np.asarray(stars["y_px"])], axis=1),
        star_snr=np.asarray(stars["snr"])[:, 0],
    )


def _with_frame_at(scenario: Scenario, instrument: Instrument, time_s: float) -> Scenario:
    """Scenario with a single frame of one kind of sensor, at a time after the epoch."""
    frames = Frames(count=1, interval_s=instrument.frames.interval_s, start_s=time_s)
    moved = dataclasses.replace(instrument.sensor, frames=frames)
    sensors = tuple(moved if sensor.name == moved.name else sensor for sensor in scenario.scene.sensors)
    return Scenario(dataclasses.replace(scenario.scene, sensors=sensors))


def earth_clearance(view: CameraView, pole: F64, xy_px: F64) -> F64:
    """Return the clearance of rays through points of the image past the Earth: below 0 where they meet it, shape (...).

    In axes stretched along the pole, where the ellipsoid is a sphere: the ray's smallest distance from the centre over
    the radius, minus one. The apparent directions are taken back through the aberration.

    Args:
        view: The view.
        pole: Axis of the ellipsoid, unit, shape (3,).
        xy_px: Points, shape (..., 2).
    """
    seen = view.camera.direction(xy_px.reshape(-1, 2), view.axes_icrs)
    # The Earth comes along: only the motion about it shifts its limb.
    ray = apparent_direction(seen, -view.velocity_m_s).reshape(*xy_px.shape[:-1], 3)
    stretch = EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M - 1
    start = view.position_m + (view.position_m @ pole) * stretch * pole
    ray = ray + (ray @ pole)[..., None] * stretch * pole
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = ray @ start
    nearest = np.linalg.norm(start - np.minimum(along, 0)[..., None] * ray, axis=-1)
    return np.asarray(nearest / EARTH_EQUATORIAL_RADIUS_M - 1)
