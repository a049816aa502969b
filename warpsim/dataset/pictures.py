"""Pictures that trainers read, made of a data set's images: 8 bits by a stated tone map, labels beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from warpsim.arguments import above_zero
from warpsim.dataset.read_dataset import Columns, DatasetReader
from warpsim.errors import InputError
from warpsim.labels.boxes import LEAST_BOX_PX, cut_box
from warpsim.labels.table import BOX_COLUMNS

CHANNELS = ("bands", "frames")
"""What the three channels of a picture may be."""

N_CHANNEL = 3
"""Of such pictures: PNG has 1 or 3."""

Grey = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class ToneMap:
    """Map of levels to 8 bits: linear about the blank level, logarithmic above.

    grey = 255 (asinh(x / knee) - asinh(low / knee)) / (asinh(top / knee) - asinh(low / knee)), rounded, where x is the
    level above the blank level in NEI, cut at low and top.
    """

    knee_nei: float = 2.0
    top_nei: float = 1000.0

    def __post_init__(self) -> None:
        if above_zero("top_nei", self.top_nei) <= above_zero("knee_nei", self.knee_nei):
            raise InputError(f"must be above knee_nei = {self.knee_nei:g}", "top_nei", self.top_nei)

    @property
    def low_nei(self) -> float:
        """Level that is drawn black: noise goes below the blank level, too."""
        return -2.0 * self.knee_nei

    def grey(self, counts: npt.NDArray[np.uint16], row: dict[str, Any]) -> Grey:
        """Return the grey of an image, of which its row says what counts mean."""
        level_nei = (counts.astype(np.float32) - row["blank_counts"]) / row["counts_per_nei"]
        low, top = np.arcsinh(self.low_nei / self.knee_nei), np.arcsinh(self.top_nei / self.knee_nei)
        part = (np.arcsinh(np.clip(level_nei, self.low_nei, self.top_nei) / self.knee_nei) - low) / (top - low)
        return np.asarray(np.rint(255.0 * part), dtype=np.uint8)

    @property
    def facts(self) -> dict[str, Any]:
        """What a reader needs to go back to NEI."""
        formula = "255 (asinh(x/knee) - asinh(low/knee)) / (asinh(top/knee) - asinh(low/knee)), x: NEI above blank"
        return {"grey": formula, "low_nei": self.low_nei, **asdict(self)}


class Label(NamedTuple):
    """A visible target in a picture."""

    number: int
    """Of the target in its sequence, from 1; the same in all of its pictures."""
    target: str
    class_name: str
    box_px: tuple[float, float, float, float]
    """COCO's: left, top, width, height; pixel edges on whole numbers."""
    snr: float
    """Light in the target's own pixel over the noise of that pixel; in its best band."""
    unblended: float
    """Part of the light in that pixel that is the target's own; 1 where the data set does not say."""


@dataclass(frozen=True)
class Picture:
    """One picture."""

    split: str
    sequence: int
    sensor: str
    band: str
    """Or bands, A+C, where they are channels."""
    frame: int
    n_frame: int
    """Of its sequence."""
    images: tuple[dict[str, Any] | None, ...]
    """Rows of the table of images, one for each channel; none where the sensor lacks a band."""
    row: dict[str, Any]
    """Row of the labelled image, or of the first of several bands."""
    labels: list[Label]
    n_hidden: int
    """Targets that are not visible in any of its bands."""

    @property
    def video(self) -> str:
        """Name of the sequence of pictures that it is from."""
        return f"{self.sequence:06d}_{self.sensor}_{self.band}"

    @property
    def stem(self) -> str:
        """Name of it."""
        return f"{self.video}_{self.frame:06d}"

    def grey(self, reader: DatasetReader, tone_map: ToneMap) -> Grey:
        """Return its pixels, shape (row, column, channel)."""
        blank = np.zeros((self.row["height"], self.row["width"]), dtype=np.uint8)
        drawn = [blank if row is None else tone_map.grey(reader.counts(row), row) for row in self.images]
        return np.stack(drawn, axis=-1)


def pictures_of(
    reader: DatasetReader, split: str, images: list[tuple[dict[str, Any], Columns]], bands: Sequence[str], channels: str
) -> Iterator[Picture]:
    """Yield the pictures of a sequence: sensor by sensor, band by band, frame by frame.

    Channels: "" one, the image; "bands" the bands, in this order; "frames" the image and, before it, the two frames
    before, of which the first frames of a sequence lack some: the first one stands for those.
    """
    known = {(row["sensor"], row["frame"], row["band"]): (row, columns) for row, columns in images}
    frames = sorted({frame for _, frame, _ in known})
    for sensor in dict.fromkeys(sensor for sensor, *_ in known):
        own = [band for band in bands if (sensor, frames[0], band) in known]
        groups = [own] if channels == "bands" else [[band] for band in own]
        for group in filter(None, groups):
            for at, frame in enumerate(frames):
                rows = [known[sensor, frame, band][0] for band in group]
                labels, n_hidden = _labels(reader, [known[sensor, frame, band] for band in group])
                shown: tuple[dict[str, Any] | None, ...] = (rows[0],)
                if channels == "frames":
                    before = (frames[max(0, at - back)] for back in reversed(range(N_CHANNEL)))
                    shown = tuple(known[sensor, number, group[0]][0] for number in before)
                elif channels == "bands":
                    found = [known[sensor, frame, band][0] if band in group else None for band in bands]
                    shown = (*found, *[None] * (N_CHANNEL - len(found)))
                name, number = "+".join(group), rows[0]["sequence"]
                yield Picture(split, number, sensor, name, frame, len(frames), shown, rows[0], labels, n_hidden)


def _labels(reader: DatasetReader, images: list[tuple[dict[str, Any], Columns]]) -> tuple[list[Label], int]:
    """Labels of the targets that are visible in one or more of some bands, and how many are in none."""
    row, first = images[0]
    # Data sets from before there was a least size have boxes that readers drop.
    least_px = 0.0 if "least_box_px" in reader.recipe else LEAST_BOX_PX
    seen = np.stack([columns["visible"] for _, columns in images])
    corners = np.stack([[columns[name] for name in BOX_COLUMNS] for _, columns in images])  # band, part, target
    left_top = np.where(seen[:, None], corners[:, :2], np.inf).min(axis=0)
    right_bottom = np.where(seen[:, None], corners[:, :2] + corners[:, 2:], -np.inf).max(axis=0)
    snr = np.stack([columns["snr_peak"] / columns.get("noise_nei", 1.0) for _, columns in images])
    snr = np.nan_to_num(np.where(seen, snr, 0.0)).max(axis=0)  # nothing is known of some that are off the array
    blend = np.stack([columns.get("blend_fraction", np.zeros(seen.shape[1])) for _, columns in images])
    blend = np.nan_to_num(np.where(seen, blend, 1.0)).min(axis=0)
    (shown,) = np.nonzero(seen.any(axis=0))
    size_px = np.array([row["width"], row["height"]])
    boxes_px = cut_box(left_top.T[shown], right_bottom.T[shown], size_px, least_px)
    labels = [
        Label(
            int(number) + 1,
            str(first["target"][number]),
            str(first["class"][number]),
            tuple(box.tolist()),
            float(snr[number]),
            float(1.0 - blend[number]),
        )
        for number, box in zip(shown, boxes_px, strict=True)
    ]
    return labels, seen.shape[1] - len(labels)
