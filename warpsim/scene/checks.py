"""Checks over several parts of a scene; each error is one line that names the field."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from warpsim.config.model import parts_with_files
from warpsim.detector.hits_and_flicker import hit_area
from warpsim.detector.levels import levels
from warpsim.errors import InputError, errors_at
from warpsim.instant import Instant, instant, instant_after
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.constellations import ListedSatellites, MixedConstellation, SeedPattern
from warpsim.orbit.ephemeris import EphemerisOrbit, EphemerisSatellites
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS, SHIPPED
from warpsim.scene.background_terms import Background
from warpsim.scene.band_descriptions import (
    BandDescription,
    find_band,
    needs_file,
    parts_with_bands,
    tables_by_band,
    unknown_rule,
)
from warpsim.scene.environment import Lighting, Sky
from warpsim.scene.groups import AnyConstellation, TargetGroup, TargetSpec
from warpsim.scene.pointing import ANY, TRACKED, satellites_of
from warpsim.scene.pointing_program import check_frames as check_covered
from warpsim.scene.pointing_program import entry_path, make_program, tracked_targets
from warpsim.scene.sensors import Frames, Sensor, sensor_instances
from warpsim.scene.short_form import item_path, with_paths
from warpsim.scene.target_histories import timed_tables, within_scene
from warpsim.scene.targets import SceneTarget, with_values
from warpsim.target.mesh import Mesh
from warpsim.target.patches import patch_areas
from warpsim.target.surface import Graybody


def reads_file(part: Any) -> bool:
    """Return whether a part of a description names a file that must be read to know its names."""
    return any(True for _ in parts_with_files(part))


def known_names(path: Any) -> list[str] | None:
    """Return the names of a constellation or of orbits; None where they are read from a file."""
    return None if reads_file(path) else list(path.names)


def check_sensors(constellation: AnyConstellation, sensors: Sequence[Sensor], frames: Frames) -> None:
    """Check that sensors have unique names, existing satellites, and exposures that fit between frames."""
    if not sensors:
        raise InputError("must hold at least one", "sensors")
    satellites = known_names(constellation)
    names: set[str] = set()
    for path, sensor in with_paths("sensors", sensors):
        exposure_s, own = sensor.detector.exposure_s, sensor.frames or frames
        with errors_at(path):
            if sensor.name in names:
                raise InputError("must be no other sensor's name", "name", sensor.name)
            if own.count > 1 and exposure_s > own.interval_s:
                rule = f"must be at most frames.interval_s ({own.interval_s:g})"
                raise InputError(rule, "detector.exposure_s", exposure_s, "g")
            line_s, n_row = sensor.detector.line_time_s, sensor.camera.n_row
            if own.count > 1 and n_row * abs(line_s) > own.interval_s * (1.0 + 1e-9):
                rule = f"must read all {n_row} rows within frames.interval_s ({own.interval_s:g})"
                raise InputError(rule, "detector.line_time_s", line_s, "g")
            if satellites is not None:
                check_satellites(sensor, satellites)
            if sensor.detector.hits is not None:
                hit_area(sensor.detector, sensor.camera)
        names.add(sensor.name)


def check_zodiacal(sensors: Sequence[Sensor], background: Background) -> None:
    """Check that no detector has zodiacal light of its own beside that of the background."""
    for path, sensor in with_paths("sensors", sensors):
        own = getattr(sensor.detector, "zodiacal_mjy_sr", 0.0)
        with errors_at(path):
            if background.zodiacal and any(np.ravel(list(own.values()) if isinstance(own, Mapping) else own)):
                raise InputError("must be 0 where background.zodiacal is on", "detector.zodiacal_mjy_sr", own)


def check_satellites(sensor: Sensor, satellites: Sequence[str]) -> None:
    """Check that a sensor's satellites exist, and that each of them has a pointing."""
    carriers = [satellites[index] for index in satellites_of(sensor.on, satellites)]
    pointed: set[int] = set()
    for number, pointing in enumerate(sensor.pointing):
        with errors_at(entry_path(number, len(sensor.pointing))):
            pointed |= set(satellites_of(pointing.on, carriers))
    left = [name for index, name in enumerate(carriers) if index not in pointed]
    if left:
        raise InputError(f"must say where every sensor looks, got nothing for that of {left[0]}", "pointing")


