"""Short forms of a scene: one sensor and one group need no lists.

`camera`, `optics`, `detector`, `bands` and `pointing` beside the scene's own fields describe its only sensor;
`trajectory`, `targets` and `release` its only group. They become lists of one here, at the border. The other way round,
paths of fields leave out the number of what is the only one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from warpsim.config.model import Location, nearest_field
from warpsim.errors import InputError

Item = TypeVar("Item")

SHORT_FORMS = {
    "sensors": ("camera", "optics", "detector", "bands", "pointing"),
    "groups": ("trajectory", "targets", "release"),
}
"""Fields of the only item of a list, by the list."""

NAMES = {"sensors": "sensor", "groups": "main"}
"""Name of the only item if none is given."""


def with_lists(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a scene with lists of sensors and groups."""
    result = dict(values)
    for name, fields in SHORT_FORMS.items():
        given = {field: result.pop(field) for field in fields if field in result}
        if given and name in result:
            field, value = next(iter(given.items()))
            hint = " (did you mean band?)" if field == "bands" and isinstance(value, Mapping) else ""
            raise InputError(f"must not be given beside {name}, which hold it{hint}", field)
        if given:
            result[name] = [{"name": NAMES[name], **given}]
    return result


def list_of(field: str) -> str | None:
    """Return the list whose only item a field belongs to in the short form; None for the scene's own fields."""
    return next((name for name, fields in SHORT_FORMS.items() if field in fields), None)


def shortened(values: Mapping[str, Any]) -> Callable[[Location], Location]:
    """Return a function that drops the number of an only sensor, group or entry of pointing from a field path."""

    def shorten(location: Location) -> Location:
        name, *rest = location or ("",)
        if name not in SHORT_FORMS or not rest or not isinstance(rest[0], int):
            return location
        items, number = values.get(str(name), (None,)), rest[0]
        if not isinstance(items, list | tuple):
            return location
        item = items[number] if number < len(items) else None
        inner = rest[1:]
        if inner[:2] == ["pointing", 0]:
            entries = item.get("pointing") if isinstance(item, Mapping) else getattr(item, "pointing", None)
            if not isinstance(entries, list | tuple) or len(entries) == 1:
                inner = ["pointing", *inner[2:]]
        return tuple(inner) if len(items) == 1 else (name, number, *inner)

    return shorten


def with_paths(name: str, items: Sequence[Item]) -> Iterator[tuple[str, Item]]:
    """Yield the items of a list of sensors or groups, each after its field path."""
    return ((item_path(name, number, len(items)), item) for number, item in enumerate(items))


def item_path(name: str, number: int, count: int) -> str:
    """Return the field path of an item of a list of sensors or groups; "" where it is the only one."""
    return "" if count == 1 else f"{name}[{number}]"


def changed(data: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested dicts and lists after changes, in place."""
    for name, value in changes.items():
        *parents, leaf = name.split("__")
        path = name.replace("__", ".")
        part: Any = data
        for parent in parents:
            part = _inner(part, parent, path)
            if not isinstance(part, dict | list):
                raise InputError(f"is not a field of a part{nearest_field(parent)}", path)
        if isinstance(part, list) and not leaf.isdecimal() and len(part) == 1 and isinstance(part[0], dict):
            part = part[0]
        if isinstance(part, list):
            part[_index(part, leaf, path)] = value
        else:
            part[leaf] = value
    return data


def _inner(part: Any, name: str, path: str) -> Any:
    """Part that a name leads to."""
    if isinstance(part, list) and not name.isdecimal() and len(part) == 1:
        part = part[0]
    if isinstance(part, list):
        return part[_index(part, name, path)]
    return part.get(name) if isinstance(part, dict) else None


def _index(items: list[Any], number: str, path: str) -> int:
    if not (number.isdecimal() and int(number) < len(items)):
        which = f"0 to {len(items) - 1}" if items else "none of an empty list"
        raise InputError(f"must name an item by its number, {which}, got {number}", path)
    return int(number)
