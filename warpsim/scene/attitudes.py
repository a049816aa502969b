"""Attitudes of the targets of a scene, and tables of attitudes and temperatures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from warpsim.errors import errors_at
from warpsim.instant import Instant
from warpsim.scene.groups import TargetGroup
from warpsim.scene.short_form import with_paths
from warpsim.scene.targets import SceneTarget
from warpsim.scene.tracks import Tracks
from warpsim.target.attitude import BodyMotion, attitude_frame
from warpsim.target.attitude_table import AttitudeRows, AttitudeTable
from warpsim.target.temperature import TemperatureTable
from warpsim.target.torque_free import TorqueFree, TorqueFreeMotion

AnyAttitude = BodyMotion | AttitudeRows | TorqueFreeMotion


def target_attitudes(
    targets: Sequence[SceneTarget],
    tracks: Tracks,
    tables: dict[tuple[int, int], AttitudeRows],
    seed: int,
) -> list[AnyAttitude]:
    """Return the attitude motion of each single target; those of one entry share their table (timed_tables)."""
    found: list[AnyAttitude] = []
    for number, target in enumerate(targets):
        attitude = target.spec.attitude
        if isinstance(attitude, AttitudeTable):
            found.append(tables[target.group, target.entry])
            continue
        if isinstance(attitude, TorqueFree):
            found.append(attitude.motion(seed, number))
            continue
        first_s, last_s = target.exists_s
        begin_s = max(0.0, first_s, min(target.release_s, last_s))  # some are gone before their release
        velocity_m_s = tracks.targets[number].state(begin_s)[1]
        with errors_at("", target.name), errors_at("attitude"):
            found.append(BodyMotion(attitude, attitude_frame(attitude, velocity_m_s, seed, number)))
    return found


def timed_tables(
    groups: Sequence[TargetGroup],
    field: Literal["attitude", "temperature"],
    epoch: Instant,
    duration_s: float,
    with_files: bool = True,
) -> dict[tuple[int, int], Any]:
    """Return the tables of attitudes, or of temperatures, by group and entry, checked to cover the scene."""
    rows: dict[tuple[int, int], Any] = {}
    for number, (path, group) in enumerate(with_paths("groups", groups)):
        for entry, spec in enumerate(group.targets):
            table = getattr(spec, field)
            if isinstance(table, AttitudeTable | TemperatureTable) and (with_files or table.file is None):
                with errors_at(path), errors_at(f"targets[{entry}].{field}"):
                    rows[number, entry] = table.rows(epoch)
                    rows[number, entry].check_span(*within_scene(group.span_s, duration_s))
    return rows


def within_scene(span_s: tuple[float, float], duration_s: float) -> tuple[float, float]:
    """Return the part of a span that lies within a scene [s]."""
    return max(0.0, span_s[0]), min(duration_s, span_s[1])
