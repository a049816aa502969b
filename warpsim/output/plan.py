"""What a run will write.

The unit of work is a sensor. All receipts and the manifest carry the key of the run: a hash of everything that the
files depend on.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warpsim.arguments import chosen_names
from warpsim.errors import InputError
from warpsim.output.formats import FORMATS, Format, Images, chosen_formats
from warpsim.render.renderer import Renderer
from warpsim.scene.inputs import input_checksums
from warpsim.scene.scene import Scene

USUAL_FORMATS = ("fits",)

PARTS = ".warpsim-parts"
"""Folder of what a run needs while it is unfinished."""


@dataclass(frozen=True)
class Plan:
    """What a run will write."""

    scene: Scene
    folder: Path
    bands: list[str]
    frames_of: dict[str, list[int]]
    """Frames of each sensor: those asked for in which it has access."""
    key: str
    """Hash of all that the files depend on."""
    tables: tuple[str, ...] = ("truth",)
    """Tables beside the images: "truth" (targets), and "stars" when wanted."""
    formats: dict[str, Format] = field(default_factory=lambda: {name: FORMATS[name] for name in USUAL_FORMATS})
    """How images are stored, by name."""

    @property
    def n_image(self) -> int:
        """Images of the whole run."""
        return sum(len(numbers) for numbers in self.frames_of.values()) * len(self.bands)

    @property
    def parts(self) -> Path:
        """Folder of what a run needs while it is unfinished."""
        return self.folder / PARTS

    @property
    def manifest_path(self) -> Path:
        """Written last: its presence means that the run is complete."""
        return self.folder / "manifest.json"

    def table_path(self, table: str) -> Path:
        """A table of all sensors."""
        return self.folder / f"{table}.fits"

    @property
    def names(self) -> list[str]:
        """Names of all files of the finished run, relative to its folder."""
        images = [name for sensor in self.frames_of for name in self.image_names(sensor)]
        tables = [self.table_path(table).name for table in self.tables]
        return [*images, *tables, self.sheet_path.name, self.manifest_path.name]

    @property
    def sheet_path(self) -> Path:
        """The contact sheet."""
        return self.folder / "contact_sheet.png"

    def images(self, sensor: str, band: str) -> Images:
        """The images of a sensor in a band."""
        return Images(self.scene, sensor, band, self.frames_of[sensor])

    def image_names(self, sensor: str) -> list[str]:
        """Names of all files of a sensor's images."""
        of_bands = [self.images(sensor, band) for band in self.bands]
        return [name for form in self.formats.values() for images in of_bands for name in form.names(images)]

    @property
    def needs_signal(self) -> bool:
        """Whether a format stores noiseless images."""
        return any(form.needs_signal for form in self.formats.values())

    def part_paths(self, sensor: str) -> list[Path]:
        """The tables of one sensor, until all are there."""
        return [self.parts / f"{sensor}_{table}.fits" for table in self.tables]

    def receipt_path(self, sensor: str) -> Path:
        """The receipt of a sensor."""
        return self.parts / f"{sensor}.json"


def make_plan(
    renderer: Renderer,
    folder: Path,
    frames: Sequence[int] | None,
    sensors: Sequence[str] | None,
    bands: Sequence[str] | None,
    stars: bool,
    every_frame: bool = False,
    formats: Sequence[str] = USUAL_FORMATS,
    preview: str | None = None,
) -> Plan:
    """Decide what a run writes; None means all of the scene.

    Raises:
        InputError: A bad name or number, a package that a format needs is missing, or no access at all.
    """
    import warpsim

    chosen = chosen_formats(formats, preview)
    scene = renderer.scene
    numbers = renderer.checked_frames(range(scene.frames.count) if frames is None else frames)
    if not numbers:
        raise InputError("must name at least one", "frames")
    # Frames of a cube and files of a run are written once each, however often they are named.
    numbers = list(dict.fromkeys(numbers))
    sensor_list = list(dict.fromkeys(chosen_names("sensors", sensors, scene.sensor_names)))
    band_list = list(dict.fromkeys(chosen_names("bands", bands, list(scene.bands))))
    times = scene.frame_time_s(numbers)
    always = np.ones(len(times), dtype=bool)
    seen = {sensor: always if every_frame else scene.has_access(sensor, times) for sensor in sensor_list}
    frames_of = {
        sensor: [number for number, ok in zip(numbers, has_access, strict=True) if ok]
        for sensor, has_access in seen.items()
        if has_access.any()
    }
    if not frames_of:
        raise InputError(
            "no sensor has access to the main target in any of them; `warpsim access` lists when, `warpsim check` says "
            "why not, --every-frame renders all the same",
            "frames",
        )
    device = "cuda" if renderer.device.is_cuda else "cpu"
    tables = ("truth", "stars") if stars else ("truth",)
    facts = [scene.to_dict(), input_checksums(scene), renderer.catalog.checksum, frames_of, band_list, device, tables]
    facts.append(warpsim.__version__)
    if tuple(chosen) != USUAL_FORMATS:
        facts.append(list(chosen))
    key = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return Plan(scene, folder, band_list, frames_of, key, tables, chosen)
