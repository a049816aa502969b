"""Rules that span several parts of a scene; each breach is one line that names the fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from warpsim.errors import InputError
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.constellations import ListedSatellites, MixedConstellation, SeedPattern
from warpsim.orbit.ephemeris import EphemerisOrbit, EphemerisSatellites
from warpsim.orbit.epoch import instant
from warpsim.scene.attitudes import table_rows
from warpsim.scene.temperatures import temperature_tables
from warpsim.scene.view_axes import tracked_targets

if TYPE_CHECKING:
    from warpsim.scene.parts import Trajectory
    from warpsim.scene.scene import Scene

LONGEST_TRACKS_S = 2e8
"""Longest scene times number of moving things: 1.4 GB of orbit nodes at most, 4 to 8 GB while they are made."""

LARGEST_VIEW = 2**29
"""Pixels of one sensor's image in all bands: array strides are 32-bit numbers of bytes."""


def check_scene(scene: Scene) -> None:
    """Raise pydantic's error at the first rule that a scene breaks."""
    _check_images(scene)
    _check_names(scene)
    _check_times(scene)
    _check_exposure(scene)
    _check_optics(scene)
    _check_detector(scene)
    _check_pointing(scene)
    _check_attitudes(scene)
    _check_surfaces(scene)
    _check_temperatures(scene)


def _check_images(scene: Scene) -> None:
    if not scene.bands:
        raise InputError("must name at least one band", "bands")
    if len(set(scene.bands)) != len(scene.bands):
        raise InputError(f"must not repeat, got {', '.join(scene.bands)}", "bands")
    n_value = scene.camera.n_row * scene.camera.n_col * len(scene.bands)
    if n_value >= LARGEST_VIEW:
        raise InputError("n_row * n_col * number of bands must be below 2**29", "camera", n_value)


def _check_names(scene: Scene) -> None:
    if not scene.targets:
        raise InputError("must hold at least the main target, which the trajectory belongs to", "targets")
    if scene.targets[0].count != 1:
        raise InputError("must be 1 for the main target", "targets[0].count", scene.targets[0].count)
    try:
        names = [*scene.sensor_names, *scene.target_names, "sun"]
    except InputError as error:  # from a file
        raise error.within("constellation") from None
    twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise InputError(f"names must be unique among sensors and targets, got {twice[0]} twice", "targets")
    taken = {*names, "main", "group"}
    for number, group in enumerate(scene.groups):
        if group.name in taken:
            raise InputError(
                "must be no other name of the scene, 'main' or 'group'", f"groups[{number}].name", group.name
            )
        taken.add(group.name)


def _check_exposure(scene: Scene) -> None:
    exposure_s, interval_s = scene.detector.exposure_s, scene.frames.interval_s
    if scene.frames.count > 1 and exposure_s > interval_s:
        raise InputError(f"must be at most frames.interval_s ({interval_s:g})", "detector.exposure_s", exposure_s, "g")


def _check_times(scene: Scene) -> None:
    """Scene, frames, paths and releases must agree on time."""
    for number, group in enumerate(scene.groups_of_targets):
        where = "" if number == 0 else f"groups[{number - 1}]."
        if group.targets[0].release is not None:
            raise InputError("must not be given, the main target is not released", f"{where}targets[0].release")
        _check_path(scene, f"{where}trajectory", group.trajectory)
        for release in group.releases:
            if release is None:
                continue
            if release.time_s > scene.duration_s:
                raise InputError(
                    f"must be within duration_s ({scene.duration_s:g})", f"{where}release.time_s", release.time_s, "g"
                )
            if release.time_s < 0 and isinstance(group.trajectory, BallisticArc):
                raise InputError(
                    "must be >= 0, as the flight starts at the epoch", f"{where}release.time_s", release.time_s, "g"
                )
    n_body = len(scene.sensor_names) + len(scene.target_names)
    if n_body * scene.duration_s > LONGEST_TRACKS_S:
        raise InputError(
            f"{scene.duration_s:g} s are too long for {n_body} sensors and targets: their product must be at most "
            f"{LONGEST_TRACKS_S:g} s",
            "duration_s",
        )
    last_s = scene.frame_time_s([scene.frames.count - 1])[0]
    if last_s > scene.duration_s:
        raise InputError(f"the last frame must be within duration_s ({scene.duration_s:g}), got {last_s:g} s", "frames")
    _check_span(scene, "constellation", scene.constellation)


