"""Fluxes of a catalog: as given, predicted where asked for, and light and magnitudes in any band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.output.star_catalogs import catalog_report
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import SHIPPED
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.photometric_bands import photometric_bands, photometric_name
from warpsim.sky.star_counts import irradiance_counts, magnitude_counts
from warpsim.sky.star_photometry import COLOURS
from warpsim.sky.stellar_templates import (
    DWARF,
    GIANT,
    UNKNOWN_TEMPERATURE_K,
    colour,
    colour_temperature_k,
    templates,
)
from warpsim.sky.visible_stars import hipparcos_v_mag

BANDS = photometric_bands()
MSX = ("B1", "B2", "A", "C", "D", "E")
MWIR = Band.top_hat("mwir", 3.5, 5.0)


def flux(name, magnitude):
    return BANDS[name].zero_mag_jy * 10 ** (-0.4 * np.asarray(magnitude))


def catalog(**columns):
    fluxes = {
        "V": flux("V", [5.0, 9.0, np.nan, np.nan]),
        "Ks": flux("Ks", [2.0, np.nan, 6.0, np.nan]),
        "W3": flux("W3", [1.9, 4.0, np.nan, np.nan]),
    }
    return StarCatalog.from_arrays([1.0, 2.0, 3.0, 4.0], [0.0] * 4, fluxes, **columns)


# --- given and predicted ---


def test_given_fluxes_stay_what_they_are():
    stars = catalog()
    assert stars.bands == ("V", "Ks", "W3")
    for full in (stars, stars.filled(), stars.filled().at_epoch(2020.0), stars.at_epoch(2020.0)):
        for name in stars.bands:
            known = np.isfinite(stars.flux_jy(name))
            np.testing.assert_array_equal(full.flux_jy(name)[known], stars.flux_jy(name)[known])
            assert (full.flux_flag(name)[known] == 1).all()
            # Exactly the band's conversion, in every bit.
            light = full.irradiance_w_cm2(name)[known]
            np.testing.assert_array_equal(light, stars.flux_jy(name)[known] * BANDS[name].w_cm2_per_jy)


def test_filling_predicts_every_photometric_band():
    stars = catalog().filled()
    for name in BANDS:
        np.testing.assert_array_equal(np.isfinite(stars.flux_jy(name)), [True, True, True, False], err_msg=name)
        given = np.isfinite(catalog().flux_jy(name))
        assert stars.flux_flag(name).tolist() == np.where(given, 1, [3, 3, 3, 0]).tolist()
        assert (catalog().flux_flag(name) == given).all()
    # A star as bright in V-K as a K giant has nearly one magnitude from K to 12 um.
    assert stars.magnitude("A")[0] == pytest.approx(1.95, abs=0.1)


def test_light_follows_from_given_fluxes_alone():
    """Filling, limits and what was asked for before change no light in a band without limits."""
    stars = catalog()
    expected = stars.irradiance_w_cm2(MWIR)
    full = stars.filled({"A": np.full(4, 1e-6), "W3": np.full(4, 1e-6)})
    for name in MSX:
        full.flux_jy(name)
    np.testing.assert_array_equal(full.irradiance_w_cm2(MWIR), expected)
    for name in ("B1", "C", "J"):
        np.testing.assert_array_equal(full.irradiance_w_cm2(name), stars.irradiance_w_cm2(name))
    assert full.flux_jy("A")[:3].tolist() == [1e-6] * 3
    assert full.irradiance_w_cm2("A")[0] == 1e-6 * BANDS["A"].w_cm2_per_jy
    assert full.irradiance_w_cm2("A", "paper")[0] == pytest.approx(1e-6 / 58.49 * 510.651e-18, rel=2e-3)
    assert np.isnan(full.flux_jy("A")[3])  # a limit is no flux
    assert full.flux_jy("W3")[2] == 1e-6
    assert full.flux_jy("W3")[0] == stars.flux_jy("W3")[0]


def test_light_of_an_msx_band_without_a_flux_is_predicted():
    stars = catalog()
    for physics in ("physical", "paper"):
        light = stars.irradiance_w_cm2("A", physics)
        np.testing.assert_array_equal(light, stars.filled().irradiance_w_cm2("A", physics))
        assert (light[:3] > 0).all()
        assert light[3] == 0.0
    assert np.isnan(stars.flux_jy("A")).all()
    assert np.isnan(stars.magnitude("A")).all()
    with pytest.raises(InputError, match=r"band: must be one of A, B1, .*, got 'mwir'"):
        stars.irradiance_w_cm2(MWIR, "paper")


def test_a_band_that_only_bears_a_photometric_name_is_another():
    stars = catalog()
    false_a = Band("A", MWIR.wavelength_um, MWIR.response)
    np.testing.assert_array_equal(stars.irradiance_w_cm2(false_a), stars.irradiance_w_cm2(MWIR))


@pytest.mark.parametrize("name", SHIPPED)
def test_another_name_for_a_band_changes_nothing(name):
    band, alias = SHIPPED[name], replace(SHIPPED[name], name="alias")
    for stars in (catalog(), catalog().filled()):
        photometry = (stars.magnitude, stars.flux_jy, stars.flux_flag) if name in BANDS else ()
        for of_stars in (stars.irradiance_w_cm2, *photometry):
            np.testing.assert_array_equal(of_stars(alias), of_stars(band))


def test_a_band_with_a_zero_point_of_its_own_is_another():
    own = replace(BANDS["IRAS25"], zero_mag_jy=7.0, zero_mag_w_cm2=np.nan)
    assert photometric_name(own) is None


def test_arrays_are_read_only():
    stars = catalog().filled()
    for values in (stars.flux_jy("A"), stars.flux_flag("A"), stars.flux_jy("V"), stars.luminosity, stars.temperature_k):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1


def test_memory_is_in_proportion_to_the_bands():
    n_star = 1000
    columns = StarCatalog.from_arrays(np.zeros(n_star), np.zeros(n_star), {"V": np.ones(n_star)})
    assert columns.flux_jy("W1").strides == (0,)
    assert columns.flux_flag("W1").strides == (0,)


# --- temperature and class ---


def star(temperature_k=None, luminosity=None, **magnitudes):
    fluxes = {name: [flux(name, value)] for name, value in magnitudes.items()}
    return StarCatalog.from_arrays(
        [0.0], [0.0], fluxes,
        temperature_k=None if temperature_k is None else [temperature_k],
        luminosity=None if luminosity is None else [luminosity],
    )  # fmt: skip


ALL = {"BP": 8.0, "RP": 7.0, "V": 7.6, "Ks": 4.2, "Ic": 6.4, "J": 5.0, "B": 9.0, "W3": 4.2, "A": 4.1}


@pytest.mark.parametrize(
    ("blue", "red", "without"),
    [
        ("BP", "RP", ()),
        ("V", "Ks", ("BP",)),
        ("V", "Ic", ("BP", "Ks")),
        ("J", "Ks", ("BP", "V")),
        ("B", "V", ("BP", "Ks", "Ic")),
        ("V", "W3", ("BP", "Ks", "Ic", "B")),
        ("V", "A", ("BP", "Ks", "Ic", "B", "W3")),
    ],
)
def test_the_surest_colour_tells_the_temperature(blue, red, without):
    """The template at that temperature has the star's colour, and the star has no fluxes bluer or redder than that."""
    assert (blue, red) in COLOURS
    known = {name: magnitude for name, magnitude in ALL.items() if name not in without}
    kelvin = star(**known).spectrum_temperature_k[0]
    found = colour(blue, red, np.array([GIANT]), np.array([kelvin]))[0]
    assert found == pytest.approx(known[blue] - known[red], abs=1e-9)


