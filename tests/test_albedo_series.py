"""Sunlight by way of the Earth as a series of harmonics: against harmonics found elsewhere, and against the rule."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import eval_legendre, sph_harm_y
from test_earthlight import (
    SEED,
    SHAPES,
    UP,
    directions,
    every_shape,
    facets,
    ground_patches,
    hard_geometries,
    largest_m2,
    mesh,
    sun_at,
)
from warpsim_kernels.albedo_series import damping

from warpsim.errors import InputError
from warpsim.target import earth_radiation
from warpsim.target.earth_radiation import SERIES_ERRORS, SERIES_RINGS, albedo_area_m2, albedo_method

DAMPING_ATOL = 1e-13
PATCH_ATOL = 3e-5  # of the largest value: patches at the terminator
MESH_RTOL = 1e-5  # sides of 3000 strips, second order in their widths
SPHERE_RTOL = 2e-5  # 800 x 400 facets
RULE_ATOL = 2e-5  # error of the rule of 16 nodes
LIMB_SINES = [1.0, 0.9999, 0.999, 0.995, 0.98, 0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.35, 0.24, 0.15, 0.05, 0.0166]
every_degree = pytest.mark.parametrize("degree", SERIES_ERRORS)


def series_area_m2(shape, view, nadir, limb_sine, sun, degree):
    """Area by the series, with the rings that scenes take."""
    return albedo_area_m2(shape, view, nadir, limb_sine, sun, SERIES_RINGS[degree], degree)


def box():
    """A mesh of six facets."""
    return mesh(np.vstack([np.eye(3), -np.eye(3)]), [0.4, 1.0, 0.6, 0.4, 1.0, 0.6])


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
@pytest.mark.parametrize("limb_sine", [0.9, 0.98, 0.3])
def test_series_of_an_element(degree, limb_sine):
    """Harmonics of patches of sunlit ground, by scipy: high Sun, terminator on the disc, night below."""
    rng = np.random.default_rng(SEED + degree)
    for zenith_deg in (20, 80, 92, 100):
        nadir = directions(rng, 1)[0]
        sun = sun_at(rng, nadir, np.radians(zenith_deg))
        normal = directions(rng, 12)
        expected = np.maximum(harmonics_of(*ground_patches(nadir, limb_sine, sun, 120), nadir, degree)(normal), 0)
        found = [albedo_area_m2(mesh([n], [1.0]), n, nadir, limb_sine, sun, 16, degree) for n in normal]
        np.testing.assert_allclose(found, expected, rtol=0, atol=PATCH_ATOL * np.pi * limb_sine**2)


@every_degree
@pytest.mark.parametrize("name", ["sphere", "cylinder", "cone", "flat-cone"])
@pytest.mark.ci
def test_series_of_bodies_are_those_of_their_meshes(degree, name):
    """Ends, the side's arc and the sphere in closed form, against sums over facets by the same series."""
    shape, rng = SHAPES[name], np.random.default_rng(SEED)
    if name == "sphere":
        x, weight = np.polynomial.legendre.leggauss(400)
        turn = (np.arange(800) + 0.5) * 2 * np.pi / 800
        across = np.sqrt(1 - x * x)[:, None]
        normal = np.stack([across * np.cos(turn), across * np.sin(turn), x[:, None] + 0 * turn], axis=2).reshape(-1, 3)
        flat = mesh(normal, np.repeat(weight, 800) * np.pi / 400 * shape.radius_m**2)
    else:
        flat = mesh(*facets(shape, 3000))
    nadir = directions(rng, 12)
    view, sun = (
        directions(rng, 12),
        np.array([sun_at(rng, n, z) for n, z in zip(nadir, np.linspace(0, 1.9, 12), strict=True)]),
    )
    view[:2] = UP, -UP
    body, sum_of_facets = (series_area_m2(one, view, nadir, 0.9, sun, degree) for one in (shape, flat))
    allowed = (SPHERE_RTOL if name == "sphere" else MESH_RTOL) * np.pi * 0.81 * largest_m2(shape)
    np.testing.assert_allclose(body, sum_of_facets, rtol=0, atol=allowed)
    assert body.max() > 0.1 * np.pi * 0.81 * largest_m2(shape)


