"""Render a scene into a folder, resumable after an interruption at any moment."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from platform import python_version
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import some_names
from warpsim.detector.detectors import detector_terms, has_maps
from warpsim.errors import InputError
from warpsim.files import sha256_of, whole_file, write_fits_table
from warpsim.output.calibration import write_maps
from warpsim.output.check_background import earth_warning
from warpsim.output.check_pointing import pointing_warning
from warpsim.output.checkpoints import files_match
from warpsim.output.contact_sheet import draw_contact_sheet
from warpsim.output.fits_header import Views
from warpsim.output.formats import Images
from warpsim.output.growing import GrowingFiles
from warpsim.output.output_folder import PARTS, CheckpointRecord, OutputFolder
from warpsim.output.plan import SHEET, USUAL_FORMATS, RunPlan, make_plan, maps_name, part_name
from warpsim.output.summary import joined_tables, left_out_rows, package_versions, response_facts
from warpsim.output.wording import progress_bar
from warpsim.render.frameset import FrameSet
from warpsim.render.renderer import Renderer
from warpsim.scene.instrument import Instrument
from warpsim.scene.provenance import provenance
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene
from warpsim.version import __version__

if TYPE_CHECKING:
    from astropy.table import Table

COUNTS_BYTES_PER_CALL = 64 * 2**20
"""Images held in memory at a time."""


@dataclass(frozen=True)
class RunReport:
    """Report of a run."""

    folder: Path
    n_sensor: int
    n_image: int
    n_image_rendered: int
    """Less than n_image when an earlier run had done some."""
    render_s: float
    """Time spent rendering, without files and without compiling kernels."""
    total_s: float
    bands: list[str]
    warning: str | None = None
    """What had to be replaced in the cameras' axes, and an Earth in the field that is not rendered."""
    without_access: tuple[str, ...] = ()
    """Sensors that were named, and have no access in these frames."""

    def text(self) -> str:
        """A few lines for a person."""
        text = self._summary() + (f"\nwarning: {self.warning}" if self.warning else "")
        if self.without_access:
            text += f"\nleft out, as they have no access in these frames: {some_names(self.without_access)}"
        return text

    def _summary(self) -> str:
        sensors = "1 sensor" if self.n_sensor == 1 else f"{self.n_sensor} sensors"
        images = "1 image" if self.n_image == 1 else f"{self.n_image} images"
        line = f"{images} ({sensors}, bands {' '.join(self.bands)}) in {self.folder} after {self.total_s:.1f} s"
        if self.n_image_rendered == 0:
            return f"{line}; all were there already"
        speed = self.n_image_rendered / max(self.render_s, 1e-9)
        kept = self.n_image - self.n_image_rendered
        line += f"; rendering took {self.render_s:.2f} s of it, {speed:,.0f} images per second"
        return line + (f", {kept} images kept from before" if kept else "")


