"""Pointing on a device: the kernel of the stage aim, what it reads, and pointing that somebody outside commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from warpsim_kernels.aim import AimFeatures, make_aim_kernel
from warpsim_kernels.aim import Pointing as PointingStruct
from warpsim_kernels.pointing import (
    LAW_ATTITUDE,
    LAW_FIXED,
    LAW_SCAN,
    LAW_TRACK,
    UP_NORTH,
    UP_ORBIT_NORMAL,
    UP_ZENITH,
    ScanRows,
)
from warpsim_kernels.pointing import PointingLaw as LawStruct
from warpsim_kernels.pointing_errors import N_STEP, STEPS_PER_CORRELATION, PointingError
from warpsim_kernels.pointing_errors import Jitter as JitterStruct

from warpsim.launches import struct_of
from warpsim.render.device import kernel_loading
from warpsim.render.target_field import make_attitudes, rows_once
from warpsim.scene.camera_axes import PointingLaw
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing import Bias, Drift, Jitter
from warpsim.scene.pointing_commands import AppliedCommand, PointingCommand, apply_command, checked_command
from warpsim.scene.pointing_program import SensorProgram
from warpsim.scene.scenario import Scenario
from warpsim.streams import normals

_KINDS = {"track": LAW_TRACK, "fixed": LAW_FIXED, "scan": LAW_SCAN, "attitude": LAW_ATTITUDE}
_UPS = {"zenith": UP_ZENITH, "north": UP_NORTH, "orbit_normal": UP_ORBIT_NORMAL}

_RAD_PER_URAD = 1e-6


def make_pointing(instrument: Instrument, device: wp.Device) -> tuple[wp.Kernel, Any]:
    """Return the kernel of the stage aim, and the pointing of an instrument's sensors on a device."""
    features, sensors = aim_features(instrument), instrument.program.sensors
    keys = [instrument.pointing_key(sensor) for sensor in range(len(sensors))]
    given: dict[str, Any] = {
        "laws": [_law_struct(law, len(sensors)) for law in instrument.program.laws],
        "law": [own.steps[0].law for own in sensors],
    }
    if features.steps:
        given |= _steps(instrument)
    if features.scan or features.attitude:
        given["rows"] = _rows(sensors, device)
    if features.steady_errors:
        given["errors"] = [_error_struct(own, key) for own, key in zip(sensors, keys, strict=True)]
    if features.jitter:
        given["jitters"] = [jitter_struct(own.jitter, key) for own, key in zip(sensors, keys, strict=True)]
    return make_aim_kernel(features), struct_of(PointingStruct, device, **given)


def aim_features(instrument: Instrument) -> AimFeatures:
    """Return what the kernel of an instrument's pointing holds; one kernel serves all that may be commanded."""
    program, commanded = instrument.program, instrument.is_commanded
    kinds, sensors = {law.kind for law in program.laws}, program.sensors
    steps = commanded or any(len(own.steps) > 1 for own in sensors)
    return AimFeatures(
        track=commanded or "track" in kinds,
        fixed=commanded or "fixed" in kinds,
        scan="scan" in kinds,
        attitude="attitude" in kinds,
        steps=steps,
        slews=steps and any(own.slew is not None for own in sensors),
        steady_errors=any(_errs(own.bias) or _errs(own.drift) for own in sensors),
        jitter=any(own.jitter is not None and own.jitter.rms_urad > 0 for own in sensors),
    )


def _errs(error: Bias | Drift | None) -> bool:
    """Return whether an error is not 0."""
    if error is None:
        return False
    given = (error.rms_urad, error.urad) if isinstance(error, Bias) else (error.rms_urad_s, error.urad_s)
    return bool(np.any([np.any(value) for value in given if value is not None]))


def _law_struct(law: PointingLaw, n_sensor: int) -> Any:
    return struct_of(
        LawStruct,
        kind=_KINDS[law.kind],
        up_rule=_UPS[law.up],
        first_tracked=n_sensor + law.targets.start,
        n_tracked=len(law.targets),
        direction=law.direction,
        local=int(law.local),
        roll_rad=law.roll_rad,
        turn=law.turn,
    )


def _steps(instrument: Instrument) -> dict[str, Any]:
    """Steps of all sensors, those of each together, as fields of the struct; sensors with the same ones share them."""
    known: dict[Any, int] = {}
    first: list[int] = []
    rows: list[tuple[Any, ...]] = []
    sensors = instrument.program.sensors
    for sensor, own in enumerate(sensors):
        turns = instrument.turns(sensor)
        key = (id(own.steps), turns)
        if key not in known:
            known[key] = len(rows)
            rows += [
                (max(step.start_s, -1e300), step.law, turn.duration_s, turn.ramp, turn.total_s, turn.vector)
                for step, turn in zip(own.steps, turns, strict=True)
            ]
        first.append(known[key])
    names = ("step_start_s", "step_law", "turn_s", "turn_ramp", "unsettled_s", "turn_vector")
    return {
        "step_first": first,
        "step_count": [len(own.steps) for own in sensors],
        "slews": [int(own.slew is not None) for own in sensors],
        **dict(zip(names, zip(*rows, strict=True), strict=True)),
    }


