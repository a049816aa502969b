"""Shapes: the area that is lit from one side and seen from another, against mpmath, quadrature and meshes."""

from itertools import pairwise

import mpmath
import numpy as np
import pytest
import warp as wp
from bodies import ends_m, unit_vectors
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath.calculus.quadrature import GaussLegendre
from on_devices import launched
from warpsim_kernels.shapes import projected_area_along_kernel, reflected_area_kernel

import warpsim as ws
from warpsim.target.areas import body_struct, facets_of

SEED = 299792

AREA_TOL = 1e-12  # of the surface: float64 rounding
SPHERE_TOL = 1e-13  # the same, for the closed form against Gauss quadrature that is exact to rounding
MESH_TOL = 1e-4  # of the surface: 2000 flat facets around
SUN_MEAN_TOL = 1e-8  # of the surface: 192 x 256 directions, of a function with kinks

BODIES = {
    "sphere": ws.Sphere(0.7),
    "cylinder": ws.Cylinder(0.4, 1.9),
    "cone": ws.Cone(0.5, 1.7),
    "flat-cone": ws.Cone(1.5, 0.4),
    "needle-cone": ws.Cone(1e-2, 1e2),
    "disc-cone": ws.Cone(10.0, 1e-3),
    "needle-cylinder": ws.Cylinder(1e-2, 1e2),
    "disc-cylinder": ws.Cylinder(10.0, 1e-3),
    "frustum": ws.Frustum(0.5, 0.2, 1.1),
    "wide-top": ws.Frustum(0.2, 0.6, 0.3),
    "disc-frustum": ws.Frustum(9.0, 10.0, 1e-3),
    "plate": ws.Plate(2.0, 0.3),
}
TURNED = {name: shape for name, shape in BODIES.items() if shape.kind in ("cylinder", "cone", "frustum")}
every_body = pytest.mark.parametrize("shape", BODIES.values(), ids=BODIES)


def side_angle_rad(shape):
    """Angle between side and axis: where a projected area has its kinks."""
    if shape not in TURNED.values():
        return 0.3
    base, top, height = ends_m(shape)
    return abs(np.arctan2(base - top, height))


def unit(polar, azimuth):
    polar, azimuth = np.broadcast_arrays(polar, azimuth)
    return np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)


def random_directions(n, seed=SEED):
    return unit_vectors(seed, n)


def hard_pairs(shape, n=120):
    """Views and suns: on the axis, in the base plane, at exactly the half-angle and next to it, together, opposite."""
    half = side_angle_rad(shape)
    near = [half, half + 1e-9, half - 1e-9, np.nextafter(half, 4), np.pi - half, np.pi - half + 1e-9, np.pi / 2 - half]
    polar = np.array([0.0, np.pi, 1e-9, np.pi / 2, np.pi / 2 - 1e-12, np.pi / 2 + 1e-9, 0.7, 1.4, *near])
    apart = np.array([0.0, 1e-8, 1.0, np.pi / 2, 2.9, np.pi - 1e-8, np.pi, 4.0])
    rng = np.random.default_rng(SEED)
    first, second, turn = np.meshgrid(polar, polar, apart)
    pick = rng.permutation(first.size)[:n]
    azimuth = rng.uniform(0, 2 * np.pi, n)
    view, sun = unit(first.flat[pick], azimuth), unit(second.flat[pick], azimuth + turn.flat[pick])
    some, others = random_directions(40), random_directions(40, SEED + 1)
    return np.concatenate([view, some, some, some]), np.concatenate([sun, some, -some, others])


