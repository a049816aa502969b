"""Changes to a description that name fields of its parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from warpsim.errors import InputError


def changed(data: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Nested dicts and lists after changes, in place.

    Args:
        data: The description.
        changes: New values by field; double underscores lead into parts, numbers into lists.

    Raises:
        InputError: A name leads nowhere.
    """
    for name, value in changes.items():
        *parents, leaf = name.split("__")
        place: Any = data
        for parent in parents:
            if _is_index(place, parent):
                place = place[int(parent)]
            else:
                place = place.get(parent) if isinstance(place, dict) else None
            if not isinstance(place, dict | list):
                raise InputError(f"Scene: {name.replace('__', '.')}: is not a field of a part")
        if isinstance(place, list):
            if not _is_index(place, leaf):
                raise InputError(f"Scene: {name.replace('__', '.')}: is not an item of a list of {len(place)}")
            place[int(leaf)] = value
        else:
            place[leaf] = value
    return data


def _is_index(place: Any, name: str) -> bool:
    return isinstance(place, list) and name.isdigit() and int(name) < len(place)
