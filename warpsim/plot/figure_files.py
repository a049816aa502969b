"""Figures of a scenario as files, drawn without pyplot, which would ask for a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpsim.files import check_new_file, prepare_folder
from warpsim.plot.access_figure import plot_access, plot_range
from warpsim.plot.bands_figure import plot_bands
from warpsim.plot.bodies import plot_attitudes
from warpsim.plot.drawn_targets import target_kinds
from warpsim.plot.figure import FIGURE_SUFFIXES, checked_time_s, need_matplotlib, save_figure
from warpsim.plot.ground_tracks import plot_ground_tracks
from warpsim.plot.group_panels import plot_group
from warpsim.plot.overview import SCENE_INCH, plot_scene
from warpsim.plot.view import VIEW_INCH, plot_satellite_view
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.figure import Figure

N_VIEW = 3
"""Sensors of each kind whose views are drawn."""

_TALLEST_INCH = 30.0


def check_figure_file(path: Path, overwrite: bool, where: str) -> None:
    """Check that a figure may be written, before the work.

    Raises:
        InputError: The suffix is none of a figure, the file cannot be written, or matplotlib is not installed.
    """
    check_new_file(path, FIGURE_SUFFIXES, overwrite)
    need_matplotlib(where)


def draw_access(
    scene: Scene | Scenario, path: Path, access: Table | None = None, sensors: Sequence[str] | None = None
) -> None:
    """Draw the intervals of sensors, and below them their ranges against time, to a file.

    Args:
        scene: The scene.
        path: File to write.
        access: What `scene.access` gave; the scene's own if left out.
        sensors: Names of the sensors, or of the kinds, that it is about, drawn with access or without; those with
            access if left out.

    Raises:
        InputError: A name is no sensor, or the file cannot be written.
    """
    scenario = scenario_of(scene)
    table = scenario.access() if access is None else access
    named = None if sensors is None else list(dict.fromkeys(scenario.select_sensors(sensors)))
    n_row = max(3, len(set(table["sensor"])) if named is None else len(named))
    chart_inch = min(1.4 + 0.27 * n_row, _TALLEST_INCH)
    figure = _figure(9.6, chart_inch + 4.6)
    chart, ranges = figure.subplots(2, 1, sharex=True, height_ratios=[chart_inch, 4.6])
    plot_access(scenario, chart, only_with_access=named is None, access=table, sensors=named)
    chart.set_xlabel("")
    plot_range(scenario, named, ranges, table)
    save_figure(figure, path)


def draw_scenario(
    scene: Scene | Scenario,
    folder: Path,
    time_s: float | None = None,
    overwrite: bool = False,
    sensors: Sequence[str] | None = None,
) -> list[Path]:
    """Draw all figures of a scenario into a folder.

    They are scene.png, ground_tracks.png, group.png (group_NAME.png for each of several groups), attitudes.png,
    access.png and view_SENSOR.png for some sensors; those of groups and attitudes where there are targets.

    Args:
        scene: The scene.
        folder: Made where it is missing.
        time_s: The instant of all but the tracks and access [s after the epoch]; the middle of the scene if left out.
        overwrite: Whether existing files are replaced.
        sensors: Names of sensors or of kinds whose views are drawn; up to three of each kind that have access at the
            instant if left out.

    Returns:
        The files.

    Raises:
        InputError: No such sensor, the instant is outside the scene, the folder cannot be written, a file is there
            already, or matplotlib is not installed.
    """
    from warpsim.render.renderer import Renderer

    need_matplotlib("plot")
    scenario = scenario_of(scene)
    duration_s = scenario.scene.duration_s
    time = checked_time_s(0.5 * duration_s if time_s is None else time_s, duration_s)
    prepare_folder(folder)
    views = _observing(scenario, time) if sensors is None else list(dict.fromkeys(scenario.select_sensors(sensors)))
    groups = {"group" if len(scenario.group_names) == 1 else f"group_{name}": name for name in scenario.group_names}
    names = ["scene", "ground_tracks", *groups, *(["attitudes"] if scenario.targets else []), "bands", "access"]
    paths = {name: folder / f"{name}.png" for name in [*names, *(f"view_{name}" for name in views)]}
    for path in paths.values():
        check_new_file(path, FIGURE_SUFFIXES, overwrite)

    _draw_outside(scenario, time, paths, groups)
    draw_access(scenario, paths["access"])
    renderer = Renderer(scenario) if views else None
    for name in views:
        figure = _figure(*VIEW_INCH)
        plot_satellite_view(scenario, name, time, figure.add_subplot(), renderer)
        save_figure(figure, paths[f"view_{name}"])
    return list(paths.values())


def _draw_outside(scenario: Scenario, time_s: float, paths: Mapping[str, Path], groups: Mapping[str, str]) -> None:
    """Draw the scene, ground tracks, groups, bands and attitudes.

    Args:
        scenario: The scenario.
        time_s: The instant [s after the epoch].
        paths: Files by name; attitudes are drawn where they have one.
        groups: Names of the groups by those of their files.
    """
    figure = _figure(*SCENE_INCH)
    plot_scene(scenario, time_s, figure.add_subplot())
    save_figure(figure, paths["scene"])
    figure = _figure(11.0, 5.8)
    plot_ground_tracks(scenario, figure.add_subplot())
    save_figure(figure, paths["ground_tracks"])
    for name, group in groups.items():
        figure = _figure(8.2, 8.0)
        plot_group(scenario, time_s, list(figure.subplots(2, 2).flat), group)
        save_figure(figure, paths[name])
    figure = _figure(10.0, 5.6)
    plot_bands(scenario, figure.add_subplot())
    save_figure(figure, paths["bands"])
    if "attitudes" in paths:
        figure = _figure(9.2, 1.3 + 1.25 * len(target_kinds(scenario)))
        plot_attitudes(scenario, time_s, figure.add_subplot())
        save_figure(figure, paths["attitudes"])


def _observing(scenario: Scenario, time_s: float) -> list[str]:
    """The first sensors of each kind that have access at an instant."""
    at, found = np.array([time_s]), []
    for instrument in scenario.instruments.values():
        found += [name for index, name in enumerate(instrument.names) if instrument.has_access(index, at)[0]][:N_VIEW]
    return found


def _figure(width: float, height: float) -> Figure:
    """Return a new figure [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
