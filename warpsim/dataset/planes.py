"""Planes of images that are written besides the counts."""

from __future__ import annotations

import numpy as np

from warpsim.dataset.recipe import Recipe
from warpsim.dataset.writers import Planes
from warpsim.render.frameset import FrameSet
from warpsim.scene.instrument import Instrument


def planes_of(recipe: Recipe, frames: FrameSet) -> Planes:
    """Return the arrays of a render call by name, with the axes (frame, sensor, band, ...)."""
    planes: Planes = {"counts": frames.counts.numpy()}
    if recipe.signal and frames.signal_w_cm2 is not None:
        planes["signal_w_cm2"] = frames.signal_w_cm2.numpy()
    if recipe.masks:
        planes["mask"] = frames.target_masks(recipe.least_nei)
    if recipe.contributions:
        images, (n_row, n_col) = frames.counts.shape[:3], frames.counts.shape[3:]
        light = np.zeros((*images, len(frames.scenario.targets), n_row, n_col), dtype=np.float32)
        for f, s, b in np.ndindex(light.shape[:3]):
            light[f, s, b] = frames.contributions_w_cm2(frames.frames[f], frames.sensors[s], frames.bands[b])
        planes["contributions_w_cm2"] = light
    return planes


def bytes_per_view(recipe: Recipe, instrument: Instrument, n_target: int) -> int:
    """Return the memory of a view [bytes], with all bands, planes and temporaries."""
    per_pixel = 2 + 4 * recipe.signal + 2 * recipe.masks + 4 * n_target * (recipe.contributions or recipe.masks)
    return per_pixel * recipe.pixels_of(instrument)
