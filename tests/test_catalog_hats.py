"""HATS folders: stars read as views need them, the same as with all in memory; and folders that lack something.

What lacks, or is other than the folder says, is one line each, and no stars are silently gone.
"""

import shutil
import warnings

import numpy as np
import pytest
from astropy.table import Table
from test_catalog_size import parquet, write_hats, write_parquet

import warpsim as ws
from warpsim.output.check import scene_report
from warpsim.render.device_stars import catalog_checksums
from warpsim.sky import tiles
from warpsim.sky.hats import HatsFolder

N_STAR = 600
FAR = (200.0, -80.0, 1.0)

pytest.importorskip("pyarrow")
pytest.importorskip("astropy_healpix")


def stars(n_star, seed=5):
    """Bright and faint, with large motions and parallaxes."""
    random = np.random.default_rng(seed)
    ks_mag = random.uniform(-3.0, 9.0, n_star)
    return Table({
        "ra_deg": random.uniform(0.0, 360.0, n_star), "dec_deg": np.degrees(np.arcsin(random.uniform(-1, 1, n_star))),
        "mag_Ks": ks_mag, "mag_J": ks_mag + random.uniform(0.1, 1.2, n_star),
        "pm_dec_mas_yr": random.normal(0.0, 3000.0, n_star), "parallax_mas": random.uniform(0.0, 700.0, n_star),
    })  # fmt: skip


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


# --- the catalog's name ---


@pytest.mark.ci
def test_a_catalog_is_called_as_it_calls_itself(folder):
    assert "obs_collection=test\n" in (folder / "hats.properties").read_text()
    assert ws.StarCatalog.read(folder).name == ws.StarCatalog.read(folder, region=FAR).name == "test"
    (folder.parent / "collection.properties").write_text("hats_primary_table_url=hats\n")
    assert ws.StarCatalog.read(folder.parent).name == "test"
    (folder / "hats.properties").write_text("hats_frame=equatorial\n")
    assert ws.StarCatalog.read(folder).name == ws.StarCatalog.read(folder.parent).name == "hats"


@pytest.mark.parametrize("options", [{}, {"region": (0.0, 0.0, 180.0)}, {"limit": {"Ks": 9.0}}])
def test_star_tables_are_called_by_the_catalog(folder, options):
    renderer = ws.Renderer(ws.Scene.load("stss").replace(sky={"catalog": str(folder), **options}), "cpu")
    assert renderer.catalog.name == "test"
    assert renderer.render([60], sensors="sat11", keep_stars=True).stars.meta["CATALOG"] == "test"


def test_names_of_folders_surveys_and_tables(tmp_path):
    table = Table({"ra": [10.0], "dec": [20.0], "phot_g_mean_mag": [9.0], "bp_rp": [1.0]})
    (tmp_path / "parts").mkdir()
    path = write_parquet(table, tmp_path / "parts" / "a.parquet")
    assert ws.StarCatalog.read(path).name == "gaia (a.parquet)"
    assert ws.StarCatalog.read([path]).name == "gaia (a.parquet)"
    assert ws.StarCatalog.read(path.parent).name == "gaia (parts)"


# --- partitions that are missing, or too many ---


@pytest.mark.parametrize("region", [None, (10.0, 80.0, 3.0)])
def test_missing_partitions_are_named_and_counted(folder, region):
    files = files_of(folder)
    for file in files[5:20]:
        file.unlink()
    gone = sorted(tuple(int(part.split("=")[1].split(".")[0]) for part in (f.parts[-3], f.name)) for f in files[5:20])
    order, pixel = gone[0]
    options = {} if region is None else {"region": region}
    rule = f"must hold Norder={order}, Npix={pixel}, which partition_info.csv lists (15 of {len(files)} are missing)"
    assert refusal(folder, **options) == f"{folder}: {rule}"


def test_a_partition_without_rows_needs_no_file(folder):
    info = folder / "partition_info.csv"
    info.write_text(info.read_text() + "5,0,0\n")
    assert len(ws.StarCatalog.read(folder)) == N_STAR