def lit_and_seen(shape, view, sun):
    """Integral of max(0, n.v) max(0, n.s) over flat ends and side: Gauss-Legendre in 30 digits between all kinks."""
    with mpmath.workdps(30):
        nodes = GaussLegendre(mpmath.mp).calc_nodes(3, mpmath.mp.prec)  # 12: good to 1e-18 over half a turn
        v, s = (mpmath.matrix([mpmath.mpf(x) for x in vector]) for vector in (view, sun))
        v, s = v / mpmath.norm(v), s / mpmath.norm(s)
        if shape.kind == "plate":
            both = max(v[2], 0) * max(s[2], 0) + max(-v[2], 0) * max(-s[2], 0)
            return both * mpmath.mpf(shape.width_m) * mpmath.mpf(shape.length_m)
        base, top, height = (mpmath.mpf(x) for x in ends_m(shape))
        slant = mpmath.hypot(base - top, height)
        across, along = height / slant, (base - top) / slant
        total = mpmath.pi * top**2 * max(v[2], 0) * max(s[2], 0) + mpmath.pi * base**2 * max(-v[2], 0) * max(-s[2], 0)
        kinks = {mpmath.mpf(0), mpmath.pi, 2 * mpmath.pi}
        for d in (v, s):
            flat = across * mpmath.hypot(d[0], d[1])
            if flat > abs(along * d[2]):
                middle, arc = mpmath.atan2(d[1], d[0]), mpmath.acos(-along * d[2] / flat)
                kinks |= {(middle + arc) % (2 * mpmath.pi), (middle - arc) % (2 * mpmath.pi)}
        edges = sorted(kinks)
        for low, high in pairwise(edges):
            for x, weight in nodes:
                phi = low + (high - low) * (x + 1) / 2
                normal = (across * mpmath.cos(phi), across * mpmath.sin(phi), along)
                faces = [max(sum(n * d[k] for k, n in enumerate(normal)), 0) for d in (v, s)]
                total += weight * (high - low) / 2 * faces[0] * faces[1] * (base + top) / 2 * slant
        return total


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BODIES if name != "sphere"])
def test_reflected_area_matches_mpmath(name, record_accuracy):
    shape = BODIES[name]
    view, sun = hard_pairs(shape)
    expected = np.array([float(lit_and_seen(shape, v, s)) for v, s in zip(view, sun, strict=True)])
    error = np.abs(shape.reflected_area_m2(view, sun) - expected).max() / shape.surface_m2
    assert error < AREA_TOL
    record_accuracy("Reflected area", error, AREA_TOL, "of the surface", "mpmath")


def test_flat_cones_are_lit_and_seen_in_two_arcs():
    """The sides' arcs of azimuth overlap on both sides: without the second one the light would be too faint."""
    shape = ws.Cone(1.5, 0.4)
    view, sun = unit(1.1, 0.3), unit(1.1, 0.3 + np.pi)
    expected = float(lit_and_seen(shape, view, sun))
    assert shape.reflected_area_m2(view, sun) == pytest.approx(expected, rel=AREA_TOL, abs=0)
    # From here the whole side but a wedge of the far side is seen, and from there the wedge opposite.
    seen = np.arccos(-1.5 / 0.4 / np.tan(1.4))
    assert np.pi / 2 + 0.5 < seen < np.pi
    view, sun = unit(1.4, 0.3), unit(1.4, 0.3 + np.pi)
    expected = float(lit_and_seen(shape, view, sun))
    assert shape.reflected_area_m2(view, sun) == pytest.approx(expected, rel=AREA_TOL, abs=0)


def test_lambert_sphere_matches_quadrature():
    """About the pole that is perpendicular to both directions the lit and seen lune is smooth."""
    sphere, x_w = ws.Sphere(0.7), np.polynomial.legendre.leggauss(40)
    for phase in [0.0, 1e-9, 0.3, np.pi / 2, 2.9, np.pi - 1e-4, np.pi]:
        view, sun = unit(np.pi / 2, 0.0), unit(np.pi / 2, phase)
        low, high = phase - np.pi / 2, np.pi / 2
        longitude, weight = low + (high - low) * (x_w[0] + 1) / 2, (high - low) / 2 * x_w[1]
        latitude = x_w[0] * np.pi / 2
        normal = unit(np.pi / 2 - latitude[:, None], longitude[None, :])
        area = np.cos(latitude)[:, None] * weight * (x_w[1] * np.pi / 2)[:, None] * sphere.radius_m**2
        expected = np.sum(area * (normal @ view) * (normal @ sun))
        assert abs(sphere.reflected_area_m2(view, sun) - expected) < SPHERE_TOL * sphere.surface_m2
    turn = np.linalg.qr(np.random.default_rng(SEED).normal(size=(3, 3)))[0]
    tilted = sphere.reflected_area_m2(turn @ unit(0.4, 1.0), turn @ unit(1.9, 3.0))
    assert tilted == pytest.approx(sphere.reflected_area_m2(unit(0.4, 1.0), unit(1.9, 3.0)), rel=1e-14, abs=0)


