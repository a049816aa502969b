"""Large catalogs: some columns, some stars, many files, and HATS folders."""

import csv

import numpy as np
import pytest
from astropy.table import Table

import warpsim as ws
from warpsim.render.device_stars import load_catalog
from warpsim.sky.hats import HatsFolder, is_hats

pytest.importorskip("pyarrow")
healpix = pytest.importorskip("astropy_healpix")
parquet = pytest.importorskip("pyarrow.parquet")

N_STAR = 4000


@pytest.fixture(scope="module")
def stars():
    """Stars over the whole sky, in no order."""
    random = np.random.default_rng(11)
    dec_deg = np.degrees(np.arcsin(random.uniform(-1.0, 1.0, N_STAR)))
    return Table({
        "ra_deg": random.uniform(0.0, 360.0, N_STAR), "dec_deg": dec_deg, "mag_Ks": random.uniform(3.0, 9.0, N_STAR),
        "mag_J": random.uniform(4.0, 10.0, N_STAR), "pm_dec_mas_yr": random.normal(0.0, 50.0, N_STAR),
        **{f"other_{k}": random.normal(size=N_STAR) for k in range(40)},
    })  # fmt: skip


def write_parquet(table, path, rows_per_group=None):
    import pyarrow

    arrow = pyarrow.table({name: np.asarray(table[name]) for name in table.colnames})
    parquet.write_table(arrow, path, row_group_size=rows_per_group)
    return path


def write_hats(table, folder, orders=(1, 2)):
    """Partitions of two orders: pixels of the coarser one in the north, of the finer one in the south."""
    (folder / "dataset").mkdir(parents=True)
    (folder / "hats.properties").write_text("#HATS catalog\nobs_collection=test\nhats_col_ra=ra_deg\n")
    with (folder / "partition_info.csv").open("w", newline="") as stream:
        info = csv.writer(stream)
        info.writerow(["Norder", "Npix", "num_rows"])
        coarse, fine = (
            healpix.lonlat_to_healpix(
                table["ra_deg"] * healpix.core.u.deg, table["dec_deg"] * healpix.core.u.deg, 2**order, order="nested"
            )
            for order in orders
        )
        north = coarse < 4 * 4 ** orders[0]
        for order, pixels, where in ((orders[0], coarse, north), (orders[1], fine, ~north)):
            for pixel in np.unique(pixels[where]).tolist():
                path = (
                    folder / "dataset" / f"Norder={order}" / f"Dir={pixel // 10000 * 10000}" / f"Npix={pixel}.parquet"
                )
                path.parent.mkdir(parents=True, exist_ok=True)
                part = table[where & (pixels == pixel)]
                write_parquet(part, path)
                info.writerow([order, pixel, len(part)])
    return folder


def same_stars(one, other):
    """The same stars, in whatever order, but for the names that rows give."""
    order, other_order = (np.lexsort((catalog.dec_deg, catalog.ra_deg)) for catalog in (one, other))
    for name in ("ra_deg", "dec_deg", "pm_dec_mas_yr"):
        np.testing.assert_array_equal(getattr(one, name)[order], getattr(other, name)[other_order])
    np.testing.assert_array_equal(one.flux_jy("J")[order], other.flux_jy("J")[other_order])


def inside(table, ra_deg, dec_deg, radius_deg):
    from astropy.coordinates import angular_separation

    radians = np.radians([table["ra_deg"], table["dec_deg"]])
    return table[np.degrees(angular_separation(*radians, *np.radians([ra_deg, dec_deg]))) <= radius_deg]


REGIONS = [(10.0, -20.0, 15.0), (0.0, 89.0, 5.0), (359.5, 0.0, 3.0), (120.0, 45.0, 180.0)]


@pytest.mark.parametrize("kind", ["ecsv", "parquet", "groups", "folder", "list", "hats"])
@pytest.mark.parametrize("region", [*REGIONS, [REGIONS[0], REGIONS[2]]])
def test_stars_of_a_region(tmp_path, stars, kind, region):
    """By astropy's separations, whatever the files."""
    if kind == "ecsv":
        stars.write(path := tmp_path / "x.ecsv")
    elif kind in ("parquet", "groups"):
        table = stars[np.argsort(stars["dec_deg"])] if kind == "groups" else stars
        path = write_parquet(table, tmp_path / "x.parquet", 200 if kind == "groups" else None)
    elif kind == "hats":
        path = write_hats(stars, tmp_path / "hats")
    else:
        parts = [
            write_parquet(stars[start : start + 1000], tmp_path / f"{start}.parquet")
            for start in range(0, N_STAR, 1000)
        ]
        path = tmp_path if kind == "folder" else parts
    catalog = ws.StarCatalog.read(path, region=region)
    cones = region if isinstance(region, list) else [region]
    wanted = np.unique(np.concatenate([inside(stars, *cone)["ra_deg"] for cone in cones]))
    np.testing.assert_array_equal(np.sort(catalog.ra_deg), wanted)


