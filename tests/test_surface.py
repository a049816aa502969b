"""Surfaces: numbers and tables by band, what is refused, and that each band is rendered with its own."""

import copy
import pickle

import numpy as np
import pytest

import warpsim as ws

KIRCHHOFF = 1e-15
RENDERED_RTOL = 1e-6  # truth holds float32 irradiances

BY_BAND = {"A": 0.9, "C": 0.85, "E": 0.8}


def test_one_number_holds_in_all_bands():
    for surface in (ws.Graybody(reflectance=0.9), ws.Graybody(emissivity=0.1), ws.Graybody(0.9, 0.1)):
        for band in ws.BANDS:
            assert surface.emissivity_in(band) == pytest.approx(0.1, abs=KIRCHHOFF)
            assert surface.reflectance_in(band) == pytest.approx(0.9, abs=KIRCHHOFF)
    assert ws.Graybody(emissivity=0.1).emissivity_in("A") == 0.1  # as given, not 1 - (1 - 0.1)


def test_tables_by_band_and_mixtures():
    surface = ws.Graybody(reflectance=BY_BAND)
    assert [band for band in ws.BANDS if surface.describes(band)] == ["A", "C", "E"]
    for band, reflectance in BY_BAND.items():
        assert surface.reflectance_in(band) == reflectance
        assert surface.emissivity_in(band) == pytest.approx(1 - reflectance, abs=KIRCHHOFF)
    mixed = ws.Graybody(reflectance={"A": 0.9}, emissivity={"C": 0.3, "A": 0.1})
    assert (mixed.reflectance_in("C"), mixed.emissivity_in("A")) == (0.7, 0.1)
    assert [band for band in ws.BANDS if mixed.describes(band)] == ["A", "C"]
    one_and_table = ws.Graybody(reflectance=0.9, emissivity={"C": 0.1})
    assert all(one_and_table.describes(band) for band in ws.BANDS)
    with pytest.raises(ws.InputError, match="must give reflectance or emissivity in band E, got them in A, C"):
        mixed.emissivity_in("E")


def test_tables_do_not_change_and_can_be_keys():
    given = dict(BY_BAND)
    surface = ws.Graybody(reflectance=given)
    given["A"] = 0.0
    assert surface == ws.Graybody(reflectance=BY_BAND)
    assert hash(surface) == hash(ws.Graybody(reflectance=dict(reversed(BY_BAND.items()))))
    assert surface != ws.Graybody(reflectance={**BY_BAND, "A": 0.5})
    with pytest.raises(TypeError):
        surface.reflectance["A"] = 1.0
    assert pickle.loads(pickle.dumps(surface)) == copy.deepcopy(surface) == surface


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "give reflectance or emissivity"),
        ({"reflectance": 1.1}, r"reflectance: must be in \[0, 1\], got 1.1"),
        ({"emissivity": -0.1}, r"emissivity: must be in \[0, 1\], got -0.1"),
        ({"reflectance": float("nan")}, "reflectance: must be finite, got nan"),
        ({"reflectance": "bright"}, "reflectance: must be a number, got 'bright'"),
        ({"reflectance": [0.1]}, "reflectance: must be a number"),
        ({"reflectance": True}, "reflectance: must be a number, got True"),
        ({"reflectance": {}}, "reflectance: must be a number or a table that names a band"),
        ({"reflectance": {"A": 1.5}}, r"reflectance: A: must be in \[0, 1\], got 1.5"),
        ({"reflectance": {"A": 0.5, "C": "x"}}, "reflectance: C: must be a number, got 'x'"),
        ({"emissivity": {"F ": 0.5}}, "emissivity: must be a table of numbers by names of bands, got {'F ': 0.5}"),
        ({"reflectance": 0.9, "emissivity": 0.2}, r"reflectance: must be 1 \(opaque graybody\), got 1.1"),
        ({"reflectance": BY_BAND, "emissivity": {"E": 0.1}}, r"must be 1 \(opaque graybody\) in band E, got 0.9"),
        ({"reflectance": 0.9, "emissivity": {"D": 0.2}}, r"must be 1 \(opaque graybody\) in band D, got 1.1"),
    ],
)
def test_bad_surfaces_are_refused_in_one_line(fields, message):
    with pytest.raises(ws.InputError, match=message) as caught:
        ws.Graybody(**fields)
    assert "\n" not in str(caught.value)


def test_every_band_of_the_scene_must_be_covered(scene):
    with pytest.raises(ws.InputError, match=r"targets\[1\]\.surface: .* of sphere in every band .* none in band C"):
        scene.replace(targets__1__surface={"reflectance": {"A": 0.9, "E": 0.9}})
    (group,) = scene.to_dict()["groups"]
    other = {**group["targets"][0], "name": "other", "surface": {"emissivity": {"A": 0.5}}}
    second = {"name": "second", "trajectory": group["trajectory"], "targets": [other]}
    with pytest.raises(ws.InputError, match=r"groups\[1\]\.targets\[0\]\.surface: .* of other .* none in band C"):
        scene.replace(groups=[group, second])
    assert scene.replace(bands=["A"], targets__1__surface={"reflectance": {"A": 0.9}}).bands == ("A",)


@pytest.mark.parametrize("ending", ["toml", "json"])
def test_scenes_with_tables_by_band_load_back_equal(scene, tmp_path, ending):
    tabled = scene.replace(targets__0__surface={"reflectance": BY_BAND})
    tabled.save(tmp_path / f"s.{ending}")
    assert ws.Scene.load(tmp_path / f"s.{ending}") == tabled
    assert tabled.to_dict()["groups"][0]["targets"][0]["surface"] == {"reflectance": BY_BAND}


def test_each_band_is_rendered_with_its_own_emissivity(scene, device):
    """Light of a target is proportional to its emissivity in the band, whatever it is in the others."""
    tabled = scene.replace(targets__0__surface={"emissivity": {"A": 0.3, "C": 0.6, "E": 1.0}}, sky__catalog="none")
    plain = scene.replace(targets__0__surface={"emissivity": 1.0}, sky__catalog="none")
    light = [ws.Renderer(s, device=device).render([60], ["sat11"], ["E", "A", "C"]).truth for s in (tabled, plain)]
    ours = [table[table["target"] == "center"] for table in light]
    share = np.array(ours[0]["emitted_w_cm2"] / ours[1]["emitted_w_cm2"])
    np.testing.assert_allclose(share, [1.0, 0.3, 0.6], rtol=RENDERED_RTOL)
