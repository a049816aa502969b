"""When bodies and cameras of a scene change course at once: releases, seams of files of states, rows of directions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from warpsim.orbit.constellations import ListedSatellites, MixedConstellation
from warpsim.scene.view_axes import tracked_targets

if TYPE_CHECKING:
    from warpsim.instant import Epoch
    from warpsim.scene.scene import Scene


def bends_s(scene: Scene) -> dict[str, list[float]]:
    """Times at which the velocity of each sensor and target may jump, ascending [s after the epoch].

    Only those within the scene, and only those that the scene's parts know of: parts that have `breaks_s(epoch)`, and
    releases. Until its release a target bends with its main one.
    """
    found = dict(_breaks_s(scene.constellation, scene.constellation.names, scene.instant))
    for group in scene.groups_of_targets:
        (_, carried), *_ = _breaks_s(group.trajectory, group.names[:1], scene.instant)
        for name, release in zip(group.names, group.releases, strict=True):
            free_s = np.inf if release is None else release.time_s
            found[name] = [time for time in carried if time < free_s] + [free_s]
    return {name: sorted({time for time in times if 0 < time < scene.duration_s}) for name, times in found.items()}


def access_breaks_s(scene: Scene, target: str, sensors: Sequence[str], with_cameras: bool) -> list[list[float]]:
    """For each of the sensors, times at which its access to a target may jump or bend [s after the epoch].

    Args:
        scene: The scene.
        target: One of target_names.
        sensors: Of sensor_names.
        with_cameras: Whether it matters how the sensors' cameras stand.
    """
    bends, names, sights = bends_s(scene), scene.sensor_names, scene.sights if with_cameras else None
    first, count = tracked_targets(scene) if with_cameras else (0, 0)
    shared = [time for name in (target, *scene.target_names[first : first + count]) for time in bends[name]]
    numbers = {name: number for number, name in enumerate(names)}
    turns = {name: [] if sights is None else sights.breaks_s(numbers[name]) for name in sensors}
    return [sorted({*shared, *bends[name], *turns[name]}) for name in sensors]


def _breaks_s(mover: object, names: list[str], epoch: Epoch) -> Iterator[tuple[str, list[float]]]:
    """Names of a path or constellation with the times at which they may bend; objects of one part share its times.

    Args:
        mover: A path or constellation; lists and mixtures of them are looked into.
        names: What its objects are called in the scene.
        epoch: The scene's.
    """
    if isinstance(mover, MixedConstellation):
        for item in mover.parts:
            yield from _breaks_s(item, item.names, epoch)
    elif isinstance(mover, ListedSatellites):
        for satellite in mover.satellites:
            yield from _breaks_s(satellite.orbit, [satellite.name], epoch)
    else:
        breaks_s = getattr(mover, "breaks_s", None)
        yield from ((name, [] if breaks_s is None else breaks_s(epoch)) for name in names)
