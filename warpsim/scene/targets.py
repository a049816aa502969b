"""The single targets of a scene: the members of its groups, with the numbers that are drawn for each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import ValidationError

from warpsim.config.model import adapter, input_error
from warpsim.errors import errors_at
from warpsim.scene.groups import TargetGroup, TargetSpec
from warpsim.scene.short_form import changed, item_path
from warpsim.streams import uniforms


@dataclass(frozen=True)
class SceneTarget:
    """A single target."""

    name: str
    spec: TargetSpec
    """Its description, with its own numbers where they are spread."""
    group: int
    """Index of its group."""
    entry: int
    """Index of its entry in the group's `targets`."""
    release_s: float
    """When it leaves the group's main target, after the scene's epoch [s]; -inf where it never does."""
    exists_s: tuple[float, float]
    """From when to when it is there, after the scene's epoch [s]."""

    @property
    def is_released(self) -> bool:
        """Return whether it leaves the group's main target at some time."""
        return self.release_s > -math.inf


def scene_targets(groups: Sequence[TargetGroup], seed: int) -> list[SceneTarget]:
    """Return the single targets of groups, group by group, the main target of each first."""
    return [target for number, group in enumerate(groups) for target in _members(group, number, len(groups), seed)]


def _members(group: TargetGroup, number: int, n_group: int, seed: int) -> list[SceneTarget]:
    """Targets of a group."""
    names, releases = group.names, group.releases
    entries = [0] * len(names) if group.orbits else [k for k, spec in enumerate(group.targets) for _ in spec.names]
    found, before = [], dict.fromkeys(entries, 0)
    for name, release, entry in zip(names, releases, entries, strict=True):
        spec = group.targets[entry]
        if spec.spread:
            with errors_at(item_path("groups", number, n_group)), errors_at(f"targets[{entry}].spread", name):
                spec = drawn_spec(spec, f"{group.name}.{spec.name}", before[entry], seed)
        before[entry] += 1
        release_s = -math.inf if release is None else group.start_s + release.time_s
        found.append(SceneTarget(name, spec, number, entry, release_s, group.span_s))
    return found


def drawn_spec(spec: TargetSpec, whose: str, member: int, seed: int) -> TargetSpec:
    """Return the description of one member of an entry whose numbers are spread."""
    values = {
        field: distribution.value(float(uniforms(seed, f"spread.{whose}.{field}", member, 1)[0]))
        for field, distribution in (spec.spread or {}).items()
    }
    return with_values(spec, values)


def with_values(spec: TargetSpec, values: dict[str, object]) -> TargetSpec:
    """Return a description with some numbers replaced, by field, and nothing spread."""
    data = adapter(TargetSpec).dump_python(spec, mode="json", by_alias=True, exclude={"spread"})
    data = changed(data, {field.replace(".", "__"): value for field, value in values.items()})
    try:
        return adapter(TargetSpec).validate_python(data)  # type: ignore[no-any-return]
    except ValidationError as error:
        raise input_error(error) from None
