"""Checks of a scene that read files and solve orbits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from warpsim.errors import InputError
from warpsim.instant import Instant, instant_after
from warpsim.optics.telescope import Optics
from warpsim.orbit.arc import BallisticArc
from warpsim.orbit.constellations import ListedSatellites, MixedConstellation, SeedPattern
from warpsim.orbit.ephemeris import EphemerisOrbit, EphemerisSatellites
from warpsim.scene.attitudes import within_scene
from warpsim.scene.groups import AnyConstellation, TargetGroup
from warpsim.scene.short_form import item_path
from warpsim.target.mesh import Mesh


def check_paths(
    constellation: AnyConstellation, groups: Sequence[TargetGroup], epoch: Instant, duration_s: float
) -> None:
    """Check that tabulated motion covers the scene, and that ballistic arcs have a solution.

    Raises:
        InputError: It does not, or a file cannot be read; the path begins with the field.
    """
    _check_path(constellation, "constellation", epoch, (0.0, duration_s))
    for number, group in enumerate(groups):
        first_s, last_s = within_scene(group.span_s, duration_s)
        start, span_s = instant_after(epoch, group.start_s), (first_s - group.start_s, last_s - group.start_s)
        try:
            _check_path(group.path, group.path_field, start, span_s)
        except InputError as error:
            raise error.within(item_path("groups", number, len(groups))) from None


def _check_path(path: Any, field: str, epoch: Instant, span_s: tuple[float, float]) -> None:
    """Check a path, or a constellation with the paths in it, over a span after its time 0 [s]."""
    if isinstance(path, MixedConstellation):
        for number, part in enumerate(path.parts):
            _check_path(part, f"{field}.parts[{number}]", epoch, span_s)
    elif isinstance(path, ListedSatellites):
        for number, item in enumerate(path.satellites):
            _check_path(item.orbit, f"{field}.satellites[{number}].orbit", epoch, span_s)
    try:
        if isinstance(path, BallisticArc):
            _check_arc(path, epoch, span_s[1])
        elif isinstance(path, EphemerisOrbit | EphemerisSatellites):
            gaps_s = [time_s for time_s in path.gaps_s(epoch) if span_s[0] < time_s < span_s[1]]
            path.states(epoch, np.array([*span_s, *gaps_s]))
            path.notes(epoch, span_s[1])
        elif isinstance(path, SeedPattern):
            path.states(epoch, np.zeros(1))
    except InputError as error:
        raise error.within(field) from None


def _check_arc(arc: BallisticArc, epoch: Instant, end_s: float) -> None:
    """Check that an arc covers the scene, has the scene's epoch, and has a solution."""
    if end_s > arc.duration_s:
        raise InputError(f"must be at least {end_s:g}, until when it is asked for", "duration_s", arc.duration_s, "g")
    arc.flight(epoch).start_velocity_m_s  # noqa: B018  # solved here


def check_shapes(groups: Sequence[TargetGroup]) -> None:
    """Check that meshes in files can be read.

    Raises:
        InputError: One cannot; the path begins with the field.
    """
    for number, group in enumerate(groups):
        for entry, spec in enumerate(group.targets):
            if isinstance(spec.shape, Mesh):
                try:
                    spec.shape.surface_m2  # noqa: B018  # reads the file
                except InputError as error:
                    path = item_path("groups", number, len(groups))
                    raise error.within(f"targets[{entry}].shape").within(path) from None


def check_surfaces(groups: Sequence[TargetGroup]) -> None:
    """Check that surfaces in files can be read.

    Raises:
        InputError: One cannot; the path begins with the field.
    """
    for number, group in enumerate(groups):
        for entry, spec in enumerate(group.targets):
            if spec.surface.is_spectral:
                try:
                    spec.surface.emissivity_curve  # noqa: B018  # reads the file
                except InputError as error:
                    path = item_path("groups", number, len(groups))
                    raise error.within(f"targets[{entry}].surface").within(path) from None


def check_psf_files(optics: Optics) -> None:
    """Check that images of point spread functions can be read.

    Raises:
        InputError: One cannot; the path begins with the field.
    """
    try:
        optics.file_checksums  # noqa: B018  # reads the files
    except InputError as error:
        raise error.within("optics.psf_file") from None
