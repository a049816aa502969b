"""Spectra of stars: the continuum, shares of spectral intervals, and light in bands of one's own."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.radiometry.band import Band
from warpsim.radiometry.bands import BANDS
from warpsim.sky import stellar_spectrum
from warpsim.sky.catalog import StarCatalog
from warpsim.sky.colours import CLASS_TEMPERATURE_K, flux_from_magnitude_a
from warpsim.sky.stellar_spectrum import band_irradiance_w_cm2, engelke_temperature_k, interval_shares

QUAD_RTOL = 1e-8  # quadrature of the reference, cut at every kink, and of the code (2e-9 over 2 to 60 um)
GRID_RTOL = 1e-6  # asked of a band's radiance: the code interpolates between temperatures, 7e-7 off at most
SUM_RTOL = 1e-14  # rounding of sums of up to 32 shares

# A band of one's own with the response of an MSX band, against the calibration's W/cm2 per Jy: the nodes of the
# responses against the full curves (B1 3.8 %, B2 1.3 %), and in band A the factor that leads from B2 to C (3 %).
SAME_BAND_ATOL = {"B1": 0.04, "B2": 0.02, "A": 0.031, "C": 0.008, "D": 0.005, "E": 0.016}
ALONE_ATOL = {"B1": 0.038, "B2": 0.013, "A": 0.003, "C": 0.001, "D": 0.003, "E": 0.006}

OWN = Band("own", [3.5, 4.0, 9.0, 14.0], [0.0, 1.0, 0.7, 0.2])


def star(wavelength_um, temperature_k):
    """Engelke's continuum per wavelength, up to a factor, from the equations alone."""
    brightness_k = 0.738 * temperature_k * (1 + 79450 / (wavelength_um * temperature_k)) ** 0.182
    c2_um_k = 6.62607015e-34 * 299792458.0 / 1.380649e-23 * 1e6
    return wavelength_um**-5 / math.expm1(c2_um_k / (wavelength_um * brightness_k))


def response_at(band, wavelength_um):
    return float(np.interp(wavelength_um, band.wavelength_um, band.response, left=0.0, right=0.0))


def integral(function, band, cuts_um=()):
    """Integral of response times function over a band, piece by piece between nodes and cuts."""
    quad = pytest.importorskip("scipy.integrate").quad
    low_um, high_um = band.wavelength_um[[0, -1]]
    edges = sorted({*band.wavelength_um.tolist(), *(cut for cut in cuts_um if low_um < cut < high_um)})
    return sum(
        quad(lambda um: response_at(band, um) * function(um), a, b, epsabs=0, epsrel=1e-11)[0]
        for a, b in itertools.pairwise(edges)
        if response_at(band, a) + response_at(band, (a + b) / 2) + response_at(band, b) > 0
    )


def expected_irradiance_w_cm2(band, flux_jy, temperature_k):
    """The definition for one star: fluxes are means over their bands by frequency, factors linear in ln(wavelength)."""
    known = sorted((BANDS[name].isophotal_um, name) for name, flux in flux_jy.items() if math.isfinite(flux))
    places = [math.log(um) for um, _ in known]
    factors = []
    for _, name in known:
        mean = integral(lambda um: star(um, temperature_k), BANDS[name]) / integral(lambda um: um**-2, BANDS[name])
        factors.append(flux_jy[name] / mean)

    def w_cm2_um(um):
        factor = np.interp(math.log(um), places, factors)
        return factor * star(um, temperature_k) * 1e-26 * 299792458.0 * 1e12 * 1e-10

    return integral(w_cm2_um, band, [um for um, _ in known])


@pytest.mark.parametrize(
    ("wavelength_um", "temperature_k", "expected_k"),
    # By hand: 79450 / (10 * 7945) = 1, so T_b = 0.738 * 7945 * 2^0.182; and a factor 16 at a fifteenth of lambda T.
    [(10.0, 7945.0, 0.738 * 7945.0 * 2**0.182), (79450 / 15 / 4000, 4000.0, 0.738 * 4000.0 * 16**0.182)],
)
def test_brightness_temperature_is_engelkes(wavelength_um, temperature_k, expected_k):
    assert engelke_temperature_k(wavelength_um, temperature_k) == pytest.approx(expected_k, rel=1e-14)


# --- shares of spectral intervals ---


@pytest.mark.parametrize("temperature_k", [2600.0, 4150.0, 9600.0])
@pytest.mark.parametrize("name", list(BANDS))
def test_shares_give_means_over_the_light_of_the_band(name, temperature_k):
    band = BANDS[name]
    wavelength_um, share = interval_shares(name, 6, [temperature_k])
    total = integral(lambda um: star(um, temperature_k), band)
    for function in (lambda um: um, lambda um: um**2, lambda um: np.exp(-((um - band.isophotal_um) ** 2) / 50)):
        expected = integral(lambda um, f=function: f(um) * star(um, temperature_k), band) / total
        assert share[0] @ function(wavelength_um) == pytest.approx(expected, rel=1e-6)  # 6 intervals over band A


