"""Figures of a whole scene: the Earth, orbits, flights and who can observe them at an instant; and ground tracks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from warpsim.arrays import F64
from warpsim.constants import EARTH_GM_M3_S2
from warpsim.directions import normalised, perpendicular
from warpsim.instant import instant_after
from warpsim.orbit.earth import gcrs_to_geodetic
from warpsim.plot.coastlines import coastlines_deg
from warpsim.plot.figure import (
    BLUE,
    DASHES,
    FAINT,
    GREEN,
    GREY,
    INK,
    MOST_LABELS,
    N_PATH,
    ORANGE,
    PALE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    YELLOW,
    Globe,
    annotate_points,
    checked_time_s,
    draw_arrow,
    draw_earth,
    globe_from,
    legend_below,
    literal,
    new_axes,
    observed_targets,
    pair,
    plain,
)
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SCENE_INCH = (8.2, 9.6)
"""Size of a figure for `plot_scene`: room for a legend of four rows below a square."""

_TILT_DEG = 45.0  # from the plane of the arc to the default viewer: the arc's height and length both show
_ACCESS_COLOURS = (GREEN, ORANGE, SKY_BLUE, YELLOW)


@dataclass(frozen=True)
class _Flight:
    """Paths of a group: that of its main target, or those of all its targets where each has its own orbit."""

    label: str
    targets: list[int]
    span_s: tuple[float, float]
    """From when to when they exist within the scene [s after the epoch]."""
    number: int
    """Index of the group."""

    @property
    def is_first(self) -> bool:
        """True for the scene's first group, whose lines are vermilion."""
        return self.number == 0

    @property
    def is_single(self) -> bool:
        """True for the flight of one target."""
        return len(self.targets) == 1

    @property
    def style(self) -> dict[str, Any]:
        """Colour and dashes of its lines as arguments of `Axes.plot`."""
        if self.is_first:
            return {"color": VERMILION}
        return {"color": PURPLE, "linestyle": DASHES[(self.number - 1) % len(DASHES)]}

    def linewidth(self, of_first: float) -> float:
        """Width of its lines, with that of the first group's."""
        return of_first if self.is_first and self.is_single else 1.8 if self.is_single else 1.2

    def time_s(self, n: int) -> F64:
        """Return evenly spread times of its existence [s after the epoch], shape (n,)."""
        return np.linspace(*self.span_s, n)


def _flights(scenario: Scenario) -> list[_Flight]:
    """The flights of all groups."""
    found = []
    for number, group in enumerate(scenario.scene.groups):
        leading = [
            index for index, target in enumerate(scenario.targets) if target.group == number and not target.is_released
        ]
        if not leading:
            continue  # a file of orbits without any
        first_s, last_s = scenario.targets[leading[0]].exists_s
        span_s = max(first_s, 0.0), min(last_s, scenario.scene.duration_s)
        label = scenario.target_names[leading[0]] if group.orbits is None else f"{group.name} ({len(leading)})"
        found.append(_Flight(label, leading, span_s, number))
    return found


# --- the globe ---


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
    at, flights = np.array([time]), _flights(scenario)
    sun_m = scenario.position_m("sun", at)[0]
    view = _side_view(scenario, flights) if view_ra_dec_deg is None else view_ra_dec_deg
    globe = globe_from(*view, scenario.tracks.pole_icrs)
    observers = _observers(scenario, at)

    draw_earth(ax, globe, sun_m, scenario.epoch, time)
    satellites_m = _draw_orbits(ax, globe, scenario, at)
    _draw_lines_of_sight(ax, globe, scenario, at)
    for flight in flights:
        _draw_flight(ax, globe, scenario, flight, time)
    has_access = np.array([name in observers for name in scenario.satellite_names])
    _draw_satellites(ax, globe, satellites_m, has_access)
    _finish_scene(ax, globe, sun_m)
    utc, viewer = instant_after(scenario.epoch, time).isot, f"seen from RA {view[0] % 360:.0f}, dec {view[1]:.0f} deg"
    ax.set_title(f"{literal(scenario.scene.name)} at {time:.1f} s ({utc} UTC)\n{viewer}", fontsize=10)
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


def _side_view(scenario: Scenario, flights: list[_Flight]) -> tuple[float, float]:
    """Right ascension and declination [deg] from which the flight is seen from the side, the Sun behind the viewer."""
    sun_m = scenario.position_m("sun", np.zeros(1))[0]
    start, middle, end = sun_m, sun_m, sun_m
    if flights:
        name = scenario.target_names[flights[0].targets[0]]
        start, middle, end = scenario.position_m(name, flights[0].time_s(3)) / 1e6
    normal = np.cross(start, end)
    if np.linalg.norm(normal) < 1e-6:  # straight up and down: any side will do
        normal = perpendicular(start)
    normal *= np.sign(normal @ sun_m) or 1.0
    tilt = np.radians(_TILT_DEG)
    x, y, z = np.cos(tilt) * normalised(middle) + np.sin(tilt) * normalised(normal)
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))


