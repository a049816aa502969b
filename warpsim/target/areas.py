"""Areas of shapes, evaluated by the same device code that renders; facets of meshes on a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from warpsim.arguments import plain_array
from warpsim.arrays import F64
from warpsim.errors import InputError

UNIT_TOLERANCE = 1e-6
"""How far from 1 the length of a given direction may be; it is then scaled to 1."""


class Areas:
    """Base of all shapes."""

    def projected_area_m2(self, aspect_rad: npt.ArrayLike) -> F64:
        """Projected area [m2].

        Args:
            aspect_rad: Angle between body axis (base to apex) and the direction to the observer [rad], any shape.

        Returns:
            Array of the same shape.

        Raises:
            InputError: An angle is NaN or infinite.
        """
        import warp as wp
        from warpsim_kernels.shapes import projected_area_kernel

        aspect = plain_array(aspect_rad, "rad", "aspect_rad")
        if not np.isfinite(aspect).all():
            raise InputError("must be finite", "aspect_rad", aspect[~np.isfinite(aspect)].flat[0])
        inputs = wp.array(np.ravel(aspect), dtype=wp.float64, device="cpu")
        area = wp.empty_like(inputs)
        body = body_struct(self)
        wp.launch(projected_area_kernel, dim=aspect.size, inputs=[body, inputs], outputs=[area], device="cpu")
        return np.asarray(area.numpy()).reshape(aspect.shape)

    def projected_area_along_m2(self, view: npt.ArrayLike) -> F64:
        """Projected area [m2] towards given directions.

        Args:
            view: Unit vectors towards the observer, body axes, shape (3,) or (..., 3).

        Returns:
            Array of the shape of view without its last axis.

        Raises:
            InputError: A vector is not of length 1 within 1e-6, or the shape is another.
        """
        from warpsim_kernels.shapes import projected_area_along_kernel

        return self._areas(projected_area_along_kernel, directions("view", view))

    def reflected_area_m2(self, view: npt.ArrayLike, sun: npt.ArrayLike) -> F64:
        """Integral of max(0, n.view) max(0, n.sun) over the surface [m2], n its outward normal.

        A Lambertian body of reflectance rho in the irradiance E sends rho / pi * E times this area towards view [W/sr].

        Args:
            view: Unit vectors towards the observer, body axes, shape (3,) or (..., 3).
            sun: Unit vectors towards the light, body axes, of a shape that broadcasts with view's.

        Returns:
            Array of the common shape without its last axis.

        Raises:
            InputError: A vector is not of length 1 within 1e-6, or the shapes are others.
        """
        from warpsim_kernels.shapes import reflected_area_kernel

        views, suns = directions("view", view), directions("sun", sun)
        try:
            views, suns = np.broadcast_arrays(views, suns)
        except ValueError:
            raise InputError(f"shapes must broadcast, got {views.shape} and {suns.shape}", "view, sun") from None
        return self._areas(reflected_area_kernel, views, suns)

    def _areas(self, kernel: Any, *directions: F64) -> F64:
        """Launch a kernel over directions of one shape."""
        import warp as wp

        table = facets_of([self], "cpu")
        inputs = [wp.array(x.reshape(-1, 3), dtype=wp.vec3d, device="cpu") for x in directions]
        area = wp.empty(len(inputs[0]), dtype=wp.float64, device="cpu")
        body = body_struct(self, table.first[0])
        wp.launch(kernel, dim=len(area), inputs=[body, table.facets, *inputs], outputs=[area], device="cpu")
        return np.asarray(area.numpy()).reshape(directions[0].shape[:-1])


def directions(name: str, value: npt.ArrayLike) -> F64:
    """Checked directions, scaled to length 1."""
    try:
        vectors = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("must be unit vectors, shape (3,) or (n, 3)", name) from None
    if vectors.ndim == 0 or vectors.shape[-1] != 3:
        raise InputError(f"must be unit vectors, shape (3,) or (n, 3), got shape {vectors.shape}", name)
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    wrong = ~(np.abs(length - 1) <= UNIT_TOLERANCE)
    if wrong.any():
        raise InputError(f"must be unit vectors, got one of length {length[wrong][0]:.9g}", name)
    return np.asarray(vectors / length)


def has_facets(shape: Any) -> bool:
    """Return whether a shape is known by the facets of its `surface` (`ClosedSurface`), as a mesh is."""
    return hasattr(shape, "surface")


def top_radius_m(shape: Any) -> float:
    """Radius of the flat end towards +z of a cylinder, cone or frustum [m]."""
    return float({"cylinder": shape.radius_m, "cone": 0.0}.get(shape.kind, getattr(shape, "top_radius_m", 0.0)))


def body_struct(shape: Any, first_facet: int | None = None) -> Any:
    """Return the shape as the kernels' struct; a mesh's facets begin at first_facet among those of the scene."""
    from warpsim_kernels.shapes import Body

    body: Any = Body()
    if shape.kind == "sphere":
        body.radius_m = shape.radius_m
        return body
    if has_facets(shape):
        if first_facet is None:
            raise InputError("a mesh can be used only with the facets of its scene", "shape")
        body.first_facet, body.n_facet = first_facet, len(shape.surface.area_m2)
        return body
    if shape.kind == "plate":
        body.top_m2 = body.base_m2 = shape.width_m * shape.length_m
        return body
    if shape.kind not in ("cylinder", "cone", "frustum"):
        raise InputError("has no areas in the kernels", "shape", shape.kind)
    radius_m, height_m = shape.radius_m, shape.height_m
    top_m = top_radius_m(shape)
    slant_m = float(np.hypot(height_m, radius_m - top_m))
    body.top_m2, body.base_m2 = np.pi * top_m**2, np.pi * radius_m**2
    body.side_m2 = np.pi * (radius_m + top_m) * slant_m
    body.side_across, body.side_along = height_m / slant_m, (radius_m - top_m) / slant_m
    return body


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
    """Put the facets of shapes of any kind on a device, those of equal meshes once."""
    import warp as wp
    from warpsim_kernels.shapes import Facets

    # Something is there to point at even without a mesh.
    normals, areas = [np.zeros((1, 3))], [np.zeros(1)]
    first_of: dict[bytes, int] = {}
    first, count, total = [], [], 1
    for shape in shapes:
        if not has_facets(shape):
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
