"""Pipelines: they render the views of a pass, on device arrays and a stream of their own."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.launches import Stage, host_arrays, record_event, to_numpy
from warpsim.pool import release_later
from warpsim.render.batch import Batch, StarList, copy_views, new_inputs, some_views
from warpsim.render.buffers import (
    ViewArrays,
    bytes_of,
    new_background_nodes,
    new_signal,
    new_spots,
    new_view_arrays,
    part_of_sources,
)
from warpsim.render.device_scene import DeviceScene, moved
from warpsim.render.schedule import images_at_a_time
from warpsim.render.stages import (
    artifacts,
    background,
    counts_for,
    deposit,
    deposit_read_out,
    find_spots,
    is_read_out_at_once,
    read_out,
    read_out_into,
    view_stages,
)


class ImageStages:
    """The stages `deposit` and `read_out` of a pass, bound to signal that serves a few of its views at a time."""

    def __init__(self, scene: DeviceScene, own: ViewArrays, counts: wp.array) -> None:
        n_view = len(own.inputs.frame)
        n_at_a_time = images_at_a_time(scene, n_view)
        self.signal = new_signal((n_at_a_time, *counts.shape[1:]), scene.device)
        self._is_zero = True
        self._nodes = None if scene.background is None else new_background_nodes(scene, n_at_a_time)
        self._parts: list[tuple[int, int, list[Stage], list[Stage]]] = []  # first view and end, drawing, reading
        for first in range(0, n_view, n_at_a_time):
            end = min(first + n_at_a_time, n_view)
            signal, lists = self.signal.part(end - first), part_of_sources(own.sources, first, end)
            reads, part = own.inputs.part(first, end), own.columns.part(first, end)
            drawn = [deposit(scene, lists, part.brightness, signal)]
            if self._nodes is not None:
                drawn.insert(0, background(scene, reads, part, lists, self._nodes, signal))
            reading = [read_out(scene, reads, signal, counts, first)]
            if scene.artifacts is not None:
                reading.insert(0, artifacts(scene.artifacts, reads, signal))
            self._parts.append((first, end, drawn, reading))

    def run(
        self, counts: wp.array, kept_w_cm2: wp.array | None, kept_first: int, n_view: int, stream: wp.Stream | None
    ) -> None:
        """Draw and read out the first views of a pass into counts, (n_view, n_band, n_row, n_col).

        Signal that is to be kept goes to kept_w_cm2, of more views, from kept_first on.
        """
        signal = self.signal
        if not self._is_zero:  # a pass was broken off
            self._clear(stream)
        self._is_zero = False
        pieces = counts_for(self._parts[0][-1][-1], counts)
        for first, end, drawn, reading in self._parts:
            n = min(end, n_view) - first
            if n <= 0:
                break
            for stage in drawn:
                stage.run(n, stream)
            if kept_w_cm2 is not None:
                copy_views(kept_w_cm2, kept_first + first, signal.images, 0, n, stream)
            read_out_into(reading[-1], pieces)
            for stage in reading:
                stage.run(n, stream)
            copy_views(signal.touched, 0, signal.untouched, 0, n, stream)
        self._is_zero = True

    def _clear(self, stream: wp.Stream | None) -> None:
        """Set all signal to 0, between what the stream did before and what it does next."""
        if stream is not None:
            wp.synchronize_stream(stream)
        self.signal.flat.zero_()
        self.signal.touched.zero_()
        if stream is not None:
            wp.synchronize_stream(wp.get_stream(stream.device))


class Pipeline:
    """Renders up to n_view views at a time, on a stream of its own.

    View stages run once for all of them. So does the stage that draws and reads out at once, where there is one, unless
    signal is to be kept; else image stages follow, for few views at a time. Counts are written straight into the batch;
    only from a GPU to the host they go by way of an array of the pipeline, and the copy then runs beside another
    pipeline's work.

    Args:
        scene: What the stages read.
        n_view: Views at a time, at most.
        n_slot: Sources of a view, at most.
        to_host: Whether what a GPU renders lands in host memory.
    """

    def __init__(self, scene: DeviceScene, n_view: int, n_slot: int, to_host: bool = False) -> None:
        self.scene, self.n_view, self.n_slot = scene, n_view, n_slot
        device, camera = scene.device, scene.instrument.sensor.camera
        nothing = np.zeros(n_view)
        self.own = new_view_arrays(scene, new_inputs(device, nothing, nothing, nothing), n_slot)
        self._host_inputs = host_arrays(vars(self.own.inputs).values())
        self._host_views: list[npt.NDArray[Any]] = [array.numpy() for array in self._host_inputs]
        self._taken: wp.Event | None = None
        views = self.own.columns.views
        self._n_required = to_numpy(views)["n_required"] if device.is_cpu else None  # as it is at any time
        image = (scene.n_band, camera.n_row, camera.n_col)
        self._counts = (
            wp.empty((n_view, *image), dtype=wp.uint16, device=device) if to_host and device.is_cuda else None
        )
        self._stand_in = wp.empty((1, *image), dtype=wp.uint16, device=device)  # until a batch brings its own
        self.stream = wp.Stream(device) if device.is_cuda else None
        self._at_once: Stage | None = None
        self._images: ImageStages | None = None  # where signal is held
        self._spots: wp.array | None = None  # only where they are read: to make their functions takes time
        if is_read_out_at_once(scene):
            self._spots = new_spots(scene, n_view, n_slot)
            self._at_once = deposit_read_out(scene, self.own.inputs, self.own.sources, self._spots, self._stand_in)
        self._view_stages = self._bound_to_views()

    def _bound_to_views(self) -> list[Stage]:
        spots = [] if self._spots is None else [find_spots(self.scene, self.own.sources, self._spots)]
        return [*view_stages(self.scene, self.own), *spots]

    def point(self, scene: DeviceScene) -> None:
        """Go on with a scene that differs in its pointing alone."""
        self.finish()  # what was asked for reads the pointing before
        self.scene = scene
        self._view_stages = self._bound_to_views()

    @property
    def n_byte(self) -> int:
        """Memory of the arrays that grow with the views."""
        held = [] if self._images is None else self._images.signal.arrays
        others = [array for array in (self._spots, self._counts) if array is not None]
        return bytes_of([*self.own.arrays, self._stand_in, *held, *others])

    def begin(self, batch: Batch) -> None:
        """Prepare for a batch; by one thread for all pipelines, since Warp loads kernels where launches are prepared.

        The stream waits for what was asked of the device: others may have read the batch's memory before. The null
        stream comes after all blocking ones, those of Warp and PyTorch's default one.
        """
        if self._images is None and self._at_once_for(batch) is None:
            self._images = ImageStages(self.scene, self.own, self._stand_in)
        if self.stream is not None:
            self.stream.wait_event(record_event(self.scene.device.null_stream))

    def _take(self, batch: Batch, first: int, n_view: int) -> None:
        """Put what a batch asks for into the inputs."""
        if self._taken is not None:
            wp.synchronize_event(self._taken)
        for mine, theirs in zip(self._host_views, batch.inputs, strict=True):
            mine[:n_view] = theirs[first : first + n_view]
        if self.stream is not None:
            for here, mine in zip(vars(self.own.inputs).values(), self._host_inputs, strict=True):
                copy_views(here, 0, mine, 0, n_view, self.stream)
            self._taken = record_event(self.stream)

    def render(self, batch: Batch, first: int, end: int) -> int:
        """Render views first to end of a batch; on CUDA, only ask for it. Return the longest source list required.

        It is 0 where it is not known yet; above n_slot, the views are incomplete.
        """
        n_view, stream = end - first, self.stream
        self._take(batch, first, n_view)
        for stage in self._view_stages:
            stage.run(n_view, stream)
        self._render_images(batch, first, n_view)
        for theirs, mine in zip(batch.columns.arrays, self.own.columns.arrays, strict=True):
            copy_views(theirs, first, mine, 0, n_view, stream)
        if batch.stars is not None:
            batch.stars[first:end] = self._stars(n_view)
        if self._n_required is None:
            return 0  # to read it would be to wait
        return int(self._n_required[:n_view].max())

    def _at_once_for(self, batch: Batch) -> Stage | None:
        return self._at_once if batch.signal_w_cm2 is None else None

    def _render_images(self, batch: Batch, first: int, n_view: int) -> None:
        counts = batch.counts if self._counts is None else self._counts
        if len(counts) != n_view and self._counts is None:
            counts = counts[first : first + n_view]
        if (at_once := self._at_once_for(batch)) is not None:
            read_out_into(at_once, counts_for(at_once, counts))
            at_once.run(n_view, self.stream)
        elif self._images is not None:
            self._images.run(counts, batch.signal_w_cm2, first, n_view, self.stream)
        if self._counts is not None:
            copy_views(batch.counts, first, self._counts, 0, n_view, self.stream)

    def __del__(self) -> None:
        for array in getattr(self, "_host_inputs", ()):
            release_later(array)  # pinned memory, from which the GPU may still copy

    def finish(self) -> None:
        """Wait until all is done."""
        if self.stream is not None:
            wp.synchronize_stream(self.stream)

    def _stars(self, n_view: int) -> list[StarList]:
        """Position, movement, irradiance and number of the stars of each view, copied to the host."""
        self.finish()
        sources = self.own.sources
        arrays = (sources.n_source, sources.offset_px, sources.xy_px, sources.irradiance_w_cm2, sources.star)
        filled, offset_px, xy, light, star = (to_numpy(some_views(array, 0, n_view)) for array in arrays)
        spans: list[tuple[int, Any]] = [(view, slice(self.scene.n_target, n)) for view, n in enumerate(filled)]
        return [
            (
                xy[view, part].copy(),
                moved(offset_px[view, part]),
                light[view, :, part].T.copy(),
                star[view, part].copy(),
            )
            for view, part in spans
        ]
