"""What can be looked at: scenes, renderers, runs, sequences of data sets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from warpsim.dataset.read_dataset import rebuild_sequence
from warpsim.errors import InputError
from warpsim.files import read_json
from warpsim.live.run_images import FolderImages, GrowingImages, unfinished_run
from warpsim.live.shown_images import ImageSource, RenderedImages
from warpsim.live.view import PORT, View
from warpsim.output.output_folder import MANIFEST
from warpsim.render.renderer import Renderer
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.scene.scene_files import presets


def view(
    source: Scene | Scenario | Renderer | str | os.PathLike[str],
    port: int = PORT,
    sensors: str | Sequence[str] | None = None,
    band: str | None = None,
    sequence: int = 0,
) -> View:
    """Open a page in the browser's reach that shows a scene, its images and their truth.

    The page is offered to this machine alone, from the call on until it is closed.

    Args:
        source: A scene, its scenario, or a renderer of it: frames are rendered as the page asks for them. Or a path: of
            a scene file, of the folder of a run, finished or not, whose images are read back, or of a data set, of
            which a sequence is rendered again.
        port: TCP port on this machine; 0 chooses a free one.
        sensors: Sensors whose images are shown; the first six that have access when left out.
        band: Band that is shown; the first one of each sensor when left out.
        sequence: Number of the sequence of a data set.

    Returns:
        The page: its `url`, and methods to show a frame, to run until Ctrl-C and to close.

    Raises:
        InputError: viser (extra `live`) is not installed, the port is in use, an unknown sensor or band, or a path that
            holds none of these.
    """
    page = View(images_from(source, sequence), port, sensors, band)
    page.watch()
    return page


def images_from(source: Scene | Scenario | Renderer | str | os.PathLike[str], sequence: int = 0) -> ImageSource:
    """Return the images of what `view` takes."""
    if isinstance(source, Renderer):
        return RenderedImages(source)
    if isinstance(source, Scene | Scenario):
        return RenderedImages(Renderer(source))
    if Path(source).is_dir():
        unfinished = unfinished_run(source)
        if unfinished is not None and "recipe" in unfinished:
            raise InputError("holds a data set that is unfinished").of(source)
        if unfinished is not None:
            return GrowingImages(source)
        manifest = read_json(Path(source) / MANIFEST)
        if isinstance(manifest, dict) and "recipe" in manifest:
            return RenderedImages(Renderer(rebuild_sequence(source, sequence).scene))
        if isinstance(manifest, dict):
            return FolderImages(source)
        raise InputError(f"holds neither a run nor a data set: {MANIFEST} is missing").of(source)
    if not Path(source).exists() and os.fspath(source) not in presets():
        raise InputError("must be a preset, a scene file, or the folder of a run or a data set").of(source)
    return RenderedImages(Renderer(Scene.load(source)))
