"""The Earth's heat on bodies by polynomials: errors promised, methods chosen, and what a scene makes of them."""

import functools
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from on_devices import target_field
from warpsim_kernels.facets import Facets
from warpsim_kernels.heat_series import HeatTables, heat_series_of
from warpsim_kernels.shapes import Body

import warpsim as ws
from warpsim.errors import InputError
from warpsim.target.areas import body_struct
from warpsim.target.earth_radiation import NEAR_LIMB_SINE, earth_area_m2, view_factor
from warpsim.target.facets import facets_of
from warpsim.target.heat_table import HEAT_ERRORS, coefficient_tables, heat_method, heat_tables

SEED = 299792
FINE_RTOL = 2e-8  # of the term's largest value: rules of 64 nodes, see the ladder in test_earthlight
SPHERE_ATOL = 1e-12  # float64: the quadrature over normals is exact for these polynomials
HEIGHT_ATOL = 3e-5  # a table of 257 heights, linear in between; measured 1.4e-5
NEAR = (0.5, 0.55, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98, 0.995, 1.0)
FAR = (0.0166, 0.05, 0.15, 0.3)

SHAPES = {
    "sphere": ws.Sphere(0.7),
    "cylinder": ws.Cylinder(0.25, 1.0),
    "cone": ws.Cone(0.25, 1.0),
    "flat-cone": ws.Cone(1.0, 0.4),
    "needle": ws.Cone(1e-2, 1e2),
    "disc": ws.Cone(10.0, 1e-3),
    "frustum": ws.Frustum(0.5, 0.2, 1.1),
    "plate": ws.Plate(2.0, 0.3),
}
every_degree = pytest.mark.parametrize("degree", HEAT_ERRORS)


def directions(rng, n):
    """Random unit vectors, one in six along an axis."""
    vector = rng.normal(size=(n, 3))
    rows = rng.random(n) < 1 / 6
    vector[rows] = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0]])[rng.integers(0, 3, rows.sum())]
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)


def geometries(limb_sines, n=3000):
    """Views, nadirs and heights; views along and against the nadir are among them."""
    rng = np.random.default_rng(SEED)
    view, nadir = directions(rng, n), directions(rng, n)
    view[:100], view[100:200] = nadir[:100], -nadir[100:200]
    return view, nadir, rng.choice(limb_sines, n)


@functools.cache
def make_heat_series_kernel(degree):
    series = heat_series_of(degree)

    @wp.kernel(module="unique", enable_backward=False)
    def heat_series_kernel(
        tables: HeatTables, body: Body, facets: Facets,
        view: wp.array[wp.vec3d], nadir: wp.array[wp.vec3d], limb_sine: wp.array[wp.float64],
        area_m2: wp.array[wp.float64],
    ):  # fmt: skip
        i = wp.tid()
        area_m2[i] = series.area_m2(tables, body, facets, view[i], nadir[i], limb_sine[i])

    return heat_series_kernel


def by_polynomials(degree, shape, view, nadir, limb_sine, device="cpu"):
    table = facets_of([shape], device)
    inputs = [
        heat_tables(degree, device), body_struct(shape, table.first[0]), table.facets,
        *(wp.array(vector, dtype=wp.vec3d, device=device) for vector in (view, nadir)),
        wp.array(limb_sine, dtype=wp.float64, device=device),
    ]  # fmt: skip
    area = wp.empty(len(view), dtype=wp.float64, device=device)
    wp.launch(make_heat_series_kernel(degree), len(view), inputs=inputs, outputs=[area], device=device)
    return area.numpy()


def largest_m2(shape):
    return shape.projected_area_m2(np.linspace(0, np.pi, 721)).max()


def worst_error(degree, limb_sines):
    """Over all shapes, as a share of limb_sine^2 times the largest projected area."""
    view, nadir, limb_sine = geometries(limb_sines)
    missed = []
    for shape in SHAPES.values():
        exact = earth_area_m2(shape, view, nadir, limb_sine, n_node=64)
        area = by_polynomials(degree, shape, view, nadir, limb_sine)
        assert (area >= 0).all()
        missed.append((np.abs(area - exact) / limb_sine**2).max() / largest_m2(shape))
    return max(missed)


@every_degree
@pytest.mark.ci
def test_errors_of_the_ladder(degree):
    """No body exceeds the table, near the Earth and anywhere, and some body comes near it."""
    near, anywhere = HEAT_ERRORS[degree]
    assert near / 3 < worst_error(degree, NEAR) + FINE_RTOL <= near
    assert anywhere / 3 < worst_error(degree, FAR) + FINE_RTOL <= anywhere


