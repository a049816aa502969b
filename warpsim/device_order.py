"""Order on a GPU between the work of several libraries: what comes after all that was asked of it."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

import warp as wp

_DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"


def come_after_all(device: wp.Device) -> None:
    """Have a GPU's work from now on come after all that was asked of it before, by anyone and in any stream.

    From now on means: in blocking streams, such as Warp's, PyTorch's default stream, and the one in which memory is
    freed; they come after the null stream, which is made to wait here. It does not come after the others' non-blocking
    streams by itself, so it waits for an event of the whole device. The host waits only where the driver has no such
    events (before CUDA 12.5), or refuses one.

    Raises:
        RuntimeError: A graph is captured.
    """
    record, event = _record_of_context(), wp.Event(device)
    if record is None or device.is_capturing or record(device.context, event.cuda_event) != 0:
        wp.synchronize_device(device)
    else:
        device.null_stream.wait_event(event)


@cache
def _record_of_context() -> Callable[[Any, Any], int] | None:
    """Return the driver's cuCtxRecordEvent(context, event), 0 if it went well; None where the driver has none."""
    try:
        record = ctypes.CDLL(_DRIVER).cuCtxRecordEvent
    except (OSError, AttributeError):
        return None
    record.argtypes, record.restype = (ctypes.c_void_p, ctypes.c_void_p), ctypes.c_int
    return record
