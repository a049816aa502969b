"""Kernels are compiled ahead, side by side, while the host prepares what they read.

Left alone, Warp compiles the module of a kernel at its first launch, one after the other. Its compilers do not hold
Python's lock, so threads can do that meanwhile, and what is not loaded ahead is still loaded at its launch.

On CUDA a module is compiled for the threads of a block that its launches have, and one that has launches of several
sizes once for each. That threads may do it side by side follows from Warp's source: `Module.load` makes source code
under a lock and compiles without one, in a folder of each thread's own; NVRTC lets threads compile at a time (they take
turns with the source code, not with the machine code, which takes longer); the binary is loaded into the device's
context, whatever the thread's own current one is, and `load_module` leaves that one as it was. Only the CPU's compiler
has headers to translate first: NVRTC keeps its own.
"""

from __future__ import annotations

import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import warp as wp

from warpsim.launches import THREADS_PER_BLOCK_CUDA
from warpsim.render.device import n_usable_cpu

MOST_THREADS = 4
"""More do not help with the handful of modules that a frame has."""


class KernelLoading:
    """Modules of a device on their way; `start` and `wait` may be called from any thread.

    Args:
        device: Where kernels are to run.
    """

    def __init__(self, device: wp.Device) -> None:
        self._device = device
        self._loads: dict[tuple[Any, int | None], Future[None]] = {}  # by module and threads of a block
        self._first: Future[None] | None = None
        self._compiler: int | None = None
        self._pool: ThreadPoolExecutor | None = None
        self._lock = threading.Lock()

    def start(self, *kernels: wp.Kernel, block_dim: int = THREADS_PER_BLOCK_CUDA) -> None:
        """Begin to compile and load the modules of kernels; those begun before are left alone.

        Args:
            kernels: The kernels.
            block_dim: Threads of a block of their launches on CUDA; the CPU has none.
        """
        size = block_dim if self._device.is_cuda else None
        with self._lock:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(min(n_usable_cpu(), MOST_THREADS), thread_name_prefix="warpsim-compile")
            for kernel in kernels:
                module = kernel.module
                if (module, size) not in self._loads:
                    begun = self._pool.submit(self._load, module, size, self._first)
                    self._loads[module, size] = begun
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
