"""Formats of images: the files of a sensor's images in a band, their writing and reading.

A format is a small object without state. It names its files before they are there, so that a run can see what it would
touch and say which of its files are whole. It appends planes to files in a folder, and finishes them when all are
there: so work that was interrupted goes on where it ended.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import chosen_names
from warpsim.errors import InputError
from warpsim.output import fits_images, zarr_array
from warpsim.output.fits_header import Card, Views, image_cards, scene_cards
from warpsim.output.grey import PREVIEW_FPS, PREVIEW_PX, animation, check_preview, grey, grey_shape
from warpsim.output.image_files import facts_of, read_image, write_counts, write_signal
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

Counts = npt.NDArray[np.uint16]
Planes = Mapping[str, npt.NDArray[Any]]
"""What is written of images, by name (PLANES), shape (frame, ..., row, column)."""

PLANES = {
    "counts": "counts",
    "signal_w_cm2": "noiseless irradiance of each pixel [W/cm2]",
    "mask": "number of the target in each pixel, counted from 1; 0: none",
    "contributions_w_cm2": "noiseless irradiance of each target apart [W/cm2], one plane per target",
}


MOST_LETTERS = 220
"""Of a file's name before its endings: file systems take 255."""


@dataclass(frozen=True)
class Images:
    """The images of a sensor in a band."""

    scenario: Scenario
    sensor: str
    band: str
    frames: Sequence[int]

    @property
    def instrument(self) -> Instrument:
        """The kind of the sensor."""
        return self.scenario.instrument_of(self.sensor)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Frames, rows and columns."""
        camera = self.instrument.sensor.camera
        return len(self.frames), camera.n_row, camera.n_col

    @property
    def stem(self) -> str:
        """Stem of their file names; InputError where it is too long for one."""
        stem = f"{self.sensor}_{self.band}"
        if len(stem) > MOST_LETTERS:
            raise InputError(f"must have at most {MOST_LETTERS} letters together", "names of sensor and band", stem)
        return stem


class Format:
    """One way of storing images, in files SENSOR_BAND with some ending."""

    plane = "counts"
    """What a run must hand over: counts, or the signal."""
    ending = ""
    """Of the one file of counts, or the folder of an array."""

    def check(self) -> None:
        """Check that the format can be written here; InputError where a package is missing."""

    def path(self, folder: Path, images: Images, plane: str = "counts") -> Path:
        """Return the path of a plane of images: SENSOR_BAND.PLANE with the ending; of counts without PLANE."""
        return folder / f"{images.stem}{'' if plane == 'counts' else f'.{plane}'}{self.ending}"

    def names(self, images: Images) -> list[str]:
        """Files, relative to the folder, parts divided by `/`."""
        return [f"{images.stem}{self.ending}"]

    def n_together(self, images: Images) -> int:
        """Return the number of frames that must be appended at once, but for the last ones."""
        return 1

    def append(self, folder: Path, images: Images, views: Views, planes: Planes) -> None:
        """Append the planes of further frames."""
        raise NotImplementedError

    def finish(self, folder: Path, images: Sequence[Images], views: Views) -> None:
        """Finish the files of a sensor's images that are all there, in each of its bands."""

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts | None:
        """Images read back, shape (n, row, column); None where the format does not keep them."""
        return None


class _FitsCubes(Format):
    """SENSOR_BAND.fits: a cube of counts; SENSOR_BAND.PLANE.fits of other planes."""

    ending = ".fits"

    def append(self, folder: Path, images: Images, views: Views, planes: Planes) -> None:
        cards = scene_cards(images.scenario.scene, images.instrument, images.sensor, images.band)
        for name, values in planes.items():
            path = self.path(folder, images, name)
            fits_images.append_planes(path, values, len(images.frames), _cards_of_plane(cards, name))

    def finish(self, folder: Path, images: Sequence[Images], views: Views) -> None:
        for name in PLANES:
            paths = [path for of_band in images if (path := self.path(folder, of_band, name)).exists()]
            if name == "counts":
                fits_images.finish_cubes(paths, images[0].scenario.scene, views)
            else:
                for path in paths:
                    fits_images.finish_planes(path)

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        return fits_images.read_planes(self.path(folder, images), frames)


def _cards_of_plane(cards: list[Card], plane: str) -> list[Card]:
    """Keywords of counts, or of another plane, which has another unit."""
    if plane == "counts":
        return cards
    return [*(card for card in cards if card[0] != "BUNIT"), ("HISTORY", PLANES[plane], "")]


class _FitsFrames(Format):
    """SENSOR_BAND.frames.fits: an extension for each frame; SENSOR_BAND.PLANE.frames.fits of other planes."""

    ending = ".frames.fits"

    def append(self, folder: Path, images: Images, views: Views, planes: Planes) -> None:
        scene = images.scenario.scene
        cards = scene_cards(scene, images.instrument, images.sensor, images.band)
        every = list(image_cards(scene, images.band, views))
        for name, values in planes.items():
            own = [_cards_of_plane(of_frame, name) for of_frame in every]
            path = self.path(folder, images, name)
            fits_images.append_frames(path, values, views.frames, own, _cards_of_plane(cards, name))

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        return fits_images.read_frames(self.path(folder, images), frames)