@pytest.mark.ci
def test_between_the_tables_heights(device):
    """Heights that the table does not hold cost next to nothing: an element against a polynomial of its own."""
    degree, rng = 10, np.random.default_rng(SEED)
    limb_sine = rng.uniform(NEAR_LIMB_SINE, 1.0, 400)
    cosine = rng.uniform(-1, 1, 400)
    nadir = np.stack([np.sqrt(1 - cosine**2), 0 * cosine, cosine], axis=1)
    view = np.broadcast_to([0.0, 0.0, 1.0], nadir.shape).copy()
    area = by_polynomials(degree, ws.Plate(1.0, 1.0), view, nadir, limb_sine, device)
    sample = np.cos((np.arange(2000) + 0.5) * np.pi / 2000)
    for seen, s, c in zip(area, limb_sine, cosine, strict=True):
        root = np.sqrt((1 + sample) / 2)
        even = view_factor(root, s) - root * s * s / 2
        fit = np.polynomial.chebyshev.chebfit(sample, even, degree // 2)
        expected = max(np.polynomial.chebyshev.chebval(2 * c * c - 1, fit) + c * s * s / 2, 0)
        assert seen == pytest.approx(expected, rel=0, abs=HEIGHT_ATOL * s * s)


@every_degree
def test_spheres_are_made_of_elements(degree):
    """A sphere's polynomial is the integral of the element's over all normals that are seen."""
    node, weight = np.polynomial.legendre.leggauss(40)
    turn = (np.arange(80) + 0.5) * 2 * np.pi / 80
    normal_z = (1 + node[:, None]) / 2
    normal_x = np.sqrt(1 - normal_z**2) * np.cos(turn)
    element, sphere = (tables[190] for tables in coefficient_tables(degree))
    for angle in (0.0, 0.7, np.pi / 2, 2.5):
        c = np.cos(angle)
        to_nadir = normal_z * c + normal_x * np.sin(angle)  # the view is z
        even = np.polynomial.polynomial.polyval(to_nadir**2, element)
        total = weight / 2 @ (normal_z * even).mean(axis=1) * 2 * np.pi
        assert np.polynomial.polynomial.polyval(c * c, sphere) == pytest.approx(total, rel=0, abs=SPHERE_ATOL)


def test_meshes_are_sums_of_elements():
    rng = np.random.default_rng(SEED)
    normal = directions(rng, 12)
    area_m2 = rng.uniform(0.1, 2.0, 12)
    surface = SimpleNamespace(normal=normal, area_m2=area_m2)
    mesh = SimpleNamespace(kind="mesh", surface=surface)
    view, nadir, s = geometries((0.9,), 50)
    got = by_polynomials(10, mesh, view, nadir, s)
    seen = np.maximum(view @ normal.T, 0) * area_m2
    expected = np.sum(seen * view_factor(nadir @ normal.T, s[:, None]), axis=1)
    np.testing.assert_allclose(got, expected, rtol=0, atol=HEAT_ERRORS[10][0] * 0.81 * seen.sum(axis=1).max())


def test_methods_for_an_error():
    assert heat_method(1e-1, 0.01) == (6, 1)
    assert heat_method(3e-3, 0.9) == (6, 1)
    assert heat_method(1e-3, 0.9) == (10, 1)
    assert heat_method(1e-3, 0.5) == (10, 1)
    assert heat_method(5e-4, 0.9) == (14, 1)
    assert heat_method(1e-4, 0.9) == (0, 5)
    assert heat_method(1e-3, 0.3) == (0, 5)
    assert heat_method(3e-2, 0.1) == (10, 1)
    with pytest.raises(InputError, match="error: must be at least 4e-08 for thermal light of the Earth, got 1e-09"):
        heat_method(1e-9, 0.9)


@pytest.mark.ci
def test_a_scene_takes_what_it_asks_for(scene):
    """Light of frames within the error asked for, by either method."""
    shares = {}
    times = np.linspace(0, scene.duration_s, 40)
    where = {"sensors": ["sat11", "sat47"], "bands": ["E"], "device": "cpu"}
    exact = ws.light_curves(scene.replace(lighting__quadrature_error=1e-5), times, **where).terms_w_cm2["earth"]
    for error, degree in ((3e-3, 6), (1e-3, 10), (1e-4, 0)):
        asked = scene.replace(lighting__quadrature_error=error)
        assert target_field(asked, ["E"]).features.earth_degree == degree
        heat = ws.light_curves(asked, times, **where).terms_w_cm2["earth"]
        shares[error] = np.abs(heat - exact).max(axis=(0, 1, 2)) / exact.max(axis=(0, 1, 2))
        assert (shares[error] <= error / 0.5).all()  # a body's largest value in the scene may be half of any side's
    assert shares[1e-3].max() > 1e-5  # it is not the quadrature
