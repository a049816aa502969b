"""Instruments: a kind of sensor of a scene with its derived host data."""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from warpsim.arguments import frame_numbers
from warpsim.arrays import F64
from warpsim.detector.levels import Levels, levels
from warpsim.errors import InputError, errors_at
from warpsim.optics.psf import Psf
from warpsim.orbit.access_constraints import AccessConstraints
from warpsim.orbit.intervals import Intervals
from warpsim.radiometry.band import Band
from warpsim.scene.background_terms import Background
from warpsim.scene.bodies import SceneBodies
from warpsim.scene.camera_axes import CommandedAxes
from warpsim.scene.exposure import ExposureRule, exposure_rule
from warpsim.scene.light_terms import LightTerm, light_terms
from warpsim.scene.pointing import ANY, TRACKED
from warpsim.scene.pointing_program import (
    PointingProgram,
    check_frames,
    commanded_axes,
    entry_path,
    is_settled,
    make_program,
    slew_turns,
    tracked_targets,
)
from warpsim.scene.sensors import Sensor
from warpsim.scene.slews import SlewTurn
from warpsim.scene.target_access import ACCESS_STEP_S, Custom, Observers, can_observe, target_intervals

Mask = npt.NDArray[np.bool_]


class Instrument:
    """A kind of sensor, the satellites that carry one, and its derived data.

    Args:
        sensor: Its description.
        instances: Name of each sensor of this kind, and index of its satellite.
        bodies: The scene, and its bodies.
    """

    def __init__(self, sensor: Sensor, instances: Sequence[tuple[str, int]], bodies: SceneBodies) -> None:
        self.sensor, self._scene, self._bodies = sensor, bodies.scene, bodies
        self.names = [name for name, _ in instances]
        self.satellites = [index for _, index in instances]
        self.satellite_names = [bodies.satellite_names[index] for index in self.satellites]
        self.bands: dict[str, Band] = {name: bodies.bands[name] for name in sensor.bands}
        self.frames = sensor.frames or bodies.scene.frames
        self.access_rules = sensor.access_rules or bodies.scene.access_rules
        self._turns: dict[int, tuple[SlewTurn, ...]] = {}
        self.is_commanded = False
        """Whether its pointing has been commanded from outside while frames were rendered."""

    def __repr__(self) -> str:
        return f"Instrument({self.sensor.name}: {len(self.names)} sensors)"

    def index(self, name: str) -> int:
        """Return the index of a sensor among those of this kind.

        Raises:
            InputError: There is no such sensor.
        """
        if name not in self.index_of:
            raise InputError(f"must be a sensor of the kind {self.sensor.name}", "sensor", name)
        return self.index_of[name]

    @cached_property
    def index_of(self) -> dict[str, int]:
        """Index of each sensor by name."""
        return {name: index for index, name in enumerate(self.names)}

    def satellite_of(self, name: str) -> str:
        """Return the name of the satellite that carries a sensor; InputError if there is no such sensor."""
        return self.satellite_names[self.index(name)]

    @property
    def background(self) -> Background:
        """What lies behind stars and targets, with the image of this kind of sensor."""
        background = self._scene.background
        if background.image is None:
            return background
        return replace(background, image=background.image.replace("{kind}", self.sensor.name))

    @property
    def noise_seed(self) -> int:
        """Seed of the detectors' noise."""
        scene = self._scene
        return scene.seed if scene.noise_seed is None else scene.noise_seed

    @property
    def slews(self) -> bool:
        """Return whether a camera slews from step to step."""
        return any(program.slew is not None for program in self.program.sensors)

    def frame_time_s(self, frames: Sequence[int] | npt.NDArray[np.int64]) -> F64:
        """Return times of frames after the epoch [s], shape (n,)."""
        return self.frames.start_s + frame_numbers(frames).astype(np.float64) * self.frames.interval_s

    @cached_property
    def levels(self) -> dict[str, Levels]:
        """The detector's noise, saturation and gain in each band, as irradiance and counts."""
        sensor = self.sensor
        return {name: levels(sensor.detector, sensor.optics, sensor.camera, band) for name, band in self.bands.items()}

    def nei_w_cm2(self, band: str) -> float:
        """Return the noise equivalent irradiance of a pixel in a band [W/cm2]."""
        return self.levels[band].nei_w_cm2

    def sei_w_cm2(self, band: str) -> float:
        """Return the saturation equivalent irradiance of a pixel in a band [W/cm2]."""
        return self.levels[band].sei_w_cm2

    def psf(self, band: str) -> Psf:
        """Return the point spread function in a band: the telescope's, its jitter's and the detector's together.

        Raises:
            InputError: Its file cannot be read.
        """
        return self.sensor.optics.psf_for(self.bands[band], self.sensor.camera, self.sensor.detector.diffusion_px)

    def noise_key(self, sensor: int) -> int:
        """Return the 64-bit key of a sensor's noise: no other sensor, and no scene of another name or seed, has it."""
        return _key("noise", self.noise_seed, self._scene.name, self.satellite_names[sensor], self.sensor.name)

    def pointing_key(self, sensor: int) -> int:
        """Return the 64-bit key of the random errors of a sensor's pointing."""
        return _key("pointing", self._scene.seed, self.satellite_names[sensor], self.sensor.name)

    @cached_property
    def program(self) -> PointingProgram:
        """Pointing program of the sensors.

        Raises:
            InputError: A target or sensor is not there, or a table cannot be read; the path begins with `pointing`.
        """
        sensors = list(zip(self.names, self.satellite_names, strict=True))
        bodies, sensor = self._bodies, self.sensor
        return make_program(
            sensor.pointing, sensors, sensor.camera, bodies.targets, bodies.group_names, bodies.body_names,
            bodies.epoch,
        )  # fmt: skip

    def commanded(self, program: PointingProgram, turns: Mapping[int, tuple[SlewTurn, ...]]) -> Instrument:
        """Return the same sensors with another pointing program, and the slews of those whose steps it has changed."""
        other = copy.copy(self)
        for name in ("access", "_access_rows"):  # they follow from the pointing
            other.__dict__.pop(name, None)
        other.__dict__["program"] = program
        other._turns = {**self._turns, **turns}
        other.is_commanded = True
        return other

    def check_frames(self, time_s: F64) -> None:
        """Check that the commanded pointing covers the times of frames; InputError where it does not."""
        check_frames(self.program, self.names, time_s)

    def turns(self, sensor: int) -> tuple[SlewTurn, ...]:
        """Return the slews of a sensor, one for each step of its program.

        Raises:
            InputError: One cannot be made in time.
        """
        if sensor not in self._turns:
            satellite, scene = self.satellites[sensor], self._scene
            path = entry_path(self.program.sensors[sensor].entry, len(self.sensor.pointing))
            with errors_at("", self.names[sensor]), errors_at(path):
                self._turns[sensor] = slew_turns(self.program, sensor, satellite, self._bodies.tracks, scene.duration_s)
        return self._turns[sensor]

    def commanded_axes(self, sensor: int, time_s: F64, since_middle_s: npt.ArrayLike = 0.0) -> CommandedAxes:
        """Return the axes that a sensor is commanded to take.

        Args:
            sensor: Index of the sensor.
            time_s: After the epoch [s], shape (n,).
            since_middle_s: After the middle of the exposure that the time belongs to [s], (n,).
        """
        tracks, satellite = self._bodies.tracks, self.satellites[sensor]
        return commanded_axes(self.program, sensor, satellite, tracks, self.turns(sensor), time_s, since_middle_s)

    def settled(self, sensor: int, time_s: F64) -> Mask:
        """Return whether a sensor's camera neither slews nor settles at times, shape (n,)."""
        return is_settled(self.program, sensor, self.turns(sensor), time_s)

    @cached_property
    def light_terms(self) -> dict[str, LightTerm]:
        """Terms of the targets' reflected light (sun, earth, albedo): presence, upper bound and reason."""
        nei_w_cm2 = {band: self.nei_w_cm2(name) for name, band in self.bands.items()}
        bodies = self._bodies
        return light_terms(self._scene.lighting, bodies.tracks, bodies.targets, self.satellites, nei_w_cm2)

    @cached_property
    def exposure_rule(self) -> ExposureRule:
        """Quadrature over the exposure.

        Raises:
            InputError: Targets turn too often within it.
        """
        bodies, error = self._bodies, self._scene.lighting.quadrature_error
        detector = self.sensor.detector
        return exposure_rule(detector, bodies.targets, bodies.attitudes, self._scene.duration_s, error)

    def state(self, sensor: str, time_s: npt.ArrayLike) -> tuple[F64, F64]:
        """Return geocentric position [m] and velocity [m/s] of a sensor, GCRS axes, each of the times' shape plus (3,).

        Raises:
            InputError: There is no such sensor, or a time is outside the tracks.
        """
        return self._bodies.tracks.state(self.satellite_of(sensor), time_s)

    def observers(self, sensors: Sequence[int]) -> Observers:
        """Return some of the sensors as observers for access."""
        chosen = list(sensors)
        tracked = sorted({target for sensor in chosen for _, some in self.program.tracked(sensor) for target in some})

        def breaks_s(sensor: int) -> list[float]:
            program = self.program.sensors[sensor]
            if program.slew is None:
                return self.program.breaks_s(sensor)
            ends = [step.start_s + turn.total_s for step, turn in zip(program.steps, self.turns(sensor), strict=True)]
            return sorted({*self.program.breaks_s(sensor), *(end for end in ends if np.isfinite(end))})

        return Observers(
            tuple(self.satellites[sensor] for sensor in chosen),
            self.sensor.camera,
            lambda index, time_s: self.commanded_axes(chosen[index], time_s).axes,
            [breaks_s(sensor) for sensor in chosen],
            tuple(tracked),
        )

    def access_targets(self, sensor: int) -> list[tuple[float, tuple[int, ...]]]:
        """Return the targets that a sensor's access counts by and their start times [s]: any of them makes access.

        What is tracked is a target, or a group by its main target; where nothing is tracked, the main targets of all
        groups count. All targets on orbits of their own are main targets.
        """
        targets, requested = self._bodies.targets, self._scene.access_target
        if requested == ANY:
            return [(-np.inf, tuple(range(len(targets))))]
        if requested != TRACKED:
            return [(-np.inf, tuple(tracked_targets(requested, targets, self._bodies.group_names)))]
        counted: list[tuple[float, tuple[int, ...]]] = []
        for start_s, tracked in self.program.tracked(sensor):
            some = tracked or range(len(targets))
            main = some if len(some) == 1 else [index for index in some if not targets[index].is_released]
            counted.append((start_s, tuple(main)))
        return counted

    @cached_property
    def access(self) -> Intervals:
        """Intervals of access of each sensor; rows are indices of sensors."""
        return self.access_intervals(range(len(self.names)))

    @cached_property
    def _access_rows(self) -> dict[int, list[int]]:
        """Rows of `access` of each sensor that has some."""
        rows: dict[int, list[int]] = {}
        for row, sensor in enumerate(self.access.row.tolist()):
            rows.setdefault(sensor, []).append(row)
        return rows

    def access_intervals(
        self,
        sensors: Sequence[int],
        targets: Sequence[int] | None = None,
        rules: AccessConstraints | None = None,
        custom: Custom | None = None,
        step_s: float = ACCESS_STEP_S,
    ) -> Intervals:
        """Return the intervals in which some sensors can observe targets.

        Args:
            sensors: Indices of the sensors.
            targets: Indices of the targets, any of which makes access; what access counts by when left out.
            rules: Constraints instead of the sensor's.
            custom: Further constraints by name.
            step_s: Step of the scan [s].

        Returns:
            Intervals whose rows are indices among `sensors`.
        """
        alike: dict[tuple[tuple[float, Sequence[int]], ...], list[int]] = {}
        for row, sensor in enumerate(sensors):
            own = tuple(self.access_targets(sensor)) if targets is None else ((-np.inf, tuple(targets)),)
            alike.setdefault(own, []).append(row)
        found = []
        for counted, rows in alike.items():
            observers = self.observers([sensors[row] for row in rows])
            seen = self._seen(observers, counted, rules or self.access_rules, custom, step_s)
            found.append(Intervals(np.array(rows)[seen.row], seen.start_s, seen.end_s))
        joined = Intervals.union(found)
        if any(self.program.sensors[sensor].slew is not None for sensor in sensors):
            joined = joined.intersection(self._settled_intervals(sensors))
        return joined

    def _seen(
        self,
        observers: Observers,
        requested: Sequence[tuple[float, Sequence[int]]],
        rules: AccessConstraints,
        custom: Custom | None,
        step_s: float,
    ) -> Intervals:
        """Intervals in which sensors see any of the targets requested at the time."""
        bodies, duration_s, n_sensor = self._bodies, self._scene.duration_s, len(observers.satellites)
        found = []
        ends = [start_s for start_s, _ in requested[1:]] + [duration_s]
        for (start_s, some), end_s in zip(requested, ends, strict=True):
            begin_s, stop_s = max(start_s, 0.0), min(end_s, duration_s)
            if begin_s >= stop_s:
                continue
            seen = [
                target_intervals(
                    bodies.tracks, observers, target, rules, bodies.breakpoints_s, duration_s, custom, step_s
                )
                for target in some
            ]
            one = seen[0] if len(seen) == 1 else Intervals.union(seen)
            whole = begin_s == 0.0 and stop_s == duration_s
            found.append(one if whole else one.intersection(Intervals.whole(n_sensor, begin_s, stop_s)))
        return found[0] if len(found) == 1 else Intervals.union(found)

    def _settled_intervals(self, sensors: Sequence[int]) -> Intervals:
        """Intervals in which each of some sensors is settled."""
        found: list[tuple[int, float, float]] = []
        for row, sensor in enumerate(sensors):
            begin_s = 0.0
            for step, turn in zip(self.program.sensors[sensor].steps, self.turns(sensor), strict=True):
                if turn.total_s > 0.0:
                    found.append((row, begin_s, step.start_s))
                    begin_s = step.start_s + turn.total_s
            if begin_s < self._scene.duration_s:
                found.append((row, begin_s, self._scene.duration_s))
        rows, starts, ends = zip(*found, strict=True) if found else ((), (), ())
        return Intervals(np.array(rows, dtype=np.int64), np.array(starts, float), np.array(ends, float))

    def has_access(self, sensor: int, time_s: F64) -> Mask:
        """Return whether a sensor has access at given times, shape (n,)."""
        seen = np.zeros(time_s.shape, dtype=bool)
        mine = self._access_rows.get(sensor, [])
        for start_s, end_s in zip(self.access.start_s[mine], self.access.end_s[mine], strict=True):
            seen |= (time_s >= start_s) & (time_s <= end_s)
        return seen & self.settled(sensor, time_s)

    @property
    def sensors_with_access(self) -> list[str]:
        """Names of the sensors that have access at some time."""
        seen = set(self.access.row.tolist())
        return [name for index, name in enumerate(self.names) if index in seen]

    def can_observe(self, sensors: Sequence[int], time_s: F64) -> Mask:
        """Return whether sensors can observe each target at times, (n_time, n_sensor, n_target)."""
        seen = can_observe(self._bodies.tracks, self.observers(sensors), self.access_rules, time_s)
        for column, sensor in enumerate(sensors):
            if self.program.sensors[sensor].slew is not None:
                seen[:, column] &= self.settled(sensor, time_s)[:, None]
        return seen


def _key(purpose: str, *facts: object) -> int:
    """64-bit hash of some facts."""
    text = "\0".join([purpose, *map(str, facts)])
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")
