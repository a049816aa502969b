"""Folders as trainers want them: Ultralytics YOLO, MOTChallenge, Hugging Face; one class each, with the same methods.

YAML is written as JSON, which it contains, behind each key.
"""

from __future__ import annotations

import json
import re
from collections import defaultdict
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from warpsim.dataset.pictures import Grey, Label, Picture
from warpsim.errors import InputError
from warpsim.output.image_files import write_grey

BENCHMARK = "warpsim"
"""Name of the benchmark in MOTChallenge's folders, warpsim-SPLIT."""

MOT_CLASS = 1
"""Of every target: evaluators score class 1 alone, and take some others for distractors."""

LEAST_SIDE_PX = 10
"""Of an image, by Ultralytics."""

PX_DIGITS = 6

HUB_COLUMNS = {
    "image": "image", "sequence": "int64", "frame": "int64", "sensor": "string", "band": "string", "image_id": "int64",
    "time_s": "float64", "date_obs": "string", "nei_w_cm2": "float64",
}  # fmt: skip
"""Columns of a Hugging Face data set besides `objects`, and their types."""

HUB_OBJECTS: dict[str, Any] = {
    "bbox": "float64", "category": "int64", "id": "int64", "target": "string", "snr": "float64",
}  # fmt: skip
"""Types of what `objects` lists; of a box four."""

LINE_BYTES = 2**26
"""Of a line of JSON at most."""


@dataclass
class TrainerLayout:
    """A folder as a trainer wants it."""

    home: Path
    facts: dict[str, Any]
    """What is to be said of the export: tone map, channels, bands, classes."""
    n_picture: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    """By split."""

    @property
    def class_numbers(self) -> dict[str, int]:
        """Labelled classes, from 0."""
        return {name: number for number, name in enumerate(self.facts["classes"])}

    def add(self, picture: Picture, grey: Grey, labels: list[Label], ignored: list[Label]) -> None:
        """Write a further picture, those of a video in order."""
        raise NotImplementedError

    def finish(self) -> None:
        """Write what describes all pictures."""

    def _file(self, path: str) -> Path:
        file = self.home / path
        file.parent.mkdir(parents=True, exist_ok=True)
        return file

    def _draw(self, path: str, picture: Picture, grey: Grey) -> None:
        write_grey(self._file(path), grey, {"image_id": picture.row["image_id"]} | self.facts["provenance"])
        self.n_picture[picture.split] += 1

    def _append(self, path: str, lines: list[str]) -> None:
        """Append lines to a file, which is made even without any."""
        with self._file(path).open("a", encoding="utf-8", newline="\n") as file:
            file.writelines(f"{line}\n" for line in lines)


class _Yolo(TrainerLayout):
    """images/SPLIT/*.png, labels/SPLIT/*.txt with `class cx cy w h` in parts of the image's size, and data.yaml."""

    def add(self, picture: Picture, grey: Grey, labels: list[Label], ignored: list[Label]) -> None:
        """Write an image and its text."""
        n_row, n_col = grey.shape[:2]
        if min(n_row, n_col) < LEAST_SIDE_PX:
            raise InputError(f"images must have {LEAST_SIDE_PX} rows and columns for yolo", "camera", (n_row, n_col))
        lines = []
        for label in labels:
            x, y, w, h = label.box_px
            parts = ((x + 0.5 * w) / n_col, (y + 0.5 * h) / n_row, w / n_col, h / n_row)
            lines.append(" ".join([str(self.class_numbers[label.class_name]), *(f"{part:.8f}" for part in parts)]))
        self._draw(f"images/{picture.split}/{picture.stem}.png", picture, grey)
        self._append(f"labels/{picture.split}/{picture.stem}.txt", list(dict.fromkeys(lines)))

    def finish(self) -> None:
        """Write data.yaml, whose folder is the root of its paths."""
        lines = [
            "# Made by `warpsim export`. Paths count from this file's folder.",
            *(f"{split}: {json.dumps(f'images/{split}')}" for split in self.n_picture),
            f"nc: {len(self.class_numbers)}",
            f"names: {json.dumps(self.facts['classes'])}",
            f"channels: {self.facts['n_channel']}",
            "# How counts became 8 bits.",
            f"tone_map: {json.dumps(self.facts['tone_map'])}",
        ]
        self._append("data.yaml", lines)


class _MotChallenge(TrainerLayout):
    """warpsim-SPLIT/VIDEO with img1/000001.png, gt/gt.txt, gt/targets.csv and seqinfo.ini, and seqmaps."""

    def add(self, picture: Picture, grey: Grey, labels: list[Label], ignored: list[Label]) -> None:
        """Write an image and its lines of gt.txt, in which ignored targets have confidence 0."""
        split, number = f"{BENCHMARK}-{picture.split}", picture.frame + 1
        home = f"{split}/{picture.video}"
        if picture.frame == 0:
            if not (self.home / "seqmaps" / f"{split}.txt").exists():
                self._append(f"seqmaps/{split}.txt", ["name"])
            self._append(f"seqmaps/{split}.txt", [picture.video])
            self._append(f"{home}/seqinfo.ini", self._info(picture, grey))
            self._append(f"{home}/gt/targets.csv", ["id,target,class"])
            self._targets: set[int] = set()
        self._draw(f"{home}/img1/{number:06d}.png", picture, grey)
        lines = []
        known = sorted([*labels, *ignored])
        for label in known:
            x, y, w, h = label.box_px
            box = ",".join(f"{part:.{PX_DIGITS}f}" for part in (x + 1.0, y + 1.0, w, h))
            counts = int(label not in ignored)
            lines.append(f"{number},{label.number},{box},{counts},{MOT_CLASS},{label.unblended:.4f}")
        self._append(f"{home}/gt/gt.txt", lines)
        new = [label for label in known if label.number not in self._targets]
        self._append(f"{home}/gt/targets.csv", [f"{one.number},{one.target},{one.class_name}" for one in new])
        self._targets |= {label.number for label in new}

    def _info(self, picture: Picture, grey: Grey) -> list[str]:
        interval_s = self.facts["interval_s"]
        values = {
            "name": picture.video,
            "imDir": "img1",
            "frameRate": max(1, round(1.0 / interval_s)),  # readers take a whole number
            "seqLength": picture.n_frame,
            "imWidth": grey.shape[1],
            "imHeight": grey.shape[0],
            "imExt": ".png",
            "interval_s": interval_s,
        }
        return ["[Sequence]", *(f"{name}={value}" for name, value in values.items())]


