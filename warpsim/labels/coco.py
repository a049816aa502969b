"""Labels as a COCO file, and of one image in the form of the SatNet data set with the names that SatSim writes.

COCO: boxes, centres as keypoints, masks as run lengths, tracks of videos; written as it comes, whatever its size.
SatNet: Fletcher, J. et al. (2019), "Feature-Based Satellite Detection Using Convolutional Neural Networks", AMOS;
positions are parts of the image's width and height, from the outer corner of the first pixel: (x_px + 0.5) / n_col.
"""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64, I64
from warpsim.errors import InputError
from warpsim.files import plain_number, whole_file
from warpsim.labels.boxes import CORNER_PX, LEAST_BOX_PX, box_around, mask_to_rle, rle_area
from warpsim.labels.table import BOX_COLUMNS, LEAST_BOX
from warpsim.radiometry.magnitudes import PHYSICS
from warpsim.render.frameset import FrameSet
from warpsim.render.resolution import blur_half_px
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

if TYPE_CHECKING:
    from astropy.table import Row, Table

Rows: TypeAlias = "Table | Mapping[str, npt.NDArray[Any]]"

KEYPOINT = "centre"

BETWEEN = ",\n"
"""Items of a list in the file."""

ROWS_PER_IMAGE = 100_000
"""Ids of annotations are image id x this + row in the image's label table + 1, whatever else is visible; ids of tracks
are sequence x this + that number."""

_VALUES = ("snr", "snr_peak", "irradiance_w_cm2", "range_km")
_COLUMNS = ["target", "class", "x_px", "y_px", "keypoint_visibility", *BOX_COLUMNS, *_VALUES]

COORDINATES = (
    "bbox and keypoints count pixels from the outer corner of the first pixel, whose centre is (0.5, 0.5); "
    "x_px and y_px count from its centre"
)
"""Said in each file's info."""

_PX_DIGITS = 6
_VALUE_DIGITS = 7  # of numbers that are float32 in the images


CLASS_IDS = {"Satellite": 1, "Star": 2}
"""As in SatSim: every target is a satellite."""

SOURCE = "warpsim"

LINE_FROM_PX = 1.0
"""Movement from which a source is a line, not a point."""


def coco_categories(scene: Scene | Scenario) -> list[dict[str, Any]]:
    """Return the classes of the targets of a scene as COCO's categories, in the order of the scene, from id 1 on.

    Targets without a class of their own are classed by the name of their entry. The supercategory is the shape, of the
    first entry of the class.

    Args:
        scene: The scene, or its scenario.
    """
    described = scene if isinstance(scene, Scene) else scenario_of(scene).scene  # files of flights are not read
    specs = [spec for group in described.groups for spec in group.targets]
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
    and videos lie in further, nameless files beside it.

    Args:
        path: File to write; replaced if it is there.
        images: Of each image what COCO says of it (id, file_name, width, height, and anything else), and its rows of a
            label table, in the order of the scene's targets: a table, or its columns by name, which is quicker. Images
            with a `video_id` make `videos`; a target's `track_id` is the same in all images of a `sequence`.
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
) -> Iterator[tuple[str, str, str]]:
    """Yield COCO texts of each image, of its annotations, and of its video unless it has come: items of JSON lists."""
    ids = {str(category["name"]): int(category["id"]) for category in categories}
    videos: set[int] = set()
    for image, rows in images:
        video = "" if image.get("video_id") in {None, *videos} else _json(_video(image))
        videos |= {image["video_id"]} if video else set()
        yield _json(image), BETWEEN.join(map(_json, image_annotations(image, rows, ids))), video


def _video(image: Mapping[str, Any]) -> dict[str, Any]:
    known = {name: image[name] for name in ("sequence", "sensor", "band") if name in image}
    name = "_".join(f"{value:06d}" if isinstance(value, int) else str(value) for value in known.values())
    size = {"width": image["width"], "height": image["height"]}
    return {"id": image["video_id"], "name": name or str(image["video_id"]), **size, **known}


def write_coco_parts(
    path: Path,
    parts: Iterable[tuple[str, str, str]],
    categories: Sequence[Mapping[str, Any]],
    info: Mapping[str, Any] | None = None,
) -> None:
    """Assemble a file from texts of one or more images, their annotations and videos, whole or not at all."""
    with (
        whole_file(path) as partial,
        partial.open("w", encoding="utf-8", newline="\n") as file,
        tempfile.TemporaryFile("w+", encoding="utf-8", newline="\n", dir=path.parent) as annotations,
        tempfile.TemporaryFile("w+", encoding="utf-8", newline="\n", dir=path.parent) as videos,
    ):
        head = {"info": {"coordinates": COORDINATES, **(info or {})}, "licenses": [], "categories": list(categories)}
        file.write(_json(head)[:-1] + ',\n"images": [')
        before = {file: "\n", annotations: "\n", videos: "\n"}
        for texts in parts:
            for where, text in zip(before, texts, strict=True):
                if text:
                    where.write(before[where] + text)
                    before[where] = BETWEEN
        for name, lines in (("annotations", annotations), ("videos", videos)):
            file.write(f'\n],\n"{name}": [')
            lines.seek(0)
            shutil.copyfileobj(lines, file)
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
    first_track = int(image.get("sequence", 0)) * ROWS_PER_IMAGE
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
            "track_id": first_track + number + 1,
            "instance_id": first_track + number + 1,
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


