"""Attitudes of targets on a device: motions and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.attitude_table import AttitudeTables
from warpsim_kernels.motion import Attitude as AttitudeStruct

from warpsim.target.attitude import BodyMotion
from warpsim.target.attitude_table import AttitudeRows


@dataclass(frozen=True)
class AttitudeArrays:
    """Attitude tables on the device, and where each target's lies."""

    tables: Any
    table_first: list[int]
    """First row of each target's table."""
    table_count: list[int]
    """Rows of each target's table; 0 for a target that moves by itself."""


def make_attitudes(attitudes: Sequence[BodyMotion | AttitudeRows], device: wp.Device) -> AttitudeArrays:
    """Put the tables of all targets on a device, each once however many targets share it."""
    first_row: dict[int, int] = {}
    distinct: list[AttitudeRows] = []
    n_row = 0
    for attitude in attitudes:
        if isinstance(attitude, AttitudeRows) and id(attitude) not in first_row:
            first_row[id(attitude)] = n_row
            distinct.append(attitude)
            n_row += len(attitude.time_s)
    tables: Any = AttitudeTables()
    time_s = np.concatenate([np.zeros(0), *(rows.time_s for rows in distinct)])
    quaternion = np.concatenate([np.zeros((0, 4)), *(rows.quaternion for rows in distinct)])
    tables.time_s = wp.array(time_s, dtype=wp.float64, device=device)
    tables.quaternion = wp.array(quaternion, dtype=wp.quatd, device=device)
    return AttitudeArrays(
        tables,
        [first_row.get(id(attitude), 0) for attitude in attitudes],
        [len(attitude.time_s) if isinstance(attitude, AttitudeRows) else 0 for attitude in attitudes],
    )


def motion_struct(attitude: BodyMotion | AttitudeRows) -> Any:
    """A motion as the kernels' struct; for a table, one that is not read."""
    struct: Any = AttitudeStruct()
    if isinstance(attitude, AttitudeRows):
        return struct
    motion, frame = attitude.attitude, attitude.frame
    struct.reference, struct.first, struct.second = (wp.vec3d(*axis) for axis in frame.axes)
    struct.tilt_rad = float(np.radians(motion.precession_angle_deg))
    struct.precession_rev_s = motion.precession_rev_s
    struct.precession_phase_rev = frame.precession_phase_rev
    struct.rolling_rev_s = motion.rolling_rev_s
    struct.rolling_phase_rev = frame.rolling_phase_rev
    struct.spin_rev_s = motion.spin_rev_s
    struct.spin_phase_rev = frame.spin_phase_rev
    return struct
