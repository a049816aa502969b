"""Shipped bands and their zero points."""

import dataclasses
import itertools
import os
import subprocess
import sys
from pathlib import Path

import astropy.units as u
import build_responses
import list_responses
import numpy as np
import pytest
from build_responses import MissingPackageError, read_spectrum, source_path
from condense_curve import BLACKBODY_K, blackbodies
from response_oracles import (
    DATA,
    FACTS,
    GENERIC,
    JY_W_CM2_HZ,
    MSX,
    SURVEYS,
    dense,
    hertz,
    nodes,
    planck_w_m2_sr_um,
    shipped,
)
from scipy.integrate import quad

import warpsim as ws

TOP = Path(__file__).parents[1]

QUADRATURE_RTOL = 1e-6  # asked for; scipy's rule is good to 1e-9, the library's to 1e-12
CONDENSING_TOLERANCE = 1e-3  # of the recipe
MSX_CONDENSING_TOLERANCE = 3e-3  # its nodes are older


def test_names_and_order():
    assert tuple(ws.BANDS) == MSX and len(ws.BANDS) == 6
    assert tuple(ws.bands()) == tuple(FACTS) and len(ws.bands()) == 31
    assert ws.BANDS["A"] is ws.bands()["A"]
    assert "W1" in ws.bands() and "W1" not in ws.BANDS and 1 not in ws.bands()
    with pytest.raises(KeyError, match="no band of name 'N'; there are B1, B2, A"):
        ws.bands()["N"]


def test_names_stand_for_bands():
    assert ws.band_radiance_w_m2_sr(300.0, "LWIR") == ws.band_radiance_w_m2_sr(300.0, ws.bands()["LWIR"])
    with pytest.raises(ws.InputError, match=r"must be one of B1, B2, .* W1, .* LWIR or a Band"):
        ws.band_radiance_w_m2_sr(300.0, "N")


def test_import_reads_no_data():
    code = """
import sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
import warpsim, warpsim.radiometry.bands as bands
bands.bands(), bands.BANDS, list(bands.BANDS), "A" in bands.BANDS
assert not any("responses_v1" in name for name in opened), opened
bands.BANDS["A"]
assert any("responses_v1" in name for name in opened)
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


def test_msx_bands_are_those_of_their_calibration():
    expected = {
        "B1": (4.29, (4.22, 4.36), 194.6, 3.30e-16, 1.70e-18),
        "B2": (4.35, (4.24, 4.45), 188.8, 5.4e-16, 2.87e-18),
        "A": (8.28, (6.8, 10.8), 58.49, 8.196e-16, 1.401e-17),
        "C": (12.13, (11.1, 13.2), 26.51, 9.26e-17, 3.493e-18),
        "D": (14.65, (13.5, 15.9), 18.29, 5.69e-17, 3.109e-18),
        "E": (21.34, (18.2, 25.1), 8.80, 3.55e-17, 4.04e-18),
    }
    for name, numbers in expected.items():
        band = ws.BANDS[name]
        zero_point = (band.zero_mag_jy, band.zero_mag_w_cm2, band.w_cm2_per_jy)
        assert (band.isophotal_um, band.half_power_um, *zero_point) == numbers and not band.per_photon
    published = (TOP / "catalogs" / "published_responses" / "msx.csv").read_text().splitlines()
    assert DATA.joinpath("responses_v1.csv").read_text().splitlines()[: len(published)] == published


@pytest.mark.parametrize("name", FACTS)
def test_facts_are_there_and_in_range(name):
    band, facts = ws.bands()[name], FACTS[name]
    assert all(len(facts[key]) >= 5 for key in ("title", "source", "licence"))
    assert facts["condensing_error"] <= (MSX_CONDENSING_TOLERANCE if name in MSX else CONDENSING_TOLERANCE)
    low_um, high_um = band.half_power_um
    assert 0.3 <= low_um < band.isophotal_um < high_um <= 30.0  # the range of this library
    assert band.response.max() == 1.0 and band.name == name and band.per_photon == facts["per_photon"]
    if name in GENERIC:
        assert np.isnan([band.zero_mag_jy, band.zero_mag_w_cm2, band.w_cm2_per_jy]).all()
    else:
        assert len(facts["zero_point_source"]) > 5 and facts["flux"] in ("mean", "nominal")
        rounding = 5e-3 if name in MSX else 1e-12  # of the figures that MSX printed
        assert band.w_cm2_per_jy == pytest.approx(band.zero_mag_w_cm2 / band.zero_mag_jy, rel=rounding)


@pytest.mark.parametrize("name", FACTS)
def test_radiance_is_the_integral_of_the_curve(name, record_accuracy):
    """scipy's adaptive rule over every piece of the shipped curve."""
    wavelength_um, response = nodes(name)
    per_photon = FACTS[name]["per_photon"]
    # Response times wavelength, a parabola in each piece, has its peak at a node or between two.
    at_um = dense((wavelength_um, response), per_photon, 4096)[0]
    peak = np.max(np.interp(at_um, wavelength_um, response) * at_um**per_photon)
    for temperature_k in (300.0, 1000.0, 5800.0):

        def integrand(um, temperature_k=temperature_k):
            return np.interp(um, wavelength_um, response) * um**per_photon * planck_w_m2_sr_um(um, temperature_k)

        pieces = itertools.pairwise(wavelength_um)
        total = sum(quad(integrand, *piece, epsabs=0.0, epsrel=1e-9)[0] for piece in pieces) / peak
        error = abs(ws.band_radiance_w_m2_sr(temperature_k, name) / total - 1.0)
        record_accuracy("Band radiance, 31 shipped bands, 300 to 5800 K", error, QUADRATURE_RTOL, "of it", "scipy")


