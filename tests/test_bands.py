"""Bands, their zero points, and blackbody radiance against mpmath."""

from __future__ import annotations

import copy
import itertools
import pickle
from fractions import Fraction

import numpy as np
import pytest
from conftest import slow

import warpsim as ws
from warpsim.errors import InputError
from warpsim.radiometry.band import AB_ZERO_JY, Band
from warpsim.radiometry.bands import BANDS, as_band, band_radiance_w_m2_sr, bands
from warpsim.radiometry.curve_nodes import PRODUCT_ERROR
from warpsim.sky.catalog import StarCatalog

RADIANCE_RTOL = 1e-12  # rounding of float64 sums over up to 900 nodes, exponents up to 80 (50 K, 4 um)
COLD_RTOL = 1e-7  # below 10 K the exponential falls by decades inside one quadrature piece
HALF_POWER_ATOL_UM = 0.1  # published half-power points are rounded, and of the full curves
ISOPHOTAL_RTOL = 0.07  # isophotal wavelength of Vega against the plain mean: band A is wide
SIX_RTOL = 1e-6  # asked of a band's radiance, six intervals or all wavelengths
SHIPPED_ZERO_RTOL = 1e-5  # those facts were integrated by a trapezoid rule, and have six digits
MOMENT_RTOL = 3e-13  # sums of 32 terms of powers up to 63, and nodes good to an ulp

# The nodes of the responses against the full curves that the calibration used: 4 % in B1, 0.14 um wide.
FREQUENCY_WIDTH_RTOL = {"B1": 0.04, "B2": 0.015, "A": 0.005, "C": 0.005, "D": 0.005, "E": 0.006}

# Largest relative error of n intervals for blackbodies of 200-6000 K, as docs/physics.md has it, rounded up: the rule's
# own, in which no rounding shows. Errors that come near rounding are tested with its limit.
PLANCK_RTOL = {
    1: {"B1": 6e-3, "B2": 1.2e-2, "A": 0.21, "C": 0.026, "D": 0.024, "E": 0.087},
    2: {"B1": 7e-7, "B2": 3e-6, "A": 1.7e-2, "C": 1.7e-4, "D": 1.8e-4, "E": 2.8e-3},
    4: {"B1": 1e-12, "B2": 1e-12, "A": 4e-5, "C": 4e-9, "D": 8e-9, "E": 1.4e-6},
    6: {"B1": 1e-12, "B2": 1e-12, "A": 9e-8, "C": 1e-12, "D": 1e-12, "E": 7e-10},
    8: {"B1": 1e-12, "B2": 1e-12, "A": 3e-10, "C": 1e-12, "D": 1e-12, "E": 1e-12},
}


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
@pytest.mark.ci
def test_radiance_matches_mpmath(name, temperature_k, record_accuracy):
    band = BANDS[name]
    expected = exact_radiance(temperature_k, band.wavelength_um, band.response)
    got = band_radiance_w_m2_sr(temperature_k, name)
    assert got == pytest.approx(expected, rel=RADIANCE_RTOL, abs=0)
    error = abs(got / float(expected) - 1)
    record_accuracy("Band radiance, 50 to 6000 K", error, RADIANCE_RTOL, "of it", "mpmath")


