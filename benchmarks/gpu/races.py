"""Checks that threads, streams and passes change no bit of images and truth."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

import warpsim as ws
from benchmarks.gpu.plan import Plan, Row, lack_of_torch, rows_of

Counts = npt.NDArray[np.uint16]

SENSORS, BANDS = ["sat11"], ["A"]
LONGEST_S = 120.0
"""Threads that take longer are taken for stuck."""

PASS_BYTES = 4 * 8 * 128 * 128
"""Noiseless images of 8 views."""


class DifferentError(AssertionError):
    """Something came out otherwise than alone."""


def scene() -> ws.Scene:
    """Stss with frames 10 ms apart, while targets are in view."""
    return ws.Scene.load("stss").replace(frames={"count": 1000, "interval_s": 0.01, "start_s": 600.0})


def counts_of(renderer: ws.Renderer, frames: Sequence[int]) -> Counts:
    """Counts of frames in host memory."""
    return np.asarray(renderer.render(frames, SENSORS, BANDS).counts.numpy()).copy()


def expect(what: str, found: npt.NDArray[Any], expected: npt.NDArray[Any]) -> None:
    """Compare bits.

    Raises:
        DifferentError: They differ.
    """
    if not np.array_equal(found, expected, equal_nan=found.dtype.kind == "f"):
        part = float((found != expected).mean()) if found.shape == expected.shape else 1.0
        raise DifferentError(f"{what}: {part:.2g} of the numbers differ")


def stream_with_a_reader(device: str, n: int) -> Row:
    """A stream renders ahead while its consumer reads images and truth of the frames before."""
    where, renderer = wp.get_device(device), ws.Renderer(scene(), device)
    whole = renderer.render(range(n), SENSORS, BANDS)
    counts, x_px = whole.counts.numpy().copy(), np.asarray(whole.truth["x_px"]).reshape(n, -1)
    current = wp.get_stream(where) if where.is_cuda else None
    for number, frame in enumerate(renderer.stream(range(n), SENSORS, BANDS)):
        expect(f"counts of frame {number}", frame.counts.numpy()[0], counts[number])
        expect(f"truth of frame {number}", np.asarray(frame.truth["x_px"]), x_px[number])
    if where.is_cuda and wp.get_stream(where) is not current:
        raise DifferentError("the current stream of the device is another one")
    return {"frames": n}


def two_renderers(device: str, n: int) -> Row:
    """Two renderers, of two scenes, in two threads."""
    scenes = [scene(), scene().replace(optics__psf="gaussian")]
    expected = [counts_of(ws.Renderer(one, device), range(n)) for one in scenes]
    renderers = [ws.Renderer(one, device) for one in scenes]

    def work(number: int) -> None:
        for size in (n, 1, n // 2, n):
            expect(
                f"renderer {number}, {size} frames", counts_of(renderers[number], range(size)), expected[number][:size]
            )
            truth = renderers[number].render([size - 1], SENSORS, BANDS).truth
            if not np.isfinite(truth["range_km"]).any():
                raise DifferentError("truth is not known")

    _in_threads([partial(work, number) for number in range(2)])
    return {"frames": n}


def one_renderer(device: str, n: int) -> Row:
    """One renderer, called by three threads."""
    renderer = ws.Renderer(scene(), device)
    expected = counts_of(renderer, range(n))

    def work(number: int) -> None:
        for frames in ([number], range(n), range(n - 1, number, -2), range(1, n // 2)):
            expect(f"thread {number}", counts_of(renderer, frames), expected[list(frames)])

    _in_threads([partial(work, number) for number in range(3)])
    return {"frames": n}


def devices_in_a_list(device: str, n: int) -> Row:
    """The device once and twice in a list, in many passes on the way to the host."""
    expected = counts_of(ws.Renderer(scene(), device), range(n))
    for devices in ([device], [device, device]):
        renderer = ws.Renderer(scene(), devices, chunk_bytes=PASS_BYTES)
        for _ in range(3):
            expect(f"{len(devices)} times", counts_of(renderer, range(n)), expected)
    return {"frames": n}


def alone_against_batch(device: str, n: int) -> Row:
    """Frames by themselves, in a batch, and in small batches after a large one."""
    renderer = ws.Renderer(scene(), device)
    whole = counts_of(renderer, range(n))
    for number in (0, n // 2, n - 1):
        expect(
            f"frame {number} by another renderer", counts_of(ws.Renderer(scene(), device), [number])[0], whole[number]
        )
        expect(f"frame {number}", counts_of(renderer, [number])[0], whole[number])
    for size in (2, n // 2, n - 1):
        expect(f"{size} frames", counts_of(renderer, range(size)), whole[:size])
    return {"frames": n}


def full_against_part(device: str, n: int) -> Row:
    """One pass, and passes of several sizes of which the last is not full; light and truth, too."""
    whole = ws.Renderer(scene(), device).render(range(n), SENSORS, BANDS, keep_signal=True)
    for views in (1, 3, 8, n - 1):
        renderer = ws.Renderer(scene(), device, chunk_bytes=views * PASS_BYTES // 8)
        for _ in range(2):
            frames = renderer.render(range(n), SENSORS, BANDS, keep_signal=True)
            assert frames.signal_w_cm2 is not None and whole.signal_w_cm2 is not None
            expect(f"counts, {views} views", frames.counts.numpy(), whole.counts.numpy())
            expect(f"light, {views} views", frames.signal_w_cm2.numpy(), whole.signal_w_cm2.numpy())
            expect(f"truth, {views} views", np.asarray(frames.truth["snr"]), np.asarray(whole.truth["snr"]))
    return {"frames": n}


def other_current_stream(device: str, n: int) -> Row:
    """Images, light, truth and parts are read at once, while the current stream is another one than at the call."""
    where, renderer = wp.get_device(device), ws.Renderer(scene(), device)
    whole = _light(renderer, 0, n)
    wanted = [whole.counts.numpy().copy(), whole.signal_w_cm2.numpy().copy(), np.asarray(whole.truth["snr"]).copy()]
    readers: dict[str, Callable[[Any], npt.NDArray[Any]]] = {
        "counts": lambda frames: frames.counts.numpy(),
        "light": lambda frames: frames.signal_w_cm2.numpy(),
        "truth": lambda frames: np.asarray(frames.truth["snr"]),
    }
    for (name, read), expected in zip(readers.items(), wanted, strict=True):
        frames = _light(renderer, 0, n)
        other = wp.ScopedStream(wp.Stream(where), sync_enter=False) if where.is_cuda else nullcontext()
        with ThreadPoolExecutor(1) as threads, other:
            expect(f"{name} on another stream", threads.submit(read, frames).result(LONGEST_S), expected)
    frames = _light(renderer, 0, n)
    expect("one frame", frames.counts[n - 1], wanted[0][n - 1])
    expect("some frames", frames.counts[n - 1 : 0 : -2, 0], wanted[0][n - 1 : 0 : -2, 0])
    return {"frames": n}


def dropped_unread(device: str, n: int) -> Row:
    """Calls whose frames nobody reads, and whose memory serves the next; renderers that go before they are done."""
    expected = counts_of(ws.Renderer(scene(), device), range(n))
    for _ in range(3):
        renderer = ws.Renderer(scene(), device)
        for size in (n, 1, n // 2, n):
            renderer.render(range(size), SENSORS, BANDS)
        frames = renderer.render(range(n), SENSORS, BANDS)
        del renderer
        expect("the last call", frames.counts.numpy(), expected)
    return {"frames": n}


def side_stream(device: str, n: int) -> Row:
    """PyTorch reads images late, on a stream of its own, lets go of them at once, and others are rendered meanwhile."""
    return _read_late(device, n, lambda torch, frames: torch.from_dlpack(frames.signal_w_cm2))


def array_interface(device: str, n: int) -> Row:
    """The same by the CUDA array interface, which the CPU does not have."""
    if not wp.get_device(device).is_cuda:
        return {"skipped": "needs CUDA"}
    return _read_late(device, n, lambda torch, frames: torch.as_tensor(frames.signal_w_cm2, device=device))


def _read_late(device: str, n: int, tensor_of: Callable[[Any, ws.FrameSet], Any]) -> Row:
    if lack := lack_of_torch(device):
        return lack
    import torch

    is_cuda = wp.get_device(device).is_cuda
    renderer = ws.Renderer(scene(), device)
    expected = [_light(renderer, first, n).signal_w_cm2.numpy().copy() for first in range(4)]
    side = torch.cuda.Stream(device) if is_cuda else None
    read = []
    for first in range(4):
        frames = _light(renderer, first, n)
        with torch.cuda.stream(side) if side is not None else torch.no_grad():
            tensor = tensor_of(torch, frames)
            if is_cuda:
                torch.cuda._sleep(20_000_000)
            read.append(tensor.clone())
        del frames, tensor
    if side is not None:
        side.synchronize()
    for first, (found, alone) in enumerate(zip(read, expected, strict=True)):
        expect(f"call {first}", found.cpu().numpy(), alone)
    return {"frames": n}


def _light(renderer: ws.Renderer, first: int, n: int) -> Any:
    return renderer.render(range(first, first + n), SENSORS, BANDS, keep_signal=True)


def default_stream(device: str, n: int) -> Row:
    """PyTorch works on its default stream in a thread while renderers are made and render."""
    if lack := lack_of_torch(device):
        return lack
    import torch

    ones, done, n_step = torch.ones(1000, device=device), threading.Event(), [0]

    def work() -> None:
        while not done.is_set():
            ones.add_(1.0)
            n_step[0] += 1

    expected = counts_of(ws.Renderer(scene(), device), range(n))
    with ThreadPoolExecutor(1) as pool:
        other = pool.submit(work)
        try:
            for size in (1, n // 2, n):
                expect(f"{size} frames", counts_of(ws.Renderer(scene(), device), range(size)), expected[:size])
        finally:
            done.set()
        other.result(LONGEST_S)
    expect("PyTorch's own sum", ones.cpu().numpy(), np.full(1000, 1.0 + n_step[0], dtype=np.float32))
    return {"frames": n, "steps": n_step[0]}


def _in_threads(works: Sequence[Callable[[], None]]) -> None:
    """Do all at a time; the first exception is raised, of a thread that is stuck, too."""
    with ThreadPoolExecutor(len(works)) as pool:
        for future in [pool.submit(work) for work in works]:
            future.result(LONGEST_S)


RACES: dict[str, Callable[[str, int], Row]] = {
    "stream with a reader": stream_with_a_reader,
    "two renderers in two threads": two_renderers,
    "one renderer in three threads": one_renderer,
    "the device twice in a list": devices_in_a_list,
    "alone against batch": alone_against_batch,
    "full against part passes": full_against_part,
    "readers on another current stream": other_current_stream,
    "frames that nobody reads": dropped_unread,
    "PyTorch on a side stream": side_stream,
    "PyTorch by the array interface": array_interface,
    "PyTorch on its default stream": default_stream,
}
"""By name; each takes a device and the frames of a call."""


def races(plan: Plan) -> Iterator[Row]:
    """Make all checks."""
    n = 12 if plan.quick else 300
    return rows_of((name, partial(check, plan.device, n)) for name, check in RACES.items())
