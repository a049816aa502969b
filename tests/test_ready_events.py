"""What reads results on a GPU waits for the event after which they are complete, on whichever stream it uses.

Stand-ins for streams note in which order they are asked; arrays of the CPU stand for those of the GPU.
"""

import contextlib
import gc
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.records import Observation, View

import warpsim as ws
from warpsim import pool
from warpsim.render import batch as batches
from warpsim.render import pipelines
from warpsim.render.batch import Columns, HostColumns
from warpsim.render.image_stack import ImageStack, frames_of_key
from warpsim.render.pipeline import Pipeline
from warpsim.render.pipelines import Pipelines

READY = "ready"


class Stream:
    """Notes what it is asked to wait for."""

    cuda_stream = 77

    def __init__(self):
        self.waited = []

    def wait_event(self, event):
        self.waited.append(event)


@pytest.fixture
def current(monkeypatch):
    """The current stream, in a list, so that it can be replaced."""
    streams = [Stream()]
    monkeypatch.setattr(wp, "get_stream", lambda device: streams[-1])
    return streams


def stack(ready=READY):
    values = np.arange(6 * 2 * 3 * 4, dtype=np.uint16).reshape(6, 2, 3, 4)
    return ImageStack(wp.array(values, dtype=wp.uint16, device="cpu"), 3, 2, ready)


READERS = {
    "numpy": lambda images: images.numpy(),
    "asarray": np.asarray,
    "index": lambda images: images[1, 0],
    "DLPack": np.from_dlpack,
    "copied by DLPack": lambda images: np.from_dlpack(images, copy=True),
    "array": lambda images: images.array,
    "part": lambda images: images.part(1, 2).numpy(),
}


@pytest.mark.parametrize("name", READERS)
def test_readers_of_images_wait_on_the_stream_that_is_current_then(current, name):
    images = stack()
    assert current[0].waited == []
    READERS[name](images)
    current.append(Stream())
    READERS[name](images)
    assert [set(stream.waited) for stream in current] == [{READY}, {READY}]
    READERS[name](stack(ready=None))
    assert len(current[1].waited) == len(current[0].waited)


@pytest.fixture
def nothing_released():
    """Leave no stand-ins behind for others to wait for."""
    yield
    gc.collect()
    pool._released.clear()


class CudaArray:
    """An array of a GPU, which notes the consumer's stream after what the current stream was asked."""

    shape, dtype, ptr, pinned = (6, 2, 3, 4), wp.uint16, 1 << 40, False
    device = SimpleNamespace(is_cuda=True, ordinal=1)

    def __init__(self, stream):
        self._stream = stream
        self.__cuda_array_interface__ = {"data": (self.ptr, False), "shape": self.shape, "typestr": "<u2", "version": 2}

    def __dlpack__(self, stream):
        self._stream.waited.append(f"consumer {stream}")


@pytest.mark.parametrize("stream", [None, 1, 2, 4711])
@pytest.mark.ci
def test_a_consumers_stream_is_ordered_after_the_current_one_has_waited(current, nothing_released, stream):
    images = ImageStack(CudaArray(current[0]), 3, 2, READY)
    images.__dlpack__(stream=stream, max_version=(1, 0))
    assert current[0].waited == [READY, f"consumer {stream}"]


def test_the_array_interface_names_a_stream_that_has_waited(current, nothing_released):
    interface = ImageStack(CudaArray(current[0]), 3, 2, READY).__cuda_array_interface__
    assert (interface["stream"], interface["shape"]) == (Stream.cuda_stream, (3, 2, 2, 3, 4))
    assert current[0].waited == [READY]


@pytest.mark.parametrize("name", ["views", "observations", "irradiance_w_cm2", "columns"])
def test_readers_of_columns_wait(current, name):
    columns = Columns(
        wp.zeros(4, dtype=View, device="cpu"),
        wp.zeros((4, 2), dtype=Observation, device="cpu"),
        wp.zeros((4, 1, 2), dtype=wp.float32, device="cpu"),
    )
    getattr(HostColumns(columns, READY), name)
    assert current[0].waited == [READY]
    getattr(HostColumns(columns), name)
    assert current[0].waited == [READY]


KEYS = [
    0, -1, 2, np.int64(1), (1, 0), (1, 0, 1, slice(None), 2), (-2, ..., 1), (0, None, 1), (2, [1, 0]), slice(1, None),
    slice(None), slice(-1, None), slice(2, 0), slice(None, None, -1), slice(2, None, -2), (slice(0, 2), 1),
    (slice(2, 0, -1), slice(None), 0), (slice(1, 2), [0, 1], [1, 0]), ..., None, [2, 0], (), (..., 1), True,
    np.array([True, False, True]),
]  # fmt: skip


@pytest.mark.parametrize("key", KEYS, ids=str)
def test_an_index_into_some_frames_is_the_index_into_all(key):
    values = stack(None).numpy()
    first, end, rest = frames_of_key(key, len(values))
    np.testing.assert_array_equal(values[first:end][rest], values[key])
    assert values[first:end][rest].shape == values[key].shape


def test_only_the_frames_of_an_index_are_asked_for():
    assert frames_of_key((5, 0, 0), 100)[:2] == (5, 6)
    assert frames_of_key(slice(90, 10, -5), 100)[:2] == (15, 91)
    for beyond in (100, -101):
        assert frames_of_key(beyond, 100) == (0, 100, beyond)  # NumPy says what is wrong


