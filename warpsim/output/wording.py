"""Words and progress bars for people at a terminal."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator

import numpy as np


@contextlib.contextmanager
def progress_bar(total: int, requested: bool) -> Iterator[Callable[[int], None]]:
    """Yield a function that advances a bar on standard error by some steps; it does nothing if no bar is requested."""
    if not requested:
        yield lambda n: None
        return
    from astropy.utils.console import ProgressBar

    with ProgressBar(total, file=sys.stderr) as bar:
        done = 0

        def advance(n: int) -> None:
            nonlocal done
            done += n
            bar.update(done)

        yield advance


def counted(n: int | np.integer, noun: str) -> str:
    """Return a number with its noun, as in "1,000 stars"."""
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
