"""Fit of targets' parameters to their light curves: a scan of rates and phases, then Levenberg and Marquardt's method.

Several targets, sensors and kinds of sensors are fitted at once: parameters of one target are shared by its curves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import finite_number, plain_array, whole_number
from warpsim.arrays import F64
from warpsim.errors import InputError
from warpsim.instant import utc_time
from warpsim.render.information import Information, information_of
from warpsim.render.light_curve import LightCurve, checked_sigma

RATE_STEP_REV = 0.125
"""Turns over the span of the data between neighbouring rates of a scan."""

N_PHASE = 16
"""Phases that a scan tries with each rate."""

MOST_SETS = 2_000_000
"""Sets of parameters that a scan may try."""

_SETS_AT_ONCE = 1024
_TOLERANCE = 1e-12
_SAME_TIME_S = 1e-6


@dataclass(frozen=True, repr=False)
class Fit:
    """Parameters of targets that light curves determine."""

    names: list[str]
    """Parameters, as in `cone.precession_rev_s`: those of the curves, behind the name of the target."""
    values: F64
    """Estimates, (n_param,); phases from 0 to 1."""
    information: Information
    """What the data say about them, by the stated errors."""
    chi_square: float
    """Sum of squared residuals over the stated errors; about n_freedom where these and the model are right."""
    n_freedom: int
    """Numbers measured less parameters."""
    converged: bool
    """Whether the search ended at a minimum."""
    at_bound: list[str]
    """Parameters that ended on a bound, as the data ask for it or for more: no errors hold for these."""

    @property
    def degenerate(self) -> str:
        """A line that names the combination of parameters that the data do not determine; empty where they do."""
        return self.information.degenerate

    @property
    def p_value(self) -> float:
        """Chance of a chi-square this large or larger where errors and model are right; NaN without freedom.

        Near 0 the search has ended in a wrong minimum, or errors or model are wrong, `converged` or not.
        """
        from scipy.stats import chi2

        return float(chi2.sf(self.chi_square, self.n_freedom)) if self.n_freedom else float("nan")

    @property
    def covariance(self) -> F64:
        """Covariance of the estimates, (n_param, n_param); InputError where they are degenerate."""
        return self.information.covariance

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of each estimate; InputError where they are degenerate."""
        return self.information.sigma

    def __repr__(self) -> str:
        sigma = None if self.degenerate else self.sigma
        lines = [f"  {n} {self[n]:.8g}" + (f" +- {sigma[n]:.2g}" if sigma else "") for n in self.names]
        end = "" if self.converged else ", not converged"
        head = f"Fit(chi-square {self.chi_square:.6g} of {self.n_freedom}, p {self.p_value:.2g}{end}"
        bound = f"on a bound: {', '.join(self.at_bound)}" if self.at_bound else ""
        return "\n".join([head, *lines, *filter(None, [bound, self.degenerate])]) + ")"

    def __getitem__(self, name: str) -> float:
        if name not in self.names:
            raise InputError(f"must be among {', '.join(self.names)}", "name", name)
        return float(self.values[self.names.index(name)])


@dataclass(frozen=True)
class _Data:
    """One curve with its data; NaN is not measured."""

    curve: LightCurve
    light: F64
    """Measured values, (n,)."""
    sigma: F64
    chosen: npt.NDArray[np.bool_]
    """Which of the curve's numbers are measured, its shape."""
    columns: list[int]
    """Of the curve's parameters among all."""

    def residuals(self, values: F64) -> F64:
        return np.asarray((self.curve(values[self.columns])[self.chosen] - self.light) / self.sigma)

    def weighted_slopes(self, values: F64) -> F64:
        """Jacobian over the errors, (n, n_param of all)."""
        out = np.zeros((len(self.light), len(values)))
        slopes = self.curve.jacobian(values[self.columns])[self.chosen]
        out[:, self.columns] = slopes / self.sigma[:, None]
        return out


