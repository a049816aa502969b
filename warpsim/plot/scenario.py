"""Pictures of a scenario: the whole scene, ground tracks, and the group about its main target.

Every function draws on axes that are given to it, or else on a new pyplot figure, and returns the axes. All places are
geometric, at one instant, without light time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import EARTH_GM_M3_S2
from warpsim.errors import InputError
from warpsim.orbit.earth import gcrs_to_geodetic
from warpsim.plot.figure import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    MARKERS,
    ORANGE,
    PURPLE,
    SERIES,
    VERMILION,
    need_matplotlib,
    new_axes,
    pair,
    place_labels,
    plain,
    utc_text,
)
from warpsim.plot.globe import Globe, draw_earth, globe_from
from warpsim.scene.parts import TargetSpec
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

F64 = NDArray[np.float64]

MOST_LABELS = 40
"""More names than these are not written into a picture."""

SCENE_INCH = (8.2, 9.4)
"""Of a figure for `plot_scene`: room for a legend of four rows below a square."""

_N_PATH = 361  # points of a drawn path
_SMALLEST_HALF_M = 1.0  # of the group's panels: below it its targets are on one spot
_TILT_DEG = 45.0  # from the plane of the arc to the default viewer: the arc's height and length both show


def plot_scene(
    scene: Scene,
    time_s: float | None = None,
    ax: Axes | None = None,
    view_ra_dec_deg: tuple[float, float] | None = None,
) -> Axes:
    """Draw the Earth, the orbits, the main target's flight, and who can see it at an instant.

    Seen from infinitely far (orthographic), with the Earth's pole upwards; what is behind the Earth is left out.
    Orbits are the ellipses that the satellites are on at the instant (osculating). Satellites with access to the main
    target are green, with their lines of sight.

    Args:
        scene: The scene.
        time_s: The instant [s after the epoch]; the middle of the scene if left out.
        ax: Where to draw; in thousands of km.
        view_ra_dec_deg: Right ascension and declination of the viewer [deg]; if left out, aside of the flight's
            middle, on the side of the Sun.

    Raises:
        InputError: The instant is outside the scene, or the viewer's direction is none.
    """
    time = checked_time_s(scene, 0.5 * scene.duration_s if time_s is None else time_s)
    ax = ax or new_axes(*SCENE_INCH)
    at = np.array([time])
    main = scene.target_names[0]
    sun_m = scene.position_m("sun", at)[0]
    pole = scene.tracks.pole_icrs
    view = _side_view(scene) if view_ra_dec_deg is None else view_ra_dec_deg
    globe = globe_from(*view, pole)
    sensors_m = np.stack([scene.position_m(name, at)[0] for name in scene.sensor_names])
    flight_m = scene.position_m(main, np.linspace(0, scene.duration_s, _N_PATH))
    target_m = scene.position_m(main, at)[0]
    has_access = np.array([bool(scene.has_access(name, at)[0]) for name in scene.sensor_names])

    draw_earth(ax, globe, sun_m, scene.epoch, time)
    _draw_orbits(ax, globe, scene, at)
    for sensor_m in sensors_m[has_access]:
        sight = sensor_m + np.linspace(0, 1, 101)[:, None] * (target_m - sensor_m)
        ax.plot(*globe.visible_line(sight).T, color=GREEN, linewidth=1.0, zorder=3)
    ax.plot(*globe.visible_line(flight_m).T, color=VERMILION, linewidth=2.2, zorder=4, label=f"flight of {main}")
    for other in scene.groups_of_targets[1:]:
        path_m = scene.position_m(other.names[0], np.linspace(0, scene.duration_s, _N_PATH))
        ax.plot(*globe.visible_line(path_m).T, color=PURPLE, linewidth=1.8, zorder=3.5,
                label=f"flight of {other.names[0]}")  # fmt: skip
    for number, (mark, name) in enumerate((("o", "start"), ("s", "end"))):
        end_m = flight_m[-number]
        if not globe.is_hidden(end_m):
            ax.plot(*globe.project(end_m), mark, color="white", markeredgecolor=VERMILION, markersize=6, zorder=5,
                    label=f"its {name}, {plain(number * scene.duration_s)} s")  # fmt: skip
    if not globe.is_hidden(target_m):
        ax.plot(*globe.project(target_m), "*", color=VERMILION, markeredgecolor=INK, markersize=13, zorder=7,
                label=f"{main} now")  # fmt: skip
    _draw_satellites(ax, globe, scene, sensors_m, has_access)
    _finish_scene(ax, globe, scene, sun_m, view, time)
    shown = np.flatnonzero(has_access & ~globe.is_hidden(sensors_m))
    if len(shown) <= MOST_LABELS:
        names = [scene.sensor_names[number] for number in shown]
        place_labels(ax, globe.project(sensors_m[shown]), names, color=GREEN, fontweight="bold", zorder=5.5)
    return ax


def _side_view(scene: Scene) -> tuple[float, float]:
    """Right ascension and declination [deg] from which the flight is seen from the side, the Sun behind the viewer."""
    halves_s = np.array([0.0, 0.5, 1.0]) * scene.duration_s
    start, middle, end = scene.position_m(scene.target_names[0], halves_s) / 1e6
    normal = np.cross(start, end)
    if np.linalg.norm(normal) < 1e-6:  # straight up and down: any side will do
        normal = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
    normal *= np.sign(normal @ scene.position_m("sun", np.zeros(1))[0]) or 1.0
    tilt = np.radians(_TILT_DEG)
    towards = np.cos(tilt) * middle / np.linalg.norm(middle) + np.sin(tilt) * normal / np.linalg.norm(normal)
    x, y, z = towards
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))


def osculating_ellipse_m(position_m: F64, velocity_m_s: F64, n: int = _N_PATH) -> F64:
    """Points of the two-body ellipse through a state [m], shape (n, 3); only the state's place where it is none."""
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