CURVES_OF_PACKAGES = tuple(name for name in SURVEYS if "; via " in FACTS[name]["source"])
TRAPEZOID_RTOL = 1e-5  # of 256 steps a piece, at an exponent of 20


@pytest.mark.parametrize("name", CURVES_OF_PACKAGES)
def test_blackbodies_keep_their_light(name):
    """Against a trapezoid rule over the full published curve: no worse than stated."""
    definitions, sha256 = build_responses.read_definitions()
    try:
        curve = build_responses.published_curve(name, definitions[name], sha256)
    except MissingPackageError as missing:
        pytest.skip(str(missing))
    at_um, response, weight_um = dense(curve, FACTS[name]["per_photon"])
    temperature_k = np.array(list(blackbodies(ws.bands()[name].half_power_um[1]).values()))
    assert 5 <= len(temperature_k) <= len(BLACKBODY_K)
    full = [np.sum(response * weight_um * planck_w_m2_sr_um(at_um, t)) for t in temperature_k]
    stated = FACTS[name]["condensing_error"] + TRAPEZOID_RTOL
    np.testing.assert_allclose(ws.band_radiance_w_m2_sr(temperature_k, name), full, rtol=stated)


def test_recipe_makes_the_shipped_bytes():
    try:
        texts = build_responses.build()
    except MissingPackageError as missing:
        pytest.skip(str(missing))
    assert texts == tuple(DATA.joinpath(f"responses_v1.{suffix}").read_text() for suffix in ("csv", "toml"))


def test_table_and_listing():
    table = ws.bands().to_table()
    assert list(table["name"]) == list(FACTS) and str(table["zero_mag_w_cm2"].unit) == "W / cm2"
    row = table[list(FACTS).index("IRAC1")]
    assert (row["flux"], row["nominal_um"], row["per_photon"]) == ("nominal", 3.55, True)
    assert np.isnan(table["zero_mag_jy"][-3:]).all() and len(ws.BANDS.to_table()) == 6
    assert repr(ws.bands()).splitlines()[7] == "  W1       2.99 -  3.78 um  WISE W1"


def test_page_of_the_bands_is_up_to_date():
    page = (TOP / "docs" / "reference" / "bands.md").read_text().splitlines()
    for lines in (list_responses.number_lines(), list_responses.source_lines()):
        start = page.index(lines[0])
        assert page[start : start + len(lines)] == lines, "run catalogs/list_responses.py"


