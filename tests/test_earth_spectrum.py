"""The Earth by wavelength: exitance, albedo and features as measured, exact means over bands, a scene's defaults."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import warpsim as ws
from warpsim.radiometry.sun_and_earth import (
    earth_albedo,
    earth_brightness_temperature_k,
    earth_spectrum,
    solar_spectrum,
)
from warpsim.scene.environment import EARTH_K

QUAD_RTOL = 1e-6
TEMPERATURE_RTOL = 1e-12
EXITANCE_ATOL_W_M2 = 3.0  # CERES EBAF 4: 240.1 W/m2; the budget's own uncertainty is 2.5
ALBEDO_ATOL = 0.01  # CERES: 99.1 / 340.0

MWIR, LWIR = ws.Band.top_hat("mwir", 3.5, 5.0), ws.Band.top_hat("lwir", 8.0, 9.5)
VISIBLE = ws.Band("visible", [0.4, 0.6, 0.9], [0.3, 1.0, 0.2], per_photon=True)


def planck(um, kelvin):
    """Written out with constants of its own [W/m2/sr/um]."""
    return 1.191042972e8 / um**5 / np.expm1(14387.76877 / (um * kelvin))


def integral(function, edges):
    return sum(quad(function, a, b, epsabs=0, epsrel=1e-9)[0] for a, b in pairwise(edges))


def pieces(band, *curves):
    """Edges of a band's pieces, and of curves within."""
    nodes = np.unique(np.concatenate([band.wavelength_um, *(curve.wavelength_um for curve in curves)]))
    return nodes[(nodes >= band.wavelength_um[0]) & (nodes <= band.wavelength_um[-1])]


def test_the_whole_earth_emits_what_is_measured():
    """From 3 um to where nothing is left, without the product's own quadratures."""
    temperature = earth_spectrum().brightness_temperature_k
    exitance = np.pi * integral(lambda um: planck(um, temperature.at(um)), np.geomspace(3.0, 1000.0, 400))
    assert exitance == pytest.approx(240.1, rel=0, abs=EXITANCE_ATOL_W_M2)


def test_the_whole_earth_reflects_what_is_measured():
    sun, albedo = solar_spectrum(), earth_spectrum().albedo
    um = np.geomspace(0.2, 100.0, 100_001)
    sunlight = np.interp(um, *sun)
    mean = np.trapezoid(sunlight * albedo.at(um), um) / np.trapezoid(sunlight, um)
    assert mean == pytest.approx(99.1 / 340.0, rel=0, abs=ALBEDO_ATOL)
    assert earth_albedo(ws.Band.top_hat("all", 0.2, 100.0)) == pytest.approx(mean, rel=1e-4, abs=0)


@pytest.mark.parametrize(
    ("edges_um", "lower_k", "upper_k"),
    [
        ((3.6, 4.0), 280, 290),  # window, mostly of the warm cloudless part
        ((4.25, 4.45), 225, 242),  # CO2
        ((6.1, 6.7), 230, 245),  # water
        ((7.6, 7.8), 245, 260),  # CH4 and N2O
        ((8.33, 12.5), 267, 273),  # TES: 270 K for the full disc (Pearl and Christensen 1997)
        ((8.4, 9.2), 270, 278),
        ((9.5, 9.8), 243, 257),  # O3
        ((10.5, 12.5), 270, 278),
        ((14.3, 15.6), 215, 228),  # CO2
        ((18.0, 20.0), 255, 265),  # water, weak
        ((25.0, 30.0), 235, 248),  # water, rotation
    ],
    ids=str,
)
def test_features_of_the_emission(edges_um, lower_k, upper_k):
    assert lower_k < earth_brightness_temperature_k(ws.Band.top_hat("window", *edges_um)) < upper_k


@pytest.mark.parametrize(
    ("edges_um", "lower", "upper"),
    [
        ((0.25, 0.29), 0.0, 0.02),  # ozone
        ((0.35, 0.42), 0.38, 0.55),  # Rayleigh scattering
        ((0.5, 0.6), 0.27, 0.36),
        ((0.84, 0.88), 0.3, 0.42),
        ((0.93, 0.96), 0.1, 0.25),  # water
        ((1.12, 1.15), 0.08, 0.22),  # water
        ((1.36, 1.42), 0.0, 0.1),  # water
        ((1.82, 1.95), 0.0, 0.06),  # water
        ((2.6, 2.85), 0.0, 0.01),  # water
        ((3.6, 4.1), 0.02, 0.07),
        ((4.25, 4.4), 0.0, 0.01),  # CO2
        ((10.0, 12.0), 0.005, 0.03),
    ],
    ids=str,
)
def test_features_of_the_albedo(edges_um, lower, upper):
    assert lower <= earth_albedo(ws.Band.top_hat("window", *edges_um)) <= upper


