"""Writers of the images of a shard: one class per kind of format, all with the same methods.

`begin` a sequence, `add` its frames as they are rendered, `end` it; `finish` the shard. `locate` gives an image's file.
Planes are arrays by name (PLANES), with the axes (frame, sensor, band, ...) of a render call.
"""

from __future__ import annotations

import contextlib
import io
import json
import tarfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from warpsim.dataset.layout import ImageKey, Shard, folder_of, image_id, image_keys
from warpsim.dataset.recipe import Recipe
from warpsim.dataset.sequences import Sequence
from warpsim.errors import InputError
from warpsim.output.fits_cube import CubeWriter
from warpsim.output.fits_header import image_cards
from warpsim.output.fits_planes import PlaneWriter
from warpsim.output.image_files import facts_of, write_counts, write_signal
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Table

Planes = dict[str, npt.NDArray[Any]]

PLANES = {
    "counts": "counts",
    "signal_w_cm2": "noiseless irradiance of each pixel [W/cm2]",
    "mask": "number of the target in each pixel, counted from 1; 0: none",
    "contributions_w_cm2": "noiseless irradiance of each target apart [W/cm2], one plane per target",
}
"""What is written of an image, by name."""


class ShardWriter(Protocol):
    """Writer of the images of a shard, below a folder that mirrors the data set's."""

    def begin(self, sequence: Sequence, position: int) -> None:
        """Start a sequence, the position-th of the shard."""

    def add(self, frames: FrameSet, planes: Planes, truth: Table) -> None:
        """Write further frames of the sequence."""

    def end(self) -> None:
        """End the sequence."""

    def finish(self) -> None:
        """Finish the shard."""

    def abandon(self) -> None:
        """Close open files after a failure."""

    def locate(self, key: ImageKey) -> tuple[str, str]:
        """File of an image, relative to the data set, and its item in it: indices, or a member's name."""


class CubeFolder:
    """FITS cubes in a folder for each sequence: SENSOR_BAND.fits, and SENSOR_BAND.PLANE.fits for other planes."""

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        self._recipe, self._shard, self._folder = recipe, shard, folder
        self._cubes: dict[str, CubeWriter] = {}
        self._others: dict[str, PlaneWriter] = {}

    def begin(self, sequence: Sequence, position: int) -> None:
        """Start a sequence."""
        self._sequence = sequence
        self._home = self._folder / folder_of(self._shard, sequence.number)
        self._home.mkdir(parents=True)

    def add(self, frames: FrameSet, planes: Planes, truth: Table) -> None:
        """Append frames to each cube."""
        for s, sensor in enumerate(frames.sensors):
            for b, band in enumerate(frames.bands):
                stem = f"{sensor}_{band}"
                if stem not in self._cubes:
                    path = self._home / f"{stem}.fits"
                    self._cubes[stem] = CubeWriter(path, self._sequence.scenario, sensor, band, self._recipe.n_frame)
                self._cubes[stem].add(frames, s, b)
                for name in planes.keys() - {"counts"}:
                    self._add_other(name, f"{stem}.{name}", planes[name][:, s, b])

    def _add_other(self, name: str, stem: str, values: npt.NDArray[Any]) -> None:
        if stem not in self._others:
            shape = (self._recipe.n_frame, *values.shape[1:])
            self._others[stem] = PlaneWriter(self._home / f"{stem}.fits", shape, values.dtype, PLANES[name])
        self._others[stem].add(values)

    def end(self) -> None:
        """Close the cubes."""
        for writer in self._open:
            writer.close()
        self._cubes, self._others = {}, {}

    @property
    def _open(self) -> list[CubeWriter | PlaneWriter]:
        return [*self._cubes.values(), *self._others.values()]

    def finish(self) -> None:
        """Do nothing."""

    def abandon(self) -> None:
        """Close what is open."""
        for writer in self._open:
            with contextlib.suppress(OSError):
                writer.abandon()

    def locate(self, key: ImageKey) -> tuple[str, str]:
        """The plane of a cube."""
        return f"{folder_of(self._shard, key.sequence)}/{key.sensor}_{key.band}.fits", f"[{key.frame}]"


