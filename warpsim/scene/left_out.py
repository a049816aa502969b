"""Element sets that a scene does without: those that are not valid, and those without a state in the scene."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from warpsim.errors import errors_at
from warpsim.instant import Instant, instant_after
from warpsim.orbit.constellations import invalid_sets, without_lost
from warpsim.orbit.element_catalog import LeftOut
from warpsim.scene.description import SceneDescription
from warpsim.scene.motion import MARGIN_S
from warpsim.scene.short_form import with_paths
from warpsim.scene.target_histories import within_scene

if TYPE_CHECKING:
    from astropy.table import Table


LeftOutOf = tuple[str, LeftOut]
"""Part of a scene (`constellation`, `groups[1].orbits`), and an element set that it does without."""


def without_lost_satellites(scene: SceneDescription, epoch: Instant) -> tuple[SceneDescription, tuple[LeftOutOf, ...]]:
    """Return the scene with the satellites and targets that have states throughout it, and what is left out.

    A scene that does without none is returned itself.

    Raises:
        InputError: A file cannot be read, or no satellite has states.
    """
    with errors_at("constellation"):
        constellation, gone = without_lost(scene.constellation, epoch, -MARGIN_S, scene.duration_s + MARGIN_S)
        found = [("constellation", item) for item in (*invalid_sets(scene.constellation), *gone)]
    changes = {"constellation": constellation} if gone else {}
    groups = []
    for path, group in with_paths("groups", scene.groups):
        first_s, last_s = (end_s - group.start_s for end_s in within_scene(group.span_s, scene.duration_s))
        start = instant_after(epoch, group.start_s)
        with errors_at(path), errors_at(group.path_field):
            flying, gone = without_lost(group.path, start, first_s - MARGIN_S, last_s + MARGIN_S)
            field = f"{path}.{group.path_field}" if path else group.path_field
            found += [(field, item) for item in (*invalid_sets(group.path), *gone)]
        groups.append(dataclasses.replace(group, orbits=flying) if gone else group)
    if any(one is not other for one, other in zip(groups, scene.groups, strict=True)):
        changes["groups"] = tuple(groups)
    return (dataclasses.replace(scene, **changes) if changes else scene), tuple(found)


def left_out_table(left_out: tuple[LeftOutOf, ...]) -> Table:
    """Return the table of what a scene does without: part, name, norad_id (-1: unknown), location, reason."""
    from astropy.table import Table

    kinds = {"part": "str", "name": "str", "norad_id": "int64", "location": "str", "reason": "str"}
    rows = [
        (field, item.name, -1 if item.norad_id is None else item.norad_id, item.location, item.reason)
        for field, item in left_out
    ]
    return Table(rows=rows or None, names=list(kinds), dtype=list(kinds.values()))
