"""States of sensors and targets in truth: where they were, how fast, and how they were turned."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from warpsim.constants import SPEED_OF_LIGHT_M_S
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

F64 = npt.NDArray[np.float64]

STATE_NAMES = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "qx", "qy", "qz", "qw")
"""Of position, velocity and attitude, behind `sensor_` or `target_`."""

STATE_UNITS = {
    f"{body}_{name}": "m" if name in STATE_NAMES[:3] else "m / s"
    for body in ("sensor", "target")
    for name in STATE_NAMES[:6]
}


def sensor_states(instrument: Instrument, sensor: str, time_s: F64, axes_icrs: F64) -> F64:
    """Return states of a sensor: position [m], velocity [m/s], quaternion of the rotation from GCRS to camera axes.

    Args:
        instrument: Its kind.
        sensor: Its name.
        time_s: Times after the epoch [s], (n,).
        axes_icrs: Camera axes then, as rows, (n, 3, 3).

    Returns:
        Shape (n, 10), as STATE_NAMES has them; quaternions scalar last, their scalar not negative.
    """
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_matrix(axes_icrs).as_quat(canonical=True)
    return np.concatenate([*instrument.state(sensor, time_s), attitude], axis=-1)


def target_states(scenario: Scenario, time_s: F64, range_m: F64) -> F64:
    """Return states of targets when the light left that comes in at a time.

    Args:
        scenario: The scenario.
        time_s: When it comes in, after the epoch [s], (n, n_target).
        range_m: From how far away, likewise; NaN where a target is absent.

    Returns:
        Shape (n, n_target, 10), as STATE_NAMES has them, of the rotation from GCRS to body axes; NaN for absent ones.
    """
    from scipy.spatial.transform import Rotation

    left_s = time_s - range_m / SPEED_OF_LIGHT_M_S
    found = np.full((*time_s.shape, len(STATE_NAMES)), np.nan)
    for target, attitude in enumerate(scenario.attitudes):
        (there,) = np.nonzero(np.isfinite(left_s[:, target]))
        if len(there):
            times = left_s[there, target]
            turned = Rotation.from_quat(attitude.at(times)).inv().as_quat(canonical=True)
            found[there, target] = np.concatenate([*scenario.tracks.target_state(target, times), turned], axis=-1)
    return found
