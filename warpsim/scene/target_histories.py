"""Histories of the targets of a scene: how they turn, and their temperatures."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from warpsim.arrays import F64
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_GM_M3_S2, SOLAR_CONSTANT_W_M2
from warpsim.directions import normalised
from warpsim.errors import errors_at
from warpsim.instant import Instant
from warpsim.orbit.sun import eclipses
from warpsim.orbit.track import TrackStack
from warpsim.scene.groups import TargetGroup, TargetSpec
from warpsim.scene.short_form import item_path, with_paths
from warpsim.scene.targets import SceneTarget
from warpsim.scene.tracks import Tracks
from warpsim.target.attitude import BodyMotion, body_motion
from warpsim.target.attitude_table import AttitudeRows, AttitudeTable
from warpsim.target.cooling import ThermalNodes, integrate
from warpsim.target.heat_balance import lumped_node, surface_coefficients
from warpsim.target.patches import patch_areas
from warpsim.target.rotating_area import RotatingArea, SteadyArea, steady_area
from warpsim.target.temperature import HeatBalance, Temperature, TemperatureRows, TemperatureTable
from warpsim.target.torque_free import TorqueFree, TorqueFreeMotion

BODIES_AT_ONCE = 256
"""Targets of a kind whose heat balances are computed side by side, with common steps."""
LONGEST_STEP_REV = 0.01
"""Longest step of a heat balance, in revolutions of a circular orbit at the target's lowest position."""
ECLIPSE_STEP_S = 10.0
"""Step of the scan for eclipses of the first of them, at whose ends steps end too."""
SUN_STEP_S = 7200.0
"""Between these the Sun's direction is linear to 1e-6 rad."""

AnyAttitude = BodyMotion | AttitudeRows | TorqueFreeMotion


def target_attitudes(
    targets: Sequence[SceneTarget],
    tracks: Tracks,
    tables: dict[tuple[int, int], AttitudeRows],
    seed: int,
) -> list[AnyAttitude]:
    """Return the attitude motion of each single target; those of one entry share their table (timed_tables)."""
    found: list[AnyAttitude] = []
    for number, target in enumerate(targets):
        attitude = target.spec.attitude
        if isinstance(attitude, AttitudeTable):
            found.append(tables[target.group, target.entry])
            continue
        if isinstance(attitude, TorqueFree):
            found.append(attitude.motion(seed, number))
            continue
        first_s, last_s = target.exists_s
        begin_s = max(0.0, first_s, min(target.release_s, last_s))  # some are gone before their release
        velocity_m_s = tracks.targets[number].state(begin_s)[1]
        with errors_at("", target.name), errors_at("attitude"):
            found.append(body_motion(attitude, velocity_m_s, seed, number))
    return found


def timed_tables(
    groups: Sequence[TargetGroup],
    field: Literal["attitude", "temperature"],
    epoch: Instant,
    duration_s: float,
    with_files: bool = True,
) -> dict[tuple[int, int], Any]:
    """Return the tables of attitudes, or of temperatures, by group and entry, checked to cover the scene."""
    rows: dict[tuple[int, int], Any] = {}
    for number, (path, group) in enumerate(with_paths("groups", groups)):
        for entry, spec in enumerate(group.targets):
            table = getattr(spec, field)
            if isinstance(table, AttitudeTable | TemperatureTable) and (with_files or table.file is None):
                with errors_at(path), errors_at(f"targets[{entry}].{field}"):
                    rows[number, entry] = table.rows(epoch)
                    rows[number, entry].check_span(*within_scene(group.span_s, duration_s))
    return rows


def within_scene(span_s: tuple[float, float], duration_s: float) -> tuple[float, float]:
    """Return the part of a span that lies within a scene [s]."""
    return max(0.0, span_s[0]), min(duration_s, span_s[1])


def target_temperatures(
    targets: Sequence[SceneTarget],
    tracks: Tracks,
    attitudes: Sequence[AnyAttitude],
    tables: dict[tuple[int, int], TemperatureRows],
    bands: Sequence[str],
    duration_s: float,
    n_group: int,
) -> list[TemperatureRows]:
    """Return the temperature of each single target; equal ones share their rows.

    Targets with a heat balance have a temperature history each: a group flies together, but what a body shows to the
    Sun depends on its own axis and phases. Surfaces are averaged over `bands` for a balance that leaves it to them.
    """
    linear: dict[Any, TemperatureRows] = {}
    found: list[TemperatureRows] = []
    for _, run in itertools.groupby(enumerate(targets), key=lambda item: (item[1].group, item[1].entry, item[1].spec)):
        numbers, members = zip(*run, strict=True)
        target, first = members[0], numbers[0]
        model, spec = target.spec.temperature, target.spec
        begin_s, end_s = within_scene(target.exists_s, duration_s)
        if isinstance(model, Temperature):
            found += [linear.setdefault((target.group, target.entry, model), model.rows(begin_s, end_s))] * len(members)
        elif isinstance(model, TemperatureTable):
            found += [tables[target.group, target.entry]] * len(members)
        else:
            begin_s = min(max(begin_s, target.release_s), end_s)
            coefficients = _coefficients(spec, bands)
            path = item_path("groups", target.group, n_group)
            with errors_at(path), errors_at(f"targets[{target.entry}].temperature"):
                for start in range(first, first + len(members), BODIES_AT_ONCE):
                    some = attitudes[start : min(start + BODIES_AT_ONCE, first + len(members))]
                    found += _balanced(spec, coefficients, tracks, start, some, begin_s, end_s)
    return found


