"""Bands that a scene describes itself: sources, errors, round trips, and what a detector makes of them."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate

import warpsim as ws
from warpsim.constants import PLANCK_J_S, SPEED_OF_LIGHT_M_S
from warpsim.detector.levels import electron_levels
from warpsim.files import sha256_of
from warpsim.radiometry.band import Band
from warpsim.radiometry.curve_nodes import PRODUCT_ERROR
from warpsim.scene.provenance import input_checksums
from warpsim.scene.scenario import Scenario

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


@pytest.mark.parametrize(
    ("band", "fields"),
    [
        (Band.top_hat("x", 3.5, 5.0, per_photon=True), {"half_power_um": [3.5, 5.0], "per_photon": True}),
        (Band("x", [3.5, 5.0], [1, 1], zero_mag_jy=200.0), None),
        (Band("x", [3.5, 5.0], [1, 1], half_power_um=(3.6, 4.9)), None),
        (Band("x", [3.5, 5.0], [1, 0.5]), {"wavelength_um": [3.5, 5.0], "response": [1.0, 0.5], "per_photon": False}),
        (Band("x", [3.0, 4.0, 5.0], [0.0, 2.0, 0.0], half_power_um=(3.4, 4.7), isophotal_um=4.1), None),
        (Band("x", [3.0, 4.0, 5.0], [0.0, 2.0, 0.0], zero_mag_w_cm2=1e-15, per_photon=True), None),
        (dataclasses.replace(ws.bands()["W1"], name="x"), None),
    ],
    ids=["top-hat", "with-zero-point", "other-points", "slope", "wavelengths", "photon", "shipped"],
)
def test_objects_are_saved_and_loaded_as_they_are(tmp_path, band, fields):
    scene = stss(bands=[band])
    scene.save(tmp_path / "scene.toml")
    assert ws.Scene.load(tmp_path / "scene.toml").scenario.bands == {"x": band}
    if fields is not None:
        assert scene.to_dict()["band"]["x"] == fields


def test_half_power_points_may_stand_beside_a_file(tmp_path):
    (tmp_path / "filter.csv").write_text(CSV)
    entry = {"file": str(tmp_path / "filter.csv"), "half_power_um": [3.5, 4.8]}
    assert stss(band={"x": entry}, bands=["x"]).scenario.bands["x"].half_power_um == (3.5, 4.8)


@pytest.mark.parametrize(
    "entry", [{"half_power_um": [3.5, 5.1]}, {"shipped": "W1"}, {"file": "filter.csv"}, Band.top_hat("x", 3.5, 5.1)]
)
def test_an_object_must_agree_with_a_description_of_its_name(entry):
    with pytest.raises(ws.InputError, match=r"^Scene: band.x: must be the Band of that name in bands, or be left out$"):
        stss(band={"x": entry}, bands=[Band.top_hat("x", 3.5, 5.0)])
    nodes = {"wavelength_um": [3.5, 5.0], "response": [2.0, 2.0]}
    for same in (nodes, {"half_power_um": [3.5, 5.0]}, Band.top_hat("x", 3.5, 5.0)):
        assert list(stss(band={"x": same}, bands=[Band.top_hat("x", 3.5, 5.0)]).scenario.bands) == ["x"]
    with pytest.raises(ws.InputError, match=r"^Scene: band.x.half_power_um: must increase"):
        stss(band={"x": {"half_power_um": [5.0, 3.5]}}, bands=[Band.top_hat("x", 3.5, 5.0)])


def test_a_changed_object_replaces_the_band_of_its_name_unless_others_have_it():
    wide, narrow = Band.top_hat("x", 3.5, 5.0), Band.top_hat("x", 3.6, 4.9)
    sensor = ws.Scene.load("stss").sensors[0]
    scene = stss(sensors=[dataclasses.replace(sensor, name=name, bands=(wide,)) for name in "ab"])
    with pytest.raises(ws.InputError, match=r"band.x: must be the Band of that name in bands, or be left out$"):
        scene.replace(sensors__0__bands=[narrow])
    both = scene.replace(sensors__0__bands=[narrow], sensors__1__bands=[narrow])
    assert both.scenario.bands == {"x": narrow}


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


def test_the_checksum_is_that_of_the_file_as_it_was_read(tmp_path):
    path = tmp_path / "filter.csv"
    path.write_text(CSV)
    scene = stss(band={"x": {"file": str(path)}}, bands=["x"])
    band = scene.scenario.bands["x"]
    path.write_text(CSV.replace("0.25", "0.26"))
    assert input_checksums(scene.scenario) == {str(path): hashlib.sha256(CSV.encode()).hexdigest()}
    assert Scenario(scene).bands["x"] == band  # a description keeps what it has read


def test_files_are_multiplied(tmp_path):
    curves = {
        "filter.csv": ([3.4, 3.5, 4.9, 5.0], [0.0, 0.9, 0.9, 0.0]),
        "qe.csv": ([3.0, 4.5, 5.5], [0.4, 0.8, 0.2]),
    }
    for name, (wavelength_um, values) in curves.items():
        rows = [f"{um},{value * 100}" for um, value in zip(wavelength_um, values, strict=True)]
        (tmp_path / name).write_text("\n".join(["wavelength_um,value [%]", *rows, ""]))
    paths = [str(tmp_path / name) for name in curves]
    scene = stss(band={"x": {"files": paths, "per_photon": True}}, bands=["x"])
    scene.save(tmp_path / "scene.toml")
    assert 'files = ["filter.csv", "qe.csv"]' in (tmp_path / "scene.toml").read_text()
    scene = ws.Scene.load(tmp_path / "scene.toml")
    expected, _ = Band.from_curves("x", *curves.values())
    found, at_um = scene.scenario.bands["x"], np.linspace(3.4, 5.0, 1000)
    np.testing.assert_allclose(
        np.interp(at_um, found.wavelength_um, found.response),
        np.interp(at_um, expected.wavelength_um, expected.response),
        rtol=0,
        atol=2 * PRODUCT_ERROR,
    )
    assert input_checksums(scene.scenario) == {path: sha256_of(Path(path)) for path in paths}
    (tmp_path / "qe.csv").write_text("wavelength_um,value\n6,1\n7,1\n")
    with pytest.raises(
        ws.InputError, match=r"band.x.files: must overlap, got .*filter.csv to 5 um and .*qe.csv from 6 um$"
    ):
        _ = ws.Scene.load(tmp_path / "scene.toml").scenario


def test_a_table_bands_beside_sensors_is_hinted_at():
    data = ws.Scene.load("stss").to_dict()
    with pytest.raises(ws.InputError, match=r"bands: must not be given beside sensors, .* \(did you mean band\?\)$"):
        ws.Scene.from_dict({**data, "bands": {"mwir": MWIR}})


def test_a_scene_opens_no_file_of_a_band(tmp_path):
    scene = stss(band={"x": {"file": str(tmp_path / "none.csv")}}, bands=["x"])
    with pytest.raises(ws.InputError, match=r"^band.x: .*none.csv: cannot be read: No such file or directory$"):
        _ = scene.scenario


@pytest.mark.parametrize(
    ("band", "words"),
    [
        ({}, r"band.x: half_power_um, wavelength_um, file, files, shipped: exactly one must be given, got none"),
        ({"file": "a.csv", "files": ["b.csv"]}, r"band.x: .*exactly one must be given, got file, files$"),
        ({"files": []}, r"band.x.files: must name at least one"),
        ({"files": ["a.csv", "b.csv"], "column": "QE"}, r"band.x.column: belongs to file$"),
        (
            {"wavelength_um": [3, 4], "response": [1, 1], "half_power_um": [3.5, 4.5]},
            r"band.x.half_power_um: must rise in \[3, 4\]",
        ),
        ({**MWIR, "shipped": "A"}, r"band.x: .*exactly one must be given, got half_power_um, shipped$"),
        ({"half_power_um": [5.0, 3.5]}, r"band.x.half_power_um: must increase"),
        ({"half_power_um": [3.5]}, r"band.x.half_power_um"),
        ({"half_power_um": [0.2, 0.5]}, r"band.x.half_power_um: must lie within 0.3 to 30 um, got 0.2 to 0.5 um$"),
        ({"half_power_um": [20.0, 40.0]}, r"band.x.half_power_um: must lie within 0.3 to 30 um, got 20 to 40 um$"),
        ({"half_power_um": [400.0, 900.0]}, r"must lie within 0.3 to 30 um, got 400 to 900 um; are these nm\?$"),
        ({"wavelength_um": [3500, 5000], "response": [1, 1]}, r"got 3500 to 5000 um; are these nm\?$"),
        ({"wavelength_um": [3.0, 4.0]}, r"band.x: wavelength_um, response: must be given together"),
        ({"wavelength_um": [3, 4], "response": [0, 0]}, r"band.x.response: must be > 0 somewhere, got 0 everywhere"),
        ({"wavelength_um": [4, 3], "response": [1, 1]}, r"band.x.wavelength_um: must increase, got 4 then 3"),
        ({"wavelength_um": [3, math.nan], "response": [1, 1]}, r"band.x.wavelength_um\[1\]: must be finite, got nan"),
        ({"wavelength_um": [3, 4], "response": [1, math.nan]}, r"band.x.response\[1\]: must be finite, got nan"),
        ({"wavelength_um": [3, 4], "response": [1, -1]}, r"band.x.response: must be >= 0, got -1"),
        (
            {"wavelength_um": [3, 4, 5], "response": [1, 1]},
            r"x.response: must be as long as wavelength_um, got 2 and 3 nodes$",
        ),
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
        (
            {"bands": ["mwri"], "band": {"mwir": MWIR}},
            r"bands\[0\]: is no band \(did you mean mwir\?\); must be one of the scene's \(mwir\) or a shipped ",
        ),
        ({"bands": ["mwir"]}, r"bands\[0\]: is no band \(did you mean MWIR\?\); must be a shipped band \(B1, "),
        ({"bands": ["VI"], "band": {"vis": MWIR}}, r"did you mean vis\?"),
        ({"bands": ["zzz"]}, r"bands\[0\]: must be a shipped band \(B1, .*\), got 'zzz'$"),
        ({"bands": {"mwir": MWIR}}, r"bands: must be a list of names, .* \(did you mean band\?\)"),
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