def osculating_ellipse_m(position_m: F64, velocity_m_s: F64, n: int = N_PATH) -> F64:
    """Return points of the two-body ellipse through a state [m], (n, 3); only the state's position if it is none."""
    momentum = np.cross(position_m, velocity_m_s)
    eccentricity = np.cross(velocity_m_s, momentum) / EARTH_GM_M3_S2 - normalised(position_m)
    if np.linalg.norm(eccentricity) >= 1 or not momentum.any():
        return position_m[None]
    # Angles count from the state itself: a circle's perigee is nowhere.
    first = normalised(position_m)
    angle = np.linspace(0, 2 * np.pi, n)[:, None]
    direction = np.cos(angle) * first + np.sin(angle) * normalised(np.cross(momentum, first))
    radius = momentum @ momentum / EARTH_GM_M3_S2 / (1 + direction @ eccentricity)
    return np.asarray(radius[:, None] * direction)


def _draw_orbits(ax: Axes, globe: Globe, scenario: Scenario, at: F64) -> F64:
    """Ellipses of the satellites; returns their positions [m], shape (n_satellite, 3)."""
    from matplotlib.collections import LineCollection

    states = [scenario.tracks.state(name, at) for name in scenario.satellite_names]
    lines = [globe.visible_line(osculating_ellipse_m(position[0], velocity[0])) for position, velocity in states]
    ax.add_collection(LineCollection(lines, colors=BLUE, linewidths=0.6, alpha=0.35, zorder=1, label="orbits"))
    return np.concatenate([position for position, _ in states])


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


def _draw_flight(ax: Axes, globe: Globe, scenario: Scenario, flight: _Flight, time_s: float) -> None:
    """Path of a group while it exists, and its position; the ends of the first group's."""
    names = [scenario.target_names[target] for target in flight.targets]
    paths_m = [scenario.position_m(name, flight.time_s(N_PATH)) for name in names]
    for number, path_m in enumerate(paths_m):
        ax.plot(*globe.visible_line(path_m).T, linewidth=flight.linewidth(2.2), zorder=4.0 if flight.is_first else 3.5,
                label=None if number else f"flight of {flight.label}", **flight.style)  # fmt: skip
    if flight.is_first and flight.is_single:
        for number, (mark, name) in enumerate((("o", "start"), ("s", "end"))):
            end_m = paths_m[0][-number]
            if not globe.is_hidden(end_m):
                ax.plot(*globe.project(end_m), mark, color="white", markeredgecolor=VERMILION, markersize=6,
                        zorder=5, label=f"its {name}, {plain(flight.span_s[number])} s")  # fmt: skip
    if not flight.span_s[0] <= time_s <= flight.span_s[1]:
        return
    now_m = np.concatenate([scenario.position_m(name, np.array([time_s])) for name in names])
    seen_m = now_m[~globe.is_hidden(now_m)]
    if len(seen_m):
        size = 6 if not flight.is_single else 13 if flight.is_first else 10
        ax.plot(*globe.project(seen_m).T, "*", color=flight.style["color"], markeredgecolor=INK, markersize=size,
                zorder=7, label=f"{flight.label} now")  # fmt: skip


def _draw_satellites(ax: Axes, globe: Globe, satellites_m: F64, has_access: NDArray[np.bool_]) -> None:
    """Marks of the satellites that the Earth does not hide, and a word about the others."""
    seen, xy = ~globe.is_hidden(satellites_m), globe.project(satellites_m)
    for chosen, colour, size, words in ((has_access, GREEN, 6.5, "with"), (~has_access, GREY, 4.5, "without")):
        ax.plot(*xy[seen & chosen].T, "o", color=colour, markersize=size, zorder=6,
                label=f"satellites {words} access: {np.count_nonzero(chosen)}")  # fmt: skip
    if not seen.all():
        ax.plot([], [], " ", label=f"{np.count_nonzero(~seen)} of them behind the Earth")


def _finish_scene(ax: Axes, globe: Globe, sun_m: F64) -> None:
    """Limits, the arrow to the Sun, the legend."""
    drawn = [np.ravel(np.asarray(line.get_xydata())) for line in ax.get_lines()]
    drawn += [np.ravel(np.asarray(path.vertices)) for lines in ax.collections for path in lines.get_paths()]
    half = 1.1 * float(np.nanmax(np.abs(np.concatenate(drawn))))
    to_sun = np.array([globe.right, globe.up]) @ normalised(sun_m)
    away = float(np.linalg.norm(to_sun))
    if away > 0.02:  # else the Sun is behind the viewer's back, or behind the Earth
        aside, corner = to_sun / away * half, np.copysign(0.86 * half, to_sun)  # nothing else is in the corners
        draw_arrow(ax, corner, corner + 0.16 * away * aside, 9, arrowstyle="-|>", color=ORANGE, linewidth=2.2)
        foot = corner - 0.055 * aside
        ax.text(*pair(foot), "Sun", color=ORANGE, ha="center", va="center", fontsize=9, fontweight="bold")
    half *= 1.04
    ax.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", xlabel="[1000 km]", ylabel="[1000 km]")
    legend_below(ax, -0.08, 3)


