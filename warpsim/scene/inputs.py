"""What of a scene came from files: checksums of what was read, which need not be what the files hold by now."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from warpsim.scene.pointing import TablePointing

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene


def input_checksums(scene: Scene) -> dict[str, str]:
    """SHA-256 of the content of each input file as the scene has read it, by path; but for the star catalog."""
    parts = (scene.constellation, scene.groups_of_targets, scene.pointing)
    return _checksums(scene, parts) | scene.optics.file_checksums


def motion_checksums(scene: Scene) -> dict[str, str]:
    """Those of the files that say where satellites and targets are."""
    return _checksums(scene, (scene.constellation, *(group.trajectory for group in scene.groups_of_targets)))


def _checksums(scene: Scene, parts: tuple[Any, ...]) -> dict[str, str]:
    found: dict[str, str] = {}

    def walk(part: Any) -> None:
        if isinstance(part, tuple):
            for item in part:
                walk(item)
        if not dataclasses.is_dataclass(part):
            return
        paths = [path for path in (getattr(part, "file", None), *getattr(part, "files", ())) if path]
        if paths:
            content = scene.sights if isinstance(part, TablePointing) else part
            found[", ".join(paths)] = content.checksum  # type: ignore[union-attr]
        for field in dataclasses.fields(part):
            walk(getattr(part, field.name))

    walk(parts)
    return found
