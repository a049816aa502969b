"""Earth infrared and Earth albedo on a target: view factors, effective areas, and quadrature nodes for an error.

The areas come from the device code that renders; see earthlight.py, albedo.py and albedo_series.py in kernels/.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from warpsim.errors import InputError
from warpsim.target.areas import body_struct, directions
from warpsim.target.facets import facets_of

F64 = npt.NDArray[np.float64]
Light = Literal["thermal", "albedo"]

NODE_ERRORS: MappingProxyType[int, dict[Light, float]] = MappingProxyType(
    {
        3: {"thermal": 2e-2, "albedo": 8e-2},
        4: {"thermal": 2e-3, "albedo": 2e-2},
        5: {"thermal": 1e-4, "albedo": 3e-3},
        6: {"thermal": 3e-5, "albedo": 2e-4},
        8: {"thermal": 4e-6, "albedo": 5e-5},
        12: {"thermal": 3e-7, "albedo": 5e-6},
        16: {"thermal": 4e-8, "albedo": 2e-6},
    }
)
"""Nodes of the rule, and the worst error from the Moon's distance down to 30 km above the ground (limb_sine <= 0.995).

Errors are fractions of limb_sine^2 times the largest projected area (albedo: times pi as well), which no body exceeds
from any side. They are some twice the largest found among 30,000 geometries of nine bodies; tests measure them anew.
Lower than 30 km, albedo may be off by 2e-3 with 6 nodes, 4e-4 with 8 and 1e-4 with 12; on the ground itself the table
holds again.
"""

SERIES_ERRORS: MappingProxyType[int, tuple[float, float]] = MappingProxyType(
    {4: (1e-2, 5e-2), 8: (4e-3, 3e-2), 12: (2e-3, 2e-2)}
)
"""Degree of albedo's series of harmonics, and its worst errors: near the Earth, and out to the Moon's distance.

