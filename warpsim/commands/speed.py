"""The command bench: frames per second."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpsim.commands.options import Option, add_command, counts, names, say, scenario_of, start_warp, whole_number
from warpsim.errors import InputError

if TYPE_CHECKING:
    from warpsim.speed.report import BenchmarkPlan, Speed


def add_commands(commands: Any) -> None:
    """Add the parser of this command."""
    add_command(
        commands, "bench", "frames per second against image size and sensors on this machine", _bench,
        Option("[SCENE]", "preset or file: measure each kind of its sensors as it is"),
        Option("--device NAMES", "Warp devices: cpu, cuda:0, ...; all if left out"),
        Option("--pixels N,N", "rows and columns; 128,256,512,1024 if left out", counts),
        Option("--sensors N,N", "numbers of sensors; 1,20 if left out", counts),
        Option("--stars N", "stars in view, about; 100 if left out", whole_number),
        Option("--psf NAME", "airy (the default), or gaussian: of 0.7 px"),
        Option("--frames N", "frames of a call; as many as 64 MB of counts hold if left out", _one_count),
        Option("--resident", "leave counts on the device: nothing is copied"),
        Option("--quick", "fewer and shorter calls: good to a factor, in seconds"),
        Option("--json FILE", "also write the figures: .json"),
        Option("--overwrite", "replace an existing file"),
    )  # fmt: skip


def _bench(options: argparse.Namespace) -> int:
    from warpsim.files import check_new_file, write_json

    path = Path(options.json) if options.json else None
    if path:
        check_new_file(path, (".json",), options.overwrite)
    figures, words = _measure_sizes(options) if options.scene is None else _measure_scene(options)
    if path:
        write_json(figures, path)
        words += f"\n\nfigures in {path}"
    say(words)
    return 0


def _measure_sizes(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Figures of scenes of all sizes, which are printed as they come, and the table of stages."""
    from warpsim.speed.report import BenchmarkPlan, as_json, heading, measured, row, stage_table
    from warpsim.speed.work import PSFS

    devices = _devices(options.device)
    if options.device is not None and not devices:
        raise InputError("must name a device", "--device", options.device)
    if options.psf not in (None, *PSFS):
        raise InputError(f"must be {' or '.join(PSFS)}", "--psf", options.psf)
    if options.stars is not None and options.stars < 0:
        raise InputError("must be >= 0", "--stars", options.stars)
    given: dict[str, Any] = {
        "devices": devices or None,
        "pixels": options.pixels,
        "sensors": options.sensors,
        "n_star": options.stars,
        "psf": options.psf,
        "frames": options.frames,
    }
    switches = {"quick": options.quick, "resident": options.resident}
    plan = BenchmarkPlan(**{name: value for name, value in given.items() if value is not None}, **switches)
    _check_sizes(plan)
    start_warp()
    speeds: list[Speed] = []
    for speed in measured(plan):
        print(row(speed) if speeds else f"{heading(plan)}\n{row(speed)}", flush=True)
        speeds.append(speed)
    return as_json(plan, speeds), f"\n{stage_table(speeds)}"


def _measure_scene(options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Figures of a scene as it is, with its own images, bands and stars, and their table."""
    from dataclasses import asdict

    from warpsim.speed.report import scene_speed_table, scene_speeds

    for name in ("pixels", "sensors", "stars", "psf"):
        if getattr(options, name) is not None:
            raise InputError("must not be given with a scene, which has its own", f"--{name}")
    start_warp()
    scenario = scenario_of(options.scene)
    n_call = 3 if options.quick else 9
    speeds = list(scene_speeds(scenario, _devices(options.device), n_call, options.frames, options.resident))
    figures = {"scene": scenario.scene.name, "cases": [asdict(speed) for speed in speeds]}
    return figures, scene_speed_table(scenario, speeds)


def _devices(text: str | None) -> tuple[str, ...]:
    return tuple(names("--device", text or ""))


def _one_count(where: str, text: str) -> int:
    if len(numbers := counts(where, text)) > 1:
        raise InputError("must be one number", where, text)
    return numbers[0]


def _check_sizes(plan: BenchmarkPlan) -> None:
    """Check the scenes of all sizes, before the first is measured."""
    from warpsim.speed.work import N_CALL, speed_scene

    cases = [("--pixels", n_pixel, n_pixel, 1) for n_pixel in plan.pixels]
    cases += [("--sensors", n_sensor, min(plan.pixels), n_sensor) for n_sensor in plan.sensors]
    for option, number, n_pixel, n_sensor in cases:
        try:
            speed_scene(n_pixel, plan.psf, n_sensor)
        except InputError as error:
            raise InputError(f"{number} is not possible: {error}", option) from None
    most = speed_scene(min(plan.pixels), plan.psf).frames.count // N_CALL
    if plan.frames is not None and plan.frames > most:
        raise InputError(f"must be <= {most}", "--frames", plan.frames)
