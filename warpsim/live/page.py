"""What keeps a page going: its server, its line of status, and the threads that bring it up to date."""

from __future__ import annotations

import contextlib
import html
import importlib.util
import io
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np

from warpsim.arguments import whole_number
from warpsim.errors import InputError, one_line
from warpsim.live.run_images import GrowingImages
from warpsim.live.shown_images import ShownImage

MOST_LOAD = 0.1
"""Part of a core that the page takes while it follows frames that somebody else renders."""

ImagesOfBand: TypeAlias = Callable[[str | None], list[ShownImage]]
"""Images of a frame by the band that the page shows."""

_LOOK_S = 0.5
"""Time from one look at the folder of a run to the next [s]."""


def open_server(port: int) -> tuple[Any, int]:
    """Return a server of viser's on this machine alone, and its port; 0 chooses a free one.

    Raises:
        InputError: viser (extra `live`) is not installed, no such port, or it is in use.
    """
    if importlib.util.find_spec("viser") is None:
        raise InputError("needs viser, which the extra `live` brings: pip install 'warpsim[live]'").of("view")
    import viser

    if whole_number("port", port, 0) > 65535:
        raise InputError("must be in 0 to 65535", "port", port)
    with socket.socket() as probe:  # whether the port is free, or which one is
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"cannot be taken: {os.strerror(error.errno or 0).lower()}", "port", port) from None
        port = int(probe.getsockname()[1])
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a frame about its address
        return viser.ViserServer(host="127.0.0.1", port=port, label="warpsim", verbose=False), port


class Status:
    """How the page keeps up, and what was wrong with what it was asked for."""

    def __init__(self) -> None:
        self.notes = dict.fromkeys(("progress", "source", "sensors", "scene", "frame"), "")
        """Progress of a run that is still being rendered; problems, by what they are of."""
        self.n_dropped = 0
        self.n_shown = 0
        """Frames that were sent to the page."""
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
        notes = [
            f'<div style="color:{"inherit" if of == "progress" else "#ff6b4a"}">{html.escape(note)}</div>'
            for of, note in self.notes.items()
            if note
        ]
        return (
            '<div class="status" style="padding:0 10px;font:12px sans-serif">'
            f"frame {frame}, {time_s:g} s, {date} UTC<br>"
            f"{rate}sent within {p50_ms:.0f} ms (99 %: {p99_ms:.0f} ms), {self.n_dropped} dropped"
            f"{''.join(notes)}</div>"
        )


class _Page(Protocol):
    """What frames are shown on: the number of the one that shows, all their numbers, and how it keeps up."""

    frame: int
    frames: list[int]
    sensors: list[str]
    status: Status

    def note(self, of: str, note: str) -> None:
        """Show how much of a run is there, or what is wrong with where images come from."""

    def grow(self, newest: int | None, before: int) -> None:
        """Take the frames that are there by now."""


class Player:
    """A thread that shows frames on a page, one after the other.

    Args:
        page: What the frames are shown on; its number of the shown frame is read and, while playing, moved on.
        show: Shows a frame, or images of it that were offered; raises nothing.
        frames_per_s: How fast the page plays [frames/s].
    """

    def __init__(
        self, page: _Page, show: Callable[[int, ImagesOfBand | None], None], frames_per_s: Callable[[], float]
    ) -> None:
        self._page, self._show, self._frames_per_s = page, show, frames_per_s
        self.wanted = page.frame
        """Number of the frame to show."""
        self.playing = False
        """Whether the next frames are shown by themselves."""
        self._again = False
        self._offered: tuple[int, ImagesOfBand] | None = None
        self._work, self._stop = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._keep_up, name="warpsim view", daemon=True)

    def start(self) -> None:
        """Begin to keep the page up to date."""
        self.wanted = self._page.frame
        self._thread.start()

    def stop(self) -> None:
        """End the thread; returns when it has ended."""
        self._stop.set()
        self.wake()
        self._thread.join()

    def wait(self) -> None:
        """Return when the thread is told to stop."""
        while not self._stop.wait(0.5):
            pass

    def wake(self) -> None:
        """Let the thread look at once for what there is to do."""
        self._work.set()

    def ask(self, frame: int) -> None:
        """Let the thread show a frame."""
        self.wanted = frame
        self.wake()

    def ask_again(self) -> None:
        """Let the thread show the same frame once more."""
        self._again = True
        self.wake()

    def offer(self, frame: int, images: ImagesOfBand) -> None:
        """Let the thread show images of a frame when it has time, instead of those offered before."""
        self._page.status.n_dropped += self._offered is not None
        self._offered = frame, images
        self.wake()

    def _keep_up(self) -> None:
        """Show what is asked for, and the next frames while playing, until the page is closed."""
        begin_s, begin, was_playing, page = 0.0, 0, False, self._page
        while not self._stop.is_set():
            playing = self.playing  # which others may begin at any time
            offered, self._offered = self._offered, None
            if offered is not None:
                self.wanted = offered[0]
                self._show(*offered)
                latency_s = page.status.latency_s
                self._stop.wait(latency_s[-1] * (1 / MOST_LOAD - 1) if latency_s else 0.1)
            elif playing:
                now_s = time.perf_counter()
                if not was_playing or self.wanted != page.frame:  # at first, and where the slider was moved
                    begin_s, begin = now_s, self.wanted
                self._play_on(min(begin + int((now_s - begin_s) * self._frames_per_s()), page.frames[-1]))
            elif self.wanted != page.frame or self._again:
                self._again, wanted = False, self.wanted
                self._show(wanted, None)
                if self.wanted == wanted:
                    self.wanted = page.frame  # another one if that failed
            else:
                self._work.wait(0.2)
                self._work.clear()
            was_playing = playing

    def _play_on(self, frame: int) -> None:
        """Show a frame while playing; one that fails is left behind."""
        page = self._page
        if frame != page.frame:
            page.status.n_dropped += max(frame - page.frame - 1, 0)
            self.wanted = frame
            self._show(frame, None)
            page.frame = frame
        else:
            self._stop.wait(0.005)
        self.playing = self.playing and frame < page.frames[-1]


class Watch:
    """A thread that lets a page grow with a run, until that is done.

    Args:
        page: The page, which shows the newest frame as long as nobody moves it elsewhere.
        images: What the page shows.
    """

    def __init__(self, page: _Page, images: GrowingImages) -> None:
        self._page, self._images, self._stop = page, images, threading.Event()
        self._before, self._n_there = page.frame, -1
        self._thread = threading.Thread(target=self._watch, name="warpsim view watches", daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        is_done, problem = False, ""
        while not is_done:
            before, problem = problem, ""
            try:
                is_done = self._look()
            except Exception as error:  # a folder that is gone, or holds another run
                problem = one_line(error)
            if problem != before:
                self._page.note("source", problem)
            if self._stop.wait(_LOOK_S):
                return

    def _look(self) -> bool:
        """Show on the page what is there; return whether that is all."""
        images, page = self._images, self._page
        is_done = images.is_finished
        n_there = images.n_image_there
        if n_there != self._n_there:
            newest = images.newest(page.sensors)
            page.grow(newest, self._before)
            self._before = self._before if newest is None else newest
            self._n_there = n_there
        progress = f"{n_there} of {images.n_image} images are there"
        page.note("progress", f"the run is done, {progress}" if is_done else progress)
        return is_done

    def close(self) -> None:
        """End the thread; returns when it has ended."""
        self._stop.set()
        self._thread.join()
