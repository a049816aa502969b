"""Pointing programs: the commanded steps of each sensor of a kind, and its pointing errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arrays import F64
from warpsim.directions import unit_vectors
from warpsim.errors import InputError, errors_at
from warpsim.instant import Instant
from warpsim.optics.camera import Camera
from warpsim.scene.camera_axes import (
    CommandedAxes,
    PointingLaw,
    SatelliteState,
    image_turn,
    law_axes,
    satellite_state,
)
from warpsim.scene.pointing import (
    ALL,
    SATELLITE,
    Bias,
    BodyPointing,
    Drift,
    FixedPointing,
    Jitter,
    Pointing,
    PointingStep,
    SchedulePointing,
    Slew,
    TablePointing,
    TrackPointing,
    Up,
    satellites_of,
)
from warpsim.scene.pointing_table import DirectionRows, check_rate, direction_rows
from warpsim.scene.slews import NO_TURN, SlewTurn, between, slew_part, turn_between
from warpsim.scene.targets import SceneTarget
from warpsim.scene.tracks import Tracks
from warpsim.target.attitude_table import AttitudeRows, AttitudeTable

Rows = npt.NDArray[np.int64]

MOST_TRACKED = 10_000
"""Targets whose mean direction a camera tracks: 0.2 ms for each at a time, in a report of a scene."""

MOST_SLEWS = 10_000
"""Steps with a slew, of all sensors of a kind: one takes some milliseconds."""


@dataclass(frozen=True, eq=False)
class Step:
    """Step of a program: a pointing law and its start time."""

    start_s: float
    """After the scene's epoch [s]; -inf for what holds throughout."""
    law: int
    """Index among the laws of the program."""
    field: str = ""
    """What describes it, for messages."""


@dataclass(frozen=True, eq=False)
class SensorProgram:
    """Commanded steps of one sensor, and its pointing errors."""

    steps: tuple[Step, ...]
    slew: Slew | None
    bias: Bias | None
    drift: Drift | None
    jitter: Jitter | None
    entry: int
    """Index of the entry of the sensor's `pointing`."""
    table: DirectionRows | None = None
    """Rows of its table, where it has one."""
    is_scan: bool = False
    """Whether the camera moves from row to row."""
    attitude: AttitudeRows | None = None
    """Attitude of the body that the camera is fixed in, where it is in one."""

    @property
    def scan(self) -> DirectionRows | None:
        """Rows that the camera moves along."""
        return self.table if self.is_scan else None


@dataclass(frozen=True, eq=False)
class PointingProgram:
    """Pointing program of the sensors of a kind."""

    laws: tuple[PointingLaw, ...]
    sensors: tuple[SensorProgram, ...]
    """In the order of the kind's sensors."""

    def tracked(self, sensor: int) -> list[tuple[float, range]]:
        """Return the tracked targets of a sensor with their start times [s]; an empty range where it tracks none."""
        return [(step.start_s, self.laws[step.law].targets) for step in self.sensors[sensor].steps]

    def breaks_s(self, sensor: int) -> list[float]:
        """Return the times at which a sensor's camera jumps, or turns at another rate."""
        program = self.sensors[sensor]
        scans = [] if program.scan is None else program.scan.scan_breaks_s()
        scans += [] if program.attitude is None else program.attitude.breaks_s()
        return sorted({*scans, *(step.start_s for step in program.steps if math.isfinite(step.start_s))})


def make_program(
    pointings: Sequence[Pointing],
    sensors: Sequence[tuple[str, str]],
    camera: Camera,
    targets: Sequence[SceneTarget],
    groups: Sequence[str],
    known: set[str],
    epoch: Instant | None = None,
) -> PointingProgram:
    """Return the pointing program of sensors; the epoch is needed where a file of attitudes is read."""
    taken: dict[int, int] = {}
    for number, pointing in enumerate(pointings):
        with errors_at(entry_path(number, len(pointings))):
            chosen = satellites_of(pointing.on, [satellite for _, satellite in sensors])
            if ALL not in pointing.on and all(index in taken for index in chosen):
                raise InputError("must choose a satellite that no entry before it does", "on", list(pointing.on))
            taken |= {index: number for index in chosen if index not in taken}
    maker = _Maker(camera, targets, groups, known, [], epoch)
    made: dict[int, SensorProgram] = {}
    for number, pointing in enumerate(pointings):
        members = [index for index in range(len(sensors)) if taken[index] == number]
        with errors_at(entry_path(number, len(pointings))):
            programs = maker.programs(pointing, [sensors[i] for i in members], number)
        made |= dict(zip(members, programs, strict=True))
    n_step = sum(len(own.steps) for own in made.values() if own.slew is not None)
    if n_step > MOST_SLEWS:
        raise InputError(f"must have at most {MOST_SLEWS:,} steps with a slew in all", "pointing", n_step)
    return PointingProgram(tuple(maker.laws), tuple(made[index] for index in range(len(sensors))))


