"""Targets as bodies in space: the solid of each kind, turned as it is at a few instants."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.plot.figure import INK, new_axes, pair, plain
from warpsim.plot.scenario import checked_time_s, kind_colour, kinds_of_targets, local_frame
from warpsim.quaternion import rotated
from warpsim.scene.scene import Scene
from warpsim.target.areas import top_radius_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

N_INSTANT = 6
"""Drawn where one instant is given, spread over a turn of the slowest motion."""

_N_SECTOR = 24  # facets around a body; a quarter of them is dark, so that spin shows
_LIGHT = np.array([-0.4, 0.6, 0.7])  # of the drawing, from the viewer's upper left: no light of the scene
_CELL = 2.7  # distance of drawn bodies; their half extent is 1


def plot_attitudes(scene: Scene, time_s: float | Sequence[float], ax: Axes | None = None) -> Axes:
    """Draw one target of each kind as a solid, turned as it is at some instants; arrows are the body axes.

    Seen along the cross-track axis of the main target at the first instant: along-track to the right, radial (away
    from the Earth) upwards. Bodies are drawn equally large; a dark quarter of each shows its spin. No light time.

    Args:
        scene: The scene.
        time_s: Instants [s after the epoch]; a single one is the first of six that spread over one turn of the
            slowest motion.
        ax: Where to draw.

    Raises:
        InputError: No instant, or one outside the scene.
    """
    times = _instants(scene, time_s)
    kinds = kinds_of_targets(scene)
    names = [scene.target_names[kind.rows[0]] for kind in kinds]
    ax = ax or new_axes(1.6 + 1.25 * len(times), 1.3 + 1.25 * len(names))
    radial, along, cross = local_frame(scene, times[0])
    to_picture = np.stack([along, radial, -cross])  # right, up, towards the viewer
    for row, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        spec = kind.spec
        turned = to_picture @ body_to_gcrs(scene, name, times)
        for column, rotation in enumerate(turned):
            _draw_body(ax, spec.shape, rotation, np.array([column, -row]) * _CELL, kind_colour(kind))
        words = f"{name}\n{_dimensions(spec.shape)}" + (f"\none of {spec.count}" if spec.count > 1 else "")
        ax.text(-0.62 * _CELL, -row * _CELL, words, ha="right", va="center", fontsize=8)
    start = f"{plain(times[0])} s"
    steps = [start, *(f"{'+' if time >= times[0] else '-'}{plain(abs(time - times[0]), 4)} s" for time in times[1:])]
    for column, step in enumerate(steps):
        ax.text(column * _CELL, -(len(names) - 0.42) * _CELL, step, ha="center", va="top", fontsize=8)
    ax.set(xlim=(-1.75 * _CELL, (len(times) - 0.45) * _CELL), ylim=(-(len(names) - 0.2) * _CELL, 0.6 * _CELL))
    ax.set_aspect("equal")
    ax.set_axis_off()
    axes = f"axes of {scene.target_names[0]} at {start}: along-track to the right, radial upwards"
    ax.set_title(f"{scene.name}: attitudes, a dark quarter marks the turn\n{axes}", fontsize=10)
    return ax


def _instants(scene: Scene, time_s: float | Sequence[float]) -> list[float]:
    if not np.ndim(time_s):
        first = checked_time_s(scene, time_s)  # type: ignore[arg-type]
        rates = [
            abs(getattr(spec.attitude, rate, 0.0))
            for spec in scene.target_specs
            for rate in ("spin_rev_s", "precession_rev_s", "rolling_rev_s")
        ]
        slowest = min((rate for rate in rates if rate > 0), default=0.0)
        span_s = min(1 / slowest if slowest > 0 else np.inf, scene.duration_s - first)
        return [first + span_s * k / N_INSTANT for k in range(N_INSTANT if span_s > 0 else 1)]
    times = [checked_time_s(scene, float(time)) for time in np.ravel(time_s)]
    if not times:
        raise InputError("must hold at least one instant", "time_s")
    return times


def body_to_gcrs(scene: Scene, name: str, time_s: ArrayLike) -> F64:
    """Rotations from a target's body axes to GCRS axes, shape (n, 3, 3); columns are the body's x, y and z."""
    quaternion = scene.attitude_quaternion(name, np.atleast_1d(np.asarray(time_s, np.float64)))
    return np.stack([rotated(quaternion, axis) for axis in np.eye(3)], axis=-1)


def drawn_facets(shape: Any) -> tuple[F64, NDArray[np.int64]]:
    """A body's surface as quadrangles about its middle, their half extent 1 at most, and the sector of each.

    Returns:
        Corners in body axes, shape (n, 4, 3), seen from outside counter-clockwise, a triangle's last one twice; sectors
        0 to 23 about the body axis, shape (n,).
    """
    if shape.kind == "mesh":
        corners = shape.surface.vertices_m[shape.surface.faces][:, [0, 1, 2, 2]]
        corners = corners - (corners.max(axis=(0, 1)) + corners.min(axis=(0, 1))) / 2
    elif shape.kind == "plate":
        return _plate_facets(shape.width_m / 2, shape.length_m / 2)
    else:
        return _turned_facets(_profile(shape))
    corners = corners / np.linalg.norm(corners, axis=-1).max()
    return corners, _sectors(corners)


def _profile(shape: Any) -> F64:
    """Radius and height of the corners of a body of revolution, base to top, about its middle."""
    radius, half = shape.radius_m, getattr(shape, "height_m", 0.0) / 2
    if shape.kind == "sphere":
        angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
        return np.asarray(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.array([[0, -half], [radius, -half], [top_radius_m(shape), half], [0, half]])


def _turned_facets(profile: F64) -> tuple[F64, NDArray[np.int64]]:
    """Facets of a profile turned about z."""
    profile = profile / np.linalg.norm(profile, axis=1).max()
    turn = 2 * np.pi * np.arange(_N_SECTOR + 1) / _N_SECTOR
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    facets, sectors = [], []
    for (r0, z0), (r1, z1) in pairwise(profile):
        if r0 < 1e-12 and r1 < 1e-12:
            continue  # the cone has no upper lid
        for sector in range(_N_SECTOR):
            here, there = ring[sector], ring[sector + 1]
            facets.append([[*(r0 * here), z0], [*(r0 * there), z0], [*(r1 * there), z1], [*(r1 * here), z1]])
            sectors.append(sector)
    return np.array(facets), np.array(sectors)


def _plate_facets(half_width: float, half_length: float) -> tuple[F64, NDArray[np.int64]]:
    """Both faces of a plate, each in quarters: one of them is dark, so that a turn shows."""
    size = np.hypot(half_width, half_length)
    x, y = half_width / size, half_length / size
    facets = []
    for x0, x1 in ((-x, 0), (0, x)):
        for y0, y1 in ((-y, 0), (0, y)):
            facet = [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]]
            facets += [facet, facet[::-1]]
    corners = np.array(facets)
    return corners, _sectors(corners)


def _sectors(corners: F64) -> NDArray[np.int64]:
    """Sector of the middle of each facet."""
    middle = corners.mean(axis=1)
    turn = np.arctan2(middle[:, 1], middle[:, 0]) / (2 * np.pi) % 1.0
    return np.asarray(np.floor(turn * _N_SECTOR), dtype=np.int64) % _N_SECTOR


def _draw_body(ax: Axes, shape: Any, rotation: F64, place: F64, colour: str) -> None:
    """The facets that face the viewer, the near ones over the far ones, shaded, and the body axis."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    corners, sector = drawn_facets(shape)
    turned = corners @ rotation.T
    normal = np.cross(turned[:, 2] - turned[:, 0], turned[:, 3] - turned[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    front = np.flatnonzero(normal[:, 2] > 1e-9)
    front = front[np.argsort(turned[front, :, 2].mean(axis=1), kind="stable")]
    light = 0.55 + 0.45 * np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
    light *= np.where(sector < _N_SECTOR // 4, 0.55, 1.0)
    paint = light[:, None] * (0.35 + 0.65 * np.array(to_rgb(colour)))
    faces = PolyCollection(list(turned[front][:, :, :2] + place), facecolors=paint[front], zorder=2)
    faces.set(edgecolors=paint[front], linewidths=0.4)
    ax.add_collection(faces)
    axis = rotation[:, 2]
    if shape.kind == "sphere":
        begin, end = axis * 1.0, axis * 1.38
    else:
        begin, end = axis * np.abs(corners[..., 2]).max(), axis * 1.38
    arrow = {"arrowstyle": "->", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", pair(end[:2] + place), pair(begin[:2] + place), arrowprops=arrow, zorder=3 if axis[2] > 0 else 1)


def _dimensions(shape: Any) -> str:
    if shape.kind == "mesh":
        return "mesh, " + " x ".join(f"{size:.3g}" for size in np.ptp(shape.surface.vertices_m, axis=0)) + " m"
    if shape.kind == "plate":
        return f"plate, {shape.width_m:g} x {shape.length_m:g} m"
    radius = f"{shape.radius_m:g}" + (f" to {shape.top_radius_m:g}" if shape.kind == "frustum" else "")
    height_m = getattr(shape, "height_m", None)
    return f"{shape.kind}, r {radius} m" + (f", h {height_m:g} m" if height_m else "")