@every_body
def test_full_phase_and_behind(shape):
    """Lit from behind a convex body shows nothing where it sees a flat face; lit along the view it is brightest."""
    view = random_directions(500)
    behind = shape.reflected_area_m2(view, -view)
    assert np.abs(behind).max() < AREA_TOL * shape.surface_m2
    full = shape.reflected_area_m2(view, view)
    # Cauchy and Schwarz: (integral of n.v)^2 <= integral of (n.v)^2 times the area seen
    seen = shape.projected_area_along_m2(view)
    assert (full <= seen * (1 + 1e-12)).all()
    assert (full >= seen**2 / shape.surface_m2).all()


@every_body
def test_sun_from_all_sides_gives_pi_times_the_projected_area(shape):
    """The integral of max(0, n.s) over all directions s is pi for each n."""
    x, weight = np.polynomial.legendre.leggauss(48)
    half = side_angle_rad(shape)
    ends = np.unique([0.0, half, np.pi / 2, np.pi - half, np.pi])
    angle = np.concatenate([low + (high - low) * (x + 1) / 2 for low, high in pairwise(ends)])
    ring = np.concatenate([(high - low) / 2 * weight for low, high in pairwise(ends)]) * np.sin(angle)
    azimuth = np.arange(256) * 2 * np.pi / 256
    sun = unit(angle[:, None], azimuth[None, :])
    solid_angle = ring * 2 * np.pi / 256
    for view in random_directions(5):
        total = np.sum(solid_angle[:, None] * shape.reflected_area_m2(view, sun))
        expected = np.pi * shape.projected_area_along_m2(view)
        assert abs(total - expected) < SUN_MEAN_TOL * shape.surface_m2


@every_body
def test_areas_along_directions_are_those_at_aspects(shape):
    view = np.concatenate([random_directions(200), [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0]]])
    aspect = np.arctan2(np.hypot(view[:, 0], view[:, 1]), view[:, 2])
    error = shape.projected_area_along_m2(view) - shape.projected_area_m2(aspect)
    assert np.abs(error).max() < AREA_TOL * shape.surface_m2


LENGTHS = st.floats(1e-4, 1e2)
SHAPES = st.one_of(
    st.builds(ws.Sphere, LENGTHS),
    st.builds(ws.Cylinder, LENGTHS, LENGTHS),
    st.builds(ws.Cone, LENGTHS, LENGTHS),
    st.builds(ws.Frustum, LENGTHS, st.one_of(st.just(0.0), LENGTHS), LENGTHS),
    st.builds(ws.Plate, LENGTHS, LENGTHS),
)
ANGLES = st.one_of(st.floats(0, 2 * np.pi), st.sampled_from([0.0, np.pi / 2, np.pi, 1e-9, np.pi - 1e-9]))


@settings(max_examples=300, deadline=None)
@given(shape=SHAPES, angles=st.tuples(ANGLES, ANGLES, ANGLES, ANGLES))
def test_reflected_area_is_symmetric_and_bounded(shape, angles):
    view, sun = unit(angles[0], angles[1]), unit(angles[2], angles[3])
    area, swapped = shape.reflected_area_m2(view, sun), shape.reflected_area_m2(sun, view)
    tolerance = AREA_TOL * shape.surface_m2
    assert abs(area - swapped) <= tolerance
    assert 0 <= area <= min(shape.projected_area_along_m2(view), shape.projected_area_along_m2(sun)) + tolerance


def test_frustum_between_cone_and_cylinder():
    view, sun = random_directions(300), random_directions(300, SEED + 1)
    pairs = [(ws.Frustum(0.5, 0.0, 1.7), ws.Cone(0.5, 1.7)), (ws.Frustum(0.4, 0.4, 1.9), ws.Cylinder(0.4, 1.9))]
    for frustum, same in pairs:
        assert frustum.surface_m2 == pytest.approx(same.surface_m2, rel=1e-15, abs=0)
        np.testing.assert_array_equal(frustum.projected_area_along_m2(view), same.projected_area_along_m2(view))
        np.testing.assert_array_equal(frustum.reflected_area_m2(view, sun), same.reflected_area_m2(view, sun))
    turned = ws.Frustum(0.2, 0.6, 0.3).reflected_area_m2(-view, -sun)
    np.testing.assert_allclose(turned, ws.Frustum(0.6, 0.2, 0.3).reflected_area_m2(view, sun), rtol=0, atol=1e-14)