def _draw_orbits(ax: Axes, globe: Globe, scene: Scene, at: F64) -> None:
    from matplotlib.collections import LineCollection

    lines = []
    for name in scene.sensor_names:
        position, velocity = scene.tracks.state(name, at)
        lines.append(globe.visible_line(osculating_ellipse_m(position[0], velocity[0])))
    ax.add_collection(LineCollection(lines, colors=BLUE, linewidths=0.6, alpha=0.35, zorder=1, label="orbits"))


def _draw_satellites(ax: Axes, globe: Globe, scene: Scene, sensors_m: F64, has_access: NDArray[np.bool_]) -> None:
    """Marks of the satellites that the Earth does not hide, and a word about the others."""
    seen = ~globe.is_hidden(sensors_m)
    xy = globe.project(sensors_m)
    kinds = ((has_access, GREEN, 6.5, "with access"), (~has_access, GREY, 4.5, "without"))
    for chosen, colour, size, words in kinds:
        ax.plot(*xy[seen & chosen].T, "o", color=colour, markersize=size, zorder=6,
                label=f"satellites {words}: {np.count_nonzero(chosen)}")  # fmt: skip
    if not seen.all():
        ax.plot([], [], " ", label=f"{np.count_nonzero(~seen)} of them behind the Earth")


def _finish_scene(ax: Axes, globe: Globe, scene: Scene, sun_m: F64, view: tuple[float, float], time_s: float) -> None:
    """Limits, the arrow to the Sun, words."""
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
    viewer = f"seen from RA {view[0] % 360:.0f}, dec {view[1]:.0f} deg"
    ax.set_title(f"{scene.name} at {utc_text(scene, time_s)}\n{viewer}", fontsize=10)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=8, frameon=False)


def plot_ground_tracks(scene: Scene, ax: Axes | None = None) -> Axes:
    """Draw the places below the satellites and the main target during the scene, on a map of longitude and latitude.

    Geodetic, WGS84. The part of a satellite's track in which it has access to the main target is thick and green, the
    rest thin; dots are at the epoch.

    Args:
        scene: The scene.
        ax: Where to draw; in degrees.
    """
    ax = ax or new_axes(11.0, 5.8)
    main, table = scene.target_names[0], scene.access()
    with_access = set(table["sensor"])
    time_s = np.linspace(0, scene.duration_s, max(_N_PATH, int(scene.duration_s / 20) + 1))
    labels: list[tuple[str, F64]] = []
    for name in sorted(scene.sensor_names, key=lambda name: name in with_access):
        track = ground_track_deg(scene, name, time_s)
        seen = name in with_access
        ax.plot(*track.T, color=BLUE if seen else FAINT, linewidth=0.9, zorder=2 + seen)
        ax.plot(*track[0], ".", color=BLUE if seen else GREY, markersize=6, zorder=2 + seen)
        labels += [(name, track[0])] if seen else []
    for row in table:
        span = np.linspace(row["start_s"], row["end_s"], _N_PATH)
        ax.plot(*ground_track_deg(scene, row["sensor"], span).T, color=GREEN, linewidth=3, zorder=4, alpha=0.75)
    flight = ground_track_deg(scene, main, time_s)
    ax.plot(*flight.T, color=VERMILION, linewidth=2.4, zorder=5)
    for other in scene.groups_of_targets[1:]:
        path = ground_track_deg(scene, other.names[0], time_s)
        ax.plot(*path.T, color=PURPLE, linewidth=1.8, zorder=4.5)
    ax.plot(*flight[0], "o", color="white", markeredgecolor=VERMILION, zorder=6)
    ax.plot(*flight[-1], "s", color="white", markeredgecolor=VERMILION, zorder=6)
    _draw_legend_of_tracks(ax, scene)
    ax.set(xlim=(-180, 180), ylim=(-90, 90), xticks=range(-180, 181, 30), yticks=range(-90, 91, 30), aspect="equal")
    ax.set(xlabel="longitude, east [deg]", ylabel="latitude [deg]")
    ax.grid(color="0.85", linewidth=0.6)
    ax.set_axisbelow(True)
    words = f"{plain(scene.duration_s)} s from {scene.epoch_utc} UTC"
    ax.set_title(f"{scene.name}: ground tracks over {words}", fontsize=10)
    if len(labels) <= MOST_LABELS:
        place_labels(ax, np.array([place for _, place in labels]), [name for name, _ in labels], color=BLUE, zorder=7)
    return ax