class ImageFiles(Format):
    """SENSOR_BAND/FRAME.png or the like: a file for each frame and plane.

    Args:
        endings: Of the names of the files, by plane.
    """

    def __init__(self, endings: Mapping[str, str]) -> None:
        self._endings = endings
        self.plane = next(iter(endings))

    def names(self, images: Images) -> list[str]:
        """A file for each frame."""
        return [self._name(images, number, self.plane) for number in images.frames]

    def append(self, folder: Path, images: Images, views: Views, planes: Planes) -> None:
        """Write file by file."""
        (folder / images.stem).mkdir(parents=True, exist_ok=True)
        for i, cards in enumerate(image_cards(images.scenario.scene, images.band, views)):
            for name, values in planes.items():
                _write_plane(folder / self._name(images, views.frames[i], name), name, values[i], facts_of(cards))

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        """Read the files; of a signal, what the detector would count without noise."""
        read = np.stack([read_image(folder / self._name(images, frame, self.plane))[0] for frame in frames])
        if self.plane == "counts":
            return read
        levels = images.instrument.levels[images.band]
        mean = levels.blank_counts + read.astype(np.float64) / levels.nei_w_cm2 * levels.counts_per_nei
        return np.clip(np.round(mean), 0, 65535).astype(np.uint16)

    def _name(self, images: Images, number: int, plane: str) -> str:
        return f"{images.stem}/{number:06d}{self._endings[plane]}"


def _write_plane(path: Path, name: str, values: npt.NDArray[Any], facts: dict[str, Any]) -> None:
    if name == "counts":
        write_counts(path, values, facts)
    elif name == "signal_w_cm2":
        write_signal(path, values, facts | {"BUNIT": "W/cm2"})
    elif name == "mask":
        del facts["BUNIT"]  # numbers of targets
        write_counts(path, values, facts)
    else:
        np.save(path, values)


class _ZarrArrays(Format):
    """SENSOR_BAND.zarr: an array of counts, Zarr v3."""

    ending = ".zarr"

    def check(self) -> None:
        zarr_array.check_zarr()

    def names(self, images: Images) -> list[str]:
        return zarr_array.zarr_names(f"{images.stem}.zarr", images.shape)

    def n_together(self, images: Images) -> int:
        return zarr_array.shard_frames(images.shape)

    def append(self, folder: Path, images: Images, views: Views, planes: Planes) -> None:
        first = images.frames.index(views.frames[0])
        zarr_array.append_counts(self.path(folder, images), images.shape, first, planes["counts"])

    def finish(self, folder: Path, images: Sequence[Images], views: Views) -> None:
        for of_band in images:
            facts = [facts_of(cards) for cards in image_cards(of_band.scenario.scene, of_band.band, views)]
            zarr_array.finish_array(self.path(folder, of_band), of_band.shape, facts)

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        return zarr_array.read_zarr_counts(self.path(folder, images), frames)


class Animations(Format):
    """SENSOR_BAND.gif or .mp4: an animation in grey, for people.

    Args:
        ending: .gif or .mp4.
        step: Every so many frame numbers are shown.
    """

    def __init__(self, ending: str, step: int = 1) -> None:
        self.ending, self._step = ending, step

    def check(self) -> None:
        """Check for the extra `video`, which MP4 needs."""
        check_preview(Path(f"preview{self.ending}"))

    def append(self, folder: Path, images: Images, views: Views, planes: Planes) -> None:
        """Keep the small grey images until all are there: an animation cannot be gone on with."""
        levels = images.instrument.levels[images.band]
        with self._grey_path(folder, images).open("ab") as file:
            for number, counts in zip(views.frames, planes["counts"], strict=True):
                if number % self._step == 0:
                    file.write(grey(counts, levels, PREVIEW_PX).tobytes())

    def finish(self, folder: Path, images: Sequence[Images], views: Views) -> None:
        """Write the animations."""
        for of_band in images:
            shape = grey_shape(of_band.shape[1:], PREVIEW_PX)
            shown = np.fromfile(self._grey_path(folder, of_band), np.uint8).reshape(-1, *shape)
            with animation(self.path(folder, of_band), PREVIEW_FPS) as add:
                for image in shown:
                    add(image)

    def _grey_path(self, folder: Path, images: Images) -> Path:
        return folder / f"{images.stem}{self.ending}.grey"


FORMATS: dict[str, Format] = {
    "fits": _FitsCubes(),
    "fits-frames": _FitsFrames(),
    "tiff": ImageFiles({"counts": ".tif"}),
    "png": ImageFiles({"counts": ".png"}),
    "exr": ImageFiles({"signal_w_cm2": ".exr"}),
    "zarr": _ZarrArrays(),
}
PREVIEWS: dict[str, Format] = {"gif": Animations(".gif"), "mp4": Animations(".mp4")}


def chosen_formats(formats: Sequence[str], preview: str | None) -> dict[str, Format]:
    """Formats by name, each once, the preview last.

    Raises:
        InputError: An unknown one, none, or a package is missing.
    """
    chosen = {name: FORMATS[name] for name in chosen_names("formats", formats or (), list(FORMATS))}
    if preview is not None:
        if preview not in PREVIEWS:
            raise InputError(f"must be {' or '.join(PREVIEWS)}", "preview", preview)
        chosen[preview] = PREVIEWS[preview]
    for form in chosen.values():
        form.check()
    return chosen
