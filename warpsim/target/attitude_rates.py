"""Attitude rows with angular velocities: interpolation that keeps both, as rows so dense that slerp follows it.

Between two rows the rotation vector from the first on, in the body's axes, is the cubic (Hermite's) that has the
rotation and the angular velocity of both. What rows miss between them is estimated by the rows alone.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.quaternion import conjugate, in_one_hemisphere, product

SLERP_ERROR_RAD = 1e-7
"""Most that slerp between dense rows may miss the cubic by, ..."""

MOST_ROWS = 200_000
"""... as far as these rows allow."""

LARGEST_MISFIT = 0.25
"""Part of the rotation between rows that angular velocities may miss it by, as long as they are those of the rows."""


def rotation_vector(q: npt.ArrayLike, near: npt.ArrayLike | None = None) -> F64:
    """Return axis times angle of unit quaternions [rad], (n, 3): the shortest, or the one nearest to a vector."""
    quaternion = np.asarray(q, np.float64)
    quaternion = np.where(quaternion[..., 3:] < 0.0, -quaternion, quaternion)
    sine = np.linalg.norm(quaternion[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, quaternion[..., 3:])
    small = sine < 1e-12
    axis = quaternion[..., :3] / np.where(small, 1.0, sine)
    if near is not None:
        wanted = np.asarray(near, np.float64)
        axis = np.where(small, wanted / np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1e-300), axis)
        turns = np.sum(wanted * axis, axis=-1, keepdims=True) - angle
        angle = angle + 2.0 * np.pi * np.round(turns / (2.0 * np.pi))
    return np.where(small & (angle < 1.0), 2.0 * quaternion[..., :3], axis * angle)


def turned_by(vector: npt.ArrayLike) -> F64:
    """Return unit quaternions of rotation vectors [rad], (n, 4)."""
    v = np.asarray(vector, np.float64)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([0.5 * v * np.sinc(half / np.pi), np.cos(half)], axis=-1)


def _vector_rate(vector: F64, rate_rad_s: F64) -> F64:
    """Derivative of a rotation vector whose body turns at an angular velocity in its own axes (Bortz 1971)."""
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    safe = np.where(angle < 1e-3, 1.0, angle)
    factor = np.where(angle < 1e-3, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    once = np.cross(vector, rate_rad_s)
    return np.asarray(rate_rad_s + 0.5 * once + factor * np.cross(vector, once))


def _turned(time_s: F64, quaternion: F64, rate_rad_s: F64) -> tuple[F64, F64]:
    """Rotation vector of each interval, and what it would be by the angular velocities alone, (n - 1, 3) each."""
    expected = 0.5 * np.diff(time_s)[:, None] * (rate_rad_s[1:] + rate_rad_s[:-1])
    return rotation_vector(product(conjugate(quaternion[:-1]), quaternion[1:]), expected), expected


def _cubics(time_s: F64, quaternion: F64, rate_rad_s: F64) -> tuple[F64, F64, F64]:
    """Rotation vector of each interval, and its derivatives per interval at the ends, (n - 1, 3) each."""
    step_s = np.diff(time_s)[:, None]
    whole, _ = _turned(time_s, quaternion, rate_rad_s)
    return whole, step_s * rate_rad_s[:-1], step_s * _vector_rate(whole, rate_rad_s[1:])


def _cubic_at(whole: F64, first: F64, last: F64, part: F64) -> F64:
    """The cubic from 0 to `whole` with these derivatives at its ends."""
    u = part[:, None]
    return np.asarray(u * first + u * u * (3.0 * whole - 2.0 * first - last) + u**3 * (first + last - 2.0 * whole))


def rates_fit(time_s: F64, quaternion: F64, rate_rad_s: F64) -> bool:
    """Return whether angular velocities are those of the rows: in their axes, their unit and their sense."""
    if len(time_s) < 2:
        return True
    whole, expected = _turned(time_s, quaternion, rate_rad_s)
    missed, turned = np.linalg.norm(whole - expected, axis=1), np.linalg.norm(whole, axis=1)
    return bool(np.median(missed) <= LARGEST_MISFIT * np.median(turned) + 1e-6)


def dense_rows(time_s: F64, quaternion: F64, rate_rad_s: F64) -> tuple[F64, F64]:
    """Return rows between which slerp follows the cubics: times (m,), unit quaternions (m, 4) in one hemisphere.

    Args:
        time_s: Ascending times [s], shape (n,).
        quaternion: Unit quaternions, scalar last, body to reference axes, shape (n, 4).
        rate_rad_s: Angular velocities in the body's axes [rad/s], shape (n, 3).
    """
    if len(time_s) < 2:
        return time_s, quaternion
    whole, first, last = _cubics(time_s, quaternion, rate_rad_s)
    curvature = np.stack([6.0 * whole - 4.0 * first - 2.0 * last, 2.0 * first + 4.0 * last - 6.0 * whole])
    bend = np.linalg.norm(curvature, axis=-1).max(axis=0) + 0.5 * np.linalg.norm(np.cross(whole, last - first), axis=-1)
    pieces = np.sqrt(bend / (8.0 * SLERP_ERROR_RAD))
    pieces *= min(1.0, MOST_ROWS / max(float(pieces.sum()), 1.0))
    turned = np.linalg.norm(whole, axis=-1)  # slerp goes the short way
    count = np.ceil(np.maximum(pieces, np.maximum(1.0, turned / 1.5))).astype(np.int64)
    row = np.repeat(np.arange(len(count)), count)
    part = (np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)) / count[row]
    turned_q = turned_by(_cubic_at(whole[row], first[row], last[row], part))
    times = time_s[row] + part * np.diff(time_s)[row]
    rows = np.concatenate([product(quaternion[row], turned_q), quaternion[-1:]])
    return np.append(times, time_s[-1]), in_one_hemisphere(rows)


def row_errors_rad(time_s: F64, quaternion: F64, rate_rad_s: F64 | None) -> F64:
    """Return about how far rows are off half-way between them [rad], (n - 1,); 0 for fewer than three rows.

    Without rates, by how much the body's rate changes from one interval to the next: slerp is off by its derivative
    times step^2 / 8. With them, by how far a row is from the cubic through its neighbours, which is off 16 times more.
    """
    n = len(time_s)
    if n < 3:
        return np.zeros(max(n - 1, 0))
    step_s = np.diff(time_s)
    if rate_rad_s is None:
        mean_rate = rotation_vector(product(conjugate(quaternion[:-1]), quaternion[1:])) / step_s[:, None]
        bend = np.linalg.norm(np.diff(mean_rate, axis=0), axis=-1) / (0.5 * (step_s[1:] + step_s[:-1]))
        bend = np.maximum(np.append(bend, bend[-1]), np.insert(bend, 0, bend[0]))
        return np.asarray(bend * step_s**2 / 8.0)
    missed = np.empty(n - 2)
    for parity in range(2):
        some = slice(parity, None, 2)
        if len(time_s[some]) < 2:
            continue
        whole, first, last = _cubics(time_s[some], quaternion[some], rate_rad_s[some])
        inner = np.arange(parity + 1, n - 1, 2)
        part = (time_s[inner] - time_s[inner - 1]) / (time_s[inner + 1] - time_s[inner - 1])
        there = product(quaternion[inner - 1], turned_by(_cubic_at(whole, first, last, part)))
        missed_by = rotation_vector(product(conjugate(there), quaternion[inner]))
        missed[inner - 1] = np.linalg.norm(missed_by, axis=-1) / 16.0
    return np.asarray(np.fmax(np.append(missed, missed[-1]), np.insert(missed, 0, missed[0])))
