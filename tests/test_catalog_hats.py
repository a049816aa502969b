"""HATS folders that lack something, or say something else than they hold: one line each, and no stars silently gone."""

import shutil

import pytest
from astropy.table import Table
from test_catalog_size import write_hats, write_parquet
from test_star_tiles import stars

import warpsim as ws
from warpsim.output.check import scene_report

N_STAR = 600
FAR = (200.0, -80.0, 1.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_hats(stars(N_STAR), tmp_path_factory.mktemp("whole") / "hats")


@pytest.fixture
def folder(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "hats")


def files_of(folder):
    return sorted((folder / "dataset").rglob("*.parquet"))


def refusal(folder, **options):
    """The one line that reading and rendering both say."""
    with pytest.raises(ws.InputError) as caught:
        ws.StarCatalog.read(folder, **options)
    with pytest.raises(ws.InputError) as rendered:
        ws.Renderer(ws.Scene.load("stss").replace(sky={"catalog": str(folder), **options}), "cpu")
    text = str(caught.value)
    assert "\n" not in text and str(rendered.value) == f"sky.catalog: {text}"
    return text


def only_one_tile(folder):
    """A catalog of a part of the sky: the tile Norder=1, Npix=0, 27 deg wide."""
    for file in files_of(folder):
        if file.parent.parent.name != "Norder=1" or file.name != "Npix=0.parquet":
            file.unlink()
    info = folder / "partition_info.csv"
    info.write_text("\n".join(line for line in info.read_text().splitlines() if line.startswith(("N", "1,0,"))))
    return folder


# --- regions without stars ---


def test_a_region_beside_a_catalog_of_a_part_of_the_sky_has_no_stars(folder):
    only_one_tile(folder)
    catalog = ws.StarCatalog.read(folder, region=FAR)
    assert len(catalog) == 0 and catalog.bands == ws.StarCatalog.read(folder).bands
    assert len(catalog.filled().flux_jy("A")) == 0
    scene = ws.Scene.load("stss").replace(sky={"catalog": str(folder), "region": FAR})
    assert ": 0 stars, with light in band A 0" in scene_report(scene.scenario)
    assert "no star of the catalog gives light in these bands" in scene_report(scene.scenario)
    frames = ws.Renderer(scene, "cpu").render([60], sensors="sat11", keep_stars=True)
    assert len(frames.stars) == 0


def test_a_region_beside_files_of_a_folder_has_no_stars(tmp_path):
    table = stars(200)
    table = table[table["dec_deg"] > 0.0]
    write_parquet(table[:50], tmp_path / "a.parquet", 10)
    table[50:].write(tmp_path / "b.ecsv")
    for path in (tmp_path, tmp_path / "a.parquet", tmp_path / "b.ecsv", [tmp_path / "a.parquet"]):
        catalog = ws.StarCatalog.read(path, region=FAR)
        assert len(catalog) == 0 and {"Ks", "J"} <= set(catalog.bands)


def test_a_list_with_a_catalog_that_the_region_misses(folder, tmp_path):
    other = Table({"ra_deg": [FAR[0]], "dec_deg": [FAR[1]], "mag_Ks": [5.0], "mag_J": [6.0]})
    other.write(tmp_path / "x.ecsv")
    for path in ([only_one_tile(folder), tmp_path / "x.ecsv"], [tmp_path / "x.ecsv", folder]):
        assert ws.StarCatalog.read(path, region=FAR).ra_deg.tolist() == [FAR[0]]
