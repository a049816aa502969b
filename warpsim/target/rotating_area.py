"""Projected area of rotating bodies towards a distant light: fast rotation averaged, slow rotation sampled.

A body warms over many of its fast turns, so that only the mean over them counts. A turn is fast if the body makes more
than MOST_TURNS_SAMPLED of it in the time span. The mean is taken over phases: those of independent turns on a lattice
(rank 1), those of commensurate turns, as 3 and 1 rev/s are, along their common path. Nearly commensurate turns are
taken for independent ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.quaternion import conjugate, rotated
from warpsim.target.attitude import BodyMotion, turns
from warpsim.target.attitude_table import AttitudeRows
from warpsim.target.temperature import interpolated
from warpsim.target.torque_free import TorqueFreeMotion

MOST_TURNS_SAMPLED = 100.0
"""Most turns of a motion that is sampled in time, not averaged."""

N_ALONG = 4096
"""Phases along one turn, or along the common path of commensurate turns."""
LATTICES = {2: (17_711, (1, 10_946)), 3: (16_381, (1, 1780, 6867))}
"""Points, and multiples of a point's number, of the lattice over 2 (Fibonacci's) or 3 phases (Korobov's)."""

MOST_DENOMINATOR = 16
"""Largest denominator of the ratio of commensurate turns."""
MOST_DRIFT_REV = 0.25
"""Largest drift between commensurate turns in the time span."""

_POINTS_AT_ONCE = 1_000_000
_GRADIENT_STEP_RAD = 1e-3


@dataclass(frozen=True)
class RotatingArea:
    """Bodies of one shape and equal rotation rates, each with its axes and phases."""

    shape: Any
    attitudes: Sequence[BodyMotion] | Sequence[TorqueFreeMotion] | AttitudeRows
    """The motion of each body, all with the same rates; or the table that all turn by."""
    span_s: float
    """Length of the time span [s]."""

    def towards(self, time_s: F64, direction: F64) -> F64:
        """Projected area of each body [m2], (n_body, n_time).

        Args:
            time_s: Times after the epoch [s], (n_time,).
            direction: Unit vectors to the light, GCRS axes, (n_body, n_time, 3).
        """
        if self.shape.kind == "sphere":
            return np.full(direction.shape[:-1], np.pi * self.shape.radius_m**2)
        if isinstance(self.attitudes, AttitudeRows):
            return projected_area_m2(self.shape, rotated(conjugate(self.attitudes.at(time_s)), direction))
        area_m2 = np.empty(direction.shape[:-1])
        step = max(1, _POINTS_AT_ONCE // self._phases.shape[1])
        pairs = np.stack(np.unravel_index(np.arange(area_m2.size), area_m2.shape))
        for start in range(0, area_m2.size, step):
            body, node = pairs[:, start : start + step]
            area_m2[body, node] = self._shown_m2(body, time_s[node], direction[body, node]).mean(axis=-1)
        return area_m2

    @property
    def is_steady(self) -> bool:
        """Return whether the area depends on the light's direction alone, as all motion is averaged."""
        return bool(self._fast) and all(rate == 0 or name in self._fast for name, rate in self._rates.items())

    def swing_m2_s(self, time_s: float, direction: F64) -> F64:
        """Amplitude of the area's time integral about that of its mean, within the slowest fast turn [m2 s].

        Half the range of the area over 2 pi times the rate: that of a sine, which others hardly pass.
        """
        if not self._fast or self.shape.kind == "sphere":
            return np.zeros(len(direction))
        slowest_rev_s = min(abs(self._rates[name]) for name in self._fast)
        range_m2 = [
            np.ptp(self._shown_m2(np.array([body]), np.array([time_s]), direction[body][None]))
            for body in range(len(direction))
        ]
        return np.asarray(range_m2) / 2 / (2 * np.pi * slowest_rev_s)

    @cached_property
    def _rates(self) -> dict[str, float]:
        """Rotation rates that change the projected area [rev/s]."""
        if isinstance(self.attitudes, AttitudeRows):
            return {}
        first = self.attitudes[0]
        if isinstance(first, TorqueFreeMotion):
            return {"precession": first.nutation.precession_rev_s, "nutation": first.nutation.rate_rev_s}
        motion = first.attitude
        rates = {"precession": motion.precession_rev_s, "rolling": motion.rolling_rev_s}
        return rates | ({"spin": motion.spin_rev_s} if self.shape.kind == "mesh" else {})

    @cached_property
    def _fast(self) -> list[str]:
        return [name for name, rate in self._rates.items() if abs(rate) * self.span_s > MOST_TURNS_SAMPLED]

    @cached_property
    def _phases(self) -> F64:
        """Phases of the fast turns to average over [rev], (n_fast, n_point)."""
        rates = [self._rates[name] for name in self._fast]
        if not rates:
            return np.zeros((0, 1))
        steps = commensurate_turns(rates, self.span_s)
        if steps is not None:
            return np.outer(steps, np.arange(N_ALONG) / N_ALONG)
        n_point, multiples = LATTICES[len(rates)]
        return np.outer(multiples, np.arange(n_point)) % n_point / n_point

    def _shown_m2(self, body: npt.NDArray[np.int64], time_s: F64, direction: F64) -> F64:
        """Projected area of bodies at times towards directions, all (n,) and (n, 3), at every phase; (n, n_point)."""
        assert not isinstance(self.attitudes, AttitudeRows)

        def turned_rev(name: str, start_rev: Sequence[float]) -> F64:
            turned = np.array(start_rev)[body][:, None]
            if name in self._fast:
                return np.asarray(turned + self._phases[self._fast.index(name)])
            return np.asarray(turned + turns(self._rates[name], time_s)[:, None] if name in self._rates else turned)

        reference, first, second = np.moveaxis(np.stack([one.axes for one in self.attitudes])[body], 1, 0)
        angles = {
            name: 2 * np.pi * turned_rev(name, [getattr(one, f"{name}_phase_rev", 0.0) for one in self.attitudes])
            for name in ("precession", "rolling", "spin", "nutation")
        }
        # Into body axes: back by precession about the reference, then by the polar angle and by spin
        # (target/attitude.py), or by the nutation (target/torque_free.py).
        x, y, z = (np.einsum("ni,ni->n", direction, axis)[:, None] for axis in (first, second, reference))
        x, y = _turned_back(x, y, angles["precession"])
        motion = self.attitudes[0]
        if isinstance(motion, TorqueFreeMotion):
            inner = motion.nutation.at(angles["nutation"] / (2 * np.pi))
            parts = [np.moveaxis(rotated(inner, axis), -1, 0) for axis in np.eye(3)]
            x, y, z = (x * part[0] + y * part[1] + z * part[2] for part in parts)
        else:
            polar = angles["rolling"] + np.radians(motion.attitude.precession_angle_deg)
            z, x = _turned_back(z, x, polar)
            x, y = _turned_back(x, y, angles["spin"])
        return projected_area_m2(self.shape, np.stack(np.broadcast_arrays(x, y, z), axis=-1))


def _turned_back(a: F64, b: F64, angle: F64) -> tuple[F64, F64]:
    """Components along axes a and b after a rotation of these axes by an angle from a towards b."""
    c, s = np.cos(angle), np.sin(angle)
    return a * c + b * s, b * c - a * s


def projected_area_m2(shape: Any, direction: F64) -> F64:
    """Projected area towards unit vectors in body axes [m2], (..., 3) to (...)."""
    if shape.kind == "mesh":
        return np.asarray(shape.projected_area_along_m2(direction))
    aspect = np.arctan2(np.hypot(direction[..., 0], direction[..., 1]), direction[..., 2])
    return np.asarray(shape.projected_area_m2(aspect))


def commensurate_turns(rates_rev_s: Sequence[float], span_s: float) -> list[int] | None:
    """Whole turns of each motion after which all phases repeat; None if the rates are not commensurate."""
    ratios = [Fraction(rate / rates_rev_s[0]).limit_denominator(MOST_DENOMINATOR) for rate in rates_rev_s]
    for rate, ratio in zip(rates_rev_s, ratios, strict=True):
        if ratio == 0 or abs(rate - float(ratio) * rates_rev_s[0]) * span_s > MOST_DRIFT_REV:
            return None
    common = math.lcm(*(ratio.denominator for ratio in ratios))
    return [int(ratio * common) for ratio in ratios]


@dataclass(frozen=True)
class SteadyArea:
    """Means over fast turns for a light that moves slowly: tabulated along its path, with slopes."""

    node_s: F64
    """Times of nodes after the epoch [s], (n_node,)."""
    direction: F64
    """Direction to the light from the Earth's centre, (n_node, 3)."""
    area_m2: F64
    """Shape (n_body, n_node)."""
    slope_m2: F64
    """Change of the area with the direction, (n_body, 3, n_node)."""

    def towards(self, time_s: F64, direction: F64) -> F64:
        """Projected area as RotatingArea.towards, for directions near those of the nodes."""
        there = interpolated(self.node_s, self.direction.T, time_s)
        slope = interpolated(self.node_s, self.slope_m2, time_s)
        apart = np.moveaxis(direction, -1, 1) - there
        return np.asarray(interpolated(self.node_s, self.area_m2, time_s) + np.sum(slope * apart, axis=1))


def steady_area(area: RotatingArea, n_body: int, node_s: F64, direction: F64) -> SteadyArea:
    """Tabulate the means of a steady RotatingArea at unit vectors to the light, (n_node, 3), at times [s]."""

    def shown_m2(towards: F64) -> F64:
        unit = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        return area.towards(node_s, np.broadcast_to(unit, (n_body, len(node_s), 3)))

    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction[0]))])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    slope = np.zeros((n_body, 3, len(node_s)))
    for tangent in (across, np.cross(direction, across)):
        step = math.tan(_GRADIENT_STEP_RAD) * tangent
        rise = (shown_m2(direction + step) - shown_m2(direction - step)) / (2 * _GRADIENT_STEP_RAD)
        slope += rise[:, None, :] * tangent.T
    return SteadyArea(node_s, direction, shown_m2(direction), slope)
