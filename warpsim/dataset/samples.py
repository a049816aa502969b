"""The table `sample` of a recipe: fields of the scene and their distributions, and the files among these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from warpsim.config.distributions import KINDS, is_distribution
from warpsim.config.fields import rule_error
from warpsim.scene.scene_files import named_files, with_absolute_paths


def flat_names(value: Any) -> dict[str, Any]:
    """Distributions by their field's whole name, however deep the tables are that lead there."""
    if not isinstance(value, Mapping):
        raise rule_error("must be a table of fields and distributions")
    flat: dict[str, Any] = {}

    def walk(items: Mapping[Any, Any], above: str) -> None:
        for key, item in items.items():
            name = f"{above}{str(key).replace('__', '.')}"
            if name in flat:
                raise rule_error(f"must name each field once; {name} comes twice")
            if is_distribution(item):
                flat[name] = item
            elif isinstance(item, Mapping) and item:
                walk(item, f"{name}.")
            else:
                raise rule_error(f"must have one of {', '.join(KINDS)} for {name}, as in {{ uniform = [1, 2] }}")

    walk(value, "")
    return flat


def with_absolute_choices(distributions: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Distributions by field, in which relative paths among the values of choices are taken from a folder."""
    return {
        name: item | {"choice": [_absolute(name, value, folder) for value in item["choice"]]}
        if isinstance(item, dict) and isinstance(item.get("choice"), list | tuple)
        else item
        for name, item in distributions.items()
    }


def choices_with_files(distributions: Mapping[str, Any]) -> Iterator[tuple[str, int, Any, dict[str, Any]]]:
    """Choices that name a file, a list of files, or a star catalog: field, index, value, and value in tables."""
    for name, distribution in distributions.items():
        for number, value in enumerate(getattr(distribution, "choice", ())):
            nested = _nested(name, value)
            if named_files(nested) or "catalog" in nested.get("sky", ()):
                yield name, number, value, nested


def _absolute(name: str, value: Any, folder: Path) -> Any:
    nested: Any = with_absolute_paths(_nested(name, value), folder)
    for part in name.split("."):
        nested = nested[0 if part.isdigit() else part]
    return nested


def _nested(name: str, value: Any) -> dict[str, Any]:
    """A value in tables and lists by the parts of its name."""
    for part in reversed(name.split(".")):
        value = [value] if part.isdigit() else {part: value}
    nested: dict[str, Any] = value
    return nested