def test_colour_temperatures_beyond_the_templates():
    coolest, hottest = templates().temperature_k[[0, -1]]
    beyond = colour_temperature_k([50.0, -50.0, np.nan], ("V", "Ks"), [1, 0, 0])
    np.testing.assert_allclose(beyond, [coolest, hottest, np.nan], rtol=1e-12)
    # J-K of dwarfs turns back at 3,900 K: of two temperatures the hotter one is meant.
    dwarf = colour_temperature_k([0.8], ("J", "Ks"), [DWARF])[0]
    assert 3500.0 < dwarf < 5000.0


def test_the_temperature_given_goes_first():
    assert star(**ALL, temperature_k=3210.0).spectrum_temperature_k[0] == 3210.0
    assert np.isnan(star(**ALL).temperature_k[0])
    assert star(V=5.0).spectrum_temperature_k[0] == UNKNOWN_TEMPERATURE_K


def test_each_star_has_its_own_colour():
    nan = np.nan
    stars = StarCatalog.from_arrays(
        [0.0] * 3,
        [0.0] * 3,
        {"BP": flux("BP", [8.0, nan, nan]), "RP": flux("RP", [7.0, 7.0, nan]), "V": flux("V", [9.0, 9.0, 9.0]),
         "Ks": flux("Ks", [1.0, 6.0, nan])},
        temperature_k=[nan, nan, 5000.0],
    )  # fmt: skip
    found = stars.spectrum_temperature_k
    assert found[0] == pytest.approx(star(BP=8.0, RP=7.0).spectrum_temperature_k[0])
    assert found[1] == pytest.approx(star(V=9.0, Ks=6.0).spectrum_temperature_k[0])
    assert found[2] == 5000.0


