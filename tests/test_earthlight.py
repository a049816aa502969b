"""Light of the Earth on targets: view factor, reflected heat, reflected sunlight, and the error of each rule."""

from itertools import pairwise
from types import SimpleNamespace

import erfa
import mpmath
import numpy as np
import pytest
import warp as wp
from scipy.integrate import dblquad, quad
from warpsim_kernels import earth as earth_kernels
from warpsim_kernels.earthlight import view_factor_kernel

import warpsim as ws
from warpsim.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from warpsim.errors import InputError
from warpsim.orbit.earth import EARTH_POLAR_RADIUS_M, geocentric_radius_m
from warpsim.target import earth_radiation
from warpsim.target.earth_radiation import absorbed_area_m2, albedo_area_m2, earth_area_m2, view_factor

SEED = 141421

FACTOR_ATOL = 1e-13  # float64 rounding; the pass line is 1e-8
QUADRATURE_ATOL = 1e-8  # of the two-dimensional quadrature
NESTED_RTOL = 1e-8  # of the term's largest value: nested adaptive quadrature, and rules of 32 nodes
PATCH_RTOL = 3e-5  # of the same: sides of strips and the Earth's disc of patches, second order in their sizes
FAR_RTOL = 1e-4  # the disc's own size, 1e-5 rad, and the penumbra of a terminator
TWIN_ATOL = 1e-15
EXACT_RTOL = 1e-12
RADIUS_ATOL_M = 1e-6

EARTH_M = 6.371e6
UP = np.array([0.0, 0.0, 1.0])

SHAPES = {
    "sphere": ws.Sphere(0.7),
    "cylinder": ws.Cylinder(0.25, 1.0),
    "cone": ws.Cone(0.25, 1.0),
    "flat-cone": ws.Cone(1.0, 0.4),
    "right-cone": ws.Cone(1.0, 1.0),
    "needle": ws.Cone(1e-2, 1e2),
    "disc": ws.Cone(10.0, 1e-3),
}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


def largest_m2(shape):
    """Largest projected area."""
    return shape.projected_area_m2(np.linspace(0, np.pi, 721)).max()


def directions(rng, n):
    """Random unit vectors."""
    vector = rng.normal(size=(n, 3))
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)


def sun_at(rng, nadir, zenith_rad):
    """A unit vector at an angle from the zenith, in a random azimuth."""
    across = np.cross(nadir, directions(rng, 1)[0])
    return -nadir * np.cos(zenith_rad) + across / np.linalg.norm(across) * np.sin(zenith_rad)


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


def test_view_factor_on_the_device(device):
    rng = np.random.default_rng(SEED)
    s = np.concatenate([rng.uniform(0, 1.1, 3000), np.full(10, 0.9)])
    c = np.concatenate([rng.uniform(-1, 1, 3000), hard_elements(0.9)])
    inputs = [wp.array(x, dtype=wp.float64, device=device) for x in (c, s)]
    factor = wp.empty_like(inputs[0])
    wp.launch(view_factor_kernel, dim=len(c), inputs=inputs, outputs=[factor], device=device)
    np.testing.assert_allclose(factor.numpy(), view_factor(c, s), rtol=0, atol=TWIN_ATOL)


def sphere_share(phase_rad):
    """What a unit sphere reflects at a phase angle."""
    return 2 / 3 * (np.sin(phase_rad) + (np.pi - phase_rad) * np.cos(phase_rad))


