"""Stars of a HATS folder, read as views need them: the same frames as with all of them in memory."""

import numpy as np
import pytest
from astropy.table import Table
from test_catalog_size import write_hats

import warpsim as ws
from warpsim.output.check import scene_report
from warpsim.render.stars import catalog_checksums
from warpsim.sky import tiles
from warpsim.sky.hats import HatsFolder

pytest.importorskip("pyarrow")
pytest.importorskip("astropy_healpix")

N_STAR = 60_000


def stars(n_star=N_STAR, seed=5):
    """Bright and faint, with large motions and parallaxes."""
    random = np.random.default_rng(seed)
    ks_mag = random.uniform(-3.0, 9.0, n_star)
    return Table({
        "ra_deg": random.uniform(0.0, 360.0, n_star), "dec_deg": np.degrees(np.arcsin(random.uniform(-1, 1, n_star))),
        "mag_Ks": ks_mag, "mag_J": ks_mag + random.uniform(0.1, 1.2, n_star),
        "pm_dec_mas_yr": random.normal(0.0, 3000.0, n_star), "parallax_mas": random.uniform(0.0, 700.0, n_star),
    })  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_hats(stars(), tmp_path_factory.mktemp("stars") / "hats", (2, 3))


def scene_of(folder, **changes):
    return ws.Scene.load("stss").replace(sky={"catalog": str(folder), **changes})


def loaded(renderer):
    return next(iter(renderer._pipelines.values())).scene.stars.tiles


@pytest.mark.parametrize(
    "sky", [{}, {"parallax": True, "light_deflection": True}], ids=["plain", "parallax and deflection"]
)
@pytest.mark.ci
def test_frames_and_truth_are_those_of_an_index_in_memory(folder, sky):
    scene = scene_of(folder, **sky)
    tiled = ws.Renderer(scene)
    whole = ws.Renderer(scene, catalog=ws.StarCatalog.read(folder))
    for frames in ([100], range(60, 62), range(0, 160, 40)):
        one, other = (renderer.render(frames, keep_stars=True) for renderer in (tiled, whole))
        np.testing.assert_array_equal(one.counts.numpy(), other.counts.numpy())
        assert len(one.stars) > 10
        for name in one.stars.colnames:  # rows and names are those of the whole folder
            np.testing.assert_array_equal(one.stars[name], other.stars[name])
    assert 0 < len(loaded(tiled)) < len(HatsFolder(folder).tiles)


def test_frames_do_not_depend_on_what_was_looked_at_before(folder, monkeypatch):
    """Nothing is kept but what is needed: tiles come and go."""
    monkeypatch.setattr(tiles, "STARS_KEPT", 0)
    renderer = ws.Renderer(scene_of(folder))
    first = renderer.render([20], sensors="sat11").counts.numpy()
    before = loaded(renderer)
    renderer.render([150], sensors="sat31")
    assert not set(before) & set(loaded(renderer))
    np.testing.assert_array_equal(renderer.render([20], sensors="sat11").counts.numpy(), first)
    assert loaded(renderer) == before


def test_tiles_are_kept_while_there_is_room(folder):
    renderer = ws.Renderer(scene_of(folder))
    renderer.render([20], sensors="sat11")
    one = set(loaded(renderer))
    renderer.render([150], sensors="sat31")
    assert one < set(loaded(renderer))


@pytest.mark.ci
def test_a_moving_camera_reads_what_it_sweeps_over(folder):
    """An exposure of 10 s, in which the camera turns by many pixels."""
    detector = {"kind": "electron", "exposure_s": 10.0, "full_well_e": 1e8, "gain_e_per_count": 3000.0}
    scene = scene_of(folder).replace(
        detector=detector, lighting={"quadrature_error": 0.1}, frames={"count": 60, "interval_s": 20.0}
    )
    tiled, whole = ws.Renderer(scene), ws.Renderer(scene, catalog=ws.StarCatalog.read(folder))
    one, other = (renderer.render(range(5, 30, 8), keep_stars=True) for renderer in (tiled, whole))
    np.testing.assert_array_equal(one.counts.numpy(), other.counts.numpy())
    assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).max() > 10.0


@pytest.mark.ci
def test_another_epoch_has_its_tiles(folder):
    """Stars that move by 3 arcsec a year, 60 years on: some have left their tiles."""
    scene = scene_of(folder).replace(epoch_utc="2060-01-01T00:00:00")
    tiled = ws.Renderer(scene_of(folder)).with_scene(scene)
    whole = ws.Renderer(scene, catalog=ws.StarCatalog.read(folder))
    one, other = (renderer.render(range(40, 60, 10)).counts.numpy() for renderer in (tiled, whole))
    np.testing.assert_array_equal(one, other)


def test_more_stars_than_fit_are_refused(folder, monkeypatch):
    monkeypatch.setattr(tiles, "MOST_STARS", 3000)
    renderer = ws.Renderer(scene_of(folder))
    renderer.render([60], sensors="sat11")
    rule = r"frames: must need at most 3,000 stars at a time; render fewer at once, got [\d,]+ in \d+ tiles"
    with pytest.raises(ws.InputError, match=rule):
        renderer.render(range(160))


def test_a_region_or_a_limit_is_read_into_memory(folder):
    renderer = ws.Renderer(scene_of(folder, limit={"Ks": 0.0}))
    assert len(renderer.catalog) == int(np.count_nonzero(stars()["mag_Ks"] <= 0.0))


def test_check_says_that_stars_are_read_as_views_need_them(folder):
    scene = scene_of(folder)
    n_tile = len(HatsFolder(folder).tiles)
    said = f"60,000 stars in {n_tile} tiles of HATS, read as views need them and not counted by band"
    assert said in scene_report(scene.scenario)
    assert len(set(catalog_checksums(scene.scenario).values())) == 1


def test_folders_that_are_not_what_they_say(tmp_path):
    folder = write_hats(stars(500), tmp_path / "a")
    info = folder / "partition_info.csv"
    lines = info.read_text().splitlines()
    info.write_text("\n".join([lines[0], *(line.rpartition(",")[0] + ",7" for line in lines[1:])]) + "\n")
    with pytest.raises(
        ws.InputError, match=r"sky.catalog: .*parquet: must hold 7 stars with a position, as the folder"
    ):
        ws.Renderer(scene_of(folder))
    table = stars(500)
    table["mag_Ks"] = -20.0
    bright = ws.Renderer(scene_of(write_hats(table, tmp_path / "b", (0, 0))))
    with pytest.raises(ws.InputError, match="must hold no star brighter than 100000 Jy, or views may miss its light"):
        bright.render([60])