@pytest.mark.ci
def test_parts_make_the_whole(tmp_path, stars):
    whole = ws.StarCatalog.read(write_parquet(stars, tmp_path / "x.parquet"))
    grouped = ws.StarCatalog.read(write_parquet(stars, tmp_path / "y.parquet", 300))
    assert grouped.checksum == whole.checksum  # names, too
    assert whole.id.tolist()[:2] == ["1", "2"]
    folder = tmp_path / "parts"
    folder.mkdir()
    for start in range(0, N_STAR, 1000):
        write_parquet(stars[start : start + 1000], folder / f"{start}.parquet")
    assert ws.StarCatalog.read(folder).checksum == whole.checksum
    same_stars(ws.StarCatalog.read(write_hats(stars, tmp_path / "hats")), whole)


def test_names_count_groups_that_are_passed_over(tmp_path, stars):
    table = stars[np.argsort(stars["dec_deg"])]
    path = write_parquet(table, tmp_path / "x.parquet", 100)
    whole, some = ws.StarCatalog.read(path), ws.StarCatalog.read(path, region=(10.0, 60.0, 8.0))
    rows = np.flatnonzero(np.isin(whole.ra_deg, some.ra_deg))
    assert len(rows) == len(some) > 3
    assert some.id.tolist() == whole.id[rows].tolist()


def test_only_columns_that_are_used_are_read(tmp_path, stars, monkeypatch):
    path = write_parquet(stars, tmp_path / "x.parquet", 1000)
    asked = []
    read = parquet.ParquetFile.read_row_group

    def noted(self, group, columns=None, **options):
        asked.append((group, tuple(columns)))
        return read(self, group, columns=columns, **options)

    monkeypatch.setattr(parquet.ParquetFile, "read_row_group", noted)
    assert len(ws.StarCatalog.read(path)) == N_STAR
    used = ("ra_deg", "dec_deg", "mag_Ks", "mag_J", "pm_dec_mas_yr")
    assert asked == [(group, used) for group in range(4)]
    asked.clear()
    write_parquet(stars[np.argsort(stars["dec_deg"])], path, 1000)
    ws.StarCatalog.read(path, region=(10.0, 80.0, 5.0))
    assert [group for group, _ in asked] == [3]


def test_a_survey_of_many_columns_reads_few(tmp_path, monkeypatch):
    """AllWISE by the names of IRSA beside 280 others: 11 columns for its fluxes, and few more."""
    names = ["designation", "ra", "dec", "ph_qual", "cc_flags"]
    names += [f"w{k}mpro" for k in (1, 2, 3, 4)] + [f"{k}_m_2mass" for k in "jhk"] + [f"{k}_msig_2mass" for k in "jhk"]
    columns = {name: np.array([5.0, 6.0]) for name in names}
    columns |= {"designation": ["a", "b"], "ph_qual": ["AAAA", "AAAU"], "cc_flags": ["0000", "0000"]}
    path = write_parquet(Table(columns | {f"other_{k}": [0.0, 0.0] for k in range(280)}), tmp_path / "x.parquet")
    asked = []
    read = parquet.ParquetFile.read_row_group

    def noted(self, group, columns=None, **options):
        asked.extend(columns)
        return read(self, group, columns=columns, **options)

    monkeypatch.setattr(parquet.ParquetFile, "read_row_group", noted)
    assert len(ws.StarCatalog.read(path, "allwise")) == 2
    assert set(asked) == set(names)


def test_the_release_of_gaia_is_told_by_columns_that_are_not_read(tmp_path):
    table = Table({"ra": [10.0], "dec": [20.0], "pmra": [0.0], "pmdec": [3.6e4], "phot_g_mean_mag": [9.0],
                   "bp_rp": [1.0], "radius_val": [1.0]})  # fmt: skip
    catalog = ws.StarCatalog.read(write_parquet(table, tmp_path / "x.parquet"))
    assert catalog.dec_deg[0] == pytest.approx(20.0 - 0.155, abs=1e-6)


def test_a_limit_in_any_of_some_bands(tmp_path, stars):
    path = write_parquet(stars, tmp_path / "x.parquet")
    for limit, keep in (
        ({"Ks": 4.0}, stars["mag_Ks"] <= 4.0),
        ({"Ks": 4.0, "J": 4.5}, (stars["mag_Ks"] <= 4.0) | (stars["mag_J"] <= 4.5)),
    ):
        np.testing.assert_array_equal(ws.StarCatalog.read(path, limit=limit).ra_deg, stars["ra_deg"][keep])
    with pytest.raises(
        ws.InputError, match=r"x.parquet: limit: must name a band of the file, which has J, Ks, got W3$"
    ):
        ws.StarCatalog.read(path, limit={"W3": 8.0})


