"""Report of a scene: `warpsim check`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from warpsim.instant import instant_after
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.earth import geodetic_altitude_m
from warpsim.orbit.node_steps import TRACK_ERROR_M
from warpsim.output.check_pointing import target_attitude_lines
from warpsim.output.check_sensor import sensor_lines
from warpsim.output.wording import counted
from warpsim.render.device_stars import Skies
from warpsim.scene.band_descriptions import parts_with_bands, tables_by_band
from warpsim.scene.groups import TargetGroup, TargetSpec
from warpsim.scene.scenario import Scenario
from warpsim.scene.target_histories import within_scene
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.tiles import StarTiles
from warpsim.target.mesh import Mesh
from warpsim.target.patches import patch_areas
from warpsim.target.temperature import HeatBalance, TemperatureRows

ESCAPE_SPEED_M_S = 11_180.0
"""From the Earth's surface: no ballistic flight between two points starts faster."""

LARGEST_ABERRATION_ARCSEC = 26.0
"""The Earth's motion and a low orbit's."""
RIGHT_ANGLE_DEFLECTION_ARCSEC = 4.07e-3
"""Bending of light 90 degrees from the Sun, seen from the Earth; elsewhere divided by tan(angle / 2)."""
LIMB_DEFLECTION_ARCSEC = 1.75

MOST_LEFT_OUT = 20
"""Element sets left out that are listed."""

_GROUP_SAMPLES = 400
"""Times at which the altitude of a group is looked at."""
_MOST_SAMPLES = 1_000_000
"""Of them and of targets on orbits, together."""


def scene_report(scenario: Scenario) -> str:
    """Return some lines about a valid scene: size, sky, orbits, groups; by kind of sensor noise, access, pointing.

    Raises:
        InputError: The star catalog cannot be read, or a path cannot be propagated.
    """
    scene = scenario.scene
    skies = Skies(scene.sky, scenario.epoch, ())
    catalogs = {name: skies.catalog(one.bands.values()) for name, one in scenario.instruments.items()}
    things = f"{counted(len(scenario.sensor_names), 'sensor')}, {counted(len(scenario.target_names), 'target')}"
    lines = [
        f"{scene.name}: valid. {things}, bands {' '.join(scenario.bands)}",
        f"  epoch      {scenario.epoch.isot} UTC, {scene.duration_s:g} s",
        *_unused_lines(scenario),
        *_sky_lines(scenario, catalogs, skies.tiles),
        *_left_out_lines(scenario),
        *_orbit_lines(scenario),
    ]
    for group in scene.groups:
        lines += _group_lines(group, scenario)
    lines += [*_patch_lines(scenario), *target_attitude_lines(scenario), *_heat_lines(scenario)]
    several = len(scenario.instruments) > 1
    for instrument in scenario.instruments.values():
        carried = f"  sensor     {instrument.sensor.name} on {counted(len(instrument.names), 'satellite')}"
        lines += ["", carried] if several else []
        lines += sensor_lines(instrument, scenario, catalogs[instrument.sensor.name])
    return "\n".join(lines)


def _unused_lines(scenario: Scenario) -> list[str]:
    """Notes of the bands that are described, or named by tables by band, and not used."""
    scene = scenario.scene
    unused = {" ".join(name for name in scene.band if name not in scenario.bands): "described"}
    for start, part in parts_with_bands(scene.sensors, scene.groups, scene.lighting):
        for path, table in tables_by_band(part, start):
            names = (name for name in table if name not in {*scenario.bands, *scene.band})
            unused.setdefault(" ".join(names), f"in {path}")
    end = "but in the bands of no sensor"
    return [f"  note       band {names}: {where}, {end}" for names, where in unused.items() if names]


