"""Light of the Earth on targets: view factor, Earth infrared and Earth albedo, against sums over facets and ground."""

import functools
from types import SimpleNamespace

import erfa
import mpmath
import numpy as np
import pytest
import warp as wp
from bodies import facets
from on_devices import launched
from scipy.integrate import dblquad, quad
from scipy.special import eval_legendre, sph_harm_y
from warpsim_kernels import earth as earth_kernels
from warpsim_kernels.earth_albedo import albedo_series_of, damping, is_dark
from warpsim_kernels.earth_infrared import earth_area_m2
from warpsim_kernels.shapes import Body, Facets

import warpsim as ws
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.orbit.earth import geocentric_radius_m
from warpsim.render.target_field import earth_struct
from warpsim.target import earth_light
from warpsim.target.areas import body_struct, facets_of
from warpsim.target.earth_light import (
    ALBEDO_ERRORS,
    INFRARED_ERRORS,
    NEAR_LIMB_SINE,
    albedo_degree,
    albedo_table,
    infrared_table,
    table_limb_sines,
    view_factor,
)

SEED = 141421

FACTOR_ATOL = 1e-13  # float64 rounding; the pass line is 1e-8
QUADRATURE_ATOL = 1e-8  # of the two-dimensional quadrature
EXACT_RTOL = 1e-12
RADIUS_ATOL_M = 1e-6
DAMPING_ATOL = 1e-13
SPHERE_ATOL = 5e-5  # of limb_sine^2: a table of 257 heights and cosines, linear in between
PATCH_ATOL = 3e-5  # of the largest value: patches at the terminator
MESH_RTOL = 1e-5  # sides of 3000 strips, second order in their widths
SPHERE_RTOL = 2e-5  # 800 x 400 facets
STRIPS_ATOL = 2e-4  # 400 strips and 100 x 200 patches, of the largest value

EARTH_M = 6.371e6
UP = np.array([0.0, 0.0, 1.0])
NEAR = [0.5, 0.55, 0.6, 0.7, 0.8, 0.8137, 0.9, 0.95, 0.98, 0.995, 0.9999, 1.0]
FAR = [0.0166, 0.05, 0.15, 0.24, 0.35]

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
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
every_degree = pytest.mark.parametrize("degree", ALBEDO_ERRORS)


def mesh(normal, area_m2):
    """What a mesh says of itself."""
    surface = SimpleNamespace(normal=np.asarray(normal, float), area_m2=np.asarray(area_m2, float))
    return SimpleNamespace(kind="mesh", surface=surface)


BOX = mesh(np.vstack([np.eye(3), -np.eye(3)]), [0.4, 1.0, 0.6, 0.4, 1.0, 0.6])


def largest_m2(shape):
    """Largest projected area."""
    return np.sqrt(1.52) if shape is BOX else shape.projected_area_m2(np.linspace(0, np.pi, 721)).max()


def areas(kernel, table, dtype, shape, vectors, limb_sine, device):
    """Areas by a kernel over geometries."""
    rows = np.broadcast_shapes(*(np.shape(vector)[:-1] for vector in vectors), np.shape(limb_sine), (1,))
    arrays = [np.broadcast_to(limb_sine, rows), *(np.broadcast_to(vector, (*rows, 3)) for vector in vectors)]
    own = facets_of([shape], device)
    inputs = [wp.array(table, dtype=dtype, device=device), body_struct(shape, own.first[0]), own.facets, *arrays]
    return launched(kernel, rows, inputs, [wp.float64], device)[0]


@wp.kernel(enable_backward=False)
def infrared_kernel(
    table: wp.array3d[wp.vec4d], body: Body, facets: Facets, limb_sine: wp.array[wp.float64],
    view: wp.array[wp.vec3d], nadir: wp.array[wp.vec3d], area_m2: wp.array[wp.float64],
):  # fmt: skip
    i = wp.tid()
    area_m2[i] = earth_area_m2(table, body, facets, view[i], nadir[i], limb_sine[i])


def infrared_area_m2(shape, view, nadir, limb_sine, device="cpu"):
    return areas(infrared_kernel, infrared_table(), wp.vec4d, shape, (view, nadir), limb_sine, device)


