"""Annotations of single images, in the form of the SatNet data set: Annotations/SENSOR_BAND.FRAME.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from warpsim.files import write_json
from warpsim.labels.satnet import satnet_record
from warpsim.render.frameset import FrameSet

if TYPE_CHECKING:
    from astropy.table import Table


def write_satnet(frames: FrameSet, rows: dict[str, Table], folder: Path) -> None:
    """Write the annotations of a render call.

    Args:
        frames: The images.
        rows: Their tables "images" and "truth".
        folder: Of the sequence.
    """
    home = folder / "Annotations"
    home.mkdir(exist_ok=True)
    ids = np.asarray(rows["truth"]["image_id"])
    for image in rows["images"]:
        frame, sensor, band = int(image["frame"]), str(image["sensor"]), str(image["band"])
        labels = rows["truth"][ids == image["image_id"]]
        record = satnet_record(frames, frame, sensor, band, labels, str(image["file"]))
        write_json(record, home / f"{sensor}_{band}.{frame:06d}.json")