def _sky_lines(scenario: Scenario, catalogs: Mapping[str, StarCatalog], tiles: StarTiles | None) -> list[str]:
    """Stars by kind of sensor with light in each band; effects in their positions, and the size of disabled ones."""
    sky, bright = scenario.scene.sky, {}
    for kind, instrument in scenario.instruments.items():
        for name, band in instrument.bands.items():
            bright[name] = int(np.count_nonzero(catalogs[kind].irradiance_w_cm2(band, sky.physics)))
    numbers = ", ".join(f"{name} {n:,}" for name, n in bright.items())
    papers = ", the paper's physics" if sky.physics == "paper" else ""
    catalog = next(iter(catalogs.values()))
    stars = counted(len(catalog), "star")
    lines = [f"  sky        catalog {sky.catalog}: {stars}, with light in band {numbers}{papers}"]
    if tiles is not None:
        stars = f"{counted(len(tiles), 'star')} in {counted(len(tiles.hats.tiles), 'tile')} of HATS"
        lines = [
            f"  sky        catalog {sky.catalog}: {stars}, read as views need them and not counted by band{papers}"
        ]
    elif sky.catalog != "none" and not any(bright.values()):
        lines.append("  warning    no star of the catalog gives light in these bands")
    parallax_arcsec = float(np.nan_to_num(catalog.parallax_mas).max(initial=0.0)) / 1e3
    exclusions = [
        instrument.access_rules.min_solar_exclusion_deg or 0.0 for instrument in scenario.instruments.values()
    ]
    from_sun_deg, deflection_arcsec, where = min(exclusions), LIMB_DEFLECTION_ARCSEC, "at the Sun's limb"
    if from_sun_deg:
        deflection_arcsec = RIGHT_ANGLE_DEFLECTION_ARCSEC / float(np.tan(np.radians(from_sun_deg / 2)))
        where = f"{from_sun_deg:g} deg from the Sun"
    effects = {
        "aberration": (sky.aberration, LARGEST_ABERRATION_ARCSEC, ""),
        "parallax": (sky.parallax, parallax_arcsec, " for the nearest star"),
        "light deflection": (sky.light_deflection, deflection_arcsec, f" {where}"),
    }
    cameras = [sensor.camera for sensor in scenario.scene.sensors]
    px_per_arcsec = max(max(camera.focal_px, camera.focal_row_px) for camera in cameras) * np.radians(1 / 3600)
    included = [name for name, (on, _, _) in effects.items() if on]
    left_out = [
        f"{name} ({_short(arcsec)} arcsec, {_short(arcsec * px_per_arcsec)} px{note})"
        for name, (on, arcsec, note) in effects.items()
        if not on and arcsec > 0
    ]
    if len(catalog) or tiles is not None:
        lines.append(
            f"  positions  {', '.join(['proper motion', *included])}; left out: {', '.join(left_out) or 'nothing'}"
        )
    return lines


def _specs(scenario: Scenario) -> list[TargetSpec]:
    return list({spec.name: spec for group in scenario.scene.groups for spec in group.targets}.values())


def _surface_notes(scenario: Scenario) -> list[str]:
    """Bands beyond the wavelengths at which a target's surface is given."""
    notes = []
    for spec, surface in [(one, surface) for one in _specs(scenario) for surface in one.surfaces]:
        if not surface.is_spectral:
            continue
        low_um, high_um = surface.emissivity_curve.wavelength_um[[0, -1]]
        ends = {name: band.half_power_um for name, band in scenario.bands.items()}
        beyond = [name for name, (first_um, last_um) in ends.items() if first_um < low_um or last_um > high_um]
        if beyond:
            what = "its surface" if surface is spec.surface else "the surface of a patch"
            given = f"{what} is given from {low_um:g} to {high_um:g} um and constant beyond"
            notes.append(f"{spec.name}: {given}, as in band {' '.join(beyond)}")
    return notes


def _patch_lines(scenario: Scenario) -> list[str]:
    """Lines about the patches of targets, and how far facets stand for them."""
    lines = []
    for spec in _specs(scenario):
        areas = patch_areas(spec.shape, spec.patches)
        if areas:
            part = sum(area.surface_m2 for area in areas) / spec.shape.surface_m2
            n_facet = sum(len(area.surface.area_m2) for area in areas)
            words = f"{counted(len(areas), 'patch', 'patches')}, {100 * part:.2g} % of its surface"
            lines.append(f"  patches    {spec.name} has {words}, by {counted(n_facet, 'facet')}")
    return lines


