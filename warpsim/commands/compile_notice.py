"""Notice at a terminal, or in a log, while kernels are compiled."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from concurrent.futures import Future

AFTER_S = 1.0
"""Compilations that are over sooner are not reported."""

CACHED_S = 0.3
"""Modules that are loaded sooner were compiled before: they take milliseconds, compilations a second and more."""

_BAR = 20
_CLEAR = "\r\x1b[K"


class CompileNotice:
    """A line on standard error while modules of kernels are compiled; `add` is what `when_loading` takes.

    On a terminal it has a bar of the modules that are done, of those to compile, and is erased at the end; elsewhere it
    is one plain line, once. Nothing is said where all are loaded from the cache, or compiled within AFTER_S.

    Args:
        folder: Where compiled modules are kept; it stands in the line.
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._n_to_compile = self._n_compiled = self._n_loading = 0
        self._timer: threading.Timer | None = None
        self._showing = self._said = False

    def add(self, load: Future[None]) -> None:
        """Count a module that is on its way."""
        begin_s = time.monotonic()
        with self._lock:
            self._n_to_compile += 1
            self._n_loading += 1
            if self._n_loading == 1:
                self._timer = threading.Timer(AFTER_S, self._show)
                self._timer.daemon = True
                self._timer.start()
            self._draw()
        load.add_done_callback(lambda _: self._end(begin_s))

    def _end(self, begin_s: float) -> None:
        """Count a module as compiled, or as one that was not to be; called before `KernelLoading.wait` returns."""
        with self._lock:
            self._n_loading -= 1
            if time.monotonic() - begin_s < CACHED_S:
                self._n_to_compile -= 1
            else:
                self._n_compiled += 1
            self._draw()
            if self._n_loading == 0:
                if self._timer is not None:
                    self._timer.cancel()
                if self._showing and sys.stderr.isatty():
                    print(_CLEAR, end="", file=sys.stderr, flush=True)
                self._showing = False

    def _show(self) -> None:
        with self._lock:
            self._showing = self._n_loading > 0
            self._draw()

    def _draw(self) -> None:
        """Bring the line up to date, if it is shown."""
        if not self._showing:
            return
        where = f"once; they are kept in {self._folder}"
        if sys.stderr.isatty():
            bar = "#" * (_BAR * self._n_compiled // max(self._n_to_compile, 1))
            line = f"compiling kernels  [{bar:{_BAR}}] {self._n_compiled}/{self._n_to_compile}, {where}"
            n_column = shutil.get_terminal_size().columns
            print(f"{_CLEAR}{line[: n_column - 1]}", end="", file=sys.stderr, flush=True)
        elif not self._said:
            self._said = True
            print(f"compiling kernels, {where}", file=sys.stderr, flush=True)