def _rows(sensors: Sequence[SensorProgram], device: wp.Device) -> Any:
    """Rows of tables of directions and of the attitudes of bodies, each once, and where those of each sensor begin."""
    scans, spans = rows_once([own.scan for own in sensors], time_s=(), direction=(3,), roll_rad=())
    attitudes, attitude_spans = make_attitudes([own.attitude for own in sensors], device)
    pairs = zip(sensors, spans, attitude_spans, strict=True)
    first, count = zip(*(scan if own.attitude is None else body for own, scan, body in pairs), strict=True)
    return struct_of(ScanRows, device, **scans, attitudes=attitudes, first=first, count=count)


def _error_struct(own: SensorProgram, key: int) -> Any:
    """Bias and drift of a sensor; what is drawn once is drawn here."""
    given: dict[str, Any] = {"seed_low": key & 0xFFFFFFFF, "seed_high": key >> 32}
    if own.bias is not None:
        rms_urad, urad = own.bias.rms_urad or 0.0, own.bias.urad
        given["bias_rad"] = (rms_urad * normals(key, "bias", 0, 2) if urad is None else np.array(urad)) * _RAD_PER_URAD
    if own.drift is not None:
        given["drift_rad_s"] = np.array(own.drift.urad_s or (0.0, 0.0)) * _RAD_PER_URAD
        given["drift_rms_rad_s"] = (own.drift.rms_urad_s or 0.0) * _RAD_PER_URAD
        given["reset_s"] = own.drift.reset_s or 0.0
    return struct_of(PointingError, **given)


def jitter_struct(jitter: Jitter | None, key: int) -> Any:
    """Return the process as the kernels' struct; its matrices are those of a step of a critically damped oscillator.

    With d the step in correlation times, a state (angle, change per step) decays by the matrix exponential of
    [[0, 1], [-4 d^2, -4 d]]; the shocks have the covariance that keeps (rms^2, (2 d rms)^2) stationary.
    """
    if jitter is None or jitter.rms_urad == 0:
        return JitterStruct()
    d = 1.0 / STEPS_PER_CORRELATION
    rms_rad = jitter.rms_urad * _RAD_PER_URAD
    decay = np.exp(-2 * d) * np.array([[1 + 2 * d, 1.0], [-4 * d * d, 1 - 2 * d]])
    stationary = np.diag([1.0, 4 * d * d])
    return struct_of(
        JitterStruct,
        step_s=jitter.correlation_s * d,
        decay=decay,
        spread=rms_rad * np.linalg.cholesky(stationary - decay @ stationary @ decay.T),
        forgotten=np.linalg.matrix_power(decay, N_STEP),
        seed_low=key & 0xFFFFFFFF,
        seed_high=key >> 32,
    )


class CommandedPointing:
    """Pointing of the sensors of a stream, as commanded so far.

    Args:
        scenario: What the frames are of.
        instrument: The kind of the sensors.
        sensors: Names of those rendered.
        devices: Where they are rendered.
    """

    def __init__(
        self, scenario: Scenario, instrument: Instrument, sensors: Sequence[str], devices: Sequence[wp.Device]
    ) -> None:
        self._scenario, self._own, self._sensors, self._devices = scenario, instrument, sensors, devices
        self.instrument = instrument
        """The kind of the sensors, as it is pointed from now on."""

    def load(self) -> None:
        """Load the kernel of commanded pointing, so that frames need not wait for it."""
        instrument = self._own.commanded(self._own.program, {})
        for device in self._devices:
            loading = kernel_loading(device)
            loading.start(make_aim_kernel(aim_features(instrument)))
            loading.wait()

    def checked(self, command: Any) -> PointingCommand:
        """Return a command once it can be carried out without delay."""
        checked = checked_command(command, self._scenario, self._sensors)
        self.load()
        return checked

    def planned(
        self, command: PointingCommand, before: Instrument, frame: int
    ) -> tuple[Instrument, list[AppliedCommand]]:
        """Return the instrument, as it was before, pointed from a frame on, and what that does."""
        return apply_command(command, self._scenario, before, frame)

    def restart(self) -> None:
        """Point as the scene says."""
        self.instrument = self._own
