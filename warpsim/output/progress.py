"""Progress bars."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator


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
