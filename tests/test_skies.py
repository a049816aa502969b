"""Stars by kind of sensor: the default catalog holds those that are brightest in a sensor's bands."""

from __future__ import annotations

import numpy as np
import pytest

import warpsim as ws
from warpsim.dataset.layout import identity_of
from warpsim.output.plan import make_plan
from warpsim.radiometry.band import Band
from warpsim.render.stars import catalog_checksums

VISIBLE = Band.top_hat("visible", 0.4, 0.9, per_photon=True)


@pytest.fixture(scope="module")
def mixed_scene():
    scene = ws.Scene.load("stss")
    (sensor,) = scene.to_dict()["sensors"]
    surface = {f"targets__{k}__surface": {"reflectance": 0.5} for k in range(4)}
    kinds = [
        {**sensor, "name": "infrared", "bands": ["A", "C"]},
        {**sensor, "name": "visible", "bands": [VISIBLE]},
        {**sensor, "name": "both", "bands": [VISIBLE, "A"]},
    ]
    return scene.replace(sensors=kinds, **surface)


def rows(catalog):
    return set(catalog.id.tolist())


@pytest.mark.ci
def test_default_stars_are_those_brightest_in_the_bands():
    infrared, visible = ws.StarCatalog.default(), ws.StarCatalog.default(VISIBLE)
    both = ws.StarCatalog.default(VISIBLE, "A")
    assert len(infrared) == len(visible) == 177_860
    assert rows(both) == rows(infrared) | rows(visible)
    assert ws.StarCatalog.default("A", "E") is infrared
    assert ws.StarCatalog.default("SWIR") is not infrared  # it ends at 2.5 um
    assert ws.StarCatalog.default(VISIBLE) is visible
    light, left_out = both.irradiance_w_cm2(VISIBLE), ~np.isin(both.id, visible.id)
    assert light[left_out].max() <= light[~left_out].min()


@pytest.mark.ci
def test_kinds_of_sensors_have_stars_of_their_own(mixed_scene):
    renderer = ws.Renderer(mixed_scene, device="cpu")
    names = {kind: rows(renderer.catalog_of(kind)) for kind in ("infrared", "visible", "both")}
    assert names["infrared"] == rows(ws.StarCatalog.default())
    assert names["visible"] == rows(ws.StarCatalog.default(VISIBLE))
    assert names["both"] == names["infrared"] | names["visible"]
    assert rows(renderer.catalog) == names["infrared"]
    alone = ws.Renderer(mixed_scene.replace(sensors=[mixed_scene.to_dict()["sensors"][1]]), device="cpu")
    frames = [one.render([60], sensors=["sat11.visible" if one is renderer else "sat11"], keep_signal=True)
              for one in (renderer, alone)]  # fmt: skip
    np.testing.assert_array_equal(frames[0].signal_w_cm2.numpy(), frames[1].signal_w_cm2.numpy())
    assert frames[0].signal_w_cm2.numpy().max() > 0.0


def test_a_given_catalog_serves_all_kinds(mixed_scene):
    stars = ws.StarCatalog.synthetic(1000)
    renderer = ws.Renderer(mixed_scene, device="cpu", catalog=stars)
    assert rows(renderer.catalog_of("visible")) == rows(renderer.catalog_of("infrared")) == rows(stars)


def test_a_renderer_of_another_epoch_moves_the_same_stars(mixed_scene):
    renderer = ws.Renderer(mixed_scene, device="cpu")
    later = renderer.with_scene(mixed_scene.replace(epoch_utc="2035-01-01T14:00:00"))
    assert later.catalog.epoch_jyear == pytest.approx(renderer.catalog.epoch_jyear + 10.0, abs=0.01)
    same = renderer.with_scene(mixed_scene.replace(noise_seed=5))
    assert same.catalog is renderer.catalog


@pytest.mark.ci
def test_identities_cover_the_stars_of_all_kinds(mixed_scene, monkeypatch, tmp_path):
    """Of a data set and of a run: other stars of a kind that is not the first make other keys."""
    kinds = ("infrared", "visible", "both")
    found = catalog_checksums(mixed_scene.scenario)
    renderer = ws.Renderer(mixed_scene, device="cpu")
    assert found == {kind: renderer.catalog_of(kind).checksum for kind in kinds}
    assert len(set(found.values())) == 3

    def keys():
        inputs = identity_of(ws.Recipe(scene=mixed_scene), "cpu")["inputs"]
        renderer = ws.Renderer(mixed_scene, device="cpu")
        plans = [make_plan(renderer, [60], f"sat11.{kind}", None, False) for kind in kinds[:2]]
        return [inputs, *(plan.identity for plan in plans)]

    before = keys()
    assert before[0] == {f"star catalog of {kind}": checksum for kind, checksum in found.items()}
    default = ws.StarCatalog.default

    def fewer(*bands):
        return ws.StarCatalog.synthetic(100) if bands == (VISIBLE,) else default(*bands)

    monkeypatch.setattr(ws.StarCatalog, "default", fewer)
    after = keys()
    assert [one != other for one, other in zip(before, after, strict=True)] == [True, False, True]


def test_one_catalog_for_all_kinds_is_named_once():
    scene = ws.Scene.load("two_cameras")
    assert list(identity_of(ws.Recipe(scene=scene), "cpu")["inputs"]) == ["star catalog"]
