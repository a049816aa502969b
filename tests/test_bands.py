"""Bands, their zero points, and blackbody radiance against mpmath."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from warpsim.errors import InputError
from warpsim.sky.bands import BANDS, Band, as_band, band_radiance_w_m2_sr

RADIANCE_RTOL = 1e-12  # rounding of float64 sums over up to 900 nodes, exponents up to 80 (50 K, 4 um)
COLD_RTOL = 1e-7  # below 10 K the exponential falls by decades inside one quadrature piece
HALF_POWER_ATOL_UM = 0.1  # published half-power points are rounded, and of the full curves
ISOPHOTAL_RTOL = 0.07  # isophotal wavelength of Vega against the plain mean: band A is wide
IN_BAND_RTOL = 0.02  # a 0 mag star's spectrum is near Rayleigh-Jeans; zero points and responses are good to 1-2 %


def exact_radiance(temperature_k, wavelength_um, response):
    """Integral of a piecewise-linear response times Planck's law, by mpmath with 30 digits."""
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(30):
        h, c, k = (mpmath.mpf(text) for text in ("6.62607015e-34", "299792458", "1.380649e-23"))
        total = mpmath.mpf(0)
        for i in range(len(wavelength_um) - 1):
            l0, l1 = (mpmath.mpf(float(v)) for v in wavelength_um[i : i + 2])
            r0, r1 = (mpmath.mpf(float(v)) for v in response[i : i + 2])
            if r0 == 0 and r1 == 0:
                continue

            def spectral(l_um, l0=l0, l1=l1, r0=r0, r1=r1):
                l_m = l_um * mpmath.mpf("1e-6")
                planck = 2 * h * c**2 / l_m**5 / mpmath.expm1(h * c / (l_m * k * mpmath.mpf(temperature_k)))
                return planck * (r0 + (r1 - r0) * (l_um - l0) / (l1 - l0)) * mpmath.mpf("1e-6")

            n = max(1, int(mpmath.ceil((l1 - l0) / l0 / mpmath.mpf("0.05"))))
            total += mpmath.quad(spectral, [l0 + (l1 - l0) * j / n for j in range(n + 1)])
        return float(total)


@pytest.mark.parametrize("temperature_k", [50.0, 300.0, 6000.0])
@pytest.mark.parametrize("name", list(BANDS))
def test_radiance_matches_mpmath(name, temperature_k):
    band = BANDS[name]
    expected = exact_radiance(temperature_k, band.wavelength_um, band.response)
    assert band_radiance_w_m2_sr(temperature_k, name) == pytest.approx(expected, rel=RADIANCE_RTOL)


@pytest.mark.parametrize(
    ("wavelength_um", "response", "temperature_k", "rtol"),
    [
        ((4.29, 4.30), (1.0, 1.0), 300.0, RADIANCE_RTOL),
        ((4.29, 4.30), (0.0, 1.0), 50.0, RADIANCE_RTOL),
        ((1.0, 100.0), (1.0, 1.0), 50.0, RADIANCE_RTOL),
        ((3.0, 5.0, 8.0), (0.0, 1.0, 0.0), 10_000.0, RADIANCE_RTOL),
        ((18.0, 25.0), (1.0, 1.0), 3.0, COLD_RTOL),
        ((8.0, 8.01), (1.0, 1.0), 3.0, COLD_RTOL),
        ((8.0, 12.0), (1.0, 1.0), 10_000.0, RADIANCE_RTOL),
    ],
    ids=["narrow", "narrow-ramp-cold", "two-decades", "triangle-hot", "3K-wide", "3K-narrow", "1e4K"],
)
def test_radiance_of_user_bands_matches_mpmath(wavelength_um, response, temperature_k, rtol):
    band = Band("user", wavelength_um, response)
    expected = exact_radiance(temperature_k, wavelength_um, response)
    assert band_radiance_w_m2_sr(temperature_k, band) == pytest.approx(expected, rel=rtol)


def test_radiance_over_all_wavelengths_is_stefan_boltzmann():
    band = Band("all", np.geomspace(0.1, 1e5, 50), np.ones(50))
    # What lies beyond 0.1 um ... 10 cm at 300 K is below 1e-10 of the whole.
    assert band_radiance_w_m2_sr(300.0, band) == pytest.approx(5.670374419e-8 * 300.0**4 / np.pi, rel=1e-9)


def test_radiance_shape_order_and_type():
    temperature_k = np.array([[200.0, 250.0, 300.0], [350.0, 400.0, 450.0]])
    result = band_radiance_w_m2_sr(temperature_k, "A")
    assert result.shape == (2, 3)
    assert result.dtype == np.float64
    assert (np.diff(result.ravel()) > 0.0).all()
    assert result[1, 0] == pytest.approx(band_radiance_w_m2_sr(350.0, BANDS["A"]), rel=1e-14)
    assert isinstance(band_radiance_w_m2_sr(300, "A"), float)
    assert band_radiance_w_m2_sr([], "A").shape == (0,)


def test_radiance_in_chunks_equals_radiance_one_by_one():
    temperature_k = np.linspace(50.0, 6000.0, 7001)  # three chunks of band A
    result = band_radiance_w_m2_sr(temperature_k, "A")
    for row in (0, 2346, 2347, 2348, 7000):
        assert result[row] == pytest.approx(band_radiance_w_m2_sr(temperature_k[row], "A"), rel=1e-14)


def test_radiance_underflows_to_zero_without_warnings(recwarn):
    assert band_radiance_w_m2_sr(3.0, "B1") == 0.0
    assert not recwarn.list


