"""Finished data sets of any format read back: rows of images, labels of each, counts, and sequences as drawn."""

from __future__ import annotations

import io
import json
import os
import re
import tarfile
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arguments import whole_number
from warpsim.dataset.layout import Sequence, draw_sequence, input_checksums_of
from warpsim.dataset.recipe import Recipe
from warpsim.errors import InputError, errors_at, printable
from warpsim.files import read_json
from warpsim.labels.coco import coco_categories
from warpsim.labels.table import read_parquet
from warpsim.output.checkpoints import is_record
from warpsim.output.image_files import read_image
from warpsim.output.output_folder import MANIFEST
from warpsim.output.zarr_array import check_zarr
from warpsim.scene.scene import Scene
from warpsim.version import __version__

if TYPE_CHECKING:
    from typing import Self

Columns = dict[str, npt.NDArray[Any]]
Counts = npt.NDArray[np.uint16]

IMAGES, TRUTH = "images.parquet", "truth.parquet"

OPEN_FILES = 16
"""Files of images that are held open at most."""


def image_rows(images: Path, truth: Path) -> Iterator[tuple[dict[str, Any], Columns]]:
    """Yield each row of a table of images, and the columns of its rows of the table of truth."""
    table, labels = _columns(images), _columns(truth)
    order = np.argsort(labels["image_id"], kind="stable")
    labels = {name: column[order] for name, column in labels.items()}
    firsts = np.searchsorted(labels["image_id"], table["image_id"])
    ends = np.searchsorted(labels["image_id"], table["image_id"], side="right")
    for first, end, *values in zip(firsts, ends, *(column.tolist() for column in table.values()), strict=True):
        yield dict(zip(table, values, strict=True)), {name: column[first:end] for name, column in labels.items()}


def _columns(path: Path) -> Columns:
    table = read_parquet(path)
    return {name: np.asarray(table[name]) for name in table.colnames}


def _manifest_of(folder: Path) -> dict[str, Any]:
    manifest = read_json(folder / MANIFEST)
    if not is_record(manifest) or not all(isinstance(manifest.get(name), dict) for name in ("recipe", "splits")):
        rule = f"holds no complete data set: {MANIFEST} of `warpsim dataset` is missing or damaged"
        raise InputError(rule).of(folder)
    return dict(manifest)


class DatasetReader:
    """A complete data set.

    As a context it closes its files at the end.

    Args:
        folder: As `write_dataset` left it.

    Raises:
        InputError: It holds no complete data set.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        manifest = _manifest_of(folder)
        self.key: str = manifest["key"]
        self.recipe: dict[str, Any] = manifest["recipe"]
        self.splits: dict[str, list[int]] = manifest["splits"]
        """Numbers of the sequences of each."""
        self._check_names(MANIFEST, self.splits)
        scene = Scene.from_dict(self.recipe["scene"])
        self.class_names = [category["name"] for category in coco_categories(scene)]
        self.band_names: list[str] = self.recipe.get("bands") or list(
            dict.fromkeys(band for sensor in scene.sensors for band in sensor.bands)
        )
        self.title = printable(scene.description or scene.name)
        self.interval_s = self.recipe.get("interval_s") or scene.frames.interval_s
        self.provenance: dict[str, Any] = manifest.get("provenance", {})
        """Words of provenance that all of its files share."""
        self._open: dict[Path, _File] = {}
        """Files of images, the one that was read last at the end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        while self._open:
            self._open.popitem()[1].close()

    def _check_names(self, file: str, names: Iterable[Any]) -> None:
        """Check that names, which become parts of paths, are plain: nothing is read or written elsewhere."""
        if not all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", str(name)) for name in names):
            rule = "must have plain names of splits, sensors, bands, targets, classes and files"
            raise InputError(rule).of(self.folder / file)

    def sequences(self, split: str) -> Iterator[list[tuple[dict[str, Any], Columns]]]:
        """Yield the images of each sequence of a split, with the columns of their targets."""
        home = self.folder / split
        n_sequence = 0
        for path in sorted([*home.glob(f"*/{IMAGES}"), *home.glob(f"*.{IMAGES}")]):
            found: dict[int, list[tuple[dict[str, Any], Columns]]] = {}
            for row, labels in image_rows(path, path.with_name(path.name.replace(IMAGES, TRUTH))):
                names = {row["sensor"], row["band"], *row["file"].split("/")}
                self._check_names(path.name, names.union(labels["target"].tolist(), labels["class"].tolist()))
                found.setdefault(row["sequence"], []).append((row, labels))
            n_sequence += len(found)
            yield from found.values()
        if n_sequence != len(self.splits[split]):
            rule = f"must have tables of {len(self.splits[split])} sequences, got {n_sequence}"
            raise InputError(f"{rule}; the same `warpsim dataset` makes what is missing").of(home)

    def counts(self, row: dict[str, Any]) -> Counts:
        """Return the counts of an image, shape (row, column)."""
        path = self.folder / row["file"]
        file = self._open[path] = self._open.pop(path) if path in self._open else _opened(path)
        if len(self._open) > OPEN_FILES:
            self._open.pop(next(iter(self._open))).close()
        return np.asarray(file.read(row["item"]), dtype=np.uint16)


