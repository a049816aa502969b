"""The scene's part `lighting`: which light reaches the targets from outside."""

from __future__ import annotations

from typing import Annotated

from warpsim.describe import NonNegative, Number, Switch, closed_interval, part


@part
class Lighting:
    """Light that targets reflect, besides what they emit.

    A term that stays below `leave_out_nei` for the whole scene, by a bound, is left out, as are terms switched off: the
    kernels are compiled without them. `scene.light_terms` tells which, and why.

    Args:
        sun: Whether targets reflect sunlight.
        earth: Whether targets reflect the Earth's thermal radiation.
        albedo: Whether targets reflect the sunlight that the Earth reflects.
        leave_out_nei: Largest irradiance of a term that may be left out [NEI]; 0 leaves out what is exactly 0.
        earth_albedo: Share of sunlight that the Earth reflects, as a Lambertian surface.
        quadrature_error: Largest error of quadratures, as a share of the largest value of what is integrated: over a
            body's side and the Earth's disc, and over the exposure.
    """

    sun: Switch = True
    earth: Switch = True
    albedo: Switch = True
    leave_out_nei: NonNegative = 0.01
    earth_albedo: Annotated[NonNegative, closed_interval(0, 1)] = 0.3
    quadrature_error: Annotated[Number, closed_interval(1e-5, 0.1)] = 1e-3