def test_a_flux_of_0_has_no_colour():
    stars = StarCatalog.from_arrays([0.0], [0.0], {"BP": [0.0], "RP": [1.0]})
    assert stars.spectrum_temperature_k[0] == UNKNOWN_TEMPERATURE_K
    assert np.isfinite(stars.irradiance_w_cm2(MWIR)[0])


def test_parallax_and_motion_tell_dwarfs_from_giants():
    """Proxima Centauri and Arcturus, by Gaia's, Hipparcos's and 2MASS's magnitudes."""
    proxima = {"G": 8.985, "BP": 11.373, "RP": 7.569, "V": 11.01, "Ic": 7.38, "B": 12.82, "Ks": 4.38, "J": 5.36}
    arcturus = {"G": -0.3, "BP": 0.4, "RP": -0.9, "V": -0.05, "Ic": -1.28, "B": 1.19, "Ks": -2.91, "J": -2.25}
    for magnitudes, parallax_mas, pm_mas_yr, expected in (
        (proxima, 768.1, 3859.0, DWARF),
        (arcturus, 88.8, 2279.0, GIANT),
    ):
        fluxes = {name: [flux(name, value)] for name, value in magnitudes.items()}
        for names in (("G", "BP", "RP"), ("V", "Ic"), ("V", "B"), ("V", "Ks"), ("V", "J", "Ks"), tuple(fluxes)):
            given = {name: fluxes[name] for name in names}
            for motion in ({"parallax_mas": [parallax_mas]}, {"pm_dec_mas_yr": [pm_mas_yr]}):
                stars = StarCatalog.from_arrays([0.0], [0.0], given, **motion)
                if expected == DWARF or "parallax_mas" in motion:  # Arcturus is too fast for a giant
                    assert stars.spectrum_luminosity[0] == expected, (names, motion)
            assert StarCatalog.from_arrays([0.0], [0.0], given).spectrum_luminosity[0] == GIANT
            told = StarCatalog.from_arrays([0.0], [0.0], given, luminosity=[0], parallax_mas=[1e-3])
            assert told.spectrum_luminosity[0] == DWARF


def test_dwarfs_and_giants_differ():
    values = [star(V=8.0, temperature_k=3300.0, luminosity=c).irradiance_w_cm2(MWIR)[0] for c in (0, 1, -1)]
    assert values[0] != values[1] == values[2]


# --- tables ---


def test_tables_hold_every_band_given():
    stars = catalog(luminosity=[0, 1, -1, 1], temperature_k=[4000.0, np.nan, 3000.0, np.nan])
    table = stars.to_table()
    assert {f"flux_{name}_jy" for name in (*MSX, "V", "Ks", "W3")} <= set(table.colnames)
    assert "flux_J_jy" not in table.colnames
    again = StarCatalog.from_table(table)
    for name in (*MSX, *stars.bands):
        np.testing.assert_array_equal(again.flux_jy(name), stars.flux_jy(name))
        np.testing.assert_array_equal(again.flux_flag(name), stars.flux_flag(name))
    np.testing.assert_array_equal(again.luminosity, [0, 1, -1, 1])
    np.testing.assert_array_equal(again.temperature_k, stars.temperature_k)
    np.testing.assert_array_equal(again.irradiance_w_cm2(MWIR), stars.irradiance_w_cm2(MWIR))


