"""How warm the targets of a scene are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2, SOLAR_CONSTANT_W_M2
from warpsim.errors import InputError
from warpsim.orbit.eclipse import eclipses
from warpsim.orbit.track import TrackStack
from warpsim.target.attitude_table import AttitudeRows
from warpsim.target.cooling import Bodies, follow
from warpsim.target.heat_balance import lump_of
from warpsim.target.temperature import HeatBalance, Temperature, TemperatureRows, TemperatureTable
from warpsim.target.turning_area import SteadyArea, TurningArea, steady_area

if TYPE_CHECKING:
    from warpsim.scene.parts import TargetSpec
    from warpsim.scene.scene import Scene

F64 = npt.NDArray[np.float64]

BODIES_AT_ONCE = 256
"""Targets of a kind whose heat balances are computed side by side, with common steps."""
LONGEST_STEP_REV = 0.01
"""Longest step of a heat balance, in revolutions of a circular orbit at the target's lowest place."""
ECLIPSE_STEP_S = 10.0
"""Step of the scan for eclipses of the first of them, at whose ends steps end too."""
SUN_STEP_S = 7200.0
"""Between these the Sun's direction is linear to 1e-6 rad."""


def target_temperatures(scene: Scene) -> list[TemperatureRows]:
    """Temperature of each single target, in the order of scene.target_names; equal ones share their rows.

    Targets with a heat balance have a course each: a group flies together, but what a body shows to the Sun depends on
    its own axis and phases.

    Raises:
        InputError: A table cannot be read or does not cover the scene, or a heat balance has no solution.
    """
    tables = temperature_tables(scene)
    found: list[TemperatureRows] = []
    for where, spec in _specs(scene):
        if not isinstance(spec.temperature, HeatBalance):
            found += [tables[spec]] * spec.count
            continue
        try:
            for first in range(0, spec.count, BODIES_AT_ONCE):
                found += _warmed(scene, spec, len(found), min(BODIES_AT_ONCE, spec.count - first))
        except InputError as error:
            raise error.within(f"{where}.temperature") from None
    return found


def _warmed(scene: Scene, spec: TargetSpec, first: int, n_body: int) -> list[TemperatureRows]:
    """Courses of some targets of a kind, from target number `first` on."""
    assert isinstance(spec.temperature, HeatBalance)
    tracks, pole = scene.tracks, scene.tracks.pole_icrs
    own = tracks.targets[first : first + n_body]
    stack = TrackStack(own)
    start_s = min(max(0.0, float(tracks.release_s[len(tracks.sensors) + first])), scene.duration_s)
    lump = lump_of(spec.temperature, spec.shape.surface_m2, mean_emissivity(scene, spec))
    area = _turning_area(scene, spec, first, n_body, scene.duration_s - start_s)
    outline = _tabulated(scene, area, n_body, start_s)

    def directions(time_s: F64) -> tuple[F64, F64, F64]:
        place, sun = stack.positions_m(time_s), tracks.sun.position_at_m(time_s)
        to_sun = sun - place
        return place, sun, to_sun / np.linalg.norm(to_sun, axis=-1, keepdims=True)

    def absorbed_w(time_s: F64) -> F64:
        place, sun, to_sun = directions(time_s)
        return lump.absorbed_w(place, sun, pole, outline.towards(time_s, to_sun))

    at_start_w = absorbed_w(np.array([start_s]))[:, 0]
    start_k = spec.temperature.start_k
    begin_k = lump.equilibrium_k(at_start_w) if isinstance(start_k, str) else np.full(n_body, start_k)
    if start_s == scene.duration_s:
        return [TemperatureRows(np.zeros(1), np.array([kelvin])) for kelvin in begin_k]
    eclipsed = eclipses(own[0].position_at_m, tracks.sun.position_at_m, pole, scene.duration_s, ECLIPSE_STEP_S)
    kinks = {float(time) for eclipse in eclipsed for time in eclipse if start_s < time < scene.duration_s}
    lowest_m = max(min(np.linalg.norm(track.position_m, axis=1).min() for track in own), EARTH_EQUATORIAL_RADIUS_M)
    course = follow(
        Bodies(lambda time_s: absorbed_w(time_s) / lump.capacity_j_k, lump.emitted_w_k4 / lump.capacity_j_k),
        begin_k,
        [start_s, *sorted(kinks), scene.duration_s],
        LONGEST_STEP_REV * 2 * np.pi * float(np.sqrt(lowest_m**3 / EARTH_GM_M3_S2)),
    )
    time_s = course.time_s if start_s == 0 else np.append(0.0, course.time_s)
    held = course.temperature_k[:, [0] * (start_s > 0)]
    kelvin = np.concatenate([held, course.temperature_k], axis=1)
    swing_m2_s = area.swing_m2_s(start_s, directions(np.array([start_s]))[2][:, 0])
    ripple_k = lump.solar_absorptance * SOLAR_CONSTANT_W_M2 / lump.capacity_j_k * swing_m2_s
    return [
        TemperatureRows(time_s, row, course.error_k, float(ripple))
        for row, ripple in zip(kelvin, ripple_k, strict=True)
    ]


def _turning_area(scene: Scene, spec: TargetSpec, first: int, n_body: int, span_s: float) -> TurningArea:
    """Shape and motion of some targets of a kind."""
    some = scene.attitudes[first : first + n_body]
    attitudes: Any = some[0] if isinstance(some[0], AttitudeRows) else some
    return TurningArea(spec.shape, attitudes, span_s)


def _tabulated(scene: Scene, area: TurningArea, n_body: int, start_s: float) -> TurningArea | SteadyArea:
    """The same by a table over the Sun's way, where only means over turns count."""
    if not area.is_steady:
        return area
    node_s = np.linspace(start_s, scene.duration_s, 2 + int(area.span_s // SUN_STEP_S))
    sun_m = scene.tracks.sun.position_at_m(node_s)
    return steady_area(area, n_body, node_s, sun_m / np.linalg.norm(sun_m, axis=-1, keepdims=True))


def mean_emissivity(scene: Scene, spec: TargetSpec) -> float:
    """Mean of 1 - reflectance over the scene's bands: what a heat balance takes where nothing is given."""
    return float(np.mean([spec.surface.emissivity_in(band) for band in scene.bands]))


def temperature_tables(scene: Scene, with_files: bool = True) -> dict[TargetSpec, TemperatureRows]:
    """Temperatures that are given: linear ones, and checked tables.

    Raises:
        InputError: A table cannot be read or does not cover the scene; the text begins with its place.
    """
    tables = {}
    for where, spec in _specs(scene):
        model = spec.temperature
        if isinstance(model, Temperature):
            tables[spec] = model.rows(scene.duration_s)
        elif isinstance(model, TemperatureTable) and (with_files or model.file is None):
            try:
                tables[spec] = model.rows(scene.epoch)
                tables[spec].check_span(0.0, scene.duration_s)
            except InputError as error:
                raise error.within(f"{where}.temperature") from None
    return tables


def _specs(scene: Scene) -> Iterator[tuple[str, TargetSpec]]:
    """Place and description of every kind of target, in the order of scene.target_names."""
    for number, group in enumerate(scene.groups_of_targets):
        where = "" if number == 0 else f"groups[{number - 1}]."
        for kind, spec in enumerate(group.targets):
            yield f"{where}targets[{kind}]", spec