def entry_path(number: int, count: int) -> str:
    """Return the field path of an entry of `pointing`; the number of an only one is left out."""
    return "pointing" if count == 1 else f"pointing[{number}]"


@dataclass(frozen=True, eq=False)
class _Maker:
    """Builder of programs, and of the laws that their steps refer to."""

    camera: Camera
    targets: Sequence[SceneTarget]
    groups: Sequence[str]
    known: set[str]
    """Names that rows of tables may have."""
    laws: list[PointingLaw]
    """Those made so far."""
    epoch: Instant | None

    def programs(self, pointing: Pointing, sensors: Sequence[tuple[str, str]], entry: int) -> list[SensorProgram]:
        """Return the programs of the sensors of an entry."""
        if not sensors:
            return []
        if isinstance(pointing, TablePointing):
            courses = self._of_table(pointing, sensors)
        elif isinstance(pointing, BodyPointing):
            courses = self._of_attitude(pointing, sensors)
        else:
            courses = [{"steps": self._steps(pointing)}] * len(sensors)
        errors = {name: getattr(pointing, name) for name in ("bias", "drift", "jitter")}
        slew = getattr(pointing, "slew", None)
        return [SensorProgram(**course, **errors, slew=slew, entry=entry) for course in courses]

    def _of_table(self, pointing: TablePointing, sensors: Sequence[tuple[str, str]]) -> list[dict[str, Any]]:
        turn = image_turn(pointing.roll_deg, (0.0, 0.0), self.camera)
        tables = direction_rows(pointing, sensors, self.known)
        if pointing.mode == "scan":
            steps = (self._step(PointingLaw("scan", pointing.up, turn, local=tables[0].local)),)
            return [{"steps": steps, "table": own, "is_scan": True} for own in tables]
        steps_of: dict[int, tuple[Step, ...]] = {}
        for own in dict.fromkeys(tables):
            rows = zip(own.time_s.tolist(), own.direction, own.roll_rad.tolist(), strict=True)
            steps_of[id(own)] = tuple(
                self._step(
                    PointingLaw("fixed", pointing.up, turn, range(0), direction, own.local, roll),
                    time_s,
                    f"rows[{n}].time_s",
                )
                for n, (time_s, direction, roll) in enumerate(rows)
            )
        return [{"steps": steps_of[id(own)], "table": own} for own in tables]

    def _of_attitude(self, pointing: BodyPointing, sensors: Sequence[tuple[str, str]]) -> list[dict[str, Any]]:
        assert self.epoch is not None  # callers know that there is a file
        turn = image_turn(pointing.roll_deg, (0.0, 0.0), self.camera) @ pointing.axes_in_body
        steps = (self._step(PointingLaw("attitude", pointing.up, turn)),)
        rows: dict[tuple[str, str | None], AttitudeRows] = {}
        courses = []
        for _, satellite in sensors:
            name = pointing.object and pointing.object.replace(SATELLITE, satellite)
            key = pointing.file.replace(SATELLITE, satellite), name
            rows[key] = rows.get(key) or AttitudeTable(file=key[0], object=name).rows(self.epoch)
            courses.append({"steps": steps, "attitude": rows[key]})
        return courses

    def _steps(self, pointing: TrackPointing | FixedPointing | SchedulePointing) -> tuple[Step, ...]:
        about = self.camera, self.targets, self.groups
        if not isinstance(pointing, SchedulePointing):
            return (self._step(law_of(pointing, pointing.up, pointing.roll_deg, *about)),)
        steps = []
        for number, item in enumerate(pointing.steps):
            with errors_at(f"steps[{number}]"):
                law = law_of(item, pointing.up, pointing.roll_deg + item.roll_deg, *about)
            steps.append(self._step(law, item.start_s, f"steps[{number}].start_s"))
        return tuple(steps)

    def _step(self, law: PointingLaw, start_s: float = -math.inf, field: str = "") -> Step:
        """A step by a law, which joins the others."""
        self.laws.append(law)
        return Step(start_s, len(self.laws) - 1, field)


