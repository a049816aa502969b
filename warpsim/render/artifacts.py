"""Pixels that radiation hits and flickering change: images of their charge, and a table."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.detector.detectors import ElectronDetector
from warpsim.launches import to_numpy
from warpsim.render.batch import new_inputs
from warpsim.render.buffers import new_signal
from warpsim.render.descriptions import with_units
from warpsim.render.device_artifacts import FLICKER, HIT, DeviceArtifacts
from warpsim.render.request import Request
from warpsim.render.stages import artifacts

if TYPE_CHECKING:
    from astropy.table import Table


KINDS = {HIT: "hit", FLICKER: "flicker"}
"""Words of the bits of artifact masks."""


def artifact_images(own: DeviceArtifacts, frame: int, sensor: int) -> dict[int, npt.NDArray[np.float32]]:
    """Return the charge of each kind of artifact that a detector has in the images of a view, as irradiance [W/cm2].

    By bit of artifact masks, (n_band, n_row, n_col) each.
    """
    device, shape = own.key.device, (1, len(own.band_id), own.n_row, own.n_col)
    inputs, images = new_inputs(device, [0.0], [frame], [sensor]), {}
    for kind, struct in ((HIT, own.hits), (FLICKER, own.flicker)):
        if struct is not None:
            signal = new_signal(shape, device)
            artifacts(own, inputs, signal, kind).run()
            images[kind] = np.asarray(to_numpy(signal.images)[0])
    return images


def artifact_table(own: DeviceArtifacts | None, asked: Request) -> Table:
    """Return one row per pixel of an image that a radiation hit or a flickering pixel changes.

    Columns: frame, sensor, band, kind ("hit" or "flicker"), x_px and y_px (column and row), irradiance_w_cm2, that
    which would give the same charge; of a detector in electrons charge_e.
    """
    from astropy.table import Table

    found: list[tuple[Any, ...]] = []
    instrument, bands = asked.instrument, asked.bands
    for number, sensor in itertools.product(asked.frames, asked.sensors):
        if own is not None:
            for kind, levels in artifact_images(own, number, instrument.index(sensor)).items():
                band, row, col = np.nonzero(levels)
                count = len(band)
                names = np.full(count, sensor), np.asarray(bands)[band], np.full(count, KINDS[kind])
                found.append((np.full(count, number, dtype=np.int64), *names, col, row, levels[band, row, col]))
    none = np.zeros(0, dtype=np.int64)
    empty = (none, *(np.zeros(0, dtype="U7"),) * 3, none, none, np.zeros(0))
    values = [np.concatenate(column) for column in zip(empty, *found, strict=True)]
    columns = dict(zip(("frame", "sensor", "band", "kind", "x_px", "y_px", "irradiance_w_cm2"), values, strict=True))
    if isinstance(instrument.sensor.detector, ElectronDetector):
        e_per_w_cm2 = {band: getattr(instrument.levels[band], "e_per_w_cm2") for band in bands}  # noqa: B009
        scale = np.array([e_per_w_cm2[band] for band in columns["band"]])
        columns["charge_e"] = columns["irradiance_w_cm2"] * scale
    return with_units(Table(columns))
