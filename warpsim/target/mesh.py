"""Bodies of any form: closed triangle meshes, also out of files that trimesh reads (its extra `mesh`)."""

from __future__ import annotations

import io
import re
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BeforeValidator, Field, model_validator

from warpsim.arrays import F64, I64
from warpsim.config.fields import FileName, Positive, rule_error
from warpsim.config.model import config_model
from warpsim.errors import InputError, one_line
from warpsim.exchange.source import SourceFile, number_of
from warpsim.target.areas import Areas
from warpsim.target.closed_surface import ClosedSurface, closed_surface
from warpsim.target.from_file import FromFile


def _rows_of_three(value: Any, kinds: str, what: str) -> tuple[tuple[Any, ...], ...]:
    try:
        rows = np.asarray(value)
    except ValueError:  # rows of several lengths
        raise rule_error(f"must be rows of three {what}") from None
    if rows.ndim != 2 or rows.shape[1] != 3 or rows.dtype.kind not in kinds:
        raise rule_error(f"must be rows of three {what}")
    return tuple(map(tuple, rows.tolist()))


def _vertices(value: Any) -> Any:
    """Arrays become tuples, quantities of length metres."""
    if hasattr(value, "unit") and hasattr(value, "to_value"):
        try:
            value = value.to_value("m")
        except Exception:
            raise rule_error("must be convertible to m") from None
    return tuple((float(x), float(y), float(z)) for x, y, z in _rows_of_three(value, "fiu", "numbers"))


def _triangles(value: Any) -> Any:
    return _rows_of_three(value, "iu", "whole numbers")


Vertices = Annotated[tuple[tuple[float, float, float], ...], BeforeValidator(_vertices)]
Triangles = Annotated[tuple[tuple[int, int, int], ...], BeforeValidator(_triangles)]


@config_model
class Mesh(Areas, FromFile):
    """A closed triangle mesh; give `file`, or `vertices_m` and `faces`.

    It must be watertight and wound in one sense; one that is all inside out is turned. Facets do not hide or shade each
    other: for a mesh that is not convex (`convex`), areas are those without self-shadowing, which are too large.

    Args:
        file: OBJ, STL, or what else trimesh reads (PLY, OFF, GLB); read and checked on first use, and then kept. Needs
            the extra `mesh`.
        scale_m: Metres per unit of the file. Body axes are the file's axes.
        vertices_m: Vertices, body axes, rows of three [m].
        faces: Triangles as numbers of vertices, counted from 0, rows of three.
    """

    file: FileName | None = None
    scale_m: Positive = 1.0
    vertices_m: Vertices | None = None
    faces: Triangles | None = None
    kind: Literal["mesh"] = Field(default="mesh", kw_only=True)

    @model_validator(mode="after")
    def _sound(self) -> Mesh:
        inline = self._is_inline("vertices_m", "faces")
        if inline and self.scale_m != 1.0:
            raise InputError("belongs to a file, which is not given", "scale_m", self.scale_m, "g")
        if inline:
            try:
                self.surface  # noqa: B018  # checked here, where the field's path is known
            except InputError as error:
                raise error.within("faces") from None
        return self

    @cached_property
    def surface(self) -> ClosedSurface:
        """The mesh as read and checked, with its facets.

        Raises:
            InputError: The file cannot be read, or its mesh is not closed or is not valid otherwise.
        """
        if self.file is None:
            return closed_surface(np.array(self.vertices_m), np.array(self.faces, dtype=np.int64))
        vertices, faces = read_mesh(self._source)
        try:
            return closed_surface(vertices * self.scale_m, faces)
        except InputError as error:
            raise error.of(self.file) from None

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(self.surface.area_m2.sum())

    @property
    def convex(self) -> bool:
        """Return whether areas are exact: no part of the body hides another; to 1e-5 of its extent."""
        return self.surface.convex

    def notes(self) -> list[str]:
        """Warnings for the user, a line each.

        Of a mesh that is not convex every face that turns to the sensor counts: also those behind others, those inside
        a hollow body, and those of parts that are wound inside out while the whole is not.
        """
        if self.convex:
            return []
        name = self.file or f"mesh of {len(self.surface.faces)} faces"
        return [f"{name} is not convex: parts of it that hide or shade each other are not modelled, it is too bright"]

    def projected_area_m2(self, aspect_rad: npt.ArrayLike) -> F64:
        """Refuse an aspect angle: a mesh has no axis of symmetry.

        Raises:
            InputError: Always.
        """
        raise InputError("does not define the view of a mesh; use projected_area_along_m2(view)", "aspect_rad")


_OBJ_CORNER = re.compile(r"(-?\d+)(/(-?\d+)?)?(/-?\d+)?")
_STL_HEAD, _STL_FACET = 84, 50  # bytes


def read_mesh(source: SourceFile) -> tuple[F64, I64]:
    """Vertices in the file's units, (n_vertex, 3), and faces, (n_face, 3), numbers counted from 0."""
    try:
        import trimesh
    except ImportError:
        rule = "a mesh file needs trimesh, which the extra `mesh` brings: pip install 'warpsim[mesh]'"
        raise InputError(rule).of(source.file) from None
    ending = Path(source.file).suffix.lower().removeprefix(".")
    if ending == "obj":
        _check_obj(source)
    elif ending == "stl":
        _check_stl(source)
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are refused below
            mesh = trimesh.load_mesh(io.BytesIO(source.data), file_type=ending, process=False)
            vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # each format of trimesh has errors of its own
        kind = ending.upper() or "a mesh"
        raise InputError(f"cannot be read as {kind}: {one_line(error)}").of(source.file) from None
    if not len(faces) or not len(vertices):
        raise InputError(f"must hold {'vertices' if len(faces) else 'faces'}, got none").of(source.file)
    return vertices.reshape(len(vertices), -1)[:, :3], faces


def _check_obj(source: SourceFile) -> None:
    """Refuse what trimesh accepts silently: short lines, and vertex numbers that count backwards."""
    n_vertex, corners = 0, []
    for number, line in enumerate(source.text.split("\n"), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] == "v":
            n_vertex += 1
            if len(words) < 4:
                raise source.error(number, "a vertex must have 3 coordinates", value=len(words) - 1)
            for word in words[1:4]:
                number_of(source, number, word)
        elif words[0] == "f":
            if len(words) < 4:
                raise source.error(number, "a face must have at least 3 corners", value=len(words) - 1)
            corners += [(number, word) for word in words[1:]]
    for number, word in corners:
        match = _OBJ_CORNER.fullmatch(word)
        if match is None:
            raise source.error(number, "corners must be numbers of vertices", value=word[:40])
        vertex = int(match[1])
        if vertex < 1:
            raise source.error(number, "numbers of vertices must count from 1 (not backwards)", value=vertex)
        if vertex > n_vertex:
            raise source.error(number, f"face names vertex {vertex} of {n_vertex}")


def _check_stl(source: SourceFile) -> None:
    """Refuse files that are cut off."""
    data = source.data
    if len(data) >= _STL_HEAD:
        n_facet = int.from_bytes(data[_STL_HEAD - 4 : _STL_HEAD], "little")
        if len(data) == _STL_HEAD + _STL_FACET * n_facet:
            return
    if not (data.lstrip()[:5].lower() == b"solid" and b"endsolid" in data.lower()):
        raise source.error(0, "must be a whole STL file, binary or text; it is cut off, or of another format")