Fractions as in `NODE_ERRORS`, but from the ground itself. Near is up to one Earth's radius above it (`NEAR_LIMB_SINE`).
The worst are faces turned straight up or down under a Sun in the zenith, where all harmonics add up.
"""

NEAR_LIMB_SINE = 0.5
"""Earth's radius over the largest distance from its centre at which the series' first errors hold."""

SERIES_RINGS: MappingProxyType[int, int] = MappingProxyType({4: 4, 8: 6, 12: 8})
"""Nodes of the rule over rings of the ground, by degree of the series: more do not lower its errors."""

FINEST = 12
"""Nodes of the functions here unless asked otherwise."""


def nodes_for(light: Light, error: float) -> int:
    """Return the fewest nodes whose worst error, as a fraction of the term's largest value, is at most `error`.

    Raises:
        InputError: No rule is as good as that.
    """
    for n_node, errors in NODE_ERRORS.items():
        if errors[light] <= error:
            return n_node
    best = min(errors[light] for errors in NODE_ERRORS.values())
    raise InputError(f"must be at least {best:g} for {light} light of the Earth", "error", error, "g")


def albedo_method(error: float, limb_sine: float) -> tuple[int, int]:
    """Return the fastest method for Earth albedo whose worst error is at most `error`.

    Args:
        error: As a fraction of the largest value that the term has for a body, see `NODE_ERRORS`.
        limb_sine: Smallest Earth's radius over distance from its centre.

    Returns:
        Degree of the series of harmonics, 0 if it is not good enough, and nodes of the rule: over rings of the ground,
        and without a series over azimuth as well.

    Raises:
        InputError: No method is as good as that.
    """
    for degree, (near, anywhere) in SERIES_ERRORS.items():
        if (near if limb_sine >= NEAR_LIMB_SINE else anywhere) <= error:
            return degree, SERIES_RINGS[degree]
    return 0, nodes_for("albedo", error)


def rule_struct(n_node: int, device: Any = None) -> Any:
    """Gauss-Legendre rule of n_node nodes as the kernels' struct.

    Args:
        n_node: Nodes, >= 1.
        device: Where to; Warp's default if left out.
    """
    import warp as wp
    from warpsim_kernels.earthlight import Rule

    node, weight = np.polynomial.legendre.leggauss(n_node)
    rule: Any = Rule()
    rule.place = wp.array((1.0 + node) / 2.0, dtype=wp.float64, device=device)
    rule.weight = wp.array(weight / 2.0, dtype=wp.float64, device=device)
    rule.n_node = n_node
    return rule


def view_factor(cosine: npt.ArrayLike, limb_sine: npt.ArrayLike) -> F64:
    """View factor of a plane element to the Earth's sphere, the twin of the kernels' (Hamilton and Morgan 1952, P-6).

    Args:
        cosine: Of the angle between the element's normal and the nadir.
        limb_sine: Earth's radius over distance from its centre; more than 1 counts as 1. Shapes broadcast.
    """
    c, s = np.broadcast_arrays(np.asarray(cosine, np.float64), np.minimum(np.asarray(limb_sine, np.float64), 1.0))
    k = np.sqrt((1.0 - s) * (1.0 + s))
    q = np.sqrt(np.maximum((s - c) * (s + c), 0.0))
    rising = (np.arctan2(q, k) + c * s * s * np.arctan2(q, -k * c) - k * q) / np.pi
    return np.asarray(np.where(c >= s, c * s * s, np.where(c <= -s, 0.0, rising)))


def earth_area_m2(
    shape: Any, view: npt.ArrayLike, nadir: npt.ArrayLike, limb_sine: npt.ArrayLike, n_node: int = FINEST
) -> F64:
    """Integral of max(0, n.view) F(n) over the surface [m2], F the Earth's view factor.

    A Lambertian body of reflectance rho sends rho * L times this area towards view [W/sr], L the Earth's radiance.

    Args:
        shape: A shape of a target.
        view: Unit vectors towards the observer, body axes, shape (..., 3).
        nadir: Unit vectors towards the Earth's centre, body axes.
        limb_sine: Earth's radius over distance from its centre, > 0; broadcasts with vectors' leading axes.
        n_node: Of the quadrature; flat faces need none.

    Returns:
        Array of the common shape.

    Raises:
        InputError: A vector is not of length 1 within 1e-6, limb_sine is not > 0, or shapes do not fit.
    """
    from warpsim_kernels.earthlight import earth_area_kernel

    return _areas(earth_area_kernel, shape, n_node, limb_sine, view=view, nadir=nadir)


def absorbed_area_m2(shape: Any, nadir: npt.ArrayLike, limb_sine: npt.ArrayLike, n_node: int = FINEST) -> F64:
    """Integral of F(n) over the whole surface [m2]: a black body absorbs pi * L times this area [W].

    Args and errors are those of `earth_area_m2`.
    """
    from warpsim_kernels.earthlight import absorbed_area_kernel

    return _areas(absorbed_area_kernel, shape, n_node, limb_sine, nadir=nadir)


def albedo_area_m2(
    shape: Any,
    view: npt.ArrayLike,
    nadir: npt.ArrayLike,
    limb_sine: npt.ArrayLike,
    sun: npt.ArrayLike,
    n_node: int = FINEST,
    degree: int = 0,
) -> F64:
    """Integral over the Earth's disc of max(0, cos of the solar zenith angle) times the reflected area [m2 sr].

    A Lambertian body of reflectance rho sends rho / pi * albedo / pi * E_sun times this towards view [W/sr].

    Args:
        shape: A shape of a target.
        view: Unit vectors towards the observer, body axes, shape (..., 3).
        nadir: Unit vectors towards the Earth's centre, body axes.
        limb_sine: Earth's radius over distance from its centre, > 0; broadcasts with vectors' leading axes.
        sun: Unit vectors towards the Sun, body axes.
        n_node: Of the quadrature over rings of the ground, and over azimuth.
        degree: Even: by the series of harmonics up to this degree, not over azimuth; 0: without.

    Returns:
        Array of the common shape.

    Raises:
        InputError: A vector is not of length 1 within 1e-6, limb_sine is not > 0, or shapes do not fit.
    """
    from warpsim_kernels.albedo import albedo_area_kernel
    from warpsim_kernels.albedo_series import make_albedo_series_kernel

    kernel = make_albedo_series_kernel(degree) if degree else albedo_area_kernel
    return _areas(kernel, shape, n_node, limb_sine, view=view, nadir=nadir, sun=sun)


def _areas(kernel: Any, shape: Any, n_node: int, limb_sine: npt.ArrayLike, **vectors: npt.ArrayLike) -> F64:
    """Launch a kernel over geometries; its inputs are view, nadir, limb_sine and sun, as far as given."""
    import warp as wp

    given = {name: directions(name, value) for name, value in vectors.items()}
    sine = np.asarray(limb_sine, np.float64)
    if not (np.isfinite(sine).all() and (sine > 0.0).all()):
        raise InputError("must be finite and > 0", "limb_sine", sine[~(np.isfinite(sine) & (sine > 0))].flat[0], "g")
    try:
        common = np.broadcast_shapes(sine.shape, *(vector.shape[:-1] for vector in given.values()))
    except ValueError:
        raise InputError("shapes must broadcast", f"{', '.join(given)}, limb_sine") from None

    def upload(values: F64, dtype: Any) -> Any:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device="cpu")

    inputs = {name: upload(np.broadcast_to(v, (*common, 3)).reshape(-1, 3), wp.vec3d) for name, v in given.items()}
    sun = [inputs.pop("sun")] if "sun" in inputs else []
    sines = upload(np.broadcast_to(sine, common).reshape(-1), wp.float64)
    table = facets_of([shape], "cpu")
    body = body_struct(shape, table.first[0])
    area = wp.empty_like(sines)
    wp.launch(
        kernel,
        dim=len(sines),
        inputs=[rule_struct(n_node, "cpu"), body, table.facets, *inputs.values(), sines, *sun],
        outputs=[area],
        device="cpu",
    )
    return np.asarray(area.numpy()).reshape(common)
