"""Writers of the images of a shard: one class per kind of format, all with the same methods.

Zarr v3 has one group per split, with an array for each plane; a shard of the data set owns whole shards of the arrays.
Two processes that write into one Zarr shard lose what the other wrote. So each shard of the data set is written to a
copy of the empty group, in a folder of its own, and its files are then moved to their final paths.
"""

from __future__ import annotations

import contextlib
import io
import json
import tarfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.dataset.layout import (
    RECIPE_SEED,
    ImageKey,
    Sequence,
    Shard,
    dataset_provenance,
    folder_of,
    split_of,
)
from warpsim.dataset.recipe import Recipe
from warpsim.errors import InputError
from warpsim.output.fits_header import Views
from warpsim.output.formats import FORMATS, Animations, Format, ImageFiles, Images
from warpsim.output.zarr_array import ARRAY
from warpsim.render.frameset import FrameSet
from warpsim.scene.instrument import Instrument
from warpsim.scene.provenance import provenance

if TYPE_CHECKING:
    from astropy.table import Table

PREVIEW_FRAMES = 100
"""Of the animation of a sequence at most, evenly chosen."""

Planes = dict[str, npt.NDArray[Any]]
"""By name (PLANES), with the axes (frame, sensor, band, ...) of a render call."""

Rows = dict[str, "Table"]
"""Of a render call, by table: images, truth, ..."""

STORE = "images.zarr"
CHUNK_BYTES = 2**18
"""Of small images at most: each chunk takes zarr some milliseconds, whatever its size."""

AXES = ("sequence", "frame", "sensor", "band", "row", "column")


def store_path(split: str) -> str:
    """Path of a split's group, relative to the data set."""
    return f"{split}/{STORE}"


def array_shapes(recipe: Recipe) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Shape of one sequence and type of each array of a recipe."""
    (instrument,) = recipe.instruments.values()
    camera = instrument.sensor.camera
    image = (camera.n_row, camera.n_col)
    views = (recipe.n_frame, recipe.n_sensor, len(recipe.band_names))
    arrays: dict[str, tuple[tuple[int, ...], Any]] = {"counts": ((*views, *image), np.uint16)}
    if recipe.signal:
        arrays["signal_w_cm2"] = ((*views, *image), np.float32)
    if recipe.masks:
        arrays["mask"] = ((*views, *image), np.uint16)
    if recipe.contributions:
        arrays["contributions_w_cm2"] = ((*views, len(recipe.scenario.targets), *image), np.float32)
    return arrays


def create_store(recipe: Recipe, split: str, path: Path) -> dict[str, Any]:
    """Make a split's group, whose arrays are empty; the arrays by name."""
    from zarr import create_group
    from zarr.storage import LocalStore

    # Attributes name the axes. Sensors differ from sequence to sequence: they are in the table of images.
    known = {"sequence": split_of(recipe)[split], "band": recipe.band_names, "interval_s": recipe.step_s}
    words = dataset_provenance(recipe)
    known |= {"target": recipe.scenario.target_names} if recipe.contributions else {}
    # An explicit store: a path as text may be taken for an address.
    group = create_group(store=LocalStore(path), zarr_format=3, attributes=known | words)
    n_sequence = len(split_of(recipe)[split])
    return {
        name: group.create_array(
            name,
            shape=(n_sequence, *shape),
            dtype=dtype,
            chunks=_chunk_shape(shape, dtype, recipe.frames_per_shard),
            shards=(recipe.shard_size, recipe.frames_per_shard, *shape[1:]),
            attributes=words,
            dimension_names=AXES if len(shape) == 5 else (*AXES[:4], "target", *AXES[4:]),
            **ARRAY,
        )
        for name, (shape, dtype) in array_shapes(recipe).items()
    }


