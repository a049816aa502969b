"""Commands of scenes: render, access, check, calibrate, plot, czml, detect."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpsim.commands.options import (
    BANDS,
    DEVICE,
    FOLDER,
    FRAMES,
    OVERWRITE,
    SCENE,
    SENSORS,
    Option,
    add_command,
    chosen_frames,
    frame_numbers,
    names,
    number,
    say,
    scenario_of,
    start_warp,
    whole_number,
)
from warpsim.errors import InputError

if TYPE_CHECKING:
    from astropy.table import Table

DETECTION_SUFFIXES = (".ecsv", ".csv", ".parquet", ".tdm")


def add_commands(commands: Any) -> None:
    """Add the parsers of these commands."""
    add_command(
        commands, "render", "render a scene into a folder", _render,
        SCENE, FOLDER, FRAMES, SENSORS, BANDS, DEVICE,
        Option("--every-frame", "also frames without access to a target"),
        Option("--stars", "also list the stars in every image, in stars.fits"),
        Option("--format NAMES", "comma-separated: fits (the default), fits-frames, tiff, png, exr (noiseless), zarr",
               names, ["fits"]),
        Option("--preview NAME", "also an animation of each sensor and band: gif or mp4"),
        Option("--sheet NAME", "contact sheet of whole images or of targets", default="whole"),
        Option("--overwrite", "replace a different run in the folder"),
        Option("--quiet", "no progress bar, no report"),
        resumes=True,
    )  # fmt: skip
    add_command(
        commands, "access", "list when each sensor can observe a target", _access,
        SCENE,
        Option("--target NAME", "what the scene's access_target says if left out"),
        SENSORS,
        Option("--format NAME", "table (the default), csv or ecsv", default="table"),
        Option("--step S", "step of the scan for changes [s], 10 if left out", _step_s),
        Option("--plot FILE", "also draw the intervals and the ranges: .png, .pdf or .svg"),
        Option("--overwrite", "replace an existing figure"),
    )  # fmt: skip
    add_command(commands, "check", "validate a scene or a recipe and report on it", _check, SCENE)
    add_command(
        commands, "calibrate", "write bias, dark and flat frames, and the maps of detectors", _calibrate,
        SCENE, FOLDER, SENSORS, BANDS,
        Option("--frames N", "frames of each kind, 16 if left out", whole_number, 16),
        Option("--level X", "light of flats over saturation, 0.5 if left out", number, 0.5),
        DEVICE, OVERWRITE,
    )  # fmt: skip
    add_command(
        commands, "plot", "draw a scene: Earth and orbits, tracks, group, attitudes, access, views", _plot,
        SCENE, FOLDER,
        Option("--time S", "seconds after the epoch; the middle of the scene if left out", number),
        Option("--sensors NAMES", "comma-separated: whose views; three with access if left out", names),
        OVERWRITE,
    )  # fmt: skip
    add_command(
        commands, "czml", "write a scene for Cesium: paths, lines of sight, fields of view, ...", _czml,
        SCENE,
        Option("-o, --output FILE", "file to write: .czml", required=True),
        Option("--step S", "time between positions [s]; chosen by their error if left out", number),
        Option("--attitudes NAMES", "targets whose attitudes are written: all, or their names", _targets),
        Option("--curves NAMES", "targets whose irradiance is written, by sensor and band: all, ...", _targets),
        Option("--html FILE", "also a page that opens it in CesiumJS: .html"),
        Option("--cesium WHERE", "the page's CesiumJS: URL, or folder that holds Cesium.js"),
        OVERWRITE,
    )  # fmt: skip
    add_command(
        commands, "detect", "write what sensors detect: directions with errors, brightness", _detect,
        SCENE,
        Option("-o, --output FILE", f"file to write: {', '.join(DETECTION_SUFFIXES)}", required=True),
        FRAMES, SENSORS, BANDS,
        Option(
            "--images METHOD",
            "find them in rendered images: matched_filter, sep or photutils; drawn from truth if left out",
        ),
        Option("--threshold X", "least light over its error, 5 if left out", number, 5.0),
        Option("--probability P", "that a target is detected, however bright", number),
        Option("--clutter N", "mean number of false detections of an image", number, 0.0),
        Option("--seed N", "another one draws other numbers", whole_number, 0),
        DEVICE, OVERWRITE,
        Option("--quiet", "no progress bar"),
    )  # fmt: skip


def _render(options: argparse.Namespace) -> int:
    from warpsim.output.run import render_to_folder

    scenario = scenario_of(options.scene)
    start_warp(options.quiet)
    report = render_to_folder(
        scenario,
        options.output,
        frames=frame_numbers(options.frames),
        sensors=options.sensors,
        bands=options.bands,
        device=options.device,
        overwrite=options.overwrite,
        stars=options.stars,
        every_frame=options.every_frame,
        progress=not options.quiet,
        formats=options.format,
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
    figure = Path(options.plot) if options.plot else None
    if figure:
        from warpsim.plot.figure_files import check_figure_file, draw_access

        check_figure_file(figure, options.overwrite, "--plot")
    scenario = scenario_of(options.scene)
    sensors = options.sensors
    table = scenario.access(options.target, sensors, step_s=options.step or ACCESS_STEP_S)
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

    if not 1 <= options.frames <= MOST_FRAMES:
        raise InputError(f"must be from 1 to {MOST_FRAMES:,}", "--frames", options.frames)
    if not 0.0 < options.level <= 1.0:
        raise InputError("must be above 0, and at most 1", "--level", options.level)
    scenario = scenario_of(options.scene)
    start_warp()
    written = calibrate(
        scenario,
        options.output,
        sensors=options.sensors,
        bands=options.bands,
        n_frame=options.frames,
        flat_level=options.level,
        device=options.device or "cpu",
        overwrite=options.overwrite,
    )
    say(f"{len(written)} files in {options.output}")
    return 0


def _plot(options: argparse.Namespace) -> int:
    from warpsim.plot.figure_files import draw_scenario

    scenario = scenario_of(options.scene)
    start_warp()
    written = draw_scenario(scenario, Path(options.output), options.time, options.overwrite, options.sensors)
    files = ", ".join(path.name for path in written)
    say(f"{len(written)} figures of {scenario.scene.name} in {options.output}: {files}")
    return 0


def _czml(options: argparse.Namespace) -> int:
    from warpsim.output.czml import write_czml

    path = Path(options.output)
    scenario = scenario_of(options.scene)
    if options.curves is not None:
        start_warp()
    error_m = write_czml(
        scenario,
        path,
        options.step,
        overwrite=options.overwrite,
        attitudes=options.attitudes,
        curves=options.curves,
        html=options.html,
        cesium=options.cesium,
    )
    n_body = len(scenario.satellite_names) + len(scenario.target_names)
    say(f"{n_body} bodies in {path} ({path.stat().st_size / 1e6:.2f} MB), positions within {error_m:.2g} m")
    if options.html is not None:
        say(f"page in {options.html}: serve it, its CZML and CesiumJS, as by `python -m http.server`")
    return 0


def _targets(where: str, text: str) -> str | list[str]:
    """Names of targets, or the word for all of them."""
    return text if text == "all" else names(where, text)


def _step_s(where: str, text: str) -> float:
    step_s = number(where, text)
    if not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", where, text)
    return step_s


def _detect(options: argparse.Namespace) -> int:
    from warpsim.files import check_new_file
    from warpsim.measure.detections import detections
    from warpsim.render.renderer import Renderer

    path = Path(options.output)
    check_new_file(path, DETECTION_SUFFIXES, options.overwrite)
    if path.suffix.lower() == ".csv":
        check_new_file(path.with_suffix(".json"), None, options.overwrite)
    settings: dict[str, Any] = {
        "threshold_sigma": options.threshold,
        "probability": options.probability,
        "clutter_per_image": options.clutter,
        "seed": options.seed,
    }
    scenario = scenario_of(options.scene)
    start_warp(options.quiet)
    renderer = Renderer(scenario, device=options.device)
    which: dict[str, Any] = {"sensors": options.sensors, "bands": options.bands}
    some = scenario.sensors_with_access if options.sensors is None else scenario.select_sensors(options.sensors)
    count = scenario.instrument_of((some or scenario.sensor_names)[0]).frames.count
    frames = list(chosen_frames(options.frames, range(count)))
    if not frames:
        raise InputError(f"must name some of the {count} frames", "--frames", options.frames)
    if options.images is None:
        table = detections(renderer, frames, **which, **settings)
    else:
        from astropy.table import vstack

        from warpsim.output.wording import progress_bar

        parts = []
        with progress_bar(len(frames), not options.quiet, "frames") as advance:
            for one in frames:
                parts.append(detections(renderer.render([one], **which), method=options.images, **settings))
                advance(1)
        table = vstack(parts) if len(parts) > 1 else parts[0]
    _write_detections(table, path, options.overwrite)
    n_named = sum(1 for name in table["target"] if name)
    say(f"{len(table)} detections in {path}, {n_named} of targets")
    return 0


def _write_detections(table: Table, path: Path, overwrite: bool) -> None:
    """Write a table by the suffix of its file."""
    if path.suffix.lower() == ".tdm":
        from warpsim.exchange.tdm import write_tdm

        write_tdm(table, path, overwrite=overwrite)
    elif path.suffix.lower() == ".parquet":
        from warpsim.labels.table import write_parquet

        write_parquet(table, path)
    else:
        from warpsim.files import whole_file, write_json

        with whole_file(path) as partial:
            table.write(partial, format=f"ascii.{path.suffix.lower()[1:]}")
            if path.suffix.lower() == ".csv":  # comments are what plain readers stumble over
                write_json(dict(table.meta), path.with_suffix(".json"))
