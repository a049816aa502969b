"""Targets as bodies in space: the solid of each kind, turned as it is at a few instants."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpsim.errors import InputError
from warpsim.plot.drawn_targets import TargetKind, target_kinds
from warpsim.plot.figure import GREY, INK, checked_time_s, new_axes, pair, plain
from warpsim.plot.group_panels import local_frame
from warpsim.quaternion import rotated
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.target.areas import top_radius_m

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

N_INSTANT = 6
"""Drawn where one instant is given, spread over a turn of the slowest motion."""

_N_SECTOR = 24  # facets around a body; a quarter of them is dark, so that spin shows
_LIGHT = np.array([-0.4, 0.6, 0.7])  # of the drawing, from the viewer's upper left: no light of the scene
_CELL = 2.7  # distance of drawn bodies; their half extent is 1


def plot_attitudes(scene: Scene | Scenario, time_s: float | Sequence[float], ax: Axes | None = None) -> Axes:
    """Draw one target of each kind as a solid, turned as it is at some instants; arrows are the body axes.

    Seen along the cross-track axis of a main target at the first instant: along-track to the right, radial (away from
    the Earth) upwards. It is that of the first group that exists then, or else that of the first group when it begins
    or ends to exist. Bodies are drawn equally large; a dark quarter of each shows its spin. No light time. Absent
    targets are not drawn.

    Args:
        scene: The scene.
        time_s: Instants [s after the epoch]; a single one is the first of six that spread over one turn of the
            slowest motion.
        ax: Where to draw.

    Raises:
        InputError: No instant, one outside the scene, or no target.
    """
    scenario = scenario_of(scene)
    times = _instants(scenario, time_s)
    kinds = target_kinds(scenario)
    if not kinds:
        raise InputError("must be of a scene with targets").of("plot_attitudes")
    ax = ax or new_axes(1.6 + 1.25 * len(times), 1.3 + 1.25 * len(kinds))
    reference, reference_s = _reference(scenario, times[0])
    position_m, velocity_m_s = (part[0] for part in scenario.tracks.target_state(reference, np.array([reference_s])))
    radial, along, cross = local_frame(position_m, velocity_m_s)
    to_figure = np.stack([along, radial, -cross])  # right, up, towards the viewer
    for row, kind in enumerate(kinds):
        _draw_row(ax, scenario, kind, row, times, to_figure)
    start = f"{plain(times[0])} s"
    steps = [start, *(f"{'+' if time >= times[0] else '-'}{plain(abs(time - times[0]), 4)} s" for time in times[1:])]
    for column, step in enumerate(steps):
        ax.text(column * _CELL, -(len(kinds) - 0.42) * _CELL, step, ha="center", va="top", fontsize=8)
    ax.set(xlim=(-1.75 * _CELL, (len(times) - 0.45) * _CELL), ylim=(-(len(kinds) - 0.2) * _CELL, 0.6 * _CELL))
    ax.set_aspect("equal")
    ax.set_axis_off()
    axes = f"axes of {scenario.target_names[reference]} at {plain(reference_s)} s: along-track to the right, "
    ax.set_title(f"{scenario.scene.name}: attitudes, a dark quarter marks the turn\n{axes}radial upwards", fontsize=10)
    return ax


def _draw_row(ax: Axes, scenario: Scenario, kind: TargetKind, row: int, times: Sequence[float], to_figure: F64) -> None:
    """The first target of a kind at all instants, and words about it."""
    target = kind.targets[0]
    name, shape = scenario.target_names[target], scenario.targets[target].spec.shape
    for column, time in enumerate(times):
        centre = np.array([column, -row]) * _CELL
        if scenario.tracks.exist(target, np.array(time)):
            rotation = to_figure @ body_to_gcrs(scenario, name, time)[0]
            _draw_body(ax, shape, rotation, centre, kind.colour)
        else:
            ax.text(*pair(centre), "absent", color=GREY, ha="center", va="center", fontsize=8)
    words = f"{name}\n{_dimensions(shape)}" + (f"\none of {len(kind.targets)}" if len(kind.targets) > 1 else "")
    ax.text(-0.62 * _CELL, -row * _CELL, words, ha="right", va="center", fontsize=8)


def _instants(scenario: Scenario, time_s: float | Sequence[float]) -> list[float]:
    duration_s = scenario.scene.duration_s
    if not np.ndim(time_s):
        first = checked_time_s(time_s, duration_s)  # type: ignore[arg-type]
        slowest = min(_rates(scenario), default=0.0)
        span_s = min(1 / slowest if slowest > 0 else np.inf, duration_s - first)
        return [first + span_s * k / N_INSTANT for k in range(N_INSTANT if span_s > 0 else 1)]
    times = [checked_time_s(float(time), duration_s) for time in np.ravel(time_s)]
    if not times:
        raise InputError("must hold at least one instant", "time_s")
    return times


def _rates(scenario: Scenario) -> Iterable[float]:
    """Rates of all motions of all targets [rev/s], without those that are 0."""
    for target in scenario.targets:
        for name in ("spin_rev_s", "precession_rev_s", "rolling_rev_s"):
            rate = abs(getattr(target.spec.attitude, name, 0.0))
            if rate > 0:
                yield rate


def _reference(scenario: Scenario, time_s: float) -> tuple[int, float]:
    """The target whose local frame is drawn in, and the time of it [s]."""
    mains = {target.group: index for index, target in reversed(list(enumerate(scenario.targets)))}
    there = [index for _, index in sorted(mains.items()) if scenario.tracks.exist(index, np.array(time_s))]
    main = (there or [mains[min(mains)]])[0]
    return main, float(np.clip(time_s, *scenario.targets[main].exists_s))


def body_to_gcrs(scenario: Scenario, name: str, time_s: ArrayLike) -> F64:
    """Return rotations from a target's body axes to GCRS axes, (n, 3, 3); columns are the body's x, y and z."""
    quaternion = scenario.attitude_quaternion(name, np.atleast_1d(np.asarray(time_s, np.float64)))
    return np.stack([rotated(quaternion, axis) for axis in np.eye(3)], axis=-1)


def drawn_facets(shape: Any) -> tuple[F64, NDArray[np.int64]]:
    """Return a body's surface as quadrangles about its middle, their half extent 1 at most, and the sector of each.

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


def _draw_body(ax: Axes, shape: Any, rotation: F64, centre: F64, colour: str) -> None:
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
    faces = PolyCollection(list(turned[front][:, :, :2] + centre), facecolors=paint[front], zorder=2)
    faces.set(edgecolors=paint[front], linewidths=0.4)
    ax.add_collection(faces)
    axis = rotation[:, 2]
    if shape.kind == "sphere":
        begin, end = axis * 1.0, axis * 1.38
    else:
        begin, end = axis * np.abs(corners[..., 2]).max(), axis * 1.38
    arrow = {"arrowstyle": "->", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", pair(end[:2] + centre), pair(begin[:2] + centre), arrowprops=arrow, zorder=3 if axis[2] > 0 else 1)


def _dimensions(shape: Any) -> str:
    if shape.kind == "mesh":
        return "mesh, " + " x ".join(f"{size:.3g}" for size in np.ptp(shape.surface.vertices_m, axis=0)) + " m"
    if shape.kind == "plate":
        return f"plate, {shape.width_m:.4g} x {shape.length_m:.4g} m"
    radius = f"{shape.radius_m:.4g}" + (f" to {shape.top_radius_m:.4g}" if shape.kind == "frustum" else "")
    height_m = getattr(shape, "height_m", None)
    return f"{shape.kind}, r {radius} m" + (f", h {height_m:.4g} m" if height_m else "")
