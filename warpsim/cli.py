"""Command line: warpsim render | dataset | access | check | plot | czml | catalog | bench."""

from __future__ import annotations

import argparse
import ctypes.util
import math
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpsim.errors import InputError
from warpsim.version import __version__

if TYPE_CHECKING:
    from warpsim.scene.scenario import Scenario
    from warpsim.sky.catalog import StarCatalog
    from warpsim.speed.report import BenchmarkPlan, Speed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; exit code 0, 1 when a file could not be written, 2 for bad input, 130 when interrupted."""
    # UTC has no leap seconds announced beyond the next half year; later epochs count without further ones.
    warnings.filterwarnings("ignore", message='.*"dubious year')
    parser = _parser()
    options = parser.parse_args(arguments)
    try:
        command: Callable[[argparse.Namespace], int] = options.command
        return command(options)
    except InputError as error:
        print(f"warpsim: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of a pipe has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, say
        print(f"warpsim: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("warpsim: interrupted; the same command goes on where it stopped", file=sys.stderr)
        return 130


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    """Show a warning as one line, without its source location."""
    print(f"warpsim: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    from warpsim.dataset.command import add_arguments
    from warpsim.dataset.command import run as run_dataset

    parser = argparse.ArgumentParser(prog="warpsim", description="Render what space-based infrared sensors see.")
    parser.add_argument("--version", action="version", version=f"warpsim {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    render = commands.add_parser("render", help="render a scene into a folder")
    _add_scene(render)
    _add_render(render)
    render.set_defaults(command=_render)

    access = commands.add_parser("access", help="list when each sensor can observe a target")
    _add_scene(access)
    _add_access(access)
    access.set_defaults(command=_access)

    check = commands.add_parser("check", help="validate a scene or a recipe and report on it")
    _add_scene(check)
    check.set_defaults(command=_check)

    plot = commands.add_parser("plot", help="draw a scene: Earth and orbits, tracks, group, attitudes, access, views")
    _add_scene(plot)
    plot.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write to")
    plot.add_argument("--time", metavar="S", help="seconds after the epoch; the middle of the scene if left out")
    plot.add_argument("--sensors", metavar="NAMES", help="comma-separated: whose views; three with access if left out")
    plot.add_argument("--overwrite", action="store_true", help="replace existing files")
    plot.set_defaults(command=_plot)

    czml = commands.add_parser("czml", help="write a scene for Cesium: paths, names, lines of sight during access")
    _add_scene(czml)
    czml.add_argument("-o", "--output", required=True, metavar="FILE", help="file to write: .czml")
    czml.add_argument("--step", metavar="S", help="time between positions [s]; chosen by their error if left out")
    czml.add_argument("--overwrite", action="store_true", help="replace an existing file")
    czml.set_defaults(command=_czml)

    catalog = commands.add_parser("catalog", help="report on a star catalog, and convert it")
    _add_catalog(catalog)
    catalog.set_defaults(command=_catalog)

    dataset = commands.add_parser("dataset", help="write a data set: sampled sequences of a scene, with labels")
    add_arguments(dataset)
    dataset.set_defaults(command=lambda options: run_dataset(options, _whole_number, _start_warp))

    bench = commands.add_parser("bench", help="frames per second against image size and sensors on this machine")
    _add_bench(bench)
    bench.set_defaults(command=_bench)
    return parser


def _add_scene(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", metavar="SCENE", help="preset name (stss), or path of a .toml or .json file")


def _add_render(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to write to")
    parser.add_argument("--frames", metavar="A:B[:STEP]", help="frame numbers, like a Python slice")
    parser.add_argument(
        "--sensors", metavar="NAMES", help="comma-separated sensors, kinds of them, or patterns like 'sat1*'"
    )
    parser.add_argument("--bands", metavar="NAMES", help="comma-separated band names")
    parser.add_argument("--device", help="Warp device: cpu, cuda:0, ...")
    parser.add_argument("--every-frame", action="store_true", help="also frames without access to a target")
    parser.add_argument("--stars", action="store_true", help="also list the stars in every image, in stars.fits")
    formats = "comma-separated: fits (the default), tiff, png, exr (noiseless), zarr"
    parser.add_argument("--format", default="fits", metavar="NAMES", help=formats)
    parser.add_argument("--preview", metavar="NAME", help="also an animation of each sensor and band: gif or mp4")
    parser.add_argument("--overwrite", action="store_true", help="replace a different run in the folder")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no report")


def _add_access(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--target", metavar="NAME", help="what the scene's access_target says if left out")
    parser.add_argument(
        "--sensors", metavar="NAMES", help="comma-separated sensors, kinds of them, or patterns like 'sat1*'"
    )
    parser.add_argument("--format", default="table", metavar="NAME", help="table (the default), csv or ecsv")
    parser.add_argument("--step", metavar="S", help="step of the scan for changes [s], 10 if left out")
    parser.add_argument("--plot", metavar="FILE", help="also draw the intervals and the ranges: .png, .pdf or .svg")
    parser.add_argument("--overwrite", action="store_true", help="replace an existing figure")


def _add_catalog(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("catalog", metavar="FILE", help="a catalog file, or default, union or synthetic")
    parser.add_argument("--format", metavar="NAME", help="survey or file format; guessed if left out")
    parser.add_argument("--readme", metavar="PATH", help="ReadMe that describes a CDS file")
    parser.add_argument("--columns", metavar="PAIRS", help="what is in which column: ra_deg=RAJ2000,flux_A_jy=F8")
    parser.add_argument("--no-fill", action="store_true", help="leave bands without a flux unknown")
    parser.add_argument("--n-star", metavar="N", help="number of stars of the synthetic catalog")
    parser.add_argument("--limit-jy", metavar="JY", help="instead: flux density of its faintest star in band A")
    parser.add_argument("--sky", metavar="NAME", help="its density: astrometric (the default) or infrared")
    parser.add_argument("--seed", metavar="N", help="seed of the synthetic catalog, 0 if left out")
    parser.add_argument("-o", "--output", metavar="OUT", help="also write the catalog: .fits, .ecsv, .vot or .csv")
    parser.add_argument("--plot", metavar="PNG", help="also draw the number of stars by band and magnitude")
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")


def _add_bench(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("scene", nargs="?", help="preset or file: measure each kind of its sensors as it is")
    parser.add_argument("--device", metavar="NAMES", help="Warp devices: cpu, cuda:0, ...; all if left out")
    parser.add_argument("--pixels", metavar="N,N", help="rows and columns; 128,256,512,1024 if left out")
    parser.add_argument("--sensors", metavar="N,N", help="numbers of sensors; 1,20 if left out")
    parser.add_argument("--stars", metavar="N", help="stars in view, about; 100 if left out")
    parser.add_argument("--psf", metavar="NAME", help="airy (the default), or gaussian: of 0.7 px")
    parser.add_argument("--frames", metavar="N", help="frames of a call; as many as 64 MB of counts hold if left out")
    parser.add_argument("--resident", action="store_true", help="leave counts on the device: nothing is copied")
    parser.add_argument("--quick", action="store_true", help="fewer and shorter calls: good to a factor, in seconds")
    parser.add_argument("--json", metavar="FILE", help="also write the figures: .json")
    parser.add_argument("--overwrite", action="store_true", help="replace an existing file")


def _start_warp() -> None:
    """Start Warp without its messages: the report is for a person.

    On a machine without an NVIDIA driver Warp's native part warns on the error stream at every start; that such a
    machine has no CUDA is known, so the stream is closed to it for that moment.
    """
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    if ctypes.util.find_library("cuda") is not None:
        wp.init()
        return
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
            os.dup2(nowhere.fileno(), 2)
            wp.init()
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _render(options: argparse.Namespace) -> int:
    from warpsim.output.run import render_to_folder

    scenario = _scenario(options.scene)
    _start_warp()
    report = render_to_folder(
        scenario,
        options.output,
        frames=_frame_numbers(options.frames),
        sensors=_names(options.sensors),
        bands=_names(options.bands),
        device=options.device,
        overwrite=options.overwrite,
        stars=options.stars,
        every_frame=options.every_frame,
        progress=not options.quiet,
        formats=_names(options.format) or (),
        preview=options.preview,
    )
    if not options.quiet:
        print(report.text())
    return 0


def _scenario(source: str) -> Scenario:
    """The scenario of a preset or a scene file; errors begin with its name."""
    from warpsim.scene.scene import Scene

    scene = Scene.load(source)
    try:
        return scene.scenario
    except InputError as error:
        raise error.of(source) from None


def _access(options: argparse.Namespace) -> int:
    from warpsim.scene.target_access import ACCESS_STEP_S

    if options.format not in ("table", "csv", "ecsv"):
        raise InputError("must be table, csv or ecsv", "--format", options.format)
    step_s = ACCESS_STEP_S if options.step is None else _number("--step", options.step)
    if not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", "--step", options.step)
    figure = Path(options.plot) if options.plot else None
    if figure:
        from warpsim.plot.figure_files import check_figure_file, draw_access

        check_figure_file(figure, options.overwrite, "--plot")
    scenario = _scenario(options.scene)
    sensors = _names(options.sensors)
    table = scenario.access(options.target, sensors, step_s=step_s)
    if figure:  # files before words, as with catalogs
        draw_access(scenario, figure, table, sensors)
    if options.format != "table":
        table.write(sys.stdout, format=f"ascii.{options.format}")
        return 0
    counted = {"tracked": "what each sensor tracks", "any": "any target"}.get(
        table.meta["target"], table.meta["target"]
    )
    print(f"{scenario.scene.name}: access to {counted}, seconds after {scenario.scene.epoch_utc} UTC")
    if len(table):
        print("\n".join(table.pformat(max_lines=-1, max_width=-1, show_unit=True)))
    n_sensor = len(scenario.select_sensors(sensors))
    seen, total_s = len(set(table["sensor"])), float(sum(table["duration_s"]))
    print(f"{seen} of {n_sensor} sensors have access, {total_s:.1f} s in all")
    if figure:
        print(f"figure in {figure}")
    return 0


def _check(options: argparse.Namespace) -> int:
    from warpsim.output.check import scene_report
    from warpsim.scene.scene_files import read_scene_data

    _start_warp()  # areas of some shapes come from kernels
    if "scene" not in read_scene_data(options.scene):
        print(scene_report(_scenario(options.scene)))
        return 0
    from warpsim.dataset.recipe import Recipe
    from warpsim.dataset.recipe_report import recipe_report

    recipe = Recipe.load(options.scene)
    print(
        f"{recipe_report(recipe)}\n\nThe scene that sequences are variations of:\n{scene_report(recipe.scene.scenario)}"
    )
    return 0


def _plot(options: argparse.Namespace) -> int:
    from warpsim.plot.figure_files import draw_scenario

    time_s = None if options.time is None else _number("--time", options.time)
    scenario = _scenario(options.scene)
    _start_warp()
    sensors = _names(options.sensors)
    written = draw_scenario(scenario, Path(options.output), time_s, options.overwrite, sensors)
    names = ", ".join(path.name for path in written)
    print(f"{len(written)} figures of {scenario.scene.name} in {options.output}: {names}")
    return 0


def _czml(options: argparse.Namespace) -> int:
    from warpsim.output.czml import write_czml

    path = Path(options.output)
    step_s = None if options.step is None else _number("--step", options.step)
    scenario = _scenario(options.scene)
    error_m = write_czml(scenario, path, step_s, overwrite=options.overwrite)
    n_body = len(scenario.satellite_names) + len(scenario.target_names)
    print(f"{n_body} bodies in {path} ({path.stat().st_size / 1e6:.2f} MB), positions within {error_m:.2g} m")
    return 0


def _catalog(options: argparse.Namespace) -> int:
    from warpsim.files import check_new_file
    from warpsim.output.catalog_file import FORMAT_OF_SUFFIX, write_catalog
    from warpsim.output.catalog_report import catalog_report
    from warpsim.plot.figure import FIGURE_SUFFIXES, need_matplotlib

    output, figure = (Path(name) if name else None for name in (options.output, options.plot))
    if output:
        check_new_file(output, tuple(FORMAT_OF_SUFFIX), options.overwrite)
    if figure:
        check_new_file(figure, FIGURE_SUFFIXES, options.overwrite)
        need_matplotlib("--plot")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        catalog = _load_catalog(options)
    # Files before words: a reader that closes the pipe early (head) must not cost a file.
    written = write_catalog(catalog, output, options.overwrite) if output else None
    if figure:
        _draw_counts(catalog, figure)
    print(catalog_report(catalog, [str(warning.message) for warning in caught]))
    if written is not None:
        print(f"\n{len(written):,} {'star' if len(written) == 1 else 'stars'} at J{written.epoch_jyear} in {output}")
    if figure:
        print(f"figure in {figure}")
    return 0


def _load_catalog(options: argparse.Namespace) -> StarCatalog:
    """The catalog named on the command line."""
    from warpsim.sky.catalog import StarCatalog

    name = options.catalog
    made_up = ("n_star", "limit_jy", "sky", "seed")
    if name != "synthetic" and (given := [option for option in made_up if getattr(options, option)]):
        raise InputError("is for synthetic only", f"--{given[0].replace('_', '-')}", name)
    if name in ("default", "union", "synthetic"):
        for option in ("format", "readme", "columns", "no_fill"):
            if getattr(options, option):
                raise InputError("is for files only", f"--{option.replace('_', '-')}", name)
    if name == "default":
        return StarCatalog.default()
    if name == "union":
        return StarCatalog.union()
    if name == "synthetic":
        if (options.n_star is None) == (options.limit_jy is None):
            raise InputError("--n-star, --limit-jy: exactly one must be given with synthetic, such as --n-star 1000000")
        return StarCatalog.synthetic(
            None if options.n_star is None else _whole_number("--n-star", options.n_star),
            limit_jy=None if options.limit_jy is None else _number("--limit-jy", options.limit_jy),
            sky=options.sky or "astrometric",
            seed=0 if options.seed is None else _whole_number("--seed", options.seed),
        )
    columns = None if options.columns is None else _column_names(options.columns)
    return StarCatalog.read(name, options.format, columns=columns, readme=options.readme, fill=not options.no_fill)


def _draw_counts(catalog: StarCatalog, path: Path) -> None:
    """Draw star counts to a file without pyplot, which would ask for a display."""
    from matplotlib.figure import Figure

    from warpsim.plot.figure import save_figure
    from warpsim.plot.sky_figure import plot_star_counts

    figure = Figure(figsize=(8.5, 4.8), layout="constrained")
    plot_star_counts(catalog, ax=figure.add_subplot())
    save_figure(figure, path)


def _column_names(text: str) -> dict[str, str]:
    """Names in a file by warpsim's names of columns, from ra_deg=RAJ2000,flux_A_jy=F8."""
    pairs = [[part.strip() for part in item.split("=", 1)] for item in text.split(",") if item.strip()]
    if not pairs or any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise InputError("must be NAME=COLUMN,NAME=COLUMN,...", "--columns", text)
    return {pair[0]: pair[1] for pair in pairs}


