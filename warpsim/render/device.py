"""Choice of the device, and the division of work for it."""

from __future__ import annotations

import os
from typing import Any

import warp as wp

from warpsim.errors import InputError

ROWS_PER_BLOCK_CUDA = 4


def default_device(device: Any = None) -> wp.Device:
    """The device asked for; CUDA where present, else the CPU, when None.

    Raises:
        InputError: No such device.
    """
    if device is None:
        device = "cuda:0" if wp.is_cuda_available() else "cpu"
    try:
        return wp.get_device(device)
    except Exception:
        known = ", ".join(str(item) for item in wp.get_devices())
        raise InputError(f"must be one of {known}", "device", device) from None


def chosen_devices(device: Any = None) -> list[wp.Device]:
    """The devices of a list, or the one of `default_device`.

    Raises:
        InputError: No such device, none at all, or CPUs and GPUs, which round differently, at once.
    """
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

    Raises:
        InputError: Not a whole number >= 1.
    """
    if n_thread is not None and (isinstance(n_thread, bool) or not isinstance(n_thread, int) or n_thread < 1):
        raise InputError("must be a whole number >= 1", "n_thread", n_thread)
    return 1 if device.is_cuda or wp.config.mode == "debug" else n_thread or n_usable_cpu()


def rows_per_block(device: wp.Device, n_row: int) -> int:
    """Image rows that one deposit thread owns: all on the CPU, where a launch is one thread; few on CUDA."""
    return ROWS_PER_BLOCK_CUDA if device.is_cuda else n_row
