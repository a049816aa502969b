"""Slews of a camera from one pointing law to the next, within a rate and an acceleration.

While it turns, the camera's axes are those of the law before, turned a part s(t) of the rotation that leads to those of
the law to come, about its axis: both laws go on meanwhile, so that angle and rate are continuous at both ends. s(t)
rises by a constant acceleration, a constant rate and a constant deceleration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.scene.pointing import Slew

AxesAt = Callable[[F64], F64]
"""time_s (n,) -> camera axes as rows, (n, 3, 3)."""

_N_SAMPLE = 257
"""Instants of a turn at which its rate is looked at."""
_ROOM = 1.02
"""What a turn is slowed down by beyond what its rate asks for."""
_MOST_ROUNDS = 40
_LEAST_S = 1e-9
"""A turn is not shorter."""


@dataclass(frozen=True)
class SlewTurn:
    """A feasible slew."""

    duration_s: float
    """Of the turn, without settling [s]; 0 for none."""
    ramp: float
    """Part of it in which the rate grows, and in which it sinks, (0, 0.5]."""
    settle_s: float
    """After the turn [s]."""
    vector: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Axis times angle of the rotation at its beginning [rad]: which way round it goes where that is half a turn."""

    @property
    def total_s(self) -> float:
        """Time until the camera is settled [s]."""
        return self.duration_s + self.settle_s


NO_TURN = SlewTurn(0.0, 0.5, 0.0)


def slew_part(duration_s: npt.ArrayLike, ramp: npt.ArrayLike, since_s: F64) -> F64:
    """Return the part of a turn's rotation that is done some time after its beginning, 0 to 1.

    Args:
        duration_s: Of the turn, or of one for each time, above 0 [s].
        ramp: Part of it in which the rate grows, and in which it sinks.
        since_s: Time since its beginning [s], shape (n,).
    """
    ramp, u = np.asarray(ramp), np.clip(since_s / np.asarray(duration_s), 0.0, 1.0)
    rest = np.minimum(u, 1.0 - u)
    whole = 1.0 - ramp  # of the rate's integral, for a greatest rate of 1
    begun = np.where(rest < ramp, 0.5 * rest * rest / ramp, rest - 0.5 * ramp) / whole
    return np.asarray(np.where(u <= 0.5, begun, 1.0 - begun))


def between(before: F64, after: F64, part: F64, near: npt.ArrayLike = (0.0, 0.0, 0.0)) -> F64:
    """Return axes a part of the rotation from some to others.

    Args:
        before: Rows as axes, shape (n, 3, 3).
        after: The same.
        part: Part of the rotation, shape (n,).
        near: Axis times angle [rad], (3,) or (n, 3): of the two ways round, the nearer one is taken. The shorter one
            changes sides where the rotation passes half a turn.
    """
    from scipy.spatial.transform import Rotation

    vector = rotation_vectors(before, after)
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    other, wanted = vector * (1.0 - 2.0 * np.pi / np.where(length > 0.0, length, 1.0)), np.asarray(near, np.float64)
    nearer = np.linalg.norm(other - wanted, axis=-1) < np.linalg.norm(vector - wanted, axis=-1)
    vector = np.where(nearer[:, None] & (length > 0.0), other, vector) * part[:, None]
    return np.asarray(Rotation.from_rotvec(vector).as_matrix() @ before)


def rotation_vectors(before: F64, after: F64) -> F64:
    """Return axis times angle [rad] of rotations from some axes to others, (n, 3, 3) each, 0 to pi; (n, 3)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(np.einsum("nij,nkj->nik", after, before)).as_rotvec())


def turn_between(before: AxesAt, after: AxesAt, slew: Slew, start_s: float, end_s: float, last_s: float) -> SlewTurn:
    """Return the turn from one law to another that keeps the camera's rate and acceleration within bounds.

    The turn begins with the profile that the rotation between the two laws asks for, and is slowed down until the rate
    and the acceleration of the camera against the stars, as measured along it, are those of `slew` or less.

    Args:
        before: Axes by the law until then.
        after: Axes by the law from then on.
        slew: The bounds.
        start_s: When it begins [s].
        end_s: When it must be over, settled, at the latest [s].
        last_s: Until when the laws hold [s]; nobody asks what a longer turn does behind.

    Raises:
        InputError: The turn takes longer than that, or the laws themselves turn faster.
    """
    rate, acceleration = math.radians(slew.max_rate_deg_s), math.radians(slew.max_acceleration_deg_s2)
    vector = rotation_vectors(before(np.array([start_s])), after(np.array([start_s])))[0]
    x, y, z = vector
    angle = float(np.linalg.norm(vector))
    whole = angle > rate * rate / acceleration  # from rest to rest, at the greatest rate between
    duration_s = angle / rate + rate / acceleration if whole else 2.0 * math.sqrt(angle / acceleration)
    ramp = 0.5
    for _ in range(_MOST_ROUNDS):
        if start_s + (duration_s + slew.settle_s) > end_s:  # as a turn counts it
            break
        ramp = min(0.5, rate / acceleration / max(duration_s, _LEAST_S)) if duration_s > 0 else 0.5
        turn = SlewTurn(duration_s, max(ramp, 1e-6), slew.settle_s, (float(x), float(y), float(z)))
        looked_at_s = min(duration_s, last_s - start_s)
        times = start_s + np.linspace(0.0, 1.0, _N_SAMPLE) * looked_at_s
        part = slew_part(max(duration_s, _LEAST_S), turn.ramp, times - start_s)
        axes = between(before(times), after(times), part, vector)
        rate_now, acceleration_now = _measured(axes, looked_at_s)
        slower = max(rate_now / rate, math.sqrt(acceleration_now / acceleration))
        if slower <= 1.0 + 1e-3 or angle < 1e-9:
            return turn
        duration_s *= max(slower, 1.0) * _ROOM
    if start_s + (duration_s + slew.settle_s) > end_s:
        raise InputError(
            f"must leave time for the slew that begins at {start_s:g} s, which takes {duration_s:.3g} s or more, and "
            f"{slew.settle_s:g} s to settle",
            value=end_s,
            form="g",
        )
    raise InputError(
        f"the tracked direction turns faster than max_rate_deg_s ({slew.max_rate_deg_s:g}) or max_acceleration_deg_s2 "
        f"({slew.max_acceleration_deg_s2:g}) allow after {start_s:g} s"
    )


def _measured(axes: F64, duration_s: float) -> tuple[float, float]:
    """Greatest rate [rad/s] and acceleration [rad/s2] of axes at evenly spaced times."""
    step_s = duration_s / (len(axes) - 1)
    if step_s <= 0.0:
        return 0.0, 0.0
    # In the axes of the stars, so that neighbouring rates can be compared.
    rates = np.einsum("nji,nj->ni", axes[:-1], rotation_vectors(axes[:-1], axes[1:])) / step_s
    # Second differences over a few steps: those of neighbours are rounding.
    few = max(1, len(rates) // 32)
    changes = np.linalg.norm(rates[few:] - rates[:-few], axis=1) / (few * step_s)
    return float(np.linalg.norm(rates, axis=1).max()), float(changes.max())
