"""How far light moves over the image during an exposure, for people: two places, the ends of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.directions import normalised

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene

F64 = npt.NDArray[np.float64]

_MOST_FRAMES = 50


def longest_streaks_px(scene: Scene) -> tuple[float, float]:
    """Longest way of a star (in the middle, on an edge, in a corner of the frame) and of a target in front of it [px].

    Of up to 50 frames in which a sensor has access to the main target, in straight lines, without jitter and light
    time; 0 where there are none.
    """
    frames = np.unique(np.linspace(0, scene.frames.count - 1, min(scene.frames.count, _MOST_FRAMES)).astype(np.int64))
    time_s = scene.frame_time_s(frames)
    time_s = time_s[time_s <= scene.duration_s]
    longest = np.zeros(2)
    for sensor in scene.sensor_names:
        seen_s = time_s[scene.has_access(sensor, time_s)]
        if seen_s.size:
            longest = np.maximum(longest, _streaks_of(scene, sensor, seen_s))
    return float(longest[0]), float(longest[1])


def _streaks_of(scene: Scene, sensor: str, time_s: F64) -> F64:
    """The same of one sensor at given times."""
    half_s = 0.5 * scene.detector.exposure_s
    ends_s = [np.clip(time_s + offset_s, 0.0, scene.duration_s) for offset_s in (-half_s, half_s)]
    axes = [scene.view_axes(sensor, end_s) for end_s in ends_s]
    stars = np.einsum("ci,tij->tcj", scene.camera.landmarks, axes[0])
    star_px = _way_px(scene, stars, axes[0], stars, axes[1])
    target_px = np.zeros(1)
    for target in scene.target_names:
        sights = [normalised(scene.position_m(target, end_s) - scene.position_m(sensor, end_s)) for end_s in ends_s]
        way_px = _way_px(scene, sights[0][:, None], axes[0], sights[1][:, None], axes[1])
        target_px = np.maximum(target_px, way_px.max(initial=0.0))
    return np.array([star_px.max(initial=0.0), target_px[0]])


def _way_px(scene: Scene, start: F64, start_axes: F64, end: F64, end_axes: F64) -> F64:
    """Distances on the image between directions, (t, n, 3), seen with axes (t, 3, 3), flat; 0 behind the camera."""
    places = []
    for axes, way in ((start_axes, start), (end_axes, end)):
        seen = np.einsum("tij,tnj->tni", axes, way)
        places.append(scene.camera.project(seen.reshape(-1, 3), np.eye(3))[0])
    return np.asarray(np.nan_to_num(np.linalg.norm(places[1] - places[0], axis=-1)))