def test_shares_are_positive_and_of_sum_one():
    wavelength_um, share = interval_shares(OWN, 6, np.array([[1e-3, 2600.0, 4150.0], [9600.0, 1e8, np.nan]]).ravel())
    assert wavelength_um.shape == (6,)
    assert share.shape == (6, 6)
    assert (share > 0).all()
    np.testing.assert_allclose(share.sum(axis=1), 1.0, rtol=SUM_RTOL)
    # Hot stars are bluer; beyond 1000 ... 100,000 K nothing changes, and an unknown star is a K giant of 4850 K.
    assert share[4, 0] > share[3, 0] > share[2, 0] > share[1, 0]
    np.testing.assert_array_equal(share[[0, 4, 5]], interval_shares(OWN, 6, [1000.0, 1e5, 4850.0])[1])


def test_one_interval_takes_everything():
    np.testing.assert_array_equal(interval_shares("A", 1, [3000.0, 5000.0])[1], [[1.0], [1.0]])
    assert interval_shares("A", 4, [])[1].shape == (0, 4)


# --- bands of one's own ---


@pytest.mark.parametrize(
    "band",
    [
        OWN,
        Band("blue", [2.0, 3.0], [1.0, 0.5]),
        Band("red", [25.0, 60.0], [1.0, 1.0]),
        Band("narrow", [8.0, 8.001], [1.0, 1.0]),
        Band("across-a-knot", [8.2, 8.3], [0.3, 1.0]),
        Band("gap", [4.0, 4.3, 4.4, 9.0, 10.0], [0.0, 1.0, 0.0, 0.0, 1.0]),
        Band("all", [2.0, 60.0], [1.0, 1.0]),
    ],
    ids=lambda band: band.name,
)
def test_light_in_a_band_of_ones_own_follows_the_definition(band):
    fluxes = {
        "B1": [np.nan, 190.0, np.nan, 0.0],
        "B2": [np.nan, 150.0, 180.0, 0.0],
        "A": [2.5, 58.0, np.nan, 3.0],
        "C": [np.nan, 26.0, np.nan, 1.0],
        "D": [np.nan, 20.0, 17.0, np.nan],
        "E": [np.nan, 12.0, np.nan, 0.4],
    }
    temperature_k = np.array([4321.0, 2777.0, 9600.0, np.nan])
    got = band_irradiance_w_cm2(band, {name: np.array(flux) for name, flux in fluxes.items()}, temperature_k)
    for k, kelvin in enumerate([4321.0, 2777.0, 9600.0, 4850.0]):
        expected = expected_irradiance_w_cm2(band, {name: flux[k] for name, flux in fluxes.items()}, kelvin)
        assert got[k] == pytest.approx(expected, rel=GRID_RTOL + QUAD_RTOL, abs=0)


def test_a_flat_star_of_ones_own_band_is_flux_times_width():
    # With the same factor everywhere the narrow band sees the continuum: between hot stars' lambda^-4 and its own.
    narrow = Band("narrow", [11.99, 12.01], [1.0, 1.0])
    light = band_irradiance_w_cm2(narrow, {"C": np.array([26.51])}, np.array([1e5]))
    width_hz = 299792458.0 * 1e6 * (1 / 11.99 - 1 / 12.01)
    rayleigh_jeans_jy = 26.51 * (12.09 / 12.0) ** 2  # 12.09 um: where the flux of band C is met
    assert light[0] == pytest.approx(rayleigh_jeans_jy * 1e-30 * width_hz, rel=2e-3, abs=0)


@pytest.mark.parametrize("name", list(BANDS))
def test_the_response_of_an_msx_band_gives_nearly_the_calibrations_light(name):
    band = BANDS[name]
    twin = Band("twin", band.wavelength_um, band.response)
    fluxes = flux_from_magnitude_a(np.zeros(6), np.arange(6))
    ratio = band_irradiance_w_cm2(twin, fluxes, CLASS_TEMPERATURE_K) / (fluxes[name] * band.w_cm2_per_jy)
    # The reddest class is dusty: its colours are not those of any photosphere (E: 5 %).
    np.testing.assert_allclose(ratio[:5], 1.0, rtol=0, atol=SAME_BAND_ATOL[name])
    alone = band_irradiance_w_cm2(twin, {name: fluxes[name]}, CLASS_TEMPERATURE_K) / (fluxes[name] * band.w_cm2_per_jy)
    np.testing.assert_allclose(alone, 1.0, rtol=0, atol=ALONE_ATOL[name])


