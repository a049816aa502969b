"""Calibration of a scene's sensors as files: bias, dark and flat frames, and the maps that they are taken to find."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from warpsim.arguments import chosen_names, whole_number
from warpsim.detector.detectors import ElectronDetector
from warpsim.detector.pixel_maps import read_maps
from warpsim.errors import InputError
from warpsim.files import check_new_file, prepare_folder, whole_file
from warpsim.output.plan import maps_name
from warpsim.render.calibration_frames import calibration_counts, detector_maps
from warpsim.render.device import default_device
from warpsim.scene.provenance import provenance
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

KINDS = ("bias", "dark", "flat")

MOST_FRAMES = 10_000
"""Of a kind: they are in memory at once."""


def calibrate(
    scene: Scene | Scenario,
    folder: str | PathLike[str],
    *,
    sensors: str | Sequence[str] | None = None,
    bands: str | Sequence[str] | None = None,
    n_frame: int = 16,
    flat_level: float = 0.5,
    device: Any = "cpu",
    overwrite: bool = False,
) -> list[Path]:
    """Write bias, dark and flat frames of sensors, and their maps as truth.

    SENSOR_BAND_bias.fits, _dark and _flat hold counts, (n_frame, n_row, n_col); SENSOR.maps.fits the extensions
    GAIN_BAND, OFFSET_BAND (with BUNIT) and BAD_BAND (1 dead, 2 hot), and FLICKER_BAND where pixels flicker. Their noise
    is that of no frame of the scene, their maps are those of all. A detector in NEI terms has no bias frames: it knows
    no dark current apart.

    Args:
        scene: The scene.
        folder: Folder to write to; made where it is missing, once all else is checked.
        sensors: Names of sensors; all when left out.
        bands: Names of bands; all of each sensor when left out.
        n_frame: Frames of each kind, up to 10,000.
        flat_level: Even light of flat frames, as a fraction of what saturates a pixel, above 0 to 1.
        device: Warp device on which frames are made.
        overwrite: Replace files that are there.

    Returns:
        The files written.

    Raises:
        InputError: Unknown names, no such device, a number out of range, a maps_file that cannot be read, a file that
            is there already, or a folder that cannot be written.
    """
    scenario = scenario_of(scene)
    count = whole_number("n_frame", n_frame, 1)
    if count > MOST_FRAMES:
        raise InputError(f"must be at most {MOST_FRAMES:,}", "n_frame", n_frame)
    if isinstance(flat_level, bool) or not isinstance(flat_level, int | float) or not 0.0 < flat_level <= 1.0:
        raise InputError("must be above 0, and at most 1", "flat_level", flat_level)
    device = default_device(device)
    names = scenario.sensor_names if sensors is None else scenario.select_sensors(sensors)
    home, plan = Path(folder), []
    for sensor in names:
        instrument = scenario.instrument_of(sensor)
        chosen = chosen_names("bands", bands, list(instrument.sensor.bands))
        kinds = KINDS if isinstance(instrument.sensor.detector, ElectronDetector) else KINDS[1:]
        plan.append(
            (sensor, chosen, [(home / f"{sensor}_{band}_{kind}.fits", band, kind) for kind in kinds for band in chosen])
        )
    maps_of = {sensor: home / maps_name(sensor) for sensor, *_ in plan}
    if home.is_dir():
        for path in (*maps_of.values(), *(path for *_, files in plan for path, *_ in files)):
            check_new_file(path, (".fits",), overwrite)
    for sensor, chosen, _ in plan:
        _check_own_maps(scenario, sensor, chosen)
    prepare_folder(home)
    written = []
    for sensor, chosen, files in plan:
        write_maps(maps_of[sensor], scenario, sensor, chosen, device)
        written.append(maps_of[sensor])
        for path, band, kind in files:
            counts = calibration_counts(scenario, sensor, [band], kind, count, flat_level, device)
            _write_frames(path, scenario, sensor, band, kind, counts[:, 0], flat_level)
            written.append(path)
    return written


def _check_own_maps(scenario: Scenario, sensor: str, bands: Sequence[str]) -> None:
    own = scenario.instrument_of(sensor).sensor
    if own.detector.maps_file is not None:
        read_maps(own.detector.maps_file, [sensor], bands, list(own.bands), (own.camera.n_row, own.camera.n_col))


def _cards(scenario: Scenario, sensor: str) -> dict[str, Any]:
    exposure_s = scenario.instrument_of(sensor).sensor.detector.exposure_s
    return {"SENSOR": sensor, "EXPTIME": (exposure_s, "[s]"), **provenance(scenario.scene)}


def _write_frames(
    path: Path, scenario: Scenario, sensor: str, band: str, kind: str, counts: Any, flat_level: float
) -> None:
    from astropy.io import fits

    hdu = fits.PrimaryHDU(counts)
    hdu.header.update(_cards(scenario, sensor) | {"BAND": band, "IMAGETYP": kind, "BUNIT": "count"})
    if kind == "flat":
        hdu.header["FLATFRAC"] = flat_level, "even light over what saturates a pixel"
    with whole_file(path) as partial:
        hdu.writeto(partial, overwrite=True)


def write_maps(path: Path, scenario: Scenario, sensor: str, bands: Sequence[str], device: Any = "cpu") -> None:
    """Write what stays with the pixels of a sensor from frame to frame, an extension for each map and band."""
    from astropy.io import fits

    maps = detector_maps(scenario, sensor, bands, device)
    electrons = isinstance(scenario.instrument_of(sensor).sensor.detector, ElectronDetector)
    hdus = fits.HDUList([fits.PrimaryHDU()])
    hdus[0].header.update(_cards(scenario, sensor))
    level = "electron" if electrons else "W/cm2"
    images: list[tuple[str, Any, str]] = [("GAIN", maps.gain, ""), ("OFFSET", maps.offset, level)]
    images += [("BAD", maps.bad, ""), *([] if maps.flicker is None else [("FLICKER", maps.flicker, level)])]
    for number, band in enumerate(bands):
        for name, values, unit in images:
            hdu = fits.ImageHDU(np.ascontiguousarray(values[number]), name=f"{name}_{band}")
            if unit:
                hdu.header["BUNIT"] = unit
            hdus.append(hdu)
    with whole_file(path) as partial:
        hdus.writeto(partial, overwrite=True)
