"""Calibration: bias, dark and flat frames of sensors, and the maps that they are taken to find."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.detector_maps import detector_maps_kernel

from warpsim.detector.detectors import ElectronDetector
from warpsim.detector.pixel_maps import read_maps
from warpsim.errors import InputError
from warpsim.launches import to_numpy
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_signal
from warpsim.render.device_artifacts import band_ids, flickering_pixels, make_artifacts
from warpsim.render.read_out import make_read_out
from warpsim.render.stages import artifacts, read_out
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario

FIRST_FRAME = {"bias": 0x8000_0000, "dark": 0xA000_0000, "flat": 0xC000_0000}
"""Kinds of frames, and the number of their first: their noise is that of no frame of a scene."""

Counts = npt.NDArray[np.uint16]


@dataclass(frozen=True)
class DetectorMaps:
    """What stays with the pixels of a sensor from frame to frame, (n_band, n_row, n_col) each."""

    gain: npt.NDArray[np.float32]
    """About 1; of dead pixels, what it would be."""
    offset: npt.NDArray[np.float32]
    """Added to a pixel: of a detector in NEI terms irradiance [W/cm2], else electrons of the dark current [e]."""
    bad: npt.NDArray[np.uint8]
    """1 dead, 2 hot, 0 neither."""
    flicker: npt.NDArray[np.float32] | None = None
    """What flickering pixels have more while they are on, in the unit of offsets; None without any."""


def detector_maps(scenario: Scenario, sensor: str, bands: Sequence[str], device: Any = "cpu") -> DetectorMaps:
    """Return the maps of a sensor, as its read-out has them.

    Args:
        scenario: What the scene gives.
        sensor: Name of the sensor.
        bands: Names of bands.
        device: Where they are found.

    Raises:
        InputError: There is no such sensor or band.
    """
    instrument = _instrument(scenario, sensor, bands)
    camera, on = instrument.sensor.camera, wp.get_device(device)
    if (file := instrument.sensor.detector.maps_file) is not None:
        read = read_maps(file, [sensor], bands, list(instrument.sensor.bands), (camera.n_row, camera.n_col))
        mean = np.array([getattr(instrument.levels[band], "dark_e", 0.0) for band in bands], dtype=np.float32)
        offset = np.where(np.isnan(read.offset[0]), mean[:, None, None], read.offset[0])
        return DetectorMaps(read.gain[0], offset, read.bad[0], _flicker_map(instrument, sensor, bands))
    own = make_read_out(instrument, bands, on)
    shape = (len(bands), camera.n_row * camera.n_col)
    outputs = [wp.empty(shape, dtype=dtype, device=on) for dtype in (wp.float32, wp.float32, wp.uint8)]
    electrons = isinstance(instrument.sensor.detector, ElectronDetector)
    inputs = [own.detector, instrument.index(sensor), band_ids(instrument, bands, on), electrons]
    wp.launch(detector_maps_kernel, dim=shape, inputs=inputs, outputs=outputs, device=on)
    gain, offset, bad = (to_numpy(array).reshape(len(bands), camera.n_row, camera.n_col) for array in outputs)
    return DetectorMaps(gain, offset, bad, _flicker_map(instrument, sensor, bands))


def _flicker_map(instrument: Instrument, sensor: str, bands: Sequence[str]) -> npt.NDArray[np.float32] | None:
    camera = instrument.sensor.camera
    if instrument.sensor.detector.flicker is None:
        return None
    maps = np.zeros((len(bands), camera.n_row * camera.n_col), dtype=np.float32)
    for plane, band in zip(maps, bands, strict=True):
        pixel, level, _ = flickering_pixels(instrument, instrument.index(sensor), band)
        plane[pixel] = level * getattr(instrument.levels[band], "e_per_w_cm2", 1.0)
    return maps.reshape(len(bands), camera.n_row, camera.n_col)


def calibration_counts(
    scenario: Scenario,
    sensor: str,
    bands: Sequence[str],
    kind: str,
    n_frame: int,
    level: float = 0.5,
    device: Any = "cpu",
) -> Counts:
    """Return frames of a sensor behind a shutter, or under even light: (n_frame, n_band, n_row, n_col).

    A bias frame has neither light nor dark current, a dark frame has no light, and a flat frame has even light beside
    the dark current; radiation hits and flickering pixels are in dark and flat frames. What lies behind the stars, and
    the optics' own glow, are in none of them. A detector in NEI terms knows no dark current: its bias frames are dark
    frames.

    Args:
        scenario: What the scene gives.
        sensor: Name of the sensor.
        bands: Names of bands.
        kind: "bias", "dark" or "flat".
        n_frame: Frames.
        level: Even light of a flat frame, as a fraction of what saturates a pixel.
        device: Where they are made.

    Raises:
        InputError: There is no such sensor or band.
    """
    known = _instrument(scenario, sensor, bands)
    instrument = _shuttered(known, dark=kind != "bias")
    on, camera = wp.get_device(device), instrument.sensor.camera
    signal = new_signal((1, len(bands), camera.n_row, camera.n_col), on)
    reading = make_read_out(instrument, bands, on, dark=kind != "bias")
    scene: Any = SimpleNamespace(device=on, read_out=reading, band_id=band_ids(instrument, bands, on))
    light = np.array(
        [level * instrument.sei_w_cm2(band) if kind == "flat" else 0.0 for band in bands], dtype=np.float32
    )
    image = np.broadcast_to(light[:, None, None], signal.images.shape[1:])
    counts = np.empty((n_frame, *image.shape), dtype=np.uint16)
    read = wp.empty((1, *image.shape), dtype=wp.uint16, device=on)
    own = None if kind == "bias" else make_artifacts(known, bands, scene.read_out.detector.keys, on)
    for number in range(n_frame):
        signal.images.assign(np.ascontiguousarray(image[None]))
        signal.touched.fill_(1)
        inputs = new_inputs(on, [0.0], [FIRST_FRAME[kind] + number], [instrument.index(sensor)])
        if own is not None:
            artifacts(own, inputs, signal).run()
        read_out(scene, inputs, signal, read, 0).run()
        counts[number] = to_numpy(read)[0]
    return counts


def _instrument(scenario: Scenario, sensor: str, bands: Sequence[str]) -> Instrument:
    instrument = scenario.instrument_of(sensor)
    instrument.index(sensor)
    for band in bands:
        if band not in instrument.bands:
            raise InputError(f"must be of {', '.join(instrument.bands)}", "bands", band)
    return instrument


def _shuttered(instrument: Instrument, dark: bool) -> Instrument:
    """The same sensors without the light of sky and optics, and without dark current if so wished."""
    detector = instrument.sensor.detector
    if not isinstance(detector, ElectronDetector):
        return instrument
    off: dict[str, Any] = {"background_w_cm2_sr": 0.0, "zodiacal_mjy_sr": 0.0}
    off |= {"optics_temperature_k": None, "optics_emissivity": 0.0}
    shut = copy.copy(instrument)
    shut.__dict__.pop("levels", None)
    shut.sensor = replace(
        instrument.sensor, detector=replace(detector, **off, dark_e_s=detector.dark_e_s if dark else 0.0)
    )
    return shut
