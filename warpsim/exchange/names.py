"""Names of objects in files, as names that sensors and files can have."""

from __future__ import annotations

import re
from collections.abc import Iterable


def plain_name(name: str, otherwise: str = "object") -> str:
    """Letters, digits and `_ . -`: each run of others becomes one `_`, none at the ends. `otherwise` if none is left.

    `ISS (ZARYA)` becomes `ISS_ZARYA`.
    """
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("_.-") or otherwise


def unique_names(names: Iterable[str]) -> list[str]:
    """Plain names; one that comes again gets `_2`, `_3`, ..."""
    result: list[str] = []
    for name in map(plain_name, names):
        number, candidate = 1, name
        while candidate in result:
            number += 1
            candidate = f"{name}_{number}"
        result.append(candidate)
    return result