def check_names(constellation: AnyConstellation, sensors: Sequence[Sensor], groups: Sequence[TargetGroup]) -> None:
    """Check that names of satellites, kinds of sensors, targets and groups given in the scene are unique."""
    satellites = known_names(constellation) or []
    targets = [known_names(group.orbits) or [] if group.orbits else group.names for group in groups]
    names = [*satellites, *(name for some in targets for name in some), "sun"]
    check_unique(names)
    taken = set(names)
    for path, sensor in with_paths("sensors", sensors):
        if len(sensors) > 1 and sensor.name in taken:
            raise InputError("must be no name of a satellite or target", "name", sensor.name).within(path)
    if satellites:
        check_instances(sensors, satellites, names)
    taken |= {"group", TRACKED, ANY}
    for number, group in enumerate(groups):
        first = number == 0 and group.name == "main"  # the name it has unless given; a target's goes before it
        if not first and (group.name in taken or group.name == "main"):
            path = item_path("groups", number, len(groups))
            rule = "must be no other name of the scene, 'main' (but for the first), 'group', 'tracked' or 'any'"
            raise InputError(rule, "name", group.name).within(path)
        taken.add(group.name)


def check_unique(names: Sequence[str]) -> None:
    """Check that names of satellites, targets and the Sun are unique."""
    if len(set(names)) < len(names):
        twice = min(name for name, count in Counter(names).items() if count > 1)
        raise InputError(f"names must be unique among satellites and targets, got {twice} twice", "targets")


def check_instances(sensors: Sequence[Sensor], satellites: Sequence[str], names: Sequence[str]) -> None:
    """Check that no sensor of a satellite with several has one of the names of other bodies, or another sensor's."""
    taken = set(names)
    for number, own in enumerate(sensor_instances(sensors, satellites)):
        for name, index in own:
            if name != satellites[index] and name in taken:
                rule = f"must not make the name of another sensor, satellite or target ({name})"
                path = item_path("sensors", number, len(sensors))
                raise InputError(rule, "name", sensors[number].name).within(path)
            taken.add(name)


def check_times(groups: Sequence[TargetGroup], duration_s: float) -> None:
    """Check that groups and releases are within the scene."""
    for path, group in with_paths("groups", groups):
        first_s, last_s = group.span_s
        if group.start_s >= duration_s:
            rule = f"must be below duration_s ({duration_s:g})"
            raise InputError(rule, "start_s", group.start_s, "g").within(path)
        if first_s >= duration_s or last_s <= 0.0:
            rule = f"must have a part within the scene, 0 to {duration_s:g} s"
            raise InputError(rule, "exists_s", [first_s, last_s]).within(path)
        for release in (group.releases if group.orbits is None else [])[1:]:
            if release is not None and group.start_s + release.time_s > duration_s:
                rule = f"must be within duration_s ({duration_s:g})"
                raise InputError(rule, "release.time_s", group.start_s + release.time_s, "g").within(path)


def check_frames(sensors: Sequence[Sensor], frames: Frames, duration_s: float) -> None:
    """Check that all frames are within the scene."""
    for path, some in [("", frames), *((path, sensor.frames) for path, sensor in with_paths("sensors", sensors))]:
        last_s = 0.0 if some is None else some.start_s + (some.count - 1) * some.interval_s
        if last_s > duration_s:
            rule = f"the last frame must be within duration_s ({duration_s:g}), got {last_s:g} s"
            raise InputError(rule, "frames").within(path)