def _draw_legend_of_tracks(ax: Axes, scene: Scene) -> None:
    others = [group.names[0] for group in scene.groups_of_targets[1:]]
    for words, style in (
        (f"{scene.target_names[0]}, from o to square", {"color": VERMILION, "linewidth": 2.4}),
        *([(", ".join(others), {"color": PURPLE, "linewidth": 1.8})] if others else []),
        ("has access", {"color": GREEN, "linewidth": 3, "alpha": 0.75}),
        ("has access at another time", {"color": BLUE, "linewidth": 0.9}),
        ("never has access", {"color": FAINT, "linewidth": 0.9}),
    ):
        ax.plot([], [], label=words, **style)  # type: ignore[arg-type]
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=5, fontsize=8, frameon=False)


def ground_track_deg(scene: Scene, name: str, time_s: F64) -> F64:
    """Longitudes (-180 to 180) and latitudes below a body [deg], shape (n, 2), broken by NaN at 180 degrees."""
    lon_deg, lat_deg, _ = gcrs_to_geodetic(scene.position_m(name, time_s), scene.epoch, time_s)
    return broken_at_date_line(lon_deg, lat_deg)


def broken_at_date_line(lon_deg: F64, lat_deg: F64) -> F64:
    """A track on the map, shape (m, 2): where it passes 180 degrees it goes to the edge, and on from the other edge."""
    track = np.stack([lon_deg, lat_deg], axis=1)
    jumps = np.flatnonzero(np.abs(np.diff(lon_deg)) > 180)
    inserted = []
    for jump in jumps:
        side = 180.0 if lon_deg[jump] > 0 else -180.0
        after = lon_deg[jump + 1] + 2 * side  # the next longitude, counted on
        share = (side - lon_deg[jump]) / (after - lon_deg[jump])
        latitude = lat_deg[jump] + share * (lat_deg[jump + 1] - lat_deg[jump])
        inserted.append([[side, latitude], [np.nan, np.nan], [-side, latitude]])
    if not inserted:
        return track
    return np.insert(track, np.repeat(jumps + 1, 3), np.concatenate(inserted), axis=0)


def plot_group(
    scene: Scene, time_s: float, axes: Sequence[Axes] | None = None, group: str | None = None
) -> Sequence[Axes]:
    """Draw where the targets of a group are relative to its main one, in that one's local frame, from three sides.

    Radial is away from the Earth's centre, cross-track along position x velocity, along-track completes them
    (forwards).

    Args:
        scene: The scene.
        time_s: The instant [s after the epoch].
        axes: Where to draw: along-track and radial, cross-track and radial, along-track and cross-track, in metres or,
            for groups wider than 2 km, kilometres; and, as a fourth, the legend.
        group: Name of the group; the scene's first, "main", if left out.

    Returns:
        The axes.

    Raises:
        InputError: Not three or four axes, no such group, or the instant is outside the scene.
    """
    time = checked_time_s(scene, time_s)
    if axes is None:
        need_matplotlib("plot")
        from matplotlib import pyplot as plt

        axes = list(plt.subplots(2, 2, figsize=(8.2, 8), layout="constrained")[1].flat)
    if len(axes) not in (3, 4):
        raise InputError("must be 3 or 4", "axes", len(axes))
    groups = [one.name for one in scene.groups_of_targets]
    group = groups[0] if group is None else group
    if group not in groups:
        raise InputError(f"must be one of {', '.join(groups)}", "group", group)
    kinds = [kind for kind in kinds_of_targets(scene) if kind.group == group]
    first = kinds[0].rows[0]
    offset_m = group_offsets_m(scene, time, group)
    unit, per_m = ("km", 1e-3) if np.abs(offset_m).max() > 2000 else ("m", 1.0)
    half = max(1.12 * per_m * np.abs(offset_m).max(), _SMALLEST_HALF_M * per_m)
    rows = [row for kind in kinds for row in kind.rows]
    n_stowed = int(np.count_nonzero(stowed(scene, time)[rows]))
    words = ("radial", "along-track", "cross-track")
    for ax, (across, up) in zip(axes[:3], ((1, 0), (2, 0), (1, 2)), strict=True):
        for kind in kinds:
            places = per_m * offset_m[np.array(kind.rows) - first][:, [across, up]]
            ax.plot(*places.T, label=kind.label, **kind_style(kind))
        ax.axhline(0, color=FAINT, linewidth=0.6, zorder=0)
        ax.axvline(0, color=FAINT, linewidth=0.6, zorder=0)
        ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        ax.set(xlabel=f"{words[across]} [{unit}]", ylabel=f"{words[up]} [{unit}]")
    title = f"group about {kinds[0].label} at {plain(time)} s"
    axes[0].set_title(title + (f"\n{n_stowed} still stowed in it" if n_stowed else ""), fontsize=10)
    handles, labels = axes[0].get_legend_handles_labels()
    if len(axes) == 4:
        axes[3].set_axis_off()
        axes[3].legend(handles, labels, loc="center", title="targets")
    else:
        axes[0].legend(fontsize=7)
    return axes


