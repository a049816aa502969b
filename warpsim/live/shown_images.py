"""What a page shows of a frame: images with their truth, from wherever they come; those rendered on demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from warpsim.detector.levels import Levels
from warpsim.labels.boxes import Boxes, target_boxes
from warpsim.output.grey import window_about
from warpsim.plot.figure import target_kinds
from warpsim.render.frameset import FrameSet
from warpsim.render.renderer import Renderer
from warpsim.scene.scenario import Scenario

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


class ImageSource(Protocol):
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


def main_targets(scenario: Scenario) -> list[str]:
    """Return the names of the main targets of all groups, which the others leave."""
    names = scenario.target_names
    return [names[target] for kind in target_kinds(scenario) if kind.is_main for target in kind.targets]


def images_of(frames: FrameSet, index: int, band: str) -> list[ShownImage]:
    """Return the images of one of some rendered frames in a band, sensor by sensor."""
    frames = frames.one_frame(index)
    counts, levels = np.asarray(frames.counts)[0][:, frames.bands.index(band)], frames.instrument.levels[band]
    marks = marks_of(frames.truth, main_targets(frames.scenario), target_boxes(frames, LEAST_BOX_PX))
    keys = [(frames.frames[0], sensor, band) for sensor in frames.sensors]
    return [ShownImage(key[1], band, counts[i], levels, marks.get(key, [])) for i, key in enumerate(keys)]


def marks_of(table: Table, mains: Sequence[str], boxes: Boxes | None = None) -> dict[tuple[int, str, str], list[Mark]]:
    """Targets with light by frame, sensor and band, from a table of truth.

    Args:
        table: Truth.
        mains: Names of the main targets.
        boxes: Of its rows; those about the middles of paths when left out.
    """
    if boxes is None:
        visible = np.asarray(table["in_fov"]) & (np.asarray(table["irradiance_w_cm2"]) != 0.0)
        corner_px = np.column_stack([table["x_px"], table["y_px"]]) + 0.5 - LEAST_BOX_PX / 2
        box_px = np.concatenate([corner_px, np.full(corner_px.shape, LEAST_BOX_PX)], axis=1)
    else:
        visible, box_px = boxes.visible.ravel(), boxes.box_px.reshape(-1, 4)
    names = ("frame", "sensor", "band", "target", "x_px", "y_px", "snr", "clump_id")
    columns = [*(table[name][visible].tolist() for name in names), map(tuple, box_px[visible].tolist())]
    marks: dict[tuple[int, str, str], list[Mark]] = {}
    for frame, *texts, x_px, y_px, snr, clump, box in zip(*columns, strict=True):
        sensor, band, target = map(_text, texts)
        mark = Mark(target, x_px, y_px, box, snr, clump, target in mains)
        marks.setdefault((frame, sensor, band), []).append(mark)
    return marks


def _text(value: Any) -> str:
    """A text of a FITS table."""
    return (value.decode() if isinstance(value, bytes) else str(value)).strip()
