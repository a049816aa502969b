"""Plan of a run: the sensors, frames and bands to render, and the files to write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from warpsim.arguments import chosen_names
from warpsim.detector.detectors import has_maps
from warpsim.detector.hits_and_flicker import has_artifacts
from warpsim.errors import InputError
from warpsim.output.formats import Format, Images, chosen_formats
from warpsim.output.output_folder import MANIFEST, PARTS
from warpsim.render.renderer import Renderer
from warpsim.render.request import checked_frames
from warpsim.scene.instrument import Instrument
from warpsim.scene.provenance import input_checksums
from warpsim.scene.scenario import Scenario
from warpsim.version import __version__

USUAL_FORMATS = ("fits",)
SHEET = "contact_sheet.png"


@dataclass(frozen=True)
class RunPlan:
    """Plan of a run: the sensors, frames and bands to render, and the files to write."""

    scenario: Scenario
    bands_of: dict[str, list[str]]
    """Bands of each sensor."""
    frames_of: dict[str, list[int]]
    """Frames of each sensor: those asked for in which it has access."""
    identity: dict[str, Any]
    """All that the files depend on."""
    tables: tuple[str, ...]
    """Tables beside the images: "truth" (targets), "stars" when requested, "artifacts" where detectors have any."""
    formats: dict[str, Format]
    """How images are stored, by name."""
    without_access: tuple[str, ...]
    """Sensors that were named, and have no access in these frames."""

    @property
    def n_image(self) -> int:
        """Images of the whole run."""
        return sum(len(numbers) * len(self.bands_of[sensor]) for sensor, numbers in self.frames_of.items())

    @property
    def bands(self) -> list[str]:
        """All bands."""
        return list(dict.fromkeys(band for bands in self.bands_of.values() for band in bands))

    def bands_of_kind(self, instrument: Instrument) -> list[str]:
        """Bands of the sensors of a kind."""
        return next(self.bands_of[sensor] for sensor in self.frames_of if sensor in instrument.names)

    @property
    def instruments(self) -> dict[str, Instrument]:
        """The kinds of the sensors that are rendered, by name."""
        kinds = {self.scenario.instrument_of(sensor).sensor.name for sensor in self.frames_of}
        return {name: instrument for name, instrument in self.scenario.instruments.items() if name in kinds}

    @property
    def table_names(self) -> list[str]:
        """File names of the tables of all sensors."""
        return [f"{table}.fits" for table in self.tables]

    @property
    def claimed_names(self) -> list[str]:
        """All files, relative to the folder, and the folders of arrays: they must be the run's own."""
        images = [name for sensor in self.frames_of for name in self.image_names(sensor)]
        arrays = {name.partition("/")[0] for name in images if ".zarr/" in name}
        return [*images, *self.table_names, SHEET, *sorted(arrays), MANIFEST]

    def images_of(self, sensor: str) -> list[Images]:
        """The images of a sensor, band by band."""
        return [Images(self.scenario, sensor, band, self.frames_of[sensor]) for band in self.bands_of[sensor]]

    def image_names(self, sensor: str) -> list[str]:
        """Names of all files of a sensor's images, and of the maps of its detector if it has any."""
        names = [
            name for form in self.formats.values() for images in self.images_of(sensor) for name in form.names(images)
        ]
        return [*names, maps_name(sensor)] if has_maps(self.scenario.instrument_of(sensor).sensor.detector) else names

    @property
    def needs_signal(self) -> bool:
        """Return whether a format stores noiseless images."""
        return any(form.plane == "signal_w_cm2" for form in self.formats.values())


def maps_name(sensor: str) -> str:
    """Name of the file of a detector's maps."""
    return f"{sensor}.maps.fits"


def part_name(sensor: str, table: str, first: int) -> str:
    """Name of a part of a table, until all are there: the rows of a sensor from its first-th frame on."""
    return f"{PARTS}/tables/{table}/{sensor}.{first:09d}.fits"


