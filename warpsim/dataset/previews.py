"""Small films of a sequence, for people."""

from __future__ import annotations

from pathlib import Path

from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence
from warpsim.render.renderer import Renderer

PREVIEW_FRAMES = 100
"""At most, evenly chosen."""

FRAMES_PER_S = 10.0


def draw_previews(recipe: Recipe, sequence: Sequence, renderer: Renderer, folder: Path) -> None:
    """Draw a film of each sensor and band: SENSOR_BAND.gif."""
    from warpsim.output.preview import write_preview

    step = -(-recipe.n_frame // PREVIEW_FRAMES)
    frames = renderer.render(range(0, recipe.n_frame, step), sequence.sensors, recipe.band_names)
    counts = frames.counts.numpy()
    for s, sensor in enumerate(frames.sensors):
        for b, band in enumerate(frames.bands):
            path = folder / f"{sensor}_{band}.{recipe.preview}"
            write_preview(path, counts[:, s, b], sequence.scene.levels[band], FRAMES_PER_S)