# From the papers that the bands' facts name. IRAS: 28.3 and 6.73 Jy times the colour corrections of 10,000 K.
PUBLISHED_JY = {
    "W1": 309.540,
    "W2": 171.787,
    "W3": 31.674,
    "W4": 8.363,
    "IRAC1": 280.9,
    "IRAC2": 179.7,
    "IRAC3": 115.0,
    "IRAC4": 64.13,
    "S9W": 56.262,
    "L18W": 12.001,
    "IRAS12": 28.3 * 1.45,
    "IRAS25": 6.73 * 1.41,
    "G": 3630.7805 * 10 ** (-0.4 * (25.8010446445 - 25.6873668671)),
    "BP": 3630.7805 * 10 ** (-0.4 * (25.3539555559 - 25.3385422158)),
    "RP": 3630.7805 * 10 ** (-0.4 * (25.1039837393 - 24.7478955012)),
    "B": 4063.0,
    "V": 3636.0,
    "Ic": 2416.0,
    "J": 1594.0,
    "H": 1024.0,
    "Ks": 666.7,
}
DIGITS_RTOL = 2e-6  # those of Gaia are kept to six digits


@pytest.mark.parametrize("name", PUBLISHED_JY)
def test_zero_points_are_the_published_ones(name):
    assert ws.bands()[name].zero_mag_jy == pytest.approx(PUBLISHED_JY[name], rel=DIGITS_RTOL)


# In-band irradiance of magnitude 0 [W/cm2]: Jarrett et al. 2011, Cohen et al. 2003, from the same curves. The error is
# that of four digits (2MASS) and of the condensing.
PUBLISHED_W_CM2 = {
    "W1": 5.4188e-15,
    "W2": 2.5172e-15,
    "W3": 3.5878e-16,
    "W4": 2.0876e-17,
    "J": 5.082e-14,
    "H": 2.843e-14,
    "Ks": 1.122e-14,
}
IN_BAND_RTOL = 1e-3


@pytest.mark.parametrize("name", PUBLISHED_W_CM2)
def test_in_band_irradiance_of_magnitude_zero(name, record_accuracy):
    """Decides between photon and energy, too: a curve taken the other way is off by 1 to 16 %."""
    error = ws.bands()[name].zero_mag_w_cm2 / PUBLISHED_W_CM2[name] - 1.0
    assert abs(error) < IN_BAND_RTOL
    record_accuracy("Irradiance of magnitude 0, WISE and 2MASS", abs(error), IN_BAND_RTOL, "of it", "published figures")


# Widths that turn quoted IRAS flux densities into irradiances (Sanders & Mirabel 1996, ARA&A 34, 749) [Hz]; they come
# from finer curves than the printed ones.
IRAS_HZ = {"IRAS12": 13.48e12, "IRAS25": 5.16e12}
IRAS_RTOL = 3e-3

SUM_RTOL = 1e-5  # trapezoid rule, and six digits
MSX_PRINTED_RTOL = 0.01  # MSX's own figures, of three digits and from its full curves


@pytest.mark.parametrize("name", SURVEYS)
def test_irradiance_per_jansky(name):
    per_jy = ws.bands()[name].w_cm2_per_jy
    assert per_jy == pytest.approx(hertz(name) * JY_W_CM2_HZ, rel=MSX_PRINTED_RTOL if name in MSX else SUM_RTOL)
    if name in IRAS_HZ:
        assert per_jy == pytest.approx(IRAS_HZ[name] * JY_W_CM2_HZ, rel=IRAS_RTOL)


# Published over synthetic zero point, less 1; the synthetic one from Vega's CALSPEC spectrum (Gaia: from the spectrum
# that its zero points were made with). Beyond 3 um the surveys rest on Cohen's Vega, 2 % brighter; the rest are their
# own corrections, told in docs/reference/bands.md.
VEGA_DIFFERENCE = {
    **dict.fromkeys(("B1", "B2", "A", "C", "D", "E", "W1", "W2", "W3", "IRAC2", "IRAC3", "S9W", "Ks"), 0.019),
    **dict.fromkeys(("J", "H"), 0.013),
    **dict.fromkeys(("IRAC1", "L18W"), 0.029),
    **dict.fromkeys(("Hp", "B", "V", "Ic"), -0.0245),
    **dict.fromkeys(("G", "BP", "RP"), 0.0),
    "IRAC4": 0.0247,
    "W4": 0.0477,
    "IRAS12": 0.0443,
    "IRAS25": 0.0868,
}
VEGA_ATOL = 1.5e-3  # what the groups above differ by among themselves


