"""Bodies of closed form, and all shapes together. Symmetry axis +z; the cone's apex points towards +z."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from warpsim.config.fields import Length, NonNegative, closed_interval
from warpsim.config.model import config_model
from warpsim.target.areas import Areas
from warpsim.target.areas import body_struct as body_struct
from warpsim.target.mesh import Mesh

Radius = Annotated[Length, Field(description="Of the sphere, or of the base, which is towards -z.")]
Height = Annotated[Length, Field(description="Along the body axis z.")]


@config_model
class Sphere(Areas):
    """A sphere of radius_m [m]."""

    radius_m: Radius
    kind: Literal["sphere"] = Field(default="sphere", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(4 * np.pi * self.radius_m**2)


@config_model
class Cylinder(Areas):
    """A closed cylinder of radius_m and height_m [m]."""

    radius_m: Radius
    height_m: Height
    kind: Literal["cylinder"] = Field(default="cylinder", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(2 * np.pi * self.radius_m * (self.radius_m + self.height_m))


@config_model
class Cone(Areas):
    """A closed cone of base radius_m and height_m [m]."""

    radius_m: Radius
    height_m: Height
    kind: Literal["cone"] = Field(default="cone", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        return float(np.pi * self.radius_m * (self.radius_m + np.hypot(self.radius_m, self.height_m)))


@config_model
class Frustum(Areas):
    """A closed cone cut off parallel to its base: radius_m at its base, top_radius_m at its top, height_m [m].

    The top, towards +z, may be the wider end; with top_radius_m = 0 it is the cone.
    """

    radius_m: Radius
    top_radius_m: Annotated[NonNegative, closed_interval(0, 1e5)]
    """Of the end towards +z, which may be the wider one; 0 is a cone."""
    height_m: Height
    kind: Literal["frustum"] = Field(default="frustum", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Whole surface [m2]."""
        slant_m = np.hypot(self.radius_m - self.top_radius_m, self.height_m)
        ends_m2 = np.pi * (self.radius_m**2 + self.top_radius_m**2)
        return float(ends_m2 + np.pi * (self.radius_m + self.top_radius_m) * slant_m)


@config_model
class Plate(Areas):
    """A thin rectangle of width_m (along x) and length_m (along y) [m], its normal along z; both faces count."""

    width_m: Length
    """Along x."""
    length_m: Length
    """Along y."""
    kind: Literal["plate"] = Field(default="plate", kw_only=True)

    @property
    def surface_m2(self) -> float:
        """Surface of both faces [m2]."""
        return 2 * self.width_m * self.length_m


Shape = Annotated[Sphere | Cylinder | Cone | Frustum | Plate | Mesh, Field(discriminator="kind")]
