"""The main job: render a scene into a folder, so that it can be killed at any moment and resumed.

The unit of work is a sensor. When its files are complete they get their final names, and then a receipt with their
checksums is written. Running the same command again renders what has no valid receipt. `manifest.json` comes last.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.output.contact_sheet import draw_contact_sheet
from warpsim.output.files import prepare_folder, read_json, sha256_of, whole_file, write_json
from warpsim.output.fits_cube import CubeWriter, read_cube
from warpsim.render.renderer import Renderer
from warpsim.scene.scene import Scene

if TYPE_CHECKING:
    from astropy.table import Table

COUNTS_BYTES_PER_CALL = 64 * 2**20
"""Counts held in memory at a time."""

_PARTS = ".warpsim-parts"
_MANIFEST = "manifest.json"


@dataclass(frozen=True)
class RunReport:
    """What a run did."""

    folder: Path
    n_sensor: int
    n_image: int
    n_image_rendered: int
    """Less than n_image when an earlier run had done some."""
    render_s: float
    """Time spent rendering, without files and without compiling kernels."""
    total_s: float
    bands: list[str]

    def text(self) -> str:
        """One or two lines for a person."""
        line = (
            f"{self.n_image} images ({self.n_sensor} sensors, bands {' '.join(self.bands)}) in {self.folder}"
            f" after {self.total_s:.1f} s"
        )
        if self.n_image_rendered == 0:
            return f"{line}; all were there already"
        speed = self.n_image_rendered / max(self.render_s, 1e-9)
        kept = self.n_image - self.n_image_rendered
        return f"{line}; rendered at {speed:,.0f} frames per second" + (f", {kept} kept from before" if kept else "")


@dataclass(frozen=True)
class _Plan:
    """What a run will write."""

    scene: Scene
    folder: Path
    bands: list[str]
    frames_of: dict[str, list[int]]
    key: str
    """Hash of all that the files depend on."""

    def cube_path(self, sensor: str, band: str) -> Path:
        return self.folder / f"{sensor}_{band}.fits"

    def receipt_path(self, sensor: str) -> Path:
        return self.folder / _PARTS / f"{sensor}.json"

    def truth_path(self, sensor: str) -> Path:
        return self.folder / _PARTS / f"{sensor}_truth.fits"


def render_to_folder(
    scene: Scene,
    folder: str | Path,
    frames: Sequence[int] | None = None,
    sensors: Sequence[str] | None = None,
    bands: Sequence[str] | None = None,
    device: Any = None,
    overwrite: bool = False,
    progress: bool = False,
) -> RunReport:
    """Render a scene into a folder: FITS cubes, truth table, contact sheet, manifest.

    Each sensor is rendered in the frames in which it has access to the main target; sensors without any are left out.

    Args:
        scene: The scene.
        folder: Where to write; made when missing.
        frames: Frame numbers; all of the scene when left out.
        sensors: Sensor names; all of the scene when left out.
        bands: Band names; all of the scene when left out.
        device: Warp device.
        overwrite: Replace a different run that the folder holds.
        progress: Draw a progress bar on standard error.

    Returns:
        What was done.

    Raises:
        InputError: A bad name or number, no access at all, a folder that cannot be written or holds another run.
    """
    begin = time.perf_counter()
    target = Path(folder)
    renderer = Renderer(scene, device)
    plan = _plan(renderer, target, frames, sensors, bands)
    prepare_folder(target)
    manifest = read_json(target / _MANIFEST)
    if _is_complete(plan, manifest):
        n_image = sum(len(numbers) for numbers in plan.frames_of.values()) * len(plan.bands)
        return RunReport(
            target, len(plan.frames_of), n_image, 0, 0.0, time.perf_counter() - begin, plan.bands
        )
    _clear_other_run(plan, manifest, overwrite)
    (target / _PARTS).mkdir(exist_ok=True)
    planned = {plan.cube_path(sensor, band).name: None for sensor in plan.frames_of for band in plan.bands}
    write_json({"key": plan.key, "files": planned}, target / _PARTS / "run.json")

    # A first frame, thrown away, compiles the kernels: the speed told at the end is that of rendering.
    sensor, numbers = next(iter(plan.frames_of.items()))
    renderer.render(numbers[:1], sensors=[sensor], bands=plan.bands)

    n_image, n_done, render_s = 0, 0, 0.0
    with _progress_bar(plan, progress) as advance:
        for sensor, numbers in plan.frames_of.items():
            n_image += len(numbers) * len(plan.bands)
            if not _has_receipt(plan, sensor):
                render_s += _render_sensor(plan, renderer, sensor, advance)
                n_done += len(numbers) * len(plan.bands)
            else:
                advance(len(numbers))
    _finish(plan, renderer)
    return RunReport(
        target, len(plan.frames_of), n_image, n_done, render_s, time.perf_counter() - begin, plan.bands
    )


def _plan(
    renderer: Renderer,
    folder: Path,
    frames: Sequence[int] | None,
    sensors: Sequence[str] | None,
    bands: Sequence[str] | None,
) -> _Plan:
    import warpsim

    scene = renderer.scene
    numbers = renderer.checked_frames(range(scene.frames.count) if frames is None else frames)
    if not numbers:
        raise InputError("frames: must name at least one")
    sensor_list = renderer.checked_names("sensors", sensors, scene.sensor_names)
    band_list = renderer.checked_names("bands", bands, list(scene.bands))
    times = scene.frame_time_s(numbers)
    frames_of = {}
    for sensor in sensor_list:
        seen = scene.has_access(sensor, times)
        if seen.any():
            frames_of[sensor] = [number for number, ok in zip(numbers, seen, strict=True) if ok]
    if not frames_of:
        raise InputError(
            "frames: no sensor has access to the main target in any of them; `warpsim access` lists when, "
            "`warpsim check` says why not"
        )
    device = "cuda" if renderer.device.is_cuda else "cpu"
    facts = [scene.to_dict(), frames_of, band_list, device, warpsim.__version__]
    key = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    return _Plan(scene, folder, band_list, frames_of, key)


def _is_complete(plan: _Plan, manifest: Any) -> bool:
    if not isinstance(manifest, dict) or manifest.get("key") != plan.key:
        return False
    return _files_match(plan.folder, manifest.get("files", {}))


def _files_match(folder: Path, checksums: dict[str, str]) -> bool:
    paths = {folder / name: checksum for name, checksum in checksums.items()}
    return all(path.is_file() and sha256_of(path) == checksum for path, checksum in paths.items())


def _has_receipt(plan: _Plan, sensor: str) -> bool:
    receipt = read_json(plan.receipt_path(sensor))
    return isinstance(receipt, dict) and receipt.get("key") == plan.key and _files_match(plan.folder, receipt["files"])


def _clear_other_run(plan: _Plan, manifest: Any, overwrite: bool) -> None:
    """Remove what another run left, if that is wanted; an unfinished run of the same kind stays."""
    receipts = [read_json(path) for path in (plan.folder / _PARTS).glob("*.json")]
    keys = {item.get("key") for item in [manifest, *receipts] if isinstance(item, dict)}
    if keys <= {plan.key}:
        return
    if not overwrite:
        raise InputError(
            f"{plan.folder}: holds a different run (other scene, frames, bands, device or version); "
            "choose another folder or pass --overwrite"
        )
    for item in [manifest, *receipts]:
        for name in item.get("files", {}) if isinstance(item, dict) else ():
            (plan.folder / name).unlink(missing_ok=True)
    (plan.folder / _MANIFEST).unlink(missing_ok=True)
    shutil.rmtree(plan.folder / _PARTS, ignore_errors=True)


def _render_sensor(plan: _Plan, renderer: Renderer, sensor: str, advance: Any) -> float:
    """Render all frames of a sensor, write its cubes and truth, then the receipt; seconds spent rendering."""
    from astropy.table import vstack

    scene, numbers = plan.scene, plan.frames_of[sensor]
    bytes_per_frame = 2 * len(plan.bands) * scene.camera.n_row * scene.camera.n_col
    batch = max(1, COUNTS_BYTES_PER_CALL // bytes_per_frame)
    render_s = 0.0
    truth: list[Table] = []
    paths = [plan.cube_path(sensor, band) for band in plan.bands]
    with contextlib.ExitStack() as files:
        partials = [files.enter_context(whole_file(path)) for path in [*paths, plan.truth_path(sensor)]]
        writers = [
            CubeWriter(partial, scene, sensor, band, len(numbers))
            for partial, band in zip(partials, plan.bands, strict=False)
        ]
        for writer in writers:
            files.callback(writer.abandon)
        for first in range(0, len(numbers), batch):
            begin = time.perf_counter()
            frames = renderer.render(numbers[first : first + batch], sensors=[sensor], bands=plan.bands)
            render_s += time.perf_counter() - begin
            for band, writer in enumerate(writers):
                writer.add(frames, 0, band)
            truth.append(frames.truth)
            advance(len(frames.frames))
        for writer in writers:
            writer.close()
        vstack(truth, metadata_conflicts="silent").write(partials[-1], format="fits", overwrite=True)
    written = [*paths, plan.truth_path(sensor)]
    checksums = {str(path.relative_to(plan.folder)): sha256_of(path) for path in written}
    write_json({"key": plan.key, "files": checksums}, plan.receipt_path(sensor))
    return render_s


def _finish(plan: _Plan, renderer: Renderer) -> None:
    """Truth of all sensors, contact sheet, manifest; then the receipts are no longer needed."""
    from astropy.table import Table, vstack

    truth_path, sheet_path = plan.folder / "truth.fits", plan.folder / "contact_sheet.png"
    parts = [Table.read(plan.truth_path(sensor)) for sensor in plan.frames_of]
    with whole_file(truth_path) as partial:
        vstack(parts, metadata_conflicts="silent").write(partial, format="fits", overwrite=True)

    def planes(sensor: str, frames: list[int]) -> npt.NDArray[np.uint16]:
        cube = read_cube(plan.cube_path(sensor, plan.bands[0]))
        rows = [int(np.flatnonzero(cube.frames["FRAME"] == frame)[0]) for frame in frames]
        return cube.counts[rows]

    with whole_file(sheet_path) as partial:
        draw_contact_sheet(plan.scene, plan.bands[0], plan.frames_of, planes, partial)
    cubes = [plan.cube_path(sensor, band) for sensor in plan.frames_of for band in plan.bands]
    write_json(_manifest(plan, renderer, [*cubes, truth_path, sheet_path]), plan.folder / _MANIFEST)
    shutil.rmtree(plan.folder / _PARTS, ignore_errors=True)


def _manifest(plan: _Plan, renderer: Renderer, files: list[Path]) -> dict[str, Any]:
    """What was made, from what, with what."""
    from importlib.metadata import PackageNotFoundError, version

    import warpsim

    def installed(package: str) -> str | None:
        try:
            return version(package)
        except PackageNotFoundError:
            return None

    packages = ("numpy", "warp-lang", "astropy", "skyfield", "OpenImageIO", "pydantic")
    tracks = plan.scene.tracks
    return {
        "key": plan.key,
        "warpsim": warpsim.__version__,
        "packages": {name: installed(name) for name in packages},
        "python": sys.version.split()[0],
        "device": {"name": renderer.device.name, "alias": str(renderer.device)},
        "seed": plan.scene.seed,
        "bands": plan.bands,
        "frames": plan.frames_of,
        "orbit_interpolation": {"node_step_s": tracks.step_s, "measured_error_m": tracks.error_m},
        "scene": plan.scene.to_dict(),
        "files": {path.name: sha256_of(path) for path in files},
    }


@contextlib.contextmanager
def _progress_bar(plan: _Plan, wanted: bool) -> Any:
    """A function that advances the bar by so many frames (doing nothing when no bar is wanted)."""
    total = sum(len(numbers) for numbers in plan.frames_of.values())
    if not wanted:
        yield lambda n: None
        return
    from astropy.utils.console import ProgressBar

    with ProgressBar(total, file=sys.stderr) as bar:
        done = 0

        def advance(n: int) -> None:
            nonlocal done
            done += n
            bar.update(done)

        yield advance
