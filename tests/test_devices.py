"""Threads, devices and passes divide the work; images do not depend on how."""

import gc
import itertools
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp

import warpsim as ws
from warpsim.launches import Launch, Stage
from warpsim.render import schedule
from warpsim.render.device import chosen_devices


@pytest.fixture(scope="module")
def expected(scene):
    """Counts by one thread, one pass a call."""
    renderer = ws.Renderer(scene, device="cpu", n_thread=1)
    return np.concatenate([renderer.render([k], bands=["A", "C"]).counts.numpy() for k in range(7)])


def pipelines_of(renderer, bands):
    """The pipelines of a renderer that have had work."""
    return [pipeline for pipeline in renderer._pipelines["sensor", bands, False]._pipelines if pipeline is not None]


@pytest.mark.parametrize("devices", [["cpu"], ["cpu", "cpu"], ("cpu", "cpu", "cpu")])
@pytest.mark.parametrize("n_thread", [1, 2])
@pytest.mark.ci
def test_a_list_of_devices_shares_the_views(scene, expected, devices, n_thread, record_accuracy):
    renderer = ws.Renderer(scene, device=devices, n_thread=n_thread, chunk_bytes=4 * 2 * 128 * 128 * 3)
    assert [str(device) for device in renderer.devices] == list(devices)
    frames = renderer.render(range(7), bands=["A", "C"], keep_signal=True, keep_stars=True)
    np.testing.assert_array_equal(frames.counts.numpy(), expected)
    differ = np.count_nonzero(frames.counts.numpy() != expected)
    record_accuracy("Counts with any list of devices", differ, 0, "pixels differ", "each other")
    assert frames.counts.device.is_cpu
    pipelines = pipelines_of(renderer, ("A", "C"))
    assert len(pipelines) == max(n_thread, len(devices))
    assert len({id(pipeline.scene) for pipeline in pipelines}) == len(devices)
    one = ws.Renderer(scene, device="cpu").render(range(7), bands=["A", "C"], keep_signal=True, keep_stars=True)
    np.testing.assert_array_equal(frames.signal_w_cm2.numpy(), one.signal_w_cm2.numpy())
    for name in ("x_px", "irradiance_w_cm2", "albedo_w_cm2", "snr_peak"):
        np.testing.assert_array_equal(frames.truth[name], one.truth[name])
    np.testing.assert_array_equal(frames.stars["x_px"], one.stars["x_px"])


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
@pytest.mark.parametrize("devices", [["cuda:0"], ["cuda:0", "cuda:0"]])
def test_images_of_gpus_land_in_host_memory(scene, devices):
    """The same bits as those that stay on the GPU, over many passes, so that copies overlap with work."""
    resident = ws.Renderer(scene, device="cuda:0").render(range(30), keep_signal=True)
    landed = ws.Renderer(scene, device=devices, chunk_bytes=4 * 3 * 128 * 128 * 8)
    for _ in range(2):
        frames = landed.render(range(30), keep_signal=True)
        assert frames.counts.device.is_cpu and frames.counts.array.pinned
        np.testing.assert_array_equal(frames.counts.numpy(), resident.counts.numpy())
        np.testing.assert_array_equal(frames.signal_w_cm2.numpy(), resident.signal_w_cm2.numpy())
        np.testing.assert_array_equal(frames.truth["x_px"], resident.truth["x_px"])


