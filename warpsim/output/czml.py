"""Scenes as CZML, the format of Cesium: bodies with paths and names, lines of sight, and fields of view.

Positions are in the frame that CZML calls INERTIAL, the ICRF: its axes are those of GCRS, so the scene's numbers go in
as they are. Cesium turns them to the ground by its own Earth orientation.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from warpsim.errors import InputError
from warpsim.files import check_new_file, whole_file
from warpsim.output.czml_packets import MAIN, SATELLITE, TARGET, CzmlBody, body_packet, field_packets, line_packet
from warpsim.output.czml_samples import DATE_S, Piece, sampled_track
from warpsim.output.czml_views import fields_of_view, lines_of_sight
from warpsim.output.dates import utc_dates
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

MOST_SAMPLES = 2_000_000
"""Of all bodies together: some 100 MB of text."""

_DOCUMENT = "document"


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
    bodies = []
    largest_m = 0.0
    for body, error_m in _bodies(scenario, step_s):
        bodies.append(body)
        largest_m = max(largest_m, error_m)
    document = _document(scenario, bodies)
    with whole_file(path) as partial:
        document.save(partial, indent=None)
    return largest_m


def body_span_s(scenario: Scenario, name: str) -> tuple[float, float]:
    """Return start and end of a body's existence within the scene [s after the epoch].

    Satellites are there throughout, targets while they exist and are deployed. The first is not before the last where
    that is never.

    Args:
        scenario: The scenario.
        name: Name of a satellite or target.
    """
    duration_s = scenario.scene.duration_s
    if name in scenario.satellite_names:
        return 0.0, duration_s
    target = scenario.targets[scenario.target_names.index(name)]
    return max(0.0, target.exists_s[0], target.release_s), min(duration_s, target.exists_s[1])


def _bodies(scenario: Scenario, step_s: float | None) -> Iterator[tuple[CzmlBody, float]]:
    """The satellites and targets that are there at some time, and the errors of interpolating between samples [m]."""
    sensors = dict.fromkeys(scenario.satellite_names, "")
    for instrument in scenario.instruments.values():
        for name, satellite in zip(instrument.names, instrument.satellite_names, strict=True):
            sensors[satellite] += f", {name}" if name != satellite else ""
    for name, carried in sensors.items():
        pieces, error_m = _track(scenario, name, step_s)
        yield CzmlBody(name, f"satellite{carried}", pieces, body_span_s(scenario, name), SATELLITE, True, 1), error_m
    for target in scenario.targets:
        first_s, last_s = body_span_s(scenario, target.name)
        if last_s - first_s < 2 * DATE_S:
            continue  # never deployed
        pieces, error_m = _track(scenario, target.name, step_s)
        colour = TARGET if target.is_released else MAIN
        description, is_named = f"target, {target.spec.shape.kind}", not target.is_released
        yield CzmlBody(target.name, description, pieces, (first_s, last_s), colour, is_named, 2), error_m


def _track(scenario: Scenario, name: str, step_s: float | None) -> tuple[list[Piece], float]:
    """Samples of a body while it is there, and their error [m]."""
    position_m = functools.partial(scenario.position_m, name)
    try:
        return sampled_track(position_m, body_span_s(scenario, name), scenario.breakpoints_s[name], step_s)
    except InputError as error:
        raise error.of(name) from None


def _document(scenario: Scenario, bodies: list[CzmlBody]) -> Any:
    """The document: clock, satellites, targets, lines of sight, fields of view."""
    from czml3 import CZML_VERSION, Document, Packet
    from czml3.enums import ClockRanges, ClockSteps
    from czml3.properties import Clock
    from czml3.types import IntervalValue

    scene, dates = scenario.scene, functools.partial(czml_dates, scenario.scene.epoch_utc)
    start, end = dates([0.0, scene.duration_s])
    clock = Clock(
        currentTime=start, multiplier=10, range=ClockRanges.LOOP_STOP, step=ClockSteps.SYSTEM_CLOCK_MULTIPLIER
    )
    packets = [
        Packet(id=_DOCUMENT, name=scene.name, version=CZML_VERSION,
               description=scene.description or "A scene of warpsim.",
               clock=IntervalValue(start=start, end=end, value=clock))
    ]  # fmt: skip
    packets += [body_packet(body, dates, scene.duration_s) for body in bodies]
    lines = lines_of_sight(scenario, {body.name: body.span_s for body in bodies})
    packets += [line_packet(line, dates, scene.duration_s) for line in lines]
    for field in fields_of_view(scenario):
        packets += field_packets(field, dates, scene.duration_s)
    return Document(packets=packets)


def czml_dates(epoch_utc: str, time_s: Sequence[float]) -> list[str]:
    """Return instants as ISO 8601 UTC, to the microsecond; those within a leap second become the second after it.

    Args:
        epoch_utc: The scene's epoch.
        time_s: Times [s after the epoch], shape (n,).
    """
    texts = [str(text) for text in utc_dates(epoch_utc, time_s)]
    midnights = [f"{np.datetime64(text[:10]) + 1}T00:00:00.000000" for text in texts]
    return [f"{midnight if ':60' in text else text}Z" for text, midnight in zip(texts, midnights, strict=True)]
