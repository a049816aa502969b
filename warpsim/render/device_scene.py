"""A scene on a device, for one kind of sensor: what stays the same from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from warpsim_kernels.rolling import Roll
from warpsim_kernels.trace import Instants

from warpsim.launches import struct_of
from warpsim.legendre import gauss_legendre, series_matrix
from warpsim.optics.psf_bank import PsfBank
from warpsim.render.background import DeviceBackground
from warpsim.render.device_artifacts import DeviceArtifacts
from warpsim.render.device_stars import SceneStars
from warpsim.render.read_out import ReadOut
from warpsim.render.target_field import TargetField
from warpsim.scene.instrument import Instrument
from warpsim.scene.sensors import Sensor


@dataclass(frozen=True)
class DeviceBodies:
    """Structs and arrays of the stages that need no images, for some bands of an instrument."""

    instrument: Instrument
    device: wp.Device
    bands: list[str]
    """Names."""
    n_target: int
    aim_kernel: wp.Kernel
    pointing: Any
    """The kernels' Pointing."""
    tracks: Any
    """The kernels' Tracks."""
    field: TargetField
    camera: Any
    sample_points: wp.array
    """Directions of corners and the like in camera axes, (n_point,)."""
    streaks: Streaks
    """Instants at which sources are followed through the exposure."""

    @property
    def n_band(self) -> int:
        """Bands."""
        return len(self.bands)


@dataclass(frozen=True)
class DeviceScene(DeviceBodies):
    """Structs and arrays of all stages: stars, optics and detector besides."""

    psf: PsfBank
    read_out: ReadOut
    stars: SceneStars
    band_id: wp.array
    """Index of each band among the instrument's, (n_band,)."""
    stamp_rule: Any
    background: DeviceBackground | None
    """None where a scene has none."""
    artifacts: DeviceArtifacts | None
    """Radiation hits and flickering pixels; None where a detector has none."""


@dataclass(frozen=True)
class Streaks:
    """Instants at which a scene's sources are followed through the exposure; nothing is followed where n_path is 0."""

    n_path: int
    """Instants at which positions are found."""
    error_px: float
    """Largest error of a position met between them [px]."""
    offset_s: npt.NDArray[np.float64]
    """The instants, from the middle of the exposure [s], (n_path,)."""
    instants: Any
    """The same for the kernels."""
    roll: Any | None = None
    """The kernels' Roll, of a detector that is read row by row: the instants are then those of all rows."""

    @property
    def rolls(self) -> bool:
        """Whether sources have the times of their rows."""
        return self.roll is not None

    @property
    def enabled(self) -> bool:
        """Whether sources move."""
        return self.n_path > 0


def streaks_at(n_path: int, span_s: float, device: wp.Device, error_px: float = 0.0) -> Streaks:
    """Streaks with positions at the nodes of a Gauss-Legendre rule over a span about the frame's time [s]."""
    instants = struct_of(Instants, device, n_path=n_path, series=series_matrix(n_path))
    return Streaks(n_path, error_px, 0.5 * span_s * gauss_legendre(n_path)[0], instants)


def make_roll(sensor: Sensor, instants: Any, device: wp.Device) -> Any:
    """Return the rows' times of a sensor, paths through whose window are series at instants, as the kernels' Roll."""
    detector, n_row = sensor.detector, sensor.camera.n_row
    line_s = detector.line_time_s
    return struct_of(
        Roll,
        device,
        line_time_s=line_s,
        middle_row=0.5 * (n_row - 1),
        half_rows_s=0.5 * n_row * abs(line_s),
        half_exposure_s=0.5 * detector.exposure_s,
        half_window_s=0.5 * sensor.window_s,
        charge_drift_px=-0.5 * np.sign(line_s) if detector.tdi_stages else 0.0,
        node=gauss_legendre(instants.n_path)[0],
        instants=instants,
    )


def moved(offset_px: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """From the start to the end of the exposure: of Legendre coefficients (..., n_path, 2) to (..., 2).

    P_l(1) - P_l(-1) is 2 for odd l and 0 for even ones.
    """
    return np.asarray(2.0 * offset_px[..., 1::2, :].sum(axis=-2, dtype=np.float64))