@pytest.mark.parametrize("limb_sine", [0.3, 0.9, 1.0])
@pytest.mark.parametrize("gamma_deg", [0, 40, 64, 90, 160, 180])
def test_earth_area_of_a_sphere(limb_sine, gamma_deg):
    """Lambert's sphere integrated over the Earth's disc."""
    gamma = np.radians(gamma_deg)
    view = np.array([np.sin(gamma), 0, np.cos(gamma)])

    def patch(azimuth, angle):
        direction = [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
        return sphere_share(np.arccos(np.clip(view @ direction, -1, 1))) * np.sin(angle) * 2 / np.pi

    expected, _ = dblquad(patch, 0, np.arcsin(limb_sine), 0, np.pi, epsabs=1e-10, epsrel=1e-10)
    area = earth_area_m2(ws.Sphere(1.0), view, UP, limb_sine, n_node=24)
    assert area == pytest.approx(expected, rel=0, abs=NESTED_RTOL * np.pi * limb_sine**2)


def side_of(shape):
    """Side of a cone or cylinder: area, and the two parts of its normals."""
    r, h = shape.radius_m, shape.height_m
    if shape.kind == "cylinder":
        return 2 * np.pi * r * h, 1.0, 0.0
    slant = np.hypot(r, h)
    return np.pi * r * slant, h / slant, r / slant


def nested_earth_area(shape, view, nadir, limb_sine):
    """Ends, and the side by adaptive quadrature over azimuth of the view factor by adaptive quadrature over rings."""

    def factor(normal):
        c = np.clip(normal @ nadir, -1, 1)
        across, end = np.sqrt(1 - c * c), np.arcsin(limb_sine)

        def ring(angle):
            a, b = c * np.cos(angle), across * np.sin(angle)
            half = np.pi if a >= b else 0.0 if a <= -b else np.arccos(-a / b)
            return 2 * (a * half + b * np.sin(half)) * np.sin(angle) / np.pi

        kink = abs(np.pi / 2 - np.arccos(c))
        edges = [0, kink, end] if kink < end else [0, end]
        return sum(quad(ring, low, high, epsabs=1e-12, epsrel=1e-10)[0] for low, high in pairwise(edges))

    side_m2, across, along = side_of(shape)
    top_m2 = np.pi * shape.radius_m**2 if shape.kind == "cylinder" else 0.0
    total = np.pi * shape.radius_m**2 * max(0.0, -view[2]) * factor(-UP) + top_m2 * max(0.0, view[2]) * factor(UP)

    def strip(azimuth):
        normal = np.array([across * np.cos(azimuth), across * np.sin(azimuth), along])
        seen = normal @ view
        return seen * factor(normal) * side_m2 / (2 * np.pi) if seen > 0 else 0.0

    return total + quad(strip, 0, 2 * np.pi, epsabs=1e-9 * side_m2, epsrel=1e-9, limit=200)[0]


@pytest.mark.parametrize("name", ["cylinder", "cone", "flat-cone"])
@pytest.mark.ci
def test_earth_area_by_nested_quadrature(name):
    shape, rng = SHAPES[name], np.random.default_rng(SEED)
    view, nadir = directions(rng, 3), directions(rng, 3)
    cases = [(v, n, s) for v, n, s in zip(view, nadir, [0.9, 0.7, 0.3], strict=True)]
    base_on_limb = np.array([0.6, 0.0, -0.8])  # nadir: the base's horizon touches a limb of 0.8
    for v, n, s in [*cases, (view[0], base_on_limb, 0.8), (UP, UP, 0.9), (base_on_limb, -UP, 0.98)]:
        expected = nested_earth_area(shape, v, n, s)
        area = earth_area_m2(shape, v, n, s, n_node=32)
        assert area == pytest.approx(expected, rel=0, abs=NESTED_RTOL * s * s * largest_m2(shape))


def facets(shape, n_side):
    """Normals and areas of a body whose side is cut into flat strips."""
    side_m2, across, along = side_of(shape)
    turn = (np.arange(n_side) + 0.5) * 2 * np.pi / n_side
    normal = np.stack([across * np.cos(turn), across * np.sin(turn), np.full(n_side, along)], axis=1)
    end_m2 = np.pi * shape.radius_m**2
    ends = [end_m2, end_m2 if shape.kind == "cylinder" else 0.0]
    return np.vstack([normal, -UP, UP]), np.concatenate([np.full(n_side, side_m2 / n_side), ends])


def mesh(normal, area_m2):
    """What a mesh says of itself."""
    surface = SimpleNamespace(normal=np.asarray(normal, float), area_m2=np.asarray(area_m2, float))
    return SimpleNamespace(kind="mesh", surface=surface)


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


def patch_albedo_area(shape, view, nadir, limb_sine, sun, n=300):
    """The body lit by patches of ground: facets, or Lambert's sphere."""
    direction, light = ground_patches(nadir, limb_sine, sun, n)
    if shape.kind == "sphere":
        return shape.radius_m**2 * sphere_share(np.arccos(np.clip(direction @ view, -1, 1))) @ light
    normal, area_m2 = facets(shape, 180)
    seen = area_m2 * np.maximum(normal @ view, 0)
    rows = seen > 0
    total = 0.0
    for start in range(0, len(light), 20_000):
        part = slice(start, start + 20_000)
        total += seen[rows] @ np.maximum(normal[rows] @ direction[part].T, 0) @ light[part]
    return total


@pytest.mark.parametrize("name", ["sphere", "cylinder", "cone", "flat-cone"])
@pytest.mark.parametrize("zenith_deg", [0, 60, 85, 95, 110])
@pytest.mark.ci
def test_albedo_area_over_patches(name, zenith_deg):
    """Day, night and the terminator on the seen disc; the Earth high, rising and with its limb on an end's horizon."""
    shape, rng = SHAPES[name], np.random.default_rng(SEED + zenith_deg)
    view = directions(rng, 2)
    for v, nadir, s in [(view[0], directions(rng, 1)[0], 0.9), (view[1], np.array([0.6, 0.0, -0.8]), 0.8)]:
        sun = sun_at(rng, nadir, np.radians(zenith_deg))
        expected = patch_albedo_area(shape, v, nadir, s, sun)
        area = albedo_area_m2(shape, v, nadir, s, sun, n_node=12)
        assert area == pytest.approx(expected, rel=0, abs=PATCH_RTOL * np.pi * s * s * largest_m2(shape))


def nested_element(normal, nadir, limb_sine, sun):
    """One plane element: adaptive quadrature over ground below it, with breaks at the terminator and the horizon."""
    flat = sun + nadir * -(sun @ nadir)
    flat /= np.linalg.norm(flat)
    beside = np.cross(nadir, flat)

    def patch(azimuth, beta):
        ground = -nadir * np.cos(beta) + (flat * np.cos(azimuth) + beside * np.sin(azimuth)) * np.sin(beta)
        way = ground + nadir / limb_sine
        distance = np.linalg.norm(way)
        leaving = (np.cos(beta) / limb_sine - 1) / distance
        return leaving / distance**3 * max(0.0, ground @ sun) * max(0.0, way @ normal) * np.sin(beta)

    def strip(beta):
        """Breaks where ground @ sun or way @ normal changes sign: p + q cos + r sin = 0."""
        rows = [
            (-nadir @ sun * np.cos(beta), flat @ sun * np.sin(beta), beside @ sun * np.sin(beta)),
            (
                nadir @ normal * (1 / limb_sine - np.cos(beta)),
                flat @ normal * np.sin(beta),
                beside @ normal * np.sin(beta),
            ),
        ]
        breaks = [-np.pi, np.pi]
        for p, q, r in rows:
            if np.hypot(q, r) > abs(p):
                middle, half = np.arctan2(r, q), np.arccos(-p / np.hypot(q, r))
                breaks += [(middle + sign * half + np.pi) % (2 * np.pi) - np.pi for sign in (-1, 1)]
        breaks = np.unique(breaks)
        return sum(quad(patch, a, b, args=(beta,), epsabs=1e-12, epsrel=1e-9)[0] for a, b in pairwise(breaks))

    return quad(strip, 0, np.arccos(limb_sine), epsabs=1e-10, epsrel=1e-9, limit=200)[0]


@pytest.mark.parametrize(
    ("tilt_deg", "zenith_deg", "limb_sine"),
    [(0, 30, 0.9), (70, 100, 0.9), (150, 80, 0.9), (110, 95, 0.5), (64.158067236, 90, 0.9), (90, 60, 0.98)],
)
@pytest.mark.ci
def test_albedo_of_an_element(tilt_deg, zenith_deg, limb_sine):
    tilt, rng = np.radians(tilt_deg), np.random.default_rng(SEED)
    normal = np.array([np.sin(tilt), 0, np.cos(tilt)])
    sun = sun_at(rng, UP, np.radians(zenith_deg))
    expected = nested_element(normal, UP, limb_sine, sun)
    value = albedo_area_m2(mesh([normal], [1.0]), normal, UP, limb_sine, sun, n_node=48)
    assert value == pytest.approx(expected, rel=0, abs=NESTED_RTOL * np.pi * limb_sine**2)


@every_shape
@pytest.mark.ci
def test_far_from_the_earth(shape):
    """The Earth as a point: a body lit from one side, by heat and by a Lambertian sphere's light at the Sun's phase."""
    rng, s = np.random.default_rng(SEED), 1e-5
    view, nadir, sun = directions(rng, 40), directions(rng, 40), directions(rng, 40)
    lit = reflected_area(shape, view, nadir)
    allowed = FAR_RTOL * s * s * largest_m2(shape)
    np.testing.assert_allclose(earth_area_m2(shape, view, nadir, s), s * s * lit, rtol=0, atol=allowed)
    phase = np.arccos(np.clip(-np.sum(nadir * sun, axis=1), -1, 1))
    expected = s * s * sphere_share(phase) * lit
    np.testing.assert_allclose(albedo_area_m2(shape, view, nadir, s, sun), expected, rtol=0, atol=allowed)


def reflected_area(shape, view, light):
    """Integral of max(0, n.view) max(0, n.light): Lambert's sphere, or many strips."""
    if shape.kind == "sphere":
        return shape.radius_m**2 * sphere_share(np.arccos(np.clip(np.sum(view * light, axis=1), -1, 1)))
    normal, area_m2 = facets(shape, 20_000)
    return area_m2 @ (np.maximum(normal @ view.T, 0) * np.maximum(normal @ light.T, 0))


@every_shape
def test_absorbed_area(shape):
    """Half the surface on the ground; the mean over all nadirs is surface * (1 - cos(alpha)) / 2."""
    nadir = directions(np.random.default_rng(SEED), 20)
    np.testing.assert_allclose(absorbed_area_m2(shape, nadir, 1.0), shape.surface_m2 / 2, rtol=EXACT_RTOL, atol=0)
    x, weight = np.polynomial.legendre.leggauss(200)
    rings = np.stack([np.sqrt(1 - x * x), 0 * x, x], axis=1)
    for s in (0.3, 0.9):
        mean = weight @ absorbed_area_m2(shape, rings, s) / 2
        expected = shape.surface_m2 * (1 - np.sqrt(1 - s * s)) / 2
        assert mean == pytest.approx(expected, rel=1e-6, abs=0)


@every_shape
def test_what_is_sent_everywhere_is_what_was_absorbed(shape):
    """The integral of the reflecting area over all views is pi times the absorbing area."""
    x, weight = np.polynomial.legendre.leggauss(200)
    turn = (np.arange(256) + 0.5) * 2 * np.pi / 256
    sine = np.sqrt(1 - x * x)[:, None]
    view = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.broadcast_to(x[:, None], (200, 256))], axis=2)
    nadir = np.array([0.48, 0.6, -0.64])
    total = weight @ earth_area_m2(shape, view, nadir, 0.9).mean(axis=1) * 2 * np.pi
    assert total == pytest.approx(np.pi * absorbed_area_m2(shape, nadir, 0.9), rel=1e-4, abs=0)


