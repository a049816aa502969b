"""Images go to other libraries without a copy, all five axes, and their memory is used again only when those let go."""

import ctypes
import gc

import numpy as np
import pytest
import warp as wp

import warpsim as ws
from warpsim.render import image_stack
from warpsim.render import pool as pool_module
from warpsim.render.image_stack import ImageStack, capsule
from warpsim.render.pool import Pool, take_released

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
