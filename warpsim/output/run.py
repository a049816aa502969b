"""Render a scene into a folder, resumable after an interruption at any moment.

Running the same command again renders sensors without a valid checkpoint record (see run_folder.py). `manifest.json`
comes last.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.detectors import detector_terms
from warpsim.files import prepare_folder, sha256_of, whole_file, write_fits_table, write_json
from warpsim.output.check import pointing_warning
from warpsim.output.checkpoints import tidy
from warpsim.output.contact_sheet import SheetRow, draw_contact_sheet
from warpsim.output.manifest import made_with, response_facts
from warpsim.output.plan import USUAL_FORMATS, RunPlan, make_plan
from warpsim.output.progress import progress_bar
from warpsim.output.run_folder import has_checkpoint, is_complete, working_on, write_checkpoint
from warpsim.render.renderer import Renderer
from warpsim.scene.inputs import input_checksums
from warpsim.scene.instrument import Instrument
from warpsim.scene.roster import some_names
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene

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
    """What had to be replaced in the cameras' axes."""
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
        progress: Draw a progress bar on standard error.
        stars: Also write `stars.fits`, the stars of every image.
        every_frame: Also render frames without access.
        formats: How images are stored, one or several: "fits" (a cube for each sensor and band), "tiff", "png" (a
            16-bit file for each image), "exr" (the same of the noiseless signal [W/cm2], float32), "zarr" (an array
            for each sensor and band; the extra `zarr`).
        preview: Also an animation for each sensor and band: "gif", or "mp4" with the extra `video`.

    Returns:
        What was done.

    Raises:
        InputError: A bad name or number, a missing package, no access at all, a folder that cannot be written, is in
            use, or holds another run or files of these names that are not of warpsim.
        OSError: Writing failed on the way (a full disk).
    """
    begin = time.perf_counter()
    renderer = Renderer(scene, device)
    plan = make_plan(renderer, Path(folder), frames, sensors, bands, stars, every_frame, formats, preview)
    n_done, render_s = 0, 0.0
    if is_complete(plan):
        tidy(plan.folder, plan.parts, lambda: is_complete(plan))
    else:
        prepare_folder(plan.folder)
        try:
            with working_on(plan, overwrite):
                n_done, render_s = _render_missing(plan, renderer, progress)
                _finish(plan, renderer)
        except OSError as error:
            raise OSError(f"{plan.folder}: writing failed, the same command goes on from here: {error}") from error
    total_s = time.perf_counter() - begin
    warning = pointing_warning(renderer.scenario, plan.frames_of)
    return RunReport(
        plan.folder,
        len(plan.frames_of),
        plan.n_image,
        n_done,
        render_s,
        total_s,
        plan.bands,
        warning,
        plan.without_access,
    )


def _render_missing(plan: RunPlan, renderer: Renderer, progress: bool) -> tuple[int, float]:
    """Render the sensors without a checkpoint record; number of images and seconds spent rendering."""
    missing = [sensor for sensor in plan.frames_of if not has_checkpoint(plan, sensor)]
    firsts = {plan.scenario.instrument_of(sensor).sensor.name: sensor for sensor in reversed(missing)}
    for sensor in firsts.values():
        # A first frame, thrown away, compiles the kernels: the speed reported at the end is that of rendering.
        renderer.render(plan.frames_of[sensor][:1], [sensor], plan.bands_of[sensor])
    render_s = 0.0
    n_frame = {sensor: len(numbers) for sensor, numbers in plan.frames_of.items()}
    with progress_bar(sum(n_frame.values()), progress) as advance:
        advance(sum(n for sensor, n in n_frame.items() if sensor not in missing))
        for sensor in missing:
            render_s += _render_sensor(plan, renderer, sensor, advance)
    return sum(n_frame[sensor] * len(plan.bands_of[sensor]) for sensor in missing), render_s


def _render_sensor(plan: RunPlan, renderer: Renderer, sensor: str, advance: Any) -> float:
    """Render all frames of a sensor, write its images and tables, then the checkpoint; seconds spent rendering."""
    from astropy.table import vstack

    numbers, bands = plan.frames_of[sensor], plan.bands_of[sensor]
    camera = plan.scenario.instrument_of(sensor).sensor.camera
    bytes_per_pixel = 6 if plan.needs_signal else 2
    bytes_per_frame = bytes_per_pixel * len(bands) * camera.n_row * camera.n_col
    batch = max(1, COUNTS_BYTES_PER_CALL // bytes_per_frame)
    render_s = 0.0
    with_stars = "stars" in plan.tables
    batches: list[list[Table]] = []
    with contextlib.ExitStack() as files:
        table_files = [files.enter_context(whole_file(path)) for path in plan.part_paths(sensor)]
        writers = [
            (files.enter_context(form.writer(plan.folder, plan.images(sensor, band))), index)
            for form in plan.formats.values()
            for index, band in enumerate(bands)
        ]
        for first in range(0, len(numbers), batch):
            begin = time.perf_counter()
            requested = numbers[first : first + batch]
            frames = renderer.render(requested, [sensor], bands, plan.needs_signal, with_stars)
            render_s += time.perf_counter() - begin
            for add, band_index in writers:
                add(frames, 0, band_index)
            batches.append([frames.truth, frames.stars] if with_stars else [frames.truth])
            advance(len(frames.frames))
        for tables, partial in zip(zip(*batches, strict=True), table_files, strict=True):
            write_fits_table(vstack(list(tables), metadata_conflicts="silent"), partial)
    write_checkpoint(plan, sensor)
    return render_s


def _finish(plan: RunPlan, renderer: Renderer) -> None:
    """Tables of all sensors, contact sheet, manifest."""
    from astropy.table import Table, vstack

    parts = zip(*(plan.part_paths(sensor) for sensor in plan.frames_of), strict=True)
    joined = [vstack([Table.read(path) for path in paths], metadata_conflicts="silent") for paths in parts]
    for name, table in zip(plan.tables, joined, strict=True):
        with whole_file(plan.table_path(name)) as partial:
            write_fits_table(table, partial)

    def planes(sensor: str, frames: list[int]) -> npt.NDArray[np.uint16]:
        images = plan.images(sensor, shown[plan.scenario.instrument_of(sensor).sensor.name])
        read = (form.counts(plan.folder, images, frames) for form in plan.formats.values())
        return next(counts for counts in read if counts is not None)

    shown = {kind: _best_band(plan, instrument, joined[0]) for kind, instrument in plan.instruments.items()}
    kinds = {sensor: plan.scenario.instrument_of(sensor) for sensor in plan.frames_of}
    rows = [SheetRow(sensor, kind, shown[kind.sensor.name], plan.frames_of[sensor]) for sensor, kind in kinds.items()]
    draw_contact_sheet(plan.scenario.scene, rows, planes, plan.sheet_path)
    write_json(_manifest(plan, renderer), plan.manifest_path)


def _best_band(plan: RunPlan, instrument: Instrument, truth: Table) -> str:
    """The band of a kind of sensor in which the targets stand out most."""
    own = np.isin(np.asarray(truth["sensor"]).astype(str), instrument.names)
    names, snr = np.asarray(truth["band"]).astype(str)[own], np.asarray(truth["snr"])[own]
    bands = next(plan.bands_of[sensor] for sensor in plan.frames_of if sensor in instrument.names)
    return max(bands, key=lambda band: np.max(snr[names == band], initial=0.0))


def _manifest(plan: RunPlan, renderer: Renderer) -> dict[str, Any]:
    """Manifest: files, inputs and versions."""
    scenario = plan.scenario
    tracks = scenario.tracks
    return {
        "key": plan.key,
        **made_with(),
        "device": {"name": renderer.device.name, "alias": str(renderer.device)},
        "seed": scenario.scene.seed,
        "bands": plan.bands,
        "responses": {name: response_facts(scenario.bands[name]) for name in plan.bands},
        "frames": plan.frames_of,
        "orbit_interpolation": {"node_step_s": tracks.step_s, "measured_error_m": tracks.error_m},
        "sensors": {kind: _sensor_facts(plan, renderer, one) for kind, one in plan.instruments.items()},
        "scene": scenario.scene.to_dict(),
        "inputs": input_checksums(scenario),
        "files": {name: sha256_of(plan.folder / name) for name in plan.names if name != plan.manifest_path.name},
    }


def _sensor_facts(plan: RunPlan, renderer: Renderer, instrument: Instrument) -> dict[str, Any]:
    """Facts of a kind of sensor for the manifest: light, noise, and quadrature over the exposure."""
    bands = next(plan.bands_of[sensor] for sensor in plan.frames_of if sensor in instrument.names)
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
