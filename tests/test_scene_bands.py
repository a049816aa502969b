"""Bands that a scene describes itself: sources, errors, round trips, and what a detector makes of them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy import integrate

import warpsim as ws
from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.detector.levels import electron_levels
from warpsim.radiometry.band import Band
from warpsim.scene.inputs import input_checksums

QUADRATURE_RTOL = 1e-9
"""scipy's own tolerance; both sides are exact otherwise."""

MWIR = {"half_power_um": [3.5, 5.0]}
CSV = "wavelength_nm,response\n3400,0\n3500,0.5\n4900,0.25\n5000,0\n"
REFLECTANCE = {f"targets__{k}__surface": {"reflectance": 0.9} for k in range(4)}


def stss(**changes):
    return ws.Scene.load("stss").replace(**REFLECTANCE, **changes)


def test_a_top_hat_has_its_edges_at_half_power():
    scene = stss(band={"mwir": MWIR}, bands=["A", "mwir"])
    band = scene.scenario.bands["mwir"]
    assert band == Band.top_hat("mwir", 3.5, 5.0)
    assert band.half_power_um == (3.5, 5.0)
    assert list(scene.scenario.bands) == ["A", "mwir"]


def test_sources_of_a_response(tmp_path):
    (tmp_path / "filter.csv").write_text(CSV)
    descriptions = {
        "nodes": {"wavelength_um": [3.4, 3.5, 4.9, 5.0], "response": [0.0, 2.0, 1.0, 0.0]},
        "file": {"file": str(tmp_path / "filter.csv")},
        "photons": {"file": str(tmp_path / "filter.csv"), "per_photon": True},
        "shipped": {"shipped": "C"},
        "object": ws.Band("object", [3.4, 3.5, 4.9, 5.0], [0.0, 2.0, 1.0, 0.0], zero_mag_jy=200.0),
    }
    bands = stss(band=descriptions, bands=list(descriptions)).scenario.bands
    for name in ("file", "photons", "object"):
        np.testing.assert_allclose(bands[name].wavelength_um, bands["nodes"].wavelength_um, rtol=1e-15)
        np.testing.assert_allclose(bands[name].response, bands["nodes"].response, rtol=1e-15)
    assert bands["photons"].per_photon and not bands["file"].per_photon
    assert bands["shipped"] == dataclasses.replace(ws.BANDS["C"], name="shipped")
    assert bands["object"].zero_mag_jy == 200.0


def test_band_objects_of_sensors_join_the_scene(tmp_path):
    mwir, lwir = ws.Band.top_hat("mwir", 3.5, 5.0, per_photon=True), ws.Band.top_hat("lwir", 8.0, 9.5)
    scene = stss(bands=[mwir, "A", lwir])
    assert scene.sensors[0].bands == ("mwir", "A", "lwir")
    assert scene.scenario.bands == {"mwir": mwir, "A": ws.BANDS["A"], "lwir": lwir}
    scene.save(tmp_path / "scene.toml")
    again = ws.Scene.load(tmp_path / "scene.toml")
    assert again == scene
    assert again.scenario.bands == scene.scenario.bands
    narrower = ws.Band.top_hat("mwir", 3.6, 4.9)
    assert scene.replace(bands=[narrower]).scenario.bands == {"mwir": narrower}
    sensor = dataclasses.replace(scene.sensors[0], bands=(mwir, ws.BANDS["A"]))
    assert scene.replace(sensors=[sensor]).sensors[0].bands == ("mwir", "A")


def test_two_objects_of_a_name_must_agree():
    sensor = ws.Scene.load("stss").sensors[0]
    sensors = [
        dataclasses.replace(sensor, name=name, bands=(ws.Band.top_hat("x", 3.0, upper_um),))
        for name, upper_um in (("a", 5.0), ("b", 5.1))
    ]
    with pytest.raises(ws.InputError, match=r"bands: must be one band a name, got two of x$"):
        stss(sensors=sensors)


def test_files_travel_with_the_scene_and_identify_it(tmp_path):
    path = tmp_path / "filter.csv"
    path.write_text(CSV)
    scene = stss(band={"x": {"file": str(path)}}, bands=["x"])
    scene.save(tmp_path / "scene.toml")
    assert 'file = "filter.csv"' in (tmp_path / "scene.toml").read_text()
    assert ws.Scene.load(tmp_path / "scene.toml") == scene
    before = input_checksums(scene.scenario)
    assert list(before) == [str(path)]
    path.write_text(CSV.replace("0.25", "0.26"))
    assert input_checksums(stss(band={"x": {"file": str(path)}}, bands=["x"]).scenario) != before


def test_a_scene_opens_no_file_of_a_band(tmp_path):
    scene = stss(band={"x": {"file": str(tmp_path / "none.csv")}}, bands=["x"])
    with pytest.raises(ws.InputError, match=r"^band.x: .*none.csv: cannot be read: No such file or directory$"):
        _ = scene.scenario


