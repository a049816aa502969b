"""Rotations as unit quaternions (x, y, z, w): scalar last, Hamilton's product, float64.

A quaternion q turns a vector v into q v q*; `product(a, b)` turns by b first, then by a.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64

SMALL_ANGLE_RAD = 1e-4
"""Below it sin(x) / x is 1 - x**2 / 6 to better than 1e-17."""


def product(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """The rotation b followed by a; shapes (..., 4) that broadcast."""
    ax, ay, az, aw = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bx, by, bz, bw = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def conjugate(q: npt.ArrayLike) -> F64:
    """The inverse rotation of a unit quaternion, shape (..., 4)."""
    return np.asarray(np.asarray(q, dtype=np.float64) * np.array([-1.0, -1.0, -1.0, 1.0]))


def rotated(q: npt.ArrayLike, vector: npt.ArrayLike) -> F64:
    """Vectors turned by unit quaternions; shapes (..., 4) and (..., 3) that broadcast."""
    quaternion = np.asarray(q, dtype=np.float64)
    v = np.asarray(vector, dtype=np.float64)
    axis, scalar = quaternion[..., :3], quaternion[..., 3:]
    twice = 2 * np.cross(axis, v)
    return np.asarray(v + scalar * twice + np.cross(axis, twice))


def unit(q: npt.ArrayLike) -> F64:
    """Quaternions scaled to norm 1, shape (..., 4)."""
    quaternion = np.asarray(q, dtype=np.float64)
    return np.asarray(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True))


def in_one_hemisphere(q: npt.ArrayLike) -> F64:
    """The same rotations with signs such that neighbours have a scalar product >= 0, shape (n, 4)."""
    quaternion = np.asarray(q, dtype=np.float64)
    opposite = np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0
    sign = np.cumprod(np.concatenate([[1.0], np.where(opposite, -1.0, 1.0)]))
    return np.asarray(quaternion * sign[:, None])


def rotation_between_rad(a: npt.ArrayLike, b: npt.ArrayLike) -> F64:
    """Angle of the rotation from a to b [rad], 0 to pi whatever the signs; shapes (..., 4) that broadcast."""
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    near = np.linalg.norm(first - second, axis=-1)
    far = np.linalg.norm(first + second, axis=-1)
    # The arc between unit vectors is 2 atan2(|a - b|, |a + b|), exact for small ones too; a rotation is twice that arc.
    return np.asarray(4 * np.arctan2(np.minimum(near, far), np.maximum(near, far)))


def slerp(a: npt.ArrayLike, b: npt.ArrayLike, part: npt.ArrayLike) -> F64:
    """Between a (part = 0) and b (part = 1) at a constant rate about one axis (Shoemake 1985).

    The scalar products of a and b are >= 0, shapes (..., 4); part has the shape (...).
    """
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    u = np.asarray(part, dtype=np.float64)[..., None]
    arc = 2 * np.arctan2(
        np.linalg.norm(second - first, axis=-1, keepdims=True), np.linalg.norm(second + first, axis=-1, keepdims=True)
    )
    between = first * ((1 - u) * _sinc((1 - u) * arc)) + second * (u * _sinc(u * arc))
    return unit(between)  # the common divisor sinc(arc) drops out


def from_matrix(matrix: npt.ArrayLike) -> F64:
    """Quaternions of rotation matrices that are multiplied from the left to column vectors, shape (..., 3, 3)."""
    m = np.asarray(matrix, dtype=np.float64)
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    trace = diagonal.sum(axis=-1)
    # Row i is 4 q_i times the quaternion, for i = x, y, z, w; the longest keeps the most bits (Shepperd 1978).
    rows = np.empty((*m.shape[:-2], 4, 4))
    rows[..., :3, :3] = m + np.swapaxes(m, -2, -1)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        rows[..., i, i] = 1 + 2 * diagonal[..., i] - trace
        rows[..., i, 3] = rows[..., 3, i] = m[..., k, j] - m[..., j, k]
    rows[..., 3, 3] = 1 + trace
    longest = np.argmax(np.linalg.norm(rows, axis=-1), axis=-1)
    return unit(np.take_along_axis(rows, longest[..., None, None], axis=-2)[..., 0, :])


def _sinc(angle_rad: F64) -> F64:
    """sin(x) / x."""
    small = np.abs(angle_rad) < SMALL_ANGLE_RAD
    safe = np.where(small, 1.0, angle_rad)
    return np.where(small, 1 - angle_rad * angle_rad / 6, np.sin(safe) / safe)
