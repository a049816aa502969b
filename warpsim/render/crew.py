"""A crew: the workers of all threads and devices, which take the chunks of a job one by one."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Executor, Future, wait
from itertools import cycle

from warpsim.render.buffers import views_per_chunk
from warpsim.render.device_scene import DeviceScene
from warpsim.render.job import Job
from warpsim.render.records import GEOMETRY, Records
from warpsim.render.worker import Worker

CHUNKS_PER_WORKER = 4
"""Pieces that a short job is cut into for each of several workers, so that none waits long for another."""

PIXELS_PER_CHUNK = 2**19
"""A chunk of fewer pixels is not cut further: it is about a millisecond of work, and 50 to 150 us of Python."""

PIXELS_PER_CHUNK_CUDA = 2**25
"""The same on CUDA."""


class Lane:
    """What one thread renders with: a worker, or the two that a GPU alternates between while it copies to the host.

    Args:
        scene: What the stages read.
        shape: Rows and columns of an image.
        to_host: Whether results of a GPU land in host memory.
    """

    def __init__(self, scene: DeviceScene, shape: tuple[int, int], to_host: bool) -> None:
        self.scene, self._shape, self._to_host = scene, shape, to_host
        self.n_worker = 2 if to_host and scene.device.is_cuda else 1
        self.workers: list[Worker] = []
        self._busy = threading.Lock()  # a call that was interrupted may have left its last chunk to a thread

    def prepare(self, n_view: int, n_slot: int) -> None:
        """Make workers for chunks of up to n_view views, unless there are."""
        with self._busy:
            if not self.workers or self.workers[0].n_view < n_view or self.workers[0].n_slot != n_slot:
                self.workers.clear()  # first, so that old and new ones are not there at a time
                self.workers += [
                    Worker(self.scene, self._shape, n_view, n_slot, self._to_host) for _ in range(self.n_worker)
                ]

    def work(self, job: Job, spans: deque[tuple[int, int]], n_slot: int) -> int:
        """Render spans of views until none is left; returns the longest source list wanted, 0 where not known yet.

        Where a list is too long, the spans that are left are thrown away.
        """
        with self._busy:
            try:
                return self._work(job, spans, n_slot)
            finally:
                for worker in self.workers:
                    worker.finish()

    def _work(self, job: Job, spans: deque[tuple[int, int]], n_slot: int) -> int:
        longest = 0
        inputs = job.inputs(self.scene)
        for worker in cycle(self.workers):
            try:
                first, end = spans.popleft()
            except IndexError:
                break
            longest = max(longest, worker.render(job, inputs, first, end))
            if longest > n_slot:
                spans.clear()
        return longest


class Crew:
    """All lanes for one choice of bands.

    Args:
        scenes: One for each device, in the order of the devices.
        n_thread: Lanes in all, on the CPU; at least one for each device.
        shape: Rows and columns of an image.
        to_host: Whether results of GPUs land in host memory.
    """

    def __init__(self, scenes: Sequence[DeviceScene], n_thread: int, shape: tuple[int, int], to_host: bool) -> None:
        self.scene = scenes[0]
        self._n_pixel = shape[0] * shape[1]
        n_lane = max(n_thread, len(scenes))
        self.lanes = [Lane(scenes[number % len(scenes)], shape, to_host) for number in range(n_lane)]

    @property
    def n_byte(self) -> int:
        """Memory of the buffers of all workers."""
        return sum(worker.n_byte for lane in self.lanes for worker in lane.workers)

    def render(self, job: Job, n_slot: int, chunk_bytes: int | None, threads: Executor) -> int:
        """Render a job with source lists of n_slot places; where more than that is returned, it is to be done again."""
        size = self._views_of_a_chunk(job.n_view, n_slot, chunk_bytes)
        spans = deque((first, min(first + size, job.n_view)) for first in range(0, job.n_view, size))
        lanes = self.lanes[: len(spans)]
        room = 1 << (size - 1).bit_length()  # jobs that grow little by little are not to need new buffers each time
        room = max(size, min(room, views_per_chunk(self.scene, self._n_pixel, n_slot, chunk_bytes)))
        for lane in lanes:
            lane.prepare(room, n_slot)  # by this thread: kernels are compiled here
        others: list[Future[int]] = []
        try:
            for lane in lanes[1:]:
                others.append(threads.submit(lane.work, job, spans, n_slot))
            longest = lanes[0].work(job, spans, n_slot)
        finally:
            spans.clear()  # of an exception, too
            wait(others)
        longest = max([longest, *(other.result() for other in others)])
        return max(longest, _longest_list(job.records)) if self.scene.device.is_cuda else longest

    def _views_of_a_chunk(self, n_view: int, n_slot: int, chunk_bytes: int | None) -> int:
        """As many as memory allows, but so few that every worker has something to do until the end."""
        most = min(n_view, views_per_chunk(self.scene, self._n_pixel, n_slot, chunk_bytes))
        n_worker = sum(lane.n_worker for lane in self.lanes)
        if n_worker == 1:
            return most
        least_pixels = PIXELS_PER_CHUNK_CUDA if self.scene.device.is_cuda else PIXELS_PER_CHUNK
        least = least_pixels // (self._n_pixel * self.scene.n_band)
        fair = max(-(-n_view // (CHUNKS_PER_WORKER * n_worker)), least)
        return max(1, min(most, fair, -(-n_view // n_worker)))


def _longest_list(records: Records) -> int:
    return int(GEOMETRY.column(records.geometry, "n_wanted").numpy().max())