def test_a_partition_that_is_not_listed(folder):
    info = folder / "partition_info.csv"
    info.write_text("\n".join(line for line in info.read_text().splitlines() if not line.startswith("1,0,")))
    assert refusal(folder) == f"{info}: must list Norder=1, Npix=0, which is there (1 such)"


def test_missing_partitions_by_the_metadata_of_all(folder):
    """Without a list in CSV, the row groups of _metadata tell."""
    collected, files = [], files_of(folder)
    for file in files:
        one = parquet.read_metadata(file)
        one.set_file_path(file.relative_to(folder / "dataset").as_posix())
        collected.append(one)
    merged = collected[0]
    for one in collected[1:]:
        merged.append_row_groups(one)
    merged.write_metadata_file(folder / "dataset" / "_metadata")
    (folder / "partition_info.csv").unlink()
    assert len(ws.StarCatalog.read(folder)) == N_STAR
    files[3].unlink()
    gone, text = files[3].relative_to(folder / "dataset"), refusal(folder)
    assert text == f"{folder / 'dataset'}: must hold {gone}, which _metadata lists (1 of {len(files)} are missing)"
    (folder / "dataset" / "_metadata").write_bytes(b"x")
    assert "_metadata: ends early" in refusal(folder)


def test_partitions_of_several_orders_that_overlap(folder):
    (folder / "partition_info.csv").unlink()
    (folder / "dataset/Norder=9/Dir=0").mkdir(parents=True)
    shutil.copy(folder / "dataset/Norder=1/Dir=0/Npix=0.parquet", folder / "dataset/Norder=9/Dir=0/Npix=1.parquet")
    one, other = "dataset/Norder=1/Dir=0/Npix=0.parquet", "dataset/Norder=9/Dir=0/Npix=1.parquet"
    assert refusal(folder) == f"{folder}: must hold no pixel twice, got {one} and {other}"


def test_a_pixel_as_a_file_and_as_a_folder(folder):
    (folder / "dataset/Norder=1/Dir=0/Npix=0").mkdir()
    shutil.copy(folder / "dataset/Norder=1/Dir=0/Npix=0.parquet", folder / "dataset/Norder=1/Dir=0/Npix=0/a.parquet")
    assert "must hold no pixel twice, got dataset/Norder=1/Dir=0/Npix=0 and dataset/Norder=1/Dir=0/Npix=0.p" in refusal(
        folder
    )


@pytest.mark.parametrize("name", ["Norder=1/Dir=0/Npix=48.parquet", "Norder=30/Dir=0/Npix=0.parquet"])
def test_a_pixel_that_is_none(folder, name):
    (folder / "dataset" / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(files_of(folder)[0], folder / "dataset" / name)
    assert f"{name}: must be a pixel of HEALPix: Norder 0 to 29, Npix 0 to 12 x 4^Norder - 1" in refusal(folder)


def test_a_partition_with_other_rows_than_are_listed(folder):
    file = HatsFolder(folder).tiles[0].path
    rows = parquet.read_table(file)
    parquet.write_table(rows.slice(0, len(rows) - 1), file)
    for options in ({}, {"region": (45.0, 20.0, 1.0)}):
        rule = f"must hold {len(rows)} rows, as the folder says, got {len(rows) - 1}"
        with pytest.raises(ws.InputError, match=f"^{file}: {rule}$"):
            ws.StarCatalog.read(folder, **options)


@pytest.mark.parametrize("listed", [True, False])
def test_stars_keep_their_names_in_a_region(folder, tmp_path, listed):
    """Rows of partitions that are passed over count, those behind the last one too."""
    if not listed:
        (folder / "partition_info.csv").unlink()
    Table({"ra_deg": [10.0], "dec_deg": [-60.0], "mag_Ks": [5.0], "mag_J": [5.8]}).write(tmp_path / "x.ecsv")
    for path in (folder, [folder, tmp_path / "x.ecsv"]):
        whole, some = ws.StarCatalog.read(path), ws.StarCatalog.read(path, region=(10.0, -60.0, 12.0))
        rows = np.flatnonzero(np.isin(whole.ra_deg, some.ra_deg))
        assert len(rows) == len(some) > 1
        assert some.id.tolist() == whole.id[rows].tolist()


# --- files beside the partitions that are broken ---


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("Norder,Npix,num_rows\nx,y,z\n", "line 2: Norder: must be a whole number >= 0, got 'x'"),
        ("Norder,Npix,num_rows\n1\n", "line 2: Npix: must be a whole number >= 0, got ''"),
        ("Norder,Npix,num_rows\n1,0,1.5\n", "line 2: num_rows: must be a whole number >= 0, got '1.5'"),
        ("Norder,Npix\n1,0\n-1,0\n", "line 3: Norder: must be a whole number >= 0, got '-1'"),
        ("a,num_rows\n1,2\n", "must have the columns Norder and Npix, got a, num_rows"),
        ("", "must have the columns Norder and Npix, got none"),
        ("Norder,Npix,num_rows\n", "must list partitions, got none"),
        (b"\xff\xfe\x00", "must be text in UTF-8"),
    ],
)
def test_broken_lists_of_partitions(folder, text, rule):
    info = folder / "partition_info.csv"
    info.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert refusal(folder) == f"{info}: {rule}"