@pytest.mark.parametrize("band", [*ws.BANDS.values(), MWIR, LWIR], ids=lambda band: band.name)
def test_brightness_temperature_in_a_band(band, record_accuracy):
    """The blackbody of that temperature has the Earth's mean radiance."""
    temperature = earth_spectrum().brightness_temperature_k
    edges = pieces(band, temperature)
    mean = integral(lambda um: float(band.energy_response(um)) * planck(um, temperature.at(um)), edges)
    kelvin = earth_brightness_temperature_k(band)
    found = integral(lambda um: float(band.energy_response(um)) * planck(um, kelvin), edges)
    record_accuracy("Radiance of the Earth in a band", abs(found / mean - 1), QUAD_RTOL, "of it", "scipy")


@pytest.mark.parametrize("band", [VISIBLE, ws.BANDS["A"], MWIR], ids=lambda band: band.name)
def test_albedo_in_a_band(band, record_accuracy):
    sun, albedo = solar_spectrum(), earth_spectrum().albedo
    edges = pieces(band, sun, albedo)
    weight = [
        integral(lambda um, of=of: float(band.energy_response(um)) * np.interp(um, *sun) * of(um), edges)
        for of in (albedo.at, lambda um: 1.0)
    ]
    error = abs(earth_albedo(band) / (weight[0] / weight[1]) - 1)
    record_accuracy("Albedo of the Earth in a band", error, QUAD_RTOL, "of it", "scipy")


@pytest.mark.parametrize("edges_um", [(0.25, 0.26), (0.4, 0.9), (44.0, 45.0), (200.0, 300.0)], ids=str)
def test_the_ends_of_the_spectrum(edges_um):
    band = ws.Band.top_hat("end", *edges_um)
    ends = 255.0 if edges_um[0] < 3 else 237.0
    assert earth_brightness_temperature_k(band) == pytest.approx(ends, rel=TEMPERATURE_RTOL, abs=0)
    assert 0.0 <= earth_albedo(band) < 0.4


def test_bands_of_msx_keep_their_round_numbers():
    """They are those of the spectrum within 6 K; band A, which spans ozone and water, within 12 K."""
    lighting = ws.Lighting()
    for name, band in ws.BANDS.items():
        assert lighting.earth_k_in(band) == EARTH_K[name]
        assert lighting.earth_albedo_in(band) == 0.3
        assert abs(earth_brightness_temperature_k(band) - EARTH_K[name]) < (12.0 if name == "A" else 7.0)


def test_other_bands_have_the_spectrum_s_and_any_can_be_given():
    lighting = ws.Lighting()
    assert lighting.earth_k_in(MWIR) == earth_brightness_temperature_k(MWIR)
    assert lighting.earth_albedo_in(VISIBLE) == earth_albedo(VISIBLE)
    own_a = ws.Band.top_hat("A", 8.0, 9.0)  # called as a band of MSX, and another one
    assert lighting.earth_k_in(own_a) == earth_brightness_temperature_k(own_a)
    given = ws.Lighting(earth_albedo={"A": 0.2}, earth_k={"E": 250.0}, sun_w_cm2={"C": 1e-5})
    assert [given.earth_albedo_in(ws.BANDS[name]) for name in "AC"] == [0.2, 0.3]
    assert given.earth_k_in(ws.BANDS["E"]) == 250.0
    assert given.sun_w_m2_in(ws.BANDS["C"]) == pytest.approx(0.1, rel=1e-15, abs=0)
    assert ws.Lighting(earth_albedo=0.5).earth_albedo_in(MWIR) == 0.5


@pytest.mark.parametrize("albedo", [0.4, {"A": 0.25, "E": 0.0}], ids=str)
def test_albedo_is_saved_with_the_scene(scene, tmp_path, albedo):
    given = scene.replace(lighting__earth_albedo=albedo)
    given.save(tmp_path / "s.toml")
    assert ws.Scene.load(tmp_path / "s.toml") == given != scene


@pytest.mark.parametrize(
    ("albedo", "message"),
    [
        (1.2, r"lighting.earth_albedo: must be in \[0, 1\], got 1.2"),
        ({"A": -0.1}, r"lighting.earth_albedo: A: must be in \[0, 1\], got -0.1"),
        ({}, "lighting.earth_albedo: must be a number or a table that names a band"),
        ("dark", "lighting.earth_albedo: must be a number"),
    ],
    ids=str,
)
def test_bad_albedos_are_refused(scene, albedo, message):
    with pytest.raises(ws.InputError, match=message):
        scene.replace(lighting__earth_albedo=albedo)
