"""A worker: private buffers for a chunk of views, and the stages' launches, recorded once and bound to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from warpsim.launches import Launches, call, clear, recorded
from warpsim.render.buffers import (
    Chunk,
    Light,
    Sources,
    images_at_a_time,
    new_light,
    new_sources,
    part_of,
    part_of_light,
)
from warpsim.render.device_scene import DeviceScene
from warpsim.render.job import Job, StarList
from warpsim.render.records import Inputs, new_inputs, views_of, zero_records
from warpsim.render.rows import copy_rows
from warpsim.render.stages import IMAGE_STAGES, VIEW_STAGES
from warpsim.render.streaks import moved

_NOWHERE = 1 << 56
"""Address of counts that are recorded before their place is known; no processor has memory there."""


@dataclass
class _Keeping:
    """Where the light of a chunk is to be kept: the job's signal, and the chunk's first view there."""

    signal_w_cm2: wp.array | None = None
    first: int = 0


class Worker:
    """Renders chunks, one at a time.

    Counts are written where they belong, straight into the job's array; only from a GPU to the host they go by way of a
    buffer of the worker, and the copy then runs beside the next chunk, which another worker renders.

    Args:
        scene: What the stages read.
        shape: Rows and columns of an image.
        n_view: Views that a chunk holds at most.
        n_slot: Sources that a view holds at most.
        to_host: Whether results of a GPU land in host memory.
    """

    def __init__(
        self, scene: DeviceScene, shape: tuple[int, int], n_view: int, n_slot: int, to_host: bool = False
    ) -> None:
        self.scene, self.n_view, self.n_slot = scene, n_view, n_slot
        device, nothing = scene.device, np.zeros(n_view)
        self._inputs: Inputs = new_inputs(scene, nothing, nothing, nothing)
        self._records = zero_records(scene, n_view)
        image = (n_view, scene.n_band, *shape)
        self._n_image = images_at_a_time(scene, shape[0] * shape[1], n_view)
        self._owns_counts = to_host and device.is_cuda
        if self._owns_counts:
            counts = wp.empty(image, dtype=wp.uint16, device=device)
        else:
            counts = wp.array(ptr=_NOWHERE, dtype=wp.uint16, shape=image, device=device)
        self.chunk = Chunk(
            views_of(self._inputs, self._records),
            self._records.observations(scene),
            new_sources(scene, n_view, n_slot),
            new_light((self._n_image, *image[1:]), device),
            counts,
            keep_light=False,
        )
        self._is_dark = True  # but for a chunk that was broken off
        self._keeping = _Keeping()
        self._recorded: dict[bool, tuple[Launches, list[tuple[Any, int]]]] = {}
        self._launches(keep_light=False)
        self._copies = wp.Stream(device) if self._owns_counts else None
        self._copied: wp.Event | None = None
        if not device.is_cuda:
            self._n_wanted = self._records.view_column("n_wanted")

    def _launches(self, keep_light: bool) -> tuple[Launches, list[tuple[Any, int]]]:
        """The stages' launches, and those of their arguments that lie in moving counts, with their places there."""
        if keep_light not in self._recorded:
            with recorded(self.n_view) as launches:
                for stage in VIEW_STAGES:
                    stage(self.scene, self.chunk)
                for first in range(0, self.n_view, self._n_image):
                    end = min(first + self._n_image, self.n_view)
                    with launches.part(first, end):
                        self._record_images(self._images(first, end, keep_light), first)
            moving = [] if self._owns_counts else launches.arguments_within(self.chunk.counts)
            if self.scene.device.is_cuda:
                launches.capture(self.scene.device, [argument for argument, _ in moving])
            self._recorded[keep_light] = launches, moving
        return self._recorded[keep_light]

    def _images(self, first: int, end: int, keep_light: bool) -> Chunk:
        """The part of the chunk that is drawn and read out together."""
        chunk = self.chunk
        views, seen, sources = (part_of(part, first, end) for part in (chunk.views, chunk.observations, chunk.sources))
        return Chunk(views, seen, sources, part_of_light(chunk.light, end - first), chunk.counts[first:end], keep_light)

    def _record_images(self, images: Chunk, first: int) -> None:
        for stage in IMAGE_STAGES:
            stage(self.scene, images)
        if images.keep_light:
            call(partial(_hand_over_light, self._keeping, images.light, first))
            clear(images.light.signal_w_cm2)
            clear(images.light.lit)

    @property
    def n_byte(self) -> int:
        """Memory of the buffers that grow with the views."""
        chunk, sources = self.chunk, self.chunk.sources
        light = chunk.light
        arrays = [*self._inputs.arrays, *self._records.arrays, *vars(sources).values(), light.flat, light.lit]
        if self._owns_counts:
            arrays.append(chunk.counts)
        return sum(int(array.capacity) for array in arrays if array.size)

    def render(self, job: Job, inputs: Inputs, first: int, end: int) -> int:
        """Render views first to end of a job; returns the longest source list wanted, 0 where that is not known yet.

        Args:
            job: Takes the results.
            inputs: All views of the job, on the worker's device.
            first: First view.
            end: View behind the last.
        """
        n_view = end - first
        if not self._is_dark:
            self._darken()
        if self._copied is not None:
            self.scene.device.stream.wait_event(self._copied)
        for mine, all_views in zip(self._inputs.arrays, inputs.arrays, strict=True):
            copy_rows(mine, 0, all_views, first, n_view)
        address = job.counts.ptr + first * job.counts.strides[0]
        launches, moving = self._launches(keep_light=job.signal_w_cm2 is not None)
        for argument, place in moving:
            argument.data = address + place
        self._keeping.signal_w_cm2, self._keeping.first = job.signal_w_cm2, first
        self._is_dark = False
        launches.run(n_view)
        self._is_dark, self._keeping.signal_w_cm2 = True, None
        self._hand_over(job, first, n_view)
        if job.star_lists is not None:
            job.star_lists[first:end] = _star_lists(self.scene, self.chunk.sources, n_view)
        if self.scene.device.is_cuda:
            return 0  # to read it would be to wait
        return int(self._n_wanted[:n_view].max())

    def _hand_over(self, job: Job, first: int, n_view: int) -> None:
        """Copy what the launches have not written to its place."""
        pairs = list(zip(job.records.arrays, self._records.arrays, strict=True))
        if self._owns_counts:
            pairs.append((job.counts, self.chunk.counts))
        if self._copies is not None:
            self._copies.wait_event(self.scene.device.stream.record_event())
        for theirs, mine in pairs:
            copy_rows(theirs, first, mine, 0, n_view, self._copies)
        if self._copies is not None:
            self._copied = self._copies.record_event()

    def _darken(self) -> None:
        """Put out what light there may be."""
        self.finish()
        light = self.chunk.light
        light.flat.zero_()
        light.lit.zero_()

    def finish(self) -> None:
        """Wait for copies to the host."""
        if self._copies is not None:
            wp.synchronize_stream(self._copies)


def _hand_over_light(keeping: _Keeping, light: Light, first: int, n_view: int) -> None:
    """Copy some images of a chunk, those from `first` on, to their place in the job."""
    assert keeping.signal_w_cm2 is not None
    copy_rows(keeping.signal_w_cm2, keeping.first + first, light.signal_w_cm2, 0, n_view)


def _star_lists(scene: DeviceScene, sources: Sources, n_view: int) -> list[StarList]:
    """Position, movement, irradiance and star number of the stars of each view, copied to the host."""
    filled = sources.n_source.numpy()[:n_view]
    offset_px = sources.offset_px.numpy()
    xy, light, star = (array.numpy() for array in (sources.xy_px, sources.irradiance_w_cm2, sources.star))
    first = scene.n_target
    spans: list[tuple[int, Any]] = [(view, slice(first, n)) for view, n in enumerate(filled)]
    return [
        (xy[view, part].copy(), moved(offset_px[view, part]), light[view, :, part].T.copy(), star[view, part].copy())
        for view, part in spans
    ]
