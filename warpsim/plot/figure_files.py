"""Figures of a scenario as files, drawn without pyplot, which would ask for a display."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpsim.files import check_new_file, prepare_folder
from warpsim.plot.access_figure import plot_access, plot_range
from warpsim.plot.figure import FIGURE_SUFFIXES, checked_time_s, need_matplotlib, save_figure, target_kinds
from warpsim.plot.group_figure import plot_attitudes, plot_group
from warpsim.plot.image_figure import VIEW_INCH, plot_satellite_view
from warpsim.plot.scene_figure import SCENE_INCH, plot_ground_tracks, plot_scene
from warpsim.plot.sky_figure import plot_bands, plot_star_counts
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.sky.catalog import StarCatalog

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

N_VIEW = 3
"""Sensors of each kind whose views are drawn."""

_TALLEST_INCH = 30.0


def check_figure_file(path: Path, overwrite: bool, where: str) -> None:
    """Raise an InputError, before the work, if a figure may not be written or matplotlib is not installed."""
    check_new_file(path, FIGURE_SUFFIXES, overwrite)
    need_matplotlib(where)


def draw_access(
    scene: Scene | Scenario, path: Path, access: Table | None = None, sensors: Sequence[str] | None = None
) -> None:
    """Draw the intervals of sensors, and below them their ranges against time, to a file.

    Of what `scene.access` gave (the scene's own if left out), for the named sensors or kinds, with access or without
    (those with access if left out).
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


def draw_star_counts(catalog: StarCatalog, path: Path) -> None:
    """Draw the numbers of a catalog's stars by band and magnitude to a file."""
    figure = _figure(8.5, 4.8)
    plot_star_counts(catalog, ax=figure.add_subplot())
    save_figure(figure, path)


def draw_scenario(
    scene: Scene | Scenario,
    folder: Path,
    time_s: float | None = None,
    overwrite: bool = False,
    sensors: Sequence[str] | None = None,
) -> list[Path]:
    """Draw all figures of a scenario into a folder, at an instant (the middle of the scene if left out).

    They are scene.png, ground_tracks.png, group.png (group_NAME.png for each of several groups), attitudes.png,
    bands.png, access.png, and view_SENSOR.png for the named sensors or kinds, or up to three of each kind that have
    access at the instant; those of groups and attitudes where there are targets.
    """
    from warpsim.render.renderer import Renderer

    need_matplotlib("plot")
    scenario = scenario_of(scene)
    duration_s = scenario.scene.duration_s
    time = checked_time_s(0.5 * duration_s if time_s is None else time_s, duration_s)
    views = _observing(scenario, time) if sensors is None else list(dict.fromkeys(scenario.select_sensors(sensors)))
    prepare_folder(folder)
    groups = {"group" if len(scenario.group_names) == 1 else f"group_{name}": name for name in scenario.group_names}
    names = ["scene", "ground_tracks", *groups, *(["attitudes"] if scenario.targets else []), "bands", "access"]
    paths = {name: folder / f"{name}.png" for name in [*names, *(f"view_{name}" for name in views)]}
    for path in paths.values():
        check_new_file(path, FIGURE_SUFFIXES, overwrite)

    renderer = Renderer(scenario) if views else None
    attitudes_inch = 9.2, 1.3 + 1.25 * len(target_kinds(scenario))
    single: dict[str, tuple[tuple[float, float], Callable[..., Axes]]] = {
        "scene": (SCENE_INCH, partial(plot_scene, scenario, time)),
        "ground_tracks": ((11.0, 5.8), partial(plot_ground_tracks, scenario)),
        "attitudes": (attitudes_inch, partial(plot_attitudes, scenario, time)),
        "bands": ((10.0, 5.6), partial(plot_bands, scenario)),
    }
    for name in views:
        single[f"view_{name}"] = VIEW_INCH, partial(plot_satellite_view, scenario, name, time, renderer=renderer)
    for name, path in paths.items():
        if name == "access":
            draw_access(scenario, path)
            continue
        if name in groups:
            figure = _figure(8.2, 8.0)
            plot_group(scenario, time, list(figure.subplots(2, 2).flat), groups[name])
        else:
            size_inch, plot = single[name]
            figure = _figure(*size_inch)
            plot(ax=figure.add_subplot())
        save_figure(figure, path)
    return list(paths.values())


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
