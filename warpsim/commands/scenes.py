"""Commands of scenes: render, access, check, plot, czml."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

from warpsim.commands.options import (
    SENSORS_HELP,
    add_scene,
    frame_numbers,
    names,
    number,
    say,
    scenario_of,
    start_warp,
    whole_number,
)
from warpsim.errors import InputError


def add_commands(commands: Any) -> None:
    """Add the parsers of these commands."""
    render = commands.add_parser("render", help="render a scene into a folder")
    add_scene(render)
    render.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write to")
    render.add_argument("--frames", metavar="A:B[:STEP]", help="frame numbers, like a Python slice")
    render.add_argument("--sensors", metavar="NAMES", help=SENSORS_HELP)
    render.add_argument("--bands", metavar="NAMES", help="comma-separated band names")
    render.add_argument("--device", help="Warp device: cpu, cuda:0, ...")
    render.add_argument("--every-frame", action="store_true", help="also frames without access to a target")
    render.add_argument("--stars", action="store_true", help="also list the stars in every image, in stars.fits")
    formats = "comma-separated: fits (the default), fits-frames, tiff, png, exr (noiseless), zarr"
    render.add_argument("--format", default="fits", metavar="NAMES", help=formats)
    render.add_argument("--preview", metavar="NAME", help="also an animation of each sensor and band: gif or mp4")
    render.add_argument("--sheet", default="whole", metavar="NAME", help="contact sheet of whole images or of targets")
    render.add_argument("--overwrite", action="store_true", help="replace a different run in the folder")
    render.add_argument("--quiet", action="store_true", help="no progress bar, no report")
    render.set_defaults(command=_render, resumes=True)

    access = commands.add_parser("access", help="list when each sensor can observe a target")
    add_scene(access)
    access.add_argument("--target", metavar="NAME", help="what the scene's access_target says if left out")
    access.add_argument("--sensors", metavar="NAMES", help=SENSORS_HELP)
    access.add_argument("--format", default="table", metavar="NAME", help="table (the default), csv or ecsv")
    access.add_argument("--step", metavar="S", help="step of the scan for changes [s], 10 if left out")
    access.add_argument("--plot", metavar="FILE", help="also draw the intervals and the ranges: .png, .pdf or .svg")
    access.add_argument("--overwrite", action="store_true", help="replace an existing figure")
    access.set_defaults(command=_access)

    check = commands.add_parser("check", help="validate a scene or a recipe and report on it")
    add_scene(check)
    check.set_defaults(command=_check)

    calibrate = commands.add_parser("calibrate", help="write bias, dark and flat frames, and the maps of detectors")
    add_scene(calibrate)
    calibrate.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write to")
    calibrate.add_argument("--sensors", metavar="NAMES", help=SENSORS_HELP)
    calibrate.add_argument("--bands", metavar="NAMES", help="comma-separated band names")
    calibrate.add_argument("--frames", metavar="N", default="16", help="frames of each kind, 16 if left out")
    calibrate.add_argument(
        "--level", metavar="X", default="0.5", help="light of flats over saturation, 0.5 if left out"
    )
    calibrate.add_argument("--device", help="Warp device: cpu, cuda:0, ...")
    calibrate.add_argument("--overwrite", action="store_true", help="replace existing files")
    calibrate.set_defaults(command=_calibrate)

    plot = commands.add_parser("plot", help="draw a scene: Earth and orbits, tracks, group, attitudes, access, views")
    add_scene(plot)
    plot.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write to")
    plot.add_argument("--time", metavar="S", help="seconds after the epoch; the middle of the scene if left out")
    plot.add_argument("--sensors", metavar="NAMES", help="comma-separated: whose views; three with access if left out")
    plot.add_argument("--overwrite", action="store_true", help="replace existing files")
    plot.set_defaults(command=_plot)

    czml = commands.add_parser("czml", help="write a scene for Cesium: paths, lines of sight, fields of view, ...")
    add_scene(czml)
    czml.add_argument("-o", "--output", required=True, metavar="FILE", help="file to write: .czml")
    czml.add_argument("--step", metavar="S", help="time between positions [s]; chosen by their error if left out")
    czml.add_argument("--attitudes", metavar="NAMES", help="targets whose attitudes are written: all, or their names")
    czml.add_argument(
        "--curves", metavar="NAMES", help="targets whose irradiance is written, by sensor and band: all, ..."
    )
    czml.add_argument("--html", metavar="FILE", help="also a page that opens it in CesiumJS: .html")
    czml.add_argument("--cesium", metavar="WHERE", help="the page's CesiumJS: URL, or folder that holds Cesium.js")
    czml.add_argument("--overwrite", action="store_true", help="replace existing files")
    czml.set_defaults(command=_czml)


def _render(options: argparse.Namespace) -> int:
    from warpsim.output.run import render_to_folder

    scenario = scenario_of(options.scene)
    start_warp(options.quiet)
    report = render_to_folder(
        scenario,
        options.output,
        frames=frame_numbers(options.frames),
        sensors=names(options.sensors),
        bands=names(options.bands),
        device=options.device,
        overwrite=options.overwrite,
        stars=options.stars,
        every_frame=options.every_frame,
        progress=not options.quiet,
        formats=names(options.format) or (),
        preview=options.preview,
        sheet=options.sheet,
    )
    if not options.quiet:
        say(report.text())
    return 0


def _access(options: argparse.Namespace) -> int:
    from warpsim.scene.target_access import ACCESS_STEP_S

    if options.format not in ("table", "csv", "ecsv"):
        raise InputError("must be table, csv or ecsv", "--format", options.format)
    step_s = ACCESS_STEP_S if options.step is None else number("--step", options.step)
    if not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", "--step", options.step)
    figure = Path(options.plot) if options.plot else None
    if figure:
        from warpsim.plot.figure_files import check_figure_file, draw_access

        check_figure_file(figure, options.overwrite, "--plot")
    scenario = scenario_of(options.scene)
    sensors = names(options.sensors)
    table = scenario.access(options.target, sensors, step_s=step_s)
    if figure:  # files before words, as with catalogs
        draw_access(scenario, figure, table, sensors)
    if options.format != "table":
        table.write(sys.stdout, format=f"ascii.{options.format}")
        return 0
    counted = {"tracked": "what each sensor tracks", "any": "any target"}.get(
        table.meta["target"], table.meta["target"]
    )
    say(f"{scenario.scene.name}: access to {counted}, seconds after {scenario.scene.epoch_utc} UTC")
    if len(table):
        say("\n".join(table.pformat(max_lines=-1, max_width=-1, show_unit=True)))
    n_sensor = len(scenario.select_sensors(sensors))
    seen, total_s = len(set(table["sensor"])), float(sum(table["duration_s"]))
    say(f"{seen} of {n_sensor} sensors have access, {total_s:.1f} s in all")
    if figure:
        say(f"figure in {figure}")
    return 0


def _check(options: argparse.Namespace) -> int:
    from warpsim.output.check import scene_report
    from warpsim.scene.scene_files import read_scene_data

    start_warp()  # areas of some shapes come from kernels
    if "scene" not in read_scene_data(options.scene):
        say(scene_report(scenario_of(options.scene)))
        return 0
    from warpsim.dataset.layout import recipe_report
    from warpsim.dataset.recipe import Recipe

    recipe = Recipe.load(options.scene)
    say(
        f"{recipe_report(recipe)}\n\nThe scene that sequences are variations of:\n{scene_report(recipe.scene.scenario)}"
    )
    return 0


def _calibrate(options: argparse.Namespace) -> int:
    from warpsim.output.calibration import MOST_FRAMES, calibrate

    n_frame, level = whole_number("--frames", options.frames), number("--level", options.level)
    if not 1 <= n_frame <= MOST_FRAMES:
        raise InputError(f"must be from 1 to {MOST_FRAMES:,}", "--frames", options.frames)
    if not 0.0 < level <= 1.0:
        raise InputError("must be above 0, and at most 1", "--level", options.level)
    scenario = scenario_of(options.scene)
    start_warp()
    written = calibrate(
        scenario,
        options.output,
        sensors=names(options.sensors),
        bands=names(options.bands),
        n_frame=n_frame,
        flat_level=level,
        device=options.device or "cpu",
        overwrite=options.overwrite,
    )
    say(f"{len(written)} files in {options.output}")
    return 0


def _plot(options: argparse.Namespace) -> int:
    from warpsim.plot.figure_files import draw_scenario

    time_s = None if options.time is None else number("--time", options.time)
    scenario = scenario_of(options.scene)
    start_warp()
    sensors = names(options.sensors)
    written = draw_scenario(scenario, Path(options.output), time_s, options.overwrite, sensors)
    files = ", ".join(path.name for path in written)
    say(f"{len(written)} figures of {scenario.scene.name} in {options.output}: {files}")
    return 0


def _czml(options: argparse.Namespace) -> int:
    from warpsim.output.czml import write_czml

    path = Path(options.output)
    step_s = None if options.step is None else number("--step", options.step)
    scenario = scenario_of(options.scene)
    if options.curves is not None:
        start_warp()
    error_m = write_czml(
        scenario,
        path,
        step_s,
        overwrite=options.overwrite,
        attitudes=_targets(options.attitudes),
        curves=_targets(options.curves),
        html=options.html,
        cesium=options.cesium,
    )
    n_body = len(scenario.satellite_names) + len(scenario.target_names)
    say(f"{n_body} bodies in {path} ({path.stat().st_size / 1e6:.2f} MB), positions within {error_m:.2g} m")
    if options.html is not None:
        say(f"page in {options.html}: serve it, its CZML and CesiumJS, as by `python -m http.server`")
    return 0


def _targets(text: str | None) -> str | list[str] | None:
    """Names of targets, or the word for all of them."""
    return text if text == "all" else names(text)
