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
            if isinstance(place, list):
                place = _item(place, parent, name)
            else:
                place = place.get(parent) if isinstance(place, dict) else None
            if not isinstance(place, dict | list):
                raise InputError("is not a field of a part").of(name.replace('__', '.')).of("Scene")
        if isinstance(place, list):
            _item(place, leaf, name)
            place[int(leaf)] = value
        else:
            place[leaf] = value
    return data


def _item(items: list[Any], number: str, name: str) -> Any:
    if not (number.isdigit() and int(number) < len(items)):
        which = f"0 to {len(items) - 1}" if items else "none of an empty list"
        raise InputError(
            f"must name an item by its number, {which}", value=number
        ).of(name.replace('__', '.')).of("Scene")
    return items[int(number)]
