"""Sunlight in bands: exact integrals of the shipped spectrum, the table that it condenses, and published magnitudes."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import warpsim as ws
from warpsim.constants import ASTRONOMICAL_UNIT_M, SOLAR_CONSTANT_W_M2, SUN_RADIUS_M
from warpsim.radiometry.sun_and_earth import solar_spectrum, sun_irradiance_w_m2

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
