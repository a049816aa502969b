"""Report of a recipe for `warpsim check`."""

from __future__ import annotations

import json

from warpsim.dataset.layout import identity_of, shards_of
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence, check_extremes, draw_sequence, split_of


def recipe_report(recipe: Recipe) -> str:
    """Size, splits and sampled fields of a data set, and its first sequence as an example.

    Raises:
        InputError: The scene does not take what may be drawn, a file cannot be read, or no sequence can be drawn.
    """
    check_extremes(recipe)
    identity_of(recipe, "cpu")  # reads every file that is named
    n_pool = len(recipe.pool_of(recipe.scenario))
    size = recipe.n_sequence * recipe.n_frame * recipe.frame_bytes
    splits = ", ".join(f"{name} {len(numbers)}" for name, numbers in split_of(recipe).items())
    lines = [
        f"{recipe.n_image:,} images: {recipe.n_sequence:,} sequences of {recipe.n_frame} frames every "
        f"{recipe.step_s:g} s, {recipe.n_sensor} of {n_pool} sensors, bands {' '.join(recipe.band_names)}",
        f"sequences: {splits}",
        f"{recipe.format}, {len(shards_of(recipe)):,} shards; {size / 1e6:,.1f} MB before compression, and tables",
        *(f"drawn: {name} = {json.dumps(how)[:80]}" for name, how in recipe.to_dict().get("sample", {}).items()),
        _example(draw_sequence(recipe, 0)),
    ]
    return "\n".join(lines)


def _example(sequence: Sequence) -> str:
    values = "".join(f", {name} = {value!r}" for name, value in sequence.values.items())
    start_s = sequence.scene.frames.start_s
    return f"sequence 0: from {start_s:.3f} s on, {', '.join(sequence.sensors)}{values}"
