"""The page's server, and its line of status."""

from __future__ import annotations

import contextlib
import html
import importlib.util
import io
import os
import socket
import time
from collections import deque
from typing import Any

import numpy as np

from warpsim.arguments import whole_number
from warpsim.errors import InputError


def open_server(port: int) -> tuple[Any, int]:
    """Return a server of viser's on this machine alone, and its port; 0 chooses a free one.

    Raises:
        InputError: viser (extra `live`) is not installed, no such port, or it is in use.
    """
    if importlib.util.find_spec("viser") is None:
        raise InputError("needs viser, which the extra `live` brings: pip install 'warpsim[live]'").of("view")
    import viser

    port = _free_port(whole_number("port", port, 0))
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a frame about its address
        return viser.ViserServer(host="127.0.0.1", port=port, label="warpsim", verbose=False), port


def _free_port(port: int) -> int:
    """Return the port if it is free, another free one for 0."""
    if port > 65535:
        raise InputError("must be in 0 to 65535", "port", port)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"cannot be taken: {os.strerror(error.errno or 0).lower()}", "port", port) from None
        return int(probe.getsockname()[1])


class Status:
    """How the page keeps up, and what was wrong with what it was asked for."""

    def __init__(self) -> None:
        self.problems: dict[str, str] = {}
        """By what they are of: sensors, the scene, a frame."""
        self.n_dropped = 0
        self.n_shown = 0
        """Frames that were sent to the page."""
        self.note = ""
        """Of the source of images: that a server sends nothing, say."""
        self.progress = ""
        """How much is there of a run that is still being rendered."""
        self.latency_s: deque[float] = deque(maxlen=200)
        self._shown_at: deque[float] = deque(maxlen=60)

    def shown(self, begin_s: float) -> None:
        """Note that a frame was sent that was begun at a time of the performance counter."""
        self.n_shown += 1
        self._shown_at.append(time.perf_counter())
        self.latency_s.append(self._shown_at[-1] - begin_s)

    def html(self, frame: int, time_s: float, date: str) -> str:
        """Return the status as a part of the page."""
        p50_ms, p99_ms = 1e3 * np.percentile(self.latency_s or [0.0], [50, 99])
        since_s = self._shown_at[-1] - self._shown_at[0] if self._shown_at else 0.0
        rate = f"{(len(self._shown_at) - 1) / since_s:.1f} frames/s, " if since_s > 0 else ""
        lines = filter(None, [self.note, *self.problems.values()])
        problems = "".join(f'<div style="color:#ff6b4a">{html.escape(line)}</div>' for line in lines)
        progress = f"<br>{html.escape(self.progress)}" if self.progress else ""
        return (
            '<div class="status" style="padding:0 10px;font:12px sans-serif">'
            f"frame {frame}, {time_s:g} s, {date} UTC<br>"
            f"{rate}sent within {p50_ms:.0f} ms (99 %: {p99_ms:.0f} ms), {self.n_dropped} dropped"
            f"{progress}{problems}</div>"
        )