@pytest.mark.parametrize(
    ("wavelength_um", "response", "temperature_k", "rtol"),
    [
        ((4.29, 4.30), (1.0, 1.0), 300.0, RADIANCE_RTOL),
        ((4.29, 4.30), (0.0, 1.0), 50.0, RADIANCE_RTOL),
        slow((1.0, 100.0), (1.0, 1.0), 50.0, RADIANCE_RTOL),
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
    assert band_radiance_w_m2_sr(temperature_k, band) == pytest.approx(expected, rel=rtol, abs=0)


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
        assert result[row] == pytest.approx(band_radiance_w_m2_sr(temperature_k[row], "A"), rel=1e-14, abs=0)


def test_radiance_underflows_to_zero_without_warnings(recwarn):
    assert band_radiance_w_m2_sr(3.0, "B1") == 0.0
    assert not recwarn.list


@pytest.mark.parametrize("temperature_k", [0.0, -1.0, np.nan, np.inf, [300.0, 0.0]])
def test_bad_temperature_is_an_error(temperature_k):
    with pytest.raises(InputError, match="temperature_k: must be finite and > 0, got"):
        band_radiance_w_m2_sr(temperature_k, "A")


def test_temperature_must_be_numbers():
    with pytest.raises(InputError, match="temperature_k: must be numbers"):
        band_radiance_w_m2_sr("hot", "A")


@pytest.mark.parametrize("band", ["F", "a", "", 3, None])
def test_unknown_band_lists_the_known(band):
    with pytest.raises(InputError, match=r"^band: must be one of B1, B2, A, C, D, E, W1, .* or a Band, got ") as error:
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
    assert band.zero_mag_jy * band.w_cm2_per_jy == pytest.approx(band.zero_mag_w_cm2, rel=0.005, abs=0)


@pytest.mark.parametrize("band", BANDS.values(), ids=list(BANDS))
def test_zero_points_agree_with_the_responses(band):
    # The flux density of an MSX band is its mean over the band by frequency: irradiance = flux * integral of R d nu.
    wavelength_um = np.linspace(band.wavelength_um[0], band.wavelength_um[-1], 20_001)
    response = np.interp(wavelength_um, band.wavelength_um, band.response)
    width_hz = np.trapezoid(response * 2.99792458e14 / wavelength_um**2, wavelength_um)
    expected_w_cm2_per_jy = 1e-26 * width_hz * 1e-4
    assert band.w_cm2_per_jy == pytest.approx(expected_w_cm2_per_jy, rel=FREQUENCY_WIDTH_RTOL[band.name], abs=0)


# --- spectral intervals ---

N_INTERVALS = (1, 2, 3, 6, 11, 12, 32)
COMB = Band("comb", [3.0, 3.1, 3.2, 7.0, 7.5, 7.6, 9.0], [0.0, 1.0, 0.0, 0.0, 0.2, 0.0, 0.3])  # with two gaps
SPECTRAL_BANDS = {
    **BANDS,
    "box": Band("box", [8.0, 12.0], [1.0, 1.0]),
    "narrow": Band("narrow", [8.0, 8.0 + 1e-9], [0.0, 1.0]),
    "two-decades": Band("wide", [1.0, 100.0], [1.0, 0.0]),
    "comb": COMB,
}


def exact_moments(band, centre_um, half_width_um, n):
    """Integrals of response times ((lambda - centre) / half width)^k [um] for k < n, in rational arithmetic."""
    nodes = [(Fraction(float(l)), Fraction(float(r))) for l, r in zip(band.wavelength_um, band.response, strict=True)]
    centre, half_width = Fraction(centre_um), Fraction(half_width_um)
    moments = [Fraction(0)] * n
    for (l0, r0), (l1, r1) in itertools.pairwise(nodes):
        t0, t1 = (l0 - centre) / half_width, (l1 - centre) / half_width
        slope = (r1 - r0) / (t1 - t0)
        for k in range(n):
            constant = (r0 - slope * t0) * (t1 ** (k + 1) - t0 ** (k + 1)) / (k + 1)
            moments[k] += (constant + slope * (t1 ** (k + 2) - t0 ** (k + 2)) / (k + 2)) * half_width
    return np.array([float(moment) for moment in moments])


@pytest.mark.ci
@pytest.mark.parametrize("n", N_INTERVALS)
@pytest.mark.parametrize("band", SPECTRAL_BANDS.values(), ids=list(SPECTRAL_BANDS))
def test_intervals_are_exact_for_polynomials_of_degree_2n_minus_1(band, n):
    wavelength_um, weight_um = band.intervals(n)
    low_um, high_um = float(band.wavelength_um[0]), float(band.wavelength_um[-1])
    half_width_um = (high_um - low_um) / 2
    moments = exact_moments(band, low_um, half_width_um, 2 * n)
    # From the lower end powers grow to 2^63: each is compared with itself, rounding of the place included.
    place = (wavelength_um - low_um) / half_width_um
    got = weight_um @ place[:, None] ** np.arange(2 * n)
    rounding = np.spacing(high_um) / half_width_um * np.arange(2 * n)
    assert (np.abs(got / moments - 1.0) <= MOMENT_RTOL + rounding).all()


@pytest.mark.parametrize("n", N_INTERVALS)
@pytest.mark.parametrize("band", SPECTRAL_BANDS.values(), ids=list(SPECTRAL_BANDS))
def test_intervals_lie_inside_the_band_with_positive_weights(band, n):
    wavelength_um, weight_um = band.intervals(n)
    assert wavelength_um.shape == weight_um.shape == (n,)
    assert (weight_um > 0.0).all()
    assert band.wavelength_um[0] <= wavelength_um[0]
    assert wavelength_um[-1] <= band.wavelength_um[-1]
    assert (np.diff(wavelength_um) > 0.0).all()
    assert not wavelength_um.flags.writeable
    assert not weight_um.flags.writeable


@pytest.mark.parametrize("n", [1, 6, 32])
def test_intervals_of_simple_responses_are_the_classical_rules(n):
    special = pytest.importorskip("scipy.special")
    for name, response, jacobi in (
        ("box", [1.0, 1.0], (0, 0)),
        ("ramp", [0.0, 1.0], (0, 1)),
        ("fall", [1.0, 0.0], (1, 0)),
    ):
        place, weight = special.roots_jacobi(n, *jacobi)
        wavelength_um, weight_um = Band(name, [8.0, 12.0], response).intervals(n)
        np.testing.assert_allclose(wavelength_um, 10.0 + 2.0 * place, rtol=1e-14, err_msg=name)
        scale_um = 2.0 if name == "box" else 1.0  # the Jacobi weight function reaches 2, a response 1
        np.testing.assert_allclose(weight_um, scale_um * weight, rtol=1e-11, err_msg=name)


@pytest.mark.parametrize("n", PLANCK_RTOL)
@pytest.mark.parametrize("name", list(BANDS))
def test_intervals_integrate_blackbodies(name, n, record_accuracy):
    temperature_k = np.geomspace(200.0, 6000.0, 40)
    wavelength_um, weight_um = BANDS[name].intervals(n)
    wavelength_m = wavelength_um * 1e-6
    h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23
    planck = 2 * h * c**2 / wavelength_m**5 / np.expm1(h * c / (wavelength_m * k * temperature_k[:, None]))
    error = np.abs(planck @ (weight_um * 1e-6) / band_radiance_w_m2_sr(temperature_k, name) - 1.0)
    assert error.max() < PLANCK_RTOL[n][name]
    if n == 6:
        record_accuracy("Six spectral intervals of a band, 200 to 6000 K", error.max(), SIX_RTOL, "of it", "whole band")


def test_one_interval_is_the_mean_wavelength():
    wavelength_um, weight_um = Band("triangle", [3.0, 4.0, 6.0], [0.0, 1.0, 0.0]).intervals(1)
    assert wavelength_um[0] == pytest.approx(13.0 / 3.0, rel=1e-15)
    assert weight_um[0] == pytest.approx(1.5, rel=1e-15)


@pytest.mark.parametrize("n", [0, -1, 33, 6.0, True, "6", None])
def test_bad_number_of_intervals_is_an_error(n):
    with pytest.raises(InputError) as error:
        BANDS["A"].intervals(n)
    assert str(error.value) == f"band A: n: must be a whole number from 1 to 32, got {n!r}"


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
        ([3.0, 3.0], [1.0, 1.0], "band x: wavelength_um: must increase, got 3 then 3"),
        ([4.0, 3.0], [1.0, 1.0], "band x: wavelength_um: must increase, got 4 then 3"),
        ([0.0, 3.0], [1.0, 1.0], "band x: wavelength_um: must be > 0, got 0"),
        ([3.0, np.nan], [1.0, 1.0], "band x: wavelength_um: must be finite, got nan at node 1"),
        ([3.0, 4.0], [np.inf, 1.0], "band x: response: must be finite, got inf at node 0"),
        ([3.0, 4.0], [-0.1, 1.0], "band x: response: must be >= 0, got -0.1"),
        ([3.0, 4.0], [0.0, 0.0], "band x: response: must be > 0 somewhere, got 0 everywhere"),
        ([3.0, 4.0], [1.0, 1.0, 1.0], "band x: response: must be as long as wavelength_um, got 3 and 2 nodes"),
        ([3.0], [1.0], "band x: wavelength_um: must be a vector of at least 2 nodes, got shape (1,)"),
        ("abc", [1.0, 1.0], "band x: wavelength_um: must be numbers, got str"),
    ],
)
def test_bad_band_is_an_error(wavelength_um, response, text):
    with pytest.raises(InputError) as error:
        Band("x", wavelength_um, response)
    assert str(error.value) == text