def law_of(
    what: TrackPointing | FixedPointing | PointingStep,
    up: Up,
    roll_deg: float,
    camera: Camera,
    targets: Sequence[SceneTarget],
    groups: Sequence[str],
) -> PointingLaw:
    """Return the law of one target or direction; InputError if the target is not there."""
    track = getattr(what, "track", None)
    turn = image_turn(roll_deg, getattr(what, "offset_px", (0.0, 0.0)), camera)
    if track is not None:
        tracked = tracked_targets(track, targets, groups)
        if len(tracked) > MOST_TRACKED:
            raise InputError(f"must be at most {MOST_TRACKED:,} targets", "track", len(tracked))
        return PointingLaw("track", up, turn, tracked)
    ra_dec_deg = getattr(what, "ra_dec_deg", None)
    direction = unit_vectors(*(ra_dec_deg or getattr(what, "azimuth_elevation_deg", None) or (0.0, 0.0)))
    return PointingLaw("fixed", up, turn, range(0), direction, ra_dec_deg is None)


def tracked_targets(track: str, targets: Sequence[SceneTarget], groups: Sequence[str]) -> range:
    """Return the indices of the targets that a name stands for."""
    names = [target.name for target in targets]
    if track == "main" and names:
        return range(1)
    group = 0 if track == "group" and groups else groups.index(track) if track in groups else None
    if group is not None:
        members = [index for index, target in enumerate(targets) if target.group == group]
        return range(members[0], members[-1] + 1)
    if track not in names:
        known = "".join(f", {name!r}" for name in groups if name != "main")
        raise InputError(f"must be 'main', 'group'{known} or a target's name", "track", track)
    return range(names.index(track), names.index(track) + 1)


def slew_turns(
    program: PointingProgram, sensor: int, satellite: int, tracks: Tracks, duration_s: float
) -> tuple[SlewTurn, ...]:
    """Return the turns with which a sensor's steps begin; none where its entry has no slew."""
    own = program.sensors[sensor]
    if own.slew is not None and own.scan is not None:
        check_rate(own.scan, own.slew)
    return (
        NO_TURN,
        *(step_turn(program, sensor, number, satellite, tracks, duration_s) for number in range(1, len(own.steps))),
    )


def step_turn(
    program: PointingProgram, sensor: int, number: int, satellite: int, tracks: Tracks, duration_s: float
) -> SlewTurn:
    """Return the turn with which a step of a sensor begins, but the first; InputError if it cannot be made in time."""
    own = program.sensors[sensor]
    before, step = own.steps[number - 1], own.steps[number]
    if own.slew is None or not 0.0 <= step.start_s <= duration_s:
        return NO_TURN

    def axes_of(law: int, time_s: F64) -> F64:
        at = satellite_state(tracks, satellite, time_s)
        return law_axes(program.laws[law], own.scan or own.attitude, tracks, at).axes

    is_last = number + 1 == len(own.steps)
    end_s = math.inf if is_last else own.steps[number + 1].start_s
    with errors_at(own.steps[number if is_last else number + 1].field):
        return turn_between(
            partial(axes_of, before.law), partial(axes_of, step.law), own.slew, step.start_s, end_s, duration_s
        )