@functools.cache
def make_albedo_kernel(degree):
    """As the stage does it: nothing where the ground is dark, else harmonics from the table."""
    series = albedo_series_of(degree)

    @wp.kernel(module="unique", enable_backward=False)
    def albedo_kernel(
        table: wp.array3d[wp.float64], body: Body, facets: Facets, limb_sine: wp.array[wp.float64],
        view: wp.array[wp.vec3d], nadir: wp.array[wp.vec3d], sun: wp.array[wp.vec3d], area_m2_sr: wp.array[wp.float64],
    ):  # fmt: skip
        i = wp.tid()
        up, across = -wp.dot(nadir[i], sun[i]), wp.length(wp.cross(nadir[i], sun[i]))
        area_m2_sr[i] = wp.float64(0.0)
        if not is_dark(limb_sine[i], up, across):
            light = series.harmonics(table, limb_sine[i], up, across)
            area_m2_sr[i] = series.area_m2_sr(light, body, facets, view[i], nadir[i], sun[i])

    return albedo_kernel


def albedo_area_m2_sr(shape, view, nadir, limb_sine, sun, degree, device="cpu", table=None):
    table = albedo_table(degree) if table is None else table
    return areas(make_albedo_kernel(degree), table, wp.float64, shape, (view, nadir, sun), limb_sine, device)


def directions(rng, n):
    """Random unit vectors, one in ten along an axis."""
    vector = rng.normal(size=(n, 3))
    rows = rng.random(n) < 0.1
    vector[rows] = np.array([UP, -UP, [1.0, 0.0, 0.0]])[rng.integers(0, 3, rows.sum())]
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)


def sun_at(rng, nadir, zenith_rad):
    """A unit vector at an angle from the zenith, in a random azimuth."""
    across = np.cross(nadir, rng.normal(size=3))
    return -nadir * np.cos(zenith_rad) + across / np.linalg.norm(across) * np.sin(zenith_rad)


def hard_geometries(rng, limb_sines, n):
    """Views, nadirs, heights and Suns, with axes, oppositions, terminators on the disc and zeniths mixed in."""
    view, nadir, sun = directions(rng, n), directions(rng, n), directions(rng, n)
    limb_sine = rng.choice(limb_sines, n)
    for i in np.flatnonzero(rng.random(n) < 0.4):
        sun[i] = sun_at(rng, nadir[i], np.pi / 2 + rng.uniform(-1.1, 1.1) * np.arccos(limb_sine[i]))
    for target, source in ((view, nadir), (view, -nadir), (sun, -nadir), (view, sun)):
        rows = rng.random(n) < 0.07
        target[rows] = source[rows]
    down = np.linspace(0.0, 1.0, 50)  # faces that look straight down or up, the Sun in the zenith
    sines = np.interp(down, [0.0, 1.0], [min(limb_sines), max(limb_sines)])
    up = np.repeat([UP, -UP], 50, axis=0)
    return (
        np.vstack([view, np.tile(UP, (100, 1))]),
        np.vstack([nadir, up]),
        np.append(limb_sine, [*sines, *sines]),
        np.vstack([sun, -up]),
    )


def ring_factor(cosine, limb_sine):
    """View factor as an integral over rings about the nadir, in 30 digits."""
    with mpmath.workdps(30):
        c, s = mpmath.mpf(cosine), mpmath.mpf(limb_sine)
        across = mpmath.sqrt(1 - c * c)

        def ring(angle):
            a, b = c * mpmath.cos(angle), across * mpmath.sin(angle)
            half = mpmath.pi if a >= b else mpmath.mpf(0) if a <= -b else mpmath.acos(-a / b)
            return 2 * (a * half + b * mpmath.sin(half)) * mpmath.sin(angle)

        kink, end = abs(mpmath.pi / 2 - mpmath.acos(c)), mpmath.asin(s)
        edges = [0, kink, end] if 0 < kink < end else [0, end]
        return mpmath.quad(ring, edges) / mpmath.pi


def hard_elements(limb_sine):
    """Cosines: towards the Earth, away, upright, and with the limb on the horizon, exactly and nearly."""
    near = [limb_sine, -limb_sine, np.nextafter(limb_sine, 0), limb_sine - 1e-9, 1e-9 - limb_sine, 1e-6 - limb_sine]
    return [1.0, -1.0, 0.0, 1e-12, *[x for x in near if abs(x) <= 1]]


