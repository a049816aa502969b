"""The command bench: frames per second."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpsim.commands.options import counts, names, say, scenario_of, start_warp, whole_number
from warpsim.errors import InputError

if TYPE_CHECKING:
    from warpsim.speed.report import BenchmarkPlan, Speed


def add_commands(commands: Any) -> None:
    """Add the parsers of these commands."""
    bench = commands.add_parser("bench", help="frames per second against image size and sensors on this machine")
    bench.add_argument("scene", nargs="?", help="preset or file: measure each kind of its sensors as it is")
    bench.add_argument("--device", metavar="NAMES", help="Warp devices: cpu, cuda:0, ...; all if left out")
    bench.add_argument("--pixels", metavar="N,N", help="rows and columns; 128,256,512,1024 if left out")
    bench.add_argument("--sensors", metavar="N,N", help="numbers of sensors; 1,20 if left out")
    bench.add_argument("--stars", metavar="N", help="stars in view, about; 100 if left out")
    bench.add_argument("--psf", metavar="NAME", help="airy (the default), or gaussian: of 0.7 px")
    bench.add_argument("--frames", metavar="N", help="frames of a call; as many as 64 MB of counts hold if left out")
    bench.add_argument("--resident", action="store_true", help="leave counts on the device: nothing is copied")
    bench.add_argument("--quick", action="store_true", help="fewer and shorter calls: good to a factor, in seconds")
    bench.add_argument("--json", metavar="FILE", help="also write the figures: .json")
    bench.add_argument("--overwrite", action="store_true", help="replace an existing file")
    bench.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> int:
    if options.scene is not None:
        return _bench_scene(options)
    from warpsim.files import check_new_file, write_json
    from warpsim.speed.report import BenchmarkPlan, as_json, heading, measured, row, stage_table
    from warpsim.speed.work import PSFS

    path = Path(options.json) if options.json else None
    if path:
        check_new_file(path, (".json",), options.overwrite)
    if options.device is not None and not names(options.device):
        raise InputError("must name a device", "--device", options.device)
    if options.psf not in (None, *PSFS):
        raise InputError(f"must be {' or '.join(PSFS)}", "--psf", options.psf)
    n_star = None if options.stars is None else whole_number("--stars", options.stars)
    if n_star is not None and n_star < 0:
        raise InputError("must be >= 0", "--stars", n_star)
    given: dict[str, Any] = {
        "devices": None if options.device is None else tuple(names(options.device) or ()),
        "pixels": counts("--pixels", options.pixels),
        "sensors": counts("--sensors", options.sensors),
        "n_star": n_star,
        "psf": options.psf,
        "frames": _frames_of_call(options.frames),
    }
    switches = {"quick": options.quick, "resident": options.resident}
    plan = BenchmarkPlan(**{name: value for name, value in given.items() if value is not None}, **switches)
    _check_sizes(plan)
    start_warp()
    speeds: list[Speed] = []
    for speed in measured(plan):
        print(row(speed) if speeds else f"{heading(plan)}\n{row(speed)}", flush=True)
        speeds.append(speed)
    if path:
        write_json(as_json(plan, speeds), path)
    print(f"\n{stage_table(speeds)}")
    if path:
        say(f"\nfigures in {path}")
    return 0


def _bench_scene(options: argparse.Namespace) -> int:
    """Measure a scene as it is: its own images, bands and stars."""
    from dataclasses import asdict

    from warpsim.files import check_new_file, write_json
    from warpsim.speed.report import scene_speed_table, scene_speeds

    for name in ("pixels", "sensors", "stars", "psf"):
        if getattr(options, name) is not None:
            raise InputError("must not be given with a scene, which has its own", f"--{name}")
    path = Path(options.json) if options.json else None
    if path:
        check_new_file(path, (".json",), options.overwrite)
    start_warp()
    scenario = scenario_of(options.scene)
    devices = () if options.device is None else tuple(names(options.device) or ())
    n_frame = _frames_of_call(options.frames)
    speeds = list(scene_speeds(scenario, devices, 3 if options.quick else 9, n_frame, options.resident))
    say(scene_speed_table(scenario, speeds))
    if path:
        write_json({"scene": scenario.scene.name, "cases": [asdict(speed) for speed in speeds]}, path)
        say(f"\nfigures in {path}")
    return 0


def _frames_of_call(text: str | None) -> int | None:
    """Frames of a measured call of bench."""
    numbers = counts("--frames", text)
    if numbers is None:
        return None
    if len(numbers) > 1:
        raise InputError("must be one number", "--frames", text)
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