class _FlatError(Exception):
    """Ends a search where nothing is left to improve: SciPy's next step of degenerate parameters would be 0 / 0."""


class _Search:
    """A search for the least sum of squares from one start: what it found."""

    def __init__(self, rows: list[_Data], first: F64, bounds: F64) -> None:
        from scipy.optimize import least_squares

        self._rows = rows
        self.values = np.clip(first, *bounds.T)
        self.residual = self.slope = np.zeros(0)
        self._latest = self.values, self.residual
        try:
            found = least_squares(
                self._residuals, self.values, self._slopes, bounds=bounds.T, x_scale="jac", xtol=_TOLERANCE,
                ftol=_TOLERANCE, gtol=None,
            )  # fmt: skip
            self.values, self.residual, self.slope, self.converged = found.x, found.fun, found.jac, bool(found.success)
        except _FlatError:
            self.converged = True
        self.chi_square = float(self.residual @ self.residual)

    def _residuals(self, values: F64) -> F64:
        residual = np.concatenate([row.residuals(values) for row in self._rows])
        self._latest = values.copy(), residual
        return residual

    def _slopes(self, values: F64) -> F64:
        """Jacobian, which is asked for where residuals were found last: at the start and behind each step."""
        slope = np.concatenate([row.weighted_slopes(values) for row in self._rows])
        at, residual = self._latest
        if not np.array_equal(at, values):
            residual = self._residuals(values)
        if not (residual @ slope).any():
            self.values, self.residual, self.slope = values, residual, slope
            raise _FlatError
        return slope


def fit(
    data: Sequence[tuple[LightCurve, npt.ArrayLike, npt.ArrayLike | None]],
    start: Mapping[str, float] | None = None,
    scan: Mapping[str, Any] | None = None,
    n_start: int = 4,
) -> Fit:
    """Fit parameters of targets to light curves, by least squares over stated errors.

    Args:
        data: Light curves with the irradiance measured [W/cm2], of the curve's shape (n_time, n_sensor, n_band), NaN
            where nothing was measured, and its error, of a shape that broadcasts, anything where nothing was measured;
            None is the detector's noise, its shot noise that of the light measured. Phases that curves share must count
            at the same time (epoch and `phase_time_s`).
        start: Values to begin with, by names as in `cone.precession_rev_s`; the scene's own when left out, of the first
            curve that has the parameter.
        scan: Values to try, by name: a list, or for a rate [rev/s] a pair (lowest, highest), between which steps are an
            eighth of a turn over the span of the data; phases of scanned rates are tried too. All combinations of a
            target's are compared with its data, whatever the brightness.
        n_start: How many of the best combinations the fit is begun with, each beside its best neighbour; the best of
            what it finds is returned.

    Raises:
        InputError: Data do not fit their curve or are infinite, phases count at different times, fewer numbers than
            parameters, an unknown name, a value out of bounds, or a scan of too many combinations.
    """
    names, bounds, rows = _rows(data)
    for what, given in (("start", start), ("scan", scan)):
        if not isinstance(given, Mapping | None):
            raise InputError("must be values by name", what, given)
        for name in given or {}:
            if name not in names:
                raise InputError(f"must name parameters among {', '.join(names)}", what, name)
    values = _start(names, bounds, rows, start or {})
    starts = _scanned(names, rows, values, scan, whole_number("n_start", n_start, 1)) if scan else values[None]
    best = min((_Search(rows, first, bounds) for first in starts), key=lambda search: search.chi_square)
    light = best.residual + np.concatenate([row.light / row.sigma for row in rows])
    known = information_of(names, best.slope, light)
    found_at = np.where([name.endswith("_phase_rev") for name in names], best.values % 1.0, best.values)
    near = np.abs(best.values[:, None] - bounds) <= _TOLERANCE * np.maximum(np.abs(bounds), 1.0)
    at_bound = [names[k] for k in np.flatnonzero((near & np.isfinite(bounds)).any(axis=1))]
    n_freedom = len(best.residual) - len(names)
    return Fit(names, found_at, known, best.chi_square, n_freedom, best.converged, at_bound)


