"""Labels as a COCO file: boxes, centres as keypoints, masks as run lengths; written as it comes, whatever its size."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.files import plain_number, whole_file
from warpsim.labels.boxes import CORNER_PX, mask_to_rle, rle_area
from warpsim.labels.table import BOX_COLUMNS
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from astropy.table import Table

Rows: TypeAlias = "Table | Mapping[str, npt.NDArray[Any]]"

KEYPOINT = "centre"

BETWEEN = ",\n"
"""Items of a list in the file."""

ROWS_PER_IMAGE = 100_000
"""Ids of annotations are image id x this + row in the image's label table + 1, whatever else is visible."""

_VALUES = ("snr", "snr_peak", "irradiance_w_cm2", "range_km")
_COLUMNS = ["target", "class", "x_px", "y_px", "keypoint_visibility", *BOX_COLUMNS, *_VALUES]

COORDINATES = (
    "bbox and keypoints count pixels from the outer corner of the first pixel, whose centre is (0.5, 0.5); "
    "x_px and y_px count from its centre"
)
"""Said in each file's info."""

_PX_DIGITS = 6
_VALUE_DIGITS = 7  # of numbers that are float32 in the images


def coco_categories(scene: Scene | Scenario) -> list[dict[str, Any]]:
    """Return the classes of the targets of a scene as COCO's categories, in the order of the scene, from id 1 on.

    Targets without a class of their own are classed by the name of their entry. The supercategory is the shape, of the
    first entry of the class.

    Args:
        scene: The scene, or its scenario.
    """
    specs = [spec for group in scenario_of(scene).scene.groups for spec in group.targets]
    kinds = {spec.class_name: spec.shape.kind for spec in reversed(specs)}
    names = dict.fromkeys(spec.class_name for spec in specs)
    return [
        {"id": number, "name": name, "supercategory": kinds[name], "keypoints": [KEYPOINT], "skeleton": []}
        for number, name in enumerate(names, start=1)
    ]


def write_coco(
    path: str | Path,
    images: Iterable[tuple[Mapping[str, Any], Rows]],
    categories: Sequence[Mapping[str, Any]],
    info: Mapping[str, Any] | None = None,
) -> None:
    """Write images and the labels of their visible targets, whole or not at all.

    One image is looked at at a time, so that memory does not grow with the file. While it is written, its annotations
    lie in a second, nameless file beside it.

    Args:
        path: File to write; replaced if it is there.
        images: Of each image what COCO says of it (id, file_name, width, height, and anything else), and its rows of a
            label table, in the order of the scene's targets: a table, or its columns by name, which is quicker.
        categories: As `coco_categories` makes them.
        info: What is said about the whole file.

    Raises:
        InputError: An image lacks one of the four entries or has the id of an earlier one, or a category is unknown.
    """
    path = Path(path)
    seen: set[int] = set()

    def checked() -> Iterator[tuple[Mapping[str, Any], Rows]]:
        for image, rows in images:
            _check_image(path, image, seen)
            yield image, rows

    write_coco_parts(path, coco_texts(checked(), categories), categories, info)


def coco_texts(
    images: Iterable[tuple[Mapping[str, Any], Rows]], categories: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[str, str]]:
    """Yield COCO texts of each image and of its annotations: items of JSON lists, annotations one a line."""
    ids = {str(category["name"]): int(category["id"]) for category in categories}
    for image, rows in images:
        yield _json(image), BETWEEN.join(map(_json, image_annotations(image, rows, ids)))


