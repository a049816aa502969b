"""How finely brightness is followed through an exposure: quadrature in time, its error measured on the bodies."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from warpsim.directions import normalised
from warpsim.errors import InputError
from warpsim.quaternion import conjugate, rotated
from warpsim.target.attitude import BodyMotion
from warpsim.target.attitude_table import AttitudeRows

if TYPE_CHECKING:
    from warpsim.scene.scene import Scene
    from warpsim.target.shapes import Shape

F64 = npt.NDArray[np.float64]

NODE_COUNTS = (1, 3, 5, 9, 17, 33, 65, 129, 257, 513, 1025, 2049)
"""Odd, so that one node lies in the middle."""

_N_SAMPLE = 400


@dataclass(frozen=True)
class ExposureRule:
    """Gauss-Legendre nodes over an exposure."""

    offset_s: F64
    """From the middle of the exposure [s], (n,)."""
    weight: F64
    """Sum 1, (n,)."""
    error: float
    """Largest error met, as a share of the largest area of the body concerned."""


def exposure_rule(scene: Scene) -> ExposureRule:
    """The fewest nodes that keep the mean over the exposure within lighting.quadrature_error.

    A rule is judged by the next finer one. Brightness changes as bodies turn; what their motion along the orbit and
    their cooling change over a short exposure is linear in time, which any of the rules gets exactly. Warmth and shadow
    are those of the middle.

    Raises:
        InputError: Bodies turn so often within the exposure that 1025 nodes are too few.
    """
    exposure_s = scene.detector.exposure_s
    if exposure_s == 0.0:
        return ExposureRule(np.zeros(1), np.ones(1), 0.0)
    kinds = {spec: number for number, spec in reversed(list(enumerate(scene.target_specs)))}
    bodies = [_Sampled(spec.shape, scene.attitudes[number], scene) for spec, number in kinds.items()]
    means = [body.means(*_nodes(NODE_COUNTS[0], exposure_s)) for body in bodies]
    for count, finer in pairwise(NODE_COUNTS):
        better = [body.means(*_nodes(finer, exposure_s)) for body in bodies]
        error = max(_largest_share(one, other) for one, other in zip(means, better, strict=True))
        if error <= scene.lighting.quadrature_error:
            return ExposureRule(*_nodes(count, exposure_s), error)
        means = better
    raise InputError(
        f"detector.exposure_s: targets must turn less often in it: with {count} instants the mean over {exposure_s:g} "
        f"s is still {error:.0e} off, more than lighting.quadrature_error"
    )


def _largest_share(one: F64, other: F64) -> float:
    """Largest difference of means, as a share of the largest mean of its kind."""
    return float((np.abs(one - other) / np.maximum(other.max(axis=1, keepdims=True), 1e-300)).max())


def _nodes(count: int, exposure_s: float) -> tuple[F64, F64]:
    x, weight = np.polynomial.legendre.leggauss(count)
    x[count // 2] = 0.0
    return 0.5 * exposure_s * x, 0.5 * weight


class _Sampled:
    """A body seen and lit from directions, and at instants, spread over the scene."""

    def __init__(self, shape: Shape, attitude: BodyMotion | AttitudeRows, scene: Scene) -> None:
        self._shape, self._attitude = shape, attitude
        self._middle_s = scene.duration_s * np.mod(0.618034 * np.arange(_N_SAMPLE), 1.0)
        self._view, self._sun = normalised(np.random.default_rng(0).normal(size=(2, _N_SAMPLE, 3)))
        self._span_s = attitude.span_s if isinstance(attitude, AttitudeRows) else (-np.inf, np.inf)

    def means(self, offset_s: F64, weight: F64) -> F64:
        """Means over the exposure of outline and reflected area, (2, n_sample)."""
        times_s = np.clip((self._middle_s[:, None] + offset_s).ravel(), *self._span_s)
        turned = conjugate(self._attitude.at(times_s))
        seen, lit = (rotated(turned, np.repeat(vectors, len(offset_s), axis=0)) for vectors in (self._view, self._sun))
        areas = np.stack([self._shape.projected_area_along_m2(seen), self._shape.reflected_area_m2(seen, lit)])
        return np.asarray(areas.reshape(2, _N_SAMPLE, -1) @ weight)
