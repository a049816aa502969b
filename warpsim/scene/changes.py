"""Changes to a description that name fields of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from warpsim.errors import InputError


def changed(data: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested dicts and lists after changes, in place.

    Args:
        data: The description.
        changes: New values by field; double underscores lead into parts, numbers into lists. The number of the only
            item of a list may be left out.

    Raises:
        InputError: A name leads nowhere.
    """
    for name, value in changes.items():
        *parents, leaf = name.split("__")
        path = name.replace("__", ".")
        part: Any = data
        for parent in parents:
            part = _inner(part, parent, path)
            if not isinstance(part, dict | list):
                raise InputError("is not a field of a part", path)
        if isinstance(part, list) and not leaf.isdigit() and len(part) == 1 and isinstance(part[0], dict):
            part = part[0]
        if isinstance(part, list):
            part[_index(part, leaf, path)] = value
        else:
            part[leaf] = value
    return data


def _inner(part: Any, name: str, path: str) -> Any:
    """Part that a name leads to."""
    if isinstance(part, list) and not name.isdigit() and len(part) == 1:
        part = part[0]
    if isinstance(part, list):
        return part[_index(part, name, path)]
    return part.get(name) if isinstance(part, dict) else None


def _index(items: list[Any], number: str, path: str) -> int:
    if not (number.isdigit() and int(number) < len(items)):
        which = f"0 to {len(items) - 1}" if items else "none of an empty list"
        raise InputError(f"must name an item by its number, {which}, got {number}", path)
    return int(number)
