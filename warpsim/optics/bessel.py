"""The jinc function 2 J1(v) / v in float64, with NumPy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

ASYMPTOTIC_FROM = 25.0
"""Argument from which Hankel's expansion, cut at N_HANKEL terms, is good to float64 (its last term is below 1e-16)."""
N_HANKEL = 24
N_ANGLE = 16
"""Nodes on a quarter turn: the rule's error is J_64(v), below 1e-17 for v < ASYMPTOTIC_FROM."""


def jinc(v: ArrayLike) -> NDArray[np.float64]:
    """Return 2 J1(v) / v, the amplitude of a uniform circular pupil, of v >= 0; good to 1e-15."""
    v = np.asarray(v, dtype=np.float64)
    near = v < ASYMPTOTIC_FROM
    value = np.empty_like(v)
    value[near] = _jinc_by_poisson_integral(v[near])
    value[~near] = _jinc_by_hankel_expansion(v[~near])
    return value


def _jinc_by_poisson_integral(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Midpoint rule on 2 J1(v)/v = (2/pi) int_0^pi cos(v cos a) sin^2 a da (DLMF 10.9.4 with order 1).

    The integrand is periodic and analytic, so the rule converges exponentially, and there is no division by v.
    """
    angle = (np.arange(N_ANGLE) + 0.5) * (0.5 * np.pi / N_ANGLE)  # the other quarter turn is its mirror image
    total = np.zeros_like(v)
    for cosine, weight in zip(np.cos(angle), 2.0 / N_ANGLE * np.sin(angle) ** 2, strict=True):
        total += weight * np.cos(v * cosine)
    return total


def _jinc_by_hankel_expansion(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hankel's expansion of J1 for a large argument (DLMF 10.17.3), times 2 / v."""
    in_phase, quadrature, term = np.ones_like(v), np.zeros_like(v), np.ones_like(v)
    for k in range(1, N_HANKEL):
        term = term * ((4.0 - (2 * k - 1) ** 2) / (8 * k)) / v
        sign = -1.0 if k % 4 in (2, 3) else 1.0
        if k % 2:
            quadrature += sign * term
        else:
            in_phase += sign * term
    phase = v - 0.75 * np.pi
    return (2.0 / v) * np.sqrt(2.0 / (np.pi * v)) * (in_phase * np.cos(phase) - quadrature * np.sin(phase))


N_I1_ANGLE = 28
"""Nodes on a half turn: the rule's error is exp(-x) I_56(x), below 1e-16 for x < 30."""
I1_ASYMPTOTIC_FROM = 30.0
N_I1_TERM = 18


def scaled_i1_over_x(x: ArrayLike) -> NDArray[np.float64]:
    """Return exp(-x) I1(x) / x, of the modified Bessel function, of x >= 0; relative error below 1e-13."""
    x = np.asarray(x, dtype=np.float64)
    near = x < I1_ASYMPTOTIC_FROM
    value = np.empty_like(x)
    value[near] = _i1_by_poisson_integral(x[near])
    value[~near] = _i1_by_hankel_expansion(x[~near])
    return value


def _i1_by_poisson_integral(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Midpoint rule on I1(x)/x = (1/pi) int_0^pi exp(x cos a) sin^2 a da (DLMF 10.32.2); all terms are positive."""
    angle = (np.arange(N_I1_ANGLE) + 0.5) * (np.pi / N_I1_ANGLE)
    total = np.zeros_like(x)
    for below, weight in zip(np.cos(angle) - 1.0, np.sin(angle) ** 2 / N_I1_ANGLE, strict=True):
        total += weight * np.exp(x * below)
    return total


def _i1_by_hankel_expansion(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Hankel's expansion of I1 for a large argument (DLMF 10.40.1), times exp(-x) / x."""
    total, term = np.ones_like(x), np.ones_like(x)
    for k in range(1, N_I1_TERM):
        term = term * (((2 * k - 1) ** 2 - 4.0) / (8 * k)) / x
        total += term
    return total / (x * np.sqrt(2.0 * np.pi * x))