@pytest.mark.ci
@pytest.mark.parametrize("n_thread", [2, 5])
def test_calls_of_all_sizes_and_from_several_threads(scene, expected, n_thread):
    """Pipelines are used again with fewer views, more views, and by calls that come at once."""
    renderer = ws.Renderer(scene, device="cpu", n_thread=n_thread)
    wrong = []

    def use():
        for frames in ([3], range(7), [6, 0], range(1, 5), [2]):
            counts = renderer.render(frames, bands=["A", "C"]).counts.numpy()
            if not np.array_equal(counts, expected[list(frames)]):
                wrong.append(frames)

    threads = [threading.Thread(target=use) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_signal_does_not_leak_into_the_next_call(scene, expected):
    renderer = ws.Renderer(scene, device="cpu", n_thread=1)
    for keep in (True, False, True, False):
        frames = renderer.render(range(7), bands=["A", "C"], keep_signal=keep)
        np.testing.assert_array_equal(frames.counts.numpy(), expected)


def test_threads_end_with_the_renderer(scene):
    renderer = ws.Renderer(scene.replace(sky__catalog="none"), device="cpu", n_thread=3)
    before = set(threading.enumerate())
    renderer.render(range(40), ["sat11"], ["A"])
    mine = [thread for thread in set(threading.enumerate()) - before if thread.name.startswith("warpsim")]
    assert 1 <= len(mine) <= 3
    renderer.render(range(40), ["sat11"], ["A"])
    assert len(set(threading.enumerate()) - before) <= 3
    del renderer
    gc.collect()
    for thread in mine:
        thread.join(timeout=10)
        assert not thread.is_alive()


def test_an_error_in_a_thread_reaches_the_caller(scene, monkeypatch):
    renderer = ws.Renderer(scene, device="cpu", n_thread=2)
    counts = renderer.render(range(30), ["sat11"], ["A"]).counts.numpy().copy()
    mine, other = pipelines_of(renderer, ("A",))
    failed, render = threading.Event(), mine.render

    def fail(*arguments):
        failed.set()
        raise ZeroDivisionError("elsewhere")

    def wait(*arguments):
        assert failed.wait(timeout=30)
        return render(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(other, "render", fail)
        patch.setattr(mine, "render", wait)
        with pytest.raises(ZeroDivisionError, match="elsewhere"):
            renderer.render(range(30), ["sat11"], ["A"])
    np.testing.assert_array_equal(renderer.render(range(30), ["sat11"], ["A"]).counts.numpy(), counts)


def test_bad_lists_of_devices():
    for devices in ([], ["cpu", "tpu"], ["cuda:9"]):
        with pytest.raises(ws.InputError, match=r"^device: ") as caught:
            chosen_devices(devices)
        assert "\n" not in str(caught.value)


INTERRUPTS = {
    # Of what, before or after which call of all threads.
    "before-a-size": (wp.Launch, "set_dim", "before", 7),
    "behind-a-size": (wp.Launch, "set_dim", "after", 7),
    "before-an-output": (Launch, "set_output", "before", 2),
    "between-launches": (Launch, "run", "before", 9),
    "beside-another-thread": (ThreadPoolExecutor, "submit", "after", 1),
    "behind-the-first-stage": (Stage, "run", "after", 1),
    "behind-the-light": (Stage, "run", "after", 4),
    "in-the-other-thread-too": (Stage, "run", "after", 8),
}


@pytest.mark.parametrize(("owner", "name", "when", "at"), INTERRUPTS.values(), ids=INTERRUPTS)
def test_an_interrupt_spoils_nothing_that_comes_after(scene, expected, monkeypatch, owner, name, when, at):
    """Ctrl-C while launches get their sizes, while another thread works on, or when light lies on the images."""
    monkeypatch.setattr(schedule, "PIXELS_PER_PASS", 2 * 128 * 128)  # several passes for each thread
    renderer = ws.Renderer(scene, device="cpu", n_thread=2)
    renderer.render(range(7), bands=["A", "C"])
    real, numbers = getattr(owner, name), itertools.count(1)

    def method(self, *arguments):
        number = next(numbers)  # of several threads
        result = real(self, *arguments) if when == "after" or number != at else None
        if number == at:
            raise KeyboardInterrupt
        return result

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, method)
        with pytest.raises(KeyboardInterrupt):
            [renderer.render(range(n_frame), bands=["A", "C"]) for n_frame in (1, 4, 2, 5)]
    for _ in range(3):
        np.testing.assert_array_equal(renderer.render(range(7), bands=["A", "C"]).counts.numpy(), expected)


def test_light_of_a_pass_that_broke_off_is_put_out(scene, expected):
    renderer = ws.Renderer(scene, device="cpu", n_thread=1)
    renderer.render(range(7), bands=["A", "C"])
    (pipeline,) = pipelines_of(renderer, ("A", "C"))
    images = pipeline._images
    images.signal.flat.fill_(1e-15)
    images.signal.touched.fill_(1)
    images._is_zero = False
    np.testing.assert_array_equal(renderer.render(range(7), bands=["A", "C"]).counts.numpy(), expected)


def test_signal_is_zero_between_passes(scene, device):
    renderer = ws.Renderer(scene, device=device, n_thread=1)
    for n_frame in (7, 2):
        renderer.render(range(n_frame), bands=["A", "C"], keep_signal=True).counts.numpy()
        (pipeline,) = pipelines_of(renderer, ("A", "C"))
        for array in pipeline._images.signal.arrays:
            assert not array.numpy().any()
