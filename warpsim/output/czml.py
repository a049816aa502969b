"""Scenes as CZML, the format of Cesium: bodies with paths and names, lines of sight, and fields of view.

Positions are in the frame that CZML calls INERTIAL, the ICRF: its axes are those of GCRS, so the scene's numbers go in
as they are. Cesium turns them to the ground by its own Earth orientation.
"""

from __future__ import annotations

import functools
import html
import importlib.util
import math
import os
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M
from warpsim.errors import InputError, printable_lines
from warpsim.files import check_new_file, whole_file
from warpsim.instant import utc_dates
from warpsim.orbit.intervals import Intervals
from warpsim.output.czml_samples import DATE_S, DEGREE, Piece, PositionFunction, sampled_track
from warpsim.scene.instrument import Instrument
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of
from warpsim.sky.apparent import apparent_direction

F64 = NDArray[np.float64]

Span = tuple[float, float]
"""Start and end [s after the epoch]."""
Dates = Callable[[Sequence[float]], list[str]]
"""Times [s after the epoch] to dates in ISO 8601, UTC."""

MOST_SAMPLES = 2_000_000
"""Of all bodies together: some 100 MB of text."""

FIELD_ERROR = 1e-3
"""Error of the corners within which samples are chosen, as a fraction of the field's shorter side."""

_DOCUMENT = "document"
_SATELLITE, _TARGET, _MAIN = [86, 180, 233, 255], [230, 159, 0, 255], [213, 94, 0, 255]
_ACCESS, _FIELD = [0, 158, 115, 220], [240, 228, 66, 150]
_LABEL_OFFSET_PX = [8.0, -8.0]
_FIELD_EDGES = (1, 2, 3, 4, 1, 0, 2, 3, 0, 4)  # corners, 0 the sensor: all edges of the pyramid in one line


def write_czml(
    scene: Scene | Scenario, path: str | os.PathLike[str], step_s: float | None = None, overwrite: bool = False
) -> float:
    """Write a scene as CZML, whole or not at all.

    Every satellite and target is a packet with sampled positions, a point, a name and a path: satellites are available
    during the scene, targets while they exist and are deployed. A line joins a satellite to a target while one of its
    sensors has access to it: to the targets that access counts by and that are on the paths of their groups. The edges
    of a sensor's field of view show while it has access, and always if it tracks nothing.

    Args:
        scene: The scene.
        path: File to write, .czml.
        step_s: Time between samples of bodies [s]; if left out, the longest of 300, 150, ... s that keeps each body
            within 0.1 m.
        overwrite: Whether an existing file is replaced.

    Returns:
        How far the bodies' positions, interpolated as Cesium does, are from the scene's at most [m], measured at eight
        times or more from one sample to the next, before and after every breakpoint, and densely about the largest.

    Raises:
        InputError: The path cannot be written, the step is bad, a body jumps, or the package czml3 (the extra `czml`)
            is not installed.
    """
    scenario, path = scenario_of(scene), Path(path)
    check_new_file(path, (".czml",), overwrite)
    if importlib.util.find_spec("czml3") is None:
        raise InputError("needs czml3, which the extra `czml` brings: pip install 'warpsim[czml]'", "czml")
    if step_s is not None and not (math.isfinite(step_s) and step_s > 0):
        raise InputError("must be > 0", "step_s", step_s, "g")
    names, duration_s = [*scenario.satellite_names, *scenario.target_names], scenario.scene.duration_s
    if _DOCUMENT in names:
        raise InputError("is the name of the first packet of a CZML file, so no body may have it").of(_DOCUMENT)
    if step_s is not None and len(names) * duration_s / step_s > MOST_SAMPLES:
        raise InputError(
            f"{step_s:g} s give more than {MOST_SAMPLES} positions for {len(names)} bodies over {duration_s:g} s",
            "step_s",
        )
    from czml3 import Document

    dates = functools.partial(czml_dates, scenario.scene.epoch_utc)
    bodies, errors_m = zip(*_bodies(scenario, dates, step_s), strict=True)
    there = {str(body.id) for body in bodies}
    packets = [
        _clock_packet(scenario, dates), *bodies, *_lines_of_sight(scenario, dates, there),
        *_fields_of_view(scenario, dates),
    ]  # fmt: skip
    with whole_file(path) as partial:
        Document(packets=packets).save(partial, indent=None)
    return float(max(errors_m))


