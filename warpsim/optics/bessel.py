"""Bessel functions of order 1 in float64, with NumPy alone: importing a library's costs more than a table takes.

Small arguments take the midpoint rule on Poisson's integral: the integrand is periodic and analytic, so the rule
converges exponentially, and nothing is divided by the argument. Large ones take Hankel's expansion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from warpsim.arrays import F64

J1_LARGE, N_J1_ANGLE, N_J1_TERM = 25.0, 16, 24
"""Argument from which the expansion serves, its last term being below 1e-16; nodes of the rule on a quarter turn, its
error being J_64(v), below 1e-17; terms."""
I1_LARGE, N_I1_ANGLE, N_I1_TERM = 30.0, 28, 18
"""The same of I1; nodes on a half turn, the error being exp(-x) I_56(x), below 1e-16."""


def jinc(v: F64) -> F64:
    """Return 2 J1(v) / v, the amplitude of a uniform circular pupil, of v >= 0; absolute error below 1e-15."""
    near = v < J1_LARGE
    value = np.empty_like(v)
    # (2 / pi) int_0^pi cos(v cos a) sin^2 a da (DLMF 10.9.4); the other quarter turn is the mirror image.
    small, total = v[near], np.zeros(np.count_nonzero(near))
    angle = (np.arange(N_J1_ANGLE) + 0.5) * (0.5 * np.pi / N_J1_ANGLE)
    for cosine, weight in zip(np.cos(angle), 2.0 / N_J1_ANGLE * np.sin(angle) ** 2, strict=True):
        total += weight * np.cos(small * cosine)
    value[near] = total
    large = v[~near]
    in_phase, quadrature = np.zeros_like(large), np.zeros_like(large)
    for k, term in enumerate(_hankel_terms(large, N_J1_TERM)):  # DLMF 10.17.3
        part = quadrature if k % 2 else in_phase
        part += -term if k % 4 in (2, 3) else term
    phase = large - 0.75 * np.pi
    value[~near] = (
        (2.0 / large) * np.sqrt(2.0 / (np.pi * large)) * (in_phase * np.cos(phase) - quadrature * np.sin(phase))
    )
    return value


def scaled_i1_over_x(x: F64) -> F64:
    """Return exp(-x) I1(x) / x, of the modified Bessel function, of x >= 0; relative error below 1e-13."""
    near = x < I1_LARGE
    value = np.empty_like(x)
    # (1 / pi) int_0^pi exp(x cos a) sin^2 a da (DLMF 10.32.2); all terms are positive.
    small, total = x[near], np.zeros(np.count_nonzero(near))
    angle = (np.arange(N_I1_ANGLE) + 0.5) * (np.pi / N_I1_ANGLE)
    for below, weight in zip(np.cos(angle) - 1.0, np.sin(angle) ** 2 / N_I1_ANGLE, strict=True):
        total += weight * np.exp(small * below)
    value[near] = total
    large = x[~near]
    total = np.zeros_like(large)
    for k, term in enumerate(_hankel_terms(large, N_I1_TERM)):  # DLMF 10.40.1
        total += -term if k % 2 else term
    value[~near] = total / (large * np.sqrt(2.0 * np.pi * large))
    return value


def _hankel_terms(x: F64, n: int) -> Iterator[F64]:
    """Yield the terms a_k(1) / x^k of Hankel's expansions (DLMF 10.17.1)."""
    term = np.ones_like(x)
    for k in range(1, n + 1):
        yield term
        term = term * ((4.0 - (2 * k - 1) ** 2) / (8 * k)) / x
