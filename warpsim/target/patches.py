"""Patches of a body's surface with another emissivity and reflectance: bands and sectors of turned bodies, faces.

A patch is known by facets: strips of a degree of a side, cells of 3 degrees of a sphere, and what is flat as it is.
Each has the area vector of the piece that it stands for, so that a piece which is seen whole emits what it should.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, model_validator

from warpsim.arrays import F64
from warpsim.config.fields import Integer, Number, as_tuple, closed_interval
from warpsim.config.model import config_model
from warpsim.errors import InputError, errors_at
from warpsim.target.areas import Areas, top_radius_m
from warpsim.target.closed_surface import area_vectors, merged_facets
from warpsim.target.surface import Graybody

STRIP_DEG = 1.0
"""Largest width of the strips that a side is cut into: areas are then good to 4e-5 of the side's largest."""
CELL_DEG = 3.0
"""Largest size of the cells of a sphere: areas are good to 4e-4 of the disc."""

ON = {
    "sphere": ("side",),
    "cylinder": ("side", "top", "base"),
    "frustum": ("side", "top", "base"),
    "cone": ("side", "base"),
    "plate": ("top", "base"),
    "mesh": ("faces",),
}
"""Where the patches of each shape may be."""

Fraction = Annotated[Number, closed_interval(0, 1)]
Pair = Annotated[tuple[Fraction, Fraction], BeforeValidator(as_tuple)]
Turn = Annotated[tuple[Number, Number], BeforeValidator(as_tuple)]
Faces = Annotated[tuple[Annotated[Integer, closed_interval(0, 1e5)], ...], BeforeValidator(as_tuple)]


@config_model
class Patch:
    """A part of a target's surface of another emissivity and reflectance, as warm as the rest.

    Args:
        surface: Reflectance or emissivity, by band or for all.
        on: Where it is: side (also of a sphere), top or base; "faces" of a mesh.
        along: Where it begins and ends along the axis of a side or sphere: 0 at the base, 1 at the top.
        azimuth_deg: Where it begins and ends about the axis, from x towards y [deg]; it may go past 360 or begin
            below 0.
        faces: Of a mesh: numbers of triangles, counted from 0.
    """

    surface: Graybody
    on: Literal["side", "top", "base", "faces"] = "side"
    along: Pair = (0.0, 1.0)
    azimuth_deg: Turn = (0.0, 360.0)
    faces: Faces | None = None

    @model_validator(mode="after")
    def _sound(self) -> Patch:
        if self.along[0] >= self.along[1]:
            raise InputError("must be [first, last], the first before the last", "along", list(self.along))
        if not 0.0 < self.azimuth_deg[1] - self.azimuth_deg[0] <= 360.0:
            raise InputError("must be [first, last], up to 360 apart", "azimuth_deg", list(self.azimuth_deg))
        if self.on == "faces" and not self.faces:
            raise InputError("must be given", "faces")
        if self.faces and len(set(self.faces)) < len(self.faces):
            raise InputError("must name each face once", "faces", list(self.faces))
        if self.on != "faces" and self.faces is not None:
            raise InputError("belongs to a patch on 'faces'", "faces", list(self.faces))
        if self.on == "faces" and self.azimuth_deg != (0.0, 360.0):
            raise InputError("does not belong to a patch on 'faces'", "azimuth_deg", list(self.azimuth_deg))
        if self.on != "side" and self.along != (0.0, 1.0):
            raise InputError("belongs to a patch on the side", "along", list(self.along))
        return self

    @property
    def shows_spin(self) -> bool:
        """Whether it looks different from other azimuths: a sector of a side or sphere, or faces; no flat end does."""
        return self.on == "faces" or (self.on == "side" and self.azimuth_deg[1] - self.azimuth_deg[0] < 360.0)


@dataclass(frozen=True)
class OpenSurface:
    """Facets of a part of a body."""

    normal: F64
    """Outward, unit, body axes, shape (n_facet, 3)."""
    area_m2: F64
    """Shape (n_facet,)."""


@dataclass(frozen=True)
class PatchArea(Areas):
    """Areas of a patch of a body."""

    shape: Any
    patch: Patch
    kind: str = "patch"

    @cached_property
    def surface(self) -> OpenSurface:
        """Its facets.

        Raises:
            InputError: It names faces that the mesh does not have, or is too thin to have an area.
        """
        if self.patch.on == "faces":
            return self._of_faces()
        start, end = np.radians(self.patch.azimuth_deg)
        if self.patch.on == "side":
            with np.errstate(invalid="ignore"):
                ring = _of_sphere if self.shape.kind == "sphere" else _of_side
                side = ring(self.shape, self.patch.along, start, end)
            if not (side.area_m2 > 0.0).all():
                raise InputError("must be wide enough to have an area")
            return side
        if self.shape.kind == "plate":
            area_m2 = self.shape.width_m * self.shape.length_m
        else:
            radius_m = self.shape.radius_m if self.patch.on == "base" else top_radius_m(self.shape)
            area_m2 = 0.5 * (end - start) * radius_m**2
        return OpenSurface(np.array([[0.0, 0.0, 1.0 if self.patch.on == "top" else -1.0]]), np.array([area_m2]))

    @property
    def surface_m2(self) -> float:
        """The patch's area [m2]."""
        return float(self.surface.area_m2.sum())

    def _of_faces(self) -> OpenSurface:
        whole = self.shape.surface
        number = np.array(self.patch.faces)
        if number.max() >= len(whole.faces):
            raise InputError(f"must be below {len(whole.faces)}, the number of faces", "faces", int(number.max()))
        return OpenSurface(*merged_facets(area_vectors(whole.vertices_m, whole.faces)[number]))


