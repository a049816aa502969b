"""Star catalogs: space motion against ERFA, tables and files."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.photometric_bands import photometric_bands

BAND_LIST = ", ".join(photometric_bands())

SEPARATION_ATOL_ARCSEC = 1e-6
PARALLAX_RTOL = 1e-8  # ERFA's light time; parallaxes of the fast stars change by 1e-6 to 1e-5
ROUND_TRIP_RTOL = 1e-14  # unit conversions by 1.0 and decimal text of 17 digits


@pytest.fixture(scope="module")
def default():
    return StarCatalog.default()


def small_catalog(**changes):
    columns = {
        "ra_deg": [10.0, 359.999999, 120.0],
        "dec_deg": [-45.0, 0.0, 89.9],
        "flux_jy": {"A": [1.0, np.nan, 3.0], "E": [0.5, 0.0, 2.0]},
        "pm_ra_mas_yr": [0.0, -100.0, 7000.0],
        "pm_dec_mas_yr": [0.0, 250.0, -7000.0],
        "parallax_mas": [np.nan, 5.0, 500.0],
        "quality": [2, 0, 4],
        "id": ["a", "bb", "ccc"],
        "name": "small",
        "provenance": "made up",
    } | changes
    return StarCatalog.from_arrays(columns.pop("ra_deg"), columns.pop("dec_deg"), columns.pop("flux_jy"), **columns)


def assert_same_stars(left, right, rtol=0.0):
    for key in ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "quality", "direction_icrs"):
        np.testing.assert_allclose(getattr(left, key), getattr(right, key), rtol=rtol, atol=rtol, err_msg=key)
    for band in BANDS:
        np.testing.assert_allclose(left.flux_jy(band), right.flux_jy(band), rtol=rtol, err_msg=band)
    np.testing.assert_array_equal(left.id, right.id)


def test_import_is_light():
    modules = "warpsim.sky.catalog, warpsim.sky.readers.read"
    code = f"import sys, {modules}; print([m for m in ('astropy', 'scipy', 'pyarrow') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


# --- photometry ---


def test_flux_irradiance_and_magnitude():
    catalog = small_catalog()
    np.testing.assert_array_equal(catalog.flux_jy("A"), [1.0, np.nan, 3.0])
    np.testing.assert_allclose(catalog.irradiance_w_cm2("A"), [1.401e-17, 0.0, 4.203e-17], rtol=1e-15)
    np.testing.assert_allclose(catalog.magnitude(BANDS["A"])[[0, 2]], -2.5 * np.log10([1 / 58.49, 3 / 58.49]))
    assert np.isnan(catalog.magnitude("A")[1])
    assert catalog.magnitude("E")[1] == np.inf
    assert np.isnan(catalog.flux_jy("C")).all()
    # The spectrum gives light in C: between that of A and E, by magnitude; none to the star that has none in E.
    light = catalog.irradiance_w_cm2("C") / BANDS["C"].zero_mag_w_cm2
    assert 1 / 58.49 < light[0] < 0.5 / 8.80
    assert light[1] == 0.0
    assert (StarCatalog.from_arrays([1.0], [2.0], {"A": [np.nan]}).irradiance_w_cm2("C") == 0.0).all()


def test_flux_needs_a_photometric_band():
    catalog = small_catalog()
    for band, name in (("F", "F"), (Band("own", [3.0, 4.0], [1.0, 1.0]), "own"), (Band("A", [3.0, 4.0], [1, 1]), "A")):
        for call in (catalog.flux_jy, catalog.flux_flag):
            with pytest.raises(InputError) as error:
                call(band)
            assert str(error.value) == f"band: must be one of {BAND_LIST}, in which catalogs have fluxes, got '{name}'"
    assert np.isnan(catalog.flux_jy("V")).all()
    assert catalog.flux_flag("V").tolist() == [0, 0, 0]


def test_catalog_is_immutable():
    catalog = small_catalog()
    with pytest.raises(AttributeError):
        catalog.name = "other"
    for values in (catalog.direction_icrs, catalog.ra_deg, catalog.flux_jy("A"), catalog.quality):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1


# --- space motion ---


def erfa_place(ra_deg, dec_deg, pm_ra_mas_yr, pm_dec_mas_yr, epoch_from, epoch_to):
    """Unit vectors, proper motions [mas/yr] and parallaxes, relative to those before, by ERFA's pmsafe.

    The parallax is set to 100 arcsec: velocities then stay below 1e-5 c and distances below a light day, so that the
    relativistic and light-time terms of ERFA (which this model leaves out) stay below 1e-7 arcsec.
    """
    erfa = pytest.importorskip("erfa")
    ra_rad, dec_rad = np.radians(ra_deg), np.radians(dec_deg)
    mas_rad = np.pi / 180 / 3.6e6
    with np.errstate(all="ignore"):
        ra, dec, pm_ra, pm_dec, parallax, _ = erfa.pmsafe(
            ra_rad,
            dec_rad,
            np.asarray(pm_ra_mas_yr) * mas_rad / np.cos(dec_rad),
            np.asarray(pm_dec_mas_yr) * mas_rad,
            100.0,
            0.0,
            2451545.0,
            (epoch_from - 2000.0) * 365.25,
            2451545.0,
            (epoch_to - 2000.0) * 365.25,
        )
    direction = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    return direction, pm_ra * np.cos(dec) / mas_rad, pm_dec / mas_rad, parallax / 100.0


def separation_arcsec(left, right):
    return np.degrees(np.linalg.norm(left - right, axis=-1)) * 3600.0


FAST_STARS = {
    "dec-89.9-east": (120.0, 89.9, 10_000.0, 0.0),
    "dec-89.9-over-the-pole": (120.0, 89.9, 0.0, 10_000.0),
    "dec-89.9-diagonal": (359.9, 89.9, -7071.0, 7071.0),
    "dec-minus-89.99": (10.0, -89.99, 7071.0, -7071.0),
    "equator-across-ra-0": (359.9999, 0.0, 10_000.0, 0.0),
    "barnard": (269.4521, 4.6934, -801.6, 10_362.4),
    "still": (33.0, -33.0, 0.0, 0.0),
}


@pytest.mark.parametrize("epoch_jyear", [1950.0, 2030.0, 2100.0])
@pytest.mark.parametrize("star", FAST_STARS.values(), ids=list(FAST_STARS))
def test_at_epoch_matches_erfa(star, epoch_jyear, record_accuracy):
    ra_deg, dec_deg, pm_ra, pm_dec = ([value] for value in star)
    catalog = StarCatalog.from_arrays(
        ra_deg, dec_deg, {"A": [1.0]}, pm_ra_mas_yr=pm_ra, pm_dec_mas_yr=pm_dec, parallax_mas=[547.0]
    )
    moved = catalog.at_epoch(epoch_jyear)
    expected, expected_pm_ra, expected_pm_dec, farther = erfa_place(ra_deg, dec_deg, pm_ra, pm_dec, 2000.0, epoch_jyear)
    np.testing.assert_allclose(moved.parallax_mas, 547.0 * farther, rtol=PARALLAX_RTOL, atol=0)
    apart_arcsec = separation_arcsec(moved.direction_icrs, expected).max()
    assert apart_arcsec < SEPARATION_ATOL_ARCSEC
    record_accuracy("Space motion of stars over 100 years", apart_arcsec, SEPARATION_ATOL_ARCSEC, "arcsec", "ERFA")
    # Where the direction is right to 1e-7 arcsec, 1 arcsec from a pole, its east turns by 1e-7 rad: 1e-3 mas/yr.
    np.testing.assert_allclose(moved.pm_ra_mas_yr, expected_pm_ra, rtol=0, atol=2e-3)
    np.testing.assert_allclose(moved.pm_dec_mas_yr, expected_pm_dec, rtol=0, atol=2e-3)


def test_at_epoch_matches_erfa_for_the_whole_default(default):
    moved = default.at_epoch(2030.5)
    expected, *_ = erfa_place(
        default.ra_deg, default.dec_deg, default.pm_ra_mas_yr, default.pm_dec_mas_yr, 2000.0, 2030.5
    )
    assert separation_arcsec(moved.direction_icrs, expected).max() < SEPARATION_ATOL_ARCSEC


def test_at_epoch_chains_without_error():
    catalog = small_catalog()
    there = catalog.at_epoch(2030.0)
    assert there.epoch_jyear == 2030.0
    assert_same_stars(there.at_epoch(2030.0), there)
    assert there.at_epoch(2000.0) is catalog
    assert_same_stars(there.at_epoch(1975.0), catalog.at_epoch(1975.0))
    np.testing.assert_array_equal(there.flux_jy("A"), catalog.flux_jy("A"))
    np.testing.assert_array_equal(there.id, catalog.id)


def test_at_epoch_keeps_the_velocity_in_space():
    # Motion of constant velocity: speed = proper motion x distance, seen under a growing angle to the line of sight.
    catalog = small_catalog()
    moved = catalog.at_epoch(2100.0)
    travelled_rad = np.arccos(np.clip(np.sum(catalog.direction_icrs * moved.direction_icrs, axis=1), -1, 1))
    rate = np.hypot(catalog.pm_ra_mas_yr, catalog.pm_dec_mas_yr)
    expected = rate * np.cos(travelled_rad) ** 2
    np.testing.assert_allclose(np.hypot(moved.pm_ra_mas_yr, moved.pm_dec_mas_yr), expected, rtol=1e-9)


def test_a_star_on_the_pole_moves_along_its_meridian():
    catalog = StarCatalog.from_arrays([90.0], [90.0], {"A": [1.0]}, pm_ra_mas_yr=[0.0], pm_dec_mas_yr=[1000.0])
    moved = catalog.at_epoch(2010.0)  # north at RA 90 points over the pole to RA 270
    assert moved.ra_deg[0] == pytest.approx(270.0, abs=1e-9)
    assert moved.dec_deg[0] == pytest.approx(90.0 - math.degrees(math.atan(math.radians(10.0 / 3600.0))), abs=1e-13)


def test_at_epoch_takes_an_astropy_time():
    time = pytest.importorskip("astropy.time").Time("2030-01-01", scale="tt")
    assert small_catalog().at_epoch(time).epoch_jyear == pytest.approx(time.jyear, abs=1e-9)


@pytest.mark.parametrize("jyear", [math.nan, math.inf, "soon", None])
def test_at_epoch_needs_a_finite_year(jyear):
    with pytest.raises(InputError, match="jyear: must be"):
        small_catalog().at_epoch(jyear)


def test_eq_5_takes_a_star_over_the_pole():
    """One degree north in a year from declination 89.5: 90.5 by the formula, which is 89.5 on the other side."""
    catalog = StarCatalog.from_arrays(
        [10.0, 200.0, 300.0],
        [89.5, -89.5, 80.0],
        {"A": [1.0] * 3},
        pm_dec_mas_yr=[3.6e6, -3.6e6, 3.6e6],
        pm_ra_mas_yr=[0.0, 0.0, 3.6e6 * math.cos(math.radians(80.0))],
    )
    moved = catalog.at_epoch(2001.0, "paper")
    np.testing.assert_allclose(moved.ra_deg, [190.0, 20.0, 301.0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(moved.dec_deg, [89.5, -89.5, 81.0], rtol=0, atol=1e-12)
    for year in (2000.4, 2000.51, 2001.2, 2003.0):
        assert np.abs(catalog.at_epoch(year, "paper").dec_deg).max() <= 90.0
    np.testing.assert_array_equal(moved.pm_dec_mas_yr, catalog.pm_dec_mas_yr)
    np.testing.assert_array_equal(moved.parallax_mas, catalog.parallax_mas)


@pytest.mark.parametrize("physics", ["paper", "physical"])
def test_filling_leaves_places_and_epoch(physics):
    catalog = small_catalog()
    moved = catalog.at_epoch(2030.0, physics)
    assert np.abs(moved.direction_icrs - catalog.direction_icrs).max() > 1e-4
    full = moved.filled()
    assert full.epoch_jyear == 2030.0
    for key in (
        "ra_deg",
        "dec_deg",
        "direction_icrs",
        "pm_ra_mas_yr",
        "pm_dec_mas_yr",
        "parallax_mas",
        "temperature_k",
        "quality",
        "id",
    ):
        np.testing.assert_array_equal(getattr(full, key), getattr(moved, key), err_msg=key)
    assert np.isfinite(full.flux_jy("C")).all() and np.isnan(moved.flux_jy("C")).all()
    # The stars it was made from are filled too: other epochs have the same fluxes, at the places they had.
    assert_same_stars(full.at_epoch(2000.0), catalog.filled())
    np.testing.assert_array_equal(full.at_epoch(1990.0, physics).ra_deg, catalog.at_epoch(1990.0, physics).ra_deg)


def test_filled_fluxes_keep_to_their_limits():
    limit_jy = [1e-3, np.nan, 1e15]
    full, free = small_catalog().filled({"C": limit_jy, "A": [1e-3] * 3}), small_catalog().filled()
    np.testing.assert_array_equal(full.flux_jy("C"), [1e-3, *free.flux_jy("C")[1:]])
    assert full.flux_flag("C").tolist() == [3, 3, 3]
    # What is measured is no limit's business; the flux filled in is.
    np.testing.assert_array_equal(full.flux_jy("A")[[0, 2]], [1.0, 3.0])
    assert full.flux_jy("A")[1] == min(free.flux_jy("A")[1], 1e-3)


@pytest.mark.parametrize(
    ("limit_jy", "text"),
    [
        ({"A": [-1.0, 1.0, 1.0]}, "limit_jy.A: must be in [0, 1e+15], got -1 in row 0"),
        ({"E": [1.0, np.inf, -2.0]}, "limit_jy.E: must be in [0, 1e+15], got inf in row 1 (2 such rows)"),
        ({"A": [1.0, 1.0]}, "limit_jy.A: must have shape (3,), got (2,)"),
        ({"A": [[1.0, 1.0, 1.0]]}, "limit_jy.A: must be a vector, got shape (1, 3)"),
        ({"A": 1.0}, "limit_jy.A: must be a vector, got shape ()"),
        ({"A": "little"}, "limit_jy.A: must be numbers, got str"),
        ({"Z": [1.0] * 3}, f"limit_jy: band must be one of {BAND_LIST}, got 'Z'"),
    ],
)
def test_bad_limits_are_errors_of_one_line(limit_jy, text):
    with pytest.raises(InputError) as error:
        small_catalog().filled(limit_jy)
    assert str(error.value) == text


# --- tables and files ---


@pytest.mark.ci
def test_table_round_trip_is_exact(default):
    catalog = small_catalog()
    again = StarCatalog.from_table(catalog.to_table())
    assert_same_stars(again, catalog)
    assert (again.name, again.provenance, again.epoch_jyear) == ("small", "made up", 2000.0)
    assert_same_stars(StarCatalog.from_table(default.to_table()), default)
    moved = catalog.at_epoch(2030.0)
    again = StarCatalog.from_table(moved.to_table())
    assert again.epoch_jyear == 2030.0
    assert_same_stars(again, moved, rtol=ROUND_TRIP_RTOL)


def test_table_has_the_public_columns():
    assert small_catalog().to_table().colnames == [
        "ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas",
        "flux_B1_jy", "flux_B2_jy", "flux_A_jy", "flux_C_jy", "flux_D_jy", "flux_E_jy", "quality", "id",
        "temperature_k", "luminosity",
        "flux_B1_flag", "flux_B2_flag", "flux_A_flag", "flux_C_flag", "flux_D_flag", "flux_E_flag",
    ]  # fmt: skip


@pytest.mark.filterwarnings("ignore:Keyword name")
@pytest.mark.parametrize("suffix", ["ecsv", "fits"])
def test_epoch_survives_in_files_that_keep_it(tmp_path, suffix):
    moved = small_catalog().at_epoch(2030.0)
    moved.to_table().write(tmp_path / f"stars.{suffix}")
    assert StarCatalog.read(str(tmp_path / f"stars.{suffix}")).epoch_jyear == 2030.0


def test_minimal_csv(tmp_path):
    file = tmp_path / "stars.csv"
    file.write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,1.5\n-10.0,-20.0,\n")
    catalog = StarCatalog.read(file)
    np.testing.assert_array_equal(catalog.ra_deg, [10.0, 350.0])
    np.testing.assert_array_equal(catalog.flux_jy("A"), [1.5, np.nan])
    np.testing.assert_array_equal(catalog.pm_dec_mas_yr, [0.0, 0.0])
    assert np.isnan(catalog.parallax_mas).all()
    assert catalog.id.tolist() == ["1", "2"]


def test_units_of_columns_are_honoured():
    table = small_catalog().to_table()
    units = {"ra_deg": "rad", "pm_ra_mas_yr": "arcsec / yr", "flux_A_jy": "mJy", "parallax_mas": "uas"}
    for key, unit in units.items():
        table[key] = table[key].quantity.to(unit)
    assert_same_stars(StarCatalog.from_table(table), small_catalog(), rtol=ROUND_TRIP_RTOL)


@pytest.mark.parametrize("rows", ["ra_deg,dec_deg,flux_A_jy\n", "ra_deg,dec_deg,flux_A_jy,id,quality\n"])
def test_empty_catalog_is_legal(tmp_path, rows):
    file = tmp_path / "empty.csv"
    file.write_text(rows)
    catalog = StarCatalog.read(file, format="ascii.csv").at_epoch(2030.0)
    assert len(catalog) == 0
    assert catalog.direction_icrs.shape == (0, 3)
    assert catalog.irradiance_w_cm2("A").shape == (0,)
    assert len(StarCatalog.from_table(catalog.to_table())) == 0


def test_rows_without_a_place_are_left_out_with_a_warning():
    with pytest.warns(UserWarning, match=r"small: left out 2 of 3 stars without a finite position \(rows 0, 2\)"):
        catalog = small_catalog(ra_deg=[np.nan, 5.0, 6.0], dec_deg=[1.0, 2.0, np.inf])
    assert catalog.id.tolist() == ["bb"]
    assert catalog.flux_jy("E").tolist() == [0.0]


def test_a_masked_place_is_no_place():
    ra_deg = np.ma.masked_array([10.0, 5.0, 6.0], mask=[False, True, False])
    with pytest.warns(UserWarning, match=r"small: left out 1 of 3 stars without a finite position \(rows 1\)"):
        catalog = small_catalog(ra_deg=ra_deg)
    assert catalog.id.tolist() == ["a", "ccc"]
    flux = np.ma.masked_array([1.0, 2.0, 3.0], mask=[False, False, True])
    np.testing.assert_array_equal(small_catalog(flux_jy={"A": flux}).flux_jy("A"), [1.0, 2.0, np.nan])


def test_a_flux_that_is_there_is_measured_unless_said_to_be_predicted():
    catalog = small_catalog(flux_flag={"A": [0, 1, 2], "E": [np.nan, 2, 1]})
    assert catalog.flux_flag("A").tolist() == [1, 0, 2]  # the second has no flux in A
    assert catalog.flux_flag("E").tolist() == [1, 2, 1]
    assert catalog.flux_flag("C").tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"dec_deg": [0.0, 90.1, -91.0]}, "dec_deg: must be in [-90, 90], got 90.1 in row 1 (2 such rows)"),
        ({"ra_deg": [0.0, 1.0, 361.0]}, "ra_deg: must be in [-180, 360], got 361 in row 2"),
        ({"flux_jy": {"A": [1.0, -1.0, 1.0]}}, "flux_A_jy: must be in [0, 1e+15], got -1 in row 1"),
        ({"flux_jy": {"A": [1.0, 1.0, np.inf]}}, "flux_A_jy: must be in [0, 1e+15], got inf in row 2"),
        ({"flux_jy": {"F": [1.0] * 3}}, f"flux_jy: band must be one of {BAND_LIST}, got 'F'"),
        ({"flux_jy": {"W1": [1.0, -1.0, 1.0]}}, "flux_W1_jy: must be in [0, 1e+15], got -1 in row 1"),
        ({"luminosity": [0, 2, 1]}, "luminosity: must be in [-1, 1], got 2 in row 1"),
        ({"luminosity": [0, 0.5, 1]}, "luminosity: must be whole numbers, got 0.5 in row 1"),
        ({"flux_jy": {"A": [1.0]}}, "flux_A_jy: must have shape (3,) like ra_deg, got (1,)"),
        ({"pm_ra_mas_yr": [0, 0, np.inf]}, "pm_ra_mas_yr: must be in [-1e+09, 1e+09], got inf in row 2"),
        ({"flux_flag": {"A": [1, 1, 1.5]}}, "flux_A_flag: must be whole numbers, got 1.5 in row 2"),
        ({"flux_flag": {"A": [1, 4, 1]}}, "flux_A_flag: must be in [0, 3], got 4 in row 1"),
        ({"flux_flag": {"Z": [1, 1, 1]}}, f"flux_flag: band must be one of {BAND_LIST}, got 'Z'"),
        ({"quality": [1.5, 0, 0]}, "quality: must be whole numbers, got 1.5 in row 0"),
        ({"ra_deg": "here"}, "ra_deg: must be numbers, got str"),
        ({"ra_deg": 1.0}, "ra_deg: must be a vector, got shape ()"),
        ({"epoch_jyear": math.nan}, "epoch_jyear: must be a finite number, got nan"),
    ],
)
def test_bad_columns_are_errors_of_one_line(changes, text):
    with pytest.raises(InputError) as error:
        small_catalog(**changes)
    assert str(error.value) == text


def test_missing_columns_are_named():
    table = small_catalog().to_table()
    table.remove_column("dec_deg")
    with pytest.raises(InputError, match="table: must have the column dec_deg, got ra_deg, pm_ra_mas_yr"):
        StarCatalog.from_table(table)
    table = small_catalog().to_table()[["ra_deg", "dec_deg", "id"]]
    with pytest.raises(
        InputError, match=r"must have the column flux_X_jy or mag_X with X one of B1, .* got ra_deg, dec"
    ):
        StarCatalog.from_table(table)


def test_tables_of_unknown_and_repeated_bands_are_named():
    table = small_catalog().to_table()
    table["flux_Z_jy"] = [1.0] * 3
    with pytest.raises(InputError) as error:
        StarCatalog.from_table(table)
    assert str(error.value) == f"flux_Z_jy: must be of one of the bands {BAND_LIST}"
    table = small_catalog().to_table()
    table["mag_A"] = [1.0] * 3
    with pytest.raises(InputError) as error:
        StarCatalog.from_table(table)
    assert str(error.value) == "columns: must be one of flux_A_jy and mag_A, got both"