class FakePipeline:
    """Renders nothing; notes what it is asked."""

    def __init__(self, scene, n_view, n_slot, to_host):
        self.n_view, self.n_slot, self.log, self.n_byte = n_view, n_slot, scene.log, 0
        self.stream = SimpleNamespace(
            record_event=lambda: self.log.append("record") or f"event of {n_slot}",
            device=SimpleNamespace(context_guard=contextlib.nullcontext()),
        )

    def begin(self, batch):
        self.log.append("begin")

    def render(self, batch, first, end):
        self.log.append((first, end))
        return 0

    def finish(self):
        self.log.append("finish")


@pytest.fixture
def on_gpu(monkeypatch, current):
    """Make pipelines of a GPU, of source lists that are certain or not, and a batch of 5 views for them."""

    def make(certain, n_required=7, to_host=False):
        device = SimpleNamespace(is_cuda=True)
        scene = SimpleNamespace(device=device, n_target=2, log=[])
        monkeypatch.setattr(pipelines, "Pipeline", FakePipeline)
        monkeypatch.setattr(pipelines, "certain_slots", lambda scene: certain)
        monkeypatch.setattr(pipelines, "most_views", lambda *_: 100)
        monkeypatch.setattr(pipelines, "views_of_a_pass", lambda scene, n_view, most, n: n_view)

        def read(array):
            scene.log.append("read")
            return {"n_required": np.array([3, n_required])}

        monkeypatch.setattr(pipelines, "to_numpy", read)
        batch = SimpleNamespace(n_view=5, columns=SimpleNamespace(views=SimpleNamespace(device=device)))
        return Pipelines([scene], 1, to_host), batch, scene.log

    return make


def test_a_pipeline_that_breaks_off_is_waited_for_before_its_memory_serves_others(on_gpu, monkeypatch):
    group, batch, log = on_gpu(certain=50)

    def broken(self, batch, first, end):
        self.log.append("render")
        raise KeyboardInterrupt

    monkeypatch.setattr(FakePipeline, "render", broken)
    with pytest.raises(KeyboardInterrupt):
        group.render(batch, None)
    assert log == ["begin", "render", "finish"]


def test_other_threads_are_waited_for_when_the_callers_own_breaks_off(on_gpu, monkeypatch):
    """They write to the batch's memory until they are done."""
    begun, log = threading.Event(), []
    caller = threading.current_thread()

    def one_slow_one_broken(self, batch, first, end):
        if threading.current_thread() is caller:
            assert begun.wait(10)
            raise KeyboardInterrupt
        begun.set()
        time.sleep(0.2)
        log.append("slow one done")
        return 0

    group, batch, _ = on_gpu(certain=None, to_host=True)
    monkeypatch.setattr(pipelines, "views_of_a_pass", lambda scene, n_view, most, n: 1)
    monkeypatch.setattr(FakePipeline, "render", one_slow_one_broken)
    with ThreadPoolExecutor(2) as threads:
        with pytest.raises(KeyboardInterrupt):
            group.render(batch, threads)
        assert log == ["slow one done"]


def test_nothing_is_read_where_source_lists_are_certain_to_be_long_enough(on_gpu, current):
    group, batch, log = on_gpu(certain=50)
    assert group.render(batch, None) == "event of 50"
    assert log == ["begin", (0, 5), "record"]
    assert current[0].waited == []


def test_lengths_are_read_after_the_event_where_they_are_not(on_gpu, current):
    """And too short lists are made longer, as everywhere."""
    group, batch, log = on_gpu(certain=None, n_required=80)
    n_slot = 2 + pipelines.EXTRA_SLOTS
    assert group.render(batch, None) == f"event of {80 + 20}"
    once = ["begin", (0, 5), "record", "read"]
    assert log == [*once, "finish", *once]
    assert current[0].waited == [f"event of {n_slot}", "event of 100"]


def test_images_in_host_memory_are_waited_for(on_gpu, current):
    group, batch, log = on_gpu(certain=50, to_host=True)
    assert group.render(batch, contextlib.nullcontext()) is None
    assert log == ["begin", (0, 5), "finish"]
    assert batches.HostColumns(batch.columns)._ready is None


def test_batches_of_the_cpu_have_no_event(scene):
    frames = ws.Renderer(scene, "cpu").render([60], ["sat11"], ["A"], keep_signal=True)
    assert frames.counts.ready is None and frames.signal_w_cm2.ready is None and frames._host._ready is None
    frames.counts.wait()


def test_a_pipeline_leaves_its_pinned_memory_to_the_copies_under_way(nothing_released):
    """It may go while its last call is on its way."""
    pipeline = object.__new__(Pipeline)
    pipeline._host_inputs = [SimpleNamespace(device=SimpleNamespace(is_cuda=False), pinned=pinned) for pinned in (1, 0)]
    pinned = pipeline._host_inputs[0]
    del pipeline
    assert list(pool._released) == [pinned]


def test_streams_hand_over_complete_frames(scene, monkeypatch):
    """Latencies are of frames that are there: the thread that renders waits for each group."""
    waited = []
    monkeypatch.setattr(ImageStack, "wait", lambda images: waited.append(len(images)))
    frames = list(ws.Renderer(scene, "cpu").stream(range(60, 66), ["sat11"], ["A"], n_ahead=4))
    assert [frame.frames[0] for frame in frames] == list(range(60, 66))
    assert sum(waited) == 6
