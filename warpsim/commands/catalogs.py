"""The commands catalog (a report, a conversion), dataset (sampled sequences of a scene, with labels) and export."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpsim.commands.options import names, number, say, start_warp, whole_number
from warpsim.errors import InputError

if TYPE_CHECKING:
    from warpsim.sky.catalog import StarCatalog


def add_commands(commands: Any) -> None:
    """Add the parsers of these commands."""
    catalog = commands.add_parser("catalog", help="report on a star catalog, and convert it")
    catalog.add_argument("catalog", metavar="FILE", help="a catalog file, or default, union or synthetic")
    catalog.add_argument("--format", metavar="NAME", help="survey or file format; guessed if left out")
    catalog.add_argument("--readme", metavar="PATH", help="ReadMe that describes a CDS file")
    catalog.add_argument("--columns", metavar="PAIRS", help="what is in which column: ra_deg=RAJ2000,flux_A_jy=F8")
    catalog.add_argument("--table", metavar="NAME", help="which of several tables in the file, by name or number")
    catalog.add_argument("--epoch", metavar="YEAR", help="Julian year of the positions; read from the file if left out")
    catalog.add_argument("--no-fill", action="store_true", help="leave bands without a flux unknown")
    catalog.add_argument("--n-star", metavar="N", help="number of stars of the synthetic catalog")
    catalog.add_argument("--limit-jy", metavar="JY", help="instead: flux density of its faintest star in band A")
    catalog.add_argument("--sky", metavar="NAME", help="its density: astrometric (the default) or infrared")
    catalog.add_argument("--seed", metavar="N", help="seed of the synthetic catalog, 0 if left out")
    catalog.add_argument("-o", "--output", metavar="OUT", help="also write the catalog: .fits, .ecsv, .vot or .csv")
    catalog.add_argument("--plot", metavar="PNG", help="also draw the number of stars by band and magnitude")
    catalog.add_argument("--overwrite", action="store_true", help="replace existing files")
    catalog.set_defaults(command=_catalog)
    _add_dataset(commands)


def _catalog(options: argparse.Namespace) -> int:
    from warpsim.files import check_new_file
    from warpsim.output.catalogs import FORMAT_OF_SUFFIX, catalog_report, write_catalog
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
    say(catalog_report(catalog, [str(warning.message) for warning in caught]))
    if written is not None:
        say(f"\n{len(written):,} {'star' if len(written) == 1 else 'stars'} at J{written.epoch_jyear} in {output}")
    if figure:
        say(f"figure in {figure}")
    return 0


def _load_catalog(options: argparse.Namespace) -> StarCatalog:
    """The catalog named on the command line."""
    from warpsim.sky.catalog import StarCatalog

    name = options.catalog
    synthetic = ("n_star", "limit_jy", "sky", "seed")
    if name != "synthetic" and (given := [option for option in synthetic if getattr(options, option)]):
        raise InputError("is for synthetic only", f"--{given[0].replace('_', '-')}", name)
    if name in ("default", "union", "synthetic"):
        for option in ("format", "readme", "columns", "table", "epoch", "no_fill"):
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
            None if options.n_star is None else whole_number("--n-star", options.n_star),
            limit_jy=None if options.limit_jy is None else number("--limit-jy", options.limit_jy),
            sky=options.sky or "astrometric",
            seed=0 if options.seed is None else whole_number("--seed", options.seed),
        )
    columns = None if options.columns is None else _column_names(options.columns)
    return StarCatalog.read(
        name,
        options.format,
        columns=columns,
        table=options.table,
        epoch_jyear=None if options.epoch is None else number("--epoch", options.epoch),
        readme=options.readme,
        fill=not options.no_fill,
    )


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


def _add_dataset(commands: Any) -> None:
    dataset = commands.add_parser("dataset", help="write a data set: sampled sequences of a scene, with labels")
    dataset.add_argument("recipe", metavar="RECIPE", help="a recipe or scene: preset name, or path of .toml or .json")
    dataset.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    dataset.add_argument("--sequences", metavar="N", help="number of sequences, instead of the recipe's")
    dataset.add_argument("--frames", metavar="N", help="frames of each sequence, instead of the recipe's")
    dataset.add_argument("--bands", metavar="NAMES", help="comma-separated bands, instead of the recipe's")
    formats = "instead of the recipe's: fits, fits-frames, png, tiff, zarr or webdataset"
    dataset.add_argument("--format", metavar="NAME", help=formats)
    dataset.add_argument("--seed", metavar="N", help="seed of what is drawn, instead of the recipe's")
    dataset.add_argument("--workers", metavar="N", help="processes; as many as cores if left out")
    dataset.add_argument(
        "--scheduler", metavar="ADDRESS", help="let the workers of a Dask cluster do it: tcp://HOST:PORT"
    )
    dataset.add_argument("--device", metavar="NAME", help="Warp device of each worker: cpu, cuda:0")
    dataset.add_argument("--overwrite", action="store_true", help="replace a different data set in the folder")
    dataset.add_argument("--quiet", action="store_true", help="print nothing but errors")
    dataset.set_defaults(command=_dataset, resumes=True)

    export = commands.add_parser("export", help="write a data set once more, as a trainer wants it")
    export.add_argument("dataset", metavar="DATASET", help="folder of a finished data set")
    export.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write; missing or empty")
    export.add_argument("--format", metavar="NAME", required=True, help="yolo, mot or huggingface")
    export.add_argument("--channels", metavar="NAME", help="three channels: bands, or frames (the two before, then it)")
    export.add_argument("--bands", metavar="NAMES", help="comma-separated bands; all if left out")
    export.add_argument("--splits", metavar="NAMES", help="comma-separated splits; all if left out")
    export.add_argument("--classes", metavar="NAMES", help="comma-separated classes to label; all if left out")
    export.add_argument("--least-snr", metavar="X", default="0", help="labels from this SNR in a target's pixel on")
    export.add_argument("--knee", metavar="NEI", default="2", help="8 bits: linear up to here, 2 if left out")
    export.add_argument("--top", metavar="NEI", default="1000", help="8 bits: white from here on, 1000 if left out")
    export.add_argument("--quiet", action="store_true", help="print nothing but errors")
    export.set_defaults(command=_export)


def _dataset(options: argparse.Namespace) -> int:
    from warpsim.dataset.recipe import Recipe
    from warpsim.dataset.write_dataset import write_dataset

    numbers = {"n_sequence": "sequences", "n_frame": "frames", "seed": "seed"}
    changes: dict[str, Any] = {
        field: whole_number(f"--{option}", value)
        for field, option in numbers.items()
        if (value := getattr(options, option)) is not None
    }
    if options.bands is not None:
        changes["bands"] = names(options.bands)
    if options.format is not None:
        changes["format"] = options.format
    if options.workers is not None and options.scheduler is not None:
        raise InputError("must be left out with --scheduler, whose cluster has workers of its own", "--workers")
    n_worker = None if options.workers is None else whole_number("--workers", options.workers)
    recipe = Recipe.load(options.recipe, **changes)
    start_warp(options.quiet, in_workers=True)
    with _executor(options.scheduler) as executor:
        report = write_dataset(
            recipe, options.output, executor, n_worker, options.device, options.overwrite, not options.quiet
        )
    if not options.quiet:
        say(report.text())
    return 0


def _export(options: argparse.Namespace) -> int:
    from warpsim.dataset.export import export_dataset

    report = export_dataset(
        options.dataset,
        options.output,
        options.format,
        options.channels,
        names(options.bands),
        names(options.splits),
        names(options.classes),
        number("--least-snr", options.least_snr),
        number("--knee", options.knee),
        number("--top", options.top),
        not options.quiet,
    )
    if not options.quiet:
        say(report.text())
    return 0


@contextmanager
def _executor(scheduler: str | None) -> Iterator[Executor | None]:
    if scheduler is None:
        yield None
        return
    from warpsim.dataset.execution import dask_executor

    with dask_executor(scheduler) as executor:
        yield executor
