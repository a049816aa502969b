"""What a changed scene takes over from the one that it was made from, so that it is not worked out again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from warpsim.errors import InputError
from warpsim.scene.inputs import motion_checksums

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene

_NO_MATTER_OF_MOTION = {
    "frames", "bands", "name", "description", "camera", "optics", "detector", "sky", "lighting", "pointing",
    "access_rules",
}  # fmt: skip
_NO_MATTER_OF_ACCESS = _NO_MATTER_OF_MOTION - {"camera", "pointing", "access_rules"}


def carry_over(old: Scene, new: Scene) -> None:
    """Give a scene the tracks and the access of another one, as far as they are known and the same."""
    known = vars(old)
    if "tracks" not in known or _differ(old, new, _NO_MATTER_OF_MOTION):
        return
    try:
        if motion_checksums(old) != motion_checksums(new):  # a file was changed since it was read
            return
    except InputError:  # and cannot be read any more
        return
    vars(new)["tracks"] = known["tracks"]  # where cached_property keeps it
    if "_intervals" in known and old.sights is None and not _differ(old, new, _NO_MATTER_OF_ACCESS):
        vars(new)["_intervals"] = known["_intervals"]


def _differ(old: Scene, new: Scene, but_for: set[str]) -> bool:
    return _told(old, but_for) != _told(new, but_for)


def _told(scene: Scene, but_for: set[str]) -> dict[str, Any]:
    return {name: value for name, value in scene.to_dict().items() if name not in but_for}
