"""Radiation hits and flickering pixels of a detector, put on a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.artifacts import Flicker, Hits

from warpsim.arrays import F64
from warpsim.detector.hits_and_flicker import has_artifacts, hit_area
from warpsim.detector.levels import ElectronLevels
from warpsim.launches import struct_of
from warpsim.scene.instrument import Instrument
from warpsim.streams import uniforms

HIT, FLICKER = 1, 2
"""Bits of artifact masks."""

F32 = npt.NDArray[np.float32]


@dataclass(frozen=True)
class DeviceArtifacts:
    """Structs of the stage `artifacts`; None for what a detector does not have."""

    hits: Any
    flicker: Any
    key: wp.array
    """Of the sensors' noise, (n_sensor,)."""
    band_id: wp.array
    n_row: int
    n_col: int


def band_ids(instrument: Instrument, bands: Sequence[str], device: wp.Device) -> wp.array:
    """Return the index of each band among those of the sensors, (n_band,)."""
    return wp.array([list(instrument.sensor.bands).index(band) for band in bands], dtype=wp.uint32, device=device)


def make_artifacts(
    instrument: Instrument, bands: Sequence[str], key: wp.array, device: wp.Device
) -> DeviceArtifacts | None:
    """Put a detector's hits and flickering pixels on a device.

    Returns:
        None where it has neither.
    """
    detector, camera = instrument.sensor.detector, instrument.sensor.camera
    if not has_artifacts(detector):
        return None
    hits = _hits_struct(instrument, bands, device) if detector.hits is not None else None
    flicker = _flicker_struct(instrument, bands, device) if detector.flicker is not None else None
    return DeviceArtifacts(hits, flicker, key, band_ids(instrument, bands, device), camera.n_row, camera.n_col)


def _w_cm2(instrument: Instrument, band: str, electrons: float | None, nei: float | None) -> float:
    """Irradiance that gives a pixel so many electrons, or so many NEI."""
    levels = instrument.levels[band]
    if isinstance(levels, ElectronLevels):
        assert electrons is not None
        return electrons / levels.e_per_w_cm2
    assert nei is not None
    return nei * levels.nei_w_cm2


def _hits_struct(instrument: Instrument, bands: Sequence[str], device: wp.Device) -> Any:
    own = instrument.sensor.detector.hits
    assert own is not None
    area = hit_area(instrument.sensor.detector, instrument.sensor.camera)
    electrons, nei = (None if mean is None else mean * own.thickness_um for mean in (own.e_per_um, own.nei_per_um))
    return struct_of(
        Hits,
        device,
        mean=area.mean,
        margin_px=area.margin_px,
        thickness_px=[own.thickness_um / size for size in area.size_um],
        landau_width=own.landau_width,
        level_w_cm2=[_w_cm2(instrument, band, electrons, nei) for band in bands],
    )


def flickering_pixels(instrument: Instrument, sensor: int, band: str) -> tuple[npt.NDArray[np.int32], F32, F64]:
    """Return the flickering pixels of a sensor in a band: index in the image, level [W/cm2], phase as a part of 1."""
    detector, camera = instrument.sensor.detector, instrument.sensor.camera
    own, n_pixel = detector.flicker, camera.n_row * camera.n_col
    assert own is not None
    seed, item = instrument.noise_key(sensor), list(instrument.sensor.bands).index(band)
    # Gaps between them are geometric: as many draws as there are pixels, and a margin of 9 sigma.
    mean = own.fraction * n_pixel
    gap = np.log(uniforms(seed, "flicker.pixel", item, int(mean + 9 * np.sqrt(mean) + 20))) / np.log1p(-own.fraction)
    found = np.cumsum(np.floor(gap) + 1.0) - 1.0
    pixel = found[found < n_pixel].astype(np.int32)
    electrons_e = None if own.e_s is None else own.e_s * detector.exposure_s
    level = _w_cm2(instrument, band, electrons_e, own.nei) * -np.log(uniforms(seed, "flicker.level", item, len(pixel)))
    return pixel, level.astype(np.float32), uniforms(seed, "flicker.phase", item, len(pixel))


def _flicker_struct(instrument: Instrument, bands: Sequence[str], device: wp.Device) -> Any:
    own = instrument.sensor.detector.flicker
    assert own is not None
    planes = [flickering_pixels(instrument, row, band) for row in range(len(instrument.names)) for band in bands]
    pixel, level, part = (np.concatenate(values) for values in zip(*planes, strict=True))
    n_pixel = [len(one) for one, *_ in planes]
    return struct_of(
        Flicker,
        device,
        first=np.cumsum([0, *n_pixel]),
        pixel=pixel,
        level_w_cm2=level,
        phase=(part * own.dwell_frames).astype(np.uint32),
        dwell=own.dwell_frames,
        on_at_most=round(own.duty * 2**32) - 1,
        n_most=max(n_pixel),
    )