@pytest.mark.parametrize("name", SURVEYS)
def test_difference_from_vega(name):
    difference = ws.bands()[name].zero_mag_jy / FACTS[name]["vega_jy"] - 1.0
    assert difference == pytest.approx(VEGA_DIFFERENCE[name], abs=VEGA_ATOL)


LINES_RTOL = 2e-4  # the recipe's steps, and these, over the hydrogen lines of the spectrum


@pytest.mark.parametrize("name", SURVEYS)
def test_flux_density_of_vega(name):
    """The synthetic zero point once more, by a trapezoid rule over the shipped nodes and the spectrum."""
    definitions, sha256 = build_responses.read_definitions()
    fields = definitions[name]
    try:
        spectrum = read_spectrum(source_path(fields["vega"], sha256))
    except MissingPackageError as missing:
        pytest.skip(str(missing))
    at_um, response, weight_um = shipped(name)
    irradiance = np.interp(at_um, *spectrum) * 10.0 ** (0.4 * fields["vega_mag"])
    if name in ("G", "BP", "RP"):
        irradiance *= 3.62286e-12 / np.interp(0.55, *spectrum)  # W/cm2/um at 550 nm, Riello et al. 2021
    flux_jy = np.sum(irradiance * response * weight_um) / (hertz(name) * JY_W_CM2_HZ)
    assert FACTS[name]["vega_jy"] == pytest.approx(flux_jy, rel=LINES_RTOL)


def moment(name, power):
    """Integral of energy response times wavelength^power."""
    at_um, response, weight_um = shipped(name)
    return np.sum(response * weight_um * at_um**power)


def test_wise_effective_wavelengths():
    """Of nu F_nu = constant, about which the response does not change with the slope (Wright et al. 2010, to 1 nm)."""
    for name, published_um in {"W1": 3.368, "W2": 4.618, "W3": 12.082, "W4": 22.194}.items():
        at_um, response, weight_um = shipped(name)
        weight = response * weight_um / at_um  # by photon
        assert np.exp(np.sum(weight * np.log(at_um)) / np.sum(weight)) == pytest.approx(published_um, abs=1.5e-3)


def test_gaia_pivot_wavelengths():
    """Those of the SVO filter profile service, from the same curves."""
    for name, published_um in {"G": 0.621759, "BP": 0.510971, "RP": 0.776902}.items():
        assert np.sqrt(moment(name, 0.0) / moment(name, -2.0)) == pytest.approx(published_um, rel=3e-4)


def test_irac_nominal_wavelengths():
    """Reach et al. 2005, from the curves of 2004; those averaged over the array since are up to 0.36 % off."""
    for name, published_um in {"IRAC1": 3.550, "IRAC2": 4.493, "IRAC3": 5.731, "IRAC4": 7.872}.items():
        assert moment(name, -1.0) / moment(name, -2.0) == pytest.approx(published_um, rel=4e-3)


def test_akari_isophotal_wavelengths():
    """Ishihara et al. 2010, for stars; here for F_lambda ~ lambda^-4."""
    for name, published_um in {"S9W": 8.61, "L18W": 18.39}.items():
        assert (moment(name, -4.0) / moment(name, 0.0)) ** -0.25 == pytest.approx(published_um, rel=0.01)


def test_isophotal_flux_densities():
    """Mean over wavelength of magnitude 0 [W/cm2/um]: Jarrett et al. 2011; Cohen et al. 2003, with rounded widths."""
    published = {"W1": 8.1787e-15, "W2": 2.4150e-15, "W3": 6.5151e-17, "W4": 5.0901e-18}
    published |= {"J": 3.129e-13, "H": 1.133e-13, "Ks": 4.283e-14}
    for name, w_cm2_um in published.items():
        rtol = IN_BAND_RTOL if name.startswith("W") else 3e-3
        assert ws.bands()[name].zero_mag_w_cm2 / moment(name, 0.0) == pytest.approx(w_cm2_um, rel=rtol)


