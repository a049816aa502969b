"""Words of reports."""

from __future__ import annotations

import numpy as np


def counted(n: int | np.integer, noun: str) -> str:
    """Return a number with its noun, as in "1,000 stars"."""
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
