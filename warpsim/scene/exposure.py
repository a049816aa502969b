"""Quadrature in time over an exposure, its error measured on the bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from warpsim.arrays import F64
from warpsim.detector.detectors import Detector
from warpsim.directions import normalised
from warpsim.errors import InputError
from warpsim.legendre import gauss_legendre, series_at, series_matrix
from warpsim.quaternion import conjugate, rotated
from warpsim.scene.groups import TargetSpec
from warpsim.scene.target_histories import AnyAttitude
from warpsim.scene.targets import SceneTarget
from warpsim.target.attitude_table import AttitudeRows
from warpsim.target.patches import patch_areas

NODE_COUNTS = (1, 3, 5, 9, 17, 33, 65, 129, 257, 513, 1025, 2049)
"""Odd, so that one node lies in the middle."""

PROFILE_ERRORS = 10.0
"""Where light moves during the exposure: how much farther off the brightness of an instant may be than its mean. A
pixel sees a stretch of the exposure, over which errors of instants cancel."""

_N_SAMPLE = 400
_INSTANTS = np.linspace(-1.0, 1.0, 41)
"""Where the series of brightness is looked at."""


@dataclass(frozen=True)
class ExposureRule:
    """Gauss-Legendre nodes over an exposure."""

    offset_s: F64
    """From the middle of the exposure [s], (n,)."""
    weight: F64
    """Sum 1, (n,)."""
    error: float
    """Largest error of a mean met, as a fraction of the largest area of the body concerned."""
    profile_error: float
    """The same of an instant's value by the Legendre series through the nodes."""


def exposure_rule(
    detector: Detector,
    targets: Sequence[SceneTarget],
    attitudes: Sequence[AnyAttitude],
    duration_s: float,
    largest_error: float,
) -> ExposureRule:
    """Return the fewest nodes that keep the mean over the exposure within an error.

    Where light moves over the image meanwhile, its brightness from instant to instant counts too, within
    PROFILE_ERRORS times that. A rule is assessed by the next finer one. Brightness changes as bodies turn; what their
    motion along the orbit and their cooling change over a short exposure is linear in time, which any of the rules
    gets exactly. Temperature and shadow are those of the middle.
    """
    exposure_s = detector.exposure_s
    if exposure_s == 0.0 or not targets:
        return ExposureRule(np.zeros(1), np.ones(1), 0.0, 0.0)
    kinds = {target.spec: number for number, target in reversed(list(enumerate(targets)))}
    bodies = [_Sampled(spec, attitudes[number], exposure_s, duration_s) for spec, number in kinds.items()]
    # Where light moves, the range to it changes along the streak too: one node would not show that.
    counts = NODE_COUNTS[1:] if detector.streaks else NODE_COUNTS
    series = [body.series(counts[0]) for body in bodies]
    for count, finer in pairwise(counts):
        better = [body.series(finer) for body in bodies]
        assessed = [_errors(one, other) for one, other in zip(series, better, strict=True)]
        error, profile_error = (max(both) for both in zip(*assessed, strict=True))
        if error <= largest_error and (not detector.streaks or profile_error <= PROFILE_ERRORS * largest_error):
            node, weight = gauss_legendre(count)
            return ExposureRule(0.5 * exposure_s * node, weight, error, profile_error)
        series = better
    raise InputError(
        f"targets must turn less often in it: with {count} instants the mean over {exposure_s:g} s is still "
        f"{error:.0e} off, and instants {profile_error:.0e}, more than lighting.quadrature_error",
        "detector.exposure_s",
    )


def _errors(one: F64, other: F64) -> tuple[float, float]:
    """Largest difference of two series' means, and of their values, as fractions of the largest mean of their kind."""
    largest = np.maximum(other[..., 0].max(axis=1), 1e-300)
    mean = np.abs(one[..., 0] - other[..., 0]).max(axis=1)
    instant = np.abs(series_at(one, _INSTANTS) - series_at(other, _INSTANTS)).max(axis=(1, 2))
    return float((mean / largest).max()), float((instant / largest).max())


class _Sampled:
    """Samples of a body: directions of view and of light, and instants, spread over the scene."""

    def __init__(self, spec: TargetSpec, attitude: AnyAttitude, exposure_s: float, duration_s: float) -> None:
        self._parts, self._attitude = [spec.shape, *patch_areas(spec.shape, spec.patches)], attitude
        self._half_s = 0.5 * exposure_s
        self._middle_s = duration_s * np.mod(0.618034 * np.arange(_N_SAMPLE), 1.0)
        self._view, self._sun = normalised(np.random.default_rng(0).normal(size=(2, _N_SAMPLE, 3)))
        self._span_s = attitude.span_s if isinstance(attitude, AttitudeRows) else (-np.inf, np.inf)

    def series(self, count: int) -> F64:
        """Legendre series over the exposure of projected and reflected areas, (n, n_sample, count); the mean first."""
        offset_s = self._half_s * gauss_legendre(count)[0]
        times_s = np.clip((self._middle_s[:, None] + offset_s).ravel(), *self._span_s)
        turned = conjugate(self._attitude.at(times_s))
        seen, illuminated = (rotated(turned, np.repeat(vectors, count, axis=0)) for vectors in (self._view, self._sun))
        areas = [part.projected_area_along_m2(seen) for part in self._parts]
        areas += [part.reflected_area_m2(seen, illuminated) for part in self._parts]
        return np.asarray(np.stack(areas).reshape(-1, _N_SAMPLE, count) @ series_matrix(count).T)
