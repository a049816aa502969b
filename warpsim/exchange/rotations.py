"""Rotations as formats write them: by three angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.quaternion import product

F64 = NDArray[np.float64]

_AXES = {"X": 0, "Y": 1, "Z": 2, "1": 0, "2": 1, "3": 2}


def euler_quaternion(sequence: str, angle_deg: F64) -> F64:
    """Rotations from axes turned about three axes, one after the other, each about the axes as turned so far.

    Args:
        sequence: Axes in order, "ZXZ" or "313".
        angle_deg: Angles, in order [deg], (n, 3).

    Returns:
        Quaternions that turn components in the turned axes into those in the first ones, (n, 4).
    """
    axes = [_AXES.get(letter) for letter in sequence.strip().upper()]
    if len(axes) != 3 or None in axes or axes[0] == axes[1] or axes[1] == axes[2]:
        raise InputError("must be three axes like ZXZ or 321", value=sequence[:20])
    total = np.tile([0.0, 0.0, 0.0, 1.0], (len(angle_deg), 1))
    for axis, angle in zip(axes, np.radians(angle_deg).T, strict=True):
        turn = np.zeros((len(angle), 4))
        turn[:, axis] = np.sin(0.5 * angle)
        turn[:, 3] = np.cos(0.5 * angle)
        total = product(total, turn)
    return total
