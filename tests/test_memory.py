"""Memory of results: used again when nobody holds it, shared without copies, and in order on a GPU."""

import collections
import contextlib
import ctypes
import gc
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.records import Observation

import warpsim as ws
from warpsim import pool as pool_module
from warpsim.pool import Pool, come_after_all, take_released
from warpsim.render import image_stack
from warpsim.render.batch import copy_views
from warpsim.render.image_stack import ImageStack, capsule

SHAPE = (3, 4, 5)


@pytest.fixture
def pool(device):
    return Pool(wp.get_device(device), most_bytes=10_000)


def test_memory_comes_back_with_the_array(pool):
    first = pool.new(SHAPE, wp.uint16)
    pointer = first.ptr
    assert first.shape == SHAPE and first.is_contiguous
    assert pool.n_byte == 0
    del first
    assert pool.n_byte == 120
    assert pool.new(SHAPE, wp.uint16).ptr == pointer


@pytest.mark.parametrize(
    "hold",
    [
        lambda array: array[1:2],
        lambda array: array.flatten(),
        lambda array: array.numpy(),
        lambda array: array.numpy().reshape(-1)[3:9],
        lambda array: np.from_dlpack(array.numpy()),
        lambda array: wp.from_dlpack(wp.to_dlpack(array)),
        lambda array: memoryview(array.numpy()),
        wp.to_dlpack,
    ],
    ids=["slice", "flat", "numpy", "numpy-part", "dlpack-numpy", "dlpack-warp", "memoryview", "capsule"],
)
@pytest.mark.ci
def test_what_is_held_is_not_used_again(hold):
    pool = Pool(wp.get_device("cpu"))
    array = pool.new(SHAPE, wp.uint16)
    array.fill_(7)
    held = hold(array)
    del array
    gc.collect(1)
    assert pool.n_byte == 0
    for _ in range(3):
        pool.new(SHAPE, wp.uint16).fill_(9)
    if type(held).__name__ != "PyCapsule":
        assert ((held.numpy() if isinstance(held, wp.array) else np.asarray(held)) == 7).all()
    waiting = pool.n_byte
    del held
    gc.collect()
    assert pool.n_byte > waiting


def test_two_arrays_never_share(pool):
    arrays = [pool.new(SHAPE, wp.float32) for _ in range(5)]
    assert len({array.ptr for array in arrays}) == 5


def test_blocks_serve_what_is_a_little_smaller(pool):
    pool.new((100,), wp.float64)
    assert pool.n_byte == 800
    small, near = pool.new((10,), wp.float64), pool.new((60,), wp.float64)
    assert pool.n_byte == 0
    del small, near
    assert pool.n_byte == 880


def test_what_waits_is_bounded(pool):
    arrays = [pool.new((500,), wp.float64) for _ in range(5)]
    del arrays
    assert pool.n_byte == 8_000
    pool.new((5000,), wp.float64)
    assert pool.n_byte <= 10_000
    none = Pool(pool.device, most_bytes=0)
    none.new(SHAPE, wp.uint16)
    assert none.n_byte == 0


def test_an_empty_array_needs_no_memory(pool):
    assert pool.new((0, 5), wp.float32).shape == (0, 5)
    assert pool.n_byte == 0