def test_band_needs_a_name():
    with pytest.raises(InputError, match=r"^band: name: must be a text"):
        Band("", [3.0, 4.0], [1.0, 1.0])


def test_quantities_are_converted():
    from astropy import units as u

    in_nm = Band("x", [450.0, 850.0] * u.nm, [50.0, 100.0] * u.percent)
    assert in_nm == Band("x", [0.45, 0.85], [0.5, 1.0])
    assert Band.top_hat("x", 450.0 * u.nm, 0.85) == Band.top_hat("x", 0.45, 0.85)
    product, peak = Band.from_curves("x", ([0.45, 0.85], [0.5, 0.5]), ([450.0, 850.0] * u.nm, [0.4, 0.4]))
    assert product.half_power_um == (0.45, 0.85)
    assert peak == pytest.approx(0.2)
    for make in (lambda: Band("x", [1.0, 2.0] * u.kg, [1.0, 1.0]), lambda: Band.top_hat("x", 1.0 * u.kg, 2.0)):
        with pytest.raises(InputError, match=r"_um: must be convertible to um, got kg$"):
            make()


def test_bands_print_on_one_line():
    assert repr(Band.top_hat("x", 3.5, 5.0, per_photon=True)) == "Band('x', 3.5 to 5 um, 2 nodes by photon)"