def test_meshes_need_no_rule_for_heat_and_tend_to_their_body():
    rng = np.random.default_rng(SEED)
    body, flat = SHAPES["cone"], mesh(*facets(SHAPES["cone"], 3000))
    view, nadir, sun = directions(rng, 20), directions(rng, 20), directions(rng, 20)
    allowed = 1e-5 * 0.81 * largest_m2(body)
    heat = earth_area_m2(body, view, nadir, 0.9)
    np.testing.assert_allclose(earth_area_m2(flat, view, nadir, 0.9, n_node=1), heat, rtol=0, atol=allowed)
    absorbed = absorbed_area_m2(body, nadir, 0.9)
    np.testing.assert_allclose(absorbed_area_m2(flat, nadir, 0.9, n_node=1), absorbed, rtol=0, atol=allowed)
    albedo = albedo_area_m2(body, view, nadir, 0.9, sun)
    np.testing.assert_allclose(albedo_area_m2(flat, view, nadir, 0.9, sun), albedo, rtol=0, atol=np.pi * allowed)


@every_shape
def test_light_fades_out_over_the_terminator(shape):
    """From day to night without a jump; exactly nothing once the whole seen cap is dark."""
    s = 0.9
    edge = np.pi / 2 + np.arccos(s)
    zenith = np.concatenate([np.linspace(0, np.pi, 721), edge + np.array([-1e-3, -1e-6, 1e-9, 1e-3])])
    sun = np.stack([np.sin(zenith), 0 * zenith, -np.cos(zenith)], axis=1)  # over a nadir of +z
    light = albedo_area_m2(shape, np.array([0.6, 0.0, 0.8]), UP, s, sun) / (np.pi * s * s * largest_m2(shape))
    assert (light[zenith > edge] == 0).all()
    assert (light[zenith < edge] > 0).all()
    assert np.abs(np.diff(light[:721])).max() < 1.5 * np.pi / 720
    assert light[-3] < 1e-12


