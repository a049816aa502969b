"""The thread that keeps the page up to date: what it was asked for, what it was offered, and the next frames."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol, TypeAlias

from warpsim.live.page import Status
from warpsim.live.shown_images import ShownImage

MOST_LOAD = 0.1
"""Part of a core that the page takes while it follows frames that somebody else renders."""

ImagesOfBand: TypeAlias = Callable[[str | None], list[ShownImage]]
"""Images of a frame by the band that the page shows."""


class _Page(Protocol):
    """What frames are shown on: the number of the one that shows, all their numbers, and how it keeps up."""

    frame: int
    frames: list[int]
    status: Status


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

    @property
    def is_alive(self) -> bool:
        """Whether the page is kept up to date."""
        return self._thread.is_alive()

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
