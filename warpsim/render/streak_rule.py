"""Number of instants of the exposure at which positions are found: as few as the measured error of paths allows."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.legendre import series_at
from warpsim.render.buffers import Sources, new_path_views
from warpsim.render.stages import aim_views, trace_sources
from warpsim.render.streaks import Streaks, streaks_at

if TYPE_CHECKING:
    from warpsim.optics.camera import Camera
    from warpsim.render.device_scene import DeviceBodies
    from warpsim.scene.instrument import Instrument

F64 = npt.NDArray[np.float64]

NODE_COUNTS = (3, 5, 9, 17, 33, 65)
"""Odd, so that one node lies in the middle; all but the last may be chosen."""

PATH_ERROR_PX = 1e-3
"""How far a source may be from its path at any time of the exposure."""

_MOST_FRAMES, _MOST_SENSORS = 24, 12
_INSTANTS = np.linspace(-1.0, 1.0, 65)


def choose_streaks(duration_s: float, scene: DeviceBodies) -> Streaks:
    """Return the fewest instants that keep positions within PATH_ERROR_PX, else 33, on targets and on a still sky.

    A rule is judged by the next finer one, on frames and sensors spread over the scene: with their own axes, so that
    whatever turns the camera counts, its jitter too.

    Args:
        duration_s: Length of the scene [s].
        scene: What an instrument looks at.
    """
    instrument = scene.instrument
    camera, exposure_s = instrument.sensor.camera, instrument.sensor.detector.exposure_s
    time_s, sensor = _sample(instrument, duration_s)
    rules = [streaks_at(count, exposure_s, scene.device) for count in NODE_COUNTS]
    paths = (_paths_px(camera, scene, rule, time_s, sensor) for rule in rules)
    for count, (one, other) in zip(NODE_COUNTS, pairwise(paths), strict=False):
        error_px = _largest_shift_px(camera, one, other)
        streaks = streaks_at(count, exposure_s, scene.device, error_px)
        if error_px <= PATH_ERROR_PX:
            break
    return streaks


def _sample(instrument: Instrument, duration_s: float) -> tuple[F64, npt.NDArray[np.uint32]]:
    """Times and sensors of the views to measure on, (n_view,) each."""

    def spread(count: int, most: int) -> npt.NDArray[np.int64]:
        return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))

    time_s = instrument.frame_time_s(spread(instrument.frames.count, _MOST_FRAMES))
    time_s = time_s[time_s <= duration_s]
    sensors = spread(len(instrument.names), _MOST_SENSORS).astype(np.uint32)
    return np.repeat(time_s, len(sensors)), np.tile(sensors, len(time_s))


def _paths_px(camera: Camera, scene: DeviceBodies, rule: Streaks, time_s: F64, sensor: npt.NDArray[np.uint32]) -> F64:
    """Paths of all targets, and of stars at the landmarks of the frame, (n_view, n_source, 2, n_instant)."""
    device, n_view = scene.device, len(time_s)
    middle, path = (
        new_path_views(device, np.zeros(1), time_s, sensor),
        new_path_views(device, rule.offset_s, time_s, sensor),
    )
    aim_views(scene, middle)
    aim_views(scene, path)
    stars = np.einsum("ci,vij->vcj", camera.sample_points, middle.axes.numpy()[:, 0])
    n_source = scene.n_target + stars.shape[1]
    direction = np.concatenate([np.zeros((n_view, scene.n_target, 3)), stars], axis=1)
    none = wp.empty((0, 0, 0, 0), dtype=wp.float64, device=device)
    sources = Sources(
        wp.full(n_view, n_source, dtype=wp.int32, device=device),
        wp.zeros((n_view, n_source), dtype=wp.vec2d, device=device),  # so that the series are of places themselves
        none,
        none,
        wp.array(direction, dtype=wp.vec3d, device=device),
        wp.empty((n_view, n_source, rule.n_path), dtype=wp.vec2, device=device),
        none,
    )
    trace_sources(scene, rule, path, sources)
    series = np.asarray(sources.offset_px.numpy(), dtype=np.float64)
    return series_at(np.moveaxis(series, -1, -2), _INSTANTS)


def _largest_shift_px(camera: Camera, one: F64, other: F64) -> float:
    """Largest distance of two paths, of sources that pass the frame or come near."""
    far = np.array([[camera.n_col], [camera.n_row]])
    near = np.all((other > -far) & (other < 2 * far), axis=-2, keepdims=True)
    return float(np.abs(np.where(near, one - other, 0.0)).max(initial=0.0))
