"""Maps of the sky on plates: square gnomonic grids that touch the sphere, in which a kernel looks up directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RadianceOf = Callable[[Array], Array]
"""From unit vectors (n, 3) to radiances (n_band, n) [W/cm2/sr]."""


@dataclass(frozen=True)
class SkyPlate:
    """A square grid of radiances on the plane that touches the sphere at its centre."""

    axes: Array
    """Rows x, y, centre, (3, 3)."""
    half_width: float
    """Tangent of the angle from the centre to an edge."""
    radiance_w_cm2_sr: Array
    """(n_band, n, n), y along the second axis, x along the third."""

    @property
    def step_rad(self) -> float:
        """Step between nodes at the centre, where it is largest."""
        return float(2 * self.half_width / (self.radiance_w_cm2_sr.shape[-1] - 1))


def plate_directions(axes: Array, half_width: float, n_side: int) -> Array:
    """Unit vectors of the nodes of a plate, (n_side * n_side, 3), row after row."""
    side = np.linspace(-half_width, half_width, n_side)
    x, y = np.meshgrid(side, side)
    seen = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    return np.asarray(seen / np.linalg.norm(seen, axis=1, keepdims=True) @ axes)


def sky_cube(radiance_of: RadianceOf, n_side: int) -> list[SkyPlate]:
    """Six plates that cover the sky, the faces of a cube, filled by a function of directions."""
    plates = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            axes = np.roll(np.eye(3), axis + 1, axis=0) * np.array([[1.0], [1.0], [sign]])
            plates.append(sky_plate(radiance_of, axes, 1.0, n_side))
    return plates


def sky_plate(radiance_of: RadianceOf, axes: Array, half_width: float, n_side: int) -> SkyPlate:
    """One plate, filled by a function of directions."""
    radiance = radiance_of(plate_directions(axes, half_width, n_side))
    return SkyPlate(axes, half_width, radiance.reshape(len(radiance), n_side, n_side))