def _rows(data: Sequence[Any]) -> tuple[list[str], F64, list[_Data]]:
    """Names of all parameters, their bounds, and the data of each curve."""
    if not isinstance(data, Sequence) or not data:
        raise InputError("must hold at least one light curve", "data")
    bounds: dict[str, F64] = {}
    for number, item in enumerate(data):
        if not (isinstance(item, tuple | list) and len(item) == 3 and isinstance(item[0], LightCurve)):
            raise InputError("must be (LightCurve, irradiance_w_cm2, sigma_w_cm2)", f"data[{number}]")
        curve = item[0]
        for name, pair in zip(curve.parameters, curve.bounds, strict=True):
            own = f"{curve.target}.{name}"
            low, high = bounds.get(own, pair)
            bounds[own] = np.array([max(low, pair[0]), min(high, pair[1])])
    names = list(bounds)
    rows = [_checked(number, item, names) for number, item in enumerate(data)]
    _check_phase_times(rows)
    n_measured = sum(len(row.light) for row in rows)
    if n_measured < len(names):
        raise InputError(f"must hold at least {len(names)} numbers, one for each parameter", "data", n_measured)
    return names, np.array(list(bounds.values())), rows


def _check_phase_times(rows: list[_Data]) -> None:
    """Refuse curves that share a phase of a target but count it at different times."""
    first: dict[str, LightCurve] = {}
    for curve in [row.curve for row in rows]:
        for name in [f"{curve.target}.{own}" for own in curve.parameters if own.endswith("_phase_rev")]:
            other = first.setdefault(name, curve)
            epochs = [utc_time(one.scenario.scene.epoch_utc) for one in (other, curve)]
            apart_s = (epochs[1] - epochs[0]).sec + curve.phase_time_s - other.phase_time_s
            if abs(apart_s) > _SAME_TIME_S:
                both = " and ".join(
                    f"{one.phase_time_s:g} s after {one.scenario.scene.epoch_utc}" for one in (other, curve)
                )
                raise InputError(f"{name} must count at one time in all curves, not at {both}", "data")


def _checked(number: int, item: Any, names: list[str]) -> _Data:
    curve, light, sigma = item
    measured = plain_array(light, "W / cm2", f"data[{number}]")
    shape = (len(curve.time_s), len(curve.sensors), len(curve.bands))
    if measured.shape != shape:
        raise InputError(f"must have the shape of its curve, {shape}", f"data[{number}]", measured.shape)
    if np.isinf(measured).any():
        raise InputError("must be finite, or NaN where nothing was measured", f"data[{number}]")
    chosen = ~np.isnan(measured)
    if sigma is None:
        sigma = curve.sigma_w_cm2(np.nan_to_num(measured))
    elif np.isnan(given := plain_array(sigma, "W / cm2", f"data[{number}]")).any():
        sigma = np.where(chosen, given, 1.0)
    errors = checked_sigma(sigma, shape)
    columns = [names.index(f"{curve.target}.{name}") for name in curve.parameters]
    return _Data(curve, measured[chosen], errors[chosen], chosen, columns)


def _start(names: list[str], bounds: F64, rows: list[_Data], given: Mapping[str, float]) -> F64:
    """Values to begin with, (n_param,)."""
    values = np.zeros(len(names))
    for row in reversed(rows):
        values[row.columns] = row.curve.values
    for name, value in given.items():
        values[names.index(name)] = finite_number(f"start[{name!r}]", value)
    for name, value, (low, high) in zip(names, values, bounds, strict=True):
        if not low <= value <= high:
            raise InputError(f"{name} must be from {low:g} to {high:g}", "start", value, "g")
    return values