def _check_path(scene: Scene, where: str, path: Trajectory) -> None:
    """A flight ends where it ends, and starts at the scene's epoch."""
    if isinstance(path, BallisticArc):
        if scene.duration_s > path.duration_s:
            raise InputError(
                f"must be at most {where}.duration_s ({path.duration_s:g}), where the flight ends",
                "duration_s",
                scene.duration_s,
                "g",
            )
        if path.epoch_utc is not None and instant(path.epoch_utc).tt != scene.instant.tt:
            raise InputError(
                f"must equal the scene's epoch_utc ({scene.epoch_utc})", f"{where}.epoch_utc", path.epoch_utc
            )
    _check_span(scene, where, path)


def _check_span(scene: Scene, where: str, orbit: Any) -> None:
    """Motion that is known for a limited time only must cover the scene, without gaps and missing rows."""
    if isinstance(orbit, MixedConstellation):
        for number, part in enumerate(orbit.parts):
            _check_span(scene, f"{where}.parts[{number}]", part)
    elif isinstance(orbit, ListedSatellites):
        for number, item in enumerate(orbit.satellites):
            _check_path(scene, f"{where}.satellites[{number}].orbit", item.orbit)
    try:
        if isinstance(orbit, EphemerisOrbit | EphemerisSatellites):
            gaps_s = [time for time in orbit.gaps_s(scene.epoch) if 0.0 < time < scene.duration_s]
            orbit.states(scene.epoch, np.array([0.0, scene.duration_s, *gaps_s]))
            orbit.notes(scene.epoch, scene.duration_s)
        elif isinstance(orbit, SeedPattern):
            orbit.states(scene.instant, np.zeros(1))
    except InputError as error:
        raise error.of(where) from None


def _check_optics(scene: Scene) -> None:
    """Every band must have a point spread function; images in files are read when the scene is loaded or rendered."""
    files = scene.optics.psf_file
    for name in scene.bands:
        if isinstance(files, Mapping) and name not in files:
            raise InputError(f"must name a file for every band, got none for {name}", "optics.psf_file")
        if files is not None:
            continue
        try:
            scene.psf(name)
        except InputError as error:
            hint = "; see aperture_m and the size of a pixel" if scene.optics.psf == "airy" else ""
            raise InputError(f"in band {name}: {error}{hint}", "optics") from None


def _check_detector(scene: Scene) -> None:
    """The detector must be described in every band, and blank sky must not saturate it."""
    try:
        scene.levels  # noqa: B018
    except InputError as error:
        raise error.within("detector") from None


def _check_pointing(scene: Scene) -> None:
    """What cameras follow must be there, and a table of directions must cover the frames."""
    try:
        tracked_targets(scene)
        if scene.sights is not None:
            scene.sights.check_times(scene.sensor_names, scene.frame_time_s([0, scene.frames.count - 1]))
    except InputError as error:
        raise error from None


def _check_attitudes(scene: Scene) -> None:
    """Tables of attitudes must cover the scene; those in files are read when the scene is loaded or rendered."""
    try:
        table_rows(scene, with_files=False)
    except InputError as error:
        raise error from None


def _check_surfaces(scene: Scene) -> None:
    """Every target must be described in every band."""
    for number, group in enumerate(scene.groups_of_targets):
        where = "" if number == 0 else f"groups[{number - 1}]."
        for kind, spec in enumerate(group.targets):
            for band in scene.bands:
                if band not in spec.surface.bands:
                    raise InputError(
                        f"must give reflectance or emissivity of {spec.name} in every band of the scene, got none in "
                        f"band {band}",
                        f"{where}targets[{kind}].surface",
                    )


def _check_temperatures(scene: Scene) -> None:
    """Tables of temperatures must cover the scene; those in files are read when the scene is loaded or rendered."""
    try:
        temperature_tables(scene, with_files=False)
    except InputError as error:
        raise error from None
