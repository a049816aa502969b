"""The command `warpsim dataset`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from warpsim.errors import InputError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of the command."""
    parser.add_argument("recipe", metavar="RECIPE", help="a recipe or scene: preset name, or path of .toml or .json")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    parser.add_argument("--sequences", metavar="N", help="number of sequences, instead of the recipe's")
    parser.add_argument("--frames", metavar="N", help="frames of each sequence, instead of the recipe's")
    parser.add_argument("--bands", metavar="NAMES", help="comma-separated bands, instead of the recipe's")
    parser.add_argument("--format", metavar="NAME", help="fits, png, tiff, zarr or webdataset, instead of the recipe's")
    parser.add_argument("--seed", metavar="N", help="seed of what is drawn, instead of the recipe's")
    parser.add_argument("--workers", metavar="N", help="processes; as many as cores if left out")
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="let the workers of a Dask cluster do it: tcp://HOST:PORT"
    )
    parser.add_argument("--device", metavar="NAME", help="Warp device of each worker: cpu, cuda:0")
    parser.add_argument("--overwrite", action="store_true", help="replace a different data set in the folder")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")


def run(options: argparse.Namespace, whole_number: Callable[[str, str], int], start_warp: Callable[[], None]) -> int:
    """Run the command; return the exit code."""
    from warpsim.dataset.recipe import Recipe
    from warpsim.dataset.write_dataset import write_dataset

    numbers = {"n_sequence": "sequences", "n_frame": "frames", "seed": "seed"}
    changes: dict[str, Any] = {
        field: whole_number(f"--{option}", value)
        for field, option in numbers.items()
        if (value := getattr(options, option)) is not None
    }
    if options.bands is not None:
        changes["bands"] = [name.strip() for name in options.bands.split(",") if name.strip()]
    if options.format is not None:
        changes["format"] = options.format
    if options.workers is not None and options.scheduler is not None:
        raise InputError("must be left out with --scheduler, whose cluster has workers of its own", "--workers")
    n_worker = None if options.workers is None else whole_number("--workers", options.workers)
    recipe = Recipe.load(options.recipe, **changes)
    start_warp()
    with _executor(options.scheduler) as executor:
        report = write_dataset(
            recipe, options.output, executor, n_worker, options.device, options.overwrite, not options.quiet
        )
    if not options.quiet:
        print(report.text())
    return 0


@contextmanager
def _executor(scheduler: str | None) -> Iterator[Executor | None]:
    if scheduler is None:
        yield None
        return
    from warpsim.dataset.execution import dask_executor

    with dask_executor(scheduler) as executor:
        yield executor
