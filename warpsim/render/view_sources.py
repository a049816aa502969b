"""Sources of rendered views once more, as they were drawn, and how their positions follow from camera and targets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import BEHIND

from warpsim.optics.camera import Camera
from warpsim.optics.psf_bank import paths_struct
from warpsim.render.batch import HostColumns, StarList
from warpsim.render.device_scene import DeviceScene
from warpsim.render.point_images import PointImages

F64 = npt.NDArray[np.float64]

ANGLE_STEP_RAD, POSITION_STEP = 1e-4, 1e-3
"""Of five-point differences of projections in float64, of positions over their range: both good to 1e-11."""

_STEPS = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))


def sources_of_views(scene: DeviceScene, seen: HostColumns, stars: Sequence[StarList] | None) -> PointImages:
    """Return the sources of views as they were drawn: targets, in their order, and stars behind them, if given.

    Paths of stars are straight: of these only the ends are kept. Their bend over an exposure is below 1e-3 px where
    cameras turn evenly.
    """
    camera, device = scene.instrument.sensor.camera, scene.device
    behind = (seen.observations["flags"] & int(BEHIND)) != 0
    n_view, n_target = behind.shape
    n_star = [len(one[0]) for one in stars] if stars else [0] * n_view
    n_slot = n_target + max(n_star, default=0)
    xy_px = np.full((n_view, n_slot, 2), -1e9)
    light = np.zeros((n_view, scene.n_band, n_slot), dtype=np.float32)
    offset_px = np.zeros((n_view, n_slot, scene.streaks.n_path, 2), dtype=np.float32)
    xy_px[:, :n_target], offset_px[:, :n_target] = seen.observations["xy_px"], seen.offset_px
    light[..., :n_target] = np.where(behind[:, None], np.float32(0.0), seen.irradiance_w_cm2)
    for view, (xy, moved, irradiance, _) in enumerate(stars or ()):
        own = slice(n_target, n_target + len(xy))
        xy_px[view, own], light[view, :, own] = xy, irradiance.T
        if scene.streaks.enabled:
            offset_px[view, own, 1] = 0.5 * moved
    given = ((np.array(n_star) + n_target, wp.int32), (xy_px, wp.vec2d), (light, wp.float32))
    lists = [wp.array(np.ascontiguousarray(values), dtype=dtype, device=device) for values, dtype in given]
    paths = None
    if scene.streaks.enabled:
        moving = wp.array(offset_px, dtype=wp.vec2, device=device)
        brightness = seen.columns.to(device).brightness
        assert brightness is not None
        paths = paths_struct(moving, brightness, n_target)
    return PointImages(scene.psf, lists, scene.stamp_rule, (camera.n_row, camera.n_col), paths)


def camera_slopes(camera: Camera, xy_px: F64) -> F64:
    """Return how positions of a still sky follow the camera, (n, 2, 3): x and y by boresight, two angles, and roll.

    The boresight turns towards larger x, then towards larger y; roll turns the camera right-handed about it, as
    `roll_deg` does. Through the lens. NaN where a position is none.

    Args:
        camera: The camera.
        xy_px: Positions, (n, 2).
    """
    there = np.isfinite(xy_px).all(axis=1) & (np.abs(xy_px) < 1e6).all(axis=1)
    slopes = np.full((len(xy_px), 2, 3), np.nan)
    seen = camera.direction(xy_px[there])
    turns = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # about x, y and z, for each of the three
    for number, turn in enumerate(turns):
        step = -np.cross(turn, seen) * ANGLE_STEP_RAD
        slopes[there, :, number] = sum(weight * camera.project(seen + k * step, np.eye(3))[0] for k, weight in _STEPS)
    return slopes / ANGLE_STEP_RAD


def position_slopes(project: Any, position_m: F64, range_m: F64) -> F64:
    """Return how images follow positions in space, (n, 2, 3) [px/m]; NaN where there is none.

    Args:
        project: Function of positions, (n, 3), to pixels, (n, 2), as `FrameSet.project`, light path and lens included.
        position_m: Where the light left, (n, 3); NaN for none.
        range_m: From how far away, (n,).
    """
    slopes = np.full((len(position_m), 2, 3), np.nan)
    there = np.isfinite(position_m).all(axis=1) & (range_m > 0.0)
    if not there.any():
        return slopes
    step_m = POSITION_STEP * range_m[there, None]
    for axis in range(3):
        along = step_m * np.eye(3)[axis]
        shift = sum(weight * project(position_m[there] + k * along) for k, weight in _STEPS)
        slopes[there, :, axis] = shift / step_m
    return slopes