def make_plan(
    renderer: Renderer,
    frames: Sequence[int] | slice | None,
    sensors: str | Sequence[str] | None,
    bands: Sequence[str] | None,
    stars: bool,
    every_frame: bool = False,
    formats: Sequence[str] = USUAL_FORMATS,
    preview: str | None = None,
) -> RunPlan:
    """Return the plan of a run; None means all of the scene.

    Raises:
        InputError: A bad name or number, a package that a format needs is missing, or no access at all.
    """
    chosen = chosen_formats(formats, preview)
    scenario = renderer.scenario
    bands_of = _bands_of(scenario, sensors, bands)
    frames_of: dict[str, list[int]] = {}
    for sensor in bands_of:
        instrument = scenario.instrument_of(sensor)
        numbers = _frame_numbers(renderer, instrument, frames)
        times = instrument.frame_time_s(numbers)
        seen = np.ones(len(times), bool) if every_frame else instrument.has_access(instrument.index(sensor), times)
        if seen.any():
            frames_of[sensor] = [number for number, ok in zip(numbers, seen, strict=True) if ok]
    if not frames_of:
        raise InputError(
            "no sensor has access to a target in any of them; `warpsim access` lists when, `warpsim check` says why "
            "not, --every-frame renders all the same",
            "frames",
        )
    kinds = [scenario.instrument_of(sensor).sensor for sensor in frames_of]
    own = ("artifacts",) if any(has_artifacts(kind.detector) for kind in kinds) else ()
    tables = ("truth", *(("stars",) if stars else ()), *own)
    without = () if sensors is None else tuple(sensor for sensor in bands_of if sensor not in frames_of)
    bands_of = {sensor: bands_of[sensor] for sensor in frames_of}
    identity = {
        "scene": scenario.scene.to_dict(),
        "frames": frames_of,
        "bands_of": bands_of,
        "formats": list(chosen),
        "tables": list(tables),
        "inputs": input_checksums(scenario),
        "catalogs": {name: renderer.catalog_of(name).checksum for name in dict.fromkeys(kind.name for kind in kinds)},
        "processor": "cuda" if renderer.device.is_cuda else "cpu",
        "warpsim": __version__,
    }
    return RunPlan(scenario, bands_of, frames_of, identity, tables, chosen, without)


def _bands_of(
    scenario: Scenario, sensors: str | Sequence[str] | None, bands: Sequence[str] | None
) -> dict[str, list[str]]:
    """Return the bands of each sensor that is asked for: those of its kind that are asked for.

    Raises:
        InputError: An unknown name, or a sensor that is asked for has none of the bands.
    """
    asked = None if bands is None else list(dict.fromkeys(chosen_names("bands", bands, list(scenario.bands))))
    found = {}
    for sensor in dict.fromkeys(scenario.select_sensors(sensors)):
        known = scenario.instrument_of(sensor).sensor.bands
        found[sensor] = list(known) if asked is None else [band for band in asked if band in known]
        if not found[sensor] and sensors is not None:
            raise InputError(f"{sensor} has none of them, but {', '.join(known)}", "bands", ", ".join(asked or ()))
    return {sensor: some for sensor, some in found.items() if some}


def _frame_numbers(renderer: Renderer, instrument: Instrument, frames: Sequence[int] | slice | None) -> list[int]:
    """Return the frame numbers of a kind of sensor, each once: a slice is one of all its frames."""
    every = range(instrument.frames.count)
    requested = every if frames is None else every[frames] if isinstance(frames, slice) else frames
    numbers = checked_frames(requested, instrument, renderer.scene.duration_s)
    if not numbers:
        raise InputError(f"must name at least one; the scene has 0 to {instrument.frames.count - 1}", "frames")
    # Frames of a cube and files of a run are written once each, however often they are named.
    return list(dict.fromkeys(numbers))
