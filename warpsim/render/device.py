"""Devices: their choice, the division of work among them, and the compilation of kernels ahead of their launches.

Left alone, Warp compiles the module of a kernel at its first launch, one after the other. Its compilers do not hold
Python's lock, so threads can do that while the host prepares what kernels read; what is not loaded ahead is still
loaded at its launch.

On CUDA a module is compiled for the threads of a block that its launches have, and one that has launches of several
sizes once for each. That threads may do it side by side follows from Warp's source: `Module.load` makes source code
under a lock and compiles without one, in a folder of each thread's own; NVRTC lets threads compile at a time (they take
turns with the source code, not with the machine code, which takes longer); the binary is loaded into the device's
context, whatever the thread's own current one is, and `load_module` leaves that one as it was. Only the CPU's compiler
has headers to translate first: NVRTC keeps its own.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import warp as wp

from warpsim.errors import InputError
from warpsim.launches import THREADS_PER_BLOCK_CUDA

ROWS_PER_BLOCK_CUDA = 8
"""Rows that a deposit thread owns on CUDA where there are many: each thread looks at all sources."""

ENOUGH_THREADS_CUDA = 2**15
"""Threads of a deposit from which on they may own several rows."""


def default_device(device: Any = None) -> wp.Device:
    """The device asked for; CUDA where present, else the CPU, when None."""
    if device is None:
        device = "cuda:0" if wp.is_cuda_available() else "cpu"
    if str(device).startswith("cuda") and not wp.is_cuda_available():
        raise InputError("must be cpu, as no CUDA device was found: is there a GPU, and its driver?", "device", device)
    try:
        return wp.get_device(device)
    except Exception:
        known = ", ".join(str(item) for item in wp.get_devices())
        raise InputError(f"must be one of {known}", "device", device) from None


def chosen_devices(device: Any = None) -> list[wp.Device]:
    """The devices of a list, or the one of `default_device`."""
    if not isinstance(device, list | tuple):
        return [default_device(device)]
    devices = [default_device(item) for item in device]
    if len({item.is_cuda for item in devices}) != 1:
        raise InputError("a list must name CUDA devices only, or the CPU only", "device", device)
    return devices


def n_usable_cpu() -> int:
    """Processor cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def worker_count(device: wp.Device, n_thread: int | None) -> int:
    """CPU threads that launch on a device: as many as asked for, all cores for None, one where only one can.

    CUDA has one launch queue; and two CPU launches at once crash Warp's debug mode.
    """
    if n_thread is not None and (isinstance(n_thread, bool) or not isinstance(n_thread, int) or n_thread < 1):
        raise InputError("must be a whole number >= 1", "n_thread", n_thread)
    return 1 if device.is_cuda or wp.config.mode == "debug" else n_thread or n_usable_cpu()


def rows_per_block(device: wp.Device, n_row: int, n_image: int) -> int:
    """Image rows that one deposit thread owns: all on the CPU, where a launch is one thread; few on CUDA."""
    if not device.is_cuda:
        return n_row
    return min(max(n_image * n_row // ENOUGH_THREADS_CUDA, 1), ROWS_PER_BLOCK_CUDA)


_WATCHERS: list[Callable[[Future[None]], None]] = []


def when_loading(watch: Callable[[Future[None]], None]) -> None:
    """Let a function know of each module that `KernelLoading` begins to load, from now on: it is called with a future.

    Callbacks of that future are called before `KernelLoading.wait` returns.
    """
    _WATCHERS.append(watch)


MOST_THREADS = 4
"""More do not help with the handful of modules that a frame has."""


class KernelLoading:
    """Modules of a device on their way; `start` and `wait` may be called from any thread."""

    def __init__(self, device: wp.Device) -> None:
        self._device = device
        self._loads: dict[tuple[Any, int | None], Future[None]] = {}  # by module and threads of a block
        self._first: Future[None] | None = None
        self._compiler: int | None = None
        self._pool: ThreadPoolExecutor | None = None
        self._lock = threading.Lock()

    def start(self, *kernels: wp.Kernel, block_dim: int = THREADS_PER_BLOCK_CUDA) -> None:
        """Begin to compile and load the modules of kernels; those begun before are left alone."""
        size = block_dim if self._device.is_cuda else None
        with self._lock:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(min(n_usable_cpu(), MOST_THREADS), thread_name_prefix="warpsim-compile")
            for kernel in kernels:
                module = kernel.module
                if (module, size) not in self._loads:
                    begun = self._pool.submit(self._load, module, size, self._first)
                    self._loads[module, size] = begun
                    for watch in _WATCHERS:
                        watch(begun)
                    if not self._device.is_cuda:
                        self._first = self._first or begun

    def share_headers(self) -> None:
        """Let what this thread compiles from now on use Warp's headers as they were translated for the first module.

        On CUDA there is nothing to do.
        """
        if self._first is not None:
            self._first.exception()  # waits
            _use_headers_of(self._compiler)

    def wait(self) -> None:
        """Return when all that was begun is loaded; a launch before would compile the same module once more.

        What could not be compiled says so at its launch.
        """
        with self._lock:
            pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown()
        self.share_headers()  # for what is compiled at its launch

    def _load(self, module: Any, block_dim: int | None, first: Future[None] | None) -> None:
        if first is None:
            self._compiler = threading.get_ident()
        else:
            self.share_headers()
        wp.load_module(module, self._device, block_dim=block_dim)


_OF_DEVICE: dict[str, KernelLoading] = {}


def kernel_loading(device: wp.Device) -> KernelLoading:
    """Return the loader of kernels for a device; one for all renderers, as modules belong to the process."""
    return _OF_DEVICE.setdefault(str(device), KernelLoading(device))


def _use_headers_of(compiler: int | None) -> None:
    """Let this thread compile with the headers that another thread has translated, if it has.

    Translating Warp's headers takes as long as compiling five kernels. Warp does it once for each thread, into a folder
    of the thread's own, as two that write one file could disturb each other; here the file is complete. Where Warp
    keeps its folders otherwise, each thread translates for itself.
    """
    runtime = getattr(sys.modules.get("warp._src.context"), "runtime", None)
    folders = getattr(runtime, "_pch_dirs", {})
    shared = folders.get(compiler)
    if shared is not None and any(Path(shared.name).glob("*.pch")):
        folders.setdefault(threading.get_ident(), shared)