def _clock_packet(scenario: Scenario, dates: Dates) -> Any:
    """The first packet: name, version and clock."""
    from czml3 import CZML_VERSION, Packet
    from czml3.enums import ClockRanges, ClockSteps
    from czml3.properties import Clock
    from czml3.types import IntervalValue

    scene = scenario.scene
    start, end = dates([0.0, scene.duration_s])
    clock = Clock(
        currentTime=start, multiplier=10, range=ClockRanges.LOOP_STOP, step=ClockSteps.SYSTEM_CLOCK_MULTIPLIER
    )
    description = html.escape(printable_lines(scene.description)) or "A scene of warpsim."
    return Packet(
        id=_DOCUMENT, name=scene.name, version=CZML_VERSION, description=description,
        clock=IntervalValue(start=start, end=end, value=clock),
    )  # fmt: skip


def czml_dates(epoch_utc: str, time_s: Sequence[float]) -> list[str]:
    """Return instants as ISO 8601 UTC, to the microsecond; those within a leap second become the second after it."""
    texts = [str(text) for text in utc_dates(epoch_utc, time_s)]
    midnights = [f"{np.datetime64(text[:10]) + 1}T00:00:00.000000" for text in texts]
    return [f"{midnight if ':60' in text else text}Z" for text, midnight in zip(texts, midnights, strict=True)]


# --- bodies ---


def _bodies(scenario: Scenario, dates: Dates, step_s: float | None) -> Iterator[tuple[Any, float]]:
    """Packets of the satellites and targets that are there, and the errors of interpolating between samples [m]."""
    sensors = dict.fromkeys(scenario.satellite_names, "")
    for instrument in scenario.instruments.values():
        for name, satellite in zip(instrument.names, instrument.satellite_names, strict=True):
            sensors[satellite] += f", {name}" if name != satellite else ""
    for name, carried in sensors.items():
        yield _body(scenario, dates, step_s, name, f"satellite{carried}", _SATELLITE, is_named=True)
    for target in scenario.targets:
        first_s, last_s = _body_span_s(scenario, target.name)
        if last_s - first_s >= 2 * DATE_S:  # else never deployed
            colour, is_named = (_TARGET, False) if target.is_released else (_MAIN, True)
            yield _body(scenario, dates, step_s, target.name, f"target, {target.spec.shape.kind}", colour, is_named)


def _body_span_s(scenario: Scenario, name: str) -> Span:
    """Start and end of a body's existence within the scene; the first is not before the last where that is never."""
    duration_s = scenario.scene.duration_s
    if name in scenario.satellite_names:
        return 0.0, duration_s
    target = scenario.targets[scenario.target_names.index(name)]
    return max(0.0, target.exists_s[0], target.release_s), min(duration_s, target.exists_s[1])


def _body(
    scenario: Scenario, dates: Dates, step_s: float | None, name: str, description: str, colour: list[int],
    is_named: bool,
) -> tuple[Any, float]:  # fmt: skip
    """The packet of a body (positions, point, name, path) and the error of its positions [m].

    Name and path show where it is named: thirty names at one point hide one another.
    """
    from czml3 import Packet
    from czml3.enums import HorizontalOrigins
    from czml3.properties import Color, Label, Path, Point
    from czml3.types import Cartesian2Value, TimeInterval

    span_s, duration_s = _body_span_s(scenario, name), scenario.scene.duration_s
    position_m = functools.partial(scenario.position_m, name)
    try:
        pieces, error_m = sampled_track(position_m, span_s, scenario.breakpoints_s[name], step_s)
    except InputError as error:
        raise error.of(name) from None
    first, last = dates(span_s)
    packet = Packet(
        id=name,
        name=name,
        description=description,
        availability=TimeInterval(start=first, end=last),
        position=_position(pieces, dates),
        point=Point(color=Color(rgba=colour), pixelSize=8 if is_named else 4, outlineWidth=0),
        label=Label(
            text=name, font="12px sans-serif", fillColor=Color(rgba=colour), show=is_named,
            horizontalOrigin=HorizontalOrigins.LEFT, pixelOffset=Cartesian2Value(values=_LABEL_OFFSET_PX),
        ),
        path=Path(
            material=_solid([*colour[:3], 140]), width=1 if colour is _SATELLITE else 2, show=is_named,
            leadTime=duration_s, trailTime=duration_s, resolution=60,
        ),
    )  # fmt: skip
    return packet, error_m