@pytest.mark.parametrize(
    ("numbers", "rule"),
    [
        ({"isophotal_um": 100.0}, r"isophotal_um: must be in \[3, 5\], got 100.0"),
        ({"half_power_um": (4.5, 3.5)}, r"half_power_um: must rise in \[3, 5\], got \(4.5, 3.5\)"),
        ({"half_power_um": (2.0, 4.0)}, r"half_power_um: must rise in \[3, 5\]"),
        ({"zero_mag_jy": -3.0}, r"zero_mag_jy: must be > 0 and finite, or NaN, got -3.0"),
        ({"zero_mag_w_cm2": np.inf}, r"zero_mag_w_cm2: must be > 0 and finite, or NaN, got inf"),
    ],
)
def test_numbers_of_a_band_are_possible(numbers, rule):
    with pytest.raises(InputError, match=rf"^band x: {rule}"):
        Band("x", [3.0, 4.0, 5.0], [0.0, 1.0, 0.0], **numbers)


# --- products of curves ---

FILTER = [0.40, 0.45, 0.85, 0.90], [0.0, 0.92, 0.92, 0.0]
EFFICIENCY = [0.35, 0.60, 0.80, 1.00], [0.4, 0.95, 0.75, 0.1]
MIRROR = np.linspace(0.3, 1.1, 801), np.full(801, 0.8)
PRODUCTS = {
    "filter, efficiency": (FILTER, EFFICIENCY),
    "with a mirror of many nodes": (FILTER, EFFICIENCY, MIRROR),
    "ramps": (([1.0, 2.0], [0.0, 1.0]), ([1.0, 2.0], [1.0, 0.0])),
    "tails": (([1.0, 2.0, 3.0], [1.0, 1e-5, 0.0]), ([2.0, 2.9, 4.0], [1e-4, 1e-3, 1.0])),
    "three ramps": (([1.0, 2.0], [0.0, 1.0]), ([1.0, 3.0], [0.2, 1.0]), ([0.5, 2.0], [1.0, 0.3])),
}


