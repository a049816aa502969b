"""Tables of Earth infrared and Earth albedo on bodies, which kernels read, and their errors.

Errors are fractions of limb_sine^2 times the largest projected area (albedo: times pi as well), which no body exceeds
from any side; limb_sine is the Earth's radius over distance from its centre. The first of a pair holds from the ground
up to one Earth's radius above it (NEAR_LIMB_SINE), the second out to the Moon's distance; tests measure them anew.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from warpsim_kernels.earth_albedo import damping, kept_harmonics, step

from warpsim.arrays import F64

NEAR_LIMB_SINE = 0.5

INFRARED_ERRORS = (3e-4, 5e-3)
"""Worst errors of Earth infrared, near the Earth and out to the Moon: those of the sides of cones and cylinders."""

ALBEDO_ERRORS: MappingProxyType[int, tuple[float, float]] = MappingProxyType(
    {4: (1e-2, 5e-2), 8: (4e-3, 3e-2), 12: (2e-3, 2e-2)}
)
"""Degree of albedo's series of harmonics, and its worst errors near the Earth and out to the Moon.

The worst are faces turned straight up or down under a Sun in the zenith, where all harmonics add up.
"""

N_COSINE = 257
N_HEIGHT = {"infrared": 257, "albedo": 97}
N_ZENITH = 193
"""Being linear between nodes costs infrared 5e-5, and albedo 1e-3 of the largest light that a body can have at its
height, below 100 km with the Sun on the horizon, mostly less than 1e-4. The errors above include it."""

RINGS = {4: 4, 8: 6, 12: 8}  # nodes of the rule over rings of the ground: more do not lower the errors
_CROWDING = 4.0  # how near the limb rings crowd: found by trial, from the ground to the Moon
_SPHERE_DEGREE = 60
_SPHERE_NODES = 400


def view_factor(cosine: npt.ArrayLike, limb_sine: npt.ArrayLike) -> F64:
    """View factor of a plane element to the Earth: the part of its hemisphere, weighted by the cosine of incidence.

    Hamilton and Morgan 1952 (NACA TN 2836), configuration P-6; Howell, catalog of view factors, B-43. Written with the
    half-angles of two segments, of a circle and of an ellipse, by arc tangents that keep their digits where the Earth
    touches the element's horizon.

    Args:
        cosine: Of the angle between the element's normal and the nadir.
        limb_sine: Earth's radius over distance from its centre; more than 1 counts as 1. Shapes broadcast.
    """
    c, s = np.broadcast_arrays(np.asarray(cosine, np.float64), np.minimum(np.asarray(limb_sine, np.float64), 1.0))
    k = np.sqrt((1.0 - s) * (1.0 + s))
    q = np.sqrt(np.maximum((s - c) * (s + c), 0.0))
    rising = (np.arctan2(q, k) + c * s * s * np.arctan2(q, -k * c) - k * q) / np.pi
    return np.asarray(np.where(c >= s, c * s * s, np.where(c <= -s, 0.0, rising)))


def table_limb_sines(light: str, least: float) -> F64:
    """Heights of a table as limb_sine, at least some value: even steps of limb_sine - limb_cosine from -1 to 1."""
    steps = np.linspace(-1.0, 1.0, N_HEIGHT[light]) / np.sqrt(2.0)
    return np.asarray(np.clip(np.sin(np.pi / 4 + np.arcsin(steps)), least, 1.0))


@functools.cache
def infrared_table() -> F64:
    """View factors of plane elements, and integrals of max(0, n.view) times them over a unit sphere, over limb_sine^2.

    The sphere's are the convolution of the element's with the cosine of incidence, by Legendre series (Funk and Hecke).

    Returns:
        Shape (2, N_HEIGHT["infrared"], N_COSINE); of an element by the cosine of its normal and the nadir, of a sphere
        by that of view and nadir, from -1 to 1.
    """
    limb_sine = table_limb_sines("infrared", 1e-6)[:, None]
    cosine = np.linspace(-1.0, 1.0, N_COSINE)
    node, weight = np.polynomial.legendre.leggauss(_SPHERE_NODES)
    degree = np.arange(_SPHERE_DEGREE + 1)
    legendre = np.polynomial.legendre.legvander(node, _SPHERE_DEGREE) * weight[:, None] * (degree + 0.5)
    series = view_factor(node, limb_sine) @ legendre * [damping(number) for number in range(_SPHERE_DEGREE + 1)]
    sphere = series @ np.polynomial.legendre.legvander(cosine, _SPHERE_DEGREE).T
    value = np.stack([view_factor(cosine, limb_sine), sphere]) / limb_sine**2
    across, up = np.diff(value, axis=2), np.diff(value, axis=1)
    return np.stack([value[:, :-1, :-1], across[:, :-1], up[:, :, :-1], np.diff(up, axis=2)], axis=3)


def albedo_degree(error: float, limb_sine: float) -> int:
    """Return the degree of the fastest series for Earth albedo whose worst error is at most `error`, or the finest.

    Args:
        error: As a fraction of the largest value that the term has for a body.
        limb_sine: The smallest in the scene.
    """
    far = limb_sine < NEAR_LIMB_SINE
    return next((degree for degree, errors in ALBEDO_ERRORS.items() if errors[far] <= error), max(ALBEDO_ERRORS))


@functools.cache
def albedo_table(degree: int) -> F64:
    """Harmonics of what a plane element receives from sunlit ground, over limb_sine^2 [sr].

    The disc is cut into rings about the nadir, told apart by the zenith angle of the line of sight at the ground: sums
    by Gauss and Legendre in two pieces, which meet at the first ring that the terminator crosses.

    Args:
        degree: The highest, even: one of ALBEDO_ERRORS.

    Returns:
        Shape (N_HEIGHT["albedo"], N_ZENITH, n_harmonic), by the solar zenith angle at the point below, 0 to 180 deg.
    """
    zenith_rad = np.linspace(0.0, np.pi, N_ZENITH)
    s, sun_up = np.meshgrid(table_limb_sines("albedo", 1e-3), np.cos(zenith_rad), indexing="ij")
    past = np.maximum(np.sin(zenith_rad) - s, 0.0)
    crossed = past / np.maximum(np.hypot(sun_up, past), 1e-300)  # cosine of the first ring that the terminator crosses
    edge = np.stack([np.zeros_like(s), crossed, np.where(sun_up > 0.0, 1.0, crossed)])
    piece, row, column = np.nonzero(np.diff(edge, axis=0) > 0.0)
    s, sun_up, sun_across = (values[:, None] for values in (s[row, 0], sun_up[0, column], np.sin(zenith_rad[column])))
    k = np.sqrt((1.0 - s) * (1.0 + s))
    # The variable x crowds rings at the limb, low above the ground: cosine = x (x + near) / (1 + near).
    near = _CROWDING * k / s
    scale = 1.0 + near
    ends = edge[piece[:, None] + [0, 1], row[:, None], column[:, None]]
    ends = 2.0 * scale * ends / np.maximum(near + np.sqrt(near * near + 4.0 * scale * ends), 1e-300)
    low, high = np.split(ends, 2, axis=1)
    node, weight = np.polynomial.legendre.leggauss(RINGS[degree])
    x = low + (high - low) * (1.0 + node) / 2.0
    cosine = np.minimum(x * (x + near) / scale, 1.0)
    sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
    off_nadir = np.sqrt(k * k + s * s * cosine * cosine)  # its cosine
    up, across = cosine * off_nadir + s * sine * sine, sine * (off_nadir - s * cosine)
    solid = weight * (high - low) / 2.0 * (2.0 * x + near) / scale * cosine / off_nadir
    kept = kept_harmonics(degree)
    found = np.zeros((len(kept), len(x)))
    for m, moment in enumerate(_positive_moments(up * sun_up, across * sun_across, degree + 1)):
        light = solid * moment * (s * sine) ** m
        last, q = np.zeros_like(x), np.ones_like(x)
        for n in range(m, degree + 1):
            if (n, m) in kept:
                found[kept.index((n, m))] = _norm(n, m) * np.sum(light * q, axis=1)
            last, q = q, off_nadir * q - step(n, m) * last
    table = np.zeros((N_HEIGHT["albedo"], N_ZENITH, len(kept)))
    for some in (piece == 0, piece == 1):
        table[row[some], column[some]] += found[:, some].T
    return table


def _positive_moments(a: F64, b: F64, n_order: int) -> Iterator[F64]:
    """Integrals of max(0, a + b cos x) cos(m x) over a turn, b >= 0, for m < n_order."""
    half = np.arccos(np.clip(-a / np.maximum(b, 1e-300), -1.0, 1.0))
    sines = [half, *(np.sin(m * half) / m for m in range(1, n_order + 1))]
    for m in range(n_order):
        yield 2.0 * a * sines[m] + b * (sines[m + 1] + sines[abs(m - 1)])


def _norm(degree: int, order: int) -> float:
    """Factor of the integral of light times q_l sin^m cos(m azimuth), A_l included."""
    highest = math.prod(range(1, 2 * degree, 2)) / math.factorial(degree - order)
    ratio = math.factorial(degree - order) / math.factorial(degree + order) * (1 if order == 0 else 2)
    return float(damping(degree) * (2 * degree + 1) / (4.0 * math.pi) * ratio * highest * highest)
