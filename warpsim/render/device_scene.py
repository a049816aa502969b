"""A scene on a device, for one kind of sensor: what stays the same from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp

from warpsim.optics.psf_bank import PsfBank
from warpsim.render.pointing_arrays import PointingArrays
from warpsim.render.read_out import ReadOut
from warpsim.render.star_field import SceneStars
from warpsim.render.streaks import Streaks
from warpsim.render.target_field import TargetField
from warpsim.scene.instrument import Instrument


@dataclass(frozen=True)
class DeviceBodies:
    """Structs and arrays of the stages that need no images, for some bands of an instrument."""

    instrument: Instrument
    device: wp.Device
    n_band: int
    n_target: int
    pointing: PointingArrays
    tracks: Any
    """The kernels' Tracks."""
    field: TargetField
    camera: Any
    sample_points: wp.array
    """Directions of corners and the like in camera axes, (n_point,)."""
    streaks: Streaks
    """Instants at which sources are followed through the exposure."""


@dataclass(frozen=True)
class DeviceScene(DeviceBodies):
    """Structs and arrays of all stages: stars, optics and detector besides."""

    psf: PsfBank
    read_out: ReadOut
    stars: SceneStars
    band_id: wp.array
    """Index of each band among the instrument's, (n_band,)."""
    stamp_rule: Any