def assert_same_light(again, stars):
    """Every shipped band, a custom one, what the fluxes are, and the stars as such."""
    for band in (*BANDS, MWIR):
        np.testing.assert_array_equal(again.irradiance_w_cm2(band), stars.irradiance_w_cm2(band), err_msg=str(band))
    for name in BANDS:
        np.testing.assert_array_equal(again.flux_jy(name), stars.flux_jy(name), err_msg=name)
        np.testing.assert_array_equal(again.flux_flag(name), stars.flux_flag(name), err_msg=name)
    assert again.checksum == stars.checksum


@pytest.mark.parametrize("suffix", ["ecsv", "fits", "csv"])
@pytest.mark.ci
def test_a_filled_catalog_is_the_same_when_read_again(suffix, tmp_path):
    """What was filled in from the spectrum is marked in the table, and never an anchor of the next spectrum."""
    from astropy.table import Table

    limits = {"A": np.array([1e-6, np.nan, 1.0, np.nan])}
    for number, stars in enumerate((catalog().filled(), catalog().filled(limits), catalog())):
        assert_same_light(StarCatalog.from_table(stars.to_table()), stars)
        file = tmp_path / f"{number}.{suffix}"
        stars.to_table().write(file)
        assert_same_light(StarCatalog.read(file), stars)
        table = Table.read(file, format="ascii.csv" if suffix == "csv" else None)
        assert_same_light(StarCatalog.from_table(table), stars)
    flagged = catalog().filled().to_table()
    assert flagged["flux_A_flag"].tolist() == [3, 3, 3, 0]
    assert flagged["flux_V_flag"].tolist() == [1, 1, 0, 0]
    limited = StarCatalog.read(tmp_path / f"1.{suffix}", fill=False)
    assert limited.filled().flux_jy("A")[0] == 1e-6
    bare = StarCatalog.read(tmp_path / f"0.{suffix}", fill=False)
    assert np.isnan(bare.flux_jy("A")).all()


def test_the_default_catalog_is_the_same_when_read_again(tmp_path):
    whole = StarCatalog.default("V", "A")
    stars = whole._rows(np.arange(0, len(whole), 50))
    stars.to_table().write(tmp_path / "stars.fits")
    again = StarCatalog.read(tmp_path / "stars.fits")
    assert again.bands == stars.bands
    assert_same_light(again, stars)


def test_predictions_of_a_catalog_are_given():
    """Flag 2: they are anchors, in a table as well."""
    stars = catalog(flux_flag={"W3": [2, 2, 0, 0]}).filled()
    assert stars.to_table()["flux_W3_flag"].tolist() == [2, 2, 0, 0]
    assert_same_light(StarCatalog.from_table(stars.to_table()), stars)


def test_what_was_filled_in_is_kept_where_nothing_else_is():
    """Of a table whose measured columns were taken away."""
    stars = catalog().filled()
    table = stars.to_table()
    table.keep_columns([name for name in table.colnames if not name.startswith(("flux_V", "flux_Ks", "flux_W3"))])
    again = StarCatalog.from_table(table)
    assert again.flux_flag("A").tolist() == [2, 2, 2, 0]
    np.testing.assert_array_equal(again.flux_jy("A"), stars.flux_jy("A"))


def test_tables_of_magnitudes(tmp_path):
    from astropy.table import Table

    table = Table({"ra_deg": [1.0], "dec_deg": [2.0], "mag_V": [5.0], "mag_W1": [3.0]})
    table["mag_W1"].unit = "mag"
    stars = StarCatalog.from_table(table)
    assert stars.flux_jy("V")[0] == pytest.approx(BANDS["V"].zero_mag_jy * 0.01, rel=1e-14)
    assert stars.magnitude("W1")[0] == pytest.approx(3.0, abs=1e-12)
    (tmp_path / "stars.csv").write_text("RA_DEG,dec_deg,MAG_v,flux_w1_jy,luminosity\n1,2,5,0.5,0\n1,2,,,\n")
    read = StarCatalog.read(tmp_path / "stars.csv")
    assert read.magnitude("V")[0] == pytest.approx(5.0, abs=1e-12)
    assert read.flux_jy("W1")[0] == 0.5
    assert read.luminosity.tolist() == [0, -1]
    assert read.flux_flag("A").tolist() == [3, 0]