def hardest_geometries(n):
    """Those of the rule's ladder at more distances, with faces straight up and down under a high Sun mixed in."""
    rng = np.random.default_rng(SEED)
    view, nadir, _, sun = hard_geometries(rng, n)
    limb_sine = rng.choice(LIMB_SINES, n)
    for i in np.flatnonzero(rng.random(n) < 0.5):
        if rng.random() < 0.4:
            nadir[i] = UP * rng.choice([-1, 1])
            sun[i] = sun_at(rng, nadir[i], abs(rng.normal(0, 0.2)))
        else:
            sun[i] = sun_at(rng, nadir[i], np.pi / 2 + rng.uniform(-1, 1) * np.arccos(limb_sine[i]))
    high = np.linspace(0.0166, 1.0, 120)  # a plate that looks straight down or up, the Sun in the zenith
    down, up = np.tile(UP, (240, 1)), np.repeat([UP, -UP], 120, axis=0)
    return np.vstack([view, down]), np.vstack([nadir, up]), np.append(limb_sine, [*high, *high]), np.vstack([sun, -up])


@pytest.fixture(scope="module")
def right():
    """Hard geometries, and areas of every shape by the rule, as shares of the largest value."""
    geometry = hardest_geometries(1500)
    scale = np.pi * geometry[2] ** 2
    shapes = {**{name: (shape, largest_m2(shape)) for name, shape in SHAPES.items()}, "box": (box(), np.sqrt(1.52))}
    return geometry, {
        name: (shape, scale * most_m2, albedo_area_m2(shape, *geometry, 16) / (scale * most_m2))
        for name, (shape, most_m2) in shapes.items()
    }


@every_degree
@pytest.mark.ci
def test_errors_of_the_series(right, degree):
    """No body exceeds the table, near or far, and some body comes near it; nothing is negative."""
    geometry, areas = right
    near = geometry[2] >= earth_radiation.NEAR_LIMB_SINE
    worst = np.zeros(2)
    for shape, scale, expected in areas.values():
        found = series_area_m2(shape, *geometry, degree) / scale
        assert (found >= 0).all()
        error = np.abs(found - expected)
        worst = np.maximum(worst, [error[near].max(), error.max()])
    assert (worst + RULE_ATOL <= SERIES_ERRORS[degree]).all()
    assert (worst >= np.array(SERIES_ERRORS[degree]) / 3).all()


@every_degree
@every_shape
@pytest.mark.ci
def test_nothing_over_the_night(shape, degree):
    nadir, sun = UP, np.array([0.43, 0.0, np.sqrt(1 - 0.43**2)])  # the horizon is at a cosine of 0.4359
    assert series_area_m2(shape, np.array([0.6, 0.0, 0.8]), nadir, 0.9, sun, degree) == 0
    assert series_area_m2(shape, -UP, nadir, 0.9, sun, degree) == 0


@pytest.mark.ci
def test_no_azimuth_of_the_sun(right):
    """The Sun in the zenith: no direction is its azimuth, and none counts."""
    for name in ("cone", "box"):
        shape = right[1][name][0]
        view, nadir = np.array([0.6, 0.0, 0.8]), np.array([0.0, -0.8, 0.6])
        tilted = -nadir + 1e-7 * np.array([1.0, 0.0, 0.0])
        both = [series_area_m2(shape, view, nadir, 0.9, s, 4) for s in (-nadir, tilted)]
        assert both[0] == pytest.approx(both[1], rel=1e-6, abs=0)


def test_the_fastest_method_for_an_error():
    assert albedo_method(1e-2, 0.9) == (4, 4)
    assert albedo_method(1e-2, 0.5) == (4, 4)
    assert albedo_method(5e-3, 0.9) == (8, 6)
    assert albedo_method(2e-3, 0.9) == (12, 8)
    assert albedo_method(1e-3, 0.9) == (0, 6)
    assert albedo_method(5e-2, 0.1) == (4, 4)
    assert albedo_method(2e-2, 0.1) == (12, 8)
    assert albedo_method(1e-2, 0.1) == (0, 5)
    with pytest.raises(InputError, match="error: must be at least 2e-06 for albedo light of the Earth, got 1e-07"):
        albedo_method(1e-7, 0.9)
