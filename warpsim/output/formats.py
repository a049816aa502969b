"""Formats of images: the files of a sensor's images in a band, their writing and reading.

A format is a small object. It names its files before they are there, so that a run can see what it would touch and say
which of its files are whole. Its writer takes the frames as they are rendered; files get their names when they are
whole.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from warpsim.arguments import chosen_names
from warpsim.errors import InputError
from warpsim.files import naming, whole_file
from warpsim.output.fits_cube import CubeWriter, read_cube
from warpsim.output.fits_header import image_cards
from warpsim.output.image_files import facts_of, read_image, write_counts, write_signal
from warpsim.output.preview import check_preview, preview_file
from warpsim.output.zarr_array import check_zarr, read_zarr_counts, zarr_names, zarr_writer
from warpsim.render.frameset import FrameSet
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

Counts = npt.NDArray[np.uint16]
AddFrames = Callable[[FrameSet, int, int], None]
"""Takes all frames of a render call, for one index along the sensor and band axes."""


@dataclass(frozen=True)
class Images:
    """The images of a sensor in a band."""

    scenario: Scenario
    sensor: str
    band: str
    frames: list[int]

    @property
    def instrument(self) -> Instrument:
        """The kind of the sensor."""
        return self.scenario.instrument_of(self.sensor)

    @property
    def stem(self) -> str:
        """Stem of their file names."""
        return f"{self.sensor}_{self.band}"


class Format(Protocol):
    """One way of storing images."""

    @property
    def needs_signal(self) -> bool:
        """Return whether frames must hold the noiseless images."""

    def check(self) -> None:
        """Check that the format can be written here; InputError where a package is missing."""

    def names(self, images: Images) -> list[str]:
        """Files, relative to the folder of the run, parts divided by `/`."""

    def writer(self, folder: Path, images: Images) -> AbstractContextManager[AddFrames]:
        """Return a context that takes the frames in order; the files are complete at its end."""

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts | None:
        """Images read back, shape (n, row, column); None where the format does not keep them."""


@dataclass(frozen=True)
class FitsCubes:
    """SENSOR_BAND.fits: a cube of counts."""

    needs_signal: bool = False

    def check(self) -> None:
        """Do nothing: astropy is always installed."""

    def names(self, images: Images) -> list[str]:
        """One file."""
        return [f"{images.stem}.fits"]

    @contextlib.contextmanager
    def writer(self, folder: Path, images: Images) -> Iterator[AddFrames]:
        """Append planes."""
        path = folder / f"{images.stem}.fits"
        with whole_file(path) as partial, naming(path):
            cube = CubeWriter(partial, images.scenario, images.sensor, images.band, len(images.frames))
            try:
                yield cube.add
                cube.close()
            finally:
                cube.abandon()

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        """Planes of the cube."""
        cube = read_cube(folder / f"{images.stem}.fits")
        return cube.counts[[int(np.flatnonzero(cube.frames["FRAME"] == frame)[0]) for frame in frames]]


@dataclass(frozen=True)
class ImageFiles:
    """SENSOR_BAND/FRAME.png or the like: an image file for each frame, of counts or of the noiseless signal."""

    suffix: str
    needs_signal: bool = False

    def check(self) -> None:
        """Do nothing: OpenImageIO is always installed."""

    def names(self, images: Images) -> list[str]:
        """A file for each frame."""
        return [self._name(images, number) for number in images.frames]

    def _name(self, images: Images, number: int) -> str:
        return f"{images.stem}/{number:06d}{self.suffix}"

    @contextlib.contextmanager
    def writer(self, folder: Path, images: Images) -> Iterator[AddFrames]:
        """Write file by file."""
        (folder / images.stem).mkdir(exist_ok=True)

        def add(frames: FrameSet, sensor: int, band: int) -> None:
            stack = frames.signal_w_cm2 if self.needs_signal else frames.counts
            assert stack is not None
            write = write_signal if self.needs_signal else write_counts
            planes, cards = stack.numpy()[:, sensor, band], image_cards(frames, images.sensor, images.band)
            for number, plane, known in zip(frames.frames, planes, cards, strict=True):
                write(folder / self._name(images, number), plane, facts_of(known, self.needs_signal))

        yield add

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        """The files' numbers; of a signal, what the detector would count without noise."""
        read = np.stack([read_image(folder / self._name(images, frame))[0] for frame in frames])
        if not self.needs_signal:
            return read
        levels = images.instrument.levels[images.band]
        mean = levels.blank_counts + read.astype(np.float64) / levels.nei_w_cm2 * levels.counts_per_nei
        return np.clip(np.round(mean), 0, 65535).astype(np.uint16)


@dataclass(frozen=True)
class ZarrArrays:
    """SENSOR_BAND.zarr: an array of counts, Zarr v3."""

    needs_signal: bool = False

    def check(self) -> None:
        """Check for the extra `zarr`."""
        check_zarr()

    def names(self, images: Images) -> list[str]:
        """The array's description, and its shards."""
        camera = images.instrument.sensor.camera
        return zarr_names(f"{images.stem}.zarr", (len(images.frames), camera.n_row, camera.n_col))

    def writer(self, folder: Path, images: Images) -> AbstractContextManager[AddFrames]:
        """Write shard by shard."""
        path = folder / f"{images.stem}.zarr"
        return zarr_writer(path, images.scenario, images.sensor, images.band, len(images.frames))

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> Counts:
        """Planes of the array."""
        return read_zarr_counts(folder / f"{images.stem}.zarr", frames)


@dataclass(frozen=True)
class Animations:
    """SENSOR_BAND.gif or .mp4: an animation for people."""

    suffix: str
    needs_signal: bool = False

    def check(self) -> None:
        """Check for the extra `video`, which MP4 needs."""
        check_preview(Path(f"preview{self.suffix}"))

    def names(self, images: Images) -> list[str]:
        """One file."""
        return [f"{images.stem}{self.suffix}"]

    @contextlib.contextmanager
    def writer(self, folder: Path, images: Images) -> Iterator[AddFrames]:
        """Append images."""
        with preview_file(folder / f"{images.stem}{self.suffix}", images.instrument.levels[images.band]) as add:
            yield lambda frames, sensor, band: add(frames.counts.numpy()[:, sensor, band])

    def counts(self, folder: Path, images: Images, frames: Sequence[int]) -> None:
        """Return None: grey levels are no counts."""
        return


FORMATS: dict[str, Format] = {
    "fits": FitsCubes(),
    "tiff": ImageFiles(".tif"),
    "png": ImageFiles(".png"),
    "exr": ImageFiles(".exr", needs_signal=True),
    "zarr": ZarrArrays(),
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
