"""The renderer: owns buffers, order and threads; the stages do the work."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.stamp_sizes import size_table_stamps_kernel

from warpsim.arguments import chosen_names
from warpsim.errors import InputError
from warpsim.render.buffers import (
    Chunk,
    Observations,
    Sources,
    Views,
    new_observations,
    new_sources,
    new_views,
    part_of,
    views_per_chunk,
)
from warpsim.render.device import default_device, worker_count
from warpsim.render.frameset import FrameSet
from warpsim.render.image_stack import ImageStack
from warpsim.render.kernel_loading import kernel_loading
from warpsim.render.stages import STAGES
from warpsim.render.star_field import load_catalog, star_index
from warpsim.render.streaks import Streaks, moved
from warpsim.render.world import World
from warpsim.scene.scene import Scene
from warpsim.sky.catalog import StarCatalog

StarList = tuple[npt.NDArray[Any], ...]


@dataclass
class _Worker:
    """Buffers of one CPU thread or of the GPU."""

    sources: Sources
    signal_w_cm2: wp.array


@dataclass(frozen=True)
class _Job:
    """Arrays of one render call, (n_view, ...)."""

    views: Views
    observations: Observations
    counts: wp.array
    signal_w_cm2: wp.array | None
    star_lists: list[StarList] | None


class Renderer:
    """Renders frames of a scene.

    Args:
        scene: The description.
        device: Warp device; "cuda:0" where present, else "cpu", when left out.
        n_thread: CPU threads; all cores when left out. Results do not depend on it.
        catalog: Stars to use instead of those that the scene's sky names.

    Raises:
        InputError: No such device, a bad thread count, or a star catalog that cannot be read.
    """

    def __init__(
        self, scene: Scene, device: Any = None, n_thread: int | None = None, catalog: StarCatalog | None = None
    ) -> None:
        if catalog is not None and not isinstance(catalog, StarCatalog):
            raise InputError(f"catalog: must be a StarCatalog, got {type(catalog).__name__}; files are for sky.catalog")
        self.scene = scene
        self.device = default_device(device)
        self.n_thread = worker_count(self.device, n_thread)
        kernel_loading(self.device).start(size_table_stamps_kernel)
        self._index = star_index(scene, load_catalog(scene) if catalog is None else catalog, self.device)
        self._worlds: dict[tuple[str, ...], World] = {}
        self._workers: dict[tuple[str, ...], list[_Worker]] = {}
        self._lock = threading.Lock()  # buffers serve one call at a time
        self._compiled: set[tuple[str, ...]] = set()
        self._n_slot = 0

    @property
    def catalog(self) -> StarCatalog:
        """The stars, at the scene's epoch."""
        return self._index.catalog

    @property
    def sensors_with_access(self) -> list[str]:
        """Sensors that can observe the main target at some time of the scene."""
        return self.scene.sensors_with_access

    def render(
        self,
        frames: Iterable[int],
        sensors: Sequence[str] | None = None,
        bands: Sequence[str] | None = None,
        keep_signal: bool = False,
        keep_stars: bool = False,
    ) -> FrameSet:
        """Render frames.

        A frame does not depend on the others: alone, in any batch, in any order, on any number of threads its counts
        are bit-identical.

        Args:
            frames: Frame numbers, in the order wanted.
            sensors: Sensor names; those with access to the main target at some time of the scene when left out.
            bands: Band names; all of the scene when left out.
            keep_signal: Also keep the noiseless irradiance per pixel.
            keep_stars: Also keep the list of stars in each view.

        Returns:
            The frames, with counts and truth.

        Raises:
            InputError: An unknown name, a frame outside the scene, or no sensor with access.
        """
        frame_list = self.checked_frames(frames)
        sensor_list = chosen_names("sensors", sensors, self.scene.sensor_names)
        band_list = chosen_names("bands", bands, list(self.scene.bands))
        if sensors is None:
            sensor_list = self.sensors_with_access
            if not sensor_list:
                raise InputError(
                    "sensors: none has access to the main target under the scene's access_rules; name sensors to "
                    "render them all the same"
                )
        world = self._world(tuple(band_list))
        job = self._new_job(world, frame_list, sensor_list, keep_signal, keep_stars)
        with self._lock:
            self._run(world, tuple(band_list), job)
        n_frame, n_sensor = len(frame_list), len(sensor_list)
        return FrameSet(
            self.scene,
            frame_list,
            sensor_list,
            band_list,
            ImageStack(job.counts, n_frame, n_sensor),
            None if job.signal_w_cm2 is None else ImageStack(job.signal_w_cm2, n_frame, n_sensor),
            world,
            job.views,
            job.observations,
            job.star_lists,
        )

    def checked_frames(self, frames: Iterable[int]) -> list[int]:
        """Frame numbers as a list of int; InputError when one is no frame of the scene."""
        if isinstance(frames, int | np.integer):
            raise InputError(f"frames: must be a list or range of frame numbers, got {frames!r}")
        numbers = list(frames)
        for number in numbers:
            if isinstance(number, bool) or not isinstance(number, int | np.integer) or not 0 <= number < 2**32:
                raise InputError(f"frames: must be whole numbers from 0 to 2**32 - 1, got {number!r}")
        times = self.scene.frame_time_s(numbers)
        late = np.flatnonzero(times > self.scene.duration_s)
        if late.size:
            raise InputError(
                f"frames: frame {numbers[late[0]]} is at {times[late[0]]:g} s, "
                f"after the scene's end (duration_s = {self.scene.duration_s:g})"
            )
        if self.scene.sights is not None:
            self.scene.sights.check_times(self.scene.sensor_names, times)
        return [int(number) for number in numbers]

    def streaks(self, bands: Sequence[str]) -> Streaks:
        """How sources are followed through the exposure."""
        return self._world(tuple(bands)).streaks

    def _world(self, bands: tuple[str, ...]) -> World:
        if bands not in self._worlds:
            self._worlds[bands] = World(self.scene, bands, self.device, self._index)
        return self._worlds[bands]

    def _new_job(
        self, world: World, frames: list[int], sensors: list[str], keep_signal: bool, keep_stars: bool
    ) -> _Job:
        n_frame, n_sensor = len(frames), len(sensors)
        sensor_rows = [self.scene.sensor_names.index(name) for name in sensors]
        views = new_views(
            world,
            np.repeat(self.scene.frame_time_s(frames), n_sensor),
            np.repeat(np.asarray(frames, dtype=np.uint32), n_sensor),
            np.tile(np.asarray(sensor_rows, dtype=np.uint32), n_frame),
        )
        n_view = n_frame * n_sensor
        shape = (n_view, world.n_band, self.scene.camera.n_row, self.scene.camera.n_col)
        counts = wp.empty(shape, dtype=wp.uint16, device=self.device)
        signal = wp.empty(shape, dtype=wp.float32, device=self.device) if keep_signal else None
        stars: list[StarList] | None = [()] * n_view if keep_stars else None
        return _Job(views, new_observations(world, n_view), counts, signal, stars)

    def _run(self, world: World, bands: tuple[str, ...], job: _Job) -> None:
        """Render all chunks; once more with longer source lists should a view have needed them."""
        n_view = int(job.counts.shape[0])
        if n_view == 0:
            return
        n_pixel = job.counts.shape[2] * job.counts.shape[3]
        self._n_slot = max(self._n_slot, world.n_target + 64)
        while True:
            # Every thread should have work, and no chunk more views than the buffers hold.
            size = min(views_per_chunk(world, n_pixel, self._n_slot), -(-n_view // self.n_thread))
            wanted = self._render_chunks(world, bands, job, size)
            if wanted <= self._n_slot:
                return
            self._n_slot = wanted + wanted // 4

    def _render_chunks(self, world: World, bands: tuple[str, ...], job: _Job, size: int) -> int:
        """Render the views chunk by chunk; the longest source list wanted, stopping early where one is too long."""
        spans = [(first, min(first + size, int(job.counts.shape[0]))) for first in range(0, job.counts.shape[0], size)]
        workers: queue.SimpleQueue[_Worker] = queue.SimpleQueue()
        for worker in self._buffers(world, bands, size, min(self.n_thread, len(spans))):
            workers.put(worker)
        longest = [0]  # of each chunk done; appending is safe between threads

        def one(span: tuple[int, int]) -> None:
            if longest[-1] > self._n_slot:
                return
            worker = workers.get()
            try:
                self._render_chunk(world, job, worker, *span)
            finally:
                workers.put(worker)
            if not self.device.is_cuda:  # where reading it would wait for the GPU; there all is looked at in the end
                longest.append(int(job.views.n_wanted.numpy()[span[0] : span[1]].max()))

        if bands not in self._compiled:  # kernels are compiled by one thread
            one(spans[0])
            self._compiled.add(bands)
            spans = spans[1:]
        if self.n_thread == 1 or len(spans) < 2:
            for span in spans:
                one(span)
        else:
            with ThreadPoolExecutor(self.n_thread) as pool:
                list(pool.map(one, spans))
        return int(job.views.n_wanted.numpy().max()) if self.device.is_cuda else max(longest)

    def _buffers(self, world: World, bands: tuple[str, ...], size: int, n_worker: int) -> list[_Worker]:
        """Buffers for chunks of up to size views: those of earlier calls where they fit, else new ones."""
        shape = (size, world.n_band, self.scene.camera.n_row, self.scene.camera.n_col)
        kept = [
            worker
            for worker in self._workers.get(bands, [])
            if worker.signal_w_cm2.shape[0] >= size and worker.sources.xy_px.shape[1] == self._n_slot
        ]
        while len(kept) < n_worker:
            sources = new_sources(world, size, self._n_slot)
            kept.append(_Worker(sources, wp.empty(shape, dtype=wp.float32, device=self.device)))
        self._workers[bands] = kept
        return kept[:n_worker]

    def _render_chunk(self, world: World, job: _Job, worker: _Worker, first: int, end: int) -> None:
        n_view = end - first
        signal = worker.signal_w_cm2[:n_view] if job.signal_w_cm2 is None else job.signal_w_cm2[first:end]
        chunk = Chunk(
            part_of(job.views, first, end),
            part_of(job.observations, first, end),
            part_of(worker.sources, 0, n_view),
            signal,
            job.counts[first:end],
        )
        for stage in STAGES:
            stage(world, chunk)
        if job.star_lists is not None:
            job.star_lists[first:end] = _star_lists(world, chunk.sources)


def _star_lists(world: World, sources: Sources) -> list[StarList]:
    """Position, movement, irradiance and star number of the stars of each view, copied to the host."""
    filled = sources.n_source.numpy()
    offset_px = sources.offset_px.numpy()
    xy, light, star = (array.numpy() for array in (sources.xy_px, sources.irradiance_w_cm2, sources.star))
    first = world.n_target
    spans = [(view, slice(first, n)) for view, n in enumerate(filled)]
    return [
        (xy[view, part].copy(), moved(offset_px[view, part]), light[view, :, part].T.copy(), star[view, part].copy())
        for view, part in spans
    ]
