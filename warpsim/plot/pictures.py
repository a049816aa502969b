"""Pictures of a scenario as files, drawn without pyplot, which would ask for a display."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpsim.files import check_new_file, prepare_folder
from warpsim.plot.access import plot_access, plot_range
from warpsim.plot.bodies import plot_attitudes
from warpsim.plot.figure import PICTURE_SUFFIXES, need_matplotlib, save_figure
from warpsim.plot.scenario import (
    SCENE_INCH,
    checked_time_s,
    kinds_of_targets,
    plot_ground_tracks,
    plot_group,
    plot_scene,
)
from warpsim.plot.view import VIEW_INCH, plot_satellite_view
from warpsim.scene.access import chosen_sensors
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.figure import Figure

N_VIEW = 3
"""Sensors whose views are drawn."""

_TALLEST_INCH = 30.0


def check_picture(path: Path, overwrite: bool, where: str) -> None:
    """See that a picture may be written, before the work is done.

    Raises:
        InputError: The suffix is none of a picture, the file cannot be written, or matplotlib is not installed.
    """
    check_new_file(path, PICTURE_SUFFIXES, overwrite)
    need_matplotlib(where)


def draw_access(scene: Scene, path: Path, access: Table | None = None, sensors: Sequence[str] | None = None) -> None:
    """Draw the intervals of sensors, and below them their ranges against time, to a file.

    Args:
        scene: The scene.
        path: File to write.
        access: What `scene.access` gave; the scene's own if left out.
        sensors: Names of the sensors that it is about, drawn with access or without; those with access if left out.
    """
    access = scene.access() if access is None else access
    named = None if sensors is None else list(dict.fromkeys(sensors))
    n_row = max(3, len(set(access["sensor"])) if named is None else len(named))
    chart_inch = min(1.4 + 0.27 * n_row, _TALLEST_INCH)
    figure = _figure(9.6, chart_inch + 4.6)
    chart, ranges = figure.subplots(2, 1, sharex=True, height_ratios=[chart_inch, 4.6])
    plot_access(scene, chart, only_with_access=named is None, access=access, sensors=named)
    chart.set_xlabel("")
    plot_range(scene, named, ranges, access)
    save_figure(figure, path)


def draw_scenario(
    scene: Scene,
    folder: Path,
    time_s: float | None = None,
    overwrite: bool = False,
    sensors: Sequence[str] | None = None,
) -> list[Path]:
    """Draw all pictures of a scenario into a folder.

    They are scene.png, ground_tracks.png, group.png and group_NAME.png for further groups, attitudes.png, access.png
    and view_SENSOR.png for some sensors.

    Args:
        scene: The scene.
        folder: Made where it is missing.
        time_s: The instant of all but the tracks and access [s after the epoch]; the middle of the scene if left out.
        overwrite: Whether existing pictures are replaced.
        sensors: Whose views are drawn; up to three that have access at the instant if left out.

    Returns:
        The files.

    Raises:
        InputError: No such sensor, the instant is outside the scene, the folder cannot be written, a picture is there
            already, or matplotlib is not installed.
    """
    from warpsim.render.renderer import Renderer

    need_matplotlib("plot")
    time = checked_time_s(scene, 0.5 * scene.duration_s if time_s is None else time_s)
    prepare_folder(folder)
    if sensors is None:
        at = np.array([time])
        seeing = [name for name in scene.sensor_names if bool(scene.has_access(name, at)[0])][:N_VIEW]
    else:
        seeing = chosen_sensors(scene, sensors)
    groups: dict[str, str | None] = {"group": None} | {f"group_{group.name}": group.name for group in scene.groups}
    names = ["scene", "ground_tracks", *groups, "attitudes", "access", *(f"view_{name}" for name in seeing)]
    paths = {name: folder / f"{name}.png" for name in names}
    for path in paths.values():
        check_new_file(path, PICTURE_SUFFIXES, overwrite)

    figure = _figure(*SCENE_INCH)
    plot_scene(scene, time, figure.add_subplot())
    save_figure(figure, paths["scene"])
    figure = _figure(11.0, 5.8)
    plot_ground_tracks(scene, figure.add_subplot())
    save_figure(figure, paths["ground_tracks"])
    for name, group in groups.items():
        figure = _figure(8.2, 8.0)
        plot_group(scene, time, list(figure.subplots(2, 2).flat), group)
        save_figure(figure, paths[name])
    figure = _figure(9.2, 1.3 + 1.25 * len(kinds_of_targets(scene)))
    plot_attitudes(scene, time, figure.add_subplot())
    save_figure(figure, paths["attitudes"])
    draw_access(scene, paths["access"])
    renderer = Renderer(scene) if seeing else None
    for name in seeing:
        figure = _figure(*VIEW_INCH)
        plot_satellite_view(scene, name, time, figure.add_subplot(), renderer)
        save_figure(figure, paths[f"view_{name}"])
    return list(paths.values())


def _figure(width: float, height: float) -> Figure:
    """A figure of its own [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
