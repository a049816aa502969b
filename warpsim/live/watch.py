"""A page that grows with a run while another process renders it."""

from __future__ import annotations

import threading
from typing import Protocol

from warpsim.errors import one_line
from warpsim.live.growing_run import GrowingImages

_LOOK_S = 0.5
"""Time from one look at the folder to the next [s]."""


class _Page(Protocol):
    """What grows with a run."""

    frame: int
    sensors: list[str]

    def note_of_source(self, note: str) -> None:
        """Show what is wrong with where images come from."""

    def tell_progress(self, progress: str) -> None:
        """Show how much of the run is there."""

    def grow(self, newest: int | None, before: int) -> None:
        """Take the frames that are there by now."""


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
                self._page.note_of_source(problem)
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
        page.tell_progress(f"the run is done, {progress}" if is_done else progress)
        return is_done

    def close(self) -> None:
        """End the thread; returns when it has ended."""
        self._stop.set()
        self._thread.join()
