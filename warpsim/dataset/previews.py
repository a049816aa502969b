"""Small animations of a sequence, for people."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence
from warpsim.output.preview import preview_file
from warpsim.render.frameset import FrameSet

PREVIEW_FRAMES = 100
"""At most, evenly chosen."""

FRAMES_PER_S = 10.0

AddFrames = Callable[[FrameSet], None]
"""Takes the frames of a render call."""


@contextmanager
def sequence_animations(recipe: Recipe, sequence: Sequence, folder: Path) -> Iterator[AddFrames]:
    """Animations of each sensor and band, SENSOR_BAND.gif, fed with frames as they come; none if not requested."""
    step = -(-recipe.n_frame // PREVIEW_FRAMES)
    with ExitStack() as stack:
        animations = {}
        for sensor in sequence.sensors if recipe.preview else ():
            instrument = sequence.scenario.instrument_of(sensor)
            for band in recipe.bands_of(instrument):
                path = folder / f"{sensor}_{band}.{recipe.preview}"
                animation = preview_file(path, instrument.levels[band], FRAMES_PER_S)
                animations[sensor, band] = stack.enter_context(animation)

        def add(frames: FrameSet) -> None:
            shown = [index for index, number in enumerate(frames.frames) if number % step == 0]
            for (sensor, band), add_counts in animations.items():
                if sensor not in frames.sensors:
                    continue
                s, b = frames.sensors.index(sensor), frames.bands.index(band)
                add_counts(frames.counts.numpy()[shown, s, b])

        yield add
