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
        return
    done, begin_s = 0, time.monotonic()
    last_s = begin_s
    with contextlib.ExitStack() as stack:
        bar = None
        if sys.stderr.isatty():
            from astropy.utils.console import ProgressBar

            bar = stack.enter_context(ProgressBar(total, file=sys.stderr))

        def advance(n: int) -> None:
            nonlocal done, last_s
            done += n
            now_s = time.monotonic()
            if bar is not None:
                bar.update(done)
            elif now_s - last_s >= LINE_EVERY_S:
                last_s = now_s
                part = f"{done:,} of {total:,} {noun} ({100 * done // total} %)"
                print(f"{part} after {now_s - begin_s:.0f} s", file=sys.stderr, flush=True)

        yield advance


def counted(n: int | np.integer, noun: str, several: str = "") -> str:
    """Return a number with its noun, as in "1,000 stars"."""
    return f"{n:,} {noun if n == 1 else several or noun + 's'}"
