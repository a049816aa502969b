"""Pointing on a device: the kernel of the stage aim, and what it reads."""

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

from warpsim.launches import to_numpy
from warpsim.render.target_field import make_attitudes
from warpsim.scene.camera_axes import PointingLaw
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing import Bias, Drift, Jitter
from warpsim.scene.pointing_table import DirectionRows
from warpsim.streams import normals
from warpsim.target.attitude_table import AttitudeRows

_KINDS = {"track": LAW_TRACK, "fixed": LAW_FIXED, "scan": LAW_SCAN, "attitude": LAW_ATTITUDE}
_UPS = {"zenith": UP_ZENITH, "north": UP_NORTH, "orbit_normal": UP_ORBIT_NORMAL}

_RAD_PER_URAD = 1e-6


def make_pointing(instrument: Instrument, device: wp.Device) -> tuple[wp.Kernel, Any]:
    """Return the kernel of the stage aim, and the pointing of an instrument's sensors on a device."""
    program = instrument.program
    features = aim_features(instrument)
    struct: Any = PointingStruct()
    structs = [_law_struct(law, len(instrument.names)) for law in program.laws]
    struct.laws = wp.array(structs, dtype=LawStruct, device=device)

    def ints(values: Sequence[int]) -> wp.array:
        return wp.array(np.asarray(values, dtype=np.int32), dtype=wp.int32, device=device)

    struct.law = ints([own.steps[0].law for own in program.sensors])
    if features.steps:
        _put_steps(struct, instrument, device)
    if features.scan:
        struct.rows = _scan_rows([own.scan for own in program.sensors], device)
    if features.attitude:
        _put_attitudes(struct.rows, [own.attitude for own in program.sensors], device)
    if features.steady_errors:
        errors = [_error_struct(instrument, sensor) for sensor in range(len(instrument.names))]
        struct.errors = wp.array(errors, dtype=PointingError, device=device)
    if features.jitter:
        jitters = [
            jitter_struct(own.jitter, instrument.pointing_key(sensor)) for sensor, own in enumerate(program.sensors)
        ]
        struct.jitters = wp.array(jitters, dtype=JitterStruct, device=device)
    return make_aim_kernel(features), struct


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
    struct: Any = LawStruct()
    struct.kind, struct.up_rule = _KINDS[law.kind], _UPS[law.up]
    struct.first_tracked, struct.n_tracked = n_sensor + law.targets.start, len(law.targets)
    if law.direction is not None:
        struct.direction = wp.vec3d(*law.direction.tolist())
    struct.local, struct.roll_rad = int(law.local), law.roll_rad
    struct.turn = wp.mat33d(*law.turn.ravel().tolist())
    return struct


def _put_steps(struct: Any, instrument: Instrument, device: wp.Device) -> None:
    """Steps of all sensors, those of each together; sensors with the same ones share them."""
    known: dict[Any, int] = {}
    first: list[int] = []
    count: list[int] = []
    rows: list[tuple[Any, ...]] = []
    for sensor, own in enumerate(instrument.program.sensors):
        turns = instrument.turns(sensor)
        key = (id(own.steps), turns)
        if key not in known:
            known[key] = len(rows)
            rows += [
                (max(step.start_s, -1e300), step.law, turn.duration_s, turn.ramp, turn.total_s, turn.vector)
                for step, turn in zip(own.steps, turns, strict=True)
            ]
        first.append(known[key])
        count.append(len(own.steps))
    start_s, law, turn_s, ramp, unsettled_s, vector = zip(*rows, strict=True)

    def put(values: Any, dtype: Any) -> wp.array:
        return wp.array(np.asarray(values), dtype=dtype, device=device)

    struct.step_first, struct.step_count = put(first, wp.int32), put(count, wp.int32)
    struct.step_start_s, struct.step_law = put(start_s, wp.float64), put(law, wp.int32)
    struct.turn_s, struct.turn_ramp = put(turn_s, wp.float64), put(ramp, wp.float64)
    struct.unsettled_s, struct.turn_vector = put(unsettled_s, wp.float64), put(vector, wp.vec3d)
    struct.slews = put([int(own.slew is not None) for own in instrument.program.sensors], wp.int32)


