"""What a page shows of a frame: images with their truth, rendered on demand or read back from the folder of a run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from warpsim.detector.levels import Levels
from warpsim.errors import InputError
from warpsim.files import read_json
from warpsim.labels.boxes import target_boxes
from warpsim.output.checkpoints import is_record
from warpsim.output.grey import window_about
from warpsim.output.output_folder import MANIFEST
from warpsim.render.frameset import FrameSet
from warpsim.render.renderer import Renderer
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from astropy.table import Table

LEAST_BOX_PX = 5.0
"""Of boxes on the page, so that the light of a point shows within its frame."""


@dataclass(frozen=True)
class Mark:
    """A target with light in an image."""

    target: str
    x_px: float
    y_px: float
    box_px: tuple[float, float, float, float]
    """Left, top, width, height; corners of pixels on whole numbers."""
    snr: float
    clump: int
    """Targets that merge share it; -1 where that is not known."""
    main: bool = False
    """Whether it is the main target of its group."""


@dataclass(frozen=True)
class ShownImage:
    """One image of a sensor in a band."""

    sensor: str
    band: str
    counts: npt.NDArray[np.uint16]
    """Shape (row, column)."""
    levels: Levels
    marks: list[Mark]
    corner_px: tuple[int, int] = (0, 0)
    """Column and row of the first pixel, where only a part of the image is shown."""

    def about_targets(self) -> ShownImage:
        """Return the square part of the image that holds all its targets with light, and some sky; all without any."""
        rows, columns = window_about([(mark.x_px, mark.y_px) for mark in self.marks], self.counts.shape)
        left, top = columns.start, rows.start
        marks = [
            replace(
                mark, x_px=mark.x_px - left, y_px=mark.y_px - top,
                box_px=(mark.box_px[0] - left, mark.box_px[1] - top, *mark.box_px[2:]),
            )
            for mark in self.marks
        ]  # fmt: skip
        return replace(self, counts=self.counts[rows, columns], marks=marks, corner_px=(left, top))

    @property
    def merged(self) -> list[list[str]]:
        """Names of targets that merge, clump by clump."""
        clumps: dict[int, list[str]] = {}
        for mark in self.marks:
            clumps.setdefault(mark.clump, []).append(mark.target)
        return [names for clump, names in clumps.items() if clump >= 0 and len(names) > 1]


class Images(Protocol):
    """A source of images by frame number."""

    scenario: Scenario
    sensors: list[str]
    """Those that have images."""

    def frames(self, sensor: str) -> Sequence[int]:
        """Numbers of the frames that a sensor has images of."""

    def at(self, frame: int, sensors: Sequence[str], band: str | None) -> list[ShownImage]:
        """Images of a frame in a band (None: the first of each sensor), of the sensors that have both."""


class RenderedImages:
    """Images that are rendered when they are asked for."""

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self.scenario = renderer.scenario
        self.sensors = renderer.sensors_with_access or self.scenario.sensor_names

    def frames(self, sensor: str) -> Sequence[int]:
        """Numbers of the frames that a sensor has images of."""
        return range(self.scenario.instrument_of(sensor).frames.count)

    def at(self, frame: int, sensors: Sequence[str], band: str | None) -> list[ShownImage]:
        """Images of a frame in a band (None: the first of each sensor), of the sensors that have both."""
        shown: list[ShownImage] = []
        for instrument in self.scenario.instruments.values():
            chosen = [name for name in sensors if name in instrument.names and frame < instrument.frames.count]
            own = instrument.sensor.bands[0] if band is None else band
            if chosen and own in instrument.sensor.bands:
                shown += images_of(self.renderer.render([frame], chosen, own), 0, own)
        return sorted(shown, key=lambda image: sensors.index(image.sensor))


def is_main(scenario: Scenario, target: int) -> bool:
    """Return whether a target, by its number, is the main one of its group, which the others leave."""
    known = scenario.targets[target]
    return known.entry == 0 and scenario.scene.groups[known.group].orbits is None


def main_targets(scenario: Scenario) -> set[str]:
    """Return the names of the main targets of all groups."""
    return {name for number, name in enumerate(scenario.target_names) if is_main(scenario, number)}


def images_of(frames: FrameSet, index: int, band: str) -> list[ShownImage]:
    """Return the images of one of some rendered frames in a band, sensor by sensor."""
    frames = frames.one_frame(index)
    counts = np.asarray(frames.counts)[0][:, frames.bands.index(band)]
    names = frames.scenario.target_names
    shape = (len(frames.sensors), len(frames.bands), len(names))
    boxes = target_boxes(frames, LEAST_BOX_PX)
    b = frames.bands.index(band)
    visible, box_px = boxes.visible.reshape(shape)[:, b], boxes.box_px.reshape(*shape, 4)[:, b]
    truth = {name: np.asarray(frames.truth[name]).reshape(shape)[:, b] for name in ("x_px", "y_px", "snr", "clump_id")}

    def marks(sensor: int) -> list[Mark]:
        return [
            Mark(
                names[target],
                float(truth["x_px"][sensor, target]),
                float(truth["y_px"][sensor, target]),
                tuple(box_px[sensor, target].tolist()),
                float(truth["snr"][sensor, target]),
                int(truth["clump_id"][sensor, target]),
                is_main(frames.scenario, int(target)),
            )
            for target in np.flatnonzero(visible[sensor])
        ]

    levels = frames.instrument.levels[band]
    return [ShownImage(name, band, counts[i], levels, marks(i)) for i, name in enumerate(frames.sensors)]


class FolderImages:
    """Images of a finished run, read back; nothing is rendered.

    Args:
        folder: As `warpsim render` left it, with FITS cubes and truth.

    Raises:
        InputError: It holds no complete run, or one in another format.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        from astropy.table import Table

        manifest = read_json(self.folder / MANIFEST)
        if not is_record(manifest) or "scene" not in manifest or "frames" not in manifest:
            raise InputError("holds no complete run, which has a manifest with a scene").of(folder)
        if "fits" not in manifest["formats"]:
            raise InputError("must have fits to be shown", "formats", " ".join(manifest["formats"])).of(folder)
        self.scenario = Scene.from_dict(manifest["scene"], str(self.folder / MANIFEST)).scenario
        self._frames: dict[str, list[int]] = {name: list(numbers) for name, numbers in manifest["frames"].items()}
        self._bands: dict[str, list[str]] = manifest["bands_of"]
        self.sensors = [name for name, numbers in self._frames.items() if numbers]
        with_truth = "truth" in manifest["tables"]
        truth = Table.read(self.folder / "truth.fits") if with_truth else None
        self._marks = {} if truth is None else marks_of(truth, main_targets(self.scenario))

    def frames(self, sensor: str) -> Sequence[int]:
        """Numbers of the frames that a sensor has images of."""
        return self._frames.get(sensor, [])

    def at(self, frame: int, sensors: Sequence[str], band: str | None) -> list[ShownImage]:
        """Images of a frame in a band (None: the first of each sensor), of the sensors that have both."""
        from astropy.io import fits

        shown = []
        for sensor in sensors:
            own = self._bands.get(sensor, [""])[0] if band is None else band
            if frame not in self.frames(sensor) or own not in self._bands[sensor]:
                continue
            with fits.open(self.folder / f"{sensor}_{own}.fits", do_not_scale_image_data=True) as file:
                plane = file[0].section[self._frames[sensor].index(frame)]
                zero = int(file[0].header.get("BZERO", 0))
            counts = (plane.astype(np.int32) + zero).astype(np.uint16)
            levels = self.scenario.instrument_of(sensor).levels[own]
            shown.append(ShownImage(sensor, own, counts, levels, self._marks.get((frame, sensor, own), [])))
        return shown


def marks_of(table: Table, mains: AbstractSet[str]) -> dict[tuple[int, str, str], list[Mark]]:
    """Targets with light by frame, sensor and band, from a table of truth; boxes stand about the middle of a path.

    Args:
        table: Truth.
        mains: Names of the main targets.
    """
    lit = np.asarray(table["in_fov"]) & (np.asarray(table["irradiance_w_cm2"]) != 0.0)
    marks: dict[tuple[int, str, str], list[Mark]] = {}
    for row in table[lit]:
        x_px, y_px, half_px = float(row["x_px"]), float(row["y_px"]), LEAST_BOX_PX / 2
        box_px = (x_px + 0.5 - half_px, y_px + 0.5 - half_px, LEAST_BOX_PX, LEAST_BOX_PX)
        name = _text(row["target"])
        mark = Mark(name, x_px, y_px, box_px, float(row["snr"]), int(row["clump_id"]), name in mains)
        marks.setdefault((int(row["frame"]), _text(row["sensor"]), _text(row["band"])), []).append(mark)
    return marks


def _text(value: Any) -> str:
    """A text of a FITS table."""
    return (value.decode() if isinstance(value, bytes) else str(value)).strip()