@pytest.mark.parametrize("shape", [SHAPES["cylinder"], SHAPES["cone"]], ids=["cylinder", "cone"])
def test_signs_of_zero_do_not_matter(shape):
    """Nadir along the axis, and in one plane with view and axis: its part beside the view is 0 or -0."""
    sun = np.array([0.36, 0.48, 0.8])
    for nadir in ([0.0, 0.0, -1.0], [-0.6, 0.0, -0.8], [0.6, 0.0, 0.8]):
        flipped = np.where(np.array(nadir) == 0, -0.0, nadir)
        for view in ([1.0, 0.0, 0.0], [-0.6, 0.0, 0.8]):
            light = [albedo_area_m2(shape, view, n, 0.9, sun) for n in (nadir, flipped)]
            near = albedo_area_m2(shape, view, np.array(nadir) + 1e-9 * np.array([0.0, 1.0, 0.0]), 0.9, sun)
            np.testing.assert_allclose(light, near, rtol=1e-6, atol=1e-9)


def hard_geometries(rng, n):
    """Random views, nadirs, distances and Suns, with axes, oppositions and terminators on the disc mixed in."""
    view, nadir, sun = directions(rng, n), directions(rng, n), directions(rng, n)
    limb_sine = rng.choice([0.0166, 0.15, 0.5, 0.8, 0.9, 0.95, 0.98, 0.995], n)
    for i in np.flatnonzero(rng.random(n) < 0.4):
        reach = np.arccos(limb_sine[i])
        sun[i] = sun_at(rng, nadir[i], np.pi / 2 + rng.uniform(-reach, reach))
    axes = np.array([UP, -UP, [1.0, 0.0, 0.0]])
    for vector in (view, nadir, sun):
        rows = rng.random(n) < 0.07
        vector[rows] = axes[rng.integers(0, 3, rows.sum())]
    for target, source in ((view, nadir), (view, -nadir), (sun, -nadir), (view, sun)):
        rows = rng.random(n) < 0.05
        target[rows] = source[rows]
    return view, nadir, limb_sine, sun


