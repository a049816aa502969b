"""Time and error of the Earth's light on a target, by method.

    python -m pytest benchmarks/test_earth_areas.py --benchmark-json=benchmarks/results/earth_areas.json
    python benchmarks/report.py benchmarks/results/earth_areas.json

One evaluation is one target in one view, one thread. Views, attitudes and Suns are random, 800 km above the ground;
the Sun is above the horizon of the point below. The error is the largest over the views, as a share of the largest
value that the body could have there. Methods are rules of some nodes, and for albedo series up to some degree.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp
from warpsim_kernels.albedo import albedo_area_kernel
from warpsim_kernels.albedo_series import make_albedo_series_kernel
from warpsim_kernels.earthlight import earth_area_kernel

import warpsim as ws
from warpsim.target.areas import body_struct
from warpsim.target.earth_radiation import NODE_ERRORS, SERIES_ERRORS, SERIES_RINGS, rule_struct
from warpsim.target.facets import facets_of

SHAPES = {"sphere": ws.Sphere(0.5), "cylinder": ws.Cylinder(0.25, 1.0), "cone": ws.Cone(0.25, 1.0)}
LIMB_SINE = 6378.0 / 7178.0
METHODS = [
    *(("thermal", 0, n_node) for n_node in NODE_ERRORS),
    *(("albedo", 0, n_node) for n_node in NODE_ERRORS),
    *(("albedo", degree, n_node) for degree, n_node in SERIES_RINGS.items()),
]
"""Light, degree of the series or 0, nodes of the rule."""


@pytest.mark.parametrize(("light", "degree", "n_node"), METHODS)
@pytest.mark.parametrize("name", SHAPES)
def test_earthlight(benchmark, name, light, degree, n_node, device):
    n_view = 5_000 if benchmark.enabled else 200
    geometry = random_geometry(n_view, device)
    area = areas(light, name, degree, n_node, geometry)
    benchmark.pedantic(area, rounds=5, warmup_rounds=1)
    if benchmark.stats is None:
        return
    largest_m2 = SHAPES[name].projected_area_m2(np.linspace(0, np.pi, 721)).max()
    largest = LIMB_SINE**2 * largest_m2 * (np.pi if light == "albedo" else 1.0)
    benchmark.extra_info.update(
        device=device,
        light=light,
        shape=name,
        degree=degree,
        n_node=n_node,
        us_per_evaluation=benchmark.stats.stats.min / n_view * 1e6,
        error=float(np.abs(area() - areas(light, name, 0, 24, geometry)()).max() / largest),
        error_bound=SERIES_ERRORS[degree][0] if degree else NODE_ERRORS[n_node][light],
    )


def random_geometry(n_view: int, device: str) -> dict[str, Any]:
    """Views, nadirs and Suns in body axes, on a device."""
    rng = np.random.default_rng(577)
    vectors = rng.normal(size=(3, n_view, 3))
    view, nadir, sun = vectors / np.linalg.norm(vectors, axis=2, keepdims=True)
    sun *= -np.sign(np.sum(sun * nadir, axis=1))[:, None]
    rows = {"view": view, "nadir": nadir, "sun": sun}
    return {key: wp.array(value, dtype=wp.vec3d, device=device) for key, value in rows.items()}


def areas(light: str, name: str, degree: int, n_node: int, geometry: dict[str, Any]) -> Any:
    """A call that computes the areas of all views."""
    view, nadir, sun = geometry["view"], geometry["nadir"], geometry["sun"]
    device = view.device
    limb_sine = wp.array(np.full(len(view), LIMB_SINE), dtype=wp.float64, device=device)
    facets = facets_of([SHAPES[name]], device).facets
    inputs = [rule_struct(n_node, device), body_struct(SHAPES[name]), facets, view, nadir, limb_sine]
    area = wp.empty_like(limb_sine)
    kernel = earth_area_kernel
    if light == "albedo":
        kernel = make_albedo_series_kernel(degree) if degree else albedo_area_kernel
        inputs.append(sun)

    def run() -> Any:
        wp.launch(kernel, dim=len(view), inputs=inputs, outputs=[area], device=device)
        return area.numpy().copy()

    return run
