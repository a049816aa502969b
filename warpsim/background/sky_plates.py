"""Maps of the sky on plates: square gnomonic grids that touch the sphere, in which a kernel looks up directions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from warpsim.arrays import F64

RadianceOf = Callable[[F64], F64]
"""From unit vectors (n, 3) to radiances (n_band, n) [W/cm2/sr]."""


@dataclass(frozen=True)
class SkyPlate:
    """A square grid of radiances on the plane that touches the sphere at its centre."""

    axes: F64
    """Rows x, y, centre, (3, 3)."""
    half_width: float
    """Tangent of the angle from the centre to an edge."""
    radiance_w_cm2_sr: F64
    """(n_band, n, n), y along the second axis, x along the third."""

    @property
    def step_rad(self) -> float:
        """Step between nodes at the centre, where it is largest."""
        return float(2 * self.half_width / (self.radiance_w_cm2_sr.shape[-1] - 1))


MOST_NODES = 4096
"""Nodes along an edge of a plate: 64 MiB of float32 a band."""

MOST_CUBE_NODES = 2049
"""Nodes along an edge of each face of a cube, 0.05 degrees apart: 96 MiB of float32 a band for all six."""

WIDEST_DEG = 90.0
"""Of a map on one plate; a wider one is on a cube."""

_BLOCK = 1 << 20
"""Directions that are looked up at once."""


@dataclass(frozen=True)
class SkyMap:
    """A map that can be looked up in any direction, and where it has light."""

    radiance_of: RadianceOf
    pixel_rad: float
    """Smallest step between its pixels."""
    centre: F64
    """Unit vector of its middle, (3,)."""
    half_angle_rad: float
    """From the centre to its farthest point."""
    size_w_cm2_sr: F64
    """Median and largest radiance of its pixels in each band, (n_band, 2)."""

    def plates(self) -> list[SkyPlate]:
        """One plate or six, with nodes half as far apart as pixels, or as the largest plates allow."""
        step = self.pixel_rad / 2
        if is_wide(self.half_angle_rad):
            return sky_cube(self.radiance_of, int(np.clip(math.ceil(2 / step) + 1, 9, MOST_CUBE_NODES)))
        half_width = math.tan(self.half_angle_rad)
        n_side = 2 * math.ceil(half_width / step) + 1
        if n_side <= MOST_NODES:
            half_width = step * (n_side - 1) / 2  # nodes on the centres of the pixels of an image like the plate
        return [sky_plate(self.radiance_of, axes_about(self.centre), half_width, min(n_side, MOST_NODES))]


def is_wide(half_angle_rad: float) -> bool:
    """Whether a map needs the cube."""
    return half_angle_rad > math.radians(WIDEST_DEG / 2) * (1 + 1e-9)


def node_step_rad(pixel_rad: float, half_angle_rad: float) -> float:
    """Step of the nodes of a map's plates: half a pixel, or what the largest plates allow."""
    finest = 2 / (MOST_CUBE_NODES - 1) if is_wide(half_angle_rad) else 2 * math.tan(half_angle_rad) / (MOST_NODES - 1)
    return max(pixel_rad / 2, finest)


def axes_about(centre: F64) -> F64:
    """Rows x (east), y (north), centre."""
    east = np.cross([0.0, 0.0, 1.0], centre)
    east = east if np.linalg.norm(east) > 1e-6 else np.array([1.0, 0.0, 0.0])
    east /= np.linalg.norm(east)
    return np.array([east, np.cross(centre, east), centre])


def plate_directions(axes: F64, half_width: float, n_side: int) -> F64:
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


def sky_plate(radiance_of: RadianceOf, axes: F64, half_width: float, n_side: int) -> SkyPlate:
    """One plate, filled by a function of directions."""
    directions = plate_directions(axes, half_width, n_side)
    blocks = [radiance_of(directions[first : first + _BLOCK]) for first in range(0, len(directions), _BLOCK)]
    radiance = np.concatenate(blocks, axis=1)
    return SkyPlate(axes, half_width, radiance.reshape(len(radiance), n_side, n_side))
