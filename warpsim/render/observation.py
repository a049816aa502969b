"""Truth without images: what sensors see of the targets, for which no pixel is drawn and no star is looked up."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from warpsim.arguments import frame_numbers
from warpsim.render.batch import Columns, Inputs, new_columns, new_inputs
from warpsim.render.buffers import (
    new_area_series,
    new_background_nodes,
    new_exposure,
    new_row_views,
    new_sources,
)
from warpsim.render.device_scene import DeviceScene
from warpsim.render.stages import background_of_targets, target_stages

_VIEWS_AT_A_TIME = 1024


def observe(scene: DeviceScene, frames: Sequence[int], sensors: Sequence[str], threads: Executor) -> Columns:
    """Return the columns of views, frame by frame and sensor by sensor within it, as rendering leaves them."""
    numbers, instrument, n_sensor = frame_numbers(frames), scene.instrument, len(sensors)
    n_view = len(numbers) * n_sensor
    rows = [instrument.index(name) for name in sensors]
    time_s = np.repeat(instrument.frame_time_s(numbers), n_sensor)
    inputs = new_inputs(scene.device, time_s, np.repeat(numbers, n_sensor), np.tile(rows, len(numbers)))
    columns = new_columns(scene, n_view)

    def run(first: int) -> None:
        end = min(first + _VIEWS_AT_A_TIME, n_view)
        reads = Inputs(*(array[first:end] for array in vars(inputs).values()))
        part, sources = columns.part(first, end), new_sources(scene, end - first, scene.n_target)
        sources.n_source.fill_(scene.n_target)
        exposure = new_exposure(scene.device, scene.streaks.offset_s, end - first) if scene.streaks.enabled else None
        own_rows = new_row_views(scene, sources) if scene.streaks.rolls else None
        stages = target_stages(scene, reads, part, sources, new_area_series(scene, end - first), exposure, own_rows)
        if scene.background is not None:
            nodes = new_background_nodes(scene, end - first)
            stages.append(background_of_targets(scene, reads, part, sources, nodes))
        for stage in stages:
            stage.run()

    if n_view:
        run(0)  # kernels are compiled by one thread
        list(threads.map(run, range(_VIEWS_AT_A_TIME, n_view, _VIEWS_AT_A_TIME)))
    return columns
