"""Number of instants of the exposure at which positions are found: as few as the measured error of paths allows."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.records import Sources, View

from warpsim.legendre import series_at
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_exposure
from warpsim.render.stages import aim, trace
from warpsim.render.streaks import Streaks, streaks_at
from warpsim.transfers import to_numpy

if TYPE_CHECKING:
    from warpsim.optics.camera import Camera
    from warpsim.render.device_scene import DeviceBodies
    from warpsim.scene.instrument import Instrument

F64 = npt.NDArray[np.float64]

NODE_COUNTS = (3, 5, 9, 17, 33, 65)
"""Odd, so that one node lies in the middle; all but the last may be chosen."""

PATH_ERROR_PX = 1e-3
"""Largest distance of a source from its path at any time of the exposure."""

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
    """Paths of all targets, and of stars at the sample points of the frame, (n_view, n_source, 2, n_instant)."""
    device, n_view = scene.device, len(time_s)
    inputs = new_inputs(device, time_s, np.zeros(n_view), sensor)
    views, exposure = wp.zeros(n_view, dtype=View, device=device), new_exposure(device, rule.offset_s, n_view)
    aim(scene, inputs, views, exposure).run()
    stars = np.einsum("ci,vij->vcj", camera.sample_points, to_numpy(views)["axes"])
    n_source = scene.n_target + stars.shape[1]
    sources: Any = Sources()
    sources.n_source = wp.full(n_view, n_source, dtype=wp.int32, device=device)
    sources.xy_px = wp.zeros((n_view, n_source), dtype=wp.vec2d, device=device)  # series are of positions themselves
    direction = np.concatenate([np.zeros((n_view, scene.n_target, 3)), stars], axis=1)
    sources.direction = wp.array(direction, dtype=wp.vec3d, device=device)
    sources.offset_px = wp.empty((n_view, n_source, rule.n_path), dtype=wp.vec2, device=device)
    targets = wp.empty((n_view, scene.n_target, rule.n_path), dtype=wp.vec2, device=device)
    trace(scene, rule, exposure, sources, targets).run()
    series = np.asarray(to_numpy(sources.offset_px), dtype=np.float64)
    return series_at(np.moveaxis(series, -1, -2), _INSTANTS)


def _largest_shift_px(camera: Camera, one: F64, other: F64) -> float:
    """Largest distance of two paths, of sources that pass the frame or come near."""
    far = np.array([[camera.n_col], [camera.n_row]])
    near = np.all((other > -far) & (other < 2 * far), axis=-2, keepdims=True)
    return float(np.abs(np.where(near, one - other, 0.0)).max(initial=0.0))
