"""Temperatures of lumped-capacitance nodes that absorb a given power and radiate: C dT/dt = Q(t) - k T^4.

Radau IIA with three stages (order 5, L-stable; Hairer and Wanner, Solving Ordinary Differential Equations II, sections
IV.5 and IV.8), so thin foils, which reach balance within seconds, and heavy bodies take the steps that their
temperature needs. All bodies share one step. The polynomial through the stages gives the rows between steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.target.temperature import HOTTEST_K, interpolated

ERROR_K = 1e-3
"""Largest error of rows and of the interpolation between them [K]."""
MOST_STEPS = 200_000
MOST_RUNS = 8

_STEPS_AHEAD = 16
_POINTS_AT_ONCE = 1_000_000

_ROOT = math.sqrt(6.0)
_C = np.array([(4 - _ROOT) / 10, (4 + _ROOT) / 10, 1.0])
_A = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)
_ERROR = np.array([-13 - 7 * _ROOT, -13 + 7 * _ROOT, -1.0]) / 3  # weights of the embedded third-order estimate
_REAL = 3 + 3 ** (2 / 3) - 3 ** (1 / 3)  # real eigenvalue of the inverse of _A
_TO_POWERS = np.linalg.inv(_C[:, None] ** np.array([1, 2, 3])).T  # stages to coefficients of u, u^2, u^3


@dataclass(frozen=True)
class ThermalNodes:
    """Heating and cooling of several bodies, a lumped-capacitance node each."""

    heating_k_s: Callable[[F64], F64]
    """Absorbed power over heat capacity, (n_time,) to (n_body, n_time) [K/s]."""
    cooling_k3_s: float
    """Power radiated at 1 K over heat capacity [1/(K3 s)]."""

    def rate_k_s(self, heating_k_s: F64, kelvin: F64) -> F64:
        """Change of temperature; below 0 K, where only trial values are, an odd function."""
        return np.asarray(heating_k_s - self.cooling_k3_s * kelvin * np.abs(kelvin) ** 3)

    def slope_s(self, kelvin: F64) -> F64:
        """Derivative of the rate by temperature."""
        return np.asarray(-4 * self.cooling_k3_s * np.abs(kelvin) ** 3)


@dataclass(frozen=True)
class TemperatureHistory:
    """Temperatures of bodies over time."""

    time_s: F64
    """Shape (n_row,)."""
    temperature_k: F64
    """Shape (n_body, n_row)."""
    error_k: float
    """Largest difference between the rows, linear in between, and a computation with half the steps."""


def integrate(
    bodies: ThermalNodes,
    start_k: F64,
    stops_s: Sequence[float],
    longest_s: float,
    error_k: float = ERROR_K,
    most_steps: int = MOST_STEPS,
) -> TemperatureHistory:
    """Integrate temperatures from the first stop to the last.

    Args:
        bodies: Their heating and cooling.
        start_k: Temperatures at the first stop [K], (n_body,).
        stops_s: Ascending times: first, last, and those between at which heating may have a kink [s].
        longest_s: Longest step: shorter pulses of heating may be missed [s].
        error_k: Bound of the measured error [K].
        most_steps: Steps after which to give up.

    Raises:
        InputError: A temperature passes HOTTEST_K, or the error cannot be kept.
    """
    tolerance, limits = 0.3, np.zeros((0, 3))
    errors_k: list[float] = []
    while len(errors_k) < MOST_RUNS and not _stalls(errors_k):
        integrator = _Integrator(bodies, np.asarray(start_k, np.float64), float(stops_s[0]), limits, most_steps)
        for stop_s in stops_s[1:]:
            integrator.advance_to(stop_s, longest_s, tolerance * error_k, 0.5 * error_k)
        history, found = integrator.history()
        if history.error_k <= error_k:
            return history
        errors_k.append(history.error_k)
        # A kink of heating within a step can escape the estimate: where it did, steps are kept short.
        poor = found.within_k > 0.6 * error_k
        if found.carried_k > 0.4 * error_k:
            poor |= found.end_k > 0.03 * found.carried_k
        begin_s, length_s = np.array(integrator.begin_s)[poor], np.array(integrator.length_s)[poor]
        limits = np.concatenate([limits, np.stack([begin_s, begin_s + length_s, length_s / 8], axis=1)])
        if not poor.any():
            tolerance *= 0.1
    raise InputError(
        f"the temperature cannot be integrated within {error_k:g} K, it is {min(errors_k):.3g} K off: heating or "
        "attitude change too unevenly"
    )


def _stalls(errors_k: Sequence[float]) -> bool:
    """Return whether the last two runs have not lowered the error."""
    return len(errors_k) > 2 and min(errors_k[-2:]) > 0.8 * min(errors_k[:-2])


class _Integrator:
    """Integrator that only halves and doubles its step: heating is evaluated for many steps of one length at once.

    `limits` holds begin, end and longest step of times in which steps must be short [s], (n, 3).
    """

    def __init__(self, bodies: ThermalNodes, kelvin: F64, start_s: float, limits: F64, most_steps: int) -> None:
        self.bodies, self.limits, self.most_steps = bodies, limits, most_steps
        self.time_s, self.kelvin = start_s, kelvin
        self.step_s = math.inf
        self.begin_s: list[float] = []
        self.length_s: list[float] = []
        self.begin_k: list[F64] = []
        self.powers: list[F64] = []
        self.n_row: list[int] = []
        self._ahead: dict[tuple[float, float], F64] = {}
        self._heating = bodies.heating_k_s(np.array([start_s]))[:, 0]

    def advance_to(self, stop_s: float, longest_s: float, tolerance_k: float, chord_k: float) -> None:
        """Take steps up to a stop, each a half, quarter, ... of the way to it."""
        way_s, done = stop_s - self.time_s, 0.0
        most = min(self.step_s, longest_s, self._first_step_s()) / way_s
        step_fraction = min(1.0, 2.0 ** math.floor(math.log2(most)))
        start_s = self.time_s
        self._ahead = {}
        while done < 1.0:
            if len(self.begin_s) >= self.most_steps or step_fraction * way_s < 1e-12 * max(1.0, abs(self.time_s)):
                raise InputError(f"the temperature cannot be integrated near {self.time_s:.6g} s: it changes too fast")
            h = step_fraction * way_s
            if self._limit_s(h) < 0.99 * h:
                step_fraction *= 0.5
                continue
            heating = self._heating_of(start_s, way_s, done, step_fraction)
            stage = _stages(self.bodies, heating, h, self.kelvin)
            off_k = math.inf if stage is None else _estimate_k(self.bodies, self._heating, h, self.kelvin, stage)
            if stage is None or not off_k <= tolerance_k:
                step_fraction *= 0.5 if off_k <= 16 * tolerance_k else 0.25
                continue
            self._take(h, stage, chord_k)
            done += step_fraction
            self.time_s, self._heating = (stop_s if done == 1.0 else start_s + done * way_s), heating[:, -1]
            # The estimate grows with the fourth power of the step; a longer step must begin on a multiple of itself.
            twice = 2 * step_fraction
            if off_k < tolerance_k / 24 and 2 * h <= longest_s and done % twice == 0 and done + twice <= 1:
                step_fraction *= 2
        self.step_s = step_fraction * way_s

    def _limit_s(self, h: float) -> float:
        """Longest step allowed within the next h seconds."""
        passed = (self.limits[:, 0] < self.time_s + 0.99 * h) & (self.limits[:, 1] > self.time_s + 0.01 * h)
        return float(self.limits[passed, 2].min(initial=math.inf))

    def _first_step_s(self) -> float:
        """A step that is short against the time in which temperatures settle."""
        slope_s = float(-self.bodies.slope_s(self.kelvin).min())
        return math.inf if self.begin_s or slope_s == 0 else 0.01 / slope_s

    def _heating_of(self, start_s: float, way_s: float, done: float, step_fraction: float) -> F64:
        """Heating at the three stages of a step; computed for some steps ahead."""
        if (done, step_fraction) not in self._ahead:
            begins = done + step_fraction * np.arange(min(_STEPS_AHEAD, round((1.0 - done) / step_fraction)))
            times = start_s + way_s * (begins[:, None] + step_fraction * _C)
            found = self.bodies.heating_k_s(times.ravel()).reshape(-1, len(begins), 3)
            self._ahead = {(begin, step_fraction): found[:, i] for i, begin in enumerate(begins.tolist())}
        return self._ahead[done, step_fraction]

    def _take(self, h: float, stage: F64, chord_k: float) -> None:
        """Record a step and the number of rows that it needs."""
        powers = (stage - self.kelvin[:, None]) @ _TO_POWERS
        curvature = 2 * np.maximum(np.abs(powers[:, 1]), np.abs(powers[:, 1] + 3 * powers[:, 2])).max()
        self.begin_s.append(self.time_s)
        self.length_s.append(h)
        self.begin_k.append(self.kelvin)
        self.powers.append(powers)
        self.n_row.append(max(1, math.ceil(math.sqrt(curvature / (8 * chord_k)))))
        self.kelvin = stage[:, -1]
        if not self.kelvin.max() <= HOTTEST_K:
            raise InputError(f"the temperature passes {HOTTEST_K:g} K near {self.time_s:.6g} s")

    def history(self) -> tuple[TemperatureHistory, _Errors]:
        """Rows of all steps, and their measured errors."""
        n_row = np.array(self.n_row)
        step = np.repeat(np.arange(len(n_row)), n_row)
        part = (np.arange(len(step)) - np.repeat(np.cumsum(n_row) - n_row, n_row)) / n_row[step]
        begin_s, h = np.array(self.begin_s), np.array(self.length_s)
        begin_k, powers = np.stack(self.begin_k, axis=1), np.stack(self.powers, axis=1)
        rows = begin_k[:, step] + np.einsum("bsp,sp->bs", powers[:, step], part[:, None] ** np.array([1, 2, 3]))
        time_s = np.append(begin_s[step] + part * h[step], self.time_s)
        kelvin = np.concatenate([rows, self.kelvin[:, None]], axis=1)
        found = _measured(self.bodies, begin_s, h, begin_k, self.kelvin, time_s, kelvin)
        return TemperatureHistory(time_s, kelvin, float(found.within_k.max()) + found.carried_k), found


@dataclass(frozen=True)
class _Errors:
    """Errors of steps [K], the largest of all bodies."""

    within_k: F64
    """Largest error of rows within each step of exact start, (n_step,)."""
    end_k: F64
    """Error at the end of each step of exact start, (n_step,)."""
    carried_k: float
    """Largest error at the start of a step: errors of earlier ends, damped by the decay of small differences."""


def _measured(bodies: ThermalNodes, begin_s: F64, h: F64, begin_k: F64, end_k: F64, row_s: F64, row_k: F64) -> _Errors:
    """Measure errors: take every step again in two halves, all steps side by side."""
    n_body, n_step = begin_k.shape
    within_k, off = np.empty(n_step), np.append(begin_k[:, 1:], end_k[:, None], axis=1)
    decay = np.empty((n_body, n_step))
    at_once = max(1, _POINTS_AT_ONCE // (3 * n_body))
    for first in range(0, n_step, at_once):
        some = slice(first, min(first + at_once, n_step))
        seen_k, fine_k, decay[:, some] = _halved(bodies, begin_s[some], 0.5 * h[some], begin_k[:, some], row_s, row_k)
        within_k[some] = seen_k
        off[:, some] -= fine_k
    carried, largest_k = np.zeros(n_body), 0.0
    for step in range(n_step):
        carried = carried * decay[:, step] + off[:, step]
        largest_k = max(largest_k, float(np.abs(carried).max()))
    return _Errors(within_k, np.abs(off).max(axis=0), largest_k)


def _halved(
    bodies: ThermalNodes, begin_s: F64, half_s: F64, begin_k: F64, row_s: F64, row_k: F64
) -> tuple[F64, F64, F64]:
    """Take steps in two halves each: errors of rows within each [K], temperatures at its end and decay over it."""
    shape = begin_k.shape
    within_k, exponent, kelvin = np.zeros(shape[1]), np.zeros(shape), begin_k.ravel()
    for start_s in (begin_s, begin_s + half_s):
        times = start_s[:, None] + half_s[:, None] * _C
        heating = bodies.heating_k_s(times.ravel()).reshape(-1, 3)
        stage = _stages(bodies, heating, np.tile(half_s, shape[0]), kelvin)
        if stage is None:
            return np.full(shape[1], math.inf), begin_k, exponent
        straight = interpolated(row_s, row_k, times.ravel()).reshape(-1, 3)
        within_k = np.maximum(within_k, np.abs(straight - stage).reshape(*shape, 3).max(axis=(0, 2)))
        exponent += half_s * bodies.slope_s(stage[:, 1]).reshape(shape)
        kelvin = stage[:, -1]
    return within_k, kelvin.reshape(shape), np.exp(exponent)


def _stages(bodies: ThermalNodes, heating_k_s: F64, h: float | F64, kelvin: F64) -> F64 | None:
    """Return temperatures at the three stages of steps of h [s], (n, 3); None where Newton's method does not settle."""
    length_s = np.broadcast_to(np.asarray(h, np.float64), kelvin.shape)[:, None]
    stage = np.repeat(kelvin[:, None], 3, axis=1)
    for _ in range(12):
        missed = stage - kelvin[:, None] - length_s * (bodies.rate_k_s(heating_k_s, stage) @ _A.T)
        jacobian = np.eye(3) - (length_s * bodies.slope_s(stage))[:, None, :] * _A
        change = np.linalg.solve(jacobian, missed[:, :, None])[:, :, 0]
        stage = stage - change
        largest_k = np.abs(change).max()
        if not largest_k > 1e-9:
            break
    return stage if largest_k <= 1e-9 else None


def _estimate_k(bodies: ThermalNodes, heating_k_s: F64, h: float, kelvin: F64, stage: F64) -> float:
    """Estimated error of a step [K]; filtered once more where it is large, as steps of stiff bodies need."""
    weighted = (stage - kelvin[:, None]) @ _ERROR / h
    divisor = _REAL / h - bodies.slope_s(kelvin)
    off = (bodies.rate_k_s(heating_k_s, kelvin) + weighted) / divisor
    again = (bodies.rate_k_s(heating_k_s, kelvin + off) + weighted) / divisor
    return float(np.minimum(np.abs(off), np.abs(again)).max())
