"""Scenes as CZML, the format of Cesium: bodies with paths and names, lines of sight, and fields of view.

Positions are in the frame that CZML calls INERTIAL, the ICRF: its axes are those of GCRS, so the scene's numbers go in
as they are. Cesium turns them to the ground by its own Earth orientation. Attitudes of targets and curves of their
light are there where they are asked for.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import os
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Any

from warpsim.arguments import chosen_names
from warpsim.errors import InputError, printable_lines
from warpsim.files import check_new_file, whole_file
from warpsim.output.czml_page import checked_cesium, write_page
from warpsim.output.czml_parts import (
    DATE_S,
    MOST_SAMPLES,
    Dates,
    body_span_s,
    czml_dates,
    position_property,
    sampled_track,
    solid,
)
from warpsim.output.czml_targets import light_properties, orientations
from warpsim.output.czml_views import fields_of_view, lines_of_sight
from warpsim.scene.scenario import Scenario
from warpsim.scene.scene import Scene, scenario_of

_DOCUMENT = "document"
_SATELLITE, _TARGET, _MAIN = [86, 180, 233, 255], [230, 159, 0, 255], [213, 94, 0, 255]
_LABEL_OFFSET_PX = [8.0, -8.0]


def write_czml(
    scene: Scene | Scenario,
    path: str | os.PathLike[str],
    step_s: float | None = None,
    overwrite: bool = False,
    attitudes: str | Sequence[str] | None = None,
    curves: str | Sequence[str] | None = None,
    html: str | os.PathLike[str] | None = None,
    cesium: str | os.PathLike[str] | None = None,
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
        overwrite: Whether existing files are replaced.
        attitudes: Names of the targets whose attitudes are written and that are drawn as solids, or "all": rotations
            from body to Earth-fixed axes, (x, y, z, w), so dense that Cesium is within 0.2 degrees between them.
        curves: Names of the targets whose light is written, or "all": irradiance at the pupil [W/cm2] by sensor and
            band, as `light_curves` has it, at the frames during access, as properties "irradiance_w_cm2/SENSOR/BAND".
        html: A page to write beside it, .html, that opens the file in CesiumJS.
        cesium: Where the page finds CesiumJS: a URL or a folder that holds Cesium.js. Without, the page says how to
            give it, and loads nothing.

    Returns:
        How far the bodies' positions, interpolated as Cesium does, are from the scene's at most [m], measured at eight
        times or more from one sample to the next, before and after every breakpoint, and densely about the largest.

    Raises:
        InputError: A file cannot be written, the step is bad, a body jumps, a target is unknown, attitudes or curves
            would take more than 2,000,000 samples, there is no CesiumJS in the folder, or the package czml3 (the extra
            `czml`) is not installed.
    """
    scenario, path = scenario_of(scene), Path(path)
    check_new_file(path, (".czml",), overwrite)
    base = checked_cesium(None if html is None else Path(html), cesium, overwrite)
    _check(scenario, step_s)
    with_attitudes, with_curves = _chosen("attitudes", attitudes, scenario), _chosen("curves", curves, scenario)
    from czml3 import Document

    dates = functools.partial(czml_dates, scenario.scene.epoch_utc)
    more = _more_of_targets(scenario, dates, with_attitudes, with_curves)
    bodies, errors_m = zip(*_bodies(scenario, dates, step_s, more), strict=True)
    there = {str(body.id) for body in bodies}
    packets = [
        _clock_packet(scenario, dates), *bodies, *lines_of_sight(scenario, dates, there),
        *fields_of_view(scenario, dates),
    ]  # fmt: skip
    with whole_file(path) as partial:
        Document(packets=packets).save(partial, indent=None)
    if html is not None:
        write_page(Path(html), path, base, scenario.scene.name)
    return float(max(errors_m))


def _check(scenario: Scenario, step_s: float | None) -> None:
    """Check that czml3 is there, the step, and the names of the bodies."""
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


