"""Pointing and jitter on a device: the kernel of the stage aim, and what it reads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.aim import (
    AIM_FIXED,
    AIM_TABLE,
    AIM_TRACK,
    UP_NORTH,
    UP_ORBIT_NORMAL,
    UP_ZENITH,
    Aim,
    AimTable,
    make_aim_kernel,
)
from warpsim_kernels.jitter import N_STEP, STEPS_PER_CORRELATION
from warpsim_kernels.jitter import Jitter as JitterStruct

from warpsim.scene.pointing import FixedPointing, Jitter
from warpsim.scene.scene import Scene
from warpsim.scene.sights import Sights
from warpsim.scene.view_axes import fixed_direction, image_turn, tracked_targets

_KINDS = {"track": AIM_TRACK, "fixed": AIM_FIXED, "table": AIM_TABLE}
_UPS = {"zenith": UP_ZENITH, "north": UP_NORTH, "orbit_normal": UP_ORBIT_NORMAL}


@dataclass(frozen=True)
class Aiming:
    """What the stage aim launches and reads."""

    kernel: wp.Kernel
    aim: Any
    table: Any
    jitter: Any


def make_aiming(scene: Scene, device: wp.Device) -> Aiming:
    """Put a scene's pointing on a device."""
    pointing, sights = scene.pointing, scene.sights
    first, count = tracked_targets(scene)
    aim: Any = Aim()
    aim.up_rule = _UPS[pointing.up]
    aim.first_tracked, aim.n_tracked = len(scene.sensor_names) + first, count
    aim.turn = wp.mat33d(*image_turn(scene).ravel().tolist())
    if isinstance(pointing, FixedPointing):
        aim.direction = wp.vec3d(*fixed_direction(pointing).tolist())
        aim.local = int(pointing.ra_dec_deg is None)
    if sights is not None:
        aim.local = int(sights.local)
    shaken = pointing.jitter is not None and pointing.jitter.rms_urad > 0
    kernel = make_aim_kernel(_KINDS[pointing.kind], shaken)
    return Aiming(kernel, aim, _table(sights, device), jitter_struct(pointing.jitter, scene.seed))


def _table(sights: Sights | None, device: wp.Device) -> Any:
    table: Any = AimTable()
    if sights is None:
        return table
    table.time_s = wp.array(sights.time_s, dtype=wp.float64, device=device)
    table.direction = wp.array(sights.direction, dtype=wp.vec3d, device=device)
    table.roll_rad = wp.array(sights.roll_rad, dtype=wp.float64, device=device)
    table.first = wp.array(sights.first, dtype=wp.int32, device=device)
    table.count = wp.array(sights.count, dtype=wp.int32, device=device)
    table.scan = int(sights.scan)
    return table


def jitter_struct(jitter: Jitter | None, seed: int) -> Any:
    """The process as the kernels' struct; its matrices are those of a step of the critically damped oscillator.

    With d the step in correlation times, a state (angle, change per step) decays by the matrix exponential of
    [[0, 1], [-4 d^2, -4 d]]; the shocks have the covariance that keeps (rms^2, (2 d rms)^2) stationary.
    """
    struct: Any = JitterStruct()
    if jitter is None:
        return struct
    d = 1.0 / STEPS_PER_CORRELATION
    rms_rad = jitter.rms_urad * 1e-6
    decay = np.exp(-2 * d) * np.array([[1 + 2 * d, 1.0], [-4 * d * d, 1 - 2 * d]])
    stationary = np.diag([1.0, 4 * d * d])
    spread = rms_rad * np.linalg.cholesky(stationary - decay @ stationary @ decay.T)
    forgotten = np.linalg.matrix_power(decay, N_STEP)
    struct.step_s = jitter.correlation_s * d
    struct.decay, struct.spread, struct.forgotten = (
        wp.mat22d(*matrix.ravel().tolist()) for matrix in (decay, spread, forgotten)
    )
    struct.seed_low, struct.seed_high = seed & 0xFFFFFFFF, seed >> 32
    return struct
