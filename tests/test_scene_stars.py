"""Stars of scenes: catalogs of kinds of sensors, and lists of the stars in each view."""

from __future__ import annotations

import numpy as np
import pytest
from astropy.table import Table
from on_devices import device_scene

import warpsim as ws
from warpsim.dataset.layout import identity_of
from warpsim.output.plan import make_plan
from warpsim.radiometry.band import Band
from warpsim.render.batch import new_columns
from warpsim.render.buffers import bytes_of, new_sources
from warpsim.render.device_stars import catalog_checksums
from warpsim.render.schedule import BYTES_PER_PASS, most_views

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


@pytest.mark.ci
def test_one_catalog_for_all_kinds_is_named_once():
    scene = ws.Scene.load("two_cameras")
    assert list(identity_of(ws.Recipe(scene=scene), "cpu")["inputs"]) == ["star catalog"]


def greek_csv(folder):
    """Two stars with names beyond ASCII, one of them where sat11 looks in frame 60."""
    path = folder / "größe.csv"
    path.write_text("ra_deg,dec_deg,flux_A_jy,id\n10.0,20.0,5.0,β Boo\n11.0,21.0,4.0,ξ\n", encoding="utf-8")
    return path


def test_names_beyond_ascii_are_written_as_escapes(scene, tmp_path):
    catalog = ws.StarCatalog.read(greek_csv(tmp_path))
    assert catalog.id.tolist() == ["β Boo", "ξ"]
    ws.write_catalog(catalog, tmp_path / "out.fits")
    assert ws.StarCatalog.read(tmp_path / "out.fits").id.tolist() == ["\\u03b2 Boo", "\\u03be"]
    ws.write_catalog(catalog, tmp_path / "out.ecsv")
    assert ws.StarCatalog.read(tmp_path / "out.ecsv").id.tolist() == ["β Boo", "ξ"]


def test_a_run_with_such_stars(scene, tmp_path):
    axes = ws.Renderer(scene, device="cpu").render([60], ["sat11"], ["A"]).axes_icrs[0, 0]
    ra, dec = np.degrees(np.arctan2(axes[2, 1], axes[2, 0])), np.degrees(np.arcsin(axes[2, 2]))
    path = tmp_path / "größe.csv"
    path.write_text(f"ra_deg,dec_deg,flux_A_jy,id\n{ra},{dec},5.0,β Boo\n", encoding="utf-8")
    described = scene.replace(sky__catalog=str(path))
    ws.render_to_folder(described, tmp_path / "out", [60], ["sat11"], ["A"], device="cpu", stars=True)
    written = Table.read(tmp_path / "out" / "stars.fits")
    assert written["id"].tolist() == ["\\u03b2 Boo"]
    assert written.meta["CATALOG"] == "gr\\xf6\\xdfe.csv"


def test_a_run_hangs_on_the_stars_themselves():
    """Not on the file's name or format: equal stars have equal checksums, whatever epoch they are looked at."""
    columns = {"ra_deg": [1.0, 2.0], "dec_deg": [3.0, 4.0], "flux_jy": {"A": [5.0, np.nan]}}
    one, same = ws.StarCatalog.from_arrays(**columns), ws.StarCatalog.from_arrays(**columns, name="other")
    assert one.checksum == same.checksum == one.at_epoch(2030.0).checksum
    changed = [
        {"ra_deg": [1.0, 2.0 + 1e-12]},
        {"dec_deg": [3.0, 4.1]},
        {"flux_jy": {"A": [5.0, 0.0]}},
        {"flux_jy": {"C": [5.0, np.nan]}},
        {"pm_ra_mas_yr": [0.0, 1.0]},
        {"pm_dec_mas_yr": [0.0, 1.0]},
        {"parallax_mas": [0.0, 1.0]},
        {"id": ["1", "3"]},
        {"flux_jy": {"A": [5.0, np.nan], "W1": [2.0, 3.0]}},
        {"temperature_k": [4000.0, np.nan]},
        {"luminosity": [1, 0]},
        {"epoch_jyear": 2001.0},
    ]
    sums = {ws.StarCatalog.from_arrays(**columns | change).checksum for change in changed}
    assert len(sums | {one.checksum}) == len(changed) + 1


def test_the_renderer_shows_its_stars(scene):
    renderer = ws.Renderer(scene, device="cpu")
    assert renderer.catalog.checksum == ws.StarCatalog.default().checksum
    assert renderer.catalog.epoch_jyear == pytest.approx(scene.epoch.tt.jyear, abs=1e-9)
    with pytest.raises(ws.InputError, match=r"^catalog: must be a StarCatalog, got str; files are for sky\.catalog$"):
        ws.Renderer(scene, device="cpu", catalog="union")


@pytest.mark.parametrize("n_pixel", [32, 128])
@pytest.mark.parametrize("n_slot", [100, 10_000, 1_000_000])
@pytest.mark.ci
def test_long_source_lists_count_in_the_memory_budget(scene, n_slot, n_pixel):
    world = device_scene(scene.replace(camera__n_row=n_pixel, camera__n_col=n_pixel), ("A", "C"))
    camera = world.instrument.sensor.camera
    sources = new_sources(world, 1, n_slot)
    held = bytes_of([sources.xy_px, sources.irradiance_w_cm2, sources.star, *new_columns(world, 1).arrays])
    signal = 2 * 4 * camera.n_row * camera.n_col
    for chunk_bytes in (None, 2**20):
        n_view, room = most_views(world, n_slot, chunk_bytes), chunk_bytes or BYTES_PER_PASS
        assert n_view == 1 or n_view * max(held, signal) <= room
        assert (n_view + 1) * max(held, signal) > room