def _position(pieces: list[Piece], dates: Dates) -> Any:
    """Sampled positions; by intervals where there is more than one piece."""
    from czml3.enums import InterpolationAlgorithms, ReferenceFrames
    from czml3.properties import Position
    from czml3.types import IntervalValue, TimeIntervalCollection

    (epoch,) = dates([0.0])
    positions = [
        Position(
            epoch=epoch,
            cartesian=np.column_stack(piece).ravel().tolist(),
            referenceFrame=ReferenceFrames.INERTIAL,
            interpolationAlgorithm=InterpolationAlgorithms.LAGRANGE,
            interpolationDegree=DEGREE,
        )
        for piece in pieces
    ]
    if len(positions) == 1:
        return positions[0]
    edges = dates([pieces[0][0][0], *(time_s[-1] for time_s, _ in pieces)])
    spans = zip(edges[:-1], edges[1:], positions, strict=True)
    return TimeIntervalCollection(values=[IntervalValue(start=a, end=b, value=value) for a, b, value in spans])


def _polyline(references: list[str], shown_s: Sequence[Span], colour: list[int], width: float, dates: Dates,
              duration_s: float) -> Any:  # fmt: skip
    """A straight line through the positions of other packets, shown within some spans of the scene."""
    from czml3.enums import ArcTypes
    from czml3.properties import Polyline, PositionList
    from czml3.types import IntervalValue, TimeIntervalCollection

    spans = [(*dates([0.0, duration_s]), False), *((*dates(span_s), True) for span_s in shown_s)]
    shown = [IntervalValue(start=start, end=end, value=value) for start, end, value in spans]  # later ones win
    return Polyline(
        show=TimeIntervalCollection(values=shown),
        positions=PositionList(references=references),
        arcType=ArcTypes.NONE,
        width=width,
        material=_solid(colour),
    )


def _solid(colour: list[int]) -> Any:
    from czml3.properties import Color, PolylineMaterial, SolidColorMaterial

    return PolylineMaterial(solidColor=SolidColorMaterial(color=Color(rgba=colour)))


# --- lines of sight ---


def _lines_of_sight(scenario: Scenario, dates: Dates, there: Collection[str]) -> Iterator[Any]:
    """Packets of the lines from satellites to targets that are there and that one of their sensors has access to.

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
                span_s = _body_span_s(scenario, name)
                within_s = max(first_s, span_s[0]), min(last_s, span_s[1])
                shown_s.setdefault(name, []).extend(_within(known[target], index, within_s))
            for name, spans_s in shown_s.items():
                if spans_s:
                    ends = [f"{instrument.satellite_names[index]}#position", f"{name}#position"]
                    line = _polyline(ends, spans_s, _ACCESS, 1.5, dates, scenario.scene.duration_s)
                    yield Packet(id=f"access/{sensor}/{name}", name=f"{sensor} sees {name}", polyline=line)


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


# --- fields of view ---


def _fields_of_view(scenario: Scenario, dates: Dates) -> Iterator[Any]:
    """Packets of the fields of view of the sensors that show theirs at some time: edges, and positions of corners.

    A field is shown while the sensor has access; that of a sensor that never tracks anything always.
    """
    from czml3 import Packet
    from czml3.types import TimeInterval

    duration_s = scenario.scene.duration_s
    for instrument in scenario.instruments.values():
        for index, sensor in enumerate(instrument.names):
            span_s = _commanded_span_s(instrument, index, duration_s)
            shown_s = _shown_s(instrument, index, span_s)
            if not shown_s:
                continue
            pieces, (first, last), name = (
                _corners(scenario, instrument, index, span_s),
                dates(span_s),
                f"field/{sensor}",
            )
            points = [f"{instrument.satellite_names[index]}#position", *(f"{name}/{k}#position" for k in (1, 2, 3, 4))]
            edges = _polyline([points[k] for k in _FIELD_EDGES], shown_s, _FIELD, 1.0, dates, duration_s)
            yield Packet(id=name, name=f"field of view of {sensor}", polyline=edges)
            for k in range(4):
                yield Packet(
                    id=f"{name}/{k + 1}",
                    name=f"corner {k + 1} of the field of view of {sensor}",
                    parent=name,
                    availability=TimeInterval(start=first, end=last),
                    position=_position([(time_s, m[:, 3 * k : 3 * k + 3]) for time_s, m in pieces], dates),
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
