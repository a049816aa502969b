"""Attitude motion of a target: spin, precession and rolling in closed form.

The rotation body -> GCRS is F Rz(azimuth) Ry(polar) Rz(spin). F has the columns (first, second, reference): fixed axes,
the last of them the direction that the body precesses about. Azimuth is the precession's angle, polar the precession
angle plus rolling. So +z of the body, its symmetry axis, is the z axis of the kernel's `axes_before_spin`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BeforeValidator, Discriminator, Field, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import Number, Vector, closed_interval, rule_error
from warpsim.config.model import choice, config_model
from warpsim.errors import InputError
from warpsim.quaternion import from_matrix, product
from warpsim.streams import uniforms

SPLITTER = 2.0**27 + 1
"""Cuts a float64 into two halves of 26 bits, whose products are exact (Veltkamp)."""

NEAR_POLE_RAD = 1e-6
"""A fixed direction nearer than this to GCRS +z or -z counts precession from +x instead of +z."""


_AXIS_RULE = "must be 'velocity', 'random' or three numbers"


def _axis_word(value: Any) -> Any:
    if value not in ("velocity", "random"):
        raise rule_error(_AXIS_RULE)
    return value


def _axis_vector(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise rule_error(_AXIS_RULE)
    return value


Axis = Annotated[
    Annotated[Literal["velocity", "random"], BeforeValidator(_axis_word), choice("word")]
    | Annotated[Vector, BeforeValidator(_axis_vector), choice("vector")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "vector"),
]
"""A fixed direction, by its name or in GCRS axes."""


@config_model
class Attitude:
    """Motion of a body about a fixed direction: precession, rolling and spin, alone or together.

    Args:
        spin_rev_s: Spin about the body axis [rev/s]. A body of revolution shows it by its patches only.
        precession_rev_s: Turning of the body axis about the fixed direction [rev/s].
        precession_angle_deg: Angle between body axis and fixed direction [deg].
        rolling_rev_s: Tumbling of the body axis about a transverse axis [rev/s].
        axis: The fixed direction: "velocity" at release, "random" (seeded), or a vector in GCRS axes.
        spin_phase_rev: Spin angle at the epoch [rev]; seeded when left out.
        precession_phase_rev: Precession angle at the epoch [rev]; 0 leans the body axis towards GCRS +z (+x where the
            fixed direction is within 1e-6 rad of a pole). Seeded when left out.
        rolling_phase_rev: Rolling angle at the epoch [rev]; when left out seeded, or 0 without rolling.
    """

    spin_rev_s: Number = 0.0
    precession_rev_s: Number = 0.0
    precession_angle_deg: Annotated[Number, closed_interval(0, 180)] = 0.0
    rolling_rev_s: Number = 0.0
    axis: Axis = "velocity"
    spin_phase_rev: Number | None = None
    precession_phase_rev: Number | None = None
    rolling_phase_rev: Number | None = None
    kind: Literal["motion"] = Field(default="motion", kw_only=True)

    @model_validator(mode="after")
    def _has_direction(self) -> Attitude:
        if not isinstance(self.axis, str) and not any(self.axis):
            raise InputError("must not be the zero vector", "axis")
        return self


@dataclass(frozen=True)
class BodyMotion:
    """A motion of one target, with the axes and phases that the seed and the release set."""

    attitude: Attitude
    axes: F64
    """Rows reference, first, second: right-handed, unit, GCRS axes; shape (3, 3)."""
    spin_phase_rev: float
    precession_phase_rev: float
    rolling_phase_rev: float

    def at(self, time_s: npt.ArrayLike) -> F64:
        """Rotation body -> GCRS at times after the epoch [s]; scalar last, unit, shape (n, 4).

        The sign depends on the time alone and is continuous in it: quaternions of neighbouring times lie in one
        hemisphere if the body turns by less than half a turn between them.
        """
        time, attitude = np.atleast_1d(np.asarray(time_s, dtype=np.float64)), self.attitude

        def half_angle_rad(rate_rev_s: float, phase_rev: float) -> F64:
            # Turns of the half-angle, at half the rate: its sine and cosine are continuous over the body's whole turns.
            return np.asarray(2 * np.pi * (turns(rate_rev_s / 2, time) + phase_rev / 2))

        azimuth = half_angle_rad(attitude.precession_rev_s, self.precession_phase_rev)
        polar = half_angle_rad(attitude.rolling_rev_s, self.rolling_phase_rev)
        polar += np.radians(attitude.precession_angle_deg) / 2
        spin = half_angle_rad(attitude.spin_rev_s, self.spin_phase_rev)
        c, s = np.cos(polar), np.sin(polar)
        turned = np.stack(  # about z by azimuth, y by polar, z by spin, multiplied out
            [
                -s * np.sin(azimuth - spin),
                s * np.cos(azimuth - spin),
                c * np.sin(azimuth + spin),
                c * np.cos(azimuth + spin),
            ],
            axis=-1,
        )
        reference, first, second = self.axes
        return product(from_matrix(np.column_stack([first, second, reference])), turned)


def body_motion(attitude: Attitude, velocity_m_s: F64, seed: int, target: int) -> BodyMotion:
    """Return the motion of a scene's target; each has random numbers of its own."""
    u = uniforms(seed, "attitude", target, 6)
    reference = _reference(attitude, velocity_m_s, u)
    if attitude.precession_phase_rev is None:
        # Any direction well away from the reference gives a stable perpendicular; the seeded angle then turns it.
        first = _cross(reference, _AXES[np.argmin(np.abs(reference))])
        first /= np.linalg.norm(first)
        second = _cross(reference, first)
        turn = 2 * np.pi * u[2]
        first, second = np.cos(turn) * first + np.sin(turn) * second, np.cos(turn) * second - np.sin(turn) * first
    else:
        second = _cross(reference, _AXES[2 if np.hypot(*reference[:2]) > NEAR_POLE_RAD else 0])
        second /= np.linalg.norm(second)
        first = _cross(second, reference)
    return BodyMotion(
        attitude,
        np.stack([reference, first, second]),
        _phase_rev(attitude.spin_phase_rev, u[5]),
        _phase_rev(attitude.precession_phase_rev, u[3]),
        _phase_rev(attitude.rolling_phase_rev, u[4] if attitude.rolling_rev_s != 0 else 0.0),
    )