def _chosen(what: str, names: str | Sequence[str] | None, scenario: Scenario) -> list[str]:
    """Names of the chosen targets that are there at some time."""
    if names is None:
        return []
    chosen = chosen_names(what, None if isinstance(names, str) and names == "all" else names, scenario.target_names)
    return [name for name in dict.fromkeys(chosen) if _is_there(scenario, name)]


def _is_there(scenario: Scenario, name: str) -> bool:
    first_s, last_s = body_span_s(scenario, name)
    return last_s - first_s >= 2 * DATE_S


def _more_of_targets(
    scenario: Scenario, dates: Dates, with_attitudes: Sequence[str], with_curves: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """What packets of targets have besides, by name: orientation and solid, curves as properties."""
    more: dict[str, dict[str, Any]] = {name: {} for name in (*with_attitudes, *with_curves)}
    colours = {target.name: _TARGET if target.is_released else _MAIN for target in scenario.targets}
    for name, fields in orientations(scenario, dates, with_attitudes, colours):
        more[name] |= fields
    if with_curves:
        for name, properties in light_properties(scenario, dates, with_curves).items():
            more[name] |= {"properties": properties}
    return more


def _clock_packet(scenario: Scenario, dates: Dates) -> Any:
    from czml3 import CZML_VERSION, Packet
    from czml3.properties import Clock
    from czml3.types import IntervalValue

    scene = scenario.scene
    start, end = dates([0.0, scene.duration_s])
    clock = Clock(currentTime=start, multiplier=10, range="LOOP_STOP", step="SYSTEM_CLOCK_MULTIPLIER")
    description = escape(printable_lines(scene.description)) or "A scene of warpsim."
    return Packet(
        id=_DOCUMENT, name=scene.name, version=CZML_VERSION, description=description,
        clock=IntervalValue(start=start, end=end, value=clock),
    )  # fmt: skip


# --- bodies ---


def _bodies(
    scenario: Scenario, dates: Dates, step_s: float | None, more: dict[str, dict[str, Any]]
) -> Iterator[tuple[Any, float]]:
    """Packets of the satellites and targets that are there, and the errors of interpolating between samples [m]."""
    sensors = dict.fromkeys(scenario.satellite_names, "")
    for instrument in scenario.instruments.values():
        for name, satellite in zip(instrument.names, instrument.satellite_names, strict=True):
            sensors[satellite] += f", {name}" if name != satellite else ""
    for name, carried in sensors.items():
        yield _body(scenario, dates, step_s, name, f"satellite{carried}", _SATELLITE, is_named=True, more={})
    for target in scenario.targets:
        if _is_there(scenario, target.name):  # else never deployed
            colour, is_named = (_TARGET, False) if target.is_released else (_MAIN, True)
            words, own = f"target, {target.spec.shape.kind}", more.get(target.name, {})
            yield _body(scenario, dates, step_s, target.name, words, colour, is_named, own)


def _body(
    scenario: Scenario, dates: Dates, step_s: float | None, name: str, description: str, colour: list[int],
    is_named: bool, more: dict[str, Any],
) -> tuple[Any, float]:  # fmt: skip
    """The packet of a body (positions, point, name, path) and the error of its positions [m].

    Name and path show where it is named: thirty names at one point hide one another.
    """
    from czml3 import Packet

    span_s, duration_s = body_span_s(scenario, name), scenario.scene.duration_s
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
        availability={"start": first, "end": last},
        position=position_property(pieces, dates),
        point={"color": {"rgba": colour}, "pixelSize": 8 if is_named else 4, "outlineWidth": 0},
        label={
            "text": name, "font": "12px sans-serif", "fillColor": {"rgba": colour}, "show": is_named,
            "horizontalOrigin": "LEFT", "pixelOffset": {"values": _LABEL_OFFSET_PX},
        },
        path={
            "material": solid([*colour[:3], 140]), "width": 1 if colour is _SATELLITE else 2, "show": is_named,
            "leadTime": duration_s, "trailTime": duration_s, "resolution": 60,
        },
        **more,
    )  # fmt: skip
    return packet, error_m