def _scan_rows(tables: Sequence[DirectionRows | None], device: wp.Device) -> Any:
    """Rows of all tables, each once, and where those of each sensor begin."""
    distinct = list(dict.fromkeys(table for table in tables if table is not None))
    starts = dict(zip(distinct, np.cumsum([0, *(len(table.time_s) for table in distinct)]), strict=False))
    rows: Any = ScanRows()
    rows.time_s = wp.array(np.concatenate([table.time_s for table in distinct]), dtype=wp.float64, device=device)
    rows.direction = wp.array(np.concatenate([table.direction for table in distinct]), dtype=wp.vec3d, device=device)
    rows.roll_rad = wp.array(np.concatenate([table.roll_rad for table in distinct]), dtype=wp.float64, device=device)
    first = [0 if table is None else starts[table] for table in tables]
    count = [0 if table is None else len(table.time_s) for table in tables]
    rows.first = wp.array(np.asarray(first, dtype=np.int32), dtype=wp.int32, device=device)
    rows.count = wp.array(np.asarray(count, dtype=np.int32), dtype=wp.int32, device=device)
    return rows


def _put_attitudes(rows: Any, attitudes: Sequence[AttitudeRows | None], device: wp.Device) -> None:
    """Add the attitude tables of bodies, and where those of each sensor begin, to the rows of scans."""
    rows.attitudes, spans = make_attitudes([one for one in attitudes if one is not None], device)
    of_sensor = iter(spans)
    own = [None if one is None else next(of_sensor) for one in attitudes]
    for name, part in (("first", 0), ("count", 1)):
        scans = getattr(rows, name)
        before = np.zeros(len(own), np.int32) if scans is None else to_numpy(scans)
        values = [old if span is None else span[part] for old, span in zip(before.tolist(), own, strict=True)]
        setattr(rows, name, wp.array(values, dtype=wp.int32, device=device))


def _error_struct(instrument: Instrument, sensor: int) -> Any:
    """Bias and drift of a sensor; what is drawn once is drawn here."""
    own, key = instrument.program.sensors[sensor], instrument.pointing_key(sensor)
    struct: Any = PointingError()
    struct.seed_low, struct.seed_high = key & 0xFFFFFFFF, key >> 32
    if own.bias is not None:
        given = own.bias.urad
        bias_urad = (own.bias.rms_urad or 0.0) * normals(key, "bias", 0, 2) if given is None else np.array(given)
        struct.bias_rad = wp.vec2d(*(bias_urad * _RAD_PER_URAD).tolist())
    if own.drift is not None:
        rates = own.drift.urad_s or (0.0, 0.0)
        struct.drift_rad_s = wp.vec2d(*(np.array(rates) * _RAD_PER_URAD).tolist())
        struct.drift_rms_rad_s = (own.drift.rms_urad_s or 0.0) * _RAD_PER_URAD
        struct.reset_s = own.drift.reset_s or 0.0
    return struct


def jitter_struct(jitter: Jitter | None, key: int) -> Any:
    """Return the process as the kernels' struct; its matrices are those of a step of a critically damped oscillator.

    With d the step in correlation times, a state (angle, change per step) decays by the matrix exponential of
    [[0, 1], [-4 d^2, -4 d]]; the shocks have the covariance that keeps (rms^2, (2 d rms)^2) stationary.
    """
    struct: Any = JitterStruct()
    if jitter is None or jitter.rms_urad == 0:
        return struct
    d = 1.0 / STEPS_PER_CORRELATION
    rms_rad = jitter.rms_urad * _RAD_PER_URAD
    decay = np.exp(-2 * d) * np.array([[1 + 2 * d, 1.0], [-4 * d * d, 1 - 2 * d]])
    stationary = np.diag([1.0, 4 * d * d])
    spread = rms_rad * np.linalg.cholesky(stationary - decay @ stationary @ decay.T)
    forgotten = np.linalg.matrix_power(decay, N_STEP)
    struct.step_s = jitter.correlation_s * d
    struct.decay, struct.spread, struct.forgotten = (
        wp.mat22d(*matrix.ravel().tolist()) for matrix in (decay, spread, forgotten)
    )
    struct.seed_low, struct.seed_high = key & 0xFFFFFFFF, key >> 32
    return struct