def test_lists_of_partitions_with_blanks_and_without_rows(folder):
    info = folder / "partition_info.csv"
    lines = [line.rpartition(",")[0].replace(",", ", ") for line in info.read_text().splitlines()]
    info.write_text("\ufeff" + "\r\n".join(lines) + "\r\n\r\n", "utf-8")
    assert HatsFolder(folder).n_row.sum() == N_STAR


@pytest.mark.parametrize("name", ["hats.properties", "properties"])
def test_properties_that_are_no_text(folder, name):
    (folder / "hats.properties").unlink()
    (folder / name).write_bytes(b"\xff\xfe=\x00")
    assert refusal(folder) == f"{folder / name}: must be text in UTF-8"


def test_a_collection_without_its_primary_table(folder):
    file = folder.parent / "collection.properties"
    file.write_text("obs_collection=x\n")
    assert refusal(folder.parent) == f"{file}: must have the key hats_primary_table_url"
    file.write_text("hats_primary_table_url=elsewhere\n")
    assert "elsewhere: must hold partitions" in refusal(folder.parent)


@pytest.mark.parametrize("index", [0, 7])
def test_a_partition_that_is_cut_off(folder, index):
    (folder / "partition_info.csv").unlink()
    file = HatsFolder(folder).tiles[index].path
    file.write_bytes(file.read_bytes()[:100])
    assert refusal(folder) == f"{file}: ends early: the Parquet data are cut off"


