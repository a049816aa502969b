"""Export of a finished data set into the folder of a trainer: Ultralytics YOLO, MOTChallenge or Hugging Face."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import chosen_names, finite_number
from warpsim.dataset.pictures import CHANNELS, N_CHANNEL, Grey, Picture, ToneMap, pictures_of
from warpsim.dataset.read_dataset import DatasetReader
from warpsim.dataset.trainer_layouts import LAYOUTS, TrainerLayout
from warpsim.errors import InputError
from warpsim.files import write_json
from warpsim.output.checkpoints import whole_folder
from warpsim.output.wording import counted, progress_bar
from warpsim.version import __version__

FACTS = "export.json"
"""What was exported, from what, by which tone map."""


@dataclass(frozen=True)
class ExportReport:
    """Report of an export."""

    folder: Path
    format: str
    n_image: int
    """Pictures written."""
    n_label: int
    n_hidden: int
    """Targets of these pictures without a label, as they are not visible."""
    n_faint: int
    """Visible targets below least_snr: without a label, or marked not to be scored (MOTChallenge)."""
    n_other: int
    """Visible targets of classes that were not asked for: likewise."""
    total_s: float

    def text(self) -> str:
        """One line for a person."""
        faint = f", {self.n_faint:,} too faint" if self.n_faint else ""
        other = f", {self.n_other:,} of other classes" if self.n_other else ""
        return (
            f"{counted(self.n_image, 'image')} and {counted(self.n_label, 'label')} for {self.format} in {self.folder} "
            f"after {self.total_s:.1f} s; left out: {self.n_hidden:,} targets not visible{faint}{other}"
        )


def export_dataset(
    dataset: str | Path,
    folder: str | Path,
    format: str,
    channels: str | None = None,
    bands: Sequence[str] | None = None,
    splits: Sequence[str] | None = None,
    classes: Sequence[str] | None = None,
    least_snr: float = 0.0,
    knee_nei: float = 2.0,
    top_nei: float = 1000.0,
    progress: bool = False,
) -> ExportReport:
    """Write a finished data set, of any format, once more as a trainer wants it (docs/datasets.md has the layouts).

    Images become 8 bits: linear about the blank level up to knee_nei, logarithmic above, white at top_nei. The tone map
    is written down beside them. The folder appears whole or not at all.

    Args:
        dataset: Folder of the data set.
        folder: Folder to write; missing or empty.
        format: "yolo" (Ultralytics), "mot" (MOTChallenge) or "huggingface" (a folder of images with metadata).
        channels: What the three channels of an image are: "bands", up to three, or "frames", the image behind the two
            frames before it. When left out, each image is one of one channel.
        bands: Bands to take; all when left out.
        splits: Splits to take; all when left out.
        classes: Classes to label, numbered in this order; all when left out. Targets of others stay without a label;
            in MOTChallenge's files they are marked not to be scored.
        least_snr: Light in a target's own pixel, over the noise of that pixel, from which on it is labelled.
        knee_nei: Level up to which the tone map is linear [NEI].
        top_nei: Level that is drawn white [NEI].
        progress: Draw a progress bar on standard error.

    Returns:
        Report of what was written and what was left out.

    Raises:
        InputError: There is no complete data set, the folder holds something, or an argument asks for what cannot be.
        OSError: An image cannot be read, or writing failed; nothing is left behind.
    """
    begin = time.perf_counter()
    folder, tone_map = Path(folder).absolute(), ToneMap(knee_nei, top_nei)
    given = {"least_snr": finite_number("least_snr", least_snr), "tone_map": tone_map.facts}
    with DatasetReader(Path(dataset)) as reader:
        facts = _facts(reader, format, channels, bands, classes) | given
        splits = chosen_names("splits", splits, list(reader.splits))
        with whole_folder(folder) as home:
            layout = LAYOUTS[format](home, facts)
            counts = np.zeros(5, dtype=np.int64)
            with progress_bar(sum(len(reader.splits[split]) for split in splits), progress, "images") as advance:
                for picture in _pictures(reader, splits, facts["bands"], channels or "", advance):
                    counts += _add(layout, picture, picture.grey(reader, tone_map))
            if not counts[0]:
                rule = f"has no images in bands {', '.join(facts['bands'])} of {', '.join(splits)}"
                raise InputError(rule).of(dataset)
            layout.finish()
            n_image, *numbers = counts.tolist()
            named = dict(zip(("labels", "hidden", "faint", "other_classes"), numbers, strict=True))
            write_json(facts | {"splits": dict(layout.n_picture)} | named, home / FACTS)
    n_label, n_hidden, n_faint, n_other = numbers
    return ExportReport(folder, format, n_image, n_label, n_hidden, n_faint, n_other, time.perf_counter() - begin)


def _add(layout: TrainerLayout, picture: Picture, grey: Grey) -> npt.NDArray[np.int64]:
    """Add a picture; return how many pictures, labels, and targets that are hidden, faint or of other classes."""
    chosen = [label for label in picture.labels if label.class_name in layout.facts["classes"]]
    labels = [label for label in chosen if label.snr >= layout.facts["least_snr"]]
    layout.add(picture, grey, labels, [label for label in picture.labels if label not in labels])
    n_faint, n_other = len(chosen) - len(labels), len(picture.labels) - len(chosen)
    return np.array([1, len(labels), picture.n_hidden, n_faint, n_other])


def _facts(
    reader: DatasetReader, format: str, channels: str | None, bands: Sequence[str] | None, classes: Sequence[str] | None
) -> dict[str, Any]:
    """What is to be said of an export; InputError where it asks for what cannot be."""
    if format not in LAYOUTS:
        raise InputError(f"must be one of {', '.join(LAYOUTS)}", "format", format)
    if channels is not None and channels not in CHANNELS:
        raise InputError(f"must be one of {', '.join(CHANNELS)}", "channels", channels)
    chosen = chosen_names("bands", bands, reader.band_names)
    if channels == "bands" and len(chosen) > N_CHANNEL:
        raise InputError(f"must name at most {N_CHANNEL} for channels", "bands", ", ".join(chosen), "s")
    return {
        "format": format,
        "title": reader.title,
        "dataset": {"name": reader.folder.absolute().name, "key": reader.key},
        "provenance": reader.provenance,
        "warpsim": __version__,
        "channels": channels,
        "n_channel": N_CHANNEL if channels else 1,
        "bands": chosen,
        "classes": list(dict.fromkeys(chosen_names("classes", classes, reader.class_names))),
        "interval_s": reader.interval_s,
    }


def _pictures(
    reader: DatasetReader, splits: list[str], bands: list[str], channels: str, advance: Callable[[int], None]
) -> Iterator[Picture]:
    for split in splits:
        for images in reader.sequences(split):
            yield from pictures_of(reader, split, images, bands, channels)
            advance(1)
