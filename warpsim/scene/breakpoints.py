"""Breakpoints: times at which the velocity of a body jumps, at releases and between segments of state files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from warpsim.instant import Instant, instant_after
from warpsim.orbit.constellations import ListedSatellites, MixedConstellation
from warpsim.scene.groups import AnyConstellation, TargetGroup
from warpsim.scene.targets import SceneTarget


def breakpoints_s(
    constellation: AnyConstellation,
    groups: Sequence[TargetGroup],
    targets: Sequence[SceneTarget],
    epoch: Instant,
    duration_s: float,
) -> dict[str, list[float]]:
    """Return the times at which the velocity of each satellite and target may jump, ascending [s after the epoch].

    Only those within the scene, and only those that are known: of paths that have `breaks_s(epoch)`, releases, and the
    ends of a target's existence. Until its release a target's are those of its group's main target.
    """
    found = dict(_path_breaks(constellation, constellation.names, epoch))
    paths = [_group_breaks(group, epoch) for group in groups]
    mains = {target.group: target.name for target in reversed(targets)}
    for target in targets:
        own = paths[target.group].get(target.name, [])
        if target.is_released:
            carried = paths[target.group].get(mains[target.group], [])
            own = [time_s for time_s in carried if time_s < target.release_s] + [target.release_s]
        found[target.name] = [*own, *target.exists_s]
    return {name: sorted({time for time in times if 0 < time < duration_s}) for name, times in found.items()}


def _group_breaks(group: TargetGroup, epoch: Instant) -> dict[str, list[float]]:
    """Breakpoints of the paths of a group, by target [s after the scene's epoch]."""
    names = group.names if group.orbits is not None else group.names[:1]
    breaks = _path_breaks(group.path, names, instant_after(epoch, group.start_s))
    return {name: [time_s + group.start_s for time_s in times] for name, times in breaks}


def _path_breaks(path: object, names: Sequence[str], epoch: Instant) -> Iterator[tuple[str, list[float]]]:
    """Breakpoints by name in a path or constellation; objects of one part have them in common."""
    if isinstance(path, MixedConstellation):
        for item in path.parts:
            yield from _path_breaks(item, item.names, epoch)
    elif isinstance(path, ListedSatellites):
        for satellite in path.satellites:
            yield from _path_breaks(satellite.orbit, [satellite.name], epoch)
    else:
        breaks_s = getattr(path, "breaks_s", None)
        yield from ((name, [] if breaks_s is None else breaks_s(epoch)) for name in names)
