"""Cone queries of the star index against brute force over all stars."""

import functools

import numpy as np
import pytest
import warp as wp
from conftest import slow
from warpsim_kernels.band_index import cone_cover, run_of_stars

import warpsim as ws

SEED = 271828
UNSURE = 1e-9  # cosines this close to the radius's are decided by the accurate angle instead

BORDER_RAD = 1e-9  # "exactly on the border" cases are asked for this much to either side
TOUCH_RAD = 1e-13  # the accurate angle is good to some 1e-16 rad


def unit(ra_deg, dec_deg):
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


def brute_force(stars, axis, radius_rad):
    """Rows of (cone, star) pairs, sorted; angle by atan2 of |a - b| and |a + b| where the cosine cannot tell."""
    cosine, limit = axis @ stars.T, np.cos(radius_rad)[:, None]
    inside = cosine > limit
    cone, star = np.nonzero(np.abs(cosine - limit) < UNSURE)
    difference, total = (np.linalg.norm(axis[cone] + sign * stars[star], axis=1) for sign in (-1, 1))
    inside[cone, star] = 2 * np.arctan2(difference, total) <= radius_rad[cone]
    return np.nonzero(inside)


@functools.cache
def hard_catalog():
    """Every 36th star of the embedded catalog, and stars at the borders of cells, at the poles, and twice."""
    sky = ws.StarCatalog.default()
    border_ra, border_dec = np.meshgrid([0.0, 1.0, 90.0, 180.0, 270.0, 359.0], [-89.0, -60, -59, 0, 59, 60, 61, 89])
    ra = np.concatenate([sky.ra_deg[::36], border_ra.ravel(), [0.0, 0.0, 77.0, 123.4, 123.4, 123.4]])
    dec = np.concatenate([sky.dec_deg[::36], border_dec.ravel(), [90.0, -90.0, 90.0, 5.0, 5.0, 5.0]])
    return ws.StarCatalog.from_arrays(ra, dec, {"A": np.ones(len(ra))})


@functools.cache
def hard_index(device):
    return ws.BandIndex(hard_catalog(), device=device)


def assert_queries_equal(index, direction, radius_rad, record=None):
    cone, star = brute_force(index.catalog.direction_icrs, direction, radius_rad)
    start, rows = index.query_many(direction, radius_rad)
    if index.device.is_cuda:  # fused multiplications and additions decide of stars on the rim itself
        stars = index.catalog.direction_icrs
        found = np.repeat(np.arange(len(direction)), np.diff(start)) * len(index) + rows
        radii = (radius_rad - TOUCH_RAD, radius_rad + TOUCH_RAD)
        surely, perhaps = (np.dot((len(index), 1), brute_force(stars, direction, near)) for near in radii)
        assert np.isin(surely, found).all() and np.isin(found, perhaps).all() and (np.diff(found) > 0).all()
        return
    np.testing.assert_array_equal(np.diff(start), np.bincount(cone, minlength=len(direction)))
    np.testing.assert_array_equal(rows, star)
    if record:
        record("Stars found in a cone", len({*rows.tolist()} ^ {*star.tolist()}), 0, "stars differ", "all stars tried")