@pytest.fixture(scope="module")
def fine_areas():
    """Hard geometries, and both areas of every shape by rules far beyond the ladder, as shares of the largest value."""
    geometry = hard_geometries(np.random.default_rng(SEED), 1200)
    return geometry, {name: shares(shape, *geometry, 64, 28) for name, shape in SHAPES.items()}


def shares(shape, view, nadir, limb_sine, sun, n_thermal, n_albedo):
    """Thermal and albedo areas as shares of their largest values."""
    scale = limb_sine**2 * largest_m2(shape)
    thermal = earth_area_m2(shape, view, nadir, limb_sine, n_thermal) / scale
    return thermal, albedo_area_m2(shape, view, nadir, limb_sine, sun, n_albedo) / (np.pi * scale)


@pytest.mark.parametrize("n_node", earth_radiation.NODE_ERRORS)
@pytest.mark.ci
def test_errors_of_the_ladder(fine_areas, n_node):
    """No body exceeds the table, and some body comes near it."""
    geometry, fine = fine_areas
    worst = {"thermal": 0.0, "albedo": 0.0}
    for name, shape in SHAPES.items():
        for light, coarse, right in zip(worst, shares(shape, *geometry, n_node, n_node), fine[name], strict=True):
            assert right.max() <= 1
            worst[light] = max(worst[light], np.abs(coarse - right).max())
    for light, error in worst.items():
        assert error <= earth_radiation.NODE_ERRORS[n_node][light]
        assert error >= earth_radiation.NODE_ERRORS[n_node][light] / 20


def test_nodes_for_an_error():
    assert earth_radiation.nodes_for("thermal", 1e-3) == 5
    assert earth_radiation.nodes_for("thermal", 1.0) == 3
    assert earth_radiation.nodes_for("albedo", 2e-4) == 6
    with pytest.raises(InputError, match="error: must be at least 2e-06 for albedo light of the Earth, got 1e-09"):
        earth_radiation.nodes_for("albedo", 1e-9)


def test_bad_input():
    sphere = SHAPES["sphere"]
    with pytest.raises(InputError, match="view: must be unit vectors, got one of length 2"):
        earth_area_m2(sphere, [0, 0, 2], UP, 0.9)
    with pytest.raises(InputError, match="nadir: must be unit vectors, got one of length nan"):
        absorbed_area_m2(sphere, [0, 0, np.nan], 0.9)
    with pytest.raises(InputError, match=r"sun: must be unit vectors, shape \(3,\) or \(n, 3\), got shape \(2,\)"):
        albedo_area_m2(sphere, UP, UP, 0.9, [1, 0])
    with pytest.raises(InputError, match="limb_sine: must be finite and > 0, got 0"):
        earth_area_m2(sphere, UP, UP, [0.9, 0])
    with pytest.raises(InputError, match="view, nadir, limb_sine: shapes must broadcast"):
        earth_area_m2(sphere, [UP, UP], [UP, UP, UP], 0.9)


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
    earth = earth_kernels.Earth()
    earth.pole = wp.vec3d(0.0, 0.0, 1.0)
    earth.equatorial_radius_m, earth.polar_radius_m = EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
    radius = wp.empty(len(lat), dtype=wp.float64, device=device)
    inputs = [wp.array(1.7 * place, dtype=wp.vec3d, device=device), earth]
    wp.launch(radius_kernel, dim=len(lat), inputs=inputs, outputs=[radius], device=device)
    np.testing.assert_allclose(radius.numpy(), expected, rtol=0, atol=RADIUS_ATOL_M)
