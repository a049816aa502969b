"""Figure of a whole scene: the Earth, orbits, paths of the groups, and who can observe them at an instant."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import EARTH_GM_M3_S2
from warpsim.plot.drawn_targets import GroupPath, group_paths, observed_targets
from warpsim.plot.figure import (
    BLUE,
    GREEN,
    GREY,
    INK,
    MOST_LABELS,
    N_PATH,
    ORANGE,
    annotate_points,
    checked_time_s,
    new_axes,
    pair,
    plain,
    utc_text,
)
from warpsim.plot.globe import Globe, draw_earth, globe_from
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

SCENE_INCH = (8.2, 9.4)
"""Size of a figure for `plot_scene`: room for a legend of four rows below a square."""

_TILT_DEG = 45.0  # from the plane of the arc to the default viewer: the arc's height and length both show


def plot_scene(
    scene: Scene | Scenario,
    time_s: float | None = None,
    ax: Axes | None = None,
    view_ra_dec_deg: tuple[float, float] | None = None,
) -> Axes:
    """Draw the Earth, the orbits, the paths of the groups, and who can observe their targets at an instant.

    Seen from infinitely far (orthographic), with the Earth's pole upwards; what is behind the Earth is left out, and so
    are targets that are absent. Orbits are the ellipses that the satellites are on at the instant (osculating).
    Satellites with access are green, with their lines of sight; sensors are named where not all of a satellite have it.

    Args:
        scene: The scene.
        time_s: The instant [s after the epoch]; the middle of the scene if left out.
        ax: Where to draw; in thousands of km.
        view_ra_dec_deg: Right ascension and declination of the viewer [deg]; if left out, aside of the middle of the
            first group's flight, on the side of the Sun.

    Raises:
        InputError: The instant is outside the scene, or the viewer's direction is none.
    """
    scenario = scenario_of(scene)
    duration_s = scenario.scene.duration_s
    time = checked_time_s(0.5 * duration_s if time_s is None else time_s, duration_s)
    ax = ax or new_axes(*SCENE_INCH)
    at, paths = np.array([time]), group_paths(scenario)
    sun_m = scenario.position_m("sun", at)[0]
    view = _side_view(scenario, paths) if view_ra_dec_deg is None else view_ra_dec_deg
    globe = globe_from(*view, scenario.tracks.pole_icrs)
    satellites_m = np.stack([scenario.position_m(name, at)[0] for name in scenario.satellite_names])
    observers = _observers(scenario, at)
    has_access = np.array([name in observers for name in scenario.satellite_names])

    draw_earth(ax, globe, sun_m, scenario.epoch, time)
    _draw_orbits(ax, globe, scenario, at)
    _draw_lines_of_sight(ax, globe, scenario, at)
    for path in paths:
        _draw_group_path(ax, globe, scenario, path, time)
    _draw_satellites(ax, globe, satellites_m, has_access)
    _finish_scene(ax, globe, sun_m)
    viewer = f"seen from RA {view[0] % 360:.0f}, dec {view[1]:.0f} deg"
    ax.set_title(f"{scenario.scene.name} at {utc_text(scenario.epoch, time)}\n{viewer}", fontsize=10)
    shown = np.flatnonzero(has_access & ~globe.is_hidden(satellites_m))
    if len(shown) <= MOST_LABELS:
        names = [observers[scenario.satellite_names[number]] for number in shown]
        annotate_points(ax, globe.project(satellites_m[shown]), names, color=GREEN, fontweight="bold", zorder=5.5)
    return ax


def _observers(scenario: Scenario, at: F64) -> dict[str, str]:
    """Labels of the satellites that have a sensor with access: their names, or those of the sensors if not all have."""
    carried: dict[str, list[str]] = {}
    for instrument in scenario.instruments.values():
        for name, satellite in zip(instrument.names, instrument.satellite_names, strict=True):
            carried.setdefault(satellite, []).append(name)
    labels = {}
    for satellite, sensors in carried.items():
        seeing = [name for name in sensors if scenario.has_access(name, at)[0]]
        if seeing:
            labels[satellite] = satellite if len(seeing) == len(sensors) else ", ".join(seeing)
    return labels


def _side_view(scenario: Scenario, paths: list[GroupPath]) -> tuple[float, float]:
    """Right ascension and declination [deg] from which the flight is seen from the side, the Sun behind the viewer."""
    sun_m = scenario.position_m("sun", np.zeros(1))[0]
    if paths:
        start, middle, end = scenario.position_m(scenario.target_names[paths[0].targets[0]], paths[0].time_s(3)) / 1e6
    else:
        start, middle, end = sun_m, sun_m, sun_m
    normal = np.cross(start, end)
    if np.linalg.norm(normal) < 1e-6:  # straight up and down: any side will do
        normal = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
    normal *= np.sign(normal @ sun_m) or 1.0
    tilt = np.radians(_TILT_DEG)
    towards = np.cos(tilt) * middle / np.linalg.norm(middle) + np.sin(tilt) * normal / np.linalg.norm(normal)
    x, y, z = towards
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))


def osculating_ellipse_m(position_m: F64, velocity_m_s: F64, n: int = N_PATH) -> F64:
    """Return points of the two-body ellipse through a state [m], (n, 3); only the state's position if it is none."""
    momentum = np.cross(position_m, velocity_m_s)
    eccentricity = np.cross(velocity_m_s, momentum) / EARTH_GM_M3_S2 - position_m / np.linalg.norm(position_m)
    size = float(np.linalg.norm(eccentricity))
    if size >= 1 or not momentum.any():
        return position_m[None]
    # Angles count from the state itself: a circle's perigee is nowhere.
    first = position_m / np.linalg.norm(position_m)
    second = np.cross(momentum, first) / np.linalg.norm(momentum)
    angle = np.linspace(0, 2 * np.pi, n)[:, None]
    direction = np.cos(angle) * first + np.sin(angle) * second
    radius = momentum @ momentum / EARTH_GM_M3_S2 / (1 + direction @ eccentricity)
    return np.asarray(radius[:, None] * direction)