@pytest.mark.parametrize(
    ("header", "rule"),
    [
        ("flux_Z_jy,flux_A_jy", "flux_Z_jy: must be of one of the bands B1, B2, A, C, D, E, "),
        ("flux_V_jy,mag_V", "columns: must be one of flux_V_jy and mag_V, got both"),
    ],
)
def test_files_of_unknown_and_repeated_bands_are_refused(tmp_path, header, rule):
    file = tmp_path / "stars.csv"
    file.write_text(f"ra_deg,dec_deg,{header}\n1,2,3,4\n")
    with pytest.raises(InputError) as error:
        StarCatalog.read(file)
    assert str(error.value).startswith(f"{file}: {rule}")
    assert "\n" not in str(error.value)


def test_a_column_may_be_mapped_to_another_band(tmp_path):
    (tmp_path / "stars.csv").write_text("ra_deg,dec_deg,flux_Z_jy\n1,2,3\n")
    assert StarCatalog.read(tmp_path / "stars.csv", columns={"flux_J_jy": "flux_Z_jy"}).flux_jy("J")[0] == 3.0


# --- colours of custom tables ---


@pytest.mark.parametrize(("name", "columns"), [("b_v_mag", None), ("B-V", None), ("BmV", {"B-V": "BmV"})])
def test_b_v_is_read_with_v(tmp_path, name, columns):
    file = tmp_path / "stars.csv"
    file.write_text(f"ra_deg,dec_deg,mag_V,{name}\n1,2,5,0.65\n1,2,6,\n1,2,7,99.9\n")
    with pytest.warns(UserWarning, match=r"2 of 3 stars have no colour"):
        stars = StarCatalog.read(file, columns=columns)
    np.testing.assert_allclose(stars.magnitude("B")[0], 5.65, rtol=1e-12)
    assert stars.flux_flag("B").tolist() == [1, 3, 3]
    assert stars.spectrum_temperature_k[0] == pytest.approx(star(V=5.0, B=5.65).spectrum_temperature_k[0])
    if name == "b_v_mag":
        from astropy.table import Table

        table = Table({"ra_deg": [1.0], "dec_deg": [2.0], "mag_V": [5.0], "b_v_mag": [0.65]})
        assert StarCatalog.from_table(table).flux_jy("B")[0] == stars.flux_jy("B")[0]


@pytest.mark.parametrize(
    ("columns", "rule"),
    [
        ({"B-V": "x"}, "columns: must name mag_V or flux_V_jy with b_v_mag: B is V + (B-V)"),
        ({"B-V": "x", "mag_B": "y"}, "columns: must be one of mag_B and b_v_mag, got both"),
        ({"V-Ks": "x"}, "columns: a colour but B-V is no column, give both magnitudes; must be of ra_deg, "),
    ],
)
def test_other_colours_are_refused(tmp_path, columns, rule):
    file = tmp_path / "stars.csv"
    file.write_text("ra_deg,dec_deg,flux_A_jy,x,y\n1,2,3,4,5\n")
    with pytest.raises(InputError) as error:
        StarCatalog.read(file, columns=columns)
    assert str(error.value).startswith(f"{file}: {rule}")


def test_stars_that_nothing_tells_the_temperature_of_are_counted(tmp_path, recwarn):
    file = tmp_path / "stars.csv"
    file.write_text(
        "ra_deg,dec_deg,mag_V,mag_B,temperature_k,spectral_type\n1,2,5,5.6,,\n1,2,5,,4000,\n1,2,5,,,K0III\n"
    )
    StarCatalog.read(file)
    assert not recwarn.list
    file.write_text(file.read_text() + "1,2,5,,,\n1,2,,,,\n")
    StarCatalog.read(file)
    text = "1 of 5 stars have no colour, type or temperature: their spectra are a K giant's of 4850 K"
    assert [str(one.message) for one in recwarn] == [f"{file}: {text}"]


def test_a_colour_mapped_to_a_magnitude_is_noticed(tmp_path):
    file = tmp_path / "stars.csv"
    file.write_text("ra_deg,dec_deg,mag_V,B-V\n1,2,10,0.6\n1,2,4,1.4\n")
    rule = r"2 of 2 stars have colours more than 0.5 mag beyond those of known spectra \(B-V -9.40\)$"
    with pytest.warns(UserWarning, match=rule):
        StarCatalog.read(file, columns={"mag_B": "B-V"})


# --- magnitudes and counts ---