class _HuggingFace(TrainerLayout):
    """SPLIT/*.png with SPLIT/metadata.parquet, and a dataset card whose features name the classes.

    Rows are lines of JSON until the end, when they get types: of a split without any label readers could not tell them.
    """

    def add(self, picture: Picture, grey: Grey, labels: list[Label], ignored: list[Label]) -> None:
        """Write an image and its line."""
        self._draw(f"{picture.split}/{picture.stem}.png", picture, grey)
        facts = {name: picture.row[name] for name in ("image_id", "time_s", "date_obs", "nei_w_cm2")}
        line = {
            "file_name": f"{picture.stem}.png",
            **{name: getattr(picture, name) for name in ("sequence", "frame", "sensor", "band")},
            **facts,
            "objects": {
                "bbox": [[round(part, PX_DIGITS) for part in label.box_px] for label in labels],
                "category": [self.class_numbers[label.class_name] for label in labels],
                "id": [label.number for label in labels],
                "target": [label.target for label in labels],
                "snr": [float(f"{label.snr:.6g}") for label in labels],
            },
        }
        self._append(f"{picture.split}/metadata.jsonl", [json.dumps(line)])

    @property
    def _features(self) -> list[dict[str, Any]]:
        names = {str(number): name for name, number in self.class_numbers.items()}
        objects = HUB_OBJECTS | {"bbox": {"sequence": "float64"}, "category": {"class_label": {"names": names}}}
        struct = [{"name": name, "sequence": kind} for name, kind in objects.items()]
        columns: list[dict[str, Any]] = [{"name": name, "dtype": kind} for name, kind in HUB_COLUMNS.items()]
        return [*columns, {"name": "objects", "struct": struct}]

    @staticmethod
    def _give_types(lines: Path) -> None:
        arrow, arrow_json, parquet = (import_module(f"pyarrow{part}") for part in ("", ".json", ".parquet"))
        objects = {name: arrow.list_(arrow.type_for_alias(kind)) for name, kind in HUB_OBJECTS.items()}
        objects["bbox"] = arrow.list_(objects["bbox"])
        kinds = {"file_name": "string"} | {name: kind for name, kind in HUB_COLUMNS.items() if name != "image"}
        columns = {name: arrow.type_for_alias(kind) for name, kind in kinds.items()}
        schema = arrow.schema(columns | {"objects": arrow.struct(objects)})
        options = arrow_json.ReadOptions(block_size=LINE_BYTES), arrow_json.ParseOptions(explicit_schema=schema)
        parquet.write_table(arrow_json.read_json(lines, *options), lines.with_suffix(".parquet"))
        lines.unlink()

    def finish(self) -> None:
        """Write tables and the card."""
        for split in self.n_picture:
            self._give_types(self.home / split / "metadata.jsonl")
        others = {"val": "validation", "all": "all_images"}  # `all` has a meaning of its own there
        files = []
        for split in self.n_picture:
            name = others.get(split) or re.sub(r"\W", "_", split)
            files += [f"  - split: {name}", f"    path: {json.dumps(f'{split}/**')}"]
        n_picture = sum(self.n_picture.values())
        classes = [f"| {number} | {name} |" for name, number in self.class_numbers.items()]
        lines = [
            "---",
            f"pretty_name: {json.dumps(self.facts['title'])}",
            "task_categories:",
            "- object-detection",
            "tags:",
            "- synthetic",
            "- infrared",
            "- space",
            "configs:",
            "- config_name: default",
            f"  features: {json.dumps(self._features)}",
            "  data_files:",
            *files,
            "---",
            "",
            f"# {self.facts['title']}",
            "",
            f"{n_picture:,} synthetic images of infrared sensors on satellites, rendered by warpsim "
            f"{self.facts['warpsim']}, with the truth that they were drawn from.",
            "",
            "`objects` of an image: `bbox` is COCO's, x, y, width, height in pixels, whose edges lie on whole numbers; "
            "`category` is the number below; `id` is the same target in all images of a `sequence`; `snr` is the light "
            "in the target's own pixel over the noise there.",
            "",
            "| category | class |",
            "|---|---|",
            *classes,
            "",
            f"Pixels are 8 bits: grey = {self.facts['tone_map']['grey']}; "
            + ", ".join(f"{name} = {value:g}" for name, value in self.facts["tone_map"].items() if name != "grey")
            + f". Channels: {self.facts['channels'] or 'one, the image'}.",
        ]
        self._append("README.md", lines)


LAYOUTS: dict[str, type[TrainerLayout]] = {"yolo": _Yolo, "mot": _MotChallenge, "huggingface": _HuggingFace}
