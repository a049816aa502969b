"""Distortion of a lens: Brown and Conrady's polynomial, its reach, and its inverse.

All in tangent-plane coordinates of the pinhole, x = X / Z and y = Y / Z in camera axes. Out to a checked radius the
polynomial is the distortion; beyond, it goes on in proportion along each ray from the boresight, so that nothing folds
back into the image and every direction has one position.
"""

from __future__ import annotations

import functools

import numpy as np

from warpsim.arrays import F64
from warpsim.config.fields import Number
from warpsim.config.model import config_model

MARGIN = 1.1
"""The polynomial serves the array and a tenth beyond, counted from the centre."""
SMALLEST_STRETCH = 0.1
"""Within that, no short line may shrink to less than this fraction of its length on the pinhole's image."""
FARTHEST = 4.0
"""The array's corners must look at most so many times as far from the boresight as without distortion, or as near."""

_TINY = 1e-300


@config_model
class Distortion:
    """Brown and Conrady's lens distortion, as OpenCV writes it.

    With r^2 = x^2 + y^2 on the pinhole's tangent plane,
    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),
    y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y.

    Args:
        k1: Radial, of the third power; below 0 is a barrel, above a cushion.
        k2: Radial, of the fifth power.
        k3: Radial, of the seventh power.
        p1: Tangential, along the rows' direction y.
        p2: Tangential, along the columns' direction x.
    """

    k1: Number = 0.0
    k2: Number = 0.0
    k3: Number = 0.0
    p1: Number = 0.0
    p2: Number = 0.0

    @property
    def is_off(self) -> bool:
        """Whether the distortion changes nothing."""
        return not any((self.k1, self.k2, self.k3, self.p1, self.p2))


def polynomial(distortion: Distortion, xy: F64) -> F64:
    """The formula itself, tangent-plane coordinates of shape (..., 2)."""
    x, y = np.moveaxis(xy, -1, 0)
    r2 = x * x + y * y
    radial = 1.0 + r2 * (distortion.k1 + r2 * (distortion.k2 + r2 * distortion.k3))
    p1, p2 = distortion.p1, distortion.p2
    return np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )


def slopes(distortion: Distortion, xy: F64) -> F64:
    """Derivatives of the polynomial, shape (..., 2, 2); symmetric, as it is a gradient."""
    x, y = np.moveaxis(xy, -1, 0)
    r2 = x * x + y * y
    radial = 1.0 + r2 * (distortion.k1 + r2 * (distortion.k2 + r2 * distortion.k3))
    growth = 2.0 * (distortion.k1 + r2 * (2.0 * distortion.k2 + r2 * 3.0 * distortion.k3))
    p1, p2 = distortion.p1, distortion.p2
    across = x * y * growth + 2.0 * (p1 * x + p2 * y)
    along_x = radial + x * x * growth + 2.0 * p1 * y + 6.0 * p2 * x
    along_y = radial + y * y * growth + 6.0 * p1 * y + 2.0 * p2 * x
    return np.stack([np.stack([along_x, across], axis=-1), np.stack([across, along_y], axis=-1)], axis=-2)


