"""Kernel launches over views, structs of their arguments, and copies to the host, on streams that are named."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from warpsim.pool import pinned_pool

if wp.config.log_level == wp.LOG_INFO:  # Warp's own default: its banner, and a line for each module it loads
    wp.config.log_level = wp.LOG_WARNING

THREADS_PER_BLOCK_CUDA = 64
"""Threads of a block, unless a launch says otherwise: the few threads of some stages are spread over many
multiprocessors, and as many blocks as one of those holds, 32, still are all of its 2,048 threads."""


class Launch:
    """A kernel launch with its arguments; preparing it costs some 20 us of Python, making it 5.

    Args:
        kernel: What is launched.
        dim: Threads along each axis, or tiles of a tiled launch; the first axis is that of views, or a multiple.
        inputs: Arguments that are read.
        outputs: Arguments that are written.
        device: Where it runs.
        block_dim: Threads of a tile, of a tiled launch; an ordinary one when left out.
    """

    def __init__(
        self,
        kernel: wp.Kernel,
        dim: Sequence[int],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        device: wp.Device,
        block_dim: int | None = None,
    ) -> None:
        self.kernel = kernel
        self.block_dim = THREADS_PER_BLOCK_CUDA if block_dim is None and device.is_cuda else block_dim
        """Threads of a block; the CPU has none in ordinary launches."""
        self._dim: tuple[int, ...] = (*dim, *([] if block_dim is None else [block_dim]))
        self._set_dim = self._dim
        self._n_input = len(inputs)
        self.outputs = list(outputs)
        given: dict[str, Any] = {"dim": list(dim), "inputs": inputs, "outputs": outputs, "device": device}
        launch = wp.launch if block_dim is None else wp.launch_tiled
        self._command = launch(kernel, **given, block_dim=self.block_dim, record_cmd=True)

    def set_output(self, number: int, array: wp.array) -> None:
        """Replace one of the outputs by another array."""
        if self._command is not None:
            self._command.set_param_at_index(self._n_input + number, array)
            self.outputs[number] = array

    def run(self, part: int = 1, whole: int = 1, stream: wp.Stream | None = None) -> None:
        """Launch for the first `part` of `whole` views of the first axis; on CUDA on a stream, or the current one."""
        if self._command is None:  # of no threads
            return
        dim = (self._dim[0] // whole * part, *self._dim[1:])
        if dim != self._set_dim:
            self._set_dim = ()  # an interrupt may come before it is noted
            self._command.set_dim(dim)
            self._set_dim = dim
        self._command.launch(stream=stream)


class Stage:
    """The launches of one step of a frame, in order, over arrays of n_view views."""

    def __init__(self, name: str, n_view: int, launches: Sequence[Launch]) -> None:
        self.name, self.n_view, self.launches = name, n_view, tuple(launches)

    def run(self, n_view: int | None = None, stream: wp.Stream | None = None) -> None:
        """Make all launches for the first n_view views, all when left out."""
        for launch in self.launches:
            launch.run(self.n_view if n_view is None else n_view, self.n_view, stream)


def struct_of(kind: Any, device: Any = None, /, **fields: Any) -> Any:
    """Return a kernels' struct with some of its fields set; values of fields that are arrays are put on a device."""
    struct = kind()
    for name, value in fields.items():
        wanted = kind.vars[name].type
        if hasattr(wanted, "ndim") and not isinstance(value, wp.array):
            value = np.ascontiguousarray(value) if isinstance(value, np.ndarray) else value
            value = wp.array(value, dtype=wanted.dtype, device=device)
        setattr(struct, name, value)
    return struct


PINNED_FROM_BYTES = 2**22
"""Smaller arrays are copied to ordinary memory: pinned memory costs more to make than they take."""


def to_numpy(array: wp.array) -> npt.NDArray[Any]:
    """Return an array on the host: a view on the CPU; from CUDA a copy, in the order of the device's current stream.

    Warp's own `numpy` changes the current stream of the whole process while it copies.
    """
    if not array.device.is_cuda:
        return np.asarray(array.numpy())
    if array.size * wp.types.type_size_in_bytes(array.dtype) >= PINNED_FROM_BYTES:
        host = pinned_pool().new(array.shape, array.dtype)
    else:
        host = wp.empty(array.shape, dtype=array.dtype, device="cpu")
    stream = wp.get_stream(array.device)
    wp.copy(host, array, stream=stream)
    wp.synchronize_stream(stream)
    return np.asarray(host.numpy())


def record_event(stream: wp.Stream) -> wp.Event:
    """Record an event in a stream.

    Warp leaves it to its caller that the stream's context is the thread's, which it is not in a new thread: nothing
    would be recorded then, and who waits for the event would not wait.
    """
    with stream.device.context_guard:
        return stream.record_event()


def wait_on_current_stream(ready: wp.Event | None, device: wp.Device) -> None:
    """Have what is asked of a device's current stream from now on come after an event; without one do nothing.

    The current stream may be another one with each call: somebody may have set it since the event was recorded.
    """
    if ready is not None:
        wp.get_stream(device).wait_event(ready)


def host_arrays(arrays: Iterable[wp.array]) -> list[wp.array]:
    """Return arrays in host memory that are like others: pinned for those of GPUs, themselves on the CPU."""
    return [
        wp.empty(array.shape, dtype=array.dtype, device="cpu", pinned=True) if array.device.is_cuda else array
        for array in arrays
    ]
