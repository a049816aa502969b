"""The command detect: a table of detections, or a tracking data message."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from astropy.table import Table

SUFFIXES = (".ecsv", ".csv", ".parquet", ".tdm")


def add_commands(commands: Any) -> None:
    """Add the parser of this command."""
    detect = commands.add_parser("detect", help="write what sensors detect: directions with errors, brightness")
    add_scene(detect)
    detect.add_argument("-o", "--output", required=True, metavar="FILE", help=f"file to write: {', '.join(SUFFIXES)}")
    detect.add_argument("--frames", metavar="A:B[:STEP]", help="frame numbers, like a Python slice")
    detect.add_argument("--sensors", metavar="NAMES", help=SENSORS_HELP)
    detect.add_argument("--bands", metavar="NAMES", help="comma-separated band names")
    method = "find them in rendered images: matched_filter, sep or photutils; drawn from truth if left out"
    detect.add_argument("--images", metavar="METHOD", help=method)
    detect.add_argument("--threshold", metavar="X", default="5", help="least light over its error, 5 if left out")
    detect.add_argument("--probability", metavar="P", help="that a target is detected, however bright")
    detect.add_argument("--clutter", metavar="N", default="0", help="mean number of false detections of an image")
    detect.add_argument("--seed", metavar="N", default="0", help="another one draws other numbers")
    detect.add_argument("--device", help="Warp device: cpu, cuda:0, ...")
    detect.add_argument("--overwrite", action="store_true", help="replace existing files")
    detect.add_argument("--quiet", action="store_true", help="no progress bar")
    detect.set_defaults(command=_detect)


def _detect(options: argparse.Namespace) -> int:
    from warpsim.files import check_new_file
    from warpsim.measure.detections import detections
    from warpsim.render.renderer import Renderer

    path = Path(options.output)
    check_new_file(path, SUFFIXES, options.overwrite)
    if path.suffix.lower() == ".csv":
        check_new_file(path.with_suffix(".json"), None, options.overwrite)
    settings: dict[str, Any] = {
        "threshold_sigma": number("--threshold", options.threshold),
        "probability": None if options.probability is None else number("--probability", options.probability),
        "clutter_per_image": number("--clutter", options.clutter),
        "seed": whole_number("--seed", options.seed),
    }
    scenario = scenario_of(options.scene)
    start_warp(options.quiet)
    renderer = Renderer(scenario, device=options.device)
    which: dict[str, Any] = {"sensors": names(options.sensors), "bands": names(options.bands)}
    some = scenario.sensors_with_access if options.sensors is None else scenario.select_sensors(which["sensors"])
    count = scenario.instrument_of((some or scenario.sensor_names)[0]).frames.count
    chosen = frame_numbers(options.frames)
    frames = chosen if isinstance(chosen, list) else list(range(count)[chosen or slice(None)])
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
    _write(table, path, options.overwrite)
    n_named = sum(1 for name in table["target"] if name)
    say(f"{len(table)} detections in {path}, {n_named} of targets")
    return 0


def _write(table: Table, path: Path, overwrite: bool) -> None:
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
