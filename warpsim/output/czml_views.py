"""What sensors see in CZML: lines of sight during access, and the edges of fields of view."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.orbit.intervals import Intervals
from warpsim.output.czml_parts import (
    Dates,
    Piece,
    PositionFunction,
    Span,
    body_span_s,
    polyline,
    position_property,
    sampled_track,
)
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.sky.apparent import apparent_direction

FIELD_ERROR = 1e-3
"""Error of the corners within which samples are chosen, as a fraction of the field's shorter side."""

_ACCESS, _FIELD = [0, 158, 115, 220], [240, 228, 66, 150]
_FIELD_EDGES = (1, 2, 3, 4, 1, 0, 2, 3, 0, 4)  # corners, 0 the sensor: all edges of the pyramid in one line


# --- lines of sight ---


def lines_of_sight(scenario: Scenario, dates: Dates, there: Collection[str]) -> Iterator[Any]:
    """Yield packets of the lines from satellites to targets that are there and that one of their sensors has access to.

    They go to the targets that access counts by and that are on the paths of their groups; to the first where none is.
    """
    from czml3 import Packet

    for instrument in scenario.instruments.values():
        known: dict[int, Intervals] = {}
        for index, sensor in enumerate(instrument.names):
            shown_s: dict[str, list[Span]] = {}
            for (first_s, last_s), target in _counted(scenario, instrument, index):
                name = scenario.target_names[target]
                if name not in there:
                    continue
                if target not in known:
                    known[target] = instrument.access_intervals(range(len(instrument.names)), [target])
                span_s = body_span_s(scenario, name)
                within_s = max(first_s, span_s[0]), min(last_s, span_s[1])
                shown_s.setdefault(name, []).extend(within(known[target], index, within_s))
            for name, spans_s in shown_s.items():
                if spans_s:
                    ends = [f"{instrument.satellite_names[index]}#position", f"{name}#position"]
                    line = polyline(ends, spans_s, _ACCESS, 1.5, dates, scenario.scene.duration_s)
                    yield Packet(id=f"access/{sensor}/{name}", name=f"{sensor} sees {name}", polyline=line)


def _counted(scenario: Scenario, instrument: Instrument, index: int) -> Iterator[tuple[Span, int]]:
    """Targets at the ends of a sensor's lines of sight, with start and end times [s]."""
    steps = instrument.access_targets(index)
    ends_s = [start_s for start_s, _ in steps[1:]] + [np.inf]
    for (start_s, targets), end_s in zip(steps, ends_s, strict=True):
        leading: Sequence[int] = [target for target in targets if not scenario.targets[target].is_released]
        yield from (((start_s, end_s), target) for target in leading or targets[:1])


def within(intervals: Intervals, row: int, span_s: Span) -> list[Span]:
    """Return intervals of a row as far as they lie within a span [s]."""
    mine = intervals.row == row
    starts_s, ends_s = np.maximum(intervals.start_s[mine], span_s[0]), np.minimum(intervals.end_s[mine], span_s[1])
    spans_s = zip(starts_s.tolist(), ends_s.tolist(), strict=True)
    return [(start_s, end_s) for start_s, end_s in spans_s if start_s < end_s]


# --- fields of view ---


def fields_of_view(scenario: Scenario, dates: Dates) -> Iterator[Any]:
    """Yield packets of the fields of view of sensors that show theirs at some time: edges, and positions of corners.

    A field is shown while the sensor has access; that of a sensor that never tracks anything always.
    """
    from czml3 import Packet

    duration_s = scenario.scene.duration_s
    for instrument in scenario.instruments.values():
        for index, sensor in enumerate(instrument.names):
            span_s = _commanded_span_s(instrument, index, duration_s)
            shown_s = _shown_s(instrument, index, span_s)
            if not shown_s:
                continue
            pieces, name = _corners(scenario, instrument, index, span_s), f"field/{sensor}"
            first, last = dates(span_s)
            points = [f"{instrument.satellite_names[index]}#position", *(f"{name}/{k}#position" for k in (1, 2, 3, 4))]
            edges = polyline([points[k] for k in _FIELD_EDGES], shown_s, _FIELD, 1.0, dates, duration_s)
            yield Packet(id=name, name=f"field of view of {sensor}", polyline=edges)
            for k in range(4):
                yield Packet(
                    id=f"{name}/{k + 1}",
                    name=f"corner {k + 1} of the field of view of {sensor}",
                    parent=name,
                    availability={"start": first, "end": last},
                    position=position_property([(time_s, m[:, 3 * k : 3 * k + 3]) for time_s, m in pieces], dates),
                )


def _commanded_span_s(instrument: Instrument, index: int, duration_s: float) -> Span:
    """Span of the scene in which the sensor's pointing is commanded [s]; empty if the start is not before its end."""
    program = instrument.program.sensors[index]
    first_s, last_s = program.steps[0].start_s, duration_s
    if program.scan is not None:
        first_s, last_s = float(program.scan.time_s[0]), float(program.scan.time_s[-1])
    if program.attitude is not None:
        first_s, last_s = program.attitude.span_s
    return max(first_s, 0.0), min(last_s, duration_s)


def _shown_s(instrument: Instrument, index: int, span_s: Span) -> list[Span]:
    if span_s[0] >= span_s[1]:
        return []
    if not any(len(targets) for _, targets in instrument.program.tracked(index)):
        return [span_s]
    return within(instrument.access, index, span_s)


def _corners(scenario: Scenario, instrument: Instrument, index: int, span_s: Span) -> list[Piece]:
    """Samples of the corners of a field of view."""
    observer = instrument.observers([index])
    bodies = [instrument.satellite_names[index], *(scenario.target_names[target] for target in observer.tracked)]
    breakpoints_s = {*observer.camera_breaks_s[0], *(time for name in bodies for time in scenario.breakpoints_s[name])}
    corners_m = _corner_positions(scenario, instrument, index)
    reach_m = float(_reach_m(scenario, instrument, index, np.array(span_s)).min())
    error_m = FIELD_ERROR * reach_m * np.radians(min(instrument.sensor.camera.field_deg))
    pieces, _ = sampled_track(corners_m, span_s, sorted(breakpoints_s), largest_error_m=error_m, may_jump=True)
    return pieces


def _corner_positions(scenario: Scenario, instrument: Instrument, index: int) -> PositionFunction:
    """Geocentric positions of the corners of a field of view as a function of time, GCRS axes, (n, 12) [m].

    They are as far away as the sensor may observe, or else as the Earth's limb is, in the directions in which the
    camera is commanded to look, without errors of pointing; aberration is taken back.
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
