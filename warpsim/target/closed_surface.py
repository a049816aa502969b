"""Closed surfaces of triangles: checks, orientation, convexity, and the facets that areas are summed over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from warpsim.arrays import F64, I64
from warpsim.errors import InputError

MOST_FACES = 100_000
LARGEST_EXTENT_M = 1e5
"""As for the lengths of other shapes: far larger bodies would overflow float32 irradiances."""
SAME_NORMAL = 1e-12
"""Facets whose normals agree to this become one: rounding apart, their areas are the same."""
FLAT = 1e-5
"""A mesh may bulge inwards by this part of its extent and still counts as convex: files hold six digits or so."""

_THINNEST = 1e-13  # a triangle's area over its longest edge squared; below, its normal is rounding
_FOLDED = -1 + 1e-11  # cosine between the normals of neighbours that lie on each other
_LEAST_VOLUME = 1e-15  # part of the extent cubed


@dataclass(frozen=True)
class ClosedSurface:
    """A checked mesh, its faces seen counter-clockwise from outside."""

    vertices_m: F64
    """Shape (n_vertex, 3), each position once."""
    faces: I64
    """Shape (n_face, 3), numbers of vertices."""
    normal: F64
    """Outward unit normals of the facets, shape (n_facet, 3): faces of one normal are one facet."""
    area_m2: F64
    """Areas of the facets, shape (n_facet,)."""
    volume_m3: float
    n_reentrant: int
    """Number of reentrant edges."""
    convex: bool


def closed_surface(vertices_m: F64, faces: I64) -> ClosedSurface:
    """Check a triangle mesh [m] and work out what areas need; faces all wound inwards are turned."""
    _check_numbers(vertices_m, faces)
    # The same position may stand in a file several times: once for each face in STL, once for each texture in OBJ.
    vertices, number = np.unique(vertices_m + 0.0, axis=0, return_inverse=True)
    faces = number.reshape(-1)[faces]
    extent_m = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    if not 0 < extent_m <= LARGEST_EXTENT_M:
        raise InputError(f"must extend over 0 to {LARGEST_EXTENT_M:g} m, got {extent_m:g} m")
    scaled = (vertices - vertices[faces[0, 0]]) / extent_m  # about a vertex: digits do not depend on the origin
    vector = area_vectors(scaled, faces)
    neighbour = _neighbours(faces, vector)
    volume = float(np.sum(scaled[faces].mean(axis=1) * vector) / 3)
    if abs(volume) <= _LEAST_VOLUME:
        raise InputError("must enclose a volume")
    if volume < 0:
        faces = faces[:, ::-1]
        vector = area_vectors(scaled, faces)
        neighbour = _neighbours(faces, vector)
    n_reentrant = _reentrant_edges(scaled, faces, vector, neighbour)
    convex = n_reentrant == 0 and _covers_once(scaled, faces, vector)
    normal, area = merged_facets(vector)
    return ClosedSurface(vertices, faces, normal, area * extent_m**2, abs(volume) * extent_m**3, n_reentrant, convex)


def _check_numbers(vertices_m: F64, faces: I64) -> None:
    """Sizes, ranges and numbers that are none."""
    if len(faces) < 4:
        raise InputError("must have at least 4 faces to be closed", value=len(faces))
    if len(faces) > MOST_FACES:
        raise InputError(f"must have at most {MOST_FACES} faces", value=len(faces))
    (bad,) = np.nonzero(~np.isfinite(vertices_m).all(axis=1))
    if len(bad):
        raise InputError(f"vertices must be finite, got {vertices_m[bad[0]].tolist()} as vertex {bad[0]}")
    (bad,) = np.nonzero(((faces < 0) | (faces >= len(vertices_m))).any(axis=1))
    if len(bad):
        face = faces[bad[0]]
        wrong = face[(face < 0) | (face >= len(vertices_m))][0]
        raise InputError(f"face {bad[0]} names vertex {wrong} of {len(vertices_m)} (counted from 0)")


def area_vectors(vertices: F64, faces: I64) -> F64:
    """Area times normal of each face, shape (n_face, 3)."""
    corner = vertices[faces]
    edge = np.roll(corner, -1, axis=1) - corner
    # From the two shorter edges: rounding of the third, the sum of both, is the largest.
    long = np.sum(edge**2, axis=2).argmax(axis=1)
    row = np.arange(len(faces))
    vector = 0.5 * np.cross(edge[row, (long + 1) % 3], edge[row, (long + 2) % 3])
    area = np.linalg.norm(vector, axis=1)
    (flat,) = np.nonzero(~(area > _THINNEST * np.sum(edge[row, long] ** 2, axis=1)))
    if len(flat):
        raise InputError(f"face {flat[0]} has no area")
    return np.asarray(vector)


def _neighbours(faces: I64, vector: F64) -> I64:
    """The face behind each edge, shape (n_face, 3); edge k goes from corner k to the next."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    size = faces.max() + 1
    key = np.minimum(start, end) * size + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    owner = order // 3
    if (count == 1).any():
        n_open = int(np.sum(count == 1))
        edges = "1 open edge" if n_open == 1 else f"{n_open} open edges"
        raise InputError(f"must be closed, has {edges}, one of them at face {owner[first[count == 1][0]]}")
    if (count > 2).any():
        at = first[count > 2][0]
        several = ", ".join(str(face) for face in owner[at : at + count[count > 2][0]][:6])
        raise InputError(f"each edge must belong to two faces, one belongs to faces {several}")
    one, other = order[first], order[first + 1]
    (same,) = np.nonzero(start[one] == start[other])
    if len(same):
        pair = f"{one[same[0]] // 3} and {other[same[0]] // 3}"
        raise InputError(f"faces must all be wound in one sense, those of faces {pair} are opposite")
    unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    (fold,) = np.nonzero(np.sum(unit[one // 3] * unit[other // 3], axis=1) < _FOLDED)
    if len(fold):
        pair = f"{one[fold[0]] // 3} and {other[fold[0]] // 3}"
        raise InputError(f"faces {pair} lie on each other (a polygon that is not convex must be cut into triangles)")
    behind = np.empty(len(key), dtype=np.int64)
    behind[one], behind[other] = other // 3, one // 3
    return behind.reshape(-1, 3)


def _reentrant_edges(vertices: F64, faces: I64, vector: F64, neighbour: I64) -> int:
    """Edges over which the neighbour rises above a face's plane by more than FLAT."""
    unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    above = vertices[faces[neighbour]] - vertices[faces][:, :, None]  # corners of each neighbour from the edge's start
    height = np.einsum("fecx,fx->fec", above, unit).max(axis=2)
    face, edge = np.nonzero(height > FLAT)
    other = neighbour[face, edge]
    return len(set(zip(np.minimum(face, other).tolist(), np.maximum(face, other).tolist(), strict=True)))


def _covers_once(vertices: F64, faces: I64, vector: F64) -> bool:
    """Return whether every direction from the centre of volume meets the surface once.

    With no reentrant edge, the surface is then that of a convex body. (A pentagram's double pyramid has no such
    edge either, but goes round its centre twice.) Solid angles: van Oosterom and Strackee 1983.
    """
    corner = vertices[faces]
    volume = np.sum(corner.mean(axis=1) * vector, axis=1)
    centre = np.sum(0.75 * corner.mean(axis=1) * volume[:, None], axis=0) / volume.sum()
    a, b, c = np.moveaxis(corner - centre, 1, 0)
    if not (np.sum(a * vector, axis=1) > -FLAT * np.linalg.norm(vector, axis=1)).all():
        return False
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    dot_ab, dot_bc, dot_ca = (np.sum(x * y, axis=1) for x, y in ((a, b), (b, c), (c, a)))
    triple = 2 * np.sum(a * vector, axis=1)
    solid_angle = 2 * np.arctan2(triple, la * lb * lc + dot_ab * lc + dot_bc * la + dot_ca * lb)
    return bool(abs(solid_angle.sum() - 4 * np.pi) < 1.0)


def merged_facets(vector: F64) -> tuple[F64, F64]:
    """Normals and areas of facets, those of one normal summed up."""
    unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    _, group = np.unique(np.round(unit / SAME_NORMAL) + 0.0, axis=0, return_inverse=True)
    group = group.reshape(-1)
    total = np.stack([np.bincount(group, weights=vector[:, k]) for k in range(3)], axis=1)
    area = np.linalg.norm(total, axis=1)
    return total / area[:, None], area
