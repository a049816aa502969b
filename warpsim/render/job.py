"""One render call: the views that it asks for, and the arrays in which its results land."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.render.device_scene import DeviceScene
from warpsim.render.pool import Pool
from warpsim.render.records import Inputs, Records, new_inputs, new_records

StarList = tuple[npt.NDArray[Any], ...]


@dataclass(frozen=True)
class Job:
    """Views, (n_view,), frame by frame and sensor by sensor within it; and their results, (n_view, ...)."""

    time_s: npt.NDArray[np.float64]
    frame: npt.NDArray[np.uint32]
    sensor: npt.NDArray[np.uint32]
    records: Records
    counts: wp.array
    signal_w_cm2: wp.array | None
    star_lists: list[StarList] | None

    @property
    def n_view(self) -> int:
        """Views."""
        return len(self.time_s)

    def inputs(self, scene: DeviceScene) -> Inputs:
        """The views on a scene's device."""
        return new_inputs(scene, self.time_s, self.frame, self.sensor)


def new_job(
    scene: DeviceScene,
    frames: Sequence[int],
    sensors: Sequence[str],
    pool: Pool,
    keep_signal: bool = False,
    keep_stars: bool = False,
) -> Job:
    """A job with memory from the pool, on the pool's device."""
    n_frame, n_sensor, instrument = len(frames), len(sensors), scene.instrument
    n_view = n_frame * n_sensor
    rows = [instrument.index(name) for name in sensors]
    camera = instrument.sensor.camera
    shape = (n_view, scene.n_band, camera.n_row, camera.n_col)
    stars: list[StarList] | None = [()] * n_view if keep_stars else None
    return Job(
        np.repeat(instrument.frame_time_s(frames), n_sensor),
        np.repeat(np.asarray(frames, dtype=np.uint32), n_sensor),
        np.tile(np.asarray(rows, dtype=np.uint32), n_frame),
        new_records(scene, n_view, pool),
        pool.new(shape, wp.uint16),
        pool.new(shape, wp.float32) if keep_signal else None,
        stars,
    )