@functools.lru_cache(maxsize=64)
def checked_radius(distortion: Distortion, half_x: float, half_y: float) -> tuple[float, str]:
    """Largest radius on the tangent plane that the polynomial serves, and what is wrong with it ("" if nothing).

    The array spans half_x and half_y on the distorted plane. The radius is the smallest whose circle lies wholly
    outside the array and its margin. Derivatives that are positive definite on the disc make a gradient one-to-one
    there; a circle whose image runs around the boresight makes the continuation so.
    """
    corner = MARGIN * float(np.hypot(half_x, half_y))
    radius = corner * np.linspace(0.0, FARTHEST, 513)[1:]
    angle = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    with np.errstate(over="ignore", invalid="ignore"):
        position = polynomial(distortion, radius[:, None, None] * ray)
        slope = slopes(distortion, radius[:, None, None] * ray)
        middle = 0.5 * (slope[..., 0, 0] + slope[..., 1, 1])
        stretch = middle - np.hypot(0.5 * (slope[..., 0, 0] - slope[..., 1, 1]), slope[..., 0, 1])
        turned = np.stack([-ray[:, 1], ray[:, 0]], axis=-1)
        onward = np.einsum("...ij,...j->...i", slope, np.broadcast_to(turned, position.shape))
        turns = position[..., 0] * onward[..., 1] - position[..., 1] * onward[..., 0]
        sound = np.all((stretch >= SMALLEST_STRETCH) & (turns > 0), axis=1)
        outside = np.all(np.abs(position / [half_x, half_y]).max(axis=-1) >= MARGIN, axis=1)
    n_sound = len(radius) if sound.all() else int(np.argmin(sound))
    reached = np.flatnonzero(outside[:n_sound])
    if len(reached) and radius[reached[0]] * FARTHEST >= corner:
        return float(radius[reached[0]]), ""
    if len(reached):
        return 0.0, f"the corners see less than 1/{FARTHEST:g} of the field"
    if n_sound < len(radius):
        return 0.0, f"it folds or shrinks to a tenth at {MARGIN * radius[n_sound] / corner:.3g} half diagonals"
    return 0.0, f"the corners see nothing within {FARTHEST:g} half diagonals"


def distorted(distortion: Distortion, limit: float, seen: F64) -> F64:
    """Vectors in camera axes (..., 3), as the pinhole would have to see them for the same position on the image.

    For all directions of the sphere, behind the camera too; of the same component along the boresight. `limit` is the
    checked radius.
    """
    x, y, z = np.moveaxis(seen, -1, 0)
    scale = np.maximum(np.maximum(z, np.hypot(x, y) / limit), _TINY)[..., None]
    position = scale * polynomial(distortion, seen[..., :2] / scale)
    return np.concatenate([position, z[..., None]], axis=-1)


def undistorted(distortion: Distortion, limit: float, position: F64) -> F64:
    """The inverse on the tangent plane, shape (n, 2): Newton's method with steps halved until they help."""
    xy = position.copy()
    missed = _continued(distortion, limit, xy) - position
    tolerance = 4e-16 * np.linalg.norm(position, axis=-1)  # a residual that is good enough
    for _ in range(100):
        todo = np.flatnonzero(np.linalg.norm(missed, axis=-1) > tolerance)
        if not len(todo):
            break
        step = -np.linalg.solve(_continued_slopes(distortion, limit, xy[todo]), missed[todo][..., None])[..., 0]
        fraction = np.ones(len(todo))
        for _ in range(30):
            trial = xy[todo] + fraction[:, None] * step
            left = _continued(distortion, limit, trial) - position[todo]
            worse = np.linalg.norm(left, axis=-1) >= np.linalg.norm(missed[todo], axis=-1)
            if not worse.any():
                break
            fraction[worse] *= 0.5
        better = todo[~worse]
        xy[better], missed[better] = trial[~worse], left[~worse]
        tolerance[todo[worse]] = np.inf  # rounding is all that is left
    return xy


def _continued(distortion: Distortion, limit: float, xy: F64) -> F64:
    """The polynomial within the checked radius, proportional beyond."""
    beyond = np.maximum(np.linalg.norm(xy, axis=-1, keepdims=True) / limit, 1.0)
    return np.asarray(beyond * polynomial(distortion, xy / beyond))


def _continued_slopes(distortion: Distortion, limit: float, xy: F64) -> F64:
    """Derivatives of _continued: with b = r / limit, b P(x / b) has P' (1 - x x' / r^2) + P x' b / r^2 beyond."""
    r = np.linalg.norm(xy, axis=-1)
    beyond = np.maximum(r / limit, 1.0)[:, None]
    slope = slopes(distortion, xy / beyond)
    outer = np.flatnonzero(r > limit)
    ray = xy[outer] / r[outer, None]
    across = np.eye(2) - ray[:, :, None] * ray[:, None, :]
    along = polynomial(distortion, xy[outer] / beyond[outer])[:, :, None] * ray[:, None, :] / limit
    slope[outer] = slope[outer] @ across + along
    return slope