@pytest.mark.parametrize(
    ("band", "words"),
    [
        ({}, r"band.x: half_power_um, wavelength_um, file, shipped: exactly one must be given, got none"),
        ({**MWIR, "shipped": "A"}, r"band.x: .*exactly one must be given, got half_power_um, shipped$"),
        ({"half_power_um": [5.0, 3.5]}, r"band.x.half_power_um: must increase"),
        ({"half_power_um": [3.5]}, r"band.x.half_power_um"),
        ({"half_power_um": [0.2, 0.5]}, r"band.x.half_power_um: must lie within 0.3 to 30 um, got 0.2 to 0.5 um$"),
        ({"half_power_um": [20.0, 40.0]}, r"band.x.half_power_um: must lie within 0.3 to 30 um, got 20 to 40 um$"),
        ({"wavelength_um": [3.0, 4.0]}, r"band.x: wavelength_um, response: must be given together"),
        ({"wavelength_um": [3, 4], "response": [0, 0]}, r"band.x.response: must be > 0 somewhere, got 0 everywhere"),
        ({"wavelength_um": [4, 3], "response": [1, 1]}, r"band.x.wavelength_um: must increase, got 4 then 3"),
        ({"wavelength_um": [3, math.nan], "response": [1, 1]}, r"band.x.wavelength_um\[1\]: must be finite, got nan"),
        ({"wavelength_um": [3, 4], "response": [1, math.nan]}, r"band.x.response\[1\]: must be finite, got nan"),
        ({"wavelength_um": [3, 4], "response": [1, -1]}, r"band.x.response: must be >= 0, got -1"),
        ({"wavelength_um": [3, 4, 5], "response": [1, 1]}, r"band.x.response: must be as long as wavelength_um"),
        ({"shipped": "Z"}, r"band.x.shipped: must be a shipped band \(.*\), got 'Z'$"),
        ({"shipped": "A", "per_photon": True}, r"band.x.per_photon: must be left out with shipped"),
        (
            {"wavelength_um": [0.25, 0.4, 0.8], "response": [0, 1, 1]},
            r"band.x.response: must be 0 outside 0.28",
        ),
        ({"half_power": [3, 4]}, r"band.x.half_power: is not a known field \(did you mean half_power_um\?\)"),
    ],
)
def test_bad_descriptions_give_one_line(band, words):
    with pytest.raises(ws.InputError, match=words) as caught:
        stss(band={"x": band}, bands=["x"])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bands": ["mwri"], "band": {"mwir": MWIR}}, r"bands\[0\]: must be one of the scene's \(mwir\) or a shipped "),
        ({"bands": ["mwri"], "band": {"mwir": MWIR}}, r"\(did you mean mwir\?\), got 'mwri'$"),
        ({"band": {"A": MWIR}}, r"band.A: must be no shipped band's name$"),
        ({"band": {"a/b": MWIR}}, r"band: must be names of letters"),
        ({"band": {"x": Band.top_hat("x", 0.2, 0.4)}, "bands": ["x"]}, r"band.x.half_power_um: must lie within 0.3"),
        ({"band": 3, "bands": [Band.top_hat("x", 3, 4)]}, r"band: must be a table of bands by name"),
        ({"band": {"y": Band.top_hat("x", 3, 4)}}, r"band.y: must be the band's own name, x$"),
        ({"detector__nei_w_cm2": {"A": 1e-18, "Q": 1e-18}}, r"detector.nei_w_cm2: must be a shipped .*, got 'Q'$"),
        ({"lighting__earth_k": {"Q": 250.0}}, r"lighting.earth_k: must be a shipped band .*, got 'Q'$"),
        ({"lighting__sun_w_cm2": {"Q": 1e-3}}, r"lighting.sun_w_cm2: must be a shipped band .*, got 'Q'$"),
        ({"targets__0__surface": {"reflectance": {"A": 0.9, "C": 0.9, "Q": 0.1}}}, r"targets\[0\].surface.reflectance"),
    ],
)
def test_names_of_bands_are_those_of_the_scene(changes, words):
    scene = ws.Scene.load("stss")
    with pytest.raises(ws.InputError, match=words) as caught:
        scene.replace(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("per_photon", [False, True])
def test_electrons_count_photons_over_the_response(per_photon):
    """Electrons are the integral of photons times quantum efficiency, whatever the spectrum."""
    wavelength_um, response = np.array([0.4, 0.45, 0.7, 0.9]), np.array([0.0, 0.8, 1.0, 0.3])
    band = Band("x", wavelength_um, response, per_photon=per_photon)
    peak = 0.6
    detector = ws.ElectronDetector(0.1, 1e6, 10.0, quantum_efficiency=peak)
    scene = ws.Scene.load("stss")
    camera, optics = scene.camera, scene.optics
    area_cm2 = 1e4 * math.pi / 4 * optics.aperture_m**2
    found = electron_levels(detector, optics, camera, band)

    def efficiency(um):
        shape = np.interp(um, wavelength_um, response)
        if not per_photon:
            shape = shape / um / np.max(response / wavelength_um)  # its peak is at a node
        return peak * shape

    def spectra(um):
        return {"flat": 1e-14, "steep": 1e-14 * um**-4, "red": 1e-14 * um**6}

    def integral(function):
        return integrate.quad(function, 0.4, 0.9, points=wavelength_um[1:3], epsabs=0, epsrel=1e-11)[0]

    for kind in spectra(1.0):
        photons = integral(
            lambda um, kind=kind: spectra(um)[kind] * efficiency(um) * um * 1e-6 / (PLANCK_J_S * SPEED_OF_LIGHT_M_S)
        )
        in_band_w_cm2 = integral(lambda um, kind=kind: spectra(um)[kind] * band.energy_response(um))
        assert in_band_w_cm2 * found.e_per_w_cm2 == pytest.approx(
            photons * area_cm2 * detector.exposure_s, rel=QUADRATURE_RTOL
        )


def test_another_name_of_a_shipped_band_is_the_same_band():
    scene = stss(band={"z": {"shipped": "A"}}, bands=["A", "z"])
    (first, other), lighting = scene.scenario.bands.values(), scene.lighting
    for value in (lighting.earth_k_in, lighting.earth_albedo_in, lighting.sun_w_m2_in):
        assert value(other) == value(first)


def test_the_papers_physics_knows_its_own_bands_only():
    with pytest.raises(ws.InputError, match=r"bands\[1\]: must be one of .*E with sky.physics = 'paper', got 'W1'$"):
        stss(bands=["A", "W1"], sky__physics="paper")