def stowed(scene: Scene, time_s: float) -> NDArray[np.bool_]:
    """Which targets have not left their main target yet, shape (n_target,); without light time."""
    return np.asarray(time_s < scene.tracks.release_s[len(scene.sensor_names) :])


def group_offsets_m(scene: Scene, time_s: float, group: str | None = None) -> F64:
    """Positions of a group's targets relative to its main one: radial, along-track, cross-track [m], shape (n, 3)."""
    names = next(one.names for one in scene.groups_of_targets if group in (None, one.name))
    places = np.stack([scene.position_m(name, np.array([time_s]))[0] for name in names])
    return np.asarray((places - places[0]) @ local_frame(scene, time_s, names[0]).T)


def local_frame(scene: Scene, time_s: float, name: str | None = None) -> F64:
    """Radial, along-track and cross-track unit vectors of a body as rows, GCRS axes, shape (3, 3).

    Args:
        scene: The scene.
        time_s: The instant [s after the epoch].
        name: Of the body; the main target if left out.
    """
    name = scene.target_names[0] if name is None else name
    position, velocity = (part[0] for part in scene.tracks.state(name, np.array([time_s])))
    radial = position / np.linalg.norm(position)
    normal = np.cross(position, velocity)
    if np.linalg.norm(normal) < 1e-6 * np.linalg.norm(position):  # straight up or down: any cross-track will do
        normal = np.cross(radial, np.eye(3)[np.argmin(np.abs(radial))])
    cross = normal / np.linalg.norm(normal)
    return np.stack([radial, np.cross(cross, radial), cross])


@dataclass(frozen=True)
class Kind:
    """One kind of target, or a main target, which is a kind of its own."""

    number: int
    """Counts through all groups."""
    label: str
    spec: TargetSpec
    rows: list[int]
    """Its targets among target_names."""
    group: str
    is_main: bool


def kinds_of_targets(scene: Scene) -> list[Kind]:
    """The kinds of targets of all groups, in the order of target_names."""
    kinds: list[Kind] = []
    first = 0
    for group in scene.groups_of_targets:
        for place, spec in enumerate(group.targets):
            label = spec.name if spec.count == 1 else f"{spec.name} ({spec.count})"
            rows = list(range(first, first + spec.count))
            kinds.append(Kind(len(kinds), label, spec, rows, group.name, place == 0))
            first += spec.count
    return kinds


def kind_style(kind: Kind) -> dict[str, Any]:
    """Mark and colour of a kind of target; main targets are stars."""
    if kind.is_main:
        colour = kind_colour(kind)
        return {"linestyle": "none", "marker": "*", "color": colour, "markersize": 13, "markeredgecolor": INK,
                "zorder": 5}  # fmt: skip
    mark = MARKERS[(kind.number - 1) % len(MARKERS)]
    return {"linestyle": "none", "marker": mark, "color": kind_colour(kind), "markersize": 5.5,
            "markeredgecolor": "white", "markeredgewidth": 0.4, "zorder": 3}  # fmt: skip


def kind_colour(kind: Kind) -> str:
    """The scene's main target is vermilion, which no other kind is."""
    others = [colour for colour in SERIES if colour != VERMILION]
    return VERMILION if kind.number == 0 else others[(kind.number - 1) % len(others)]


def checked_time_s(scene: Scene, time_s: float) -> float:
    """An instant of the scene [s after the epoch].

    Raises:
        InputError: It is no number, or outside the scene.
    """
    if isinstance(time_s, bool) or not isinstance(time_s, int | float | np.number):
        raise InputError("must be a number", "time_s", time_s)
    if not 0 <= time_s <= scene.duration_s:
        raise InputError(f"must be in the scene, 0 to {scene.duration_s:g} s", "time_s", time_s, "g")
    return float(time_s)