def _short(value: float) -> str:
    """Two digits, without an exponent where they are before the point."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _orbit_lines(scenario: Scenario) -> list[str]:
    """Errors of tracks, and notes of paths and shapes."""
    scene, tracks = scenario.scene, scenario.tracks
    lines = [f"  orbits     nodes every {tracks.steps} s, interpolation error {tracks.error_m * 1e3:.2g} mm"]
    for propagator in (scene.constellation, *(group.path for group in scene.groups)):
        notes = getattr(propagator, "notes", None)
        lines += [f"  note       {note}" for note in (notes(scenario.epoch, scene.duration_s) if notes else [])]
    lines += [f"  note       {note}" for note in _surface_notes(scenario)]
    for spec in _specs(scenario):
        notes_of_mesh = spec.shape.notes() if isinstance(spec.shape, Mesh) else []
        lines += [f"  note       {spec.name}: {note}" for note in notes_of_mesh]
    if tracks.error_m > TRACK_ERROR_M:
        rough = max((*tracks.satellites, *tracks.targets), key=lambda track: track.error_m)
        missed = f"near {rough.error_at_s:.6g} s interpolation is {rough.error_m * 1e3:.2g} mm off"
        lines.append(f"  warning    {rough.name} moves unevenly: {missed}")
    return lines


def _left_out_lines(scenario: Scenario) -> list[str]:
    """Element sets that the scene does without: how many, and the first of them."""
    table = scenario.left_out
    shown = [
        f"             {row['name']}, {row['location']} of {row['part'] or 'the orbits'}: {row['reason']}"
        for row in table[:MOST_LEFT_OUT]
    ]
    more = [f"             and {len(table) - len(shown):,} more (Scenario.left_out)"] if len(table) > len(shown) else []
    return [f"  left out   {counted(len(table), 'element set')}", *shown, *more] if len(table) else []


def _group_lines(group: TargetGroup, scenario: Scenario) -> list[str]:
    """A group: its size, time span and main target's altitude; a warning where that is implausible."""
    tracks, path = scenario.tracks, group.path
    first_s, last_s = within_scene(group.span_s, scenario.scene.duration_s)
    number = scenario.scene.groups.index(group)
    members = [index for index, target in enumerate(scenario.targets) if target.group == number]
    mains = members if group.orbits is not None else members[:1]
    times = np.linspace(first_s, last_s, max(2, min(_GROUP_SAMPLES, _MOST_SAMPLES // max(1, len(mains)))))
    states = [tracks.target_state(index, times) for index in mains]
    altitude_km = np.concatenate([geodetic_altitude_m(position_m, tracks.pole_icrs) for position_m, _ in states]) / 1e3
    arc = path if isinstance(path, BallisticArc) else None
    if arc:  # its own start velocity: that of the track is a derivative of its interpolant
        speed_m_s = arc.flight(instant_after(scenario.epoch, group.start_s)).start_speed_m_s
    else:
        speed_m_s = float(max(np.linalg.norm(velocity_m_s[0]) for _, velocity_m_s in states))
    kind = f"{arc.range_angle_deg:.2f} deg about the Earth's centre" if arc else path.kind.replace("_", " ")
    when = "" if (first_s, last_s) == (0.0, scenario.scene.duration_s) else f"; there from {first_s:g} to {last_s:g} s"
    lines = [
        f"  group      {group.name}: {counted(len(group.names), 'target')}, {altitude_km.min():.1f} to "
        f"{altitude_km.max():.1f} km above WGS84, start {speed_m_s:.0f} m/s, {kind}{when}"
    ]
    spread = {spec.name: spec.spread for spec in group.targets if spec.spread}
    lines += [f"  spread     {name}: {', '.join(fields)}" for name, fields in spread.items()]
    for spec in group.targets[1:]:
        release = spec.release or group.release
        released_s = -np.inf if release is None or group.orbits is not None else group.start_s + release.time_s
        if released_s >= last_s:
            words = f"released at {released_s:g} s, absent from {last_s:g} s"
            lines.append(f"  warning    {spec.name} is never deployed: {words}")
    if arc and speed_m_s > ESCAPE_SPEED_M_S:
        lines.append(f"  warning    the flight starts faster than escape speed ({ESCAPE_SPEED_M_S:.0f} m/s)")
    if arc and altitude_km.min() < arc.endpoint_altitude_km - 0.1:
        lines.append(f"  warning    the flight dips below its end points ({arc.endpoint_altitude_km:g} km)")
    if not arc and altitude_km.min() < 0:
        lines.append(f"  warning    the path goes {-altitude_km.min():.0f} km below the ground")
    return lines


def _heat_lines(scenario: Scenario) -> list[str]:
    """Temperatures of the targets whose heat is balanced, by entry."""
    by_entry: dict[str, list[TemperatureRows]] = {}
    for target, rows in zip(scenario.targets, scenario.temperatures, strict=True):
        if isinstance(target.spec.temperature, HeatBalance):
            by_entry.setdefault(target.spec.name, []).append(rows)
    lines = []
    for name, some in by_entry.items():
        low_k, high_k = min(r.temperature_k.min() for r in some), max(r.temperature_k.max() for r in some)
        error_k, ripple_k = max(r.error_k for r in some), max(r.ripple_k for r in some)
        swing = f", {ripple_k:.2g} K within a turn" if ripple_k > error_k else ""
        lines.append(f"  heat       {name}: {low_k:.1f} to {high_k:.1f} K, error {error_k:.1g} K{swing}")
    return lines