@pytest.mark.parametrize(
    "given", [{"zero_mag_jy": 3631.0}, {"zero_mag_w_cm2": 2e-13}, {"zero_mag_jy": 300.0, "w_cm2_per_jy": 3e-16}]
)
def test_a_saved_zero_point_can_be_changed(scene, tmp_path, given):
    band = ws.Band("q", [3.0, 3.3, 4.7, 5.0], [0.0, 1.0, 0.9, 0.0], **given)
    saved = scene.replace(bands=[band], detector={"kind": "nei", "nei_w_cm2": 1e-18, "sei_w_cm2": 1e-14})
    saved.save(tmp_path / "scene.toml")
    assert ws.Scene.load(tmp_path / "scene.toml").scenario.bands["q"] == band
    name = next(iter(given))
    brighter = saved.replace(**{f"band__q__{name}": 2.0 * given[name]})
    star = ws.StarCatalog.default()
    fainter_mag = star.magnitude(brighter.scenario.bands["q"])[:3] - star.magnitude(band)[:3]
    np.testing.assert_allclose(fainter_mag, 2.5 * np.log10(2.0), rtol=0, atol=1e-9)


def test_a_zero_point_that_contradicts_itself_is_refused():
    with pytest.raises(ws.InputError, match=r"band q: zero_mag_w_cm2: must be zero_mag_jy times w_cm2_per_jy, 10,"):
        ws.Band("q", [3.0, 4.0], [1.0, 1.0], zero_mag_jy=10.0, zero_mag_w_cm2=1e-10, w_cm2_per_jy=1.0)
    band = ws.Band.top_hat("q", 3.0, 4.0, zero_mag_jy=3631.0)
    with pytest.raises(ws.InputError, match="leave out one of them"):
        dataclasses.replace(band, zero_mag_jy=300.0)


def test_numbers_of_a_band_take_units():
    plain = ws.Band("q", [3.0, 5.0], [1.0, 1.0], 3.9, (3.2, 4.8), 3631.0)
    with_units = ws.Band("q", [3.0, 5.0], [1.0, 1.0], 3900 * u.nm, [3.2, 4.8] * u.um, 3.631 * u.kJy)
    for name in ("isophotal_um", "half_power_um", "zero_mag_jy", "zero_mag_w_cm2"):
        np.testing.assert_allclose(getattr(with_units, name), getattr(plain, name), rtol=1e-14)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"zero_mag_jy": "3631"}, "zero_mag_jy: must be a number, got '3631'"),
        ({"zero_mag_jy": True}, "zero_mag_jy: must be a number, got True"),
        ({"isophotal_um": None}, "isophotal_um: must be a number, got None"),
        ({"zero_mag_jy": 3.0 * u.um}, "zero_mag_jy: must be convertible to Jy, got um"),
        ({"half_power_um": 3.5}, "half_power_um: must be two numbers, got 3.5"),
        ({"half_power_um": (np.nan, 3.5)}, "half_power_um: must be two numbers, or left out"),
    ],
)
def test_numbers_of_a_band_that_are_none(given, message):
    with pytest.raises(ws.InputError, match=f"band q: {message}"):
        ws.Band("q", [3.0, 5.0], [1.0, 1.0], **given)


@pytest.mark.parametrize("name", ["zero_mag_jy", "zero_mag_w_cm2", "w_cm2_per_jy"])
def test_zero_points_of_zero_are_refused(name):
    given = {"zero_mag_jy": 10.0, "zero_mag_w_cm2": 1e-15, "w_cm2_per_jy": 1e-16, name: 0.0}
    with pytest.raises(ws.InputError, match=f"band q: {name}: must be > 0 and finite, or NaN, got 0"):
        ws.Band("q", [3.0, 4.0], [1.0, 1.0], **given)
