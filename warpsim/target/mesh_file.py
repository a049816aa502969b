"""Meshes out of files, read by trimesh: its extra `mesh`."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpsim.errors import InputError, one_line
from warpsim.exchange.source import SourceFile, number_of

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_OBJ_CORNER = re.compile(r"(-?\d+)(/(-?\d+)?)?(/-?\d+)?")
_STL_HEAD, _STL_FACET = 84, 50  # bytes


def read_mesh(source: SourceFile) -> tuple[F64, I64]:
    """Vertices, in the file's units, shape (n_vertex, 3), and faces, shape (n_face, 3), numbers counted from 0.

    Raises:
        InputError: trimesh is not installed, does not know the format, or cannot read the content.
    """
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
        mesh = trimesh.load_mesh(io.BytesIO(source.data), file_type=ending, process=False)
        vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    except Exception as error:  # each format of trimesh has errors of its own
        kind = ending.upper() or "a mesh"
        raise InputError(f"cannot be read as {kind}: {one_line(error)}").of(source.file) from None
    if not len(faces):
        raise InputError("must hold faces, got none").of(source.file)
    return vertices.reshape(len(vertices), -1)[:, :3], faces


def _check_obj(source: SourceFile) -> None:
    """Check what trimesh accepts silently: short lines, and vertex numbers that count backwards.

    Raises:
        InputError: File and line are named.
    """
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
    """Make sure that the file is whole.

    Raises:
        InputError: It is cut off, or no STL.
    """
    data = source.data
    if len(data) >= _STL_HEAD:
        n_facet = int.from_bytes(data[_STL_HEAD - 4 : _STL_HEAD], "little")
        if len(data) == _STL_HEAD + _STL_FACET * n_facet:
            return
    if not (data.lstrip()[:5].lower() == b"solid" and b"endsolid" in data.lower()):
        raise source.error(0, "must be a whole STL file, binary or text; it is cut off, or of another format")
