"""Short forms of a scene: one sensor and one group need no lists.

`camera`, `optics`, `detector`, `bands` and `pointing` beside the scene's own fields describe its only sensor;
`trajectory`, `targets` and `release` its only group. They become lists of one here, at the border. The other way round,
paths of fields leave out the number of what is the only one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from warpsim.config.model import Location
from warpsim.errors import InputError

SHORT_FORMS = {
    "sensors": ("camera", "optics", "detector", "bands", "pointing"),
    "groups": ("trajectory", "targets", "release"),
}
"""Fields of the only item of a list, by the list."""

NAMES = {"sensors": "sensor", "groups": "main"}
"""What the only item is called that has no name of its own."""


def with_lists(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a scene with lists of sensors and groups.

    Raises:
        InputError: A field of the short form stands beside the list.
    """
    result = dict(values)
    for name, fields in SHORT_FORMS.items():
        given = {field: result.pop(field) for field in fields if field in result}
        if given and name in result:
            raise InputError(f"must not be given beside {name}, which hold it", next(iter(given)))
        if given:
            result[name] = [{"name": NAMES[name], **given}]
    return result


def list_of(field: str) -> str | None:
    """Return the list whose only item a field belongs to in the short form; None for the scene's own fields."""
    return next((name for name, fields in SHORT_FORMS.items() if field in fields), None)


def shortened(values: Mapping[str, Any]) -> Callable[[Location], Location]:
    """Return what leaves the number of the only sensor or group out of a path of fields."""
    given = {name: values.get(name, (None,)) for name in SHORT_FORMS}
    alone = {name for name, items in given.items() if isinstance(items, list | tuple) and len(items) == 1}

    def shorten(location: Location) -> Location:
        return location[2:] if len(location) > 2 and location[0] in alone and location[1] == 0 else location

    return shorten


def item_place(name: str, number: int, count: int) -> str:
    """Return the path of an item of a list of sensors or groups; nothing where it is the only one."""
    return "" if count == 1 else f"{name}[{number}]"
