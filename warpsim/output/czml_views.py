"""Views of sensors in CZML: their lines of sight and fields of view, and when these are shown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.orbit.intervals import Intervals
from warpsim.output.czml_samples import Piece, PositionFunction, sampled_track
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.sky.apparent import apparent_direction

F64 = NDArray[np.float64]

FIELD_ERROR = 1e-3
"""Error of the corners within which samples are chosen, as a fraction of the field's shorter side."""


Span = tuple[float, float]
"""Start and end [s after the epoch]."""


@dataclass(frozen=True)
class LineOfSight:
    """A line from a satellite to a target, shown while a sensor has access to it."""

    sensor: str
    satellite: str
    target: str
    shown_s: list[Span]


def lines_of_sight(scenario: Scenario, spans_s: Mapping[str, Span]) -> list[LineOfSight]:
    """Return the lines from satellites to targets that one of their sensors has access to at some time.

    They go to the targets that access counts by and that are on the paths of their groups; to the first where none is.

    Args:
        scenario: The scenario.
        spans_s: When each target is there; others have no lines.
    """
    found = []
    for instrument in scenario.instruments.values():
        known: dict[int, Intervals] = {}
        for index, sensor in enumerate(instrument.names):
            shown_s: dict[str, list[Span]] = {}
            for (first_s, last_s), target in _counted(scenario, instrument, index):
                name = scenario.target_names[target]
                if name not in spans_s:
                    continue
                if target not in known:
                    known[target] = instrument.access_intervals(range(len(instrument.names)), [target])
                there_s = max(first_s, spans_s[name][0]), min(last_s, spans_s[name][1])
                shown_s.setdefault(name, []).extend(_within(known[target], index, there_s))
            satellite = instrument.satellite_names[index]
            found += [LineOfSight(sensor, satellite, name, own_s) for name, own_s in shown_s.items() if own_s]
    return found


def _counted(scenario: Scenario, instrument: Instrument, index: int) -> Iterator[tuple[Span, int]]:
    """Targets at the ends of a sensor's lines of sight, with start and end times [s]."""
    steps = instrument.access_targets(index)
    ends_s = [start_s for start_s, _ in steps[1:]] + [np.inf]
    for (start_s, targets), end_s in zip(steps, ends_s, strict=True):
        leading: Sequence[int] = [target for target in targets if not scenario.targets[target].is_released]
        yield from (((start_s, end_s), target) for target in leading or targets[:1])


def _within(intervals: Intervals, row: int, span_s: Span) -> list[Span]:
    """Intervals of a row as far as they lie within a span [s]."""
    mine = intervals.row == row
    starts_s, ends_s = np.maximum(intervals.start_s[mine], span_s[0]), np.minimum(intervals.end_s[mine], span_s[1])
    spans_s = zip(starts_s.tolist(), ends_s.tolist(), strict=True)
    return [(start_s, end_s) for start_s, end_s in spans_s if start_s < end_s]


@dataclass(frozen=True)
class FieldOfView:
    """The field of view of one sensor."""

    sensor: str
    satellite: str
    corners: list[Piece]
    """Positions of its four corners, one after the other around the field."""
    span_s: Span
    """From when to when they are known [s after the epoch]."""
    shown_s: list[Span]
    """When it is shown [s after the epoch]."""


def fields_of_view(scenario: Scenario) -> list[FieldOfView]:
    """Return the fields of view of the sensors that show theirs at some time.

    A field is shown while the sensor has access; that of a sensor that never tracks anything always.
    """
    found = []
    for instrument in scenario.instruments.values():
        for index, name in enumerate(instrument.names):
            span_s = _commanded_span_s(instrument, index, scenario.scene.duration_s)
            shown_s = _shown_s(instrument, index, span_s)
            if shown_s:
                corners = _corners(scenario, instrument, index, span_s)
                found.append(FieldOfView(name, instrument.satellite_names[index], corners, span_s, shown_s))
    return found


def _commanded_span_s(instrument: Instrument, index: int, duration_s: float) -> Span:
    """Span of the scene in which the sensor's pointing is commanded [s]; empty if the start is not before its end."""
    program = instrument.program.sensors[index]
    first_s, last_s = program.steps[0].start_s, duration_s
    if program.scan is not None:
        first_s, last_s = float(program.scan.time_s[0]), float(program.scan.time_s[-1])
    return max(first_s, 0.0), min(last_s, duration_s)


def _shown_s(instrument: Instrument, index: int, span_s: Span) -> list[Span]:
    """Spans in which the field of view of a sensor is shown [s]."""
    if span_s[0] >= span_s[1]:
        return []
    if not any(len(targets) for _, targets in instrument.program.tracked(index)):
        return [span_s]
    return _within(instrument.access, index, span_s)


def _corners(scenario: Scenario, instrument: Instrument, index: int, span_s: Span) -> list[Piece]:
    """Samples of the corners of a field of view."""
    observer = instrument.observers([index])
    bodies = [instrument.satellite_names[index], *(scenario.target_names[target] for target in observer.tracked)]
    breakpoints_s = {*observer.camera_breaks_s[0], *(time for name in bodies for time in scenario.breakpoints_s[name])}
    corners_m = corner_positions(scenario, instrument, index)
    reach_m = float(_reach_m(scenario, instrument, index, np.array(span_s)).min())
    error_m = FIELD_ERROR * reach_m * np.radians(min(instrument.sensor.camera.field_deg))
    pieces, _ = sampled_track(corners_m, span_s, sorted(breakpoints_s), largest_error_m=error_m, may_jump=True)
    return pieces


def corner_positions(scenario: Scenario, instrument: Instrument, index: int) -> PositionFunction:
    """Return geocentric positions of the corners of a field of view as a function of time, GCRS axes, (n, 12) [m].

    They are as far away as the sensor may observe, or else as the Earth's limb is, in the directions in which the
    camera is commanded to look, without errors of pointing; aberration is taken back.

    Args:
        scenario: The scenario.
        instrument: The kind of the sensor.
        index: Index of the sensor.
    """
    camera = instrument.sensor.camera
    right, bottom = camera.n_col - 0.5, camera.n_row - 0.5
    corners = camera.direction([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])

    def position_m(time_s: F64) -> F64:
        satellite_m, velocity_m_s = scenario.tracks.state(instrument.satellite_names[index], time_s)
        seen = corners @ instrument.commanded_axes(index, time_s).axes  # (n, 4, 3)
        velocities = np.repeat(velocity_m_s, len(corners), axis=0)
        direction = apparent_direction(seen.reshape(-1, 3), -velocities).reshape(seen.shape)
        reach_m = _reach_m(scenario, instrument, index, time_s)
        return np.asarray((satellite_m[:, None] + reach_m[:, None, None] * direction).reshape(len(time_s), -1))

    return position_m


def _reach_m(scenario: Scenario, instrument: Instrument, index: int, time_s: F64) -> F64:
    """Length of a drawn field of view [m], shape (n,)."""
    farthest_km = instrument.access_rules.max_range_km
    if farthest_km is not None:
        return np.full(time_s.shape, 1e3 * farthest_km)
    satellite_m = scenario.position_m(instrument.satellite_names[index], time_s)
    beyond_m2 = np.sum(satellite_m**2, axis=-1) - EARTH_EQUATORIAL_RADIUS_M**2
    return np.asarray(np.sqrt(np.maximum(beyond_m2, 0.0)))