def test_magnitudes_in_a_band_with_a_zero_point():
    own = Band("own", MWIR.wavelength_um, MWIR.response, zero_mag_w_cm2=1e-15)
    stars = catalog()
    with np.errstate(divide="ignore"):
        expected = -2.5 * np.log10(stars.irradiance_w_cm2(MWIR)[:3] / 1e-15)
    np.testing.assert_allclose(stars.magnitude(own)[:3], expected, rtol=1e-12)
    assert np.isnan(stars.magnitude(own)[3])
    with pytest.raises(InputError) as error:
        stars.magnitude(MWIR)
    assert (
        str(error.value)
        == "band mwir: zero_mag_jy: must be known for magnitudes: give the band zero_mag_jy, 3631 for AB"
    )


def test_counts_by_magnitude_and_by_irradiance():
    stars = catalog().filled()
    steps, n_star = magnitude_counts(stars, "V")
    assert steps[0] == 5
    assert n_star.sum() == 3
    light = stars.irradiance_w_cm2(MWIR)[:3]
    decades, n_star = irradiance_counts(stars, MWIR)
    assert n_star.sum() == 3
    for decade, n in zip(decades, n_star, strict=True):
        assert n == np.sum((light >= 10.0**decade) & (light < 10.0 ** (decade + 1)))
    exact = StarCatalog.from_arrays([1.0], [2.0], {"A": [1e-16 / BANDS["A"].w_cm2_per_jy]})
    assert irradiance_counts(exact, "A")[0].tolist() == [-16]


def test_the_report_has_every_band_given():
    report = catalog_report(catalog().filled())
    lines = report.splitlines()
    for name in (*MSX, "V", "Ks", "W3"):
        assert sum(line.split()[:1] == [name] for line in lines) == 1, name
    (row,) = (line for line in lines if line.split()[:1] == ["Ks"])
    assert row.split()[2:5] == ["2", "1", "1"]  # measured, predicted, unknown


# --- visible magnitudes from broad bands ---


@pytest.mark.parametrize(
    ("hp_mag", "v_minus_i", "b_minus_v", "v_mag"),
    # I/239: HIP 1, 2, 3, 70890 (Proxima), 91262 (Vega), 27989 (Betelgeuse)
    [(9.2043, 0.55, 0.482, 9.10), (9.4017, np.nan, 0.999, 9.27), (6.6081, 0.04, -0.019, 6.61),
     (0.0868, 0.01, -0.001, 0.03), (0.6080, 2.32, 1.500, 0.45)],
)  # fmt: skip
def test_v_of_hp_and_a_colour(hp_mag, v_minus_i, b_minus_v, v_mag):
    found = hipparcos_v_mag(np.array([hp_mag]), np.array([v_minus_i]), np.array([b_minus_v]))[0]
    assert found == pytest.approx(v_mag, abs=0.05 if hp_mag > 1 else 0.12)  # the last two vary, or saturate


# --- the default catalog by band ---


def test_the_default_catalog_for_a_visible_band(monkeypatch):
    """The brightest in the band, with the names of the whole table; those at 8.3 um for infrared bands."""
    from warpsim.sky import catalog as catalog_module
    from warpsim.sky import default_catalog

    whole = StarCatalog.default()
    assert StarCatalog.default("A") is StarCatalog.default(MWIR) is whole
    monkeypatch.setattr(default_catalog, "N_STAR", 1000)
    catalog_module._default_in.cache_clear()
    band = Band.top_hat("visible", 0.45, 0.9)
    stars = StarCatalog.default(band)
    assert stars is StarCatalog.default(band)
    catalog_module._default_in.cache_clear()
    light = whole.irradiance_w_cm2(band)
    brightest = np.sort(np.argsort(-light)[:1000])
    assert len(stars) == 1000
    np.testing.assert_array_equal(stars.irradiance_w_cm2(band), light[brightest])
    np.testing.assert_array_equal(stars.ra_deg, whole.ra_deg[brightest])
    assert stars.id.tolist() == whole.id_of(brightest).tolist()
    assert stars.flux_flag("A").tolist() == whole.flux_flag("A")[brightest].tolist()
    moved = stars.at_epoch(2030.0)
    np.testing.assert_array_equal(moved.dec_deg, whole.at_epoch(2030.0).dec_deg[brightest])
    assert moved.id.tolist() == stars.id.tolist()
    assert stars.checksum != whole.checksum
    with pytest.raises(InputError, match=r"^band: must be one of .* got 'visible'$"):
        StarCatalog.default("visible")