def commanded_axes(
    program: PointingProgram,
    sensor: int,
    satellite: int,
    tracks: Tracks,
    turns: Sequence[SlewTurn],
    time_s: F64,
    since_middle_s: npt.ArrayLike = 0.0,
) -> CommandedAxes:
    """Return the axes that a sensor is commanded to take at times after the epoch [s], shape (n,).

    One step, and the targets that exist in the middle, hold for all of an exposure (whose middle was since_middle_s
    before); a camera that slews turns in it.
    """
    own = program.sensors[sensor]
    starts = np.array([step.start_s for step in own.steps])
    at = satellite_state(tracks, satellite, time_s, since_middle_s)
    step_s = time_s - at.since_middle_s if own.slew is None else time_s
    step_of = np.clip(np.searchsorted(starts, step_s, side="right") - 1, 0, len(starts) - 1)
    commanded = _steps_axes(program, own, tracks, at, step_of)
    axes = commanded.axes
    duration_s, ramp = np.array([(turn.duration_s, turn.ramp) for turn in turns]).T
    since_s = time_s - starts[step_of]
    turning = (since_s >= 0.0) & (since_s < duration_s[step_of])  # the first step holds before its start, too
    if turning.any():
        step = step_of[turning]
        before = _steps_axes(program, own, tracks, at.rows(turning), step - 1).axes
        part = slew_part(duration_s[step], ramp[step], since_s[turning])
        near = np.array([turn.vector for turn in turns])[step]
        axes[turning] = between(before, axes[turning], part, near)
    return commanded


def _steps_axes(
    program: PointingProgram, own: SensorProgram, tracks: Tracks, at: SatelliteState, step_of: Rows
) -> CommandedAxes:
    """Axes by the law of a step at each time; those of all directions of a table are found at once."""
    n = len(at.time_s)
    laws = [program.laws[step.law] for step in own.steps]
    alike: dict[object, list[int]] = {}
    for number in np.unique(step_of).tolist():
        law = laws[number]
        alike.setdefault((law.up, law.local, id(law.turn)) if law.kind == "fixed" else number, []).append(number)
    axes, up_lost, lost = np.empty((n, 3, 3)), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    for numbers in alike.values():
        rows = np.flatnonzero(np.isin(step_of, numbers))
        law = laws[numbers[0]]
        if len(numbers) > 1:
            of_row = np.searchsorted(numbers, step_of[rows])
            direction = np.array([laws[number].direction for number in numbers])[of_row]
            roll_rad = np.array([laws[number].roll_rad for number in numbers])[of_row]
            law = replace(law, direction=direction, roll_rad=roll_rad)
        found = law_axes(law, own.scan or own.attitude, tracks, at.rows(rows))
        axes[rows], up_lost[rows], lost[rows] = found.axes, found.up_replaced, found.boresight_replaced
    return CommandedAxes(axes, up_lost, lost)


def is_settled(program: PointingProgram, sensor: int, turns: Sequence[SlewTurn], time_s: F64) -> npt.NDArray[np.bool_]:
    """Return whether a sensor's camera neither turns to its next step nor settles, at times (n,)."""
    settled = np.ones(len(time_s), dtype=bool)
    for step, turn in zip(program.sensors[sensor].steps, turns, strict=True):
        if turn.total_s > 0.0:
            settled &= (time_s < step.start_s) | (time_s >= step.start_s + turn.total_s)
    return settled


def check_frames(program: PointingProgram, names: Sequence[str], time_s: F64) -> None:
    """Check that the commanded pointing covers the times of frames."""
    if not time_s.size:
        return
    earliest_s, latest_s = time_s.min(), time_s.max()
    for name, own in zip(names, program.sensors, strict=True):
        if own.scan is not None:
            begin_s, end_s = own.scan.time_s[[0, -1]]
            if earliest_s < begin_s or latest_s > end_s:
                outside_s = earliest_s if earliest_s < begin_s else latest_s
                rule = f"the rows of {name} cover [{begin_s:g}, {end_s:g}] s, not the frame at {outside_s:g} s"
                raise InputError(rule, "pointing")
        elif own.attitude is not None:
            with errors_at("pointing", name):
                own.attitude.at([earliest_s, latest_s])
        elif own.steps[0].start_s > earliest_s:
            first_s = own.steps[0].start_s
            what = "rows" if own.steps[0].field.startswith("rows") else "steps"
            rule = f"the {what} of {name} cover from {first_s:g} s on, not the frame at {earliest_s:g} s"
            raise InputError(rule, "pointing")