def turned_mesh(shape, n):
    """A cylinder, cone or frustum of n flat facets around, whose corners are on the rims."""
    base, top, height = ends_m(shape)
    phi = np.arange(n) * 2 * np.pi / n
    ring = np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    here, there = np.arange(n), (np.arange(n) + 1) % n
    if top == 0:
        vertices = np.vstack([base * ring, [[0, 0, 0], [0, 0, height]]])
        faces = [np.column_stack([there, here, 0 * here + n]), np.column_stack([here, there, 0 * here + n + 1])]
    else:
        vertices = np.vstack([base * ring, top * ring + [0, 0, height], [[0, 0, 0], [0, 0, height]]])
        faces = [
            np.column_stack([there, here, 0 * here + 2 * n]),
            np.column_stack([n + here, n + there, 0 * here + 2 * n + 1]),
            np.column_stack([here, there, n + there]),
            np.column_stack([here, n + there, n + here]),
        ]
    return ws.Mesh(vertices_m=vertices, faces=np.vstack(faces))


@pytest.mark.parametrize("name", TURNED)
def test_meshes_converge_to_closed_forms(name, record_accuracy):
    shape = TURNED[name]
    view, sun = random_directions(60), random_directions(60, SEED + 1)

    def error(n):
        mesh = turned_mesh(shape, n)
        assert mesh.convex
        projected = np.abs(mesh.projected_area_along_m2(view) - shape.projected_area_along_m2(view)).max()
        lit = np.abs(mesh.reflected_area_m2(view, sun) - shape.reflected_area_m2(view, sun)).max()
        return np.array([projected, lit]) / shape.surface_m2

    coarse, fine, finest = error(60), error(240), error(2000)
    assert (fine < coarse / 6).all()  # second order: 16 times smaller, but for where the kinks fall
    assert (finest < MESH_TOL).all()
    record_accuracy("Areas of a mesh", finest.max(), MESH_TOL, "of the surface", "closed forms of the body")


def test_icospheres_converge_to_the_sphere():
    creation = pytest.importorskip("trimesh.creation")
    sphere = ws.Sphere(1.0)
    view, sun = random_directions(40), random_directions(40, SEED + 1)
    errors = []
    for level in (3, 5):
        ball = creation.icosphere(subdivisions=level)
        mesh = ws.Mesh(vertices_m=ball.vertices, faces=ball.faces)
        assert mesh.convex
        errors.append(np.abs(mesh.reflected_area_m2(view, sun) - sphere.reflected_area_m2(view, sun)).max())
    assert errors[1] < errors[0] / 10
    assert errors[1] < 1e-3 * sphere.surface_m2  # the body inscribed in a sphere by 20480 facets is that much smaller


@pytest.mark.parametrize(
    ("view", "message"),
    [
        ([0.0, 0.0, 2.0], "view: must be unit vectors, got one of length 2"),
        ([[0, 0, 1], [0, 0, 1 + 3e-6]], "view: must be unit vectors, got one of length 1.000003"),
        ([0.0, np.nan, 1.0], "view: must be unit vectors, got one of length nan"),
        ([0.0, 1.0], r"view: must be unit vectors, shape \(3,\) or \(n, 3\), got shape \(2,\)"),
        (1.0, r"view: must be unit vectors, shape \(3,\) or \(n, 3\), got shape \(\)"),
        ([[0, 0, 1], [1]], "view: must be unit vectors, shape"),
        ("up", "view: must be unit vectors, shape"),
    ],
)
def test_bad_directions(view, message):
    cone = ws.Cone(0.5, 1.0)
    with pytest.raises(ws.InputError, match=message):
        cone.projected_area_along_m2(view)
    with pytest.raises(ws.InputError, match=message):
        cone.reflected_area_m2(view, [0, 0, 1])
    with pytest.raises(ws.InputError, match=message.replace("view", "sun", 1)):
        cone.reflected_area_m2([0, 0, 1], view)