@pytest.mark.parametrize(
    ("dec", "cone"), [(["5", "6"], (10.0, 5.0, 1.0)), (["+05:00:00", "06:00:00"], (150.0, 5.0, 1.0))]
)
def test_declinations_as_text(tmp_path, dec, cone):
    """Their order is no order of numbers: no group is passed over by it."""
    ra = ["10:00:00", "20:00:00"] if ":" in dec[0] else ["10", "20"]
    table = Table({"ra_deg": ra, "dec_deg": dec, "mag_Ks": [5.0, 6.0]})
    path = write_parquet(table, tmp_path / "x.parquet", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        catalog = ws.StarCatalog.read(path, region=cone)
    np.testing.assert_allclose(catalog.dec_deg, [5.0], rtol=1e-14)


def test_binary_columns_are_texts(tmp_path):
    """Some programs write text without saying that it is."""
    table = Table({"ra_deg": [b"1", b"2"], "dec_deg": [3.0, 4.0], "mag_Ks": [5.0, 6.0], "id": [b"a", b"b"]})
    with pytest.warns(UserWarning, match="no colour"):
        catalog = ws.StarCatalog.read(write_parquet(table, tmp_path / "x.parquet"), region=(1.0, 3.0, 0.1))
    assert catalog.id.tolist() == ["a"]


# --- stars read as views need them ---


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    return write_hats(stars(60_000), tmp_path_factory.mktemp("stars") / "hats", (2, 3))


def scene_of(folder, **changes):
    return ws.Scene.load("stss").replace(sky={"catalog": str(folder), **changes})


def loaded(renderer):
    return next(iter(renderer._pipelines.values())).scene.stars.tiles


@pytest.mark.parametrize(
    "sky", [{}, {"parallax": True, "light_deflection": True}], ids=["plain", "parallax and deflection"]
)
@pytest.mark.ci
def test_frames_and_truth_are_those_of_an_index_in_memory(large, sky):
    scene = scene_of(large, **sky)
    tiled = ws.Renderer(scene)
    whole = ws.Renderer(scene, catalog=ws.StarCatalog.read(large))
    for frames in ([100], range(60, 62), range(0, 160, 40)):
        one, other = (renderer.render(frames, keep_stars=True) for renderer in (tiled, whole))
        np.testing.assert_array_equal(one.counts.numpy(), other.counts.numpy())
        assert len(one.stars) > 10
        for name in one.stars.colnames:  # rows and names are those of the whole folder
            np.testing.assert_array_equal(one.stars[name], other.stars[name])
    assert 0 < len(loaded(tiled)) < len(HatsFolder(large).tiles)


def test_frames_do_not_depend_on_what_was_looked_at_before(large, monkeypatch):
    """Nothing is kept but what is needed: tiles come and go."""
    monkeypatch.setattr(tiles, "STARS_KEPT", 0)
    renderer = ws.Renderer(scene_of(large))
    first = renderer.render([20], sensors="sat11").counts.numpy()
    before = loaded(renderer)
    renderer.render([150], sensors="sat31")
    assert not set(before) & set(loaded(renderer))
    np.testing.assert_array_equal(renderer.render([20], sensors="sat11").counts.numpy(), first)
    assert loaded(renderer) == before


def test_tiles_are_kept_while_there_is_room(large):
    renderer = ws.Renderer(scene_of(large))
    renderer.render([20], sensors="sat11")
    one = set(loaded(renderer))
    renderer.render([150], sensors="sat31")
    assert one < set(loaded(renderer))


@pytest.mark.ci
def test_a_moving_camera_reads_what_it_sweeps_over(large):
    """An exposure of 10 s, in which the camera turns by many pixels."""
    detector = {"kind": "electron", "exposure_s": 10.0, "full_well_e": 1e8, "gain_e_per_count": 3000.0}
    scene = scene_of(large).replace(
        detector=detector, lighting={"quadrature_error": 0.1}, frames={"count": 60, "interval_s": 20.0}
    )
    tiled, whole = ws.Renderer(scene), ws.Renderer(scene, catalog=ws.StarCatalog.read(large))
    one, other = (renderer.render(range(5, 30, 8), keep_stars=True) for renderer in (tiled, whole))
    np.testing.assert_array_equal(one.counts.numpy(), other.counts.numpy())
    assert np.hypot(one.stars["dx_px"], one.stars["dy_px"]).max() > 10.0


@pytest.mark.ci
def test_another_epoch_has_its_tiles(large):
    """Stars that move by 3 arcsec a year, 60 years on: some have left their tiles."""
    scene = scene_of(large).replace(epoch_utc="2060-01-01T00:00:00")
    tiled = ws.Renderer(scene_of(large)).with_scene(scene)
    whole = ws.Renderer(scene, catalog=ws.StarCatalog.read(large))
    one, other = (renderer.render(range(40, 60, 10)).counts.numpy() for renderer in (tiled, whole))
    np.testing.assert_array_equal(one, other)


def test_more_stars_than_fit_are_refused(large, monkeypatch):
    monkeypatch.setattr(tiles, "MOST_STARS", 3000)
    renderer = ws.Renderer(scene_of(large))
    renderer.render([60], sensors="sat11")
    rule = r"frames: must need at most 3,000 stars at a time; render fewer at once, got [\d,]+ in \d+ tiles"
    with pytest.raises(ws.InputError, match=rule):
        renderer.render(range(160))


@pytest.mark.ci
def test_a_region_or_a_limit_is_read_into_memory(large):
    renderer = ws.Renderer(scene_of(large, limit={"Ks": 0.0}))
    assert len(renderer.catalog) == int(np.count_nonzero(stars(60_000)["mag_Ks"] <= 0.0))


def test_check_says_that_stars_are_read_as_views_need_them(large):
    scene = scene_of(large)
    n_tile = len(HatsFolder(large).tiles)
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