def render_to_folder(
    scene: Scene | Scenario,
    folder: str | Path,
    frames: Sequence[int] | slice | None = None,
    sensors: str | Sequence[str] | None = None,
    bands: Sequence[str] | None = None,
    device: Any = None,
    overwrite: bool = False,
    progress: bool = False,
    stars: bool = False,
    every_frame: bool = False,
    formats: Sequence[str] = USUAL_FORMATS,
    preview: str | None = None,
    sheet: str = "whole",
) -> RunReport:
    """Render a scene into a folder: images (FITS cubes, usually), truth table, contact sheet, manifest.

    Each sensor is rendered in the frames in which it has access to what it tracks; sensors without any are left out.
    With every_frame access plays no part: cameras that stare or scan see stars before a target comes.

    Args:
        scene: The scene, or its scenario.
        folder: Where to write; made when missing.
        frames: Frame numbers, or a slice of those that each sensor takes; all of them when left out.
        sensors: Names of sensors or of kinds; all of the scene when left out.
        bands: Band names; all of each sensor when left out. Sensors that have none of them are left out.
        device: Warp device.
        overwrite: Replace a different run that the folder holds.
        progress: Draw a progress bar on standard error; where that is no terminal, print a line each 30 s.
        stars: Also write `stars.fits`, the stars of every image.
        every_frame: Also render frames without access.
        formats: How images are stored, one or several: "fits" (a cube for each sensor and band), "fits-frames" (an
            extension for each frame), "tiff", "png" (a 16-bit file for each image), "exr" (the same of the noiseless
            signal [W/cm2], float32), "zarr" (an array for each sensor and band; the extra `zarr`).
        preview: Also an animation for each sensor and band: "gif", or "mp4" with the extra `video`.
        sheet: What the contact sheet shows of an image: "whole", or "targets", the part about them, with marks.

    Returns:
        What was done.

    Raises:
        InputError: A bad name or number, a missing package, no access at all, a folder that cannot be written, is in
            use, or holds another run or files of these names that are not of warpsim.
        OSError: Writing failed on the way (a full disk).
    """
    begin = time.perf_counter()
    renderer = Renderer(scene, device)
    if sheet not in ("whole", "targets"):
        raise InputError("must be whole or targets", "sheet", sheet)
    plan = make_plan(renderer, frames, sensors, bands, stars, every_frame, formats, preview)
    output = OutputFolder(Path(folder), plan.identity)
    run = Run(plan, renderer, progress, sheet)
    output.write(run, overwrite)
    kinds = plan.scenario.instruments.values()
    warnings = pointing_warning(kinds, plan.frames_of), earth_warning(plan.scenario, plan.frames_of)
    return RunReport(
        output.path,
        len(plan.frames_of),
        plan.n_image,
        run.n_image_rendered,
        run.render_s,
        time.perf_counter() - begin,
        plan.bands,
        "; ".join(filter(None, warnings)) or None,
        plan.without_access,
    )