def write_coco_parts(
    path: Path,
    parts: Iterable[tuple[str, str]],
    categories: Sequence[Mapping[str, Any]],
    info: Mapping[str, Any] | None = None,
) -> None:
    """Assemble a file from texts of one or more images and of their annotations, whole or not at all."""
    with (
        whole_file(path) as partial,
        partial.open("w", encoding="utf-8", newline="\n") as file,
        tempfile.TemporaryFile("w+", encoding="utf-8", newline="\n", dir=path.parent) as annotations,
    ):
        head = {"info": {"coordinates": COORDINATES, **(info or {})}, "licenses": [], "categories": list(categories)}
        file.write(_json(head)[:-1] + ',\n"images": [')
        before = {file: "\n", annotations: "\n"}
        for texts in parts:
            for where, text in zip((file, annotations), texts, strict=True):
                if text:
                    where.write(before[where] + text)
                    before[where] = BETWEEN
        file.write('\n],\n"annotations": [')
        annotations.seek(0)
        shutil.copyfileobj(annotations, file)
        file.write("\n]}\n")


def image_annotations(image: Mapping[str, Any], rows: Rows, category_ids: Mapping[str, int]) -> list[dict[str, Any]]:
    """Return COCO's annotations of the visible targets of one image, of which id, width and height are known.

    The rows are the image's of a label table, or its columns by name, in the order of the scene's targets. InputError:
    a category is unknown, or there are too many rows.
    """
    n_row = len(rows["visible"])
    if n_row > ROWS_PER_IMAGE:
        raise InputError(f"must have at most {ROWS_PER_IMAGE} label rows", value=n_row).of(f"image {image['id']}")
    shape = (int(image["height"]), int(image["width"]))
    with_masks = "mask_rle" in rows.keys()  # noqa: SIM118 - a table is no mapping
    (visible,) = np.nonzero(np.asarray(rows["visible"]))
    names = [*_COLUMNS, "mask_rle"] if with_masks else _COLUMNS
    columns = [np.asarray(rows[name])[visible].tolist() for name in names]
    found = []
    for number, *values in zip(visible.tolist(), *columns, strict=True):
        row = dict(zip(names, values, strict=True))
        if row["class"] not in category_ids:
            raise InputError(f"must have {row['class']!r}, the class of the target {row['target']!r}", "categories")
        box_px = [round(row[name], _PX_DIGITS) for name in BOX_COLUMNS]
        position_px = [round(row[name], _PX_DIGITS) for name in ("x_px", "y_px")]
        annotation = {
            "id": int(image["id"]) * ROWS_PER_IMAGE + number + 1,
            "image_id": image["id"],
            "category_id": category_ids[row["class"]],
            "iscrowd": 0,
            "bbox": box_px,
            "area": round(box_px[2] * box_px[3], _PX_DIGITS),
            "keypoints": [*(round(value + CORNER_PX, _PX_DIGITS) for value in position_px), row["keypoint_visibility"]],
            "num_keypoints": 1,
            "target": row["target"],
            "x_px": position_px[0],
            "y_px": position_px[1],
            **{name: _short(row[name]) for name in _VALUES},
        }
        if with_masks:
            counts = row["mask_rle"] or _empty_code(shape)
            annotation["segmentation"] = {"size": list(shape), "counts": counts}
            annotation["area"] = rle_area(counts, shape) or annotation["area"]
        found.append(annotation)
    return found


@lru_cache(maxsize=16)
def _empty_code(shape: tuple[int, int]) -> str:
    return mask_to_rle(np.zeros(shape, dtype=bool))


def _check_image(path: Path, image: Mapping[str, Any], seen: set[int]) -> None:
    missing = [name for name in ("id", "file_name", "width", "height") if name not in image]
    if missing:
        raise InputError(f"must have {', '.join(missing)}, got {', '.join(image)}", "images").of(path)
    if isinstance(image["id"], bool) or not isinstance(image["id"], int) or image["id"] < 0:
        raise InputError("id must be a whole number >= 0", "images", image["id"]).of(path)
    if image["id"] in seen:
        raise InputError(f"ids must be unique, got {image['id']} twice", "images").of(path)
    seen.add(image["id"])


def _short(value: float) -> float:
    """A number with as many digits as it deserves."""
    return float(f"{value:.{_VALUE_DIGITS}g}")


_json = json.JSONEncoder(separators=(",", ":"), allow_nan=False, default=plain_number).encode