def satnet_record(
    frames: FrameSet,
    frame: int,
    sensor: str,
    band: str,
    rows: Table,
    file: str | Mapping[str, Any],
    with_stars: bool = False,
) -> dict[str, Any]:
    """Return the SatNet annotation of one image.

    x_min to x_max and y_min to y_max are the box, as in SatNet (in SatSim they are the ends of the path); x_start,
    x_mid, x_end and their like follow the source through the exposure. `pixels` and `snr` are lists, as in SatSim: the
    target's own pixel (row, column), and the SNR of its light there; both are empty where it is off the array.

    Args:
        frames: With the image; rendered with keep_stars for its stars.
        frame: Number of its frame.
        sensor: Name of its sensor.
        band: Name of its band.
        rows: Its rows of a label table.
        file: Path of the image's file, or the entries of `data.file` themselves.
        with_stars: Whether stars on the array are listed too, as class Star.

    Returns:
        Nested dicts and lists for JSON.

    Raises:
        InputError: The image was not rendered, or stars are asked for and were not kept.
    """
    frames.image_numbers("satnet_record", frame, sensor, band)
    camera = frames.instrument.sensor.camera
    names = frames.scenario.target_names
    objects = [_target(frames, band, row, names.index(str(row["target"])) + 1) for row in rows[rows["visible"]]]
    if with_stars:
        objects += _stars(frames, frame, sensor, band, rows.meta.get(LEAST_BOX, LEAST_BOX_PX))
    return {
        "data": {
            "file": {**_file(file), "sequence_id": int(frame)},
            "sensor": {
                "name": sensor,
                "band": band,
                "height": camera.n_row,
                "width": camera.n_col,
                "iFOVy": math.degrees(1.0 / camera.focal_row_px),
                "iFOVx": math.degrees(1.0 / camera.focal_px),
            },
            "objects": objects,
        }
    }


def _file(file: str | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(file, Mapping):
        return dict(file)
    dirname, _, filename = file.rpartition("/")
    return {"dirname": dirname, "filename": filename}


def _target(frames: FrameSet, band: str, row: Row, number: int) -> dict[str, Any]:
    camera = frames.instrument.sensor.camera
    size_px = np.array([camera.n_col, camera.n_row])
    x, y, width, height = (float(row[name]) for name in BOX_COLUMNS)
    position_px = np.array([row["x_px"], row["y_px"]])
    own = np.floor(position_px + CORNER_PX).astype(int)
    on_array = bool(row["in_fov"])
    return {
        **_object("Satellite", (x, y, width, height), position_px, _moved(row), size_px),
        "magnitude": _magnitude(frames, band, row["irradiance_w_cm2"]),
        "irradiance_w_cm2": float(row["irradiance_w_cm2"]),
        "pixels": [own[::-1].tolist()] if on_array else [],
        "snr": [float(row["snr_peak"])] if on_array else [],
        "snr_total": float(row["snr"]),
        "seg_id": number,
        "object_name": str(row["target"]),
        "object_id": str(row["class"]),
    }


def _stars(frames: FrameSet, frame: int, sensor: str, band: str, least_px: float) -> list[dict[str, Any]]:
    """Stars on the array, brightest first."""
    camera, number = frames.instrument.sensor.camera, frames.bands.index(band)
    size_px = np.array([camera.n_col, camera.n_row])
    half_px, stars = np.array(blur_half_px(frames.instrument, band)), frames.stars
    stars = stars[(stars["frame"] == frame) & (stars["sensor"] == sensor) & stars["in_fov"]]
    stars = stars[np.argsort(-stars["irradiance_w_cm2"][:, number], kind="stable")]
    found = []
    for row in stars:
        position_px, moved_px = np.array([row["x_px"], row["y_px"]]), _moved(row)
        ends_px = np.stack([position_px - 0.5 * moved_px, position_px + 0.5 * moved_px])
        box = tuple(box_around(ends_px.min(axis=0), ends_px.max(axis=0), half_px, size_px, least_px).tolist())
        found.append(
            {
                **_object("Star", box, position_px, moved_px, size_px),
                "magnitude": _magnitude(frames, band, row["irradiance_w_cm2"][number]),
                "irradiance_w_cm2": float(row["irradiance_w_cm2"][number]),
                "snr_total": float(row["snr"][number]),
                "seg_id": -1,
                "object_name": str(row["id"]),
                "object_id": int(row["catalog_row"]),
            }
        )
    return found


def _object(class_name: str, box: tuple[float, ...], position_px: F64, moved_px: F64, size_px: I64) -> dict[str, Any]:
    """SatNet fields of every object: class, box and path, in fractions of the image's size."""
    x, y, width, height = box
    start, middle, end = ((position_px + step * moved_px + CORNER_PX) / size_px for step in (-0.5, 0.0, 0.5))
    n_col, n_row = size_px.tolist()
    return {
        "type": "line" if math.hypot(*moved_px) >= LINE_FROM_PX else "point",
        "class_name": class_name,
        "class_id": CLASS_IDS[class_name],
        "y_min": y / n_row,
        "x_min": x / n_col,
        "y_max": (y + height) / n_row,
        "x_max": (x + width) / n_col,
        "y_center": (y + 0.5 * height) / n_row,
        "x_center": (x + 0.5 * width) / n_col,
        "bbox_height": height / n_row,
        "bbox_width": width / n_col,
        "y_start": float(start[1]),
        "x_start": float(start[0]),
        "y_mid": float(middle[1]),
        "x_mid": float(middle[0]),
        "y_end": float(end[1]),
        "x_end": float(end[0]),
        "source": SOURCE,
    }


def _moved(row: Row) -> F64:
    return np.array([row["dx_px"], row["dy_px"]])


def _magnitude(frames: FrameSet, band: str, irradiance_w_cm2: float) -> float:
    """Magnitude in the band by the zero points and the scale of the scene's stars."""
    physics = PHYSICS[frames.scene.sky.physics]
    zero_w_cm2 = physics.zero_point(band).zero_mag_w_cm2
    return -math.log(float(irradiance_w_cm2) / zero_w_cm2) / math.log(physics.magnitude_base)
