"""How the targets of a scene are turned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpsim.errors import InputError
from warpsim.target.attitude import BodyMotion, attitude_frame
from warpsim.target.attitude_table import AttitudeRows, AttitudeTable

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene


def target_attitudes(scene: Scene) -> list[BodyMotion | AttitudeRows]:
    """What turns each single target, in the order of scene.target_names; targets of one table share its rows.

    Raises:
        InputError: A table cannot be read or does not cover the scene.
    """
    tables = table_rows(scene)
    found: list[BodyMotion | AttitudeRows] = []
    for kind, spec in enumerate(scene.targets):
        for _ in range(spec.count):
            number = len(found)
            if isinstance(spec.attitude, AttitudeTable):
                found.append(tables[kind])
            else:
                velocity_m_s = scene.tracks.targets[number].state(np.zeros(1))[1][0]
                frame = attitude_frame(spec.attitude, velocity_m_s, scene.seed, number)
                found.append(BodyMotion(spec.attitude, frame))
    return found


def table_rows(scene: Scene, with_files: bool = True) -> dict[int, AttitudeRows]:
    """Checked tables of the scene, by the number of their entry in scene.targets.

    Raises:
        InputError: A table cannot be read or does not cover the scene; the text begins with its place.
    """
    rows = {}
    for kind, spec in enumerate(scene.targets):
        if isinstance(spec.attitude, AttitudeTable) and (with_files or spec.attitude.file is None):
            try:
                rows[kind] = spec.attitude.rows(scene.epoch)
                rows[kind].check_span(0.0, scene.duration_s)
            except InputError as error:
                raise InputError(f"targets[{kind}].attitude: {error}") from None
    return rows
