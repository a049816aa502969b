"""The facets of a scene's meshes on a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class FacetTable:
    """Facets of some shapes, one mesh behind the other, and where each shape's are."""

    facets: Any
    """The kernels' struct `Facets`."""
    first: list[int]
    """First facet of each shape; 0 for those that have none."""
    count: list[int]
    """Facets of each shape; 0 for all but meshes."""


def facets_of(shapes: Sequence[Any], device: Any = None) -> FacetTable:
    """Put the facets of shapes on a device, those of equal meshes once.

    Args:
        shapes: Shapes of any kind.
        device: Where to; Warp's default if left out.
    """
    import warp as wp
    from warpsim_kernels.facets import Facets

    # Something is there to point at even without a mesh.
    normals, areas = [np.zeros((1, 3))], [np.zeros(1)]
    first_of: dict[bytes, int] = {}
    first, count, total = [], [], 1
    for shape in shapes:
        if shape.kind != "mesh":
            first.append(0)
            count.append(0)
            continue
        surface = shape.surface
        content = surface.normal.tobytes() + surface.area_m2.tobytes()
        if content not in first_of:
            first_of[content] = total
            normals.append(surface.normal)
            areas.append(surface.area_m2)
            total += len(surface.area_m2)
        first.append(first_of[content])
        count.append(len(surface.area_m2))
    facets: Any = Facets()
    facets.normal = wp.array(np.concatenate(normals), dtype=wp.vec3d, device=device)
    facets.area_m2 = wp.array(np.concatenate(areas), dtype=wp.float64, device=device)
    return FacetTable(facets, first, count)