@pytest.mark.parametrize(
    "names",
    [("V", "W1"), ("G", "Ks"), ("Hp", "J"), ("BP", "W2"), ("G", "RP"), ("BP", "G"), ("B", "Ks"), ("V", "IRAC4")],
)
@pytest.mark.parametrize("temperature_k", [9600.0, 5200.0])
def test_any_colour_from_the_visible_tells_a_temperature(names, temperature_k):
    star = StarCatalog.from_arrays([0.0], [0.0], {"V": [1.0]}, temperature_k=[temperature_k], luminosity=[0]).filled()
    fluxes = {name: star.flux_jy(name) for name in names}
    found = StarCatalog.from_arrays([0.0], [0.0], fluxes, luminosity=[0])
    assert found.spectrum_temperature_k[0] == pytest.approx(temperature_k, rel=0.02)
    assert found.filled().flux_jy("H")[0] == pytest.approx(star.flux_jy("H")[0], rel=0.02)


@pytest.mark.parametrize("name", ["A", "W3", "IRAS12", "IRAS25", "S9W", "G"])
def test_a_shipped_band_under_another_name_gives_nearly_the_same_light(name):
    band = photometric_bands()[name]
    clone = Band("clone", band.wavelength_um, band.response, per_photon=band.per_photon)
    stars = StarCatalog.default()
    ratio = stars.irradiance_w_cm2(clone) / stars.irradiance_w_cm2(name)
    np.testing.assert_allclose(ratio, 1.0, rtol=2e-3)  # zero points of MSX are printed to four digits


def test_the_default_catalog_does_not_depend_on_the_order_of_the_bands():
    assert StarCatalog.default("V", "G") is StarCatalog.default("G", "V") is StarCatalog.default("G", "V", "G")
    assert StarCatalog.default("V", "A") is StarCatalog.default("W1", "V")


@pytest.mark.parametrize(
    ("band", "other", "added"), [("V", "A", 0.025), ("A", "V", 0.012), ("G", "A", 0.046), ("A", "W1", 0.0)]
)
def test_stars_of_the_other_bands_add_little_light(band, other, added):
    """What docs/howto/bands.md states: all of them are fainter than the band's own limit."""
    alone, both = (
        StarCatalog.default(band).irradiance_w_cm2(band),
        StarCatalog.default(band, other).irradiance_w_cm2(band),
    )
    assert both.sum() / alone.sum() - 1.0 == pytest.approx(added, abs=1e-3)
    np.testing.assert_array_equal(np.sort(both)[::-1][: len(alone)], np.sort(alone)[::-1])


@pytest.mark.parametrize(
    ("edges_um", "rule"),
    [
        ((40.0, 50.0), "half_power_um: must lie within 0.3 to 30 um, where the spectra of stars are known, got 40 to"),
        ((0.2, 0.25), "half_power_um: must lie within 0.3 to 30 um, where the spectra of stars are known, got 0.2 to"),
    ],
)
def test_the_default_catalog_refuses_bands_without_spectra(edges_um, rule):
    with pytest.raises(InputError) as error:
        StarCatalog.default("A", Band.top_hat("far", *edges_um))
    assert str(error.value).startswith(f"band far: {rule}")


def test_names_of_any_rows():
    stars = StarCatalog.default()
    first, last = stars.id[0], stars.id[-1]
    assert stars.id_of(0) == first
    assert stars.id_of(0).shape == ()
    assert stars.id_of(-1) == last
    assert stars.id_of([0, -1]).tolist() == [first, last]
    assert stars.id_of(np.array([[0], [-1]])).tolist() == [[first], [last]]
    assert stars.id_of([]).tolist() == []
    named = catalog(id=["a", "bb", "ccc", "d"])
    assert (named.id_of(1), named.id_of((2, 3)).tolist()) == ("bb", ["ccc", "d"])


def test_an_empty_catalog_stays_as_it_was_made():
    stars = StarCatalog.from_arrays([], [], {"A": []})
    moved = stars.at_epoch(2030.0)
    assert moved.at_epoch(2000.0) is stars
    assert moved.checksum == stars.checksum
    assert StarCatalog.from_table(stars.to_table()).checksum == stars.checksum