class ImageFolder:
    """An image file each, in a folder for each sensor and band of a sequence: SENSOR_BAND/FRAME.png."""

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        self._shard, self._folder = shard, folder
        self._suffix = {"png": ".png", "tiff": ".tif"}[recipe.format]

    def begin(self, sequence: Sequence, position: int) -> None:
        """Start a sequence."""
        self._home = self._folder / folder_of(self._shard, sequence.number)
        self._home.mkdir(parents=True)

    def add(self, frames: FrameSet, planes: Planes, truth: Table) -> None:
        """Write the images of frames."""
        for s, sensor in enumerate(frames.sensors):
            for b, band in enumerate(frames.bands):
                folder = self._home / f"{sensor}_{band}"
                folder.mkdir(exist_ok=True)
                for f, cards in enumerate(image_cards(frames, sensor, band)):
                    stem = folder / f"{frames.frames[f]:06d}"
                    self._write(stem, {name: plane[f, s, b] for name, plane in planes.items()}, facts_of(cards))

    def _write(self, stem: Path, planes: Planes, meta: dict[str, Any]) -> None:
        for name, values in planes.items():
            if name == "counts":
                write_counts(stem.with_suffix(self._suffix), values, meta)
            elif name == "signal_w_cm2":
                write_signal(stem.with_suffix(".signal_w_cm2.exr"), values, meta | {"BUNIT": "W/cm2"})
            elif name == "mask":
                facts = {key: value for key, value in meta.items() if key != "BUNIT"}  # numbers of targets
                write_counts(stem.with_suffix(f".mask{self._suffix}"), values, facts)
            else:
                np.save(stem.with_suffix(f".{name}.npy"), values)

    def end(self) -> None:
        """Do nothing."""

    def finish(self) -> None:
        """Do nothing."""

    def abandon(self) -> None:
        """Do nothing."""

    def locate(self, key: ImageKey) -> tuple[str, str]:
        """The file of an image."""
        folder = folder_of(self._shard, key.sequence)
        return f"{folder}/{key.sensor}_{key.band}/{key.frame:06d}{self._suffix}", ""


class TarArchive:
    """A tar archive per shard, in the form of WebDataset: KEY.npy (all bands), KEY.PLANE.npy and KEY.json.

    A key is SEQUENCE_FRAME_SENSOR. Archives hold no times and no owners, so that equal content is equal bytes.
    """

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        self._recipe, self._shard = recipe, shard
        path = folder / f"{shard.stem}.tar"
        path.parent.mkdir(parents=True, exist_ok=True)
        self._tar = tarfile.open(path, "w", format=tarfile.USTAR_FORMAT)  # noqa: SIM115

    def begin(self, sequence: Sequence, position: int) -> None:
        """Start a sequence."""
        self._sequence, self._position = sequence, position

    def add(self, frames: FrameSet, planes: Planes, truth: Table) -> None:
        """Append the samples of frames."""
        keys = image_keys(self._recipe, self._sequence, self._position, frames)
        for f, number in enumerate(frames.frames):
            for s, sensor in enumerate(frames.sensors):
                key = self._key(self._sequence.number, number, sensor)
                for name, values in planes.items():
                    data = io.BytesIO()
                    np.save(data, np.ascontiguousarray(values[f, s]))
                    self._append(f"{key}.npy" if name == "counts" else f"{key}.{name}.npy", data.getvalue())
                rows = truth[(truth["frame"] == number) & (truth["sensor"] == sensor)]
                own = [key for key in keys if key.frame == number and key.sensor == sensor]
                self._append(f"{key}.json", json.dumps(self._label(own, rows)).encode())

    def _label(self, keys: list[ImageKey], rows: Any) -> dict[str, Any]:
        """Metadata of a sample: its images, band by band, and its targets in each."""
        names = [name for name in rows.colnames if name not in ("frame", "sensor", "image_id", "sequence", "mask_rle")]
        columns = [np.asarray(rows[name]).tolist() for name in names]
        targets = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
        for target in targets:  # JSON knows no NaN
            target |= {name: None for name, value in target.items() if value != value}
        return {
            "sequence": keys[0].sequence,
            "frame": keys[0].frame,
            "sensor": keys[0].sensor,
            "bands": [key.band for key in keys],
            "image_ids": [image_id(self._recipe, key) for key in keys],
            "targets": targets,
        }

    def _append(self, name: str, content: bytes) -> None:
        info = tarfile.TarInfo(name)
        info.size, info.mode = len(content), 0o644
        self._tar.addfile(info, io.BytesIO(content))

    @staticmethod
    def _key(sequence: int, frame: int, sensor: str) -> str:
        return f"{sequence:06d}_{frame:06d}_{sensor.replace('.', '~')}"  # a dot ends a key

    def end(self) -> None:
        """Do nothing."""

    def finish(self) -> None:
        """Write the archive's end."""
        self._tar.close()

    def abandon(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._tar.close()

    def locate(self, key: ImageKey) -> tuple[str, str]:
        """The member that holds an image's bands."""
        member = self._key(key.sequence, key.frame, key.sensor)
        own = self._recipe.bands_of(self._sequence.scenario.instrument_of(key.sensor))
        return f"{self._shard.stem}.tar", f"{member}.npy[{own.index(key.band)}]"


def shard_writer(recipe: Recipe, shard: Shard, folder: Path) -> ShardWriter:
    """Return the writer of a recipe's format.

    Raises:
        InputError: The format needs a package that is not installed.
    """
    if recipe.format == "zarr":
        from warpsim.dataset.zarr_store import ZarrShard

        return ZarrShard(recipe, shard, folder)
    kinds: dict[str, Any] = {
        "fits": CubeFolder, "png": ImageFolder, "tiff": ImageFolder, "webdataset": TarArchive,
    }  # fmt: skip
    if recipe.format not in kinds:
        raise InputError(f"must be one of {', '.join([*kinds, 'zarr'])}", "format", recipe.format)
    writer: ShardWriter = kinds[recipe.format](recipe, shard, folder)
    return writer
