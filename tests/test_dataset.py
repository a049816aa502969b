"""Data sets: every format holds the same images and labels, and independent readers agree."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import tarfile

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from conftest import slow

import warpsim as ws
from warpsim.cli import main
from warpsim.dataset.layout import draw_sequence, split_of
from warpsim.dataset.writers import _chunk_shape
from warpsim.files import write_fits_table

parquet = pytest.importorskip("pyarrow.parquet")
Image = pytest.importorskip("PIL.Image")

SCENE = {"camera__n_row": 48, "camera__n_col": 64, "camera__fov_deg": 0.5}
GIVEN = {"n_sequence": 5, "n_frame": 3, "interval_s": 0.2, "n_sensor": 2, "bands": ["A", "C"], "seed": 3}
SAMPLE = {
    "detector.nei_w_cm2": {"log_uniform": [1e-18, 3e-18]},
    "pointing.up": {"choice": ["zenith", "north"]},
    "optics.aperture_m": {"uniform": [0.3, 0.5]},
}
PLANES = {"signal": True, "masks": True, "contributions": True, "stars": True}
FORMATS = ("fits", "fits-frames", "png", "tiff", "zarr", "webdataset")


def recipe(**changes):
    scene = ws.Scene.load("stss").replace(**SCENE)
    return ws.Recipe(**({"scene": scene, "sample": SAMPLE, "least_box_px": 1e-3, **GIVEN, **PLANES} | changes))


class Folders:
    """A data set in each format, `folders / name`, written when it is first asked for."""

    def __init__(self, top):
        self.top = top

    def __truediv__(self, name):
        folder = self.top / name
        if not folder.exists():
            if name == "zarr":
                pytest.importorskip("zarr", minversion="3")
            ws.write_dataset(recipe(format=name, sequences_per_shard=2), folder, n_worker=1, device="cpu")
        return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    return Folders(tmp_path_factory.mktemp("sets"))


@pytest.fixture(scope="module")
def rendered():
    """What the sequences show, rendered one by one without data sets."""
    made = recipe()
    frames = {}
    for number in range(GIVEN["n_sequence"]):
        sequence = draw_sequence(made, number)
        frames[number] = ws.Renderer(sequence.scene, "cpu").render(
            range(3), sequence.sensors, ["A", "C"], keep_signal=True, keep_stars=True
        )
    return frames


def tables(folder, name):
    """All tables of a name, by split, as lists of rows."""
    files = {split: sorted((folder / split).rglob(f"*{name}.parquet")) for split in ("train", "val", "test")}
    return {
        split: list(itertools.chain(*(parquet.read_table(path).to_pylist() for path in paths)))
        for split, paths in files.items()
    }


def read_counts(folder, row):
    """An image, read as its row of the table of images says, by programs that know nothing of warpsim."""
    file, item = row["file"], row["item"]
    if file.endswith(".frames.fits"):
        return fits.getdata(folder / file, json.loads(item)[0])
    if file.endswith(".fits"):
        return fits.getdata(folder / file)[json.loads(item)[0]]
    if file.endswith((".png", ".tif")):
        return np.asarray(Image.open(folder / file)).astype(np.uint16)
    if file.endswith(".tar"):
        member, _, band = item.partition("[")
        with tarfile.open(folder / file) as tar:
            return np.load(io.BytesIO(tar.extractfile(member).read()))[int(band[:-1])]
    import zarr

    return zarr.open(folder / file, mode="r")[tuple(json.loads(item))]


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.ci
def test_images_are_where_the_tables_say_and_are_those_of_the_renderer(folders, rendered, name):
    rows = list(itertools.chain(*tables(folders / name, "images").values()))
    assert sorted(row["image_id"] for row in rows) == list(range(1, 5 * 3 * 2 * 2 + 1))
    for row in rows:
        frames = rendered[row["sequence"]]
        expected = frames.counts[row["frame"], frames.sensors.index(row["sensor"]), "AC".index(row["band"])]
        assert np.array_equal(read_counts(folders / name, row), expected)
        assert (row["width"], row["height"]) == (64, 48)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.ci
def test_tables_are_the_same_in_all_formats(folders, name):
    for table in ("truth", "stars"):
        assert_same(tables(folders / name, table), tables(folders / "fits", table))
    first, other = tables(folders / name, "images"), tables(folders / "fits", "images")
    places = ("file", "item")
    assert [{k: v for k, v in row.items() if k not in places} for row in first["train"]] == [
        {k: v for k, v in row.items() if k not in places} for row in other["train"]
    ]


def assert_same(first, other):
    for split in first:
        for one, two in zip(first[split], other[split], strict=True):
            np.testing.assert_equal(one, two)


@pytest.mark.ci
def test_wcs_of_the_table_of_images_is_that_of_the_frames(folders, rendered):
    for row in tables(folders / "fits", "images")["train"]:
        wcs, frames = WCS(json.loads(row["wcs"])), rendered[row["sequence"]]
        xy_px = np.array([[0.0, 0.0], [63.0, 10.0], [31.5, 23.5]])
        expected = frames.wcs(row["frame"], row["sensor"]).all_pix2world(xy_px, 0)
        np.testing.assert_allclose(wcs.all_pix2world(xy_px, 0), expected, rtol=0, atol=1e-12)


@pytest.mark.ci
def test_truth_is_that_of_the_renderer(folders, rendered):
    rows = tables(folders / "fits", "truth")
    for number, frames in rendered.items():
        mine = [row for row in itertools.chain(*rows.values()) if row["sequence"] == number]
        for name in ("frame", "sensor", "band", "target", "x_px", "y_px", "irradiance_w_cm2", "in_fov"):
            np.testing.assert_array_equal([row[name] for row in mine], np.asarray(frames.truth[name]))


@pytest.mark.ci
def test_other_planes_are_the_same_in_all_formats(folders, rendered):
    import OpenImageIO as oiio
    import zarr

    number = split_of(recipe())["train"][1]
    frames = rendered[number]
    sensor, place = frames.sensors[1], 1
    expected = {
        "signal_w_cm2": frames.signal_w_cm2[2, place, 0],
        "mask": frames.target_mask(2, sensor, "A"),
        "contributions_w_cm2": frames.contributions_w_cm2(2, sensor, "A"),
    }
    assert expected["mask"].any() and expected["contributions_w_cm2"].any()
    home = f"train/{number:06d}/{sensor}_A"
    store = zarr.open(folders / "zarr" / "train" / "images.zarr", mode="r")
    with tarfile.open(folders / "webdataset" / "train" / "000000.tar") as tar:
        for name, plane in expected.items():
            assert np.array_equal(fits.getdata(folders / "fits" / f"{home}.{name}.fits")[2], plane)
            extension = fits.getdata(folders / "fits-frames" / f"{home}.{name}.frames.fits", "FRAME000002")
            assert np.array_equal(extension, plane)
            assert np.array_equal(store[name][1, 2, place, 0], plane)
            member = tar.extractfile(f"{number:06d}_000002_{sensor}.{name}.npy")
            assert np.array_equal(np.load(io.BytesIO(member.read()))[0], plane)
    stem = folders / "png" / home / "000002"
    exr = oiio.ImageBuf(str(stem.with_suffix(".signal_w_cm2.exr"))).get_pixels(oiio.FLOAT)[..., 0]
    assert np.array_equal(exr, expected["signal_w_cm2"])
    assert np.array_equal(np.asarray(Image.open(stem.with_suffix(".mask.png"))), expected["mask"])
    assert np.array_equal(np.load(stem.with_suffix(".contributions_w_cm2.npy")), expected["contributions_w_cm2"])


@pytest.mark.ci
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of pycocotools
def test_coco_is_read_by_its_own_tools_and_boxes_hold_the_light(folders, rendered, capsys):
    coco = pytest.importorskip("pycocotools.coco")
    files = {name: folders / name / "annotations" / "train.json" for name in FORMATS}
    sets = {name: coco.COCO(path) for name, path in files.items()}
    capsys.readouterr()
    annotations = sets["fits"].anns
    assert len(annotations) > 50 and all(read.anns == annotations for read in sets.values())
    assert {cat["name"] for cat in sets["fits"].cats.values()} == {"center", "sphere", "cylinder", "cone"}
    held, drawn = [], {}
    for annotation in annotations.values():
        image = sets["fits"].imgs[annotation["image_id"]]
        mask, (x, y, w, h) = sets["fits"].annToMask(annotation), annotation["bbox"]
        assert mask.shape == (image["height"], image["width"])
        frames = rendered[image["sequence"]]
        if image["id"] not in drawn:
            drawn[image["id"]] = frames.contributions_w_cm2(image["frame"], image["sensor"], image["band"])
        plane = drawn[image["id"]][frames.scene.target_names.index(annotation["target"])]
        column, row = annotation["keypoints"][0] - 0.5, annotation["keypoints"][1] - 0.5
        if 2 <= column <= 61 and 2 <= row <= 45:  # whole on the array
            brightest = np.unravel_index(plane.argmax(), plane.shape)
            assert abs(brightest[0] - row) <= 0.5 + 1e-6 and abs(brightest[1] - column) <= 0.5 + 1e-6
            rows, columns = np.arange(48) + 0.5, np.arange(64) + 0.5  # pixel centres in COCO's coordinates
            inside = np.outer((rows > y) & (rows < y + h), (columns > x) & (columns < x + w))
            held.append(plane[inside].sum() / plane.sum())
    videos = {video["id"]: video for video in sets["fits"].dataset["videos"]}
    assert len(videos) == len(split_of(recipe())["train"]) * 2 * 2
    for image in sets["fits"].imgs.values():
        video = videos[image["video_id"]]
        assert video["name"] == f"{image['sequence']:06d}_{image['sensor']}_{image['band']}"
        assert (video["width"], video["height"], image["frame_id"]) == (64, 48, image["frame"])
    tracks = {(sets["fits"].imgs[one["image_id"]]["sequence"], one["target"]): set() for one in annotations.values()}
    for one in annotations.values():
        tracks[sets["fits"].imgs[one["image_id"]]["sequence"], one["target"]].add(one["track_id"])
    assert all(len(ids) == 1 for ids in tracks.values()) and len(set.union(*tracks.values())) == len(tracks)
    # A box holds 84 % of the light that pixels collect: not of each image, but of all places that a point may have.
    assert len(held) > 50 and np.mean(held) == pytest.approx(0.84, abs=0.05)


@pytest.mark.parametrize("name", ["fits", "zarr"])
@pytest.mark.ci
def test_a_sequence_is_rebuilt_from_its_folder_and_rendered_to_the_same_counts(folders, name):
    for split, rows in tables(folders / name, "images").items():
        for number in {row["sequence"] for row in rows}:
            sequence = ws.rebuild_sequence(folders / name, number)
            assert sequence.values.keys() == SAMPLE.keys() and number in split_of(recipe())[split]
            n_frame = sequence.scene.frames.count
            frames = ws.Renderer(sequence.scene, "cpu").render(range(n_frame), sequence.sensors)
            mine = [row for row in rows if row["sequence"] == number]
            assert len(mine) == frames.counts[...].size / (48 * 64) == 3 * 2 * 2
            for row in mine:
                at = row["frame"], frames.sensors.index(row["sensor"]), frames.bands.index(row["band"])
                assert np.array_equal(read_counts(folders / name, row), frames.counts[at])


@pytest.mark.ci
def test_sequences_of_changed_files_are_not_rebuilt(folders, tmp_path, monkeypatch):
    catalog = tmp_path / "stars.fits"
    write_fits_table(ws.StarCatalog.synthetic(500, seed=1).to_table(), catalog)
    scene = ws.Scene.load("stss").replace(sky__catalog=str(catalog), **SCENE)
    ws.write_dataset(ws.Recipe(scene, n_sequence=2, n_frame=1, bands="A"), tmp_path / "data", n_worker=1, device="cpu")
    assert ws.rebuild_sequence(tmp_path / "data", 1).number == 1
    for number, message in (
        (2, "number: must be below 2, the sequences there are, got 2"),
        (-1, "must be a whole num"),
    ):
        with pytest.raises(ws.InputError, match=message):
            ws.rebuild_sequence(tmp_path / "data", number)
    with pytest.raises(ws.InputError, match="holds no complete data set"):
        ws.rebuild_sequence(tmp_path, 0)
    monkeypatch.setattr("warpsim.dataset.read_dataset.__version__", "99.0")
    with pytest.warns(UserWarning, match=r"written by warpsim .*, this is 99\.0: counts may differ"):
        ws.rebuild_sequence(tmp_path / "data", 0)
    write_fits_table(ws.StarCatalog.synthetic(400, seed=2).to_table(), catalog)
    with pytest.raises(ws.InputError, match=r"manifest\.json: star catalog was changed since the data set was written"):
        ws.rebuild_sequence(tmp_path / "data", 0)
    catalog.unlink()
    with pytest.raises(ws.InputError, match=r"stars\.fits"):
        ws.rebuild_sequence(tmp_path / "data", 0)


@pytest.mark.ci
def test_sequences_are_told_with_what_was_drawn(folders):
    made = recipe()
    for name in FORMATS:
        rows = parquet.read_table(folders / name / "sequences.parquet").to_pylist()
        assert [row["sequence"] for row in rows] == list(range(5))
        for row in rows:
            sequence = draw_sequence(made, row["sequence"])
            assert {field: row[field] for field in SAMPLE} == sequence.values
            assert row["start_s"] == sequence.scene.frames.start_s and row["sensors"] == ",".join(sequence.sensors)
            assert row["sequence"] in split_of(made)[row["split"]] and row["seed"] == sequence.scene.seed


@pytest.mark.ci
def test_the_manifest_has_every_file_and_the_recipe(folders):
    for name in FORMATS:
        folder = folders / name
        manifest = json.loads((folder / "manifest.json").read_text())
        checksums = {k: v for record in manifest["shards"].values() for k, v in record["files"].items()}
        checksums |= manifest["files"]
        files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
        assert set(checksums) == set(files) - {"manifest.json"}
        bands = {band: ws.Band(band, **facts) for band, facts in manifest["responses"].items()}
        assert bands == recipe().scene.scenario.bands
        for file, checksum in checksums.items():
            assert hashlib.sha256(files[file].read_bytes()).hexdigest() == checksum
        assert ws.Recipe.from_dict(manifest["recipe"]) == recipe(format=name, sequences_per_shard=2)


@pytest.mark.parametrize("name", ["zarr", slow("fits")])
@pytest.mark.ci
def test_bytes_do_not_depend_on_workers_or_batches(folders, tmp_path, monkeypatch, name):
    monkeypatch.setattr("warpsim.dataset.shard.BYTES_PER_CALL", 1)  # one frame a call
    given = recipe(format=name, sequences_per_shard=2)
    ws.write_dataset(given, tmp_path / "one", n_worker=1, device="cpu")
    monkeypatch.undo()
    ws.write_dataset(given, tmp_path / "two", n_worker=2, device="cpu")
    for folder in (tmp_path / "one", tmp_path / "two"):
        for path in (folders / name).rglob("*"):
            if path.is_file():
                assert (folder / path.relative_to(folders / name)).read_bytes() == path.read_bytes(), path


@pytest.mark.ci
def test_a_long_sequence_fills_several_shards_of_an_array(tmp_path, monkeypatch):
    zarr = pytest.importorskip("zarr", minversion="3")
    monkeypatch.setattr("warpsim.dataset.recipe.SHARD_BYTES", 5 * 2 * 48 * 64)
    given = recipe(
        format="zarr", sequences_per_shard=1, n_frame=12, n_sensor=1, bands="A", n_sequence=2, split={"all": 1},
        signal=False, masks=False, contributions=False, stars=False,
    )  # fmt: skip
    ws.write_dataset(given, tmp_path, n_worker=1, device="cpu")
    array = zarr.open(tmp_path / "all" / "images.zarr" / "counts", mode="r")
    assert array.shards == (1, 5, 1, 1, 48, 64)
    for number in range(2):
        sequence = draw_sequence(given, number)
        frames = ws.Renderer(sequence.scene, "cpu").render(range(12), sequence.sensors, "A")
        assert np.array_equal(array[number], frames.counts.numpy())


@pytest.mark.parametrize(
    ("shape", "n_frame", "chunk"),
    [
        ((100, 2, 3, 128, 128), 100, (1, 5, 1, 1, 128, 128)),
        ((7, 1, 1, 128, 128), 7, (1, 7, 1, 1, 128, 128)),
        ((97, 1, 1, 128, 128), 97, (1, 1, 1, 1, 128, 128)),
        ((8, 1, 1, 1024, 1024), 8, (1, 1, 1, 1, 1024, 1024)),
        ((8, 1, 1, 30, 128, 128), 8, (1, 1, 1, 1, 6, 128, 128)),
        ((8, 1, 1, 3, 64, 64), 8, (1, 8, 1, 1, 3, 64, 64)),
        ((8, 1, 1, 30, 1024, 1024), 8, (1, 1, 1, 1, 1, 1024, 1024)),
    ],
)
def test_chunks_hold_several_small_images_and_fill_shards(shape, n_frame, chunk):
    found = _chunk_shape(shape, np.uint16, n_frame)
    assert found == chunk
    assert all(n % c == 0 for n, c in zip((n_frame, *shape[1:]), found[1:], strict=True))


def test_satnet_annotations_and_previews_lie_beside_the_images(tmp_path):
    given = recipe(satnet=True, preview="gif", n_sequence=1, split={"all": 1}, sample=None, bands="A", coco=False)
    ws.write_dataset(given, tmp_path, n_worker=1, device="cpu")
    home = tmp_path / "all" / "000000"
    sensors = draw_sequence(given, 0).sensors
    names = [f"{sensor}_A.{frame:06d}.json" for sensor in sensors for frame in range(3)]
    assert sorted(path.name for path in (home / "Annotations").iterdir()) == sorted(names)
    record = json.loads((home / "Annotations" / names[0]).read_text())["data"]
    assert (record["sensor"]["width"], record["sensor"]["height"]) == (64, 48) and record["objects"]
    film = Image.open(home / f"{sensors[0]}_A.gif")
    assert film.n_frames == 3 and not (tmp_path / "annotations").exists()


def test_targets_must_keep_their_number_in_one_zarr_array_of_contributions(tmp_path):
    pytest.importorskip("zarr", minversion="3")
    given = recipe(format="zarr", sample={"targets.1.count": {"choice": [2, 3]}})
    with pytest.raises(ws.InputError, match=r"sequence \d: contributions in one Zarr array need the same targets"):
        ws.write_dataset(given, tmp_path / "data", n_worker=1, device="cpu")


def test_the_command_makes_a_data_set_of_a_scene(tmp_path, capsys):
    options = ["--sequences", "2", "--frames", "2", "--bands", "A", "--seed", "5", "--format", "png", "--workers", "1"]
    assert main(["dataset", "stss", "-o", str(tmp_path / "data"), *options]) == 0
    assert "4 images of 2 sequences" in capsys.readouterr().out
    assert main(["dataset", "stss", "-o", str(tmp_path / "data"), *options]) == 0
    assert "all were there already" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["nothing"], "nothing: must be a preset (stss"),
        (["stss", "--sequences", "many"], "--sequences: must be a whole number, got 'many'"),
        (["stss", "--sequences", "0"], "stss: n_sequence: must be >= 1, got 0"),
        (
            ["stss", "--format", "exr"],
            "format: must be 'fits', 'fits-frames', 'png', 'tiff', 'zarr' or 'webdataset', got 'e",
        ),
        (["stss", "--workers", "0"], "n_worker: must be a whole number >= 1, got 0"),
        (["stss", "--device", "tpu"], "device: must be one of cpu"),
    ],
)
def test_bad_options_are_told_in_one_line_and_leave_nothing(options, message, tmp_path, capsys):
    assert main(["dataset", *options, "-o", str(tmp_path / "data")]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not (tmp_path / "data").exists()
