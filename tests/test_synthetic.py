"""Made-up stars: density, number counts, colours, nesting, repeatability."""

from __future__ import annotations

import hashlib
import itertools
import tracemalloc

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.synthetic import _CHUNK_STARS, GALACTIC_OF_ICRS

# n(b) = scale / (|sin b| + softening)^1.5 per square degree at a limit [Jy], and how many stars that makes.
SKIES = {"astrometric": (2.85, 0.40, 0.116, 173_000), "infrared": (2.0, 0.05, 0.1, 577_000)}
SKY_DEG2 = 41_252.961
ZERO_MAG_JY = 58.49

# Of 1000 stars of seed 7 from a row on: in the first chunk of random numbers, across its end, and two chunks later.
# Without the processor's vector units, one place in 4 million came out 0.1 mas off, and no flux.
PLACE_SHA256 = {
    ("astrometric", 0): "4e1319c916289dbd29eb3a930534acd8461f347fcadc52c0f728fc94b7e78d05",
    ("astrometric", 131_000): "fb0559c7212d429d84a704d4a2326269666e6f6689d275e9ecd935d01ec9b25c",
    ("astrometric", 300_000): "98df3f8af452ab9496a4bf17fd19c3b543c027e096f842e207f102f329841db8",
    ("infrared", 0): "130522917a7a0ca5007fd6e5b93d7e568f2247fbc2e4c040dc579a8cbde2281d",
    ("infrared", 131_000): "7f30548a82a2e4799529e8a3d74784b52c3f1b20fb0ae8238b36dee53ef8d033",
    ("infrared", 300_000): "7136af5513af57df0ebc15beab0706cd414a895f984870773fb9797d8d61095a",
}
FLUX_SHA256 = {
    ("astrometric", 0): "deb764f04e38a80bf3c1c671b4fabd061e1ca7cf8400b2f6774b480f2ee4a72b",
    ("astrometric", 131_000): "9003bb2f3f3f1d2347ba73a1c50b04b962390b42122e5ac33cf350db61423c76",
    ("astrometric", 300_000): "7850cf50880e1916860cfd7da0f4b6f942116823fac5e14c5b6b58a3d82bf8a0",
    ("infrared", 0): "79e538056c0b0c0fafafdb86d614f29cb5d8ed049227610f98b512aec87039c8",
    ("infrared", 131_000): "6e4e70729d87595a56ae04828a7ebddf9853ab544e896e53efe294e054862a4d",
    ("infrared", 300_000): "3e7edf6c0f8b0ab037deeabf624adf3171c708a967b6251bb22a34842c8f770a",
}

CHI2_SIGMA = 5.0  # a chi-square of k degrees of freedom has mean k and variance 2 k
FRAME_BIAS_ARCSEC = 0.03  # between ICRS and the FK5 axes that astropy's galactic system hangs on
FLUX_RTOL = 1e-7  # float32
MAX_HELD_BYTES, MAX_PEAK_BYTES = 100, 200  # per star


@pytest.fixture(scope="module", params=list(SKIES))
def sky(request):
    return request.param


@pytest.fixture(scope="module")
def catalog(sky):
    return StarCatalog.synthetic(200_000, sky=sky, seed=4)


def galactic_deg(catalog):
    """Longitude and latitude by astropy, whose axes differ by the frame bias only."""
    coordinates = pytest.importorskip("astropy.coordinates")
    place = coordinates.SkyCoord(catalog.ra_deg, catalog.dec_deg, unit="deg").galactic
    return place.l.deg, place.b.deg