@dataclass
class Run:
    """The work of a run; a shard is a sensor."""

    plan: RunPlan
    renderer: Renderer
    progress: bool
    sheet: str = "whole"
    n_image_rendered: int = 0
    render_s: float = 0.0
    """Time spent rendering."""

    @property
    def claimed_names(self) -> list[str]:
        """All files, and the folders of arrays."""
        return self.plan.claimed_names

    def records_of(self, folder: OutputFolder, manifest: dict[str, Any]) -> dict[str, CheckpointRecord]:
        """Return the records of sensors of a finished run, whose rows are taken out of its tables again."""
        from astropy.table import Table

        checksums = manifest["files"]
        if not files_match(folder.path, {name: checksums.get(name, "") for name in self.plan.table_names}):
            return {}
        tables = {name: Table.read(folder.path / f"{name}.fits") for name in self.plan.tables}
        records = {}
        for sensor in self.plan.frames_of:
            files = {name: checksums.get(name, "") for name in self.plan.image_names(sensor)}
            for name, table in tables.items():
                part = part_name(sensor, name, 0)
                (folder.path / part).parent.mkdir(parents=True, exist_ok=True)
                own = table[np.asarray(table["sensor"]).astype(str) == sensor]
                write_fits_table(own, folder.path / part)
                files[part] = sha256_of(folder.path / part)
            records[sensor] = {"key": folder.key, "shard": sensor, "files": files}
        return records

    def write_missing(self, folder: OutputFolder, records: dict[str, CheckpointRecord]) -> None:
        """Render the sensors without a record."""
        plan = self.plan
        missing = [sensor for sensor in plan.frames_of if sensor not in records]
        firsts = {plan.scenario.instrument_of(sensor).sensor.name: sensor for sensor in reversed(missing)}
        for sensor in firsts.values():
            # A first frame, thrown away, compiles the kernels: the speed reported at the end is that of rendering.
            self.renderer.render(plan.frames_of[sensor][:1], [sensor], plan.bands_of[sensor])
        with progress_bar(sum(map(len, plan.frames_of.values())), self.progress, "frames") as advance:
            advance(sum(len(plan.frames_of[sensor]) for sensor in records))
            for sensor in missing:
                with folder.naming_full_disk():
                    records[sensor] = self._write_sensor(folder, sensor, advance)

    def _write_sensor(self, folder: OutputFolder, sensor: str, advance: Callable[[int], None]) -> CheckpointRecord:
        """Render a sensor from the frame on where an earlier run ended; write its images and tables."""
        plan, images = self.plan, self.plan.images_of(sensor)
        numbers = plan.frames_of[sensor]
        growing = GrowingFiles(folder.growing_path(sensor))
        n_done = sum(len(views["frames"]) for views in growing.steps)
        advance(n_done)
        batch = self._n_together(images)
        for first in range(n_done, len(numbers), batch):
            frames = self._render(sensor, numbers[first : first + batch])
            views = Views.of(frames, sensor)
            for number, of_band in enumerate(images):
                planes = {"counts": frames.counts.numpy()[:, 0, number]}
                if frames.signal_w_cm2 is not None:
                    planes["signal_w_cm2"] = frames.signal_w_cm2.numpy()[:, 0, number]
                for form in plan.formats.values():
                    form.append(growing.path, of_band, views, {form.plane: planes[form.plane]})
            for table in plan.tables:
                path = growing.path / part_name(sensor, table, first)
                path.parent.mkdir(parents=True, exist_ok=True)
                write_fits_table(getattr(frames, table), path)
            growing.end_step(views.plain)
            advance(len(frames.frames))
        views = Views.joined(images[0].instrument, sensor, growing.steps)
        for form in plan.formats.values():
            form.finish(growing.path, images, views)
        if has_maps(images[0].instrument.sensor.detector):
            write_maps(growing.path / maps_name(sensor), plan.scenario, sensor, plan.bands_of[sensor])
        parts = sorted(path.relative_to(growing.path).as_posix() for path in growing.path.rglob("*.fits"))
        tables = [name for name in parts if name.startswith(PARTS)]  # first: images that are there have their truth
        record = folder.move_in(sensor, growing.path, [*tables, *plan.image_names(sensor)])
        growing.remove()
        return record

    def _n_together(self, images: list[Images]) -> int:
        """Return the number of frames of a render call: what memory is for, in whole shards of arrays."""
        _, n_row, n_col = images[0].shape
        bytes_per_frame = (6 if self.plan.needs_signal else 2) * len(images) * n_row * n_col
        least = max(form.n_together(images[0]) for form in self.plan.formats.values())
        return max(least, COUNTS_BYTES_PER_CALL // bytes_per_frame // least * least)

    def _render(self, sensor: str, numbers: list[int]) -> FrameSet:
        begin = time.perf_counter()
        bands = self.plan.bands_of[sensor]
        frames = self.renderer.render(numbers, [sensor], bands, self.plan.needs_signal, "stars" in self.plan.tables)
        self.render_s += time.perf_counter() - begin
        self.n_image_rendered += len(numbers) * len(bands)
        return frames

    def finish(self, folder: OutputFolder, records: dict[str, CheckpointRecord]) -> dict[str, Any]:
        """Write the tables of all sensors and the contact sheet."""
        from astropy.table import Table

        plan = self.plan
        names = [*plan.table_names, SHEET]
        folder.plan_finish(dict.fromkeys(names))
        joined = {}
        for table in plan.tables:
            home = part_name("", table, 0).rpartition("/")[0]
            names_of = (sorted(records[sensor]["files"]) for sensor in plan.frames_of)
            parts = [name for names_of_sensor in names_of for name in names_of_sensor if name.startswith(f"{home}/")]
            joined[table] = joined_tables([Table.read(folder.path / name) for name in parts])
            with whole_file(folder.path / f"{table}.fits") as partial:
                write_fits_table(joined[table], partial)
        self._draw_sheet(folder.path, joined["truth"])
        checksums = {name: sha for sensor in plan.frames_of for name, sha in records[sensor]["files"].items()}
        checksums = {name: sha for name, sha in checksums.items() if not name.startswith(PARTS)}
        return self._manifest(folder.key, checksums | {name: sha256_of(folder.path / name) for name in names})

    def _draw_sheet(self, folder: Path, truth: Table) -> None:
        plan = self.plan
        best = {kind: _best_band(plan, instrument, truth) for kind, instrument in plan.instruments.items()}
        bands = {sensor: best[plan.scenario.instrument_of(sensor).sensor.name] for sensor in plan.frames_of}
        rows = [Images(plan.scenario, sensor, band, plan.frames_of[sensor]) for sensor, band in bands.items()]

        def planes(row: Images, frames: list[int]) -> npt.NDArray[np.uint16]:
            read = (form.counts(folder, row, frames) for form in plan.formats.values())
            return next(counts for counts in read if counts is not None)

        def positions_px(row: Images, frames: list[int]) -> list[npt.NDArray[np.float64]]:
            lit = np.ma.filled(truth["irradiance_w_cm2"], 0.0) > 0  # columns that not all kinds have are masked
            own = truth[(truth["sensor"] == row.sensor) & (truth["band"] == row.band) & lit]
            xy_px = np.stack([np.asarray(own[name], np.float64) for name in ("x_px", "y_px")], axis=1)
            there = np.isfinite(xy_px).all(axis=1)  # behind a camera there is no place
            return [xy_px[there & (np.asarray(own["frame"]) == frame)] for frame in frames]

        marks = positions_px if self.sheet == "targets" else None
        draw_contact_sheet(plan.scenario.scene, rows, planes, folder / SHEET, marks)

    def _manifest(self, key: str, checksums: dict[str, str]) -> dict[str, Any]:
        plan, device = self.plan, self.renderer.device
        tracks = plan.scenario.tracks
        return {
            "key": key,
            "warpsim": __version__,
            "packages": package_versions(),
            "python": python_version(),
            "device": {"name": device.name, "alias": str(device)},
            "provenance": provenance(plan.scenario.scene),
            "bands": plan.bands,
            "responses": {name: response_facts(plan.scenario.bands[name]) for name in plan.bands},
            "orbit_interpolation": {
                "node_step_s": tracks.step_s,
                "longest_node_step_s": tracks.longest_step_s,
                "measured_error_m": tracks.error_m,
            },
            "left_out": left_out_rows(plan.scenario),
            "sensors": {kind: _sensor_facts(plan, self.renderer, one) for kind, one in plan.instruments.items()},
            **plan.identity,
            "files": checksums,
        }


def _best_band(plan: RunPlan, instrument: Instrument, truth: Table) -> str:
    """The band of a kind of sensor in which the targets stand out most."""
    own = np.isin(np.asarray(truth["sensor"]).astype(str), instrument.names)
    names, snr = np.asarray(truth["band"]).astype(str)[own], np.asarray(truth["snr"])[own]
    return max(plan.bands_of_kind(instrument), key=lambda band: np.max(snr[names == band], initial=0.0))


def _sensor_facts(plan: RunPlan, renderer: Renderer, instrument: Instrument) -> dict[str, Any]:
    """Facts of a kind of sensor for the manifest: light, noise, and quadrature over the exposure."""
    bands = plan.bands_of_kind(instrument)
    facts: dict[str, Any] = {
        "bands": bands,
        "light_terms": {name: term.reason for name, term in instrument.light_terms.items()},
        "detector": {
            "terms": detector_terms(instrument.sensor.detector),
            "bands": {band: asdict(instrument.levels[band]) for band in bands},
        },
    }
    if instrument.sensor.streaks:
        streaks = renderer.streaks(instrument, bands)
        facts["movement"] = {"path_nodes": streaks.n_path, "measured_error_px": streaks.error_px}
    return facts
