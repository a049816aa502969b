"""Annotations: COCO's, shard by shard, and those of single images in the form of the SatNet data set.

A worker leaves the COCO texts of its shard beside its checkpoint record, so that in the end they are only joined.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.dataset.layout import COCO, Shard, table_path
from warpsim.dataset.recipe import SHARDED, Recipe
from warpsim.files import read_json, sha256_of, write_json
from warpsim.labels.coco import BETWEEN, coco_categories, coco_texts
from warpsim.labels.parquet import read_parquet
from warpsim.labels.satnet import satnet_record
from warpsim.output.output_folder import PARTS
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Table

Columns = dict[str, npt.NDArray[Any]]

_FACTS = {
    "id": "image_id", "file_name": "file", "item": "item", "width": "width", "height": "height",
    "sequence": "sequence", "frame": "frame", "time_s": "time_s", "date_obs": "date_obs", "sensor": "sensor",
    "band": "band",
}  # fmt: skip
"""What COCO's file says of an image, and the columns of the table of images that know it."""


def keep_texts(recipe: Recipe, folder: Path, shard: Shard) -> str:
    """Write the COCO texts of a shard with complete tables; return their SHA-256."""
    path = _texts_path(folder, shard)
    write_json(_texts(recipe, folder, shard), path)
    return sha256_of(path)


def shard_texts(recipe: Recipe, folder: Path, shard: Shard, checksum: str | None) -> tuple[str, str]:
    """Return the COCO texts of a shard's images and annotations; made again unless stored whole."""
    path = _texts_path(folder, shard)
    if path.is_file() and sha256_of(path) == checksum:
        images, annotations = read_json(path)
        return images, annotations
    return _texts(recipe, folder, shard)


def _texts_path(folder: Path, shard: Shard) -> Path:
    return folder / PARTS / COCO / f"{shard.name}.json"


def _texts(recipe: Recipe, folder: Path, shard: Shard) -> tuple[str, str]:
    images, annotations = zip(
        *coco_texts(_images(recipe, folder, shard), coco_categories(recipe.scenario)), strict=True
    )
    return BETWEEN.join(images), BETWEEN.join(filter(None, annotations))


def _images(recipe: Recipe, folder: Path, shard: Shard) -> Iterator[tuple[dict[str, Any], Columns]]:
    """Each image of a shard, and the columns of its targets."""
    for number in shard.sequences[:1] if recipe.format in SHARDED else shard.sequences:
        images = _columns(folder / table_path(recipe, shard, number, "images"))
        truth = _columns(folder / table_path(recipe, shard, number, "truth"))
        order = np.argsort(truth["image_id"], kind="stable")
        truth = {name: column[order] for name, column in truth.items()}
        ends = np.searchsorted(truth["image_id"], images["image_id"], side="right")
        firsts = np.searchsorted(truth["image_id"], images["image_id"])
        facts = {ours: images[name].tolist() for ours, name in _FACTS.items()}
        for first, end, *values in zip(firsts, ends, *facts.values(), strict=True):
            yield dict(zip(facts, values, strict=True)), {name: column[first:end] for name, column in truth.items()}


def _columns(path: Path) -> Columns:
    table = read_parquet(path)
    return {name: np.asarray(table[name]) for name in table.colnames}


def write_satnet(frames: FrameSet, rows: dict[str, Table], folder: Path) -> None:
    """Write SatNet annotations of the images of a render call: Annotations/SENSOR_BAND.FRAME.json.

    Args:
        frames: The images.
        rows: Their tables "images" and "truth".
        folder: Of the sequence.
    """
    home = folder / "Annotations"
    home.mkdir(parents=True, exist_ok=True)
    ids = np.asarray(rows["truth"]["image_id"])
    for image in rows["images"]:
        frame, sensor, band = int(image["frame"]), str(image["sensor"]), str(image["band"])
        labels = rows["truth"][ids == image["image_id"]]
        record = satnet_record(frames, frame, sensor, band, labels, str(image["file"]))
        write_json(record, home / f"{sensor}_{band}.{frame:06d}.json")