def test_threads_may_take_and_give_back_at_once():
    pool = Pool(wp.get_device("cpu"), most_bytes=4_000)
    wrong = []

    def use(number):
        for _ in range(300):
            array = pool.new((100,), wp.int64)
            values = array.numpy()
            values[:] = number
            if (values != number).any():
                wrong.append(number)
            del values, array

    threads = [threading.Thread(target=use, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert pool.n_byte <= 4_000


KINDS = {
    "numbers": (wp.float32, ()),
    "vectors": (wp.vec3d, (2, 3)),
    "records": (Observation, (5,)),
    "none": (wp.vec2, (0,)),
}


@pytest.mark.parametrize(("dtype", "shape"), KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("via", ["device", "cpu"])
def test_consecutive_views_are_copied(device, via, dtype, shape):
    """Of arrays on one device, and to and from the host; what lies beside them stays."""
    source = wp.zeros((6, *shape), dtype=dtype, device="cpu")
    n_byte = source.strides[0] * 6 if source.size else 0
    values = np.random.default_rng(5).integers(0, 256, n_byte, dtype=np.uint8)
    memory_of(source)[:] = values
    there = source.to(device)
    middle = wp.zeros((4, *shape), dtype=dtype, device=device if via == "device" else "cpu")
    back = wp.zeros((9, *shape), dtype=dtype, device=device)
    copy_views(middle, 1, there, 3, 3)
    copy_views(back, 7, middle, 2, 2)
    copy_views(back, 0, middle, 0, 0)
    wp.synchronize_device(device)
    on_host = back.to("cpu")
    found, expected = memory_of(on_host).reshape(9, -1), values.reshape(6, -1)
    np.testing.assert_array_equal(found[7:], expected[4:6])
    assert not found[:7].any()


def memory_of(array):
    """Bytes of an array in host memory, for as long as it is held."""
    n_byte = array.size * wp.types.type_size_in_bytes(array.dtype)
    return np.ctypeslib.as_array((ctypes.c_uint8 * n_byte).from_address(array.ptr or 0)) if n_byte else np.empty(0)


def test_results_that_are_held_are_never_overwritten(scene):
    """Of many calls of a renderer, in any form; and memory does come back."""
    renderer = ws.Renderer(scene, device="cpu")
    fresh = [renderer.render([k], ["sat11"], ["A"]).counts.numpy().copy() for k in range(6)]
    forms = [lambda c: c, lambda c: c.array, lambda c: c.numpy(), np.from_dlpack, lambda c: c[0, 0], np.asarray]
    held = [form(renderer.render([k], ["sat11"], ["A"]).counts) for k, form in enumerate(forms)]
    truths = [renderer.render([k], ["sat11"], ["A"]) for k in (3, 4)]
    copies = [frames.axes_icrs.copy() for frames in truths]
    for k in range(20):
        renderer.render([40 + k], ["sat11", "sat27"], ["A"])
        renderer.render([40 + k], ["sat11"], ["A"])
    for values, kept in zip(fresh, held, strict=True):
        array = kept.numpy() if isinstance(kept, wp.array) else np.asarray(kept)
        np.testing.assert_array_equal(array.reshape(values.shape), values)
    for frames, axes in zip(truths, copies, strict=True):
        np.testing.assert_array_equal(frames.axes_icrs, axes)
        assert set(frames.truth["frame"]) == set(frames.frames)
    del held, truths, frames, kept, array
    gc.collect()
    assert renderer.buffer_bytes > renderer._pipelines["sensor", ("A",), False].n_byte


def test_a_renderer_does_not_hold_its_latest_result(scene):
    renderer = ws.Renderer(scene, device="cpu", n_thread=2)
    frames = renderer.render(range(3), ["sat11", "sat27"], ["A"], keep_signal=True)
    n_byte = sum(images.array.size * wp.types.type_size_in_bytes(images.array.dtype) for images in
                 (frames.counts, frames.signal_w_cm2))  # fmt: skip
    waiting = renderer.buffer_bytes
    del frames
    gc.collect()
    assert renderer.buffer_bytes >= waiting + n_byte


def test_memory_is_bounded_by_the_chunk_and_stated(scene):
    """Buffers grow with the chunk, not with the call; and images do not depend on it."""
    whole = ws.Renderer(scene, device="cpu", n_thread=2, pool_bytes=0)
    expected = whole.render(range(4), bands=["A"]).counts.numpy()
    one_view = 4 * 128 * 128
    sizes = []
    for n_view in (1, 3):
        renderer = ws.Renderer(scene, device="cpu", n_thread=2, chunk_bytes=n_view * one_view, pool_bytes=0)
        np.testing.assert_array_equal(renderer.render(range(4), bands=["A"]).counts.numpy(), expected)
        sizes.append(renderer.buffer_bytes)
        # Of two threads; a chunk's results, some 2.8 kB a view, come on top.
        assert 2 * n_view * one_view < sizes[-1] < 2 * 2 * n_view * one_view + 2 * n_view * 4000
        renderer.render(range(20), bands=["A"])
        assert renderer.buffer_bytes == sizes[-1]
    assert sizes[1] > 2 * sizes[0]
    assert whole.buffer_bytes > sizes[1]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"chunk_bytes": 0}, "chunk_bytes: must be a whole number >= 1, got 0"),
        ({"chunk_bytes": 1e6}, "chunk_bytes: must be a whole number >= 1, got 1000000.0"),
        ({"pool_bytes": -1}, "pool_bytes: must be a whole number >= 0, got -1"),
    ],
)
def test_bad_sizes_are_named(scene, arguments, text):
    with pytest.raises(ws.InputError) as caught:
        ws.Renderer(scene, device="cpu", **arguments)
    assert str(caught.value) == text


