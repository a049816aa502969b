"""Words and progress bars for people at a terminal."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

LINE_EVERY_S = 30.0
"""Least time between lines of progress."""


@contextlib.contextmanager
def progress_bar(total: int, requested: bool, noun: str) -> Iterator[Callable[[int], None]]:
    """Yield a function that advances a bar on standard error by some steps; it does nothing if no bar is requested.

    Where standard error is no terminal, plain lines stand for the bar, such as "120 of 400 sequences (30 %) after 95
    s", one each LINE_EVERY_S at most: work that is done sooner prints none.
    """
    if not requested:
        yield lambda n: None
    elif not sys.stderr.isatty():
        yield _Lines(total, noun).advance
    else:
        from astropy.utils.console import ProgressBar

        with ProgressBar(total, file=sys.stderr) as bar:
            done = 0

            def advance(n: int) -> None:
                nonlocal done
                done += n
                bar.update(done)

            yield advance


class _Lines:
    """Lines of progress for a log."""

    def __init__(self, total: int, noun: str) -> None:
        self._total, self._noun, self._done = total, noun, 0
        self._begin_s = self._last_s = time.monotonic()

    def advance(self, n: int) -> None:
        """Count some steps, and print a line if the last one is long ago."""
        self._done += n
        now_s = time.monotonic()
        if now_s - self._last_s >= LINE_EVERY_S:
            self._last_s = now_s
            part = f"{self._done:,} of {self._total:,} {self._noun} ({100 * self._done // self._total} %)"
            print(f"{part} after {now_s - self._begin_s:.0f} s", file=sys.stderr, flush=True)


def counted(n: int | np.integer, noun: str, several: str = "") -> str:
    """Return a number with its noun, as in "1,000 stars"."""
    return f"{n:,} {noun if n == 1 else several or noun + 's'}"
