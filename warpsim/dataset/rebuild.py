"""Sequences of a data set as scenes again: from the recipe in its manifest, as they were drawn."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

from warpsim.arguments import whole_number
from warpsim.dataset.layout import Sequence, draw_sequence, input_checksums_of
from warpsim.dataset.recipe import Recipe
from warpsim.errors import InputError, errors_at
from warpsim.files import read_json
from warpsim.output.checkpoints import is_record
from warpsim.output.output_folder import MANIFEST
from warpsim.version import __version__


def rebuild_sequence(folder: str | os.PathLike[str], number: int) -> Sequence:
    """Return a sequence of a data set as it was drawn: its scene, sensors and drawn values.

    `ws.Renderer(sequence.scene).render(range(n_frame), sequence.sensors)` gives the counts of the files, bit for bit,
    on the same kind of device with the same versions. Sensors of several kinds are rendered kind by kind
    (`sequence.by_kind`).

    Args:
        folder: Folder of a complete data set.
        number: Number of the sequence, as in `sequences.parquet`.

    Returns:
        The sequence: `scene` (with the drawn values, a seed of its own, and frames 0 to n_frame - 1), `scenario`,
        `sensors`, `by_kind`, `values` by field, `attempt`, `number`. A warning says if it was written by another
        version.

    Raises:
        InputError: The folder holds no complete data set, no such sequence, or a file that it was made from is missing
            or was changed since.
    """
    path = Path(folder) / MANIFEST
    manifest = read_json(path)
    if not is_record(manifest) or "recipe" not in manifest:
        raise InputError("holds no complete data set, which has a manifest with a recipe").of(folder)
    with errors_at("", os.fspath(path)):
        recipe = Recipe.from_dict(manifest["recipe"])
        number = whole_number("number", number, 0)
        if number >= recipe.n_sequence:
            raise InputError(f"must be below {recipe.n_sequence:,}, the sequences there are", "number", number)
        inputs = input_checksums_of(recipe)
        for name, checksum in manifest.get("inputs", {}).items():
            if inputs.get(name) != checksum:
                raise InputError(f"{name} was changed since the data set was written")
    if manifest.get("warpsim") != __version__:
        warnings.warn(
            f"{path}: written by warpsim {manifest.get('warpsim')}, this is {__version__}: counts may differ",
            stacklevel=2,
        )
    return draw_sequence(recipe, number)