def _draw_orbits(ax: Axes, globe: Globe, scenario: Scenario, at: F64) -> None:
    from matplotlib.collections import LineCollection

    lines = []
    for name in scenario.satellite_names:
        position, velocity = scenario.tracks.state(name, at)
        lines.append(globe.visible_line(osculating_ellipse_m(position[0], velocity[0])))
    ax.add_collection(LineCollection(lines, colors=BLUE, linewidths=0.6, alpha=0.35, zorder=1, label="orbits"))


def _draw_lines_of_sight(ax: Axes, globe: Globe, scenario: Scenario, at: F64) -> None:
    """Lines from satellites to the targets that one of their sensors has access to, each once."""
    lines: dict[tuple[str, int], None] = {}
    for instrument in scenario.instruments.values():
        for sensor, satellite in enumerate(instrument.satellite_names):
            if instrument.has_access(sensor, at)[0]:
                seen = observed_targets(scenario, instrument, sensor, float(at[0]))
                lines |= dict.fromkeys((satellite, target) for target in seen)
    for satellite, target in lines:
        start_m = scenario.position_m(satellite, at)
        line_m = start_m + np.linspace(0, 1, 101)[:, None] * (scenario.tracks.target_state(target, at)[0] - start_m)
        ax.plot(*globe.visible_line(line_m).T, color=GREEN, linewidth=1.0, zorder=3)


def _draw_group_path(ax: Axes, globe: Globe, scenario: Scenario, path: GroupPath, time_s: float) -> None:
    """Path of a group while it exists, and where it is; the ends of the first group's."""
    many = len(path.targets) > 1
    width, order = 1.2 if many else 2.2 if path.is_first else 1.8, 4.0 if path.is_first else 3.5
    paths_m = [scenario.position_m(scenario.target_names[target], path.time_s(N_PATH)) for target in path.targets]
    for number, path_m in enumerate(paths_m):
        label = None if number else f"flight of {path.label}"
        ax.plot(*globe.visible_line(path_m).T, linewidth=width, zorder=order, label=label, **path.style)
    if path.is_first and not many:
        for number, (mark, name) in enumerate((("o", "start"), ("s", "end"))):
            end_m = paths_m[0][-number]
            if not globe.is_hidden(end_m):
                ax.plot(*globe.project(end_m), mark, color="white", markeredgecolor=path.style["color"], markersize=6,
                        zorder=5, label=f"its {name}, {plain(path.span_s[number])} s")  # fmt: skip
    if not path.exists(time_s):
        return
    names = [scenario.target_names[target] for target in path.targets]
    now_m = np.stack([scenario.position_m(name, np.array([time_s]))[0] for name in names])
    seen_m = now_m[~globe.is_hidden(now_m)]
    if len(seen_m):
        size = 6 if many else 13 if path.is_first else 10
        ax.plot(*globe.project(seen_m).T, "*", color=path.style["color"], markeredgecolor=INK, markersize=size,
                zorder=7, label=f"{path.label} now")  # fmt: skip


def _draw_satellites(ax: Axes, globe: Globe, satellites_m: F64, has_access: NDArray[np.bool_]) -> None:
    """Marks of the satellites that the Earth does not hide, and a word about the others."""
    seen = ~globe.is_hidden(satellites_m)
    xy = globe.project(satellites_m)
    kinds = ((has_access, GREEN, 6.5, "with access"), (~has_access, GREY, 4.5, "without"))
    for chosen, colour, size, words in kinds:
        ax.plot(*xy[seen & chosen].T, "o", color=colour, markersize=size, zorder=6,
                label=f"satellites {words}: {np.count_nonzero(chosen)}")  # fmt: skip
    if not seen.all():
        ax.plot([], [], " ", label=f"{np.count_nonzero(~seen)} of them behind the Earth")


def _finish_scene(ax: Axes, globe: Globe, sun_m: F64) -> None:
    """Limits, the arrow to the Sun, the legend."""
    ax.autoscale_view()
    drawn = [np.ravel(np.asarray(line.get_xydata())) for line in ax.get_lines()]
    drawn += [np.ravel(np.asarray(path.vertices)) for lines in ax.collections for path in lines.get_paths()]
    half = 1.1 * float(np.nanmax(np.abs(np.concatenate(drawn))))
    to_sun = np.array([globe.right, globe.up]) @ (sun_m / np.linalg.norm(sun_m))
    away = float(np.linalg.norm(to_sun))
    if away > 0.02:  # else the Sun is behind the viewer's back, or behind the Earth
        begin, end = to_sun / away * half * 0.86, to_sun / away * half * (0.86 + 0.16 * away)
        arrow = {"arrowstyle": "-|>", "color": ORANGE, "linewidth": 2.2}
        ax.annotate("", pair(end), pair(begin), arrowprops=arrow, zorder=9)
        x, y = pair(begin - to_sun / away * half * 0.055)
        ax.text(x, y, "Sun", color=ORANGE, ha="center", va="center", fontsize=9, fontweight="bold")
    half *= 1.04
    ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel="[1000 km]", ylabel="[1000 km]")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=8, frameon=False)