def test_more_than_2_gib_in_one_array():
    """Warp's axes end at 2**31 - 1."""
    array = Pool(wp.get_device("cpu")).new((700, 3, 1024, 1024), wp.uint16)
    assert array.shape == (700, 3, 1024, 1024)
    array[699:].fill_(7)  # touches the last pages only
    assert (array[699:].numpy() == 7).all()


PICKS = ([60, 61, 62], ["sat11", "sat47"], ["A", "E"])
WRITABLE = {"numpy", "torch"}
"""JAX arrays cannot be written to by anyone."""


def from_numpy(stack):
    array = np.from_dlpack(stack)
    return array, array.ctypes.data


def from_torch(stack):
    torch = pytest.importorskip("torch")
    tensor = torch.from_dlpack(stack)
    return tensor, tensor.data_ptr()


def from_jax(stack):
    pytest.importorskip("jax")
    from jax import numpy as jnp

    array = jnp.from_dlpack(stack, copy=False)
    return array, array.unsafe_buffer_pointer()


CONSUMERS = {"numpy": from_numpy, "torch": from_torch, "jax": from_jax}


@pytest.fixture(scope="module")
def renderer(scene):
    return ws.Renderer(scene, device="cpu")


@pytest.fixture
def frames(renderer):
    return renderer.render(*PICKS, keep_signal=True)


@pytest.mark.parametrize("name", CONSUMERS)
def test_memory_is_shared(frames, name):
    for stack, kind in ((frames.counts, "uint16"), (frames.signal_w_cm2, "float32")):
        held, address = CONSUMERS[name](stack)
        assert address == stack.array.ptr
        assert tuple(held.shape) == stack.shape == (3, 2, 2, 128, 128)
        assert str(held.dtype).endswith(kind)
        np.testing.assert_array_equal(np.asarray(held), stack.numpy())
        if name in WRITABLE:
            held[2, 1, 0, 5, 7] = 11
            assert stack.numpy()[2, 1, 0, 5, 7] == 11


@pytest.mark.parametrize("name", CONSUMERS)
def test_a_single_frame_shares_its_part(frames, name):
    part = frames.one_frame(1)
    held, address = CONSUMERS[name](part.counts)
    assert address == frames.counts.array.ptr + 2 * 2 * 2 * 128 * 128
    np.testing.assert_array_equal(np.asarray(held), frames.counts.numpy()[1:2])


@pytest.mark.parametrize("name", CONSUMERS)
def test_memory_is_not_used_again_while_a_consumer_holds_it(name):
    pool = Pool(wp.get_device("cpu"))
    array = pool.new((6, 2, 16, 16), wp.uint16)
    array.fill_(7)
    held, _ = CONSUMERS[name](ImageStack(array, 3, 2))
    del array
    gc.collect()
    assert pool.n_byte == 0
    for _ in range(3):
        pool.new((6, 2, 16, 16), wp.uint16).fill_(9)
    assert (np.asarray(held) == 7).all()
    waiting = pool.n_byte
    del held
    gc.collect()
    assert pool.n_byte == waiting + 2 * 6 * 2 * 16 * 16


def test_a_capsule_that_nobody_takes_gives_its_memory_back():
    pool = Pool(wp.get_device("cpu"))
    made = ImageStack(pool.new((6, 2, 16, 16), wp.uint16), 3, 2).__dlpack__(max_version=(1, 0))
    gc.collect()
    assert pool.n_byte == 0
    del made
    gc.collect()
    assert pool.n_byte == 2 * 6 * 2 * 16 * 16


def test_the_stack_itself_may_go_first(renderer, frames):
    expected = frames.counts.numpy().copy()
    held = np.from_dlpack(frames.counts)
    del frames
    gc.collect()
    for number in range(5):
        renderer.render([70 + number, 80, 90], *PICKS[1:])
    np.testing.assert_array_equal(held, expected)


