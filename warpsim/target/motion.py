"""How a target turns and cools."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import model_validator

from warpsim.describe import NonNegative, Number, Positive, Vector, closed_interval, part, part_error
from warpsim.streams import uniforms


@part
class Attitude:
    """Motion of the body axis about a fixed direction.

    Args:
        spin_rev_s: Spin about the body axis [rev/s]. It does not change how a body of revolution looks.
        precession_rev_s: Turning of the body axis about the fixed direction [rev/s].
        precession_angle_deg: Angle between body axis and fixed direction [deg].
        rolling_rev_s: Tumbling of the body axis about a transverse axis [rev/s].
        axis: The fixed direction: "velocity" at release, "random" (seeded), or a vector in GCRS axes.
    """

    spin_rev_s: Number = 0.0
    precession_rev_s: Number = 0.0
    precession_angle_deg: Annotated[Number, closed_interval(0, 180)] = 0.0
    rolling_rev_s: Number = 0.0
    axis: Literal["velocity", "random"] | Vector = "velocity"

    @model_validator(mode="after")
    def _has_direction(self) -> Attitude:
        if not isinstance(self.axis, str) and not any(self.axis):
            raise part_error("axis: must not be the zero vector")
        return self


Kelvin = Annotated[Positive, closed_interval(0, 1e5)]


@part
class Temperature:
    """A temperature that changes linearly from the scene's start to its end, or stays.

    Args:
        start_k: At the scene's epoch [K].
        end_k: At the scene's end [K]; the same as at the start when left out.
    """

    start_k: Kelvin
    end_k: Kelvin | None = None


@part
class Graybody:
    """Surface that emits and reflects the same in all bands.

    Opaque: emissivity = 1 - reflectance. Giving both inconsistently is an error.

    Args:
        reflectance: Diffuse reflectance, 0 to 1.
        emissivity: Emissivity, 0 to 1.
    """

    reflectance: Annotated[NonNegative, closed_interval(0, 1)] | None = None
    emissivity: Annotated[NonNegative, closed_interval(0, 1)] | None = None

    @model_validator(mode="after")
    def _opaque(self) -> Graybody:
        if self.reflectance is None and self.emissivity is None:
            raise part_error("give reflectance or emissivity")
        if self.reflectance is not None and self.emissivity is not None:
            total = self.reflectance + self.emissivity
            if abs(total - 1) > 1e-9:
                raise part_error(f"emissivity + reflectance: must be 1 (opaque graybody), got {total:g}")
        return self

    @property
    def emissivity_value(self) -> float:
        """Emissivity, whichever of the two was given."""
        if self.emissivity is not None:
            return self.emissivity
        return 1.0 - float(self.reflectance or 0.0)


def attitude_frame(
    attitude: Attitude, velocity_m_s: npt.NDArray[np.float64], seed: int, target: int
) -> tuple[npt.NDArray[np.float64], float, float]:
    """Fixed axes and phases of one target's motion.

    Args:
        attitude: The description.
        velocity_m_s: Velocity at release, GCRS axes, shape (3,).
        seed: The scene's seed.
        target: Number of the target in the scene; each has random numbers of its own.

    Returns:
        Rows reference, first, second (right-handed, unit), shape (3, 3); precession and rolling phase [rev].
    """
    u = uniforms(seed, "attitude", target, 5)
    if attitude.axis == "velocity":
        reference = np.asarray(velocity_m_s, dtype=np.float64)
    elif attitude.axis == "random":
        z = 2 * u[0] - 1
        ring = np.sqrt(1 - z * z)
        reference = np.array([ring * np.cos(2 * np.pi * u[1]), ring * np.sin(2 * np.pi * u[1]), z])
    else:
        reference = np.asarray(attitude.axis, dtype=np.float64)
    reference = reference / np.abs(reference).max()  # first, so that the squares neither overflow nor vanish
    reference = reference / np.linalg.norm(reference)
    # Any direction well away from the reference gives a stable perpendicular; the seeded angle then turns it.
    spare = np.eye(3)[np.argmin(np.abs(reference))]
    first = np.cross(reference, spare)
    first /= np.linalg.norm(first)
    second = np.cross(reference, first)
    turn = 2 * np.pi * u[2]
    first, second = np.cos(turn) * first + np.sin(turn) * second, np.cos(turn) * second - np.sin(turn) * first
    rolling_phase = float(u[4]) if attitude.rolling_rev_s != 0 else 0.0
    return np.stack([reference, first, second]), float(u[3]), rolling_phase