_AXES = np.eye(3)


def _cross(a: F64, b: F64) -> F64:
    """Return the bits of np.cross in a sixth of its time."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _phase_rev(given_rev: float | None, seeded_rev: float) -> float:
    return float(seeded_rev) if given_rev is None else given_rev % 1.0


def _reference(attitude: Attitude, velocity_m_s: F64, u: F64) -> F64:
    """The fixed direction as a unit vector."""
    if attitude.axis == "velocity":
        reference = np.asarray(velocity_m_s, dtype=np.float64)
        if not reference.any():
            raise InputError("must be 'random' or a vector for a target at rest, which has no velocity", "axis")
    elif attitude.axis == "random":
        z = 2 * u[0] - 1
        ring = np.sqrt(1 - z * z)
        reference = np.array([ring * np.cos(2 * np.pi * u[1]), ring * np.sin(2 * np.pi * u[1]), z])
    else:
        reference = np.asarray(attitude.axis, dtype=np.float64)
    reference = reference / np.abs(reference).max()  # first, so that the squares neither overflow nor vanish
    return np.asarray(reference / np.linalg.norm(reference))


def turns(rate_rev_s: float, time_s: F64) -> F64:
    """Fraction of a turn after time_s at a constant rate, from 0 to 1, of the shape of time_s.

    Rounded only at the end: the product's own rounding error is recovered (Dekker 1971), and whole turns are taken off
    the rest, so no phase is lost however long the time.
    """
    product_rev = np.asarray(rate_rev_s * time_s)
    rate_high, rate_low = _halves(np.asarray(rate_rev_s))
    time_high, time_low = _halves(time_s)
    lost = rate_high * time_high - product_rev + rate_high * time_low + rate_low * time_high + rate_low * time_low
    phase = (product_rev - np.floor(product_rev)) + lost
    return np.asarray(phase - np.floor(phase))


def _halves(value: F64) -> tuple[F64, F64]:
    shifted = SPLITTER * value
    high = shifted - (shifted - value)
    return high, value - high