@pytest.mark.parametrize("curves", PRODUCTS.values(), ids=list(PRODUCTS))
def test_a_product_of_curves_is_within_its_error(curves):
    band, peak = Band.from_curves("x", *curves)
    at_um = np.linspace(*band.wavelength_um[[0, -1]], 200_001)
    product = np.prod([np.interp(at_um, *curve, left=0.0, right=0.0) for curve in curves], axis=0)
    assert peak == pytest.approx(product.max(), rel=PRODUCT_ERROR)
    found = np.interp(at_um, band.wavelength_um, band.response) * peak
    assert np.abs(found - product).max() <= PRODUCT_ERROR * product.max() * (1.0 + 1e-6)  # and rounding


def test_a_product_has_few_nodes():
    """Those of a parabola's chords: the square of their width is 8 errors over the second derivative."""
    n_piece = len(Band.from_curves("x", *PRODUCTS["ramps"])[0].response) - 1
    fewest = np.sqrt(2.0 / (8.0 * PRODUCT_ERROR * 0.25))  # over 1 um; the second derivative is 2
    assert fewest <= n_piece <= 1.05 * fewest
    plain, mirrored = (Band.from_curves("x", *PRODUCTS[name])[0] for name in list(PRODUCTS)[:2])
    assert len(mirrored.response) <= 1.05 * len(plain.response)
    assert len(Band.from_curves("x", FILTER, MIRROR)[0].response) == 4


@pytest.mark.parametrize(
    ("curves", "rule"),
    [
        (
            (([0.4, 0.9], [1.0, 1.0]), ([0.3, 2.0], [1.0, 1.0]), ([1.2, 2.0], [1.0, 1.0])),
            "must overlap, got curves[0] to 0.9 um and curves[2] from 1.2 um",
        ),
        ((([1, 2], [1, 1]), ([2, 3], [1, 1])), "must overlap, got curves[0] to 2 um and curves[1] from 2 um"),
        (
            (([1.0, 2.0, 3.0], [0.0, 0.0, 1.0]), ([0.5, 1.5], [1.0, 1.0])),
            "must have a product above 0, got 0 everywhere from 1 to 1.5 um, where curves[0] is 0",
        ),
        (
            (([1.0, 2.0, 3.0], [0.0, 0.0, 1.0]), ([1.0, 2.0, 3.0], [1.0, 0.0, 0.0])),
            "must have a product above 0, got 0 everywhere from 1 to 3 um",
        ),
        ((), "must be at least one"),
    ],
)
def test_curves_without_a_product_are_named(curves, rule):
    with pytest.raises(InputError) as error:
        Band.from_curves("x", *curves)
    assert str(error.value) == f"band x: curves: {rule}"


# --- zero points ---

ZERO_RTOL = 1e-12  # Gauss nodes on pieces of 2 %, against logarithms


