"""The commands catalog (a report, a conversion), dataset (sampled sequences of a scene, with labels) and export."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpsim.commands.options import (
    FOLDER,
    OVERWRITE,
    Option,
    add_command,
    is_given,
    names,
    number,
    say,
    start_warp,
    whole_number,
)
from warpsim.errors import InputError

if TYPE_CHECKING:
    from warpsim.sky.catalog import StarCatalog


def add_commands(commands: Any) -> None:
    """Add the parsers of these commands."""
    add_command(
        commands, "catalog", "report on a star catalog, and convert it", _catalog,
        Option("FILE", "a catalog file, or default, union or synthetic"),
        Option("--format NAME", "survey or file format; guessed if left out"),
        Option("--readme PATH", "ReadMe that describes a CDS file"),
        Option("--columns PAIRS", "what is in which column: ra_deg=RAJ2000,flux_A_jy=F8", _column_names),
        Option("--table NAME", "which of several tables in the file, by name or number"),
        Option("--epoch YEAR", "Julian year of the positions; read from the file if left out", number),
        Option("--no-fill", "leave bands without a flux unknown"),
        Option("--n-star N", "number of stars of the synthetic catalog", whole_number),
        Option("--limit-jy JY", "instead: flux density of its faintest star in band A", number),
        Option("--sky NAME", "its density: astrometric (the default) or infrared"),
        Option("--seed N", "seed of the synthetic catalog, 0 if left out", whole_number),
        Option("-o, --output OUT", "also write the catalog: .fits, .ecsv, .vot or .csv"),
        Option("--plot PNG", "also draw the number of stars by band and magnitude"),
        OVERWRITE,
    )  # fmt: skip
    add_command(
        commands, "dataset", "write a data set: sampled sequences of a scene, with labels", _dataset,
        Option("RECIPE", "a recipe or scene: preset name, or path of .toml or .json"),
        FOLDER,
        Option("--sequences N", "number of sequences, instead of the recipe's", whole_number),
        Option("--frames N", "frames of each sequence, instead of the recipe's", whole_number),
        Option("--bands NAMES", "comma-separated bands, instead of the recipe's", names),
        Option("--format NAME", "instead of the recipe's: fits, fits-frames, png, tiff, zarr or webdataset"),
        Option("--seed N", "seed of what is drawn, instead of the recipe's", whole_number),
        Option("--workers N", "processes; as many as cores if left out", whole_number),
        Option("--scheduler ADDRESS", "let the workers of a Dask cluster do it: tcp://HOST:PORT"),
        Option("--device NAME", "Warp device of each worker: cpu, cuda:0"),
        Option("--overwrite", "replace a different data set in the folder"),
        Option("--quiet", "print nothing but errors"),
        resumes=True,
    )  # fmt: skip
    add_command(
        commands, "export", "write a data set once more, as a trainer wants it", _export,
        Option("DATASET", "folder of a finished data set"),
        Option("-o, --output DIR", "folder to write; missing or empty", required=True),
        Option("--format NAME", "yolo, mot or huggingface", required=True),
        Option("--channels NAME", "three channels: bands, or frames (the two before, then it)"),
        Option("--bands NAMES", "comma-separated bands; all if left out", names),
        Option("--splits NAMES", "comma-separated splits; all if left out", names),
        Option("--classes NAMES", "comma-separated classes to label; all if left out", names),
        Option("--least-snr X", "labels from this SNR in a target's pixel on", number, 0.0),
        Option("--knee NEI", "8 bits: linear up to here, 2 if left out", number, 2.0),
        Option("--top NEI", "8 bits: white from here on, 1000 if left out", number, 1000.0),
        Option("--quiet", "print nothing but errors"),
    )  # fmt: skip


def _catalog(options: argparse.Namespace) -> int:
    from warpsim.files import check_new_file
    from warpsim.output.star_catalogs import FORMAT_OF_SUFFIX, catalog_report, write_catalog
    from warpsim.plot.figure_files import check_figure_file, draw_star_counts

    output, figure = (Path(name) if name else None for name in (options.output, options.plot))
    if output:
        check_new_file(output, tuple(FORMAT_OF_SUFFIX), options.overwrite)
    if figure:
        check_figure_file(figure, options.overwrite, "--plot")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        catalog = _load_catalog(options)
    # Files before words: a reader that closes the pipe early (head) must not cost a file.
    written = write_catalog(catalog, output, options.overwrite) if output else None
    if figure:
        draw_star_counts(catalog, figure)
    say(catalog_report(catalog, [str(warning.message) for warning in caught]))
    if written is not None:
        say(f"\n{len(written):,} {'star' if len(written) == 1 else 'stars'} at J{written.epoch_jyear} in {output}")
    if figure:
        say(f"figure in {figure}")
    return 0


def _load_catalog(options: argparse.Namespace) -> StarCatalog:
    """The catalog named on the command line."""
    from warpsim.sky.catalog import StarCatalog

    name = options.file
    synthetic = ("n_star", "limit_jy", "sky", "seed")
    if name != "synthetic" and (given := [option for option in synthetic if is_given(options, option)]):
        raise InputError("is for synthetic only", f"--{given[0].replace('_', '-')}", name)
    if name in ("default", "union", "synthetic"):
        for option in ("format", "readme", "columns", "table", "epoch", "no_fill"):
            if is_given(options, option):
                raise InputError("is for files only", f"--{option.replace('_', '-')}", name)
    if name == "default":
        return StarCatalog.default()
    if name == "union":
        return StarCatalog.union()
    if name == "synthetic":
        if (options.n_star is None) == (options.limit_jy is None):
            raise InputError("--n-star, --limit-jy: exactly one must be given with synthetic, such as --n-star 1000000")
        return StarCatalog.synthetic(
            options.n_star, limit_jy=options.limit_jy, sky=options.sky or "astrometric", seed=options.seed or 0
        )
    return StarCatalog.read(
        name,
        options.format,
        columns=options.columns,
        table=options.table,
        epoch_jyear=options.epoch,
        readme=options.readme,
        fill=not options.no_fill,
    )


def _column_names(where: str, text: str) -> dict[str, str]:
    """Names in a file by warpsim's names of columns, from ra_deg=RAJ2000,flux_A_jy=F8."""
    pairs = [[part.strip() for part in item.split("=", 1)] for item in text.split(",") if item.strip()]
    if not pairs or any(len(pair) != 2 or not all(pair) for pair in pairs):
        raise InputError("must be NAME=COLUMN,NAME=COLUMN,...", where, text)
    return {pair[0]: pair[1] for pair in pairs}


def _dataset(options: argparse.Namespace) -> int:
    from warpsim.dataset.recipe import Recipe
    from warpsim.dataset.write_dataset import write_dataset

    given = {
        "n_sequence": options.sequences, "n_frame": options.frames, "seed": options.seed, "bands": options.bands,
        "format": options.format,
    }  # fmt: skip
    changes = {field: value for field, value in given.items() if value is not None}
    if options.workers is not None and options.scheduler is not None:
        raise InputError("must be left out with --scheduler, whose cluster has workers of its own", "--workers")
    recipe = Recipe.load(options.recipe, **changes)
    start_warp(options.quiet, in_workers=True)
    with _executor(options.scheduler) as executor:
        report = write_dataset(
            recipe, options.output, executor, options.workers, options.device, options.overwrite, not options.quiet
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
        options.bands,
        options.splits,
        options.classes,
        options.least_snr,
        options.knee,
        options.top,
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