@pytest.mark.parametrize("limb_sine", [1.0, 1 - 1e-12, 0.995, 0.9, 0.5, 0.0166])
@pytest.mark.ci
def test_view_factor_in_thirty_digits(limb_sine, record_accuracy):
    cosine = np.array([*hard_elements(limb_sine), *np.random.default_rng(SEED).uniform(-1, 1, 25)])
    expected = [float(ring_factor(c, limb_sine)) for c in cosine]
    np.testing.assert_allclose(view_factor(cosine, limb_sine), expected, rtol=0, atol=FACTOR_ATOL)
    error = np.abs(view_factor(cosine, limb_sine) - expected).max()
    record_accuracy("View factor of the Earth", error, FACTOR_ATOL, "", "mpmath")


@pytest.mark.parametrize("altitude_m", [1.2e5, 1.6e6, 3.6e7])
@pytest.mark.parametrize("tilt_deg", [0, 50, 90, 115, 150])
def test_view_factor_over_the_ground(altitude_m, tilt_deg, record_accuracy):
    """Patches of the ground as they radiate, cos cos / (pi d^2), over the angle from the point below and azimuth."""
    r, tilt = EARTH_M + altitude_m, np.radians(tilt_deg)
    reach = np.arccos(EARTH_M / r)

    def patch(azimuth, beta):
        across = EARTH_M * np.sin(beta)
        to_ground = np.array([across * np.cos(azimuth), across * np.sin(azimuth), EARTH_M * np.cos(beta) - r])
        distance = np.linalg.norm(to_ground)
        leaving = (r * np.cos(beta) - EARTH_M) / distance
        arriving = max(0.0, to_ground @ [np.sin(tilt), 0, -np.cos(tilt)]) / distance
        return leaving * arriving / distance**2 * EARTH_M * across / np.pi

    def horizon(beta):
        """Azimuth up to which ground at beta is above the element's horizon."""
        a, b = (r - EARTH_M * np.cos(beta)) * np.cos(tilt), EARTH_M * np.sin(beta) * np.sin(tilt)
        return np.arccos(np.clip(-a / b, -1, 1)) if b > 0 else np.pi * (a > 0)

    share, _ = dblquad(patch, 0, reach, 0, horizon, epsabs=1e-10, epsrel=1e-10)
    assert view_factor(np.cos(tilt), EARTH_M / r) == pytest.approx(2 * share, rel=0, abs=QUADRATURE_ATOL)
    error = abs(view_factor(np.cos(tilt), EARTH_M / r) - 2 * share)
    record_accuracy("View factor of the Earth, over the ground", error, QUADRATURE_ATOL, "", "quadrature in 2-D")


def test_view_factors_of_closed_form():
    c = np.linspace(-1, 1, 41)
    np.testing.assert_allclose(view_factor(c, 1.0), (1 + c) / 2, rtol=0, atol=FACTOR_ATOL)  # on the ground
    np.testing.assert_allclose(view_factor(c, 1.5), (1 + c) / 2, rtol=0, atol=FACTOR_ATOL)  # taken for the ground
    assert view_factor(1.0, 0.8) == pytest.approx(0.64, rel=EXACT_RTOL, abs=0)
    alpha = np.arcsin(0.8)
    upright = (alpha - np.sin(alpha) * np.cos(alpha)) / np.pi
    assert view_factor(0.0, 0.8) == pytest.approx(upright, rel=EXACT_RTOL, abs=0)
    assert view_factor(-0.8, 0.8) == 0.0
    assert view_factor(np.nextafter(-0.8, 0), 0.8) < 1e-16


def test_view_factor_does_not_jump():
    s = 0.9
    at = np.array([s, -s])
    for step in (1e-4, 1e-8, 1e-12):
        np.testing.assert_allclose(view_factor(at + step, s), view_factor(at - step, s), rtol=0, atol=2 * step)


def sphere_share(phase_rad):
    """What a unit sphere reflects at a phase angle."""
    return 2 / 3 * (np.sin(phase_rad) + (np.pi - phase_rad) * np.cos(phase_rad))