class _File(NamedTuple):
    """An open file of images."""

    read: Callable[[str], npt.NDArray[Any]]
    """Of one by its `item` in the table of images."""
    close: Callable[[], Any] = lambda: None


def _opened(path: Path) -> _File:
    if path.suffix in (".png", ".tif"):
        return _File(lambda item: read_image(path)[0])
    if path.suffix == ".fits":
        from astropy.io import fits

        file = fits.open(path)
        if file[0].header["NAXIS"] == 0:  # an extension for each frame
            return _File(lambda item: np.asarray(file[json.loads(item)[0]].section[:]), file.close)
        return _File(lambda item: np.asarray(file[0].section[json.loads(item)[0]]), file.close)
    if path.suffix == ".tar":
        return _tar_reader(path)
    check_zarr()
    import zarr

    array: Any = zarr.open_array(store=zarr.storage.LocalStore(path), mode="r")
    return _File(lambda item: np.asarray(array[tuple(json.loads(item))]), array.store.close)


def _tar_reader(path: Path) -> _File:
    tar = tarfile.open(path)  # noqa: SIM115

    @lru_cache(maxsize=4)  # of the frames that one image may show
    def bands_of(member: str) -> npt.NDArray[Any]:
        file = tar.extractfile(member)
        return np.asarray(np.load(io.BytesIO(file.read() if file else b"")))

    def read(item: str) -> npt.NDArray[Any]:
        member, _, band = item[:-1].partition("[")
        return np.asarray(bands_of(member)[int(band)])

    return _File(read, tar.close)


def rebuild_sequence(folder: str | os.PathLike[str], number: int) -> Sequence:
    """Return a sequence of a data set as it was drawn: its scene, sensors and drawn values.

    `ws.Renderer(sequence.scene).render(range(n_frame), sequence.sensors)` gives the counts of the files, bit for bit,
    on the same kind of device with the same versions. Sensors of several kinds are rendered kind by kind
    (`sequence.by_kind`).

    Args:
        folder: Folder of a complete data set.
        number: Number of the sequence, as in `sequences.parquet`.

    Returns:
        The sequence: `scene` (with the drawn values, a seed of its own, and frames 0 to n_frame - 1), `scenario`,
        `sensors`, `by_kind`, `values` by field, `attempt`, `number`. A warning says if it was written by another
        version.

    Raises:
        InputError: The folder holds no complete data set, no such sequence, or a file that it was made from is missing
            or was changed since.
    """
    path, manifest = Path(folder) / MANIFEST, _manifest_of(Path(folder))
    with errors_at("", os.fspath(path)):
        recipe = Recipe.from_dict(manifest["recipe"])
        number = whole_number("number", number, 0)
        if number >= recipe.n_sequence:
            raise InputError(f"must be below {recipe.n_sequence:,}, the sequences there are", "number", number)
        inputs = input_checksums_of(recipe)
        for name, checksum in manifest.get("inputs", {}).items():
            if inputs.get(name) != checksum:
                raise InputError(f"{name} was changed since the data set was written")
    if manifest.get("warpsim") != __version__:
        warnings.warn(
            f"{path}: written by warpsim {manifest.get('warpsim')}, this is {__version__}: counts may differ",
            stacklevel=2,
        )
    return draw_sequence(recipe, number)