def test_directions_broadcast_and_are_scaled():
    cone, view, sun = ws.Cone(0.5, 1.0), random_directions(4), random_directions(5, SEED + 1)
    table = cone.reflected_area_m2(view[:, None], sun)
    assert table.shape == (4, 5)
    assert table[2, 3] == cone.reflected_area_m2(view[2], sun[3])
    assert cone.reflected_area_m2(view[0], sun[0]).shape == ()
    assert cone.projected_area_along_m2(np.empty((0, 3))).shape == (0,)
    stretched = cone.reflected_area_m2(view * (1 + 9e-7), sun[0])
    np.testing.assert_allclose(stretched, table[:, 0], rtol=1e-14, atol=0)
    with pytest.raises(ws.InputError, match=r"view, sun: shapes must broadcast, got \(4, 3\) and \(5, 3\)"):
        cone.reflected_area_m2(view, sun)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ws.Frustum(-1.0, 0.5, 1.0), "radius_m: must be > 0"),
        (lambda: ws.Frustum(1.0, -0.5, 1.0), "top_radius_m: must be >= 0, got -0.5"),
        (lambda: ws.Frustum(1.0, 0.5, 0.0), "height_m: must be > 0"),
        (lambda: ws.Frustum(1.0, np.nan, 1.0), "top_radius_m: must be finite"),
        (lambda: ws.Frustum(1.0, 2e5, 1.0), "top_radius_m: must be in"),
        (lambda: ws.Plate(0.0, 1.0), "width_m: must be > 0"),
        (lambda: ws.Plate(1.0, np.inf), "length_m: must be finite"),
        (lambda: ws.Plate(1.0), "length_m: is required"),
    ],
)
def test_bad_sizes(make, message):
    with pytest.raises(ws.InputError, match=message):
        make()


def test_facets_of_a_scene_stand_once_and_give_the_same_areas(device):
    """Shapes of all kinds, as the renderer has them: one list of facets, each body with its place in it."""
    box = turned_mesh(ws.Cylinder(0.4, 1.9), 12)
    other = turned_mesh(ws.Cone(0.5, 1.7), 7)
    shapes = [ws.Sphere(0.5), box, other, ws.Plate(1.0, 2.0), turned_mesh(ws.Cylinder(0.4, 1.9), 12)]
    table = facets_of(shapes, device)
    assert table.count == [0, 14, 8, 0, 14]
    assert table.first[1] == table.first[4] != table.first[2]
    assert len(table.facets.area_m2) <= 14 + 8 + 1
    view, sun = random_directions(50), random_directions(50, SEED + 1)
    for shape, first in zip(shapes, table.first, strict=True):
        inputs = [body_struct(shape, first), table.facets, view, sun]
        (area_m2,) = launched(projected_area_along_kernel, 50, inputs[:3], [wp.float64], device)
        np.testing.assert_allclose(area_m2, shape.projected_area_along_m2(view), rtol=1e-13, atol=0)
        (lit,) = launched(reflected_area_kernel, 50, inputs, [wp.float64], device)
        np.testing.assert_allclose(lit, shape.reflected_area_m2(view, sun), rtol=1e-13, atol=1e-15)
    with pytest.raises(ws.InputError, match="a mesh can be used only with the facets of its scene"):
        body_struct(box)


def test_a_body_with_facets_needs_no_code_of_its_own():
    """Its struct, its facets and its drawing are those of the mesh of the same surface."""
    from types import SimpleNamespace

    from warpsim.plot.group_figure import drawn_facets

    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    mesh = ws.Mesh(vertices_m=vertices.tolist(), faces=faces)
    own = SimpleNamespace(kind="octahedron", surface=mesh.surface)
    assert facets_of([own, mesh]).count == facets_of([mesh, mesh]).count
    assert body_struct(own, 1).n_facet == body_struct(mesh, 1).n_facet == 8
    np.testing.assert_array_equal(drawn_facets(own), drawn_facets(mesh))
    with pytest.raises(ws.InputError, match="shape: has no areas in the kernels"):
        body_struct(SimpleNamespace(kind="cube", radius_m=1.0, height_m=2.0))
