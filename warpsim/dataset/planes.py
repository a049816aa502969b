"""What is written of each image besides its counts."""

from __future__ import annotations

from typing import Any

import numpy as np

from warpsim.dataset.recipe import Recipe
from warpsim.dataset.writers import Planes
from warpsim.render.frameset import FrameSet
from warpsim.scene.scene import Scene


def planes_of(recipe: Recipe, frames: FrameSet) -> Planes:
    """Arrays of a render call by name, with the axes (frame, sensor, band, ...)."""
    planes: Planes = {"counts": frames.counts.numpy()}
    if recipe.signal and frames.signal_w_cm2 is not None:
        planes["signal_w_cm2"] = frames.signal_w_cm2.numpy()
    if recipe.masks:
        planes["mask"] = _each(frames, lambda f, s, b: frames.target_mask(f, s, b, recipe.least_nei))
    if recipe.contributions:
        planes["contributions_w_cm2"] = _each(frames, frames.contributions_w_cm2)
    return planes


def bytes_per_frame(recipe: Recipe, scene: Scene) -> int:
    """Memory of one frame of a sequence [bytes], with all planes, and what their making takes."""
    camera, n_target = scene.camera, len(scene.target_names)
    per_pixel = 2 + 4 * recipe.signal + 2 * recipe.masks + 4 * n_target * (recipe.contributions or recipe.masks)
    return per_pixel * camera.n_row * camera.n_col * recipe.n_sensor * len(recipe.band_names)


def _each(frames: FrameSet, of_image: Any) -> Any:
    """An array of what is made image by image."""
    return np.stack(
        [
            [[of_image(frame, sensor, band) for band in frames.bands] for sensor in frames.sensors]
            for frame in frames.frames
        ]
    )
