"""Pointing commands: somebody outside, such as a tracker, points sensors while their frames are rendered.

A command is a step of a schedule that begins at a time of its own: at the next frame, or when the camera has settled if
it slews then. It takes the place of all steps that the sensor would have begun then or later; if that is the first one
too, the camera is settled there from the beginning. So frames after it are those of a
scene whose `pointing` is that schedule, bit for bit; with an exposure to the error of paths, as how finely it is
followed has been chosen by the scene's own pointing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from warpsim.config.model import adapter, input_error
from warpsim.errors import InputError, errors_at
from warpsim.scene.instrument import Instrument
from warpsim.scene.pointing import PointingStep
from warpsim.scene.pointing_program import PointingProgram, Step, law_of, step_turn
from warpsim.scene.scenario import Scenario
from warpsim.scene.slews import NO_TURN, SlewTurn

_KEPT_STEPS = 8
"""Steps of a sensor that are kept: frames that are being rendered need the last ones before the command."""


class AppliedCommand(NamedTuple):
    """A pointing command as it was carried out."""

    sensor: str
    frame: int
    """Frame that was to be rendered next."""
    start_s: float
    """When the camera begins to turn, after the scene's epoch [s]: at that frame, or when it had settled."""
    settled_s: float
    """When it is settled there [s]."""
    step: PointingStep
    """The command as the step of a schedule, to repeat the run."""


class PointingCommand(NamedTuple):
    """A pointing command that is well-formed."""

    sensors: list[str]
    step: PointingStep
    """What they look at; its start counts for nothing."""


def checked_command(command: Any, scenario: Scenario, sensors: Sequence[str]) -> PointingCommand:
    """Return a command, its target looked up.

    Args:
        command: `sensor`, a name or pattern, and the fields of a PointingStep but `start_s`.
        scenario: What the frames are of.
        sensors: Names of the sensors that are rendered.

    Raises:
        InputError: A field is unknown, or its value not valid; no such sensor is rendered, or no such target there.
    """
    if not isinstance(command, Mapping):
        raise InputError("must be a table of fields, such as {'sensor': ..., 'track': ...}", "command", command)
    fields = {key: value for key, value in command.items() if key != "sensor"}
    if "start_s" in fields:
        raise InputError("must be left out: a command begins at the next frame", "command.start_s")
    with errors_at("command"):
        if not isinstance(command.get("sensor"), str):
            raise InputError("must name a sensor that is rendered", "sensor", command.get("sensor"))
        if not (chosen := [name for name in scenario.select_sensors(command["sensor"]) if name in sensors]):
            raise InputError("must name a sensor that is rendered", "sensor", command["sensor"])
        try:
            step = adapter(PointingStep).validate_python({"start_s": 0.0, **fields})
        except ValidationError as error:
            raise input_error(error) from None
        camera = scenario.instrument_of(chosen[0]).sensor.camera
        law_of(step, "zenith", 0.0, camera, scenario.targets, scenario.group_names)
    return PointingCommand(chosen, step)


def apply_command(
    command: PointingCommand, scenario: Scenario, instrument: Instrument, frame: int
) -> tuple[Instrument, list[AppliedCommand]]:
    """Return the instrument pointed by a command that comes before a frame is rendered, and what was done.

    Raises:
        InputError: A slew is not possible within its limits, or the camera settles after the scene's end only.
    """
    time_s = float(instrument.frame_time_s([frame])[0])
    program, turns, applied = instrument.program, {}, []
    for name in command.sensors:
        sensor = instrument.index(name)
        with errors_at("command", name):
            program, turns[sensor] = _with_step(command.step, scenario, instrument, program, sensor, time_s)
        start_s = program.sensors[sensor].steps[-1].start_s
        step = replace(command.step, start_s=start_s)
        applied.append(AppliedCommand(name, frame, start_s, start_s + turns[sensor][-1].total_s, step))
    return instrument.commanded(_without_unused_laws(program), turns), applied


def _with_step(
    step: PointingStep, scenario: Scenario, instrument: Instrument, program: PointingProgram, sensor: int, time_s: float
) -> tuple[PointingProgram, tuple[SlewTurn, ...]]:
    """The program in which a sensor goes on with a step, and the turns of that sensor."""
    own, turns, duration_s = program.sensors[sensor], instrument.turns(sensor), scenario.scene.duration_s
    n_begun = int(np.searchsorted([old.start_s for old in own.steps], time_s))
    first = max(0, n_begun - _KEPT_STEPS)
    steps, turns = own.steps[first:n_begun], (NO_TURN, *turns[first + 1 : n_begun])[:n_begun]
    start_s = max(time_s, steps[-1].start_s + turns[-1].total_s) if steps else time_s
    if start_s > duration_s:
        raise InputError(f"the camera is settled at {start_s:g} s only, after the scene's end ({duration_s:g})")
    pointing = instrument.sensor.pointing[own.entry]
    roll_deg = pointing.roll_deg + step.roll_deg
    law = law_of(step, pointing.up, roll_deg, instrument.sensor.camera, scenario.targets, scenario.group_names)
    steps = (*steps, Step(start_s, len(program.laws)))
    sensors = tuple(replace(one, steps=steps) if index == sensor else one for index, one in enumerate(program.sensors))
    program = PointingProgram((*program.laws, law), sensors)
    satellite = instrument.satellites[sensor]
    n_before = len(steps) - 1
    turn = step_turn(program, sensor, n_before, satellite, scenario.tracks, duration_s) if n_before else NO_TURN
    return program, (*turns, turn)


def _without_unused_laws(program: PointingProgram) -> PointingProgram:
    """The program with those laws only that a step has."""
    used = sorted({step.law for own in program.sensors for step in own.steps})
    number = {law: index for index, law in enumerate(used)}
    renumbered: dict[int, tuple[Step, ...]] = {}  # sensors share their steps
    for own in program.sensors:
        if id(own.steps) not in renumbered:
            renumbered[id(own.steps)] = tuple(replace(step, law=number[step.law]) for step in own.steps)
    sensors = tuple(replace(own, steps=renumbered[id(own.steps)]) for own in program.sensors)
    return PointingProgram(tuple(program.laws[law] for law in used), sensors)