def check_bands(
    own: Mapping[str, BandDescription],
    sensors: Sequence[Sensor],
    groups: Sequence[TargetGroup],
    lighting: Lighting,
    sky: Sky,
) -> None:
    """Check that all bands that a scene names are its own or shipped ones, or known to the paper if its sky is."""
    known = {*own, *SHIPPED}
    for start, part in parts_with_bands(sensors, groups, lighting):
        named = [(path, band) for path, table in tables_by_band(part) for band in table]
        if isinstance(part, Sensor):
            named = [*((f"bands[{number}]", band) for number, band in enumerate(part.bands)), *named]
        unknown = next(((path, band) for path, band in named if band not in known), None)
        if unknown is not None:
            raise InputError(unknown_rule(unknown[1], own), *unknown).within(start)
        for number, band in enumerate(part.bands if isinstance(part, Sensor) and sky.physics == "paper" else ()):
            if band not in BANDS:
                rule = f"must be one of {', '.join(BANDS)} with sky.physics = 'paper'"
                raise InputError(rule, f"bands[{number}]", band).within(start)


def check_instruments(sensors: Sequence[Sensor], own: Mapping[str, BandDescription]) -> None:
    """Check the instruments in the bands that no file must be read for."""
    for path, sensor in with_paths("sensors", sensors):
        check_instrument(sensor, [find_band(name, own) for name in sensor.bands if not needs_file(name, own)], path)


def check_instrument(sensor: Sensor, bands: Sequence[Band], path: str) -> None:
    """Check that a sensor has a point spread function in bands, and that blank sky does not saturate."""
    optics = sensor.optics
    with errors_at(path):
        for band in bands:
            if isinstance(optics.psf_file, Mapping) and band.name not in optics.psf_file:
                raise InputError(f"must name a file for every band, got none for {band.name}", "optics.psf_file")
            if optics.psf_file is None:  # image files are read on their first use
                with errors_at("optics", f"in band {band.name}"):
                    optics.psf_for(band, sensor.camera, sensor.detector.diffusion_px)
            levels(sensor.detector, optics, sensor.camera, band)


def check_targets(groups: Sequence[TargetGroup], sensors: Sequence[Sensor], epoch_utc: str, duration_s: float) -> None:
    """Check that targets are described in every band, drawn numbers are valid, and tables cover the scene."""
    bands = list(dict.fromkeys(band for sensor in sensors for band in sensor.bands))
    for path, group in with_paths("groups", groups):
        for entry, spec in enumerate(group.targets):
            for part, surface in surface_paths(spec):
                missing = next((band for band in bands if not surface.describes(band)), None)
                if missing is not None:
                    rule = (
                        f"must give reflectance or emissivity of {spec.name} in every band of the scene, got none in "
                        f"band {missing}"
                    )
                    raise InputError(rule, f"targets[{entry}].{part}").within(path)
            for field, distribution in (spec.spread or {}).items():
                for value in distribution.extremes:
                    with errors_at(path), errors_at(f"targets[{entry}].spread"):
                        with_values(spec, {field: value})
    timed_tables(groups, "attitude", instant(epoch_utc), duration_s, with_files=False)
    timed_tables(groups, "temperature", instant(epoch_utc), duration_s, with_files=False)


def check_pointing(
    constellation: AnyConstellation,
    sensors: Sequence[Sensor],
    groups: Sequence[TargetGroup],
    access_target: str,
    frames: Frames,
) -> None:
    """Check that tracked targets and access targets exist, and that commanded pointing covers the frames.

    Left to the scenario where a file must be read to know the names of satellites or targets, or rows of directions.
    """
    satellites = known_names(constellation)
    if satellites is None or any(reads_file(group.orbits) for group in groups):
        return
    targets = [
        SceneTarget(name, spec, number, 0, -math.inf, group.span_s)
        for number, group in enumerate(groups)
        for name, spec in zip(group.names, group.specs, strict=True)
    ]
    names = [group.name for group in groups]
    check_access_target(access_target, targets, names)
    instances = sensor_instances(sensors, satellites)
    known = {*satellites, *(name for some in instances for name, _ in some)}
    for (path, sensor), own in zip(with_paths("sensors", sensors), instances, strict=True):
        if any(reads_file(pointing) for pointing in sensor.pointing):
            continue
        named = [(name, satellites[index]) for name, index in own]
        when = sensor.frames or frames
        with errors_at(path):
            program = make_program(sensor.pointing, named, sensor.camera, targets, names, known)
            ends_s = when.start_s + np.array([0.0, (when.count - 1) * when.interval_s])
            check_covered(program, [name for name, _ in own], ends_s)


