"""The bands that ship with warpsim: the mapping, in-band integrals, the recipe and the page about them."""

import itertools
import os
import subprocess
import sys
from pathlib import Path

import build_responses
import list_responses
import numpy as np
import pytest
from condense_curve import BLACKBODY_K, blackbodies
from published_curves import MissingPackageError
from response_oracles import DATA, FACTS, GENERIC, MSX, SURVEYS, dense, nodes, planck_w_m2_sr_um
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