def random_cones(n, rng):
    """Directions all over the sky, a fifth close to a pole; radii of 1e-9 rad to 20 deg, one in 50 up to pi."""
    direction = rng.normal(size=(n, 3))
    direction[: n // 5, :2] *= 10.0 ** rng.uniform(-6, 0, (n // 5, 1))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = 10.0 ** rng.uniform(-9, np.log10(0.35), n)
    radius[::50] = rng.uniform(0, np.pi, len(radius[::50]))
    return direction, radius


@pytest.mark.parametrize("n_time", [5, slow(20)])
@pytest.mark.ci
def test_a_hundred_thousand_random_cones(device, n_time, record_accuracy):
    rng = np.random.default_rng((SEED, n_time))
    for _ in range(n_time):
        assert_queries_equal(hard_index(device), *random_cones(4000, rng), record_accuracy)


@pytest.mark.slow
def test_a_million_random_cones(device, record_accuracy):
    rng = np.random.default_rng(SEED + 1)
    for _ in range(250):
        assert_queries_equal(hard_index(device), *random_cones(4000, rng), record_accuracy)


HARD_DEC_DEG = [-90.0, -89.9, -60.5, -60.0, -59.5, 0.0, 59.5, 60.0, 60.5, 89.9, 90.0]
HARD_RADII_RAD = [0.0, 1e-9, 0.001, np.radians(0.5), np.radians(1.0), 0.3, 1.2, np.pi / 2, 3.0, np.pi]


@pytest.mark.parametrize("dec_deg", HARD_DEC_DEG)
@pytest.mark.parametrize("ra_deg", [0.0, 1e-7, 0.5, 180.0, 359.5, 360.0])
def test_hard_directions_at_every_radius(device, ra_deg, dec_deg, record_accuracy):
    direction = np.tile(unit(ra_deg, dec_deg), (len(HARD_RADII_RAD), 1))
    assert_queries_equal(hard_index(device), direction, np.array(HARD_RADII_RAD), record_accuracy)


@pytest.mark.parametrize("radius_deg", [29.9, 30.0, 30.1, 90.0, 150.0])
def test_cones_that_touch_a_pole(device, radius_deg):
    """The cone's rim passes just short of, through, and just over the pole."""
    direction = unit(np.array([10.0, 200.0, 355.0] * 2), np.array([60.0] * 3 + [-60.0] * 3))
    for shift in (-1e-6, -1e-10, 0.0, 1e-10, 1e-6):
        assert_queries_equal(hard_index(device), direction, np.full(6, np.radians(radius_deg) + shift))


def test_radius_zero_finds_the_star_itself_and_its_doubles(device):
    index = hard_index(device)
    direction = index.catalog.direction_icrs
    missed = [row for row in range(0, len(direction), 7) if row not in index.query(direction[row], 0.0)]
    assert missed == []
    twins = np.flatnonzero((index.catalog.ra_deg == 123.4) & (index.catalog.dec_deg == 5.0))
    assert len(twins) == 3
    np.testing.assert_array_equal(index.query(direction[twins[1]], 0.0), twins)


def test_radius_pi_finds_every_star(device):
    index = hard_index(device)
    for direction in (unit(12.0, 34.0), [0, 0, 1], index.catalog.direction_icrs[5]):
        np.testing.assert_array_equal(index.query(direction, np.pi), np.arange(len(index)))


def test_stars_near_the_rim_fall_on_the_right_side(device):
    """Cones around a star's neighbourhood whose rim passes the star at a billionth of a radian."""
    index = hard_index(device)
    rng = np.random.default_rng(SEED)
    rows = rng.integers(0, len(index), 1000)
    star = index.catalog.direction_icrs[rows]
    direction = rng.normal(size=(1000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    angle = 2 * np.arctan2(np.linalg.norm(direction - star, axis=1), np.linalg.norm(direction + star, axis=1))
    for side, expected in ((BORDER_RAD, True), (-BORDER_RAD, False)):
        start, found = index.query_many(direction, angle + side)
        hits = [bool((found[start[k] : start[k + 1]] == rows[k]).any()) for k in range(1000)]
        assert hits == [expected] * 1000


def test_query_many_is_query_one_by_one(device):
    index = hard_index(device)
    direction, radius = random_cones(60, np.random.default_rng(SEED + 2))
    start, rows = index.query_many(direction, radius)
    assert start[0] == 0 and start[-1] == len(rows) and rows.dtype == np.int64
    for k in range(60):
        alone = index.query(direction[k], radius[k])
        assert alone.dtype == np.int64
        np.testing.assert_array_equal(alone, rows[start[k] : start[k + 1]])
        np.testing.assert_array_equal(index.query(1e-3 * direction[k], radius[k]), alone)  # any length will do


@functools.cache
def dense_catalog():
    """Long runs, which are bisected: clusters across right ascension 0, at a pole, on borders, and on one meridian."""
    rng = np.random.default_rng(SEED + 3)
    centres = [(0.0, 0.0), (0.0, 59.9), (180.0, 60.1), (359.99, -75.0), (77.0, 89.8), (123.4, -89.9), (90.0, 30.0)]
    ra, dec = [], []
    for centre_ra, centre_dec in centres:
        axis = unit(centre_ra, centre_dec)
        star = axis + rng.normal(size=(3000, 3)) * np.radians(1.2)
        star /= np.linalg.norm(star, axis=1, keepdims=True)
        ra.append(np.degrees(np.arctan2(star[:, 1], star[:, 0])) % 360 % 360)
        dec.append(np.degrees(np.arcsin(star[:, 2])))
    ra += [np.zeros(400), np.full(400, 180.0), np.full(100, 359.9999999999)]
    dec += [rng.uniform(-90, 90, 400), rng.uniform(60, 90, 400), rng.uniform(-1, 1, 100)]
    return ws.StarCatalog.from_arrays(np.concatenate(ra), np.concatenate(dec), {"A": np.ones(21_900)})


def stored_directions(index):
    """Unit vectors of an index's stars by catalog row, as they were rounded."""
    stars = np.empty((len(index), 3))
    stars[index.star_row] = index.direction_icrs
    return stars / np.linalg.norm(stars, axis=1, keepdims=True)


def border_places(rng, n):
    """Stars within 1e-6 deg of borders of cells: bands at all latitudes, columns, both at once, and about the poles."""
    nearly = rng.normal(size=(6, n)) * 1e-6
    anywhere = rng.uniform(0, 360, n), np.degrees(np.arcsin(rng.uniform(-0.86, 0.86, n)))
    whole_ra, whole_dec = rng.integers(0, 360, n), rng.integers(-89, 90, n)
    near_pole = rng.choice([-1, 1], n) * (90 - 10.0 ** rng.uniform(-12, 0, n))
    ra = np.concatenate([anywhere[0], whole_ra + nearly[0], whole_ra + nearly[1], anywhere[0], anywhere[0]])
    last = rng.choice([-1, 1], n) * (rng.choice([89, 60], n) + nearly[4])
    dec = np.concatenate([whole_dec + nearly[2], anywhere[1], whole_dec + nearly[3], near_pole, last])
    return ra, dec


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("side", ["north", "east", "south", "west"])
def test_a_rim_that_just_touches_a_star_on_a_border_finds_it(device, dtype, side):
    """Cones to one side of a star; the rim passes it on the near or the far side by TOUCH_RAD."""
    rng = np.random.default_rng(SEED + 6)
    ra, dec = border_places(rng, 1500)
    n = len(ra)
    index = ws.BandIndex(ws.StarCatalog.from_arrays(ra, dec, {"A": np.ones(n)}), device=device, dtype=dtype)
    star = stored_directions(index)
    east = np.cross([0.0, 0.0, 1.0], star)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(star, east)
    aside = {"north": north, "east": east, "south": -north, "west": -east}[side]
    away = 10.0 ** rng.uniform(-6, -2, (n, 1))
    axis = np.cos(away) * star + np.sin(away) * aside
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = 2 * np.arctan2(np.linalg.norm(star - axis, axis=1), np.linalg.norm(star + axis, axis=1))
    row = np.arange(n)
    for radius, expected in ((angle + TOUCH_RAD, True), (angle - TOUCH_RAD, False)):
        start, found = index.query_many(axis, radius)
        cone = np.repeat(row, np.diff(start))
        hit = np.zeros(n, dtype=bool)
        hit[cone[found == cone]] = True
        wrong = np.flatnonzero(hit != expected)
        assert wrong.size == 0, f"{wrong.size} of {n}, the first at {ra[wrong[0]]!r}, {dec[wrong[0]]!r}"


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.ci
def test_dense_fields(device, dtype):
    """Cones centred on and beside stars of clusters; float32 directions are exact for themselves."""
    index = ws.BandIndex(dense_catalog(), device=device, dtype=dtype)
    assert index.direction_array.dtype is (wp.vec3d if dtype is np.float64 else wp.vec3f)
    rng = np.random.default_rng(SEED + 4)
    stars = stored_directions(index)
    direction = dense_catalog().direction_icrs[rng.integers(0, len(index), 1500)]
    direction += rng.normal(size=direction.shape) * 10.0 ** rng.uniform(-9, -1.5, (1500, 1))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = 10.0 ** rng.uniform(-5, -0.5, 1500)
    cone, star = brute_force(stars, direction, radius)
    start, rows = index.query_many(direction, radius)
    np.testing.assert_array_equal(np.diff(start), np.bincount(cone, minlength=1500))
    np.testing.assert_array_equal(rows, star)
    assert start[-1] > 100_000


def test_index_reads_few_stars_besides_those_it_finds(device):
    """The point of bands and bisection: candidates per view stay near the area searched, at any latitude."""
    rng = np.random.default_rng(SEED + 5)
    star = rng.normal(size=(200_000, 3))
    star /= np.linalg.norm(star, axis=1, keepdims=True)
    ra, dec = np.degrees(np.arctan2(star[:, 1], star[:, 0])) % 360, np.degrees(np.arcsin(star[:, 2]))
    index = ws.BandIndex(ws.StarCatalog.from_arrays(ra, dec, {"A": np.ones(len(ra))}), device=device)
    per_deg2 = len(ra) / 41_253
    for latitude in (0.0, 45.0, 59.9, 60.1, 75.0, 85.0, 88.9):
        direction = unit(rng.uniform(0, 360, 50), np.full(50, latitude))
        n_read = candidates(index, direction, np.radians(0.72))
        # Three bands of one degree, each as wide as the cone or as a whole cell more.
        assert n_read.mean() < 16 * per_deg2


def candidates(index, direction, radius_rad):
    """Stars that a query reads, (n,): the kernel's own runs, summed."""
    n_read = wp.zeros(len(direction), dtype=wp.int32, device=index.device)
    inputs = [index.cell_start_array, index.direction_array, wp.array(direction, dtype=wp.vec3d, device=index.device)]
    wp.launch(count_kernel, len(direction), inputs=[*inputs, float(radius_rad)], outputs=[n_read], device=index.device)
    return n_read.numpy()


@wp.kernel(enable_backward=False)
def count_kernel(
    cell_start: wp.array[wp.int32],
    star_direction: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    radius_rad: wp.float64,
    n_read: wp.array[wp.int32],
):
    cone = wp.tid()
    cover = cone_cover(direction[cone], radius_rad)
    for band in range(cover.first_band, cover.last_band + 1):
        for part in range(2):
            run = run_of_stars(cell_start, star_direction, band, cover, part)
            n_read[cone] = n_read[cone] + run[1] - run[0]


def test_no_cones(device):
    start, rows = hard_index(device).query_many(np.empty((0, 3)), [])
    np.testing.assert_array_equal(start, [0])
    assert len(rows) == 0


@pytest.mark.parametrize("n_star", [0, 1])
def test_smallest_catalogs(device, n_star):
    catalog = ws.StarCatalog.from_arrays([10.0] * n_star, [-60.0] * n_star, {"A": [1.0] * n_star})
    index = ws.BandIndex(catalog, device=device)
    assert len(index) == n_star
    for radius, expected in ((np.pi, n_star), (0.1, n_star), (0.0, n_star)):
        assert len(index.query(unit(10.0, -60.0), radius)) == expected
    assert len(index.query(unit(10.0, 60.0), 1.0)) == 0


@pytest.mark.parametrize(("ra_deg", "dec_deg"), [(0.0, 90.0), (0.0, -90.0), (360.0, 0.0), (-180.0, 59.999)])
def test_a_star_on_a_cell_corner_is_found_from_all_around(device, ra_deg, dec_deg):
    index = ws.BandIndex(ws.StarCatalog.from_arrays([ra_deg], [dec_deg], {"A": [1.0]}), device=device)
    star = index.catalog.direction_icrs[0]
    aside = np.random.default_rng(SEED).normal(size=(200, 3))
    aside -= (aside @ star)[:, None] * star
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    for angle in (1e-8, 1e-4, 0.02, 1.0):
        around = np.cos(angle) * star + np.sin(angle) * aside
        start, _ = index.query_many(around, np.full(200, angle + BORDER_RAD))
        assert (np.diff(start) == 1).all()
        start, _ = index.query_many(around, np.full(200, angle - BORDER_RAD))
        assert (np.diff(start) == 0).all()


BAD = {
    "zero-direction": ([0.0, 0.0, 0.0], 0.1, "^direction_icrs: must be finite and not zero$"),
    "nan-direction": ([np.nan, 0.0, 1.0], 0.1, "^direction_icrs: must be finite and not zero$"),
    "infinite-direction": ([np.inf, 0.0, 1.0], 0.1, "^direction_icrs: must be finite"),
    "two-numbers": ([1.0, 0.0], 0.1, r"^direction_icrs: must have shape \(3,\) or \(n, 3\)"),
    "negative-radius": ([1.0, 0.0, 0.0], -1e-9, r"^radius_rad: must be in \[0, pi\], got -1e-09$"),
    "radius-above-pi": ([1.0, 0.0, 0.0], 3.15, r"^radius_rad: must be in \[0, pi\], got 3.15$"),
    "nan-radius": ([1.0, 0.0, 0.0], np.nan, r"^radius_rad: must be in \[0, pi\], got nan$"),
    "two-radii": ([[1.0, 0.0, 0.0]], [0.1, 0.2], r"^radius_rad: must have shape \(1,\), got \(2,\)$"),
}


@pytest.mark.parametrize(("direction", "radius_rad", "message"), BAD.values(), ids=BAD)
def test_bad_input_is_named_in_one_line(direction, radius_rad, message):
    index = ws.BandIndex(ws.StarCatalog.from_arrays([1.0], [2.0], {"A": [1.0]}))
    with pytest.raises(ws.InputError, match=message) as caught:
        index.query(direction, radius_rad)
    assert "\n" not in str(caught.value)


def test_directions_are_double_or_single():
    with pytest.raises(ws.InputError, match=r"^dtype: must be float64 or float32, got int64$"):
        ws.BandIndex(ws.StarCatalog.from_arrays([1.0], [2.0], {"A": [1.0]}), dtype=np.int64)
