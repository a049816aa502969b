"""Figure of ground tracks: the points below satellites and targets on a map of longitude and latitude."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.instant import Instant
from warpsim.orbit.earth import gcrs_to_geodetic
from warpsim.plot.drawn_targets import GroupPath, group_paths
from warpsim.plot.figure import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    MOST_LABELS,
    N_PATH,
    ORANGE,
    SKY_BLUE,
    YELLOW,
    annotate_points,
    new_axes,
    plain,
)
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

_ACCESS_COLOURS = (GREEN, ORANGE, SKY_BLUE, YELLOW)


def plot_ground_tracks(scene: Scene | Scenario, ax: Axes | None = None) -> Axes:
    """Draw the points below the satellites and the targets during the scene, on a map of longitude and latitude.

    Geodetic, WGS84. The part of a satellite's track in which a sensor of it has access is thick: green, or in one
    colour for each kind of sensor, the later kinds within the earlier ones. The rest is thin; dots are at the epoch.
    Targets are drawn while they exist.

    Args:
        scene: The scene.
        ax: Where to draw; in degrees.
    """
    scenario = scenario_of(scene)
    duration_s = scenario.scene.duration_s
    ax = ax or new_axes(11.0, 5.8)
    time_s = np.linspace(0, duration_s, max(N_PATH, int(duration_s / 20) + 1))
    with_access = _draw_access(ax, scenario)
    labels: list[tuple[str, F64]] = []
    for name in sorted(scenario.satellite_names, key=lambda name: name in with_access):
        track = ground_track_deg(scenario.position_m(name, time_s), scenario.epoch, time_s)
        seen = name in with_access
        ax.plot(*track.T, color=BLUE if seen else FAINT, linewidth=0.9, zorder=2 + seen)
        ax.plot(*track[0], ".", color=BLUE if seen else GREY, markersize=6, zorder=2 + seen)
        labels += [(name, track[0])] if seen else []
    paths = group_paths(scenario)
    for path in paths:
        _draw_group_path(ax, scenario, path, len(time_s))
    _draw_legend(ax, scenario, paths)
    ax.set(xlim=(-180, 180), ylim=(-90, 90), xticks=range(-180, 181, 30), yticks=range(-90, 91, 30), aspect="equal")
    ax.set(xlabel="longitude, east [deg]", ylabel="latitude [deg]")
    ax.grid(color="0.85", linewidth=0.6)
    ax.set_axisbelow(True)
    words = f"{plain(duration_s)} s from {scenario.scene.epoch_utc} UTC"
    ax.set_title(f"{scenario.scene.name}: ground tracks over {words}", fontsize=10)
    if len(labels) <= MOST_LABELS:
        annotate_points(
            ax, np.array([point for _, point in labels]), [name for name, _ in labels], color=BLUE, zorder=7
        )
    return ax


def _access_style(scenario: Scenario, kind: int) -> dict[str, Any]:
    """Colour and width of the tracks during access of a kind of sensor; the first is the widest."""
    width = 3.0 + 2.5 * (len(scenario.instruments) - 1 - kind)
    return {"color": _ACCESS_COLOURS[kind % len(_ACCESS_COLOURS)], "linewidth": width, "alpha": 0.75}


def _draw_access(ax: Axes, scenario: Scenario) -> set[str]:
    """Draw the tracks of satellites while their sensors have access; return the names of these satellites."""
    satellites = set()
    for kind, instrument in enumerate(scenario.instruments.values()):
        access = instrument.access
        for row, start_s, end_s in zip(access.row.tolist(), access.start_s, access.end_s, strict=True):
            satellite, time_s = instrument.satellite_names[row], np.linspace(start_s, end_s, N_PATH)
            track = ground_track_deg(scenario.position_m(satellite, time_s), scenario.epoch, time_s)
            ax.plot(*track.T, zorder=4, **_access_style(scenario, kind))
            satellites.add(satellite)
    return satellites


def _draw_group_path(ax: Axes, scenario: Scenario, path: GroupPath, n_time: int) -> None:
    """Tracks of a group's targets while they exist; the ends of the first group's."""
    time_s, order = path.time_s(n_time), 5.0 if path.is_first else 4.5
    for target in path.targets:
        position_m = scenario.position_m(scenario.target_names[target], time_s)
        track = ground_track_deg(position_m, scenario.epoch, time_s)
        ax.plot(*track.T, zorder=order, **_group_path_style(path))
        if path.is_first and len(path.targets) == 1:
            ax.plot(*track[0], "o", color="white", markeredgecolor=path.style["color"], zorder=6)
            ax.plot(*track[-1], "s", color="white", markeredgecolor=path.style["color"], zorder=6)


def _group_path_style(path: GroupPath) -> dict[str, Any]:
    """Colour, dashes and width of the tracks of a group."""
    return {**path.style, "linewidth": 1.2 if len(path.targets) > 1 else 2.4 if path.is_first else 1.8}


def _draw_legend(ax: Axes, scenario: Scenario, paths: list[GroupPath]) -> None:
    entries: list[tuple[str, dict[str, Any]]] = []
    for path in paths:
        ends = ", from o to square" if path.is_first and len(path.targets) == 1 else ""
        entries.append((f"{path.label}{ends}", _group_path_style(path)))
    for kind, name in enumerate(scenario.instruments):
        words = "has access" if len(scenario.instruments) == 1 else f"{name} has access"
        entries.append((words, _access_style(scenario, kind)))
    entries.append(("has access at another time", {"color": BLUE, "linewidth": 0.9}))
    entries.append(("never has access", {"color": FAINT, "linewidth": 0.9}))
    for words, style in entries:
        ax.plot([], [], label=words, **style)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=5, fontsize=8, frameon=False)


def ground_track_deg(position_m: F64, epoch: Instant, time_s: F64) -> F64:
    """Return longitudes (-180 to 180) and latitudes [deg], shape (n, 2), broken by NaN at 180 degrees.

    Args:
        position_m: Geocentric positions, GCRS axes [m], shape (m, 3).
        epoch: The scene's.
        time_s: Their times [s after the epoch], shape (m,).
    """
    lon_deg, lat_deg, _ = gcrs_to_geodetic(position_m, epoch, time_s)
    return broken_at_date_line(lon_deg, lat_deg)


def broken_at_date_line(lon_deg: F64, lat_deg: F64) -> F64:
    """Return a track on the map, (m, 2): where it passes 180 degrees it goes to the edge, on from the other edge."""
    track = np.stack([lon_deg, lat_deg], axis=1)
    jumps = np.flatnonzero(np.abs(np.diff(lon_deg)) > 180)
    inserted = []
    for jump in jumps:
        side = 180.0 if lon_deg[jump] > 0 else -180.0
        after = lon_deg[jump + 1] + 2 * side  # the next longitude, counted on
        fraction = (side - lon_deg[jump]) / (after - lon_deg[jump])
        latitude = lat_deg[jump] + fraction * (lat_deg[jump + 1] - lat_deg[jump])
        inserted.append([[side, latitude], [np.nan, np.nan], [-side, latitude]])
    if not inserted:
        return track
    return np.insert(track, np.repeat(jumps + 1, 3), np.concatenate(inserted), axis=0)
