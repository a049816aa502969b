"""What sensors see of the targets without images: no pixel is drawn, and no star is looked up."""

from __future__ import annotations

from concurrent.futures import Executor

import warp as wp

from warpsim.render.batch import Columns, Inputs
from warpsim.render.buffers import new_background_nodes, new_view_arrays
from warpsim.render.device_scene import DeviceBodies, DeviceScene
from warpsim.render.stages import background_of_targets, split_light, target_stages


def observe(
    scene: DeviceBodies, inputs: Inputs, columns: Columns, size: int, threads: Executor, terms: wp.array | None = None
) -> None:
    """Fill the columns of views as rendering does, `size` views at a time.

    Args:
        scene: What the stages read.
        inputs: Inputs of the views.
        columns: Their columns.
        size: Views at a time.
        threads: Threads that work.
        terms: Irradiance by each term, (N_TERM, n_view, n_band, n_target); filled where it is asked for.
    """
    n_view = len(inputs.frame)

    def run(first: int) -> None:
        end = min(first + size, n_view)
        own = new_view_arrays(scene, inputs.part(first, end), scene.n_target, columns.part(first, end))
        own.sources.n_source.fill_(scene.n_target)
        stages = target_stages(scene, own)
        if isinstance(scene, DeviceScene) and scene.background is not None:
            nodes = new_background_nodes(scene, end - first)
            stages.append(background_of_targets(scene, own.inputs, own.columns, own.sources, nodes))
        if terms is not None:
            stages.append(split_light(scene, own.columns.observations, terms[:, first:end]))
        for stage in stages:
            stage.run()

    if n_view:
        run(0)  # kernels are compiled by one thread
        list(threads.map(run, range(size, n_view, size)))