def tensor_of(made):
    """Name of a capsule and the fields of its tensor, read as DLPack's header lays them out."""
    pointer_of = ctypes.pythonapi.PyCapsule_GetPointer
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    name_of = ctypes.pythonapi.PyCapsule_GetName
    name_of.restype, name_of.argtypes = ctypes.c_char_p, [ctypes.py_object]
    name = name_of(made)
    address = pointer_of(made, name)
    head = {}
    if name == b"dltensor_versioned":
        head = {
            "version": tuple((ctypes.c_uint32 * 2).from_address(address)),
            "flags": ctypes.c_uint64.from_address(address + 24).value,
        }
        address += 32
    n_axis = ctypes.c_int32.from_address(address + 16).value
    shape = ctypes.c_void_p.from_address(address + 24).value
    return name, head | {
        "data": ctypes.c_void_p.from_address(address).value,
        "device": tuple((ctypes.c_int32 * 2).from_address(address + 8)),
        "type": tuple((ctypes.c_uint8 * 2).from_address(address + 20)),
        "shape": tuple((ctypes.c_int64 * n_axis).from_address(shape)),
        "byte_offset": ctypes.c_uint64.from_address(address + 40).value,
    }


@pytest.mark.parametrize("on_device", [(1, 0), (2, 0), (2, 3)])
def test_capsules_say_where_the_memory_is(frames, monkeypatch, on_device):
    """As on a machine with GPUs: nothing reads the memory on the way."""
    monkeypatch.setattr(image_stack, "device_of", lambda array: on_device)
    array, shape = frames.counts.array, frames.counts.shape
    fields = {"data": array.ptr, "device": on_device, "type": (1, 16), "shape": shape, "byte_offset": 0}
    assert tensor_of(capsule(array, shape)) == (b"dltensor", fields)
    name, versioned = tensor_of(capsule(array, shape, (1, 3)))
    assert name == b"dltensor_versioned"
    assert versioned.pop("version")[0] == 1
    assert versioned.pop("flags") == 0  # neither read-only nor copied
    assert versioned == fields


class Device:
    is_cuda, ordinal = True, 1


class Array:
    device, dtype, ptr, pinned = Device(), wp.uint16, 1 << 40, False


def test_memory_on_cuda_waits_for_its_readers(monkeypatch):
    """What was let go of is kept until the device has been ordered after its readers, which the next result does."""
    ordered = []

    def refuse(device):
        raise RuntimeError("a graph is captured")

    made = capsule(Array(), (1, 2, 1, 4, 4), (1, 0))
    assert tensor_of(made)[1]["device"] == (2, 1)
    del made
    gc.collect()
    assert len(pool_module._released) == 1
    monkeypatch.setattr(pool_module, "come_after_all", refuse)
    with pytest.raises(RuntimeError, match="captured"):
        take_released()
    assert len(pool_module._released) == 1  # it still waits
    monkeypatch.setattr(pool_module, "come_after_all", ordered.append)
    monkeypatch.setattr(wp, "synchronize_device", refuse)  # the host does not wait
    Pool(wp.get_device("cpu")).new((3,), wp.uint16)
    assert ordered == [Array.device]
    assert len(pool_module._released) == 0
    take_released()
    assert len(ordered) == 1


def test_pinned_memory_waits_for_all_devices(monkeypatch):
    """The host waits: any device may copy from it."""

    class Host:
        is_cuda = False

    class Pinned(Array):
        device, pinned = Host(), True

    waited, devices = [], [Device(), Device()]
    monkeypatch.setattr(wp, "get_cuda_devices", lambda: devices)
    monkeypatch.setattr(wp, "synchronize_device", waited.append)
    pool_module.release_later(Pinned())
    take_released()
    assert waited == devices
    assert len(pool_module._released) == 0


def test_what_the_standard_lets_a_consumer_ask_for(frames):
    counts = frames.counts
    assert counts.__dlpack_device__() == (1, 0)
    assert np.from_dlpack(counts, device="cpu", copy=False).ctypes.data == counts.array.ptr
    copied = np.from_dlpack(counts, copy=True)
    assert copied.ctypes.data != counts.array.ptr
    np.testing.assert_array_equal(copied, counts.numpy())
    copied[0, 0, 0, 0, 0] += 1
    assert copied[0, 0, 0, 0, 0] != counts.numpy()[0, 0, 0, 0, 0]
    with pytest.raises(BufferError, match=r"dl_device: must be \(1, 0\), where the images are"):
        counts.__dlpack__(dl_device=(2, 0))
    with pytest.raises(BufferError, match="stream: must be None for images on the CPU, got 1"):
        counts.__dlpack__(stream=1)


def test_no_images_are_an_array_too(renderer):
    frames = renderer.render([], ["sat11"], ["A"])
    assert np.from_dlpack(frames.counts).shape == (0, 1, 1, 128, 128)


