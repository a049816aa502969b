"""The renderer: takes what is asked for, owns pipelines, memory and threads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import warp as wp
from warpsim_kernels.stamp_sizes import size_table_stamps_kernel

from warpsim.arguments import frame_numbers, whole_number
from warpsim.errors import InputError
from warpsim.pool import pool_of
from warpsim.radiometry.band import Band
from warpsim.render.batch import Batch, HostColumns, inputs_of_views, new_batch, new_columns
from warpsim.render.device import chosen_devices, kernel_loading, worker_count
from warpsim.render.device_scene import Streaks
from warpsim.render.device_stars import Skies
from warpsim.render.device_upload import make_device_scene, with_pointing
from warpsim.render.frame_stream import FrameStream
from warpsim.render.frameset import FrameSet
from warpsim.render.image_stack import ImageStack
from warpsim.render.pipelines import Pipelines
from warpsim.render.pointing_arrays import CommandedPointing
from warpsim.render.request import Request, checked_rate, checked_request
from warpsim.render.stream import GROUP_BYTES, GROUP_BYTES_CUDA, Stream, StreamStats, stream_sizes
from warpsim.render.tiled_stars import with_stars_of
from warpsim.render.truth import observe, truth_table
from warpsim.scene.description import SceneDescription
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.sky.catalog import StarCatalog

if TYPE_CHECKING:
    from astropy.table import Table

VIEWS_AT_A_TIME = 1024
"""Of truth without images."""


class Renderer:
    """Renders frames of a scene.

    Args:
        scene: The scene, or its scenario.
        device: Warp device; "cuda:0" where present, else "cpu", when left out. A list of devices shares the work out;
            images then land in host memory, pinned where the devices are GPUs.
        n_thread: CPU threads; all cores when left out. Results do not depend on it.
        catalog: Stars to use instead of those that the scene's sky names.
        chunk_bytes: Cuts the views that a thread works on at a time: neither all their noiseless images nor what else
            is known of them would take more (but one view may); 32 MiB on the CPU and 512 MiB on CUDA when left out.
            Far fewer of these images are held at a time: on the CPU 1 MiB, or one; on CUDA 32 MiB, or as many as keep
            the device busy. Results do not depend on it.
        pool_bytes: Memory of results that are no longer held, kept for later ones, at most; 256 MiB on the CPU and
            8 GiB on CUDA when left out.

    Raises:
        InputError: No such device, a bad number, or a star catalog that cannot be read.
    """

    def __init__(
        self,
        scene: Scene | Scenario,
        device: Any = None,
        n_thread: int | None = None,
        catalog: StarCatalog | None = None,
        chunk_bytes: int | None = None,
        pool_bytes: int | None = None,
        *,
        _skies: Skies | None = None,
    ) -> None:
        if catalog is not None and not isinstance(catalog, StarCatalog):
            kind = type(catalog).__name__
            raise InputError(f"must be a StarCatalog, got {kind}; files are for sky.catalog", "catalog")
        self.chunk_bytes = None if chunk_bytes is None else whole_number("chunk_bytes", chunk_bytes, 1)
        self.scenario = scenario_of(scene)
        self.devices = chosen_devices(device)
        self.device = self.devices[0]
        self.n_thread = worker_count(self.device, n_thread)
        self._to_host = isinstance(device, list | tuple)
        for each in self.devices:
            kernel_loading(each).start(size_table_stamps_kernel)
        self._given: dict[str, Any] = {"device": device, "n_thread": n_thread, "catalog": catalog}
        self._given |= {"chunk_bytes": chunk_bytes, "pool_bytes": pool_bytes}
        self._skies = _skies or Skies(self.scene.sky, self.scenario.epoch, self.devices, catalog)
        self._skies.indices(self._first_bands)  # a catalog that cannot be read is found here
        most_bytes = None if pool_bytes is None else whole_number("pool_bytes", pool_bytes, 0)
        self._pool = pool_of(self.devices, self._to_host, most_bytes)
        self._pipelines: dict[tuple[str, tuple[str, ...], bool], Pipelines] = {}
        self._lock = threading.Lock()  # buffers serve one call at a time
        self._stream: Stream | None = None

    @property
    def scene(self) -> SceneDescription:
        """The description."""
        return self.scenario.scene

    def with_scene(self, scene: Scene | Scenario) -> Renderer:
        """Return a renderer of another scene, like this one in all else; quicker to make if the sky is the same.

        A star catalog that this one has read from a file is not read again.

        Raises:
            InputError: The scene names a star catalog that cannot be read.
        """
        scenario = scenario_of(scene)
        if scenario.scene.sky != self.scene.sky:
            return Renderer(scenario, **self._given)
        return Renderer(scenario, **self._given, _skies=self._skies.at(scenario.epoch))

    @property
    def catalog(self) -> StarCatalog:
        """The stars of the first kind of sensor, at the scene's epoch; see `catalog_of`."""
        return self._skies.indices(self._first_bands)[0].catalog

    def catalog_of(self, sensor: str) -> StarCatalog:
        """Return the stars of a sensor, at the scene's epoch: of the default catalog those brightest in its bands.

        Args:
            sensor: Name of a sensor, or of a kind.

        Raises:
            InputError: There is no such sensor.
        """
        return self._skies.indices(self.scenario.instrument_of(sensor).bands.values())[0].catalog

    @property
    def _first_bands(self) -> list[Band]:
        return list(next(iter(self.scenario.instruments.values())).bands.values())

    @property
    def buffer_bytes(self) -> int:
        """Memory [bytes] of the buffers of all workers, and of the results that are no longer held.

        Besides them there are the scene (stars, tables of the optics) and the results that somebody holds. Each choice
        of bands that was rendered has workers of its own.
        """
        return sum(pipelines.n_byte for pipelines in self._pipelines.values()) + self._pool.n_byte

    @property
    def sensors_with_access(self) -> list[str]:
        """Sensors that can observe what their access counts by at some time of the scene."""
        return self.scenario.sensors_with_access

    def render(
        self,
        frames: Iterable[int],
        sensors: str | Sequence[str] | None = None,
        bands: str | Sequence[str] | None = None,
        keep_signal: bool = False,
        keep_stars: bool = False,
    ) -> FrameSet:
        """Render frames of sensors of one kind; on a GPU, ask for it: what reads them waits until they are complete.

        A frame does not depend on the others: alone, in any batch, in any order, on any number of threads its counts
        are bit-identical.

        Args:
            frames: Frame numbers, in the requested order.
            sensors: Names of sensors, or the name of a kind, which stands for all of it; those that have access at some
                time of the scene when left out. Those of several kinds have images of their own: one call for each.
            bands: Band names; all of the kind when left out.
            keep_signal: Also keep the noiseless irradiance per pixel.
            keep_stars: Also keep the list of stars in each view.

        Returns:
            The frames, with counts and truth.

        Raises:
            InputError: An unknown name, sensors of several kinds, a frame outside the scene, or no sensor with access.
        """
        if frames is None:
            raise InputError("must be a list or range of frame numbers", "frames", frames)
        return self._render(checked_request(self.scenario, frames, sensors, bands, (keep_signal, keep_stars)))

    def truth(
        self,
        frames: Iterable[int] | None = None,
        sensors: str | Sequence[str] | None = None,
        bands: str | Sequence[str] | None = None,
    ) -> Table:
        """Return the truth of frames without rendering them: `render(...).truth` with no pixel drawn.

        Args:
            frames: Frame numbers, in the requested order; all of the scene when left out.
            sensors: As in `render`.
            bands: As in `render`.

        Raises:
            InputError: As in `render`.
        """
        request = checked_request(self.scenario, frames, sensors, bands)
        with self._lock:
            scene, instrument = self._pipelines_of(request.instrument, tuple(request.bands)).scene, request.instrument
            numbers, rows = frame_numbers(request.frames), [instrument.index(name) for name in request.sensors]
            inputs = inputs_of_views(scene.device, instrument.frame_time_s(numbers), rows, numbers)
            columns = new_columns(scene, len(inputs.frame))
            observe(scene, inputs, columns, VIEWS_AT_A_TIME, self._threads)
        return truth_table(request, scene, HostColumns(columns))

    def stream(
        self,
        frames: Iterable[int] | None = None,
        sensors: str | Sequence[str] | None = None,
        bands: str | Sequence[str] | None = None,
        rate_hz: float | None = None,
        drop: bool = True,
        n_ahead: int | None = None,
        keep_signal: bool = False,
        keep_stars: bool = False,
        loop: bool = False,
        prepare: Callable[[FrameSet], Any] | None = None,
        idle: Callable[[float], bool] | None = None,
    ) -> FrameStream:
        """Render frame after frame in real time, while the caller works on those before; `stats` says how it goes.

        The clock starts when the first frame is ready; frame k is then due k / rate_hz later, and its time is over when
        the next one is due. Ending the loop, or an exception in it, ends the stream.

        Args:
            frames: Frame numbers, in the requested order; all of the scene when left out.
            sensors: As in `render`.
            bands: As in `render`.
            rate_hz: Frames (times, with all sensors) per second; as fast as possible when left out.
            drop: Leave out frames whose time is over; False: hand over every one, however late.
            n_ahead: Frames rendered ahead at most; chosen by rate and size when left out.
            keep_signal: As in `render`.
            keep_stars: As in `render`.
            loop: Begin anew after the last frame, without end; pointing is then the scene's again.
            prepare: Function of each frame, called ahead by the thread that renders; `latest.prepared` is its result.
            idle: Function that waits for so long at most [s], called while no frame is due; False ends the stream.

        Returns:
            Iterator of FrameSets of one frame each; its `send` points sensors while it runs.

        Raises:
            InputError: As in `render`; a rate or a number of frames that is not above 0.
        """
        request = checked_request(self.scenario, frames, sensors, bands, (keep_signal, keep_stars))
        rate_hz = checked_rate(rate_hz)
        ahead = None if n_ahead is None else whole_number("n_ahead", n_ahead, 1)
        n_pipeline = max(self.n_thread, len(self.devices))
        group_bytes = GROUP_BYTES_CUDA if self.device.is_cuda else GROUP_BYTES
        sizes = stream_sizes(rate_hz, len(request.sensors), request.bytes_per_frame, n_pipeline, ahead, group_bytes)

        def rendered(some: Sequence[int], instrument: Instrument) -> FrameSet:
            frames = self._render(replace(request, frames=some, instrument=instrument))
            frames.counts.wait()  # what is handed over is complete, and latencies are those of complete frames
            return frames

        pointing = CommandedPointing(self.scenario, request.instrument, request.sensors, self.devices)
        options: dict[str, Any] = {"loop": loop, "pointing": pointing, "prepare": prepare, "idle": idle}
        self._stream = Stream(rendered, request.frames, rate_hz, drop, *sizes, **options)
        return FrameStream(self._stream)

    @property
    def stats(self) -> StreamStats | None:
        """Statistics of the latest stream, so far; None before the first."""
        return None if self._stream is None else self._stream.stats

    def _render(self, request: Request) -> FrameSet:
        frames, sensors, bands = request.frames, request.sensors, request.bands
        with self._lock:
            pipelines = self._pipelines_of(request.instrument, tuple(bands))
            batch = new_batch(pipelines.scene, frames, sensors, self._pool, request.keep_signal, request.keep_stars)
            ready = pipelines.render(batch, self._threads)
            if self._skies.tiles is not None:
                pipelines, ready = self._with_stars_of(batch, pipelines, ready)
        shape = len(frames), len(sensors)
        counts = ImageStack(batch.counts, *shape, ready)
        signal = None if batch.signal_w_cm2 is None else ImageStack(batch.signal_w_cm2, *shape, ready)
        drawn = counts, signal, pipelines.scene, batch.columns, batch.stars
        return FrameSet(self.scenario, request.instrument, frames, sensors, bands, *drawn)

    def streaks(self, instrument: Instrument, bands: Sequence[str]) -> Streaks:
        """Return how sources are followed through the exposure of a kind of sensor."""
        return self._pipelines_of(instrument, tuple(bands)).scene.streaks

    def _pipelines_of(self, instrument: Instrument, bands: tuple[str, ...]) -> Pipelines:
        """Pipelines of a kind of sensor, and others where its pointing is commanded: one command after the other."""
        key = instrument.sensor.name, bands, instrument.is_commanded
        if key not in self._pipelines:
            if instrument.is_commanded:
                own = self._pipelines_of(self.scenario.instruments[instrument.sensor.name], bands).scenes
                scenes = [with_pointing(scene, instrument) for scene in own]
            else:
                indices = self._skies.indices(instrument.bands.values())
                scenes = [make_device_scene(self.scenario, instrument, bands, index.device, index) for index in indices]
            self._pipelines[key] = Pipelines(scenes, self.n_thread, self._to_host, self.chunk_bytes)
        pipelines = self._pipelines[key]
        if pipelines.scene.instrument is not instrument:
            pipelines.point([with_pointing(scene, instrument) for scene in pipelines.scenes])
        return pipelines

    def _with_stars_of(
        self, batch: Batch, pipelines: Pipelines, ready: wp.Event | None
    ) -> tuple[Pipelines, wp.Event | None]:
        """Render a batch once more if its views need stars that are not read; return what rendered it last."""
        if ready is not None:
            wp.synchronize_event(ready)
        if not batch.n_view or (scenes := with_stars_of(batch, pipelines.scenes, self.scenario, self._skies)) is None:
            return pipelines, ready
        key = next(key for key, one in self._pipelines.items() if one is pipelines)
        self._pipelines[key] = pipelines = Pipelines(scenes, self.n_thread, self._to_host, self.chunk_bytes)
        return pipelines, pipelines.render(batch, self._threads)

    @cached_property
    def _threads(self) -> ThreadPoolExecutor:
        """Threads that wait for work; they end with the renderer."""
        return ThreadPoolExecutor(max(self.n_thread, 2 * len(self.devices)), thread_name_prefix="warpsim")