def check_access_target(access_target: str, targets: Sequence[SceneTarget], groups: Sequence[str]) -> None:
    """Check that the access target exists."""
    if access_target in (TRACKED, ANY):
        return
    try:
        tracked_targets(access_target, targets, groups)
    except InputError as error:
        raise InputError(f"{error.rule}, {TRACKED!r} or {ANY!r}", "access_target", access_target) from None


def check_paths(
    constellation: AnyConstellation, groups: Sequence[TargetGroup], epoch: Instant, duration_s: float
) -> None:
    """Check that tabulated motion covers the scene, and that ballistic arcs have a solution."""
    _check_path(constellation, "constellation", epoch, (0.0, duration_s))
    for path, group in with_paths("groups", groups):
        first_s, last_s = within_scene(group.span_s, duration_s)
        start, span_s = instant_after(epoch, group.start_s), (first_s - group.start_s, last_s - group.start_s)
        with errors_at(path):
            _check_path(group.path, group.path_field, start, span_s)


def _check_path(path: Any, field: str, epoch: Instant, span_s: tuple[float, float]) -> None:
    """Check a path, or a constellation with the paths in it, over a span after its time 0 [s]."""
    if isinstance(path, MixedConstellation):
        for number, part in enumerate(path.parts):
            _check_path(part, f"{field}.parts[{number}]", epoch, span_s)
    elif isinstance(path, ListedSatellites):
        for number, item in enumerate(path.satellites):
            _check_path(item.orbit, f"{field}.satellites[{number}].orbit", epoch, span_s)
    with errors_at(field):
        if isinstance(path, BallisticArc):
            if span_s[1] > path.duration_s:
                rule = f"must be at least {span_s[1]:g}, until when it is asked for"
                raise InputError(rule, "duration_s", path.duration_s, "g")
            path.flight(epoch).start_velocity_m_s  # noqa: B018  # solved here
        elif isinstance(path, EphemerisOrbit | EphemerisSatellites):
            gaps_s = [time_s for time_s in path.gaps_s(epoch) if span_s[0] < time_s < span_s[1]]
            path.states(epoch, np.array([*span_s, *gaps_s]))
            path.notes(epoch, span_s[1])
        elif isinstance(path, SeedPattern):
            path.states(epoch, np.zeros(1))


def check_target_files(groups: Sequence[TargetGroup]) -> None:
    """Check that meshes and surfaces in files can be read."""
    for path, group in with_paths("groups", groups):
        for entry, spec in enumerate(group.targets):
            if isinstance(spec.shape, Mesh):
                with errors_at(path), errors_at(f"targets[{entry}].shape"):
                    spec.shape.surface_m2  # noqa: B018  # reads the file
            for part, surface in surface_paths(spec):
                if surface.is_spectral:
                    with errors_at(path), errors_at(f"targets[{entry}].{part}"):
                        surface.emissivity_curve  # noqa: B018  # reads the file
            with errors_at(path), errors_at(f"targets[{entry}]"):
                patch_areas(spec.shape, spec.patches)


def surface_paths(spec: TargetSpec) -> list[tuple[str, Graybody]]:
    """Return the surfaces of a target with the paths of their fields."""
    return [("surface", spec.surface), *((f"patches[{n}].surface", p.surface) for n, p in enumerate(spec.patches))]
