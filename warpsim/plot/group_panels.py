"""Figure of a group: its targets about its main one, in that one's local frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError
from warpsim.plot.drawn_targets import TargetKind, target_kinds
from warpsim.plot.figure import FAINT, checked_time_s, need_matplotlib, plain
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.scene.tracks import Tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

_SMALLEST_HALF_M = 1.0  # of the panels: below it the targets are at one point
_AXES = ("radial", "along-track", "cross-track")


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
    number = group_index(scenario.group_names, group)
    if axes is None:
        need_matplotlib("plot")
        from matplotlib import pyplot as plt

        axes = list(plt.subplots(2, 2, figsize=(8.2, 8), layout="constrained")[1].flat)
    if len(axes) not in (3, 4):
        raise InputError("must be 3 or 4", "axes", len(axes))
    kinds = [kind for kind in target_kinds(scenario) if kind.group == number]
    main = kinds[0].targets[0]
    exists = bool(scenario.tracks.exist(main, np.array(time)))
    offsets_m = {target: np.zeros(3) for kind in kinds for target in kind.targets}
    if exists:
        offsets_m = dict(zip(offsets_m, group_offsets_m(scenario.tracks, list(offsets_m), time), strict=True))
    _draw_panels(axes[:3], kinds if exists else [], offsets_m)
    title = f"group about {scenario.target_names[main]} at {plain(time)} s"
    if not exists:
        first_s, last_s = scenario.targets[main].exists_s
        title += f"\nabsent until {plain(first_s)} s" if time < first_s else f"\nabsent since {plain(last_s)} s"
    n_not_deployed = sum(time < scenario.targets[target].release_s for target in offsets_m) if exists else 0
    axes[0].set_title(title + (f"\n{n_not_deployed} not deployed" if n_not_deployed else ""), fontsize=10)
    handles, labels = axes[0].get_legend_handles_labels()
    if len(axes) == 4:
        axes[3].set_axis_off()
        if handles:
            axes[3].legend(handles, labels, loc="center", title="targets")
    elif handles:
        axes[0].legend(fontsize=7)
    return axes


def group_index(names: Sequence[str], group: str | None) -> int:
    """Return the index of a group, the first for None.

    Args:
        names: Names of the groups.
        group: Name of one of them.

    Raises:
        InputError: There is no such group, or none at all.
    """
    if not names:
        raise InputError("must be a group of the scene, which has none", "group", group)
    if group is not None and group not in names:
        raise InputError(f"must be one of {', '.join(names)}", "group", group)
    return 0 if group is None else names.index(group)


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
        ax.set(xlabel=f"{_AXES[across]} [{unit}]", ylabel=f"{_AXES[up]} [{unit}]")


def group_offsets_m(tracks: Tracks, targets: Sequence[int], time_s: float) -> F64:
    """Return positions of targets relative to the first: radial, along-track, cross-track [m], shape (n, 3).

    Args:
        tracks: Of the scene.
        targets: Indices of the targets.
        time_s: The instant [s after the epoch].
    """
    states = [tracks.target_state(target, np.array([time_s])) for target in targets]
    position_m = np.concatenate([position for position, _ in states])
    return np.asarray((position_m - position_m[0]) @ local_frame(position_m[0], states[0][1][0]).T)


def local_frame(position_m: F64, velocity_m_s: F64) -> F64:
    """Return radial, along-track and cross-track unit vectors of a state as rows, GCRS axes, shape (3, 3)."""
    radial = position_m / np.linalg.norm(position_m)
    normal = np.cross(position_m, velocity_m_s)
    if np.linalg.norm(normal) < 1e-6 * np.linalg.norm(position_m):  # straight up or down: any cross-track will do
        normal = np.cross(radial, np.eye(3)[np.argmin(np.abs(radial))])
    cross = normal / np.linalg.norm(normal)
    return np.stack([radial, np.cross(cross, radial), cross])
