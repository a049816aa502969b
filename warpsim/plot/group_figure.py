"""Figures of groups: targets about their main one, in that one's local frame, and their attitudes as solid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from warpsim.arrays import F64
from warpsim.directions import normalised, perpendicular
from warpsim.errors import InputError
from warpsim.plot.figure import (
    FAINT,
    GREY,
    INK,
    TargetKind,
    checked_time_s,
    draw_arrow,
    literal,
    new_axes,
    pair,
    plain,
    target_kinds,
)
from warpsim.quaternion import rotated
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.scene.tracks import Tracks
from warpsim.target.areas import has_facets, top_radius_m
from warpsim.target.torque_free import TorqueFree

if TYPE_CHECKING:
    from matplotlib.axes import Axes


N_INSTANT = 6
"""Attitudes drawn where one instant is given, spread over a turn of the slowest motion."""

_AXES = ("radial", "along-track", "cross-track")
_SMALLEST_HALF_M = 1.0  # of the panels: below it the targets are at one point
_N_SECTOR = 24  # facets around a body; a quarter of them is dark, so that spin shows
_LIGHT = np.array([-0.4, 0.6, 0.7])  # of the drawing, from the viewer's upper left: no light of the scene
_CELL = 2.7  # distance of drawn bodies; their half extent is 1


def plot_group(
    scene: Scene | Scenario, time_s: float, axes: Sequence[Axes] | None = None, group: str | None = None
) -> Sequence[Axes]:
    """Draw the positions of a group's targets relative to its main one, in that one's local frame, from three sides.

    Radial is away from the Earth's centre, cross-track along position x velocity, along-track completes them
    (forwards). In a group whose targets have orbits of their own the first one stands for the main one. Absent targets
    are not drawn.

    Args:
        scene: The scene.
        time_s: The instant [s after the epoch].
        axes: Where to draw: along-track and radial, cross-track and radial, along-track and cross-track, in metres or,
            for groups wider than 2 km, kilometres; and, as a fourth, the legend.
        group: Name of the group; the scene's first if left out.

    Returns:
        The axes.

    Raises:
        InputError: Not three or four axes, no such group, or the instant is outside the scene.
    """
    scenario = scenario_of(scene)
    time = checked_time_s(time_s, scenario.scene.duration_s)
    names = scenario.group_names
    if not names:
        raise InputError("must be a group of the scene, which has none", "group", group)
    if group is not None and group not in names:
        raise InputError(f"must be one of {', '.join(names)}", "group", group)
    number = 0 if group is None else names.index(group)
    axes = list(new_axes(8.2, 8.0, 2, 2).flat) if axes is None else axes
    if len(axes) not in (3, 4):
        raise InputError("must be 3 or 4", "axes", len(axes))
    kinds = [kind for kind in target_kinds(scenario) if kind.group == number]
    targets = [target for kind in kinds for target in kind.targets]
    title = f"group about {scenario.target_names[targets[0]]} at {plain(time)} s"
    if scenario.tracks.exist(targets[0], np.array(time)):
        _draw_panels(axes[:3], kinds, dict(zip(targets, group_offsets_m(scenario.tracks, targets, time), strict=True)))
        n_not_deployed = sum(time < scenario.targets[target].release_s for target in targets)
        title += f"\n{n_not_deployed} not deployed" if n_not_deployed else ""
    else:
        _draw_panels(axes[:3], [], {})
        first_s, last_s = scenario.targets[targets[0]].exists_s
        title += f"\nabsent until {plain(first_s)} s" if time < first_s else f"\nabsent since {plain(last_s)} s"
    axes[0].set_title(title, fontsize=10)
    handles, labels = axes[0].get_legend_handles_labels()
    if len(axes) == 4:
        axes[3].set_axis_off()
        if handles:
            axes[3].legend(handles, labels, loc="center", title="targets")
    elif handles:
        axes[0].legend(fontsize=7)
    return axes


def _draw_panels(axes: Sequence[Axes], kinds: Sequence[TargetKind], offsets_m: dict[int, F64]) -> None:
    """Marks of the targets on three axes of one scale."""
    extent_m = float(max((np.abs(offset_m).max() for offset_m in offsets_m.values()), default=0.0))
    unit, per_m = ("km", 1e-3) if extent_m > 2000 else ("m", 1.0)
    half = max(1.12 * per_m * extent_m, _SMALLEST_HALF_M * per_m)
    for ax, (across, up) in zip(axes, ((1, 0), (2, 0), (1, 2)), strict=True):
        for kind in kinds:
            points = per_m * np.stack([offsets_m[target] for target in kind.targets])[:, [across, up]]
            ax.plot(*points.T, label=kind.label, **kind.style)
        ax.axhline(0, color=FAINT, linewidth=0.6, zorder=0)
        ax.axvline(0, color=FAINT, linewidth=0.6, zorder=0)
        ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        if half >= 1e4:
            ax.locator_params(nbins=4)  # their numbers are long
        ax.set(xlabel=f"{_AXES[across]} [{unit}]", ylabel=f"{_AXES[up]} [{unit}]")


def group_offsets_m(tracks: Tracks, targets: Sequence[int], time_s: float) -> F64:
    """Return positions of targets relative to the first: radial, along-track, cross-track [m], shape (n, 3)."""
    states = [tracks.target_state(target, np.array([time_s])) for target in targets]
    position_m = np.concatenate([position for position, _ in states])
    return np.asarray((position_m - position_m[0]) @ local_frame(position_m[0], states[0][1][0]).T)


def local_frame(position_m: F64, velocity_m_s: F64) -> F64:
    """Radial, along-track and cross-track unit vectors of a state as rows, GCRS axes, shape (3, 3)."""
    radial, normal = normalised(position_m), np.cross(position_m, velocity_m_s)
    if np.linalg.norm(normal) < 1e-6 * np.linalg.norm(position_m):  # straight up or down: any cross-track will do
        normal = perpendicular(radial)
    cross = normalised(normal)
    return np.stack([radial, np.cross(cross, radial), cross])


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
    times_s = _instants_s(scenario, time_s)
    kinds = target_kinds(scenario)
    if not kinds:
        raise InputError("must be of a scene with targets").of("plot_attitudes")
    ax = ax or new_axes(1.6 + 1.25 * len(times_s), 1.3 + 1.25 * len(kinds))
    mains = {target.group: index for index, target in reversed(list(enumerate(scenario.targets)))}
    there = [index for _, index in sorted(mains.items()) if scenario.tracks.exist(index, np.array(times_s[0]))]
    reference = (there or [mains[min(mains)]])[0]
    reference_s = float(np.clip(times_s[0], *scenario.targets[reference].exists_s))
    position_m, velocity_m_s = (part[0] for part in scenario.tracks.target_state(reference, np.array([reference_s])))
    radial, along, cross = local_frame(position_m, velocity_m_s)
    to_figure = np.stack([along, radial, -cross])  # right, up, towards the viewer
    for row, kind in enumerate(kinds):
        _draw_row(ax, scenario, kind, row, times_s, to_figure)
    for column, time in enumerate(times_s):
        sign = "+" if time >= times_s[0] else "-"
        step = f"{sign}{plain(abs(time - times_s[0]), 4)} s" if column else f"{plain(time)} s"
        ax.text(column * _CELL, -(len(kinds) - 0.42) * _CELL, step, ha="center", va="top", fontsize=8)
    ax.set(xlim=(-1.75 * _CELL, (len(times_s) - 0.45) * _CELL), ylim=(-(len(kinds) - 0.2) * _CELL, 0.6 * _CELL))
    ax.set_aspect("equal")
    ax.set_axis_off()
    words = f"attitudes, a dark quarter marks the turn\naxes of {scenario.target_names[reference]}"
    words += f" at {plain(reference_s)} s: along-track to the right, radial upwards"
    ax.set_title(f"{literal(scenario.scene.name)}: {words}", fontsize=10)
    return ax


def _instants_s(scenario: Scenario, time_s: float | Sequence[float]) -> list[float]:
    """The given instants, or those spread over a turn of the slowest motion from a single one on."""
    duration_s = scenario.scene.duration_s
    if np.ndim(time_s):
        times_s = [checked_time_s(float(time), duration_s) for time in np.ravel(time_s)]
        if not times_s:
            raise InputError("must hold at least one instant", "time_s")
        return times_s
    first = checked_time_s(time_s, duration_s)  # type: ignore[arg-type]
    motions = ("spin_rev_s", "precession_rev_s", "rolling_rev_s")
    rates = [abs(getattr(target.spec.attitude, name, 0.0)) for target in scenario.targets for name in motions]
    free = [target.spec.attitude for target in scenario.targets if isinstance(target.spec.attitude, TorqueFree)]
    rates += [float(np.linalg.norm(attitude.rates_deg_s)) / 360.0 for attitude in free]
    slowest = min((rate for rate in rates if rate > 0), default=0.0)
    span_s = min(1 / slowest if slowest else np.inf, duration_s - first)
    return [first + span_s * k / N_INSTANT for k in range(N_INSTANT if span_s > 0 else 1)]


def _draw_row(ax: Axes, scenario: Scenario, kind: TargetKind, row: int, times_s: list[float], to_figure: F64) -> None:
    """The first target of a kind at all instants, and words about it."""
    target = kind.targets[0]
    name, shape = scenario.target_names[target], scenario.targets[target].spec.shape
    for column, time in enumerate(times_s):
        centre = np.array([column, -row]) * _CELL
        if scenario.tracks.exist(target, np.array(time)):
            _draw_body(ax, shape, to_figure @ body_to_gcrs(scenario, name, time)[0], centre, kind.colour)
        else:
            ax.text(*pair(centre), "absent", color=GREY, ha="center", va="center", fontsize=8)
    words = f"{name}\n{_dimensions(shape)}" + (f"\none of {len(kind.targets)}" if len(kind.targets) > 1 else "")
    ax.text(-0.62 * _CELL, -row * _CELL, words, ha="right", va="center", fontsize=8)


def body_to_gcrs(scenario: Scenario, name: str, time_s: ArrayLike) -> F64:
    """Return rotations from a target's body axes to GCRS axes, (n, 3, 3); columns are the body's x, y and z."""
    quaternion = scenario.attitude_quaternion(name, np.atleast_1d(np.asarray(time_s, np.float64)))
    return np.stack([rotated(quaternion, axis) for axis in np.eye(3)], axis=-1)


def drawn_facets(shape: Any) -> F64:
    """Return a body's surface as quadrangles about its middle, their half extent 1 at most.

    Corners in body axes, shape (n, 4, 3), seen from outside counter-clockwise, a triangle's last one twice.
    """
    if has_facets(shape):
        corners = shape.surface.vertices_m[shape.surface.faces][:, [0, 1, 2, 2]]
        corners = corners - (corners.max(axis=(0, 1)) + corners.min(axis=(0, 1))) / 2
    elif shape.kind == "plate":  # both faces in quarters: one of them is dark, so that a turn shows
        half = np.array([shape.width_m, shape.length_m, 0.0]) / 2
        quarter = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        upper = half * np.stack([quarter + np.array([x, y, 0]) for x in (-1, 0) for y in (-1, 0)])
        corners = np.concatenate([np.stack([facet, facet[::-1]]) for facet in upper])
    else:
        corners = _turned_facets(*_profile(shape))
    return np.asarray(corners / np.linalg.norm(corners, axis=-1).max())


def _profile(shape: Any) -> tuple[ArrayLike, ArrayLike]:
    """Radii and heights of the corners of a body of revolution, base to top, about its middle [m]."""
    if shape.kind == "sphere":
        angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
        return shape.radius_m * np.cos(angle), shape.radius_m * np.sin(angle)
    half = shape.height_m / 2
    top_m = top_radius_m(shape)
    if top_m == 0:
        return [0, shape.radius_m, 0], [-half, -half, half]
    return [0, shape.radius_m, top_m, 0], [-half, -half, half, half]


def _turned_facets(radius_m: ArrayLike, height_m: ArrayLike) -> F64:
    """Facets of a profile turned about z, shape (n, 4, 3)."""
    turn = 2 * np.pi * np.arange(_N_SECTOR + 1) / _N_SECTOR
    radius, height = np.broadcast_arrays(np.asarray(radius_m)[:, None], np.asarray(height_m)[:, None])
    x, y = radius * np.cos(turn), radius * np.sin(turn)
    points = np.stack([x, y, np.broadcast_to(height, x.shape)], axis=-1)
    corners = np.stack([points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]], axis=2)
    return corners.reshape(-1, 4, 3)


def _draw_body(ax: Axes, shape: Any, rotation: F64, centre: F64, colour: str) -> None:
    """The facets that face the viewer, the near ones over the far ones, shaded, and the body axis."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    corners = drawn_facets(shape)
    turned = corners @ rotation.T
    normal = normalised(np.cross(turned[:, 2] - turned[:, 0], turned[:, 3] - turned[:, 1]))
    front = np.flatnonzero(normal[:, 2] > 1e-9)
    front = front[np.argsort(turned[front, :, 2].mean(axis=1), kind="stable")]
    light = 0.55 + 0.45 * np.clip(normal @ normalised(_LIGHT), 0, 1)
    x, y, _ = corners.mean(axis=1).T
    light *= np.where((x > 0) & (y > 0), 0.55, 1.0)
    paint = light[front, None] * (0.35 + 0.65 * np.array(to_rgb(colour)))
    faces = PolyCollection(list(turned[front][:, :, :2] + centre), facecolors=paint, zorder=2)
    faces.set(edgecolors=paint, linewidths=0.4)
    ax.add_collection(faces)
    axis, top = rotation[:, 2], 1.0 if shape.kind == "sphere" else np.abs(corners[..., 2]).max()
    draw_arrow(ax, centre + top * axis[:2], centre + 1.38 * axis[:2], 3 if axis[2] > 0 else 1,
               arrowstyle="->", color=INK, linewidth=0.9, shrinkA=0, shrinkB=0)  # fmt: skip


def _dimensions(shape: Any) -> str:
    if has_facets(shape):
        return f"{shape.kind}, " + " x ".join(f"{size:.3g}" for size in np.ptp(shape.surface.vertices_m, axis=0)) + " m"
    if shape.kind == "plate":
        return f"plate, {shape.width_m:.4g} x {shape.length_m:.4g} m"
    radius = f"{shape.radius_m:.4g}" + (f" to {shape.top_radius_m:.4g}" if shape.kind == "frustum" else "")
    height_m = getattr(shape, "height_m", None)
    return f"{shape.kind}, r {radius} m" + (f", h {height_m:.4g} m" if height_m else "")