@pytest.mark.parametrize("limb_sine", [0.0166, 0.3, 0.9, 1.0])
@pytest.mark.parametrize("gamma_deg", [0, 40, 64, 90, 160, 180])
def test_earth_area_of_a_sphere(limb_sine, gamma_deg):
    """Lambert's sphere integrated over the Earth's disc."""
    gamma = np.radians(gamma_deg)
    view = np.array([np.sin(gamma), 0, np.cos(gamma)])

    def patch(azimuth, angle):
        direction = [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
        return sphere_share(np.arccos(np.clip(view @ direction, -1, 1))) * np.sin(angle) * 2 / np.pi

    expected, _ = dblquad(patch, 0, np.arcsin(limb_sine), 0, np.pi, epsabs=1e-10, epsrel=1e-10)
    area = infrared_area_m2(ws.Sphere(1.0), view, UP, limb_sine)
    assert area == pytest.approx(expected, rel=0, abs=SPHERE_ATOL * np.pi * limb_sine**2)


@pytest.mark.parametrize(
    ("limb_sines", "error"), [(NEAR, INFRARED_ERRORS[0]), (FAR, INFRARED_ERRORS[1])], ids=["near", "far"]
)
@pytest.mark.ci
def test_errors_of_infrared(limb_sines, error, device):
    """No body exceeds what is stated, near the Earth and out to the Moon, and some body comes near it."""
    view, nadir, limb_sine, _ = hard_geometries(np.random.default_rng(SEED), limb_sines, 1500)
    worst = 0.0
    for shape in [*SHAPES.values(), BOX]:
        normal, area_m2 = (shape.surface.normal, shape.surface.area_m2) if shape is BOX else facets(shape, 3000)
        if shape.kind == "sphere":
            continue  # its own test
        expected = np.array([
            np.maximum(v @ normal.T, 0) * area_m2 @ view_factor(np.clip(n @ normal.T, -1, 1), s)
            for v, n, s in zip(view, nadir, limb_sine, strict=True)
        ])  # fmt: skip
        area = infrared_area_m2(shape, view, nadir, limb_sine, device)
        assert (area >= 0).all()
        worst = max(worst, np.max(np.abs(area - expected) / limb_sine**2) / largest_m2(shape))
    assert error / 3 < worst <= error


def ground_patches(nadir, limb_sine, sun, n):
    """Directions, and solid angles times cosines of the solar zenith angle, of sunlit patches of the seen ground.

    Patches lie by the Earth's central angle from the point below (Gauss's rule) and by azimuth (equal steps).
    """
    first = np.cross(nadir, [0.6, 0.0, 0.8])
    first /= np.linalg.norm(first)
    x, weight = np.polynomial.legendre.leggauss(n)
    beta = np.arccos(limb_sine) * (1 + x)[:, None, None] / 2
    azimuth = (np.arange(2 * n) + 0.5)[None, :, None] * np.pi / n
    across = first * np.cos(azimuth) + np.cross(nadir, first) * np.sin(azimuth)
    ground = -nadir * np.cos(beta) + across * np.sin(beta)  # unit: the Earth's radius
    way = ground + nadir / limb_sine
    distance = np.linalg.norm(way, axis=2)
    leaving = (np.cos(beta[..., 0]) / limb_sine - 1) / distance
    area = np.sin(beta[..., 0]) * np.arccos(limb_sine) / 2 * weight[:, None] * np.pi / n
    light = (leaving * area / distance**2 * np.maximum(ground @ sun, 0)).ravel()
    return (way / distance[..., None]).reshape(-1, 3)[light > 0], light[light > 0]


def test_damping_of_the_cosine():
    """Legendre's coefficients of max(0, cos), 2 pi times the integral with P_l."""
    for degree in range(17):
        integral, _ = quad(lambda x, n=degree: x * eval_legendre(n, x), 0, 1, epsabs=1e-14)
        assert damping(degree) == pytest.approx(2 * np.pi * integral, rel=0, abs=DAMPING_ATOL)


def harmonics_of(direction, light, nadir, degree):
    """Sums of light times conjugate harmonics about the nadir, A_l times those; with a function to evaluate them."""
    first = np.cross(nadir, [0.0, 0.6, 0.8])
    first /= np.linalg.norm(first)
    axes = np.array([first, np.cross(nadir, first), nadir])

    def terms(unit):
        x, y, z = axes @ unit.T
        theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
        pairs = [(l, m) for l in range(degree + 1) for m in range(-l, l + 1)]
        return np.array([l for l, _ in pairs]), np.array([sph_harm_y(l, m, theta, phi) for l, m in pairs])

    degrees, found = terms(direction)
    damped = np.array([damping(l) for l in degrees]) * (found.conj() @ light)
    return lambda unit: (damped @ terms(unit)[1]).real


@pytest.mark.slow
@pytest.mark.parametrize("degree", [4, 12])
@pytest.mark.parametrize("height", [83, 92, 30])
def test_harmonics_of_an_element(degree, height, monkeypatch):
    """Harmonics of patches of sunlit ground, by scipy: high Sun, terminator on the disc, night below."""
    rng = np.random.default_rng(SEED + degree)
    monkeypatch.setitem(earth_light.RINGS, degree, 16)
    table, limb_sine = albedo_table.__wrapped__(degree), table_limb_sines("albedo", 1e-3)[height]
    for column in (21, 85, 98, 107):
        nadir = directions(rng, 1)[0]
        sun = sun_at(rng, nadir, column * np.pi / 192)
        normal = directions(rng, 12)
        expected = np.maximum(harmonics_of(*ground_patches(nadir, limb_sine, sun, 120), nadir, degree)(normal), 0)
        found = [albedo_area_m2_sr(mesh([n], [1.0]), n, nadir, limb_sine, sun, degree, table=table)[0] for n in normal]
        np.testing.assert_allclose(found, expected, rtol=0, atol=PATCH_ATOL * np.pi * limb_sine**2)


@every_degree
@pytest.mark.parametrize("name", ["sphere", "cylinder", "cone", "flat-cone"])
@pytest.mark.ci
def test_series_of_bodies_are_those_of_their_meshes(degree, name):
    """Ends, the side's arc and the sphere in closed form, against sums over facets by the same series."""
    shape, rng = SHAPES[name], np.random.default_rng(SEED)
    flat = mesh(*facets(shape, 800 if name == "sphere" else 3000))
    view, nadir = directions(rng, 12), directions(rng, 12)
    sun = [sun_at(rng, n, z) for n, z in zip(nadir, np.linspace(0, 1.9, 12), strict=True)]
    view[:2] = UP, -UP
    body, sum_of_facets = (albedo_area_m2_sr(one, view, nadir, 0.9, sun, degree) for one in (shape, flat))
    allowed = (SPHERE_RTOL if name == "sphere" else MESH_RTOL) * np.pi * 0.81 * largest_m2(shape)
    np.testing.assert_allclose(body, sum_of_facets, rtol=0, atol=allowed)
    assert body.max() > 0.1 * np.pi * 0.81 * largest_m2(shape)


@functools.cache
def patch_shares(far):
    """Hard geometries, and areas of every shape lit by patches of ground, as fractions of the largest value."""
    rng = np.random.default_rng(SEED)
    geometry = hard_geometries(rng, FAR if far else NEAR[:-1], 250)
    fractions = {name: np.zeros(len(geometry[0])) for name in (*SHAPES, "box")}
    for i, (view, nadir, limb_sine, sun) in enumerate(zip(*geometry, strict=True)):
        direction, light = ground_patches(nadir, limb_sine, sun, 100)
        for name, shape in {**SHAPES, "box": BOX}.items():
            if shape.kind == "sphere":
                phase = np.arccos(np.clip(direction @ view, -1, 1))
                area = shape.radius_m**2 * sphere_share(phase) @ light
            else:
                normal, area_m2 = (BOX.surface.normal, BOX.surface.area_m2) if shape is BOX else facets(shape, 180)
                seen = area_m2 * np.maximum(normal @ view, 0)
                rows = seen > 0
                area = seen[rows] @ (np.maximum(normal[rows] @ direction.T, 0) @ light)
            fractions[name][i] = area / (np.pi * limb_sine**2 * largest_m2(shape))
    return geometry, fractions


@every_degree
@pytest.mark.parametrize("far", [False, True], ids=["near", "far"])
@pytest.mark.slow
def test_errors_of_albedo(degree, far, device):
    """No body exceeds what is stated, near the Earth and out to the Moon, and some body comes near it."""
    (view, nadir, limb_sine, sun), fractions = patch_shares(far)
    worst = 0.0
    for name, shape in {**SHAPES, "box": BOX}.items():
        area = albedo_area_m2_sr(shape, view, nadir, limb_sine, sun, degree, device)
        assert (area >= 0).all()
        found = area / (np.pi * limb_sine**2 * largest_m2(shape))
        worst = max(worst, np.abs(found - fractions[name]).max())
    assert ALBEDO_ERRORS[degree][far] / 4 < worst <= ALBEDO_ERRORS[degree][far] + STRIPS_ATOL


@every_degree
def test_the_table_is_finite(degree):
    """The Sun on the horizon of the point below is a column: ring and terminator meet at one angle."""
    table = albedo_table(degree)
    assert np.isfinite(table).all()
    assert (table[:, -1] == 0).all()  # midnight


@every_shape
@pytest.mark.ci
def test_light_fades_out_over_the_terminator(shape, device):
    """From day to night without a jump, at a height between the table's; nothing once the whole seen cap is dark."""
    s = 0.8137
    edge = np.pi / 2 + np.arccos(s)
    zenith = np.concatenate([np.linspace(0, np.pi, 721), edge + np.array([-1e-3, -1e-6, 1e-9, 1e-3])])
    sun = np.stack([np.sin(zenith), 0 * zenith, -np.cos(zenith)], axis=1)  # over a nadir of +z
    light = albedo_area_m2_sr(shape, [0.6, 0.0, 0.8], UP, s, sun, 4, device) / (np.pi * s * s * largest_m2(shape))
    assert (light[zenith > edge] == 0).all()
    assert np.abs(np.diff(light[:721])).max() < 1.5 * np.pi / 720
    assert light[-3] < 1e-3


@pytest.mark.parametrize("shape", [SHAPES["cylinder"], SHAPES["cone"]], ids=["cylinder", "cone"])
@pytest.mark.ci
def test_signs_of_zero_do_not_matter(shape):
    """Nadir along the axis, and in one plane with view and axis: its part beside the view is 0 or -0."""
    sun, aside = np.array([0.36, 0.48, 0.8]), 1e-9 * np.array([0.0, 1.0, 0.0])
    for nadir in ([0.0, 0.0, -1.0], [-0.6, 0.0, -0.8], [0.6, 0.0, 0.8]):
        nadirs = np.array([nadir, np.where(np.array(nadir) == 0, -0.0, nadir), nadir + aside])
        for view in ([1.0, 0.0, 0.0], [-0.6, 0.0, 0.8]):
            for area in (
                infrared_area_m2(shape, view, nadirs, 0.9),
                albedo_area_m2_sr(shape, view, nadirs, 0.9, sun, 4),
            ):
                np.testing.assert_allclose(area[:2], area[2], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("shape", [SHAPES["cone"], BOX], ids=["cone", "box"])
@pytest.mark.ci
def test_no_azimuth_of_the_sun(shape):
    """The Sun in the zenith: no direction is its azimuth, and none counts."""
    view, nadir = np.array([0.6, 0.0, 0.8]), np.array([0.0, -0.8, 0.6])
    sun = np.array([-nadir, -nadir + 1e-7 * np.array([1.0, 0.0, 0.0])])
    one, other = albedo_area_m2_sr(shape, view, nadir, 0.9, sun, 4)
    assert one == pytest.approx(other, rel=1e-6, abs=0)


def test_the_fastest_series_for_an_error():
    near = [albedo_degree(error, 0.9) for error in (1e-2, 5e-3, 2e-3, 1e-3)]
    far = [albedo_degree(error, NEAR_LIMB_SINE - 0.1) for error in (5e-2, 3e-2, 2e-2, 1e-2)]
    assert near == far == [4, 8, 12, 12]
    assert albedo_degree(1e-2, NEAR_LIMB_SINE) == 4


@wp.kernel(enable_backward=False)
def radius_kernel(position_m: wp.array[wp.vec3d], earth: earth_kernels.Earth, radius_m: wp.array[wp.float64]):
    i = wp.tid()
    radius_m[i] = earth_kernels.geocentric_radius_m(position_m[i], earth)


def test_radius_below_a_target(device):
    """Along a geodetic latitude's own place on the ellipsoid (ERFA), on the host and on the device."""
    lat = np.radians(np.array([-90, -60, -1e-6, 0, 10, 45, 89, 90]))
    place = np.array([erfa.gd2gce(EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, 0.7, x, 0.0) for x in lat])
    expected = np.linalg.norm(place, axis=1)
    sine = place[:, 2] / expected
    np.testing.assert_allclose(geocentric_radius_m(sine), expected, rtol=0, atol=RADIUS_ATOL_M)
    earth = earth_struct(UP)
    (radius,) = launched(radius_kernel, len(lat), [1.7 * place, earth], [wp.float64], device)
    np.testing.assert_allclose(radius, expected, rtol=0, atol=RADIUS_ATOL_M)