@pytest.mark.parametrize("temperature_k", [0.0, -1.0, np.nan, np.inf, [300.0, 0.0]])
def test_bad_temperature_is_an_error(temperature_k):
    with pytest.raises(InputError, match="temperature_k must be finite and > 0, got"):
        band_radiance_w_m2_sr(temperature_k, "A")


def test_temperature_must_be_numbers():
    with pytest.raises(InputError, match="temperature_k must be numbers"):
        band_radiance_w_m2_sr("hot", "A")


@pytest.mark.parametrize("band", ["F", "a", "", 3, None])
def test_unknown_band_lists_the_known(band):
    with pytest.raises(InputError, match=r"^band: must be one of B1, B2, A, C, D, E or a Band, got ") as error:
        band_radiance_w_m2_sr(300.0, band)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("band", BANDS.values(), ids=list(BANDS))
def test_shipped_responses_agree_with_the_published_figures(band):
    assert band.response.max() == 1.0
    plain = Band("plain", band.wavelength_um, band.response)
    np.testing.assert_allclose(plain.half_power_um, band.half_power_um, rtol=0, atol=HALF_POWER_ATOL_UM)
    assert plain.isophotal_um == pytest.approx(band.isophotal_um, rel=ISOPHOTAL_RTOL)
    assert np.isnan(plain.zero_mag_jy)
    # Two columns of the same table, each rounded on its own (B2 5.4e-16 has two digits).
    assert band.zero_mag_jy * band.w_cm2_per_jy == pytest.approx(band.zero_mag_w_cm2, rel=0.005)


@pytest.mark.parametrize("band", BANDS.values(), ids=list(BANDS))
def test_zero_points_agree_with_the_responses(band):
    # In-band irradiance of a Rayleigh-Jeans star with the stated flux density at the isophotal wavelength.
    wavelength_um = np.linspace(band.wavelength_um[0], band.wavelength_um[-1], 20_001)
    response = np.interp(wavelength_um, band.wavelength_um, band.response)
    zero_w_cm2_um = band.zero_mag_jy * 1e-26 * 2.99792458e8 / (band.isophotal_um * 1e-6) ** 2 * 1e-10
    in_band_w_cm2 = np.trapezoid(response * zero_w_cm2_um * (band.isophotal_um / wavelength_um) ** 4, wavelength_um)
    assert in_band_w_cm2 == pytest.approx(band.zero_mag_w_cm2, rel=IN_BAND_RTOL)


def test_band_is_scaled_to_peak_one_copied_and_read_only():
    wavelength_um, response = np.array([3.0, 4.0, 5.0]), np.array([0.0, 4.0, 2.0])
    band = Band("mid", wavelength_um, response)
    wavelength_um[0] = response[0] = 99.0
    np.testing.assert_array_equal(band.wavelength_um, [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(band.response, [0.0, 1.0, 0.5])
    with pytest.raises(ValueError, match="read-only"):
        band.response[0] = 1.0
    with pytest.raises(AttributeError):
        band.name = "other"


def test_derived_wavelengths_of_a_triangle():
    band = Band("triangle", [3.0, 4.0, 5.0], [0.0, 1.0, 0.0])
    assert band.isophotal_um == pytest.approx(4.0, rel=1e-14)
    assert band.half_power_um == pytest.approx((3.5, 4.5), rel=1e-14)
    assert Band("box", [3.0, 5.0], [1.0, 1.0]).half_power_um == (3.0, 5.0)


def test_equal_bands_are_equal():
    band = Band("mid", [3.0, 4.0, 5.0], [0.0, 2.0, 1.0])
    same = Band("mid", band.wavelength_um, band.response)
    assert band == same
    assert hash(band) == hash(same)
    assert band != Band("mid", [3.0, 4.0, 5.5], [0.0, 2.0, 1.0])
    assert pickle.loads(pickle.dumps(band)) == band
    assert copy.deepcopy(BANDS["A"]) == BANDS["A"]
    assert as_band(band) is band
    assert as_band("E") is BANDS["E"]


@pytest.mark.parametrize(
    ("wavelength_um", "response", "text"),
    [
        ([3.0, 3.0], [1.0, 1.0], "band x: wavelength_um must increase, got 3 then 3"),
        ([4.0, 3.0], [1.0, 1.0], "band x: wavelength_um must increase, got 4 then 3"),
        ([0.0, 3.0], [1.0, 1.0], "band x: wavelength_um must be > 0, got 0"),
        ([3.0, np.nan], [1.0, 1.0], "band x: wavelength_um must be finite, got nan at node 1"),
        ([3.0, 4.0], [np.inf, 1.0], "band x: response must be finite, got inf at node 0"),
        ([3.0, 4.0], [-0.1, 1.0], "band x: response must be >= 0, got -0.1"),
        ([3.0, 4.0], [0.0, 0.0], "band x: response must be > 0 somewhere, got 0 everywhere"),
        ([3.0, 4.0], [1.0, 1.0, 1.0], "band x: response must be as long as wavelength_um, got 3 and 2 nodes"),
        ([3.0], [1.0], "band x: wavelength_um must be a vector of at least 2 nodes, got shape (1,)"),
        ("abc", [1.0, 1.0], "band x: wavelength_um must be numbers, got str"),
    ],
)
def test_bad_band_is_an_error(wavelength_um, response, text):
    with pytest.raises(InputError) as error:
        Band("x", wavelength_um, response)
    assert str(error.value) == text


def test_band_needs_a_name():
    with pytest.raises(InputError, match="name must be a text"):
        Band("", [3.0, 4.0], [1.0, 1.0])
