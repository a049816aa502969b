"""Sun and Earth by wavelength: integrals over bands, condensed tables, exitance and albedo as measured, defaults."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import warpsim as ws
from warpsim.constants import ASTRONOMICAL_UNIT_M, SOLAR_CONSTANT_W_M2, SUN_RADIUS_M
from warpsim.radiometry.sun_and_earth import (
    earth_albedo,
    earth_brightness_temperature_k,
    earth_spectrum,
    solar_spectrum,
    sun_irradiance_w_m2,
)
from warpsim.scene.environment import EARTH_K

EXACT_RTOL = 1e-12  # Gauss points against closed forms of polynomials
QUAD_RTOL = 1e-6  # adaptive quadrature piece by piece
CONDENSED_RTOL = 1e-3  # what the recipe promises of windows of 2 % and more
SOLAR_CONSTANT_ATOL_W_M2 = 0.2  # 0.11 W/m2 lie below 0.2 um, 0.001 beyond 100 um
MAGNITUDE_ATOL = 0.06  # top hats stand for the responses of 2MASS and WISE; zero point of W4 (0.06 mag)

STANDARD = {
    # Integrals of the whole ASTM E-490-00a table [W/m2], before its scaling, between wavelengths [um]; linear between
    # its nodes up to 1 um, power laws beyond.
    (0.25, 0.3): 12.6614,
    (0.3, 0.31): 5.48474,
    (0.39, 0.4): 11.4919,
    (0.4, 0.41): 16.8537,
    (0.42, 0.44): 33.335,
    (0.4, 0.7): 530.114,
    (0.5, 0.51): 19.079,
    (0.55, 0.57): 36.9267,
    (0.65, 0.67): 30.8545,
    (0.7, 1.0): 311.159,
    (0.85, 0.87): 19.2835,
    (1.0, 1.02): 14.4981,
    (1.2, 1.3): 46.0072,
    (1.5, 1.8): 68.6513,
    (2.0, 2.4): 33.4056,
    (2.55, 2.85): 11.6884,
    (3.5, 3.57): 0.98085,
    (3.5, 5.0): 11.2745,
    (4.3, 4.4): 0.619867,
    (8.0, 9.5): 0.620885,
    (8.0, 12.0): 1.09101,
    (11.0, 11.3): 0.0464765,
    (20.0, 25.0): 0.0479259,
    (27.0, 28.5): 0.00600694,
    (40.0, 45.0): 0.00369905,
}
STANDARD_W_M2 = 1366.073

V_NODES = [
    (0.47, 0), (0.48, 0.03), (0.49, 0.163), (0.5, 0.458), (0.51, 0.78), (0.52, 0.967), (0.53, 1), (0.54, 0.973),
    (0.55, 0.898), (0.56, 0.792), (0.57, 0.684), (0.58, 0.574), (0.59, 0.461), (0.6, 0.359), (0.61, 0.27),
    (0.62, 0.197), (0.63, 0.135), (0.64, 0.081), (0.65, 0.045), (0.66, 0.025), (0.67, 0.017), (0.68, 0.013), (0.7, 0),
]  # fmt: skip
"""Johnson V (Bessell 1990, PASP 102, 1181)."""


@pytest.mark.parametrize("name", list(ws.BANDS))
def test_sunlight_is_the_integral_of_the_spectrum(name):
    band, (node_um, irradiance) = ws.BANDS[name], solar_spectrum()
    first_um, last_um = band.wavelength_um[[0, -1]]
    edges = np.unique([*band.wavelength_um, *node_um[(node_um > first_um) & (node_um < last_um)]])
    total = sum(
        quad(lambda um: float(band.energy_response(um)) * np.interp(um, node_um, irradiance), a, b)[0]
        for a, b in pairwise(edges)
    )
    assert sun_irradiance_w_m2(name) == pytest.approx(total, rel=QUAD_RTOL, abs=0)


def test_a_photon_response_is_integrated_exactly():
    """Response times wavelength times spectrum is a cubic in each piece: by hand from its moments."""
    band = ws.Band("qe", [0.5, 0.9], [0.2, 0.8], per_photon=True)
    node_um, irradiance = solar_spectrum()
    inside = node_um[(node_um > 0.5) & (node_um < 0.9)]
    edges = np.concatenate([[0.5], inside, [0.9]])
    total = 0.0
    for a, b in pairwise(edges):
        response = np.polynomial.Polynomial.fit([a, b], 0.2 + 0.6 * (np.array([a, b]) - 0.5) / 0.4, 1).convert()
        spectrum = np.polynomial.Polynomial.fit([a, b], np.interp([a, b], node_um, irradiance), 1).convert()
        primitive = (response * spectrum * np.polynomial.Polynomial([0, 1])).integ()
        total += primitive(b) - primitive(a)
    peak = 0.8 * 0.9
    assert sun_irradiance_w_m2(band) == pytest.approx(total / peak, rel=1e-9, abs=0)


def test_the_solar_constant():
    everything = ws.Band.top_hat("all", 0.05, 1000.0)
    assert sun_irradiance_w_m2(everything) == pytest.approx(SOLAR_CONSTANT_W_M2, rel=0, abs=SOLAR_CONSTANT_ATOL_W_M2)
    assert sun_irradiance_w_m2(ws.Band.top_hat("x-rays", 0.01, 0.1)) == 0.0
    assert sun_irradiance_w_m2(ws.Band.top_hat("radio", 200.0, 300.0)) == 0.0


@pytest.mark.parametrize(("edges_um", "standard_w_m2"), STANDARD.items(), ids=str)
def test_it_condenses_the_standard(edges_um, standard_w_m2, record_accuracy):
    found = sun_irradiance_w_m2(ws.Band.top_hat("window", *edges_um)) * STANDARD_W_M2 / SOLAR_CONSTANT_W_M2
    error = abs(found / standard_w_m2 - 1)
    record_accuracy("Sunlight in a band, condensed", error, CONDENSED_RTOL, "of it", "the whole table of ASTM E-490")


def test_the_suns_visual_magnitude():
    """V = -26.76 (Willmer 2018, ApJS 236, 47), with the zero point of Bessell 1998, 3.631e-9 erg/cm2/s/A."""
    um, response = np.array(V_NODES).T
    irradiance = sun_irradiance_w_m2(ws.Band("V", um, response)) / np.trapezoid(response, um)
    assert -2.5 * np.log10(irradiance / 3.631e-8) == pytest.approx(-26.76, rel=0, abs=0.02)


@pytest.mark.parametrize(
    ("wavelength_um", "width_um", "zero_w_cm2_um", "magnitude"),
    [
        (1.235, 0.162, 3.129e-13, -27.90),
        (1.662, 0.251, 1.133e-13, -28.25),
        (2.159, 0.262, 4.283e-14, -28.30),
        (3.3526, 0.66263, 8.1787e-15, -28.31),
        (22.0883, 4.1013, 5.0901e-18, -28.30),
    ],
    ids=["J", "H", "Ks", "W1", "W4"],
)
def test_the_suns_infrared_magnitudes(wavelength_um, width_um, zero_w_cm2_um, magnitude):
    """Willmer 2018, with the zero points of Cohen et al. 2003 (2MASS) and Jarrett et al. 2011 (WISE)."""
    lower_um, upper_um = wavelength_um - width_um / 2, wavelength_um + width_um / 2
    w_cm2_um = sun_irradiance_w_m2(ws.Band.top_hat("hat", lower_um, upper_um)) * 1e-4 / width_um
    assert -2.5 * np.log10(w_cm2_um / zero_w_cm2_um) == pytest.approx(magnitude, rel=0, abs=MAGNITUDE_ATOL)


def test_the_sun_is_cooler_in_the_infrared():
    """About 5000 K at 10 um, as the photosphere is seen higher up: 15 to 23 % fainter than a blackbody of 5772 K."""
    solid_angle = np.pi * (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2
    for name, lower_k, upper_k in [("A", 4900, 5100), ("C", 4700, 4950), ("E", 4400, 4650)]:
        radiance = sun_irradiance_w_m2(name) / solid_angle
        kelvin = np.linspace(4000, 6000, 2001)
        brightness_k = np.interp(radiance, ws.band_radiance_w_m2_sr(kelvin, name), kelvin)
        assert lower_k < brightness_k < upper_k


def test_unknown_bands_are_refused():
    with pytest.raises(ws.InputError, match="band: must be one of"):
        sun_irradiance_w_m2("Z")


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
