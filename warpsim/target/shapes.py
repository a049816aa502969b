"""Convex bodies of revolution. Symmetry axis +z; the cone's apex points towards +z."""

from __future__ import annotations

from typing import Annotated, Any, Literal, cast

import numpy as np
import numpy.typing as npt
from pydantic import Field

from warpsim.describe import Length, part
from warpsim.errors import InputError


class _Body:
    """What all shapes share: areas, evaluated by the same device code that renders."""

    def projected_area_m2(self, aspect_rad: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Area of the outline [m2].

        Args:
            aspect_rad: Angle between body axis (base to apex) and the direction to the observer [rad], any shape.

        Returns:
            Array of the same shape.

        Raises:
            InputError: An angle is NaN or infinite.
        """
        import warp as wp
        from warpsim_kernels.shapes import projected_area_kernel

        aspect = np.asarray(aspect_rad, dtype=np.float64)
        if not np.isfinite(aspect).all():
            raise InputError(f"aspect_rad: must be finite, got {aspect[~np.isfinite(aspect)].flat[0]}")
        inputs = wp.array(np.ravel(aspect), dtype=wp.float64, device="cpu")
        area = wp.empty_like(inputs)
        body = body_struct(cast("Shape", self))
        wp.launch(projected_area_kernel, dim=aspect.size, inputs=[body, inputs], outputs=[area], device="cpu")
        return np.asarray(area.numpy()).reshape(aspect.shape)

    def reflected_area_m2(self, view: npt.ArrayLike, sun: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Placeholder."""
        import warp as wp
        from warpsim_kernels.shapes import reflected_area_kernel

        inputs = [wp.array(np.ascontiguousarray(x), dtype=wp.vec3d, device="cpu") for x in (view, sun)]
        area = wp.empty(len(inputs[0]), dtype=wp.float64, device="cpu")
        wp.launch(reflected_area_kernel, len(area), inputs=[body_struct(self), *inputs], outputs=[area], device="cpu")
        return np.asarray(area.numpy())


@part
class Sphere(_Body):
    """A sphere of radius_m [m]."""

    radius_m: Length
    kind: Literal["sphere"] = Field(default="sphere", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(4 * np.pi * self.radius_m**2)


@part
class Cylinder(_Body):
    """A closed cylinder of radius_m and height_m [m]."""

    radius_m: Length
    height_m: Length
    kind: Literal["cylinder"] = Field(default="cylinder", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(2 * np.pi * self.radius_m * (self.radius_m + self.height_m))


@part
class Cone(_Body):
    """A closed cone of base radius_m and height_m [m]."""

    radius_m: Length
    height_m: Length
    kind: Literal["cone"] = Field(default="cone", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(np.pi * self.radius_m * (self.radius_m + np.hypot(self.radius_m, self.height_m)))


Shape = Annotated[Sphere | Cylinder | Cone, Field(discriminator="kind")]


def body_struct(shape: Any) -> Any:
    """The shape as the kernels' struct."""
    from warpsim_kernels.shapes import Body

    body = Body()
    if shape.kind == "sphere":
        body.radius_m = shape.radius_m
        return body
    radius_m, height_m = shape.radius_m, shape.height_m
    top_m = radius_m if shape.kind == "cylinder" else 0.0
    slant_m = float(np.hypot(height_m, radius_m - top_m))
    body.top_m2, body.base_m2 = np.pi * top_m**2, np.pi * radius_m**2
    body.side_m2 = np.pi * (radius_m + top_m) * slant_m
    body.side_across, body.side_along = height_m / slant_m, (radius_m - top_m) / slant_m
    return body
