"""The Earth's limb: the shipped table against the program that made it, quadratures and physical bounds."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import warpsim as ws
from warpsim.background.earth_limb import limb_profile, limb_table
from warpsim.radiometry.bands import BANDS, band_radiance_w_m2_sr, planck_w_m2_sr_um

CATALOGS = Path(__file__).parents[1] / "catalogs"
WARMEST_K, COLDEST_K = 288.2, 180.0  # of the US Standard Atmosphere below 100 km


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("build_earth_limb", CATALOGS / "build_earth_limb.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_profiles_are_integrals_of_the_table():
    table, band = limb_table(), ws.Band.top_hat("hat", 9.0, 10.0)
    fine_um = np.linspace(9.0, 10.0, 20_001)
    expected = [np.trapezoid(np.interp(fine_um, table.emission_um, row), fine_um) for row in table.emission_w_m2_sr_um]
    assert limb_profile(band).emission_w_cm2_sr[:-1] * 1e4 == pytest.approx(expected[:-1], rel=2e-4)
    assert np.array_equal(table.height_km, np.arange(0.0, 121.0, 2.0))


def test_no_path_is_brighter_than_its_warmest_air():
    table = limb_table()
    low = table.height_km <= 90
    warmest = planck_w_m2_sr_um(table.emission_um, WARMEST_K)
    assert (table.emission_w_m2_sr_um[low] <= 1.01 * warmest).all()


def test_opaque_bands_have_the_temperature_of_the_stratosphere():
    table = limb_table()
    at_15_um = table.emission_w_m2_sr_um[:, np.argmin(np.abs(table.emission_um - 15.0))]
    kelvin = 14387.76877 / 15.0 / np.log1p(1.191042972e8 / 15.0**5 / at_15_um)
    assert ((kelvin > 225) & (kelvin < 245))[table.height_km <= 34].all()


@pytest.mark.parametrize("band", BANDS)
def test_the_limb_falls_with_height(band):
    profile = limb_profile(BANDS[band])
    middle = (profile.height_km >= 50) & (profile.height_km <= 90)
    assert (np.diff(profile.emission_w_cm2_sr[middle]) < 0).all()
    ground = float(band_radiance_w_m2_sr(WARMEST_K, band)) * 1e-4
    assert profile.emission_w_cm2_sr.max() < ground
    assert profile.emission_w_cm2_sr[-1] == profile.reflected_w_cm2_sr[-1] == 0.0


def test_sunlit_limb_is_blue_and_thin_where_it_is_high():
    blue, red = (limb_profile(ws.Band.top_hat("hat", *ends)) for ends in ((0.42, 0.48), (0.62, 0.68)))
    at_40_km = 20
    sun = [1361 * part for part in (0.087, 0.072)]  # of sunlight, roughly
    ratio = blue.reflected_w_cm2_sr[at_40_km] / sun[0] / (red.reflected_w_cm2_sr[at_40_km] / sun[1])
    assert 3.0 < ratio < 6.5  # (650 / 450)**4 = 4.4
    # Optically thin: a column of air of 40 km tangent height, scattered evenly, by the scale height.
    column = 0.225 * (2.87 / 1013.25) * np.sqrt(2 * np.pi * 6411 / 7.4)  # Rayleigh depth at 450 nm
    reflectance = blue.reflected_w_cm2_sr[at_40_km] * np.pi * 1e4 / sun[0]
    assert reflectance == pytest.approx(column / 4, rel=0.25)


def test_paths_have_the_length_and_the_air_of_spherical_shells(build):
    for tangent_km in (0.0, 35.0, 100.0):
        height_km, length_km = build.limb_path(tangent_km)
        whole_km = 2 * np.sqrt((build.EARTH_KM + 120) ** 2 - (build.EARTH_KM + tangent_km) ** 2)
        assert length_km.sum() == pytest.approx(whole_km)
        assert height_km.min() == pytest.approx(tangent_km, abs=0.02)
        air = np.exp(-(height_km - tangent_km) / 7.0)
        exact_km = np.sqrt(2 * np.pi * 7.0 * (build.EARTH_KM + tangent_km))  # first order in scale height / radius
        if tangent_km < 60:
            assert (air * length_km).sum() == pytest.approx(exact_km, rel=3e-3)


def test_an_isothermal_opaque_path_is_a_blackbody(build):
    class Isothermal:
        height_km = np.arange(0.0, 121.0, 5.0)
        temperature_k = np.full(25, 250.0)

        def __init__(self):
            self.amounts = {36: np.full(25, 1e3)}

        at = build.Air.at

    everywhere = np.full(len(build.WAVENUMBER_CM), 0)
    tables = {"CO2": (np.zeros(len(everywhere)), np.full(len(everywhere), 0.6), everywhere)}
    radiance = build.emission_w_m2_sr_um(20.0, Isothermal(), tables)
    assert radiance == pytest.approx(planck_w_m2_sr_um(1e4 / build.WAVENUMBER_CM, 250.0), rel=1e-6)


def test_numbers_are_read_from_data_statements(build):
    text = """      DATA ABC/1.0,2*.5,
     1 -3.0E+00/
      DENSTY(36,I)=CONCO2*PSS**0.6705*TSS**(-2.2560)
C     DATA DEF/9.0/
"""
    numbers, powers = build.data_statements(text)
    assert numbers["ABC"].tolist() == [1.0, 0.5, 0.5, -3.0]
    assert powers == {36: (0.6705, -2.256)} and set(numbers) == {"ABC"}