def _coefficients(spec: TargetSpec, bands: Sequence[str]) -> tuple[float, float]:
    """Solar absorptance and infrared emissivity: means over the surface, with its patches."""
    areas_m2 = [area.surface_m2 for area in patch_areas(spec.shape, spec.patches)]
    areas_m2 = [spec.shape.surface_m2 - sum(areas_m2), *areas_m2]
    of_parts = np.array([surface_coefficients(surface, bands) for surface in spec.surfaces])
    absorptance, emissivity = np.average(of_parts, axis=0, weights=areas_m2)
    return float(absorptance), float(emissivity)


def _balanced(
    spec: TargetSpec,
    coefficients: tuple[float, float],
    tracks: Tracks,
    first: int,
    attitudes: Sequence[AnyAttitude],
    start_s: float,
    end_s: float,
) -> list[TemperatureRows]:
    """Return the temperature histories of targets of one description, from the first on, integrated side by side."""
    model, n_body = spec.temperature, len(attitudes)
    assert isinstance(model, HeatBalance)
    own = tracks.targets[first : first + n_body]
    stack, pole = TrackStack(own), tracks.pole_icrs
    node = lumped_node(model, spec.shape.surface_m2, coefficients)
    turned: Any = attitudes[0] if isinstance(attitudes[0], AttitudeRows) else attitudes
    area = RotatingArea(spec.shape, turned, end_s - start_s)
    projected: RotatingArea | SteadyArea = area
    if area.is_steady:  # only means over turns matter: tabulated along the Sun's path
        node_s = np.linspace(start_s, end_s, 2 + int(area.span_s // SUN_STEP_S))
        projected = steady_area(area, n_body, node_s, normalised(tracks.sun.position_at_m(node_s)))

    def directions(time_s: F64) -> tuple[F64, F64, F64]:
        position, sun = stack.positions_m(time_s), tracks.sun.position_at_m(time_s)
        return position, sun, normalised(sun - position)

    def absorbed_w(time_s: F64) -> F64:
        position, sun, to_sun = directions(time_s)
        return node.absorbed_w(position, sun, pole, projected.towards(time_s, to_sun))

    at_start_w = absorbed_w(np.array([start_s]))[:, 0]
    begin_k = node.equilibrium_k(at_start_w) if isinstance(model.start_k, str) else np.full(n_body, model.start_k)
    if start_s == end_s:
        return [TemperatureRows(np.zeros(1), np.array([kelvin])) for kelvin in begin_k]
    eclipsed = eclipses(own[0].position_at_m, tracks.sun.position_at_m, pole, end_s, ECLIPSE_STEP_S)
    kinks = {float(time) for eclipse in eclipsed for time in eclipse if start_s < time < end_s}
    lowest_m = max(min(np.linalg.norm(track.position_m, axis=1).min() for track in own), EARTH_EQUATORIAL_RADIUS_M)
    history = integrate(
        ThermalNodes(lambda time_s: absorbed_w(time_s) / node.capacity_j_k, node.emitted_w_k4 / node.capacity_j_k),
        begin_k,
        [start_s, *sorted(kinks), end_s],
        LONGEST_STEP_REV * 2 * np.pi * float(np.sqrt(lowest_m**3 / EARTH_GM_M3_S2)),
    )
    time_s = history.time_s if start_s == 0 else np.append(0.0, history.time_s)
    constant = history.temperature_k[:, [0] * (start_s > 0)]
    kelvin = np.concatenate([constant, history.temperature_k], axis=1)
    swing_m2_s = area.swing_m2_s(start_s, directions(np.array([start_s]))[2][:, 0])
    ripple_k = node.solar_absorptance * SOLAR_CONSTANT_W_M2 / node.capacity_j_k * swing_m2_s
    return [
        TemperatureRows(time_s, row, history.error_k, float(ripple))
        for row, ripple in zip(kelvin, ripple_k, strict=True)
    ]