def _chunk_shape(shape: tuple[int, ...], dtype: Any, n_frame: int) -> tuple[int, ...]:
    """Shape of a chunk: an image, and if it is small some of its targets' planes, then some frames of it."""
    n_plane = max(1, CHUNK_BYTES // (shape[-2] * shape[-1] * int(np.dtype(dtype).itemsize)))
    n_target = shape[3] if len(shape) == 6 else 1
    targets = _largest_divisor(n_target, n_plane)
    frames = _largest_divisor(n_frame, n_plane // n_target) if targets == n_target else 1
    return (1, frames, 1, 1, *(targets,) * (len(shape) - 5), *shape[-2:])


def _largest_divisor(number: int, most: int) -> int:
    """Largest divisor up to a limit: chunks must fill shards."""
    return max(d for d in range(1, max(1, min(number, most)) + 1) if number % d == 0)


class ShardWriter:
    """Writer of the images of a shard below a folder that mirrors the data set's."""

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        self._recipe, self._shard, self._folder = recipe, shard, folder

    def add(self, sequence: Sequence, position: int, frames: FrameSet, planes: Planes, rows: Rows) -> None:
        """Add further frames of the position-th sequence of the shard."""
        raise NotImplementedError

    def finish(self) -> None:
        """Finish the files of the shard."""
        raise NotImplementedError

    def close(self) -> None:
        """Close open files, finished or not."""

    def locate(self, sequence: Sequence, key: ImageKey) -> tuple[str, str]:
        """Return an image's file, relative to the data set, and its item in it: indices, or a member's name."""
        raise NotImplementedError


class _ZarrShard(ShardWriter):
    """Whole shards of each array of the group of a split."""

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        super().__init__(recipe, shard, folder)
        self._path = folder / store_path(shard.split)
        self._arrays = create_store(recipe, shard.split, self._path)
        self._buffers: dict[str, Any] = {}
        self._first = shard.number * recipe.shard_size

    def add(self, sequence: Sequence, position: int, frames: FrameSet, planes: Planes, rows: Rows) -> None:
        """Keep frames until a shard of an array is full."""
        if self._recipe.contributions and sequence.scenario.target_names != self._recipe.scenario.target_names:
            raise InputError(
                "contributions in one Zarr array need the same targets in every sequence; choose another format",
                f"sequence {sequence.number}",
            )
        n_frame = self._recipe.frames_per_shard
        for name, (shape, dtype) in array_shapes(self._recipe).items():
            for f, number in enumerate(frames.frames):
                if name not in self._buffers:
                    self._buffers[name] = np.zeros((len(self._shard.sequences), n_frame, *shape[1:]), dtype)
                self._buffers[name][position, number % n_frame] = planes[name][f]
                if len(self._shard.sequences) == 1 and (number % n_frame == n_frame - 1 or number == shape[0] - 1):
                    self._flush(name, number // n_frame * n_frame, number + 1)

    def _flush(self, name: str, first: int, end: int) -> None:
        last = self._first + len(self._shard.sequences)
        self._arrays[name][self._first : last, first:end] = self._buffers.pop(name)[:, : end - first]

    def finish(self) -> None:
        """Write buffered frames; the group's description is written by the run."""
        for name in list(self._buffers):
            self._flush(name, 0, self._recipe.n_frame)
        for path in self._path.rglob("zarr.json"):
            path.unlink()

    def locate(self, sequence: Sequence, key: ImageKey) -> tuple[str, str]:
        """The array and the index of an image."""
        index = f"[{self._first + key.position}, {key.frame}, {key.sensor_number}, {key.band_number}]"
        return f"{store_path(self._shard.split)}/counts", index


def planes_of(recipe: Recipe, frames: FrameSet) -> Planes:
    """Return what is written of a render call."""
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


class _SequenceFolders(ShardWriter):
    """A folder for each sequence, with the files of a run: cubes, or an image file each, and animations."""

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        super().__init__(recipe, shard, folder)
        if recipe.format in ("fits", "fits-frames"):
            self._format: Format = FORMATS[recipe.format]
        else:
            ending = {"png": ".png", "tiff": ".tif"}[recipe.format]
            others = {"signal_w_cm2": ".signal_w_cm2.exr", "contributions_w_cm2": ".contributions_w_cm2.npy"}
            self._format = ImageFiles({"counts": ending, "mask": f".mask{ending}", **others})
        step = -(-recipe.n_frame // PREVIEW_FRAMES)
        self._formats = [self._format, *([Animations(f".{recipe.preview}", step)] if recipe.preview else [])]
        self._number = -1
        """Of the sequence that is being written."""
        self._written: dict[str, tuple[list[Images], list[dict[str, Any]]]] = {}
        """Of each sensor of it: its images by band, and the views so far."""

    def add(self, sequence: Sequence, position: int, frames: FrameSet, planes: Planes, rows: Rows) -> None:
        """Append frames to the files of each sensor and band."""
        if sequence.number != self._number:
            self.finish()
            self._number = sequence.number
        home = self._folder / folder_of(self._shard, sequence.number)
        home.mkdir(parents=True, exist_ok=True)
        for s, sensor in enumerate(frames.sensors):
            views = Views.of(frames, sensor)
            if sensor not in self._written:
                frame_numbers = range(self._recipe.n_frame)
                images = [Images(sequence.scenario, sensor, band, frame_numbers) for band in frames.bands]
                self._written[sensor] = images, []
            images, before = self._written[sensor]
            before.append(views.plain)
            for b, of_band in enumerate(images):
                for form in self._formats:
                    form.append(home, of_band, views, {name: values[:, s, b] for name, values in planes.items()})

    def finish(self) -> None:
        """Finish the files of the sequence."""
        home = self._folder / folder_of(self._shard, self._number)
        for sensor, (images, parts) in self._written.items():
            views = Views.joined(images[0].instrument, sensor, parts)
            for form in self._formats:
                form.finish(home, images, views)
        for path in home.glob("*.grey"):
            path.unlink()
        self._written = {}

    def locate(self, sequence: Sequence, key: ImageKey) -> tuple[str, str]:
        """The plane of a cube, the extension of a file, or the file of an image."""
        images = Images(sequence.scenario, key.sensor, key.band, [key.frame])
        (name,) = self._format.names(images)
        item = {"fits": f"[{key.frame}]", "fits-frames": f"[{key.frame + 1}]"}.get(self._recipe.format, "")
        return f"{folder_of(self._shard, key.sequence)}/{name}", item


class _TarArchive(ShardWriter):
    """A tar archive per shard, in the form of WebDataset: KEY.npy (all bands), KEY.PLANE.npy and KEY.json.

    A key is SEQUENCE_FRAME_SENSOR. Archives hold no times and no owners, so that equal content is equal bytes; names
    above 100 letters have a header of their own.
    """

    def __init__(self, recipe: Recipe, shard: Shard, folder: Path) -> None:
        super().__init__(recipe, shard, folder)
        path = folder / f"{shard.stem}.tar"
        path.parent.mkdir(parents=True, exist_ok=True)
        self._tar = tarfile.open(path, "w", format=tarfile.PAX_FORMAT)  # noqa: SIM115

    def add(self, sequence: Sequence, position: int, frames: FrameSet, planes: Planes, rows: Rows) -> None:
        """Append the samples of frames."""
        words = provenance(sequence.scene) | {RECIPE_SEED: self._recipe.seed}
        for f, number in enumerate(frames.frames):
            for s, sensor in enumerate(frames.sensors):
                key = self._key(sequence.number, number, sensor)
                for name, values in planes.items():
                    data = io.BytesIO()
                    np.save(data, np.ascontiguousarray(values[f, s]))
                    self._append(f"{key}.npy" if name == "counts" else f"{key}.{name}.npy", data.getvalue())
                tables = (rows["images"], rows["truth"])
                own = (table[(table["frame"] == number) & (table["sensor"] == sensor)] for table in tables)
                self._append(f"{key}.json", json.dumps(self._label(*own) | words).encode())

    def _label(self, images: Table, truth: Table) -> dict[str, Any]:
        """Metadata of a sample: its images, band by band, and its targets in each."""
        names = [name for name in truth.colnames if name not in ("frame", "sensor", "image_id", "sequence", "mask_rle")]
        columns = [np.asarray(truth[name]).tolist() for name in names]
        targets = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
        for target in targets:  # JSON knows no NaN
            target |= {name: None for name, value in target.items() if value != value}
        return {
            **{name: images[name].tolist()[0] for name in ("sequence", "frame", "sensor")},
            "bands": images["band"].tolist(),
            "image_ids": images["image_id"].tolist(),
            "targets": targets,
            **{name: images[name].tolist()[0] for name in ("time_s", "date_obs")},
        }

    def _append(self, name: str, content: bytes) -> None:
        info = tarfile.TarInfo(name)
        info.size, info.mode = len(content), 0o644
        self._tar.addfile(info, io.BytesIO(content))

    @staticmethod
    def _key(sequence: int, frame: int, sensor: str) -> str:
        return f"{sequence:06d}_{frame:06d}_{sensor.replace('.', '~')}"  # a dot ends a key

    def finish(self) -> None:
        """Write the archive's end."""
        self._tar.close()

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._tar.close()

    def locate(self, sequence: Sequence, key: ImageKey) -> tuple[str, str]:
        """The member that holds an image's bands."""
        member = self._key(key.sequence, key.frame, key.sensor)
        own = self._recipe.bands_of(sequence.scenario.instrument_of(key.sensor))
        return f"{self._shard.stem}.tar", f"{member}.npy[{own.index(key.band)}]"


def shard_writer(recipe: Recipe, shard: Shard, folder: Path) -> ShardWriter:
    """Return the writer of a recipe's format."""
    kinds: dict[str, type[ShardWriter]] = {"zarr": _ZarrShard, "webdataset": _TarArchive}
    return kinds.get(recipe.format, _SequenceFolders)(recipe, shard, folder)
