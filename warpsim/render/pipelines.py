"""The pipelines of all threads and devices, which take the passes of a batch one by one."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Executor, Future, wait

import warp as wp

from warpsim.launches import record_event, to_numpy, wait_on_current_stream
from warpsim.render.batch import Batch
from warpsim.render.device_scene import DeviceScene
from warpsim.render.pipeline import Pipeline
from warpsim.render.schedule import certain_slots, most_views, views_of_a_pass

EXTRA_SLOTS = 64
"""Stars that source lists hold to begin with, besides the targets; unless they are certain to hold all."""


class Pipelines:
    """Renders batches of one choice of bands.

    Args:
        scenes: One for each device.
        n_thread: Pipelines in all, on the CPU; at least one for each device.
        to_host: Whether what GPUs render lands in host memory; each then has two pipelines, of which one copies while
            the other renders.
        chunk_bytes: Memory of a pass; chosen by the device when left out.
    """

    def __init__(
        self, scenes: Sequence[DeviceScene], n_thread: int, to_host: bool, chunk_bytes: int | None = None
    ) -> None:
        self.scene, self.scenes = scenes[0], scenes
        self._to_host = to_host
        n_device, is_cuda = len(scenes), scenes[0].device.is_cuda
        n_pipeline = n_device * (2 if to_host else 1) if is_cuda else max(n_thread, n_device)
        self._scenes = [scenes[number % n_device] for number in range(n_pipeline)]
        self._pipelines: list[Pipeline | None] = [None] * n_pipeline
        self._busy = [threading.Lock() for _ in self._scenes]  # an interrupted call may have left one to a thread
        self._chunk_bytes = chunk_bytes
        certain = certain_slots(self.scene) if is_cuda else None  # the CPU need not wait for what was required
        self._is_certain = certain is not None
        self._ready: wp.Event | None = None
        self._set_slots(certain or self.scene.n_target + EXTRA_SLOTS)

    def point(self, scenes: Sequence[DeviceScene]) -> None:
        """Go on with scenes that differ in their pointing alone."""
        self.scene, self.scenes = scenes[0], scenes
        self._scenes = [scenes[number % len(scenes)] for number in range(len(self._scenes))]
        for scene, pipeline, busy in zip(self._scenes, self._pipelines, self._busy, strict=True):
            with busy:
                if pipeline is not None:
                    pipeline.point(scene)

    @property
    def n_byte(self) -> int:
        """Memory of their arrays."""
        return sum(pipeline.n_byte for pipeline in self._pipelines if pipeline is not None)

    def _set_slots(self, n_slot: int) -> None:
        self._n_slot = n_slot
        self._most_views = most_views(self.scene, n_slot, self._chunk_bytes, self._to_host)

    def render(self, batch: Batch, threads: Executor) -> wp.Event | None:
        """Render a batch; once more with longer source lists should a view have needed them.

        Return the event after which the batch is complete, on a GPU; None where it is complete already.
        """
        if batch.n_view == 0:
            return None
        while (required := self._render(batch, threads)) > self._n_slot:
            self._set_slots(required + required // 4)
        return self._ready

    def _render(self, batch: Batch, threads: Executor) -> int:
        """Length of the longest source list required."""
        most = self._most_views
        size = views_of_a_pass(self.scene, batch.n_view, most, len(self._scenes))
        spans = deque((first, min(first + size, batch.n_view)) for first in range(0, batch.n_view, size))
        numbers = range(min(len(self._scenes), len(spans)))
        room = max(size, min(1 << (size - 1).bit_length(), most))  # calls that grow little by little need no new ones
        for number in numbers:
            self._prepare(number, room).begin(batch)
        others: list[Future[int]] = []
        try:
            for number in numbers[1:]:
                others.append(threads.submit(self._work, number, batch, spans))
            longest = self._work(0, batch, spans)
        finally:
            spans.clear()  # of an exception, too
            if others:
                wait(others)
        longest = max([longest, *(other.result() for other in others)])
        if not self.scene.device.is_cuda:
            return longest
        self._hand_over(numbers)
        if self._is_certain:
            return 0
        wait_on_current_stream(self._ready, batch.columns.views.device)
        return int(to_numpy(batch.columns.views)["n_required"].max())

    def _prepare(self, number: int, room: int) -> Pipeline:
        """Return a pipeline for passes of up to `room` views, a new one unless there is one."""
        with self._busy[number]:
            pipeline = self._pipelines[number]
            if pipeline is None or pipeline.n_view < room or pipeline.n_slot != self._n_slot:
                if pipeline is not None:
                    pipeline.finish()
                self._pipelines[number] = pipeline = None  # first, so that old and new ones are not there at a time
                pipeline = Pipeline(self._scenes[number], room, self._n_slot, self._to_host)
                self._pipelines[number] = pipeline
            return pipeline

    def _work(self, number: int, batch: Batch, spans: deque[tuple[int, int]]) -> int:
        """Render passes until none is left, or a source list is too long; return the longest."""
        with self._busy[number]:
            pipeline = self._pipelines[number]
            assert pipeline is not None
            try:
                longest = self._passes(pipeline, batch, spans)
            except BaseException:
                pipeline.finish()  # it writes to the batch, whose memory will serve others
                raise
        return longest

    @staticmethod
    def _passes(pipeline: Pipeline, batch: Batch, spans: deque[tuple[int, int]]) -> int:
        longest = 0
        while longest <= pipeline.n_slot:
            try:
                first, end = spans.popleft()
            except IndexError:
                return longest
            longest = max(longest, pipeline.render(batch, first, end))
        spans.clear()
        return longest

    def _hand_over(self, numbers: range) -> None:
        """Wait where the batch is in host memory; else note the event after which it is complete."""
        for number in numbers:
            pipeline = self._pipelines[number]
            assert pipeline is not None and pipeline.stream is not None
            if self._to_host:
                pipeline.finish()
            else:  # there is one pipeline only
                self._ready = record_event(pipeline.stream)