# --- the map ---


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
    ax.plot(*coastlines_deg().T, color=PALE, linewidth=0.5, zorder=1.5)
    with_access = _draw_access(ax, scenario)
    starts: dict[str, F64] = {}
    for name in sorted(scenario.satellite_names, key=lambda name: name in with_access):
        track, seen = _track_deg(scenario, name, time_s), name in with_access
        ax.plot(*track.T, color=BLUE if seen else FAINT, linewidth=0.9, zorder=2 + seen)
        ax.plot(*track[0], ".", color=BLUE if seen else GREY, markersize=6, zorder=2 + seen)
        if seen:
            starts[name] = track[0]
    _draw_flight_tracks(ax, scenario, len(time_s))
    for kind, name in enumerate(scenario.instruments):
        words = "has access" if len(scenario.instruments) == 1 else f"{name} has access"
        ax.plot([], [], label=words, **_access_style(scenario, kind))
    for colour, words in ((BLUE, "has access at another time"), (FAINT, "never has access")):
        ax.plot([], [], label=words, color=colour, linewidth=0.9)
    legend_below(ax, -0.12, 5)
    ax.set(xlim=(-180, 180), ylim=(-90, 90), xticks=range(-180, 181, 30), yticks=range(-90, 91, 30), aspect="equal")
    ax.set(xlabel="longitude, east [deg]", ylabel="latitude [deg]")
    ax.grid(color="0.85", linewidth=0.6)
    ax.set_axisbelow(True)
    words = f"{plain(duration_s)} s from {scenario.scene.epoch_utc} UTC"
    ax.set_title(f"{literal(scenario.scene.name)}: ground tracks over {words}", fontsize=10)
    if len(starts) <= MOST_LABELS:
        annotate_points(ax, list(starts.values()), list(starts), color=BLUE, zorder=7)
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
            satellite = instrument.satellite_names[row]
            track = _track_deg(scenario, satellite, np.linspace(start_s, end_s, N_PATH))
            ax.plot(*track.T, zorder=4, **_access_style(scenario, kind))
            satellites.add(satellite)
    return satellites


def _draw_flight_tracks(ax: Axes, scenario: Scenario, n_time: int) -> None:
    """Tracks of the groups' targets while they exist; the ends of the first group's."""
    for flight in _flights(scenario):
        with_ends = flight.is_first and flight.is_single
        label = f"{flight.label}, from o to square" if with_ends else flight.label
        for target in flight.targets:
            track = _track_deg(scenario, scenario.target_names[target], flight.time_s(n_time))
            ax.plot(*track.T, zorder=5.0 if flight.is_first else 4.5, linewidth=flight.linewidth(2.4),
                    label=label if target == flight.targets[0] else None, **flight.style)  # fmt: skip
            for mark, end in (("o", track[0]), ("s", track[-1])) if with_ends else ():
                ax.plot(*end, mark, color="white", markeredgecolor=VERMILION, zorder=6)


def _track_deg(scenario: Scenario, name: str, time_s: F64) -> F64:
    """Longitudes (-180 to 180) and latitudes [deg] below an object, shape (m, 2), broken by NaN at 180 degrees."""
    lon_deg, lat_deg, _ = gcrs_to_geodetic(scenario.position_m(name, time_s), scenario.epoch, time_s)
    return broken_at_date_line(lon_deg, lat_deg)


def broken_at_date_line(lon_deg: F64, lat_deg: F64) -> F64:
    """Return a track on the map, (m, 2): where it passes 180 degrees it goes to the edge, on from the other edge."""
    track = np.stack([lon_deg, lat_deg], axis=1)
    before = np.flatnonzero(np.abs(np.diff(lon_deg)) > 180)
    side = np.copysign(180.0, lon_deg[before])
    fraction = (side - lon_deg[before]) / (lon_deg[before + 1] + 2 * side - lon_deg[before])
    latitude = lat_deg[before] + fraction * np.diff(lat_deg)[before]
    gap = np.full_like(side, np.nan)
    edges = np.stack([np.stack([side, latitude], 1), np.stack([gap, gap], 1), np.stack([-side, latitude], 1)], axis=1)
    return np.insert(track, np.repeat(before + 1, 3), edges.reshape(-1, 2), axis=0)