def _parts(start: float, end: float, largest_deg: float) -> tuple[F64, float]:
    """Middles of equal parts of an interval, and their width [rad]."""
    n = max(1, int(np.ceil(np.degrees(end - start) / largest_deg - 1e-9)))
    width = (end - start) / n
    return np.asarray(start + width * (np.arange(n) + 0.5)), width


def _of_side(shape: Any, along: tuple[float, float], start: float, end: float) -> OpenSurface:
    """Strips from the patch's lower end to its upper."""
    radius_m, top_m, height_m = shape.radius_m, top_radius_m(shape), shape.height_m
    low, high = along
    mean_m = radius_m + (top_m - radius_m) * 0.5 * (low + high)
    azimuth, width = _parts(start, end, STRIP_DEG)
    across = height_m * np.sinc(width / (2 * np.pi))
    up = np.full(len(azimuth), radius_m - top_m)
    vector = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), up], axis=1)
    length = np.linalg.norm(vector, axis=1)
    return OpenSurface(vector / length[:, None], width * mean_m * (high - low) * length)


def _of_sphere(shape: Any, along: tuple[float, float], start: float, end: float) -> OpenSurface:
    """Rings of equal steps of the polar angle, cut into cells that are about as wide."""
    first, last = np.arccos(1.0 - 2.0 * np.array(along))  # from the base
    middle, height = _parts(first, last, CELL_DEG)
    normal, area = [], []
    for polar in middle:
        azimuth, width = _parts(start, end, CELL_DEG / max(np.sin(polar), 1e-3))
        ring = 0.5 * (height - np.sin(height) * np.cos(2.0 * polar))  # integral of the squared sine
        across = 2.0 * np.sin(0.5 * width) * ring
        up = -0.5 * width * np.sin(height) * np.sin(2.0 * polar)
        vector = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), np.full(len(azimuth), up)], axis=1)
        length = np.linalg.norm(vector, axis=1)
        normal.append(vector / length[:, None])
        area.append(shape.radius_m**2 * length)
    return OpenSurface(np.concatenate(normal), np.concatenate(area))


def check_patches(shape: Any, patches: Sequence[Patch]) -> None:
    """Check that patches are on a shape, and not on each other.

    Raises:
        InputError: They are not.
    """
    for number, patch in enumerate(patches):
        if patch.on not in ON.get(shape.kind, ()):
            allowed = ", ".join(ON.get(shape.kind, ("nothing",)))
            raise InputError(f"must be one of {allowed} of a {shape.kind}", f"patches[{number}].on", patch.on)
        if shape.kind == "plate" and patch.azimuth_deg != (0.0, 360.0):
            raise InputError("does not belong to a plate", f"patches[{number}].azimuth_deg", list(patch.azimuth_deg))
    for (first, one), (second, other) in itertools.combinations(enumerate(patches), 2):
        if _overlap(one, other):
            raise InputError(f"patches[{first}] and patches[{second}] must not overlap", "patches")


def _overlap(one: Patch, other: Patch) -> bool:
    if one.on != other.on:
        return False
    if one.faces is not None and other.faces is not None:
        return bool(set(one.faces) & set(other.faces))
    if min(one.along[1], other.along[1]) <= max(one.along[0], other.along[0]):
        return False
    ahead = (other.azimuth_deg[0] - one.azimuth_deg[0]) % 360.0
    spans = [patch.azimuth_deg[1] - patch.azimuth_deg[0] for patch in (one, other)]
    return ahead < spans[0] * (1 - 1e-12) or ahead + spans[1] > 360.0 * (1 + 1e-12)


def patch_areas(shape: Any, patches: Sequence[Patch]) -> list[PatchArea]:
    """Return the areas of patches of a shape, their facets found.

    Raises:
        InputError: A patch names faces that the mesh does not have, or is too thin to have an area.
    """
    found = [PatchArea(shape, patch) for patch in patches]
    for number, area in enumerate(found):
        with errors_at(f"patches[{number}]"):
            area.surface  # noqa: B018  # checked here
    return found