def test_continuum_colours_are_those_of_giants():
    """Against A, from 4500 to 3000 K: C, D, E within 0.05 mag of 0, B1 from +0.03 to +0.10 (published zero points)."""
    for kelvin in (4500.0, 3750.0, 3000.0):
        magnitude = {}
        for name, band in BANDS.items():
            mean = integral(lambda um, t=kelvin: star(um, t), band) / integral(lambda um: um**-2, band)
            magnitude[name] = -2.5 * math.log10(mean / band.zero_mag_jy)
        for name in "CDE":
            assert abs(magnitude[name] - magnitude["A"]) < 0.05
        assert 0.03 < magnitude["B1"] - magnitude["A"] < 0.105


@pytest.mark.parametrize(
    ("wavelength_um", "text"),
    [
        ([1.9, 4.0], "got 1.9 to 4 um"),
        ([40.0, 61.0], "got 40 to 61 um"),
    ],
)
def test_a_band_beyond_the_continuum_is_an_error(wavelength_um, text):
    band = Band("far", wavelength_um, [1.0, 1.0])
    for call in (lambda: interval_shares(band, 3, [4000.0]), lambda: band_irradiance_w_cm2(band, {}, [4000.0])):
        with pytest.raises(InputError) as error:
            call()
        rule = "band far: must lie within 2 to 60 um, where the spectrum of stars is known, "
        assert str(error.value) == rule + text


def test_ends_without_response_may_lie_beyond():
    band = Band("padded", [0.5, 3.0, 4.0, 5.0, 100.0], [0.0, 0.0, 1.0, 0.0, 0.0])
    trimmed = Band("trimmed", [3.0, 4.0, 5.0], [0.0, 1.0, 0.0])
    flux = {"A": np.array([1.0])}
    assert band_irradiance_w_cm2(band, flux, [4000.0]) == pytest.approx(
        band_irradiance_w_cm2(trimmed, flux, [4000.0]), rel=1e-12, abs=0
    )


# --- catalogs ---


@pytest.fixture(scope="module")
def stars():
    flux_jy = {"A": [1.0, np.nan, 3.0, np.nan], "E": [0.5, 0.0, 2.0, np.nan]}
    temperature_k = [3000.0, 9000.0, np.nan, 4000.0]
    return StarCatalog.from_arrays([1.0, 2.0, 3.0, 4.0], [0.0] * 4, flux_jy, temperature_k=temperature_k)


@pytest.mark.parametrize("physics", ["physical", "paper"])
def test_interval_irradiances_add_up_to_the_bands(stars, physics):
    for name in ("A", "C", "E"):
        for n_interval in (1, 6, 32):
            wavelength_um, light = stars.interval_irradiance_w_cm2(name, n_interval, physics)
            np.testing.assert_array_equal(wavelength_um, BANDS[name].intervals(n_interval)[0])
            assert light.shape == (4, n_interval)
            np.testing.assert_allclose(light.sum(axis=1), stars.irradiance_w_cm2(name, physics), rtol=SUM_RTOL)


def test_interval_irradiances_of_a_band_of_ones_own(stars):
    _, light = stars.interval_irradiance_w_cm2(OWN, 6)
    np.testing.assert_allclose(light.sum(axis=1), stars.irradiance_w_cm2(OWN), rtol=SUM_RTOL)
    with pytest.raises(InputError, match="band own: n: must be a whole number from 1 to 32, got 40"):
        stars.interval_irradiance_w_cm2(OWN, 40)
    with pytest.raises(InputError, match=r"band: must be one of .*, got 'own'"):
        stars.interval_irradiance_w_cm2(OWN, 6, "paper")


def test_catalog_light_in_a_band_of_ones_own(stars):
    light = stars.irradiance_w_cm2(OWN)
    expected = expected_irradiance_w_cm2(OWN, {"A": 1.0, "E": 0.5}, 3000.0)
    assert light[0] == pytest.approx(expected, rel=GRID_RTOL + QUAD_RTOL, abs=0)
    assert light[1] == 0.0  # its only flux is 0
    assert light[3] == 0.0  # no flux at all
    # A response of one's own that only bears the name of an MSX band is no MSX band.
    false_a = Band("A", OWN.wavelength_um, OWN.response)
    np.testing.assert_array_equal(stars.irradiance_w_cm2(false_a), light)
    assert StarCatalog.from_arrays([], [], {}).irradiance_w_cm2(OWN).shape == (0,)


def test_work_in_chunks_equals_work_one_by_one(monkeypatch):
    temperature_k = np.geomspace(1500.0, 50_000.0, 23)
    whole = interval_shares("A", 6, temperature_k)[1]
    monkeypatch.setattr(stellar_spectrum, "_CHUNK_ELEMENTS", 6 * 5)
    np.testing.assert_allclose(interval_shares("A", 6, temperature_k)[1], whole, rtol=SUM_RTOL)
