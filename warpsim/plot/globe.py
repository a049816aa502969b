"""The Earth seen from far away: projection of positions on a plane, and their occultation.

matplotlib's own axes in three dimensions have no depth test. Here everything is projected straight onto a plane
(orthographically), and lines are cut where they pass behind the limb of the WGS84 ellipsoid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.directions import normalised, unit_vectors
from warpsim.errors import InputError
from warpsim.instant import Instant
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M, geodetic_to_gcrs_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

SCALE_M = 1e6
"""Drawn as one: the axes are in thousands of km."""

_STRETCH = EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M
_N_SHADE = 241  # pixels across the shaded disc
_DAY, _NIGHT = np.array([0.87, 0.93, 0.98]), np.array([0.55, 0.60, 0.68])


def stretched(vectors: ArrayLike, pole: F64) -> F64:
    """Return vectors (..., 3) in axes stretched along the pole, in which the WGS84 ellipsoid is a sphere."""
    array = np.asarray(vectors, np.float64)
    return np.asarray(array + (array @ pole)[..., None] * pole * (_STRETCH - 1))


@dataclass(frozen=True)
class Globe:
    """A direction from which the Earth is seen, from infinitely far; unit vectors (3,) in GCRS axes."""

    towards: F64
    """From the Earth to the viewer."""
    up: F64
    """Upwards in the drawn plane, perpendicular to towards."""
    pole: F64
    """Axis of the ellipsoid."""

    @property
    def right(self) -> F64:
        """Unit vector to the right in the drawn plane, shape (3,)."""
        return np.asarray(np.cross(self.up, self.towards))

    def project(self, position_m: ArrayLike) -> F64:
        """Return points of the drawn plane [1000 km], shape (..., 2), of positions [m], shape (..., 3)."""
        return np.asarray(np.asarray(position_m, np.float64) @ np.stack([self.right, self.up], axis=1) / SCALE_M)

    def is_hidden(self, position_m: ArrayLike, on_surface: bool = False) -> NDArray[np.bool_]:
        """Return whether the Earth hides positions [m] of shape (..., 3); on its surface their side decides."""
        point, ahead = stretched(position_m, self.pole), normalised(stretched(self.towards, self.pole))
        along = point @ ahead
        across2 = np.sum(point * point, axis=-1) - along * along
        return np.asarray((along < 0) & (on_surface | (across2 < EARTH_EQUATORIAL_RADIUS_M**2)))

    def visible_line(self, path_m: F64, on_surface: bool = False) -> F64:
        """Return the visible parts of a path (n, 3) on the drawn plane [1000 km], shape (m, 2); NaN between them."""
        hidden = self.is_hidden(path_m, on_surface)
        change = np.flatnonzero(hidden[1:] != hidden[:-1])
        start, step = path_m[change], path_m[change + 1] - path_m[change]
        low, high = np.zeros(len(change)), np.ones(len(change))
        for _ in range(40):  # to 1e-12 of a step
            middle = 0.5 * (low + high)
            same = self.is_hidden(start + middle[:, None] * step, on_surface) == hidden[change]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        limb = self.project(start + low[:, None] * step)
        drawn = self.project(path_m)
        drawn[hidden] = np.nan
        # Each crossing adds the point on the limb; the hidden side of it is NaN already.
        return np.asarray(np.insert(drawn, change + 1, limb, axis=0))

    def limb(self, n: int = 361) -> F64:
        """Return the limb of the Earth on the drawn plane [1000 km], shape (n, 2)."""
        ahead = normalised(stretched(self.towards, self.pole))
        first = normalised(np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))]))
        turn = np.linspace(0, 2 * np.pi, n)[:, None]
        circle = EARTH_EQUATORIAL_RADIUS_M * (np.cos(turn) * first + np.sin(turn) * np.cross(ahead, first))
        return self.project(circle + (circle @ self.pole)[:, None] * self.pole * (1 / _STRETCH - 1))

    def normals(self, xy: F64) -> F64:
        """Return unit normals of the surface at points of the drawn plane [1000 km], (..., 2); NaN beside the disc."""
        origin = SCALE_M * (xy[..., :1] * self.right + xy[..., 1:] * self.up)
        point, ahead = stretched(origin, self.pole), stretched(self.towards, self.pole)
        a, b = ahead @ ahead, point @ ahead
        c = np.sum(point * point, axis=-1) - EARTH_EQUATORIAL_RADIUS_M**2
        root = np.sqrt(np.where(b * b >= a * c, b * b - a * c, np.nan))
        # The gradient of |stretched position|2 stretches the pole's part a second time.
        return normalised(stretched(point + ((root - b) / a)[..., None] * ahead, self.pole))


def globe_from(ra_deg: float, dec_deg: float, pole: F64) -> Globe:
    """Return the Earth seen from a direction, with its pole upwards; an InputError if it is no direction."""
    if not (np.isfinite(ra_deg) and abs(dec_deg) <= 90):
        raise InputError(f"must be a right ascension and a declination, got {ra_deg}, {dec_deg}", "view_ra_dec_deg")
    towards = unit_vectors(ra_deg, dec_deg)
    up = pole - (pole @ towards) * towards
    if np.linalg.norm(up) < 1e-6:  # seen along the pole: what lies at the right ascension points downwards
        up = -unit_vectors(ra_deg, 0.0)
        up = up - (up @ towards) * towards
    return Globe(towards, normalised(up), pole)


def draw_earth(ax: Axes, globe: Globe, sun_m: F64, epoch: Instant, time_s: float) -> None:
    """Draw the Earth at an instant: day and night side, meridians and parallels every 30 degrees, the limb."""
    from matplotlib.patches import Polygon

    limb = globe.limb()
    half = 1.01 * np.abs(limb).max(axis=0)
    x, y = (np.linspace(-extent, extent, _N_SHADE) for extent in half)
    points = np.stack(np.meshgrid(x, y), axis=-1)
    # Points beside the disc take the colour of its edge, so that none shines through where it is cut out.
    beyond = np.linalg.norm(points, axis=-1, keepdims=True) / (0.999 * EARTH_POLAR_RADIUS_M / SCALE_M)
    points /= np.maximum(1, beyond)
    sunlight = globe.normals(points) @ normalised(sun_m)
    # A smooth step some 12 degrees wide about the terminator, where the Sun is low or twilight.
    day = np.clip(0.5 + 0.5 * sunlight / 0.1, 0, 1)[..., None]
    colours, extent = day * _DAY + (1 - day) * _NIGHT, (-half[0], half[0], -half[1], half[1])
    image = ax.imshow(colours, origin="lower", extent=extent, interpolation="bilinear", zorder=0.5)
    image.set_clip_path(Polygon(limb, closed=True, transform=ax.transData))
    along_deg, up_deg = np.linspace(-180, 180, 181), np.linspace(-90, 90, 91)
    parallels = [(along_deg, np.full_like(along_deg, latitude)) for latitude in range(-60, 61, 30)]
    meridians = [(np.full_like(up_deg, longitude), up_deg) for longitude in range(-180, 180, 30)]
    for lon_deg, lat_deg in parallels + meridians:
        line = globe.visible_line(geodetic_to_gcrs_m(lon_deg, lat_deg, 0.0, epoch, time_s), on_surface=True)
        ax.plot(*line.T, color="white", linewidth=0.6, zorder=0.6)
    ax.plot(*limb.T, color="0.3", linewidth=0.9, zorder=0.7)
