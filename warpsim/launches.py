"""Kernel launches that are made at once, or recorded once and made many times.

Packing the arguments of a launch costs Warp 20 us of Python, and 5 when it is recorded: it then copies them into one
structure each time, 20 us where other work has emptied the caches. Here that structure is made once, which leaves 2.
Warp's CPU graphs are as quick, but the capture is one for the process: launches of other threads would fall into it.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import warp as wp

PACKED_BY_WARP = "1.19."
"""Versions of Warp whose CPU kernels are called as `_PackedLaunch` does it; with others Warp makes the launches."""

_thread = threading.local()  # .recording: the Launches that this thread records, if any


def launch(kernel: wp.Kernel, dim: Any, inputs: Sequence[Any], outputs: Sequence[Any], device: Any) -> None:
    """Launch a kernel, like `wp.launch`; where the thread is recording, add the launch to the recording instead."""
    recording = _recording()
    made = wp.launch(kernel, dim, inputs, outputs, device=device, record_cmd=recording is not None)
    if recording is not None:
        recording.add(made, (dim,) if isinstance(dim, int) else tuple(dim))


def launch_tiled(
    kernel: wp.Kernel, dim: Sequence[int], inputs: Sequence[Any], outputs: Sequence[Any], block_dim: int, device: Any
) -> None:
    """The same like `wp.launch_tiled`."""
    recording = _recording()
    made = wp.launch_tiled(
        kernel,
        dim=dim,
        inputs=inputs,
        outputs=outputs,
        block_dim=block_dim,
        device=device,
        record_cmd=recording is not None,
    )
    if recording is not None:
        recording.add(made, (*dim, block_dim))


def clear(array: wp.array) -> None:
    """Set an array to zero, or record that."""
    recording = _recording()
    if recording is None:
        array.zero_()
    else:
        recording.add_clear(array)


def call(function: Callable[[int], None]) -> None:
    """Have a function called with the number of views, in its turn, whenever the recording is made: for measuring."""
    recording = _recording()
    if recording is None:
        raise RuntimeError("call: only for what is recorded")
    recording.add_call(function)


@contextmanager
def recorded(n_view: int) -> Iterator[Launches]:
    """Record what the thread launches, for arrays of n_view views, instead of making it."""
    _thread.recording = launches = Launches(n_view)
    try:
        yield launches
    finally:
        _thread.recording = None


def _recording() -> Launches | None:
    return getattr(_thread, "recording", None)


class _Clear:
    """An array to be set to zero, with the manners of a recorded launch."""

    arguments: Sequence[Any] = ()

    def __init__(self, array: wp.array) -> None:
        self._part = self._array = array

    def set_dim(self, dim: Sequence[int]) -> None:
        self._part = self._array[: dim[0]]

    def launch(self) -> None:
        self._part.zero_()


class _Call:
    """A function of the number of views, with the manners of a recorded launch."""

    arguments: Sequence[Any] = ()

    def __init__(self, function: Callable[[int], None], n_view: int) -> None:
        self._function, self._n_view = function, n_view

    def set_dim(self, dim: Sequence[int]) -> None:
        self._n_view = dim[0]

    def launch(self) -> None:
        self._function(self._n_view)


class _Launch:
    """A launch as Warp records it."""

    def __init__(self, launch: wp.Launch) -> None:
        self._recorded = launch

    @property
    def arguments(self) -> Sequence[Any]:
        """The kernel's arguments, as ctypes."""
        return list(self._recorded.params[1:])  # behind the bounds

    def set_dim(self, dim: Sequence[int]) -> None:
        self._recorded.set_dim(dim)

    def launch(self) -> None:
        self._recorded.launch()


class _PackedLaunch(_Launch):
    """A launch on the CPU with its arguments in one structure."""

    def __init__(self, launch: wp.Launch) -> None:
        super().__init__(launch)
        self._names = [argument.label for argument in launch.kernel.adj.args]
        values = launch.params[1:]
        fields = [(name, type(value)) for name, value in zip(self._names, values, strict=True)]
        self._structure = type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*values)
        self._pointers = self._both()

    def _both(self) -> tuple[Any, Any]:
        return ctypes.byref(self._recorded.params[0]), ctypes.byref(self._structure)

    @property
    def arguments(self) -> Sequence[Any]:
        """The kernel's arguments, parts of the structure."""
        return [getattr(self._structure, name) for name in self._names]

    def set_dim(self, dim: Sequence[int]) -> None:
        super().set_dim(dim)
        self._pointers = self._both()

    def launch(self) -> None:
        self._recorded.hooks.forward(*self._pointers)


