"""The command dataset: sampled sequences of a scene, with labels."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from warpsim.commands.options import names, start_warp, whole_number
from warpsim.errors import InputError


def add_commands(commands: Any) -> None:
    """Add the parser of this command."""
    dataset = commands.add_parser("dataset", help="write a data set: sampled sequences of a scene, with labels")
    dataset.add_argument("recipe", metavar="RECIPE", help="a recipe or scene: preset name, or path of .toml or .json")
    dataset.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    dataset.add_argument("--sequences", metavar="N", help="number of sequences, instead of the recipe's")
    dataset.add_argument("--frames", metavar="N", help="frames of each sequence, instead of the recipe's")
    dataset.add_argument("--bands", metavar="NAMES", help="comma-separated bands, instead of the recipe's")
    dataset.add_argument(
        "--format", metavar="NAME", help="instead of the recipe's: fits, png, tiff, zarr or webdataset"
    )
    dataset.add_argument("--seed", metavar="N", help="seed of what is drawn, instead of the recipe's")
    dataset.add_argument("--workers", metavar="N", help="processes; as many as cores if left out")
    dataset.add_argument(
        "--scheduler", metavar="ADDRESS", help="let the workers of a Dask cluster do it: tcp://HOST:PORT"
    )
    dataset.add_argument("--device", metavar="NAME", help="Warp device of each worker: cpu, cuda:0")
    dataset.add_argument("--overwrite", action="store_true", help="replace a different data set in the folder")
    dataset.add_argument("--quiet", action="store_true", help="print nothing but errors")
    dataset.set_defaults(command=_dataset)


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