def chi2_excess(found, expected):
    """Standard deviations by which chi-square lies above its mean, for counts in bins of a known total."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    assert found.sum() == pytest.approx(expected.sum(), rel=1e-9)
    freedom = len(found) - 1
    return (np.sum((found - expected) ** 2 / expected) - freedom) / np.sqrt(2 * freedom)


# --- how many ---


def test_closed_form_integrates_to_the_known_totals(sky):
    integrate = pytest.importorskip("scipy.integrate")
    scale, softening, limit_jy, total = SKIES[sky]

    def ring_density(b_rad):
        return scale / (abs(np.sin(b_rad)) + softening) ** 1.5 * np.cos(b_rad)

    hemisphere, _ = integrate.quad(ring_density, 0, np.pi / 2)
    expected = 4 * np.pi * np.degrees(1.0) ** 2 * hemisphere
    assert expected == pytest.approx(total, rel=1e-3)
    assert len(StarCatalog.synthetic(limit_jy=limit_jy, sky=sky)) == int(expected)


@pytest.mark.parametrize(("limit_jy", "dex"), [(0.116, 0.0), (0.0116, 0.33 * 2.5), (1.16, -0.33 * 2.5)])
def test_other_limits_scale_by_a_third_of_a_dex_per_magnitude(limit_jy, dex):
    expected = 173_060.8 * 10**dex
    assert len(StarCatalog.synthetic(limit_jy=limit_jy)) == pytest.approx(expected, abs=2)


def test_bright_counts_grow_by_half_a_dex_per_magnitude():
    at_break, brighter = (len(StarCatalog.synthetic(limit_jy=ZERO_MAG_JY * 10 ** (-0.4 * m))) for m in (2.0, 0.0))
    assert at_break == pytest.approx(173_060.8 * 10 ** (0.33 * (2.0 + 2.5 * np.log10(0.116 / ZERO_MAG_JY))), abs=2)
    assert brighter == pytest.approx(at_break / 10.0, abs=1)


def test_limit_and_number_say_the_same(sky):
    limit_jy = SKIES[sky][2]
    by_limit = StarCatalog.synthetic(limit_jy=limit_jy, sky=sky)
    by_number = StarCatalog.synthetic(len(by_limit), sky=sky)
    np.testing.assert_array_equal(by_limit.ra_deg, by_number.ra_deg)
    np.testing.assert_array_equal(by_limit.flux_jy("A"), by_number.flux_jy("A"))
    # The faintest is as faint as the limit says, to one part in n_star of the counts.
    assert by_limit.flux_jy("A")[-1] == pytest.approx(limit_jy, rel=1e-4)
    assert by_limit.flux_jy("A").min() >= limit_jy * (1 - FLUX_RTOL)


# --- where ---


def test_density_follows_latitude(catalog, sky):
    _, softening, _, _ = SKIES[sky]
    edges = np.sin(np.radians([0, 0.5, 1, 2, 4, 7, 11, 16, 22, 30, 40, 52, 66, 90]))
    power = -2.0 / np.sqrt(edges + softening)
    expected = len(catalog) * np.diff(power) / (power[-1] - power[0])
    _, b_deg = galactic_deg(catalog)
    for half in (b_deg >= 0, b_deg < 0):
        share = np.histogram(np.sin(np.radians(np.abs(b_deg[half]))), edges)[0]
        assert chi2_excess(share, expected * share.sum() / expected.sum()) < CHI2_SIGMA
    # North and south alike: a binomial count.
    assert abs((b_deg >= 0).sum() - len(catalog) / 2) < CHI2_SIGMA * np.sqrt(len(catalog)) / 2
    # A density one tenth off in its softening would not pass.
    wrong = -2.0 / np.sqrt(edges + 1.1 * softening)
    share = np.histogram(np.sin(np.radians(np.abs(b_deg))), edges)[0]
    assert chi2_excess(share, len(catalog) * np.diff(wrong) / (wrong[-1] - wrong[0])) > CHI2_SIGMA


def test_density_in_stars_per_square_degree(sky):
    """The absolute density at the limit quoted, at a few latitudes."""
    scale, softening, limit_jy, _ = SKIES[sky]
    catalog = StarCatalog.synthetic(limit_jy=limit_jy, sky=sky, seed=1)
    sin_b = np.abs(np.sin(np.radians(galactic_deg(catalog)[1])))
    for centre in (0.01, 0.07, 0.3, 0.7):
        half_width = 0.1 * centre
        count = np.sum(np.abs(sin_b - centre) < half_width)
        expected = scale / (centre + softening) ** 1.5 * SKY_DEG2 * 2 * half_width
        # 0.4 %: the density is not quite linear over the strip.
        assert abs(count - expected) < CHI2_SIGMA * np.sqrt(expected) + 0.004 * expected


def test_places_are_uniform_in_longitude_at_any_latitude(catalog):
    l_deg, b_deg = galactic_deg(catalog)
    for half in (np.abs(b_deg) < 10, np.abs(b_deg) >= 10, b_deg > 0):
        share = np.histogram(l_deg[half], 36, (0, 360))[0]
        assert chi2_excess(share, np.full(36, half.sum() / 36)) < CHI2_SIGMA


def test_places_do_not_depend_on_brightness(catalog):
    _, b_deg = galactic_deg(catalog)
    sin_b = np.abs(np.sin(np.radians(b_deg)))
    bright, faint = sin_b[: len(sin_b) // 10], sin_b[len(sin_b) // 10 :]
    error = np.hypot(bright.std() / np.sqrt(len(bright)), faint.std() / np.sqrt(len(faint)))
    assert abs(bright.mean() - faint.mean()) < CHI2_SIGMA * error


def test_galactic_axes_are_those_of_erfa_and_astropy():
    erfa = pytest.importorskip("erfa")
    coordinates = pytest.importorskip("astropy.coordinates")
    np.testing.assert_allclose(GALACTIC_OF_ICRS @ GALACTIC_OF_ICRS.T, np.eye(3), rtol=0, atol=1e-15)
    rng = np.random.default_rng(0)
    ra, dec = rng.uniform(0, 2 * np.pi, 1000), np.arcsin(rng.uniform(-1, 1, 1000))
    mine = GALACTIC_OF_ICRS @ np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    longitude, latitude = erfa.icrs2g(ra, dec)
    np.testing.assert_allclose(np.arctan2(mine[1], mine[0]) % (2 * np.pi), longitude, rtol=0, atol=np.radians(1e-9))
    np.testing.assert_allclose(np.arcsin(mine[2]), latitude, rtol=0, atol=np.radians(1e-9))
    other = coordinates.SkyCoord(ra, dec, unit="rad").galactic.cartesian.xyz.value
    assert np.degrees(np.linalg.norm(mine - other, axis=0)).max() * 3600 < FRAME_BIAS_ARCSEC


@pytest.mark.parametrize("chunk", [0, 1])
def test_places_lie_where_the_random_numbers_say(catalog, sky, chunk):
    """Star by star, from the same raw numbers, through ERFA."""
    erfa = pytest.importorskip("erfa")
    from warpsim.streams import uniforms

    u = uniforms(4, f"synthetic {sky} sky", chunk, 4000).reshape(1000, 4)
    rows = slice(chunk << 17, (chunk << 17) + 1000)
    softening = SKIES[sky][1]
    near, far = softening**-0.5, (1 + softening) ** -0.5
    sin_b = (near - np.abs(2 * u[:, 0] - (u[:, 0] >= 0.5)) * (near - far)) ** -2 - softening
    ra, dec = erfa.g2icrs(2 * np.pi * u[:, 1], np.arcsin(np.where(u[:, 0] < 0.5, -sin_b, sin_b)))
    np.testing.assert_allclose(catalog.dec_deg[rows], np.degrees(dec), rtol=0, atol=2e-8)  # 0.05 mas, by rounding
    np.testing.assert_allclose(catalog.ra_deg[rows], np.degrees(ra), rtol=0, atol=2e-8)


# --- how bright, which colour ---


def test_counts_follow_the_two_slopes(catalog, sky):
    _, _, limit_jy, total = SKIES[sky]
    magnitude = catalog.magnitude("A")
    assert (np.diff(magnitude) > -1e-6).all()  # brightest first
    limit_mag = -2.5 * np.log10(limit_jy / ZERO_MAG_JY)
    at_break = total * 10 ** (0.33 * (2.0 - limit_mag))
    assert magnitude.min() >= -6.0 - 1e-6
    for m in (-2.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        expected = at_break * 10 ** ((0.5 if m < 2 else 0.33) * (m - 2.0))
        # 1 for the star that stands on the border, 0.1 % for the total, which is quoted to three digits.
        assert abs(np.sum(magnitude < m) - expected) < 1 + 1e-3 * expected


def test_colours_are_those_of_the_default_catalog():
    default = StarCatalog.default()
    made_up = StarCatalog.synthetic(len(default), seed=3)
    edges_k = (0.0, 2800.0, 3500.0, 3850.0, 4500.0, 5250.0, np.inf)
    for low, high in ((-6, 2), (2, 4), (4, 5), (5, 6), (6, 6.7)):
        for coolest_k, hottest_k in itertools.pairwise(edges_k):
            true, found = (
                np.mean((t > coolest_k) & (t <= hottest_k))
                for t in (
                    c.temperature_k[(c.magnitude("A") >= low) & (c.magnitude("A") < high)] for c in (default, made_up)
                )
            )
            assert found == pytest.approx(true, abs=0.02), (low, coolest_k)  # 2.5 sigma of 4000 stars


def test_other_bands_follow_from_the_spectrum(catalog):
    """Stars of a temperature have one colour, that of a catalog of one star."""
    for temperature_k in (7000.0, 4150.0, 3100.0):
        rows = catalog.temperature_k == temperature_k
        assert rows.sum() > 1000
        one = StarCatalog.from_arrays(
            [0.0], [0.0], {"A": [1.0]}, temperature_k=[temperature_k], luminosity=[1]
        ).filled()
        for band in ("B1", "E", "V"):
            found = catalog.magnitude(band)[rows] - catalog.magnitude("A")[rows]
            np.testing.assert_allclose(found, one.magnitude(band)[0] - one.magnitude("A")[0], rtol=0, atol=1e-9)


# --- the same every time ---


def test_same_numbers_on_every_machine(sky):
    catalog = StarCatalog.synthetic(301_000, sky=sky, seed=7)
    for start in (0, 131_000, 300_000):
        rows = slice(start, start + 1000)
        place = np.rint(np.stack([catalog.ra_deg[rows], catalog.dec_deg[rows]]) * 3.6e7).astype("<i8")
        flux = catalog.flux_jy("A")[rows].astype("<f4")
        np.testing.assert_array_equal(flux, catalog.flux_jy("A")[rows])  # nothing beyond float32
        assert hashlib.sha256(place.tobytes()).hexdigest() == PLACE_SHA256[sky, start]
        assert hashlib.sha256(flux.tobytes()).hexdigest() == FLUX_SHA256[sky, start]


def test_a_larger_catalog_begins_with_the_same_stars():
    small = StarCatalog.synthetic(1000, seed=7)
    for n_star in (1001, _CHUNK_STARS + 5):
        large = StarCatalog.synthetic(n_star, seed=7)
        np.testing.assert_array_equal(large.ra_deg[:1000], small.ra_deg)
        np.testing.assert_array_equal(large.dec_deg[:1000], small.dec_deg)
        np.testing.assert_array_equal(large.flux_jy("E")[:1000], small.flux_jy("E"))
        assert large.id[:1000].tolist() == small.id.tolist()
    # Streams of different chunks have nothing in common.
    assert len(np.unique(large.ra_deg)) > len(large) - 20  # 0.1 mas is fine enough to tell 130,000 stars apart


def test_seeds_and_skies_differ():
    places = {
        (sky, seed): StarCatalog.synthetic(100, sky=sky, seed=seed).ra_deg
        for sky in SKIES
        for seed in (0, 1, 2**32, 2**63 - 1)
    }
    assert len({values.tobytes() for values in places.values()}) == 8
    assert not np.isin(places["infrared", 0], places["infrared", 1]).any()


# --- as a catalog ---


def test_synthetic_stars_are_a_catalog():
    catalog = StarCatalog.synthetic(500, sky="infrared", seed=2)
    assert catalog.id[[0, 123]].tolist() == ["SYN 0", "SYN 123"]
    assert not catalog.quality.any()
    assert not catalog.pm_ra_mas_yr.any()
    assert not catalog.pm_dec_mas_yr.any()
    assert np.isnan(catalog.parallax_mas).all()
    assert (catalog.flux_flag("D") == 3).all()
    assert "infrared sky, seed 2, the 500 brightest stars" in catalog.provenance
    moved = catalog.at_epoch(2030.0)
    np.testing.assert_array_equal(moved.direction_icrs, catalog.direction_icrs)
    again = StarCatalog.from_table(catalog.to_table())
    for key in ("ra_deg", "dec_deg", "temperature_k", "quality", "id"):
        np.testing.assert_array_equal(getattr(again, key), getattr(catalog, key))
    np.testing.assert_array_equal(catalog.filled().flux_jy("B1"), catalog.flux_jy("B1"))


def test_memory_is_bounded():
    n_star = 400_000
    StarCatalog.synthetic(10)
    tracemalloc.start()
    catalog = StarCatalog.synthetic(n_star)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(catalog) == n_star
    assert held / n_star < MAX_HELD_BYTES
    assert peak / n_star < MAX_PEAK_BYTES


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({}, "n_star, limit_jy: exactly one must be given, got None and None"),
        ({"n_star": 5, "limit_jy": 0.1}, "n_star, limit_jy: exactly one must be given, got 5 and 0.1"),
        ({"n_star": 0}, "n_star: must be a whole number from 1 to 100000000, got 0"),
        ({"n_star": 10**9}, "n_star: must be a whole number from 1 to 100000000, got 1000000000"),
        ({"n_star": 1e3}, "n_star: must be a whole number from 1 to 100000000, got 1000.0"),
        ({"n_star": True}, "n_star: must be a whole number from 1 to 100000000, got True"),
        ({"limit_jy": 0.0}, "limit_jy: must be finite and > 0, got 0.0"),
        ({"limit_jy": float("nan")}, "limit_jy: must be finite and > 0, got nan"),
        ({"limit_jy": "faint"}, "limit_jy: must be a number, got 'faint'"),
        ({"limit_jy": 1e-6}, "limit_jy: must leave 1 to 100000000 stars, got 1e-06, which leaves 2.61e+09"),
        ({"limit_jy": 1e6}, "limit_jy: must leave 1 to 100000000 stars, got 1e+06, which leaves 0.00238"),
        ({"n_star": 5, "sky": "dark"}, "sky: must be 'astrometric' or 'infrared', got 'dark'"),
        ({"n_star": 5, "sky": ["infrared"]}, "sky: must be 'astrometric' or 'infrared', got ['infrared']"),
        ({"n_star": 5, "seed": -1}, "seed: must be a whole number from 0 to 9223372036854775807, got -1"),
        ({"n_star": 5, "seed": 1.5}, "seed: must be a whole number from 0 to 9223372036854775807, got 1.5"),
    ],
)
def test_bad_arguments_are_errors_of_one_line(arguments, text):
    with pytest.raises(InputError) as error:
        StarCatalog.synthetic(**arguments)
    assert str(error.value) == text
