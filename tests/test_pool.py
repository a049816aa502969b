"""Memory is used again only when nobody holds it any more, and only so much of it is kept."""

import ctypes
import gc
import threading

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.records import Observation

import warpsim as ws
from warpsim.render.batch import copy_views
from warpsim.render.pool import Pool

SHAPE = (3, 4, 5)


@pytest.fixture
def pool(device):
    return Pool(wp.get_device(device), most_bytes=10_000)


def test_memory_comes_back_with_the_array(pool):
    first = pool.new(SHAPE, wp.uint16)
    place = first.ptr
    assert first.shape == SHAPE and first.is_contiguous
    assert pool.n_byte == 0
    del first
    assert pool.n_byte == 120
    assert pool.new(SHAPE, wp.uint16).ptr == place


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
    gc.collect()
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
    found, expected = memory_of(back.to("cpu")).reshape(9, -1), values.reshape(6, -1)
    np.testing.assert_array_equal(found[7:], expected[4:6])
    assert not found[:7].any()


def memory_of(array):
    """Bytes of an array in host memory."""
    n_byte = array.size * wp.types.type_size_in_bytes(array.dtype)
    return np.ctypeslib.as_array((ctypes.c_uint8 * n_byte).from_address(array.ptr or 0)) if n_byte else np.empty(0)


def test_results_that_are_held_are_never_overwritten(scene):
    """Of many calls of a renderer, in any form; and memory does come back."""
    renderer = ws.Renderer(scene, device="cpu")
    fresh = [renderer.render([k], ["sat11"], ["A"]).counts.numpy().copy() for k in range(6)]
    forms = [lambda c: c, lambda c: c.array, lambda c: c.numpy(), np.from_dlpack, lambda c: c[0, 0], np.asarray]
    held = [form(renderer.render([k], ["sat11"], ["A"]).counts) for k, form in enumerate(forms)]
    truths = [renderer.render([k], ["sat11"], ["A"]) for k in (3, 4)]
    places = [frames.axes_icrs.copy() for frames in truths]
    for k in range(20):
        renderer.render([40 + k], ["sat11", "sat27"], ["A"])
        renderer.render([40 + k], ["sat11"], ["A"])
    for values, kept in zip(fresh, held, strict=True):
        array = kept.numpy() if isinstance(kept, wp.array) else np.asarray(kept)
        np.testing.assert_array_equal(array.reshape(values.shape), values)
    for frames, axes in zip(truths, places, strict=True):
        np.testing.assert_array_equal(frames.axes_icrs, axes)
        assert set(frames.truth["frame"]) == set(frames.frames)
    del held, truths, frames, kept, array
    gc.collect()
    assert renderer.buffer_bytes > renderer._pipelines["sensor", ("A",)].n_byte


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