class _Entry:
    """A recorded launch for the views first to end."""

    def __init__(self, launch: Any, dim: tuple[int, ...], first: int, end: int) -> None:
        self.launch = launch
        self.wanted = True
        """Whether any of its views is."""
        self._dim, self._first, self._n_view = dim, first, end - first
        self._n_set = self._n_view

    def set_views(self, n_view: int) -> None:
        """Leave out what is behind the first n_view views."""
        n_view = min(max(n_view - self._first, 0), self._n_view)
        if n_view == self._n_set:
            return
        self._n_set = -1  # until it is done: an interrupt may come at any place
        self.wanted = n_view > 0
        if self.wanted:
            self.launch.set_dim((self._dim[0] // self._n_view * n_view, *self._dim[1:]))
        self._n_set = n_view


class Launches:
    """Recorded launches over views; made in order, for as many views as wanted up to those recorded.

    The first axis of every launch must be as long as there are views, or a multiple of it.

    Args:
        n_view: Views that the arrays hold.
    """

    def __init__(self, n_view: int) -> None:
        self.n_view = n_view
        self._launches: list[_Entry] = []
        self._part = (0, n_view)
        self._n_set = n_view
        self._graph: wp.Graph | None = None
        self._n_in_graph = 0

    @contextmanager
    def part(self, first: int, end: int) -> Iterator[None]:
        """Record what is for the views first to end only."""
        self._part = (first, end)
        try:
            yield
        finally:
            self._part = (0, self.n_view)

    def add(self, launch: wp.Launch | None, dim: tuple[int, ...]) -> None:
        """Append a recorded launch of full size; None, where nothing is to be launched."""
        if launch is not None:
            packed = launch.device.is_cpu and launch.block_dim == 1 and wp.config.version.startswith(PACKED_BY_WARP)
            self._append((_PackedLaunch if packed else _Launch)(launch), dim)

    def add_clear(self, array: wp.array) -> None:
        """Append setting an array to zero."""
        self._append(_Clear(array), array.shape)

    def add_call(self, function: Callable[[int], None]) -> None:
        """Append a call; what is behind it is in no graph."""
        n_view = self._part[1] - self._part[0]
        self._append(_Call(function, n_view), (n_view,))

    def _append(self, launch: Any, dim: tuple[int, ...]) -> None:
        self._launches.append(_Entry(launch, dim, *self._part))

    def arguments_within(self, array: wp.array) -> list[tuple[Any, int]]:
        """Arguments of the launches that lie in this array, and where in it [bytes]; setting `.data` moves them."""
        found = [
            (argument, argument.data - array.ptr)
            for entry in self._launches
            for argument in entry.launch.arguments
            if getattr(argument, "data", None) is not None
        ]
        return [(argument, place) for argument, place in found if 0 <= place < array.capacity]

    def capture(self, device: wp.Device, moving: Sequence[Any] = ()) -> None:
        """On CUDA, make one graph of the launches before the first that has one of the moving arguments."""
        self._n_in_graph = next(
            (
                number
                for number, entry in enumerate(self._launches)
                if isinstance(entry.launch, _Call)
                or any(argument is moved for moved in moving for argument in entry.launch.arguments)
            ),
            len(self._launches),
        )
        if self._n_in_graph == 0:
            return
        with wp.ScopedCapture(device) as capture:
            for entry in self._launches[: self._n_in_graph]:
                entry.launch.launch()
        self._graph = capture.graph

    def run(self, n_view: int) -> None:
        """Make all launches for the first n_view views."""
        if n_view != self._n_set:
            self._n_set = -1
            for entry in self._launches:
                entry.set_views(n_view)
            self._n_set = n_view
        done = 0
        if self._graph is not None and n_view == self.n_view:  # a graph keeps the size that it was captured with
            wp.capture_launch(self._graph)
            done = self._n_in_graph
        for entry in self._launches[done:]:
            if entry.wanted:
                entry.launch.launch()