@pytest.mark.parametrize(
    ("option", "value"),
    [("region", (1, 2)), ("region", (1, 95, 1)), ("region", (1, 2, 0)), ("region", "x"), ("region", [(1, 2, np.nan)]),
     ("limit", 8.0), ("limit", {}), ("limit", {"W3": "x"}), ("limit", {"Q": 8.0}), ("limit", {"W3": np.nan})],
)  # fmt: skip
def test_bad_regions_and_limits_are_named(tmp_path, stars, option, value):
    path = write_parquet(stars[:2], tmp_path / "x.parquet")
    with pytest.raises(ws.InputError, match=rf"^{option}: (band )?must be "):
        ws.StarCatalog.read(path, **{option: value})


def test_a_scene_reads_a_region(tmp_path, stars):
    path = write_parquet(stars, tmp_path / "x.parquet")
    sky = {"catalog": str(path), "region": [10.0, -20.0, 15.0], "limit": {"Ks": 6.0}}
    scene = ws.Scene.load("stss").replace(sky=sky)
    scene.save(tmp_path / "scene.toml")
    assert (again := ws.Scene.load(tmp_path / "scene.toml")) == scene
    assert again.sky.region == ((10.0, -20.0, 15.0),)
    wanted = ws.StarCatalog.read(path, region=(10.0, -20.0, 15.0), limit={"Ks": 6.0})
    assert load_catalog(again.sky).checksum == wanted.checksum
    assert 0 < len(wanted) < N_STAR / 20


@pytest.mark.parametrize(
    ("sky", "message"),
    [
        ({"table": True}, "Scene: sky.table: must be a name or a whole number, got True"),
        ({"table": 1.5}, "Scene: sky.table: must be a name or a whole number, got 1.5"),
        ({"region": "x"}, "Scene: sky.region: must be (ra_deg, dec_deg, radius_deg) with -90 <= dec_deg <= 90 and "),
        ({"limit": {"Q": 1.0}}, "Scene: sky.limit: band must be one of "),
        ({"epoch_jyear": 1e9}, "sky.epoch_jyear: must be within 100,000 years of 2000, got 1000000000.0"),
    ],
)
def test_fields_of_a_sky_are_named_as_they_stand(tmp_path, stars, sky, message):
    path = write_parquet(stars[:2], tmp_path / "x.parquet")
    with pytest.raises(ws.InputError) as caught:
        load_catalog(ws.Scene.load("stss").replace(sky={"catalog": str(path), **sky}).sky)
    assert str(caught.value).startswith(message) and caught.value.field.rpartition(".")[2] in (*sky, "sky")


def test_a_table_of_a_sky_is_a_number_or_a_name():
    assert ws.Sky(catalog="x.fits", table=np.int64(2)).table == 2
    assert ws.Sky(catalog="x.fits", table="b").table == "b"
    with pytest.raises(ws.InputError, match=r"^Sky: table: must be a name or a whole number, got 1\.5$"):
        ws.Sky(catalog="x.fits", table=1.5)


# --- HATS ---


def test_tiles_near_a_cone_are_all_that_hold_its_stars(tmp_path, stars):
    """Every star within a cone is in a tile that is said to be near; most of the others are passed over."""
    folder = HatsFolder(write_hats(stars, tmp_path / "hats"))
    tables = [parquet.read_table(tile.path) for tile in folder.tiles]
    assert folder.n_row.tolist() == [len(table) for table in tables]
    for region in REGIONS[:3]:
        near = {tile.path for tile in folder.near([region])}
        for tile, table in zip(folder.tiles, tables, strict=True):
            found = inside(Table({key: table[key].to_numpy() for key in ("ra_deg", "dec_deg")}), *region)
            assert not len(found) or tile.path in near
        assert len(near) < len(folder.tiles) / 2


@pytest.mark.ci
def test_layouts_of_hats(tmp_path, stars):
    whole = ws.StarCatalog.read(write_hats(stars, tmp_path / "a"))
    # As folders of files, without a count of rows, in a collection.
    folder = write_hats(stars, tmp_path / "c" / "main")
    (folder / "partition_info.csv").unlink()
    for file in list((folder / "dataset").rglob("*.parquet")):
        inner = file.with_suffix("")
        inner.mkdir()
        file.rename(inner / "part0.parquet")
    (tmp_path / "c" / "collection.properties").write_text("hats_primary_table_url=main\n")
    assert is_hats(tmp_path / "c")
    assert ws.StarCatalog.read(tmp_path / "c").checksum == whole.checksum
    assert HatsFolder(tmp_path / "c").n_row.sum() == N_STAR
    (folder / "hats.properties").write_text("hats_frame = galactic\n")
    with pytest.raises(ws.InputError, match="hats_frame: must be equatorial, got 'galactic'"):
        HatsFolder(tmp_path / "c")


def test_folders_without_stars(tmp_path):
    with pytest.raises(ws.InputError, match="must hold files of stars"):
        ws.StarCatalog.read(tmp_path)
    (tmp_path / "hats.properties").write_text("a=b\n")
    (tmp_path / "dataset" / "Norder=1").mkdir(parents=True)
    with pytest.raises(ws.InputError, match="must hold partitions"):
        ws.StarCatalog.read(tmp_path)
    with pytest.raises(ws.InputError, match="path: must name at least one file"):
        ws.StarCatalog.read([])