@pytest.mark.parametrize("per_photon", [False, True])
def test_ab_zero_point_of_a_top_hat(per_photon):
    """3631 Jy over 3.5 to 5 um; by photon the energy response is wavelength / 5 um."""
    light_um_s = 299792458e6
    width_hz = light_um_s * (np.log(5.0 / 3.5) / 5.0 if per_photon else 1.0 / 3.5 - 1.0 / 5.0)
    band = Band.top_hat("x", 3.5, 5.0, per_photon=per_photon)
    assert band.ab_zero_mag_w_cm2 == pytest.approx(3631.0 * 1e-30 * width_hz, rel=ZERO_RTOL)
    assert np.isnan([band.zero_mag_jy, band.zero_mag_w_cm2, band.w_cm2_per_jy]).all()
    by_ab = Band("x", band.wavelength_um, band.response, per_photon=per_photon, zero_mag_jy=AB_ZERO_JY)
    assert by_ab.zero_mag_w_cm2 == band.ab_zero_mag_w_cm2
    assert by_ab.w_cm2_per_jy == band.flat_w_cm2_per_jy


def test_a_zero_point_follows_from_the_other():
    nodes = [3.0, 4.0, 5.0], [0.0, 1.0, 0.5]
    by_jy = Band("x", *nodes, zero_mag_jy=200.0)
    by_w_cm2 = Band("x", *nodes, zero_mag_w_cm2=by_jy.zero_mag_w_cm2)
    assert by_w_cm2.zero_mag_jy == pytest.approx(200.0, rel=ZERO_RTOL)
    assert Band("x", *nodes, zero_mag_jy=200.0, w_cm2_per_jy=1e-17).zero_mag_w_cm2 == 200.0 * 1e-17
    assert Band("x", *nodes, zero_mag_jy=200.0, zero_mag_w_cm2=4e-15).w_cm2_per_jy == 4e-15 / 200.0
    assert np.isnan(Band("x", *nodes, w_cm2_per_jy=1e-17).zero_mag_jy)


@pytest.mark.parametrize("zero", [{"zero_mag_jy": 3631.0}, {"zero_mag_w_cm2": 4e-15}], ids=str)
def test_makers_of_bands_take_zero_points(zero):
    hat = Band.top_hat("x", 3.5, 5.0, **zero)
    assert hat == Band("x", [3.5, 5.0], [1.0, 1.0], **zero)
    assert Band.from_curves("x", ([3.5, 5.0], [0.5, 0.5]), per_photon=False, **zero) == (hat, 0.5)
    with pytest.raises(InputError, match="band x: zero_mag_jy: must be > 0"):
        Band.top_hat("x", 3.5, 5.0, zero_mag_jy=0.0)


@pytest.mark.parametrize("name", ["W1", "W3", "J", "V", "Hp"])
def test_shipped_zero_points_are_of_the_same_definition(name):
    """The surveys that quote the mean over the band by frequency, but for the condensing of the curves."""
    band = bands()[name]
    plain = Band(name, band.wavelength_um, band.response, per_photon=band.per_photon, zero_mag_jy=band.zero_mag_jy)
    assert plain.zero_mag_w_cm2 == pytest.approx(band.zero_mag_w_cm2, rel=SHIPPED_ZERO_RTOL)


def test_stars_have_magnitudes_in_a_band_with_either_zero_point():
    stars = StarCatalog.from_arrays([10.0, 20.0], [5.0, 6.0], {"A": [5.0, 50.0]})
    nodes = [3.0, 4.0, 5.0], [0.0, 1.0, 0.5]
    by_jy = Band("x", *nodes, zero_mag_jy=200.0)
    magnitude = stars.magnitude(by_jy)
    np.testing.assert_allclose(10.0 ** (-0.4 * magnitude) * by_jy.zero_mag_w_cm2, stars.irradiance_w_cm2(by_jy))
    by_w_cm2 = Band("x", *nodes, zero_mag_w_cm2=by_jy.zero_mag_w_cm2)
    np.testing.assert_array_equal(stars.magnitude(by_w_cm2), magnitude)


def test_a_table_of_bands_with_numbers_for_names_is_refused():
    with pytest.raises(ws.InputError, match=r"Scene: band\.1: must be a table of fields, got 2"):
        ws.Scene.from_dict(ws.Scene.load("stss").to_dict() | {"band": {1: 2}})
