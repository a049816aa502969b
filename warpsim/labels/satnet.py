"""Labels of one image in the form of the SatNet data set, with the names that SatSim writes.

Fletcher, J. et al. (2019), "Feature-Based Satellite Detection Using Convolutional Neural Networks", AMOS. Positions are
parts of the image's width and height, from the outer corner of the first pixel: (x_px + 0.5) / n_col.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.labels.boxes import CORNER_PX, blur_half_px, box_around
from warpsim.labels.table import BOX_COLUMNS
from warpsim.radiometry.magnitudes import PHYSICS
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Row, Table

F64 = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

CLASS_IDS = {"Satellite": 1, "Star": 2}
"""As in SatSim: every target is a satellite."""

SOURCE = "warpsim"

LINE_FROM_PX = 1.0
"""Movement from which a source is a line, not a point."""


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
        objects += _stars(frames, frame, sensor, band)
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


def _stars(frames: FrameSet, frame: int, sensor: str, band: str) -> list[dict[str, Any]]:
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
        box = tuple(box_around(ends_px.min(axis=0), ends_px.max(axis=0), half_px, size_px).tolist())
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


def _object(class_name: str, box: tuple[float, ...], position_px: F64, moved_px: F64, size_px: Ints) -> dict[str, Any]:
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