def _scanned(names: list[str], rows: list[_Data], values: F64, scan: Mapping[str, Any], n_start: int) -> F64:
    """Best starts of a scan, (2 n_start, n_param), which takes each target for itself."""
    starts = np.tile(values, (2 * n_start, 1))
    for target in dict.fromkeys(row.curve.target for row in rows):
        own = [row for row in rows if row.curve.target == target]
        wanted = {name: scan[name] for name in names if name in scan and name.rpartition(".")[0] == target}
        if wanted:
            axes = _axes(names, own, wanted)
            scanned = [names.index(name) for name in axes]
            starts[:, scanned] = _best_of_grid(own, values, scanned, list(axes.values()), n_start)
    return starts


def _axes(names: list[str], rows: list[_Data], wanted: dict[str, Any]) -> dict[str, F64]:
    """Values to try of each parameter: those given, steps between two rates, phases of such rates."""
    span_s = max(row.curve.time_s.max() for row in rows) - min(row.curve.time_s.min() for row in rows)
    axes: dict[str, F64] = {}
    for name, given in wanted.items():
        if name.endswith("_rev_s") and isinstance(given, tuple) and len(given) == 2:
            low, high = (finite_number(f"scan[{name!r}]", rate) for rate in given)
            n_step = math.ceil(abs(high - low) * max(span_s, 1e-9) / RATE_STEP_REV)
            if n_step > MOST_SETS:
                raise InputError(f"has {n_step:.3g} steps, more than {MOST_SETS:.3g}", f"scan[{name!r}]", given)
            axes[name] = np.linspace(low, high, n_step + 1)
            phase = name.removesuffix("_rev_s") + "_phase_rev"
            if phase in names and phase not in wanted:
                axes[phase] = np.arange(N_PHASE) / N_PHASE
        else:
            axes[name] = np.atleast_1d(plain_array(given, "", f"scan[{name!r}]"))
            if axes[name].ndim != 1 or not axes[name].size:
                raise InputError("must be a list of values", f"scan[{name!r}]", given)
    n_set = int(np.prod([len(axis) for axis in axes.values()], dtype=np.float64))
    if n_set > MOST_SETS:
        raise InputError(f"has {n_set:.3g} combinations, more than {MOST_SETS:.3g}", "scan")
    return axes


def _best_of_grid(rows: list[_Data], values: F64, scanned: list[int], axes: list[F64], n_start: int) -> F64:
    """Return the best combinations of scanned parameters, each with its best neighbour, (2 n_start, n_scanned)."""
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    index = np.stack(np.unravel_index(np.arange(len(grid)), [len(axis) for axis in axes]), axis=-1)
    misfit = np.empty(len(grid))
    for first in range(0, len(grid), _SETS_AT_ONCE):
        some = grid[first : first + _SETS_AT_ONCE]
        sets = np.tile(values, (len(some), 1))
        sets[:, scanned] = some
        misfit[first : first + len(some)] = _misfit(rows, sets)
    found: list[int] = []
    for _ in range(n_start):
        best = int(np.argmin(misfit))
        near = (np.abs(index - index[best]) <= 1).all(axis=1)
        misfit[best] = np.inf
        found += [best, int(np.argmin(np.where(near, misfit, np.inf)))]
        misfit[near] = np.inf
    return np.asarray(grid[found])


def _misfit(rows: list[_Data], sets: F64) -> F64:
    """Chi square of each set with the brightness that fits best, less that without light; (n_set,)."""
    with_data, squared = np.zeros(len(sets)), np.zeros(len(sets))
    for row in rows:
        model = row.curve(sets[:, row.columns])[:, row.chosen] / row.sigma
        with_data += model @ (row.light / row.sigma)
        squared += np.einsum("sn,sn->s", model, model)
    return np.asarray(-(np.maximum(with_data, 0.0) ** 2) / np.maximum(squared, 1e-300))