def _whole_number(where: str, text: str) -> int:
    """A whole number such as 1000000 or 1e6."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not number.is_integer():
        raise InputError("must be a whole number", value=text).of(where)
    return int(number)


def _number(where: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError("must be a number", value=text).of(where) from None


def _bench_scene(options: argparse.Namespace) -> int:
    """Measure a scene as it is: its own images, bands and stars."""
    from dataclasses import asdict

    from warpsim.files import check_new_file, write_json
    from warpsim.speed.scene_speed import scene_speed_table, scene_speeds

    for name in ("pixels", "sensors", "stars", "psf"):
        if getattr(options, name) is not None:
            raise InputError("must not be given with a scene, which has its own", f"--{name}")
    path = Path(options.json) if options.json else None
    if path:
        check_new_file(path, (".json",), options.overwrite)
    _start_warp()
    scenario = _scenario(options.scene)
    devices = () if options.device is None else tuple(_names(options.device) or ())
    n_frame = _frames_of_call(options.frames)
    speeds = list(scene_speeds(scenario, devices, 3 if options.quick else 9, n_frame, options.resident))
    print(scene_speed_table(scenario, speeds))
    if path:
        write_json({"scene": scenario.scene.name, "cases": [asdict(speed) for speed in speeds]}, path)
        print(f"\nfigures in {path}")
    return 0


def _bench(options: argparse.Namespace) -> int:
    if options.scene is not None:
        return _bench_scene(options)
    from warpsim.files import check_new_file, write_json
    from warpsim.speed.report import BenchmarkPlan, as_json, heading, measured, row, stage_table
    from warpsim.speed.work import PSFS

    path = Path(options.json) if options.json else None
    if path:
        check_new_file(path, (".json",), options.overwrite)
    if options.device is not None and not _names(options.device):
        raise InputError("must name a device", "--device", options.device)
    if options.psf not in (None, *PSFS):
        raise InputError(f"must be {' or '.join(PSFS)}", "--psf", options.psf)
    n_star = None if options.stars is None else _whole_number("--stars", options.stars)
    if n_star is not None and n_star < 0:
        raise InputError("must be >= 0", "--stars", n_star)
    given: dict[str, Any] = {
        "devices": None if options.device is None else tuple(_names(options.device) or ()),
        "pixels": _counts("--pixels", options.pixels),
        "sensors": _counts("--sensors", options.sensors),
        "n_star": n_star,
        "psf": options.psf,
        "frames": _frames_of_call(options.frames),
    }
    switches = {"quick": options.quick, "resident": options.resident}
    plan = BenchmarkPlan(**{name: value for name, value in given.items() if value is not None}, **switches)
    _check_sizes(plan)
    _start_warp()
    speeds: list[Speed] = []
    for speed in measured(plan):
        print(row(speed) if speeds else f"{heading(plan)}\n{row(speed)}", flush=True)
        speeds.append(speed)
    if path:
        write_json(as_json(plan, speeds), path)
    print(f"\n{stage_table(speeds)}")
    if path:
        print(f"\nfigures in {path}")
    return 0


def _frames_of_call(text: str | None) -> int | None:
    """Frames of a measured call of bench."""
    numbers = _counts("--frames", text)
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


def _counts(where: str, text: str | None) -> tuple[int, ...] | None:
    """Return whole numbers >= 1 of a comma-separated list."""
    if text is None:
        return None
    numbers = tuple(_whole_number(where, item) for item in text.split(","))
    if min(numbers) < 1:
        raise InputError("must be whole numbers >= 1", value=text).of(where)
    return numbers


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]


def _frame_numbers(text: str | None) -> list[int] | slice | None:
    """Frame numbers of A:B, A:B:STEP (a slice of the frames of each sensor) or a single number."""
    if text is None:
        return None
    try:
        numbers = [int(item) if item.strip() else None for item in text.split(":")]
        if len(numbers) == 1 and numbers[0] is not None:
            return [numbers[0]]
        if len(numbers) not in (2, 3) or 0 in numbers[2:]:
            raise ValueError
        return slice(*numbers)
    except ValueError:
        raise InputError("must be A:B, A:B:STEP or one number", "--frames", text) from None


def run() -> None:
    """Entry point of the `warpsim` command."""
    warnings.showwarning = _show_warning
    sys.exit(main())


if __name__ == "__main__":
    run()