def test_host_memory_is_aligned_for_every_consumer():
    pool = Pool(wp.get_device("cpu"))
    for n in (1, 100, 3_000_000):
        assert pool.new((n,), wp.uint16).ptr % 64 == 0


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_images_on_a_gpu_are_shared_with_pytorch(scene):
    torch = pytest.importorskip("torch")
    if not torch.cuda.is_available():
        pytest.skip("PyTorch without CUDA")
    frames = ws.Renderer(scene, device="cuda:0").render(*PICKS)
    held = torch.from_dlpack(frames.counts)
    assert held.data_ptr() == frames.counts.array.ptr
    assert held.device.type == "cuda"
    np.testing.assert_array_equal(held.cpu().numpy(), frames.counts.numpy())
    on_host = np.from_dlpack(frames.counts, device="cpu")
    np.testing.assert_array_equal(on_host, frames.counts.numpy())


@pytest.fixture
def asked(monkeypatch):
    """What driver, device and host are asked, in order."""
    log = []
    monkeypatch.setattr(wp, "Event", lambda device: SimpleNamespace(cuda_event=f"event of {device.name}"))
    monkeypatch.setattr(wp, "synchronize_device", lambda device: log.append("host waits"))
    return log


def device(log, is_capturing=False):
    """A stand-in that cannot be hashed, as Warp's devices cannot."""
    waits = SimpleNamespace(wait_event=lambda event: log.append(f"null stream waits for {event.cuda_event}"))
    guard = contextlib.nullcontext()
    return SimpleNamespace(
        name="gpu", context=11, is_capturing=is_capturing, null_stream=waits, is_cuda=True, context_guard=guard
    )


def test_memory_of_gpus_is_waited_for_once_for_each(monkeypatch, asked):
    driver(monkeypatch, asked, 0)
    one, other = device(asked), device(asked)
    other.context = 12
    lent = [SimpleNamespace(device=where, pinned=False) for where in (one, other, one)]
    monkeypatch.setattr(pool_module, "_released", collections.deque(lent))
    take_released()
    assert [entry[0] for entry in asked if isinstance(entry, tuple)] == [11, 12]
    assert not pool_module._released


def driver(monkeypatch, log, status):
    def record(context, event):
        log.append((context, event))
        return status

    monkeypatch.setattr(pool_module, "_record_of_context", lambda: record)


def test_the_device_waits_and_the_host_does_not(monkeypatch, asked):
    driver(monkeypatch, asked, 0)
    come_after_all(device(asked))
    assert asked == [(11, "event of gpu"), "null stream waits for event of gpu"]


def test_the_host_waits_where_the_driver_refuses(monkeypatch, asked):
    driver(monkeypatch, asked, 900)
    come_after_all(device(asked))
    assert asked == [(11, "event of gpu"), "host waits"]


def test_the_host_waits_where_the_driver_has_no_such_events(monkeypatch, asked):
    monkeypatch.setattr(pool_module, "_record_of_context", lambda: None)
    come_after_all(device(asked))
    assert asked == ["host waits"]


def test_the_driver_is_not_asked_amid_a_capture(monkeypatch, asked):
    """It would spoil the capture; Warp's own waiting says what is wrong."""
    driver(monkeypatch, asked, 0)
    come_after_all(device(asked, is_capturing=True))
    assert asked == ["host waits"]


@pytest.mark.parametrize("library", ["no-such-library.so", None])
def test_drivers_without_it_are_found_out(monkeypatch, library):
    """A library that is not there, and one (the process itself) without the function."""
    monkeypatch.setattr(pool_module, "_DRIVER", library)
    assert pool_module._record_of_context.__wrapped__() is None


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_a_blocking_stream_comes_after_a_non_blocking_one():
    """Numbers are added on a PyTorch side stream, late; a Warp stream that does not wait for it reads them."""
    torch = pytest.importorskip("torch")
    where = wp.get_device("cuda:0")
    assert pool_module._record_of_context() is not None, "the driver is older than CUDA 12.5"
    side, own = torch.cuda.Stream("cuda:0"), wp.Stream(where)
    values, seen = torch.zeros(1000, device="cuda:0"), wp.zeros(1000, dtype=float, device=where)
    values.add_(0.0)  # to load its kernel would be to wait
    torch.cuda._sleep(1)
    torch.cuda.synchronize()
    with torch.cuda.stream(side):
        torch.cuda._sleep(1_000_000_000)
        values.add_(1.0)
    come_after_all(where)
    assert not side.query(), "the host did not wait"
    wp.copy(seen, wp.from_torch(values), stream=own)
    wp.synchronize_stream(own)
    assert (seen.numpy() == 1.0).all()
