"""How the targets of a scene are turned."""

from __future__ import annotations

from typing import TYPE_CHECKING

from warpsim.errors import InputError
from warpsim.target.attitude import BodyMotion, attitude_frame
from warpsim.target.attitude_table import AttitudeRows, AttitudeTable

if TYPE_CHECKING:
    from warpsim.scene.parts import TargetSpec
    from warpsim.scene.scene import Scene


def target_attitudes(scene: Scene) -> list[BodyMotion | AttitudeRows]:
    """What turns each single target, in the order of scene.target_names; targets of one table share its rows.

    Raises:
        InputError: A table cannot be read or does not cover the scene.
    """
    tables, tracks = table_rows(scene), scene.tracks
    found: list[BodyMotion | AttitudeRows] = []
    for number, spec in enumerate(scene.target_specs):
        if isinstance(spec.attitude, AttitudeTable):
            found.append(tables[spec])
        else:
            released_s = max(0.0, float(tracks.release_s[len(tracks.sensors) + number]))
            velocity_m_s = tracks.targets[number].state(released_s)[1]
            try:
                frame = attitude_frame(spec.attitude, velocity_m_s, scene.seed, number)
            except InputError as error:
                raise error.within("attitude").of(scene.target_names[number]) from None
            found.append(BodyMotion(spec.attitude, frame))
    return found


def table_rows(scene: Scene, with_files: bool = True) -> dict[TargetSpec, AttitudeRows]:
    """Checked tables of the scene's targets.

    Raises:
        InputError: A table cannot be read or does not cover the scene; the text begins with its place.
    """
    rows = {}
    for number, group in enumerate(scene.groups_of_targets):
        where = "" if number == 0 else f"groups[{number - 1}]."
        for kind, spec in enumerate(group.targets):
            if isinstance(spec.attitude, AttitudeTable) and (with_files or spec.attitude.file is None):
                try:
                    rows[spec] = spec.attitude.rows(scene.epoch)
                    rows[spec].check_span(0.0, scene.duration_s)
                except InputError as error:
                    raise error.within(f"{where}targets[{kind}].attitude") from None
    return rows
