"""Label files, opened by others: pyarrow and pandas, pycocotools, and plain JSON."""

import importlib
import json
import tracemalloc

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import MaskedColumn, Table

import warpsim as ws
from warpsim.files import write_fits_table
from warpsim.render.descriptions import DESCRIPTIONS
from warpsim.render.resolution import blur_half_px

pyarrow = pytest.importorskip("pyarrow")

SENSOR = "sat11"
FRAME = 60
N_TARGET = 30
PLACE_PX = 1e-6
"""Places in COCO files have six decimals."""
VALUE_RTOL = 1e-6
"""Other numbers there have seven digits."""


@pytest.fixture(scope="module")
def frames(scene):
    return ws.Renderer(scene, device="cpu").render([FRAME, 100], [SENSOR, "sat27"], ["A", "C"], keep_stars=True)


@pytest.fixture(scope="module")
def table(frames):
    return ws.labels.label_table(frames, least_nei=8.0, with_masks=True)


def same_tables(one, other):
    assert one.colnames == other.colnames
    for name in one.colnames:
        a, b = np.asarray(one[name]), np.asarray(other[name])
        assert a.dtype == b.dtype, name
        np.testing.assert_array_equal(a, b)
        assert one[name].unit == other[name].unit


# --- Parquet ---------------------------------------------------------------------------------------------------------


def test_parquet_gives_back_the_table(table, tmp_path):
    path = tmp_path / "labels.parquet"
    ws.labels.write_parquet(table, path, {"split": "train", "n": np.int64(3)})
    back = ws.labels.read_parquet(path)
    same_tables(table, back)
    own = {"LEAST_NEI": 8.0, "LEAST_BOX_PX": 3.0, "split": "train", "n": 3}
    assert back.meta == table.meta | own and back.meta["SEED"] == 2024
    assert [back[name].info.description for name in back.colnames] == [DESCRIPTIONS[name] for name in table.colnames]
    assert list(tmp_path.iterdir()) == [path]


def test_parquet_of_truth_and_stars(frames, tmp_path):
    for name, one in (("truth", frames.truth), ("stars", frames.stars), ("none", frames.truth[:0])):
        ws.labels.write_parquet(one, tmp_path / name)
        back = ws.labels.read_parquet(tmp_path / name)
        if len(one):
            same_tables(one, back)
        assert back.colnames == one.colnames and len(back) == len(one)
        assert [one[name].info.description for name in one.colnames] == [DESCRIPTIONS[name] for name in one.colnames]


def test_parquet_of_a_table_from_fits(frames, tmp_path):
    """Its numbers have the other byte order, and its texts are bytes."""
    write_fits_table(frames.truth, tmp_path / "truth.fits")
    assert "COMMENT" not in fits.getheader(tmp_path / "truth.fits", 1)  # no block of YAML
    ws.labels.write_parquet(Table.read(tmp_path / "truth.fits"), tmp_path / "truth.parquet")
    same_tables(frames.truth, ws.labels.read_parquet(tmp_path / "truth.parquet"))


def test_parquet_keeps_what_is_masked(tmp_path):
    table = Table({"x_px": MaskedColumn([1.0, 2.0], mask=[False, True]), "target": ["a", "b"], "in_fov": [True, False]})
    table["target"] = MaskedColumn(["a", "b"], mask=[True, False])
    table["in_fov"] = MaskedColumn([True, False], mask=[False, True])
    ws.labels.write_parquet(table, tmp_path / "x")
    back = ws.labels.read_parquet(tmp_path / "x")
    for name in table.colnames:
        assert back[name].tolist() == table[name].tolist()  # None where masked


def test_parquet_is_the_same_bytes(table, tmp_path):
    for name in ("one", "two"):
        ws.labels.write_parquet(table.copy(), tmp_path / name)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_parquet_is_read_without_warpsim(table, tmp_path):
    parquet = importlib.import_module("pyarrow.parquet")
    ws.labels.write_parquet(table, tmp_path / "x.parquet")
    read = parquet.read_table(tmp_path / "x.parquet")
    assert read.column_names == table.colnames and read.num_rows == len(table)
    assert read.schema.field("range_km").metadata[b"unit"] == b"km"
    assert read.schema.field("box_x_px").metadata[b"description"].startswith(b"left edge")
    assert pyarrow.types.is_dictionary(read.schema.field("sensor").type)
    assert read["sensor"].to_pylist() == table["sensor"].tolist()
    assert json.loads(read.schema.metadata[b"warpsim"])["LEAST_NEI"] == 8.0
    bright = parquet.read_table(tmp_path / "x.parquet", filters=[("snr", ">", 40.0)])  # pushed down to the file
    assert bright.num_rows == np.count_nonzero(table["snr"] > 40.0)


def test_parquet_is_read_by_pandas(table, tmp_path):
    pandas = pytest.importorskip("pandas")
    ws.labels.write_parquet(table, tmp_path / "x.parquet")
    read = pandas.read_parquet(tmp_path / "x.parquet")
    assert list(read.columns) == table.colnames
    np.testing.assert_array_equal(read["x_px"], table["x_px"])
    assert read["target"].astype(str).tolist() == table["target"].tolist()


def test_parquet_errors(table, tmp_path, monkeypatch):
    with pytest.raises(ws.InputError, match="cannot be read"):
        ws.labels.read_parquet(tmp_path / "missing.parquet")
    (tmp_path / "broken").write_bytes(b"PAR1 nothing")
    with pytest.raises(ws.InputError, match="broken: cannot be read"):
        ws.labels.read_parquet(tmp_path / "broken")
    with pytest.raises(ws.InputError, match="meta: JSON cannot hold a value of type set"):
        ws.labels.write_parquet(table, tmp_path / "x", {"a": {1}})

    def without(name, *rest):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", without)
    with pytest.raises(ws.InputError, match=r"needs pyarrow, .* pip install 'warpsim\[parquet\]'"):
        ws.labels.write_parquet(table, tmp_path / "x")
    assert [path.name for path in tmp_path.iterdir()] == ["broken"]


# --- COCO ------------------------------------------------------------------------------------------------------------


def images_of(frames, table):
    """Images of a frame set, in the order of the table's rows."""
    number = 0
    for frame in frames.frames:
        for sensor in frames.sensors:
            for band in frames.bands:
                rows = table[number * N_TARGET : (number + 1) * N_TARGET]
                name = f"{sensor}_{band}/{frame:06d}.png"
                yield {"id": number, "file_name": name, "width": 128, "height": 128, "sensor": sensor}, rows
                number += 1


@pytest.fixture(scope="module")
def coco_path(frames, table, tmp_path_factory):
    path = tmp_path_factory.mktemp("coco") / "labels.json"
    categories = ws.labels.coco_categories(frames.scene)
    ws.labels.write_coco(path, images_of(frames, table), categories, {"description": "a test"})
    assert [file.name for file in path.parent.iterdir()] == ["labels.json"]
    return path


def test_coco_by_hand(frames, table, coco_path):
    data = json.loads(coco_path.read_text())
    assert list(data) == ["info", "licenses", "categories", "images", "annotations", "videos"]
    assert data["videos"] == []  # the images say nothing of videos
    assert data["info"]["description"] == "a test" and "outer corner" in data["info"]["coordinates"]
    assert [category["name"] for category in data["categories"]] == ["center", "sphere", "cylinder", "cone"]
    assert [category["id"] for category in data["categories"]] == [1, 2, 3, 4]
    assert all(category["keypoints"] == ["centre"] for category in data["categories"])
    assert [image["sensor"] for image in data["images"]] == [SENSOR, SENSOR, "sat27", "sat27"] * 2
    visible = np.flatnonzero(table["visible"])
    assert len(data["annotations"]) == len(visible) > 100
    names = {category["id"]: category["name"] for category in data["categories"]}
    for annotation, number in zip(data["annotations"], visible, strict=True):
        row = table[number]
        assert annotation["image_id"] == number // N_TARGET
        assert annotation["id"] == annotation["image_id"] * 100_000 + number % N_TARGET + 1
        assert annotation["target"] == row["target"] and names[annotation["category_id"]] == row["class"]
        box = [row[name] for name in ("box_x_px", "box_y_px", "box_w_px", "box_h_px")]
        np.testing.assert_allclose(annotation["bbox"], box, rtol=0, atol=PLACE_PX)
        x, y, visibility = annotation["keypoints"]
        np.testing.assert_allclose([x - 0.5, y - 0.5], [row["x_px"], row["y_px"]], rtol=0, atol=PLACE_PX)
        np.testing.assert_allclose([annotation["x_px"], annotation["y_px"]], [x - 0.5, y - 0.5], atol=1e-9)
        assert visibility == row["keypoint_visibility"] in (1, 2) and annotation["num_keypoints"] == 1
        for name in ("snr", "snr_peak", "irradiance_w_cm2", "range_km"):
            np.testing.assert_allclose(annotation[name], row[name], rtol=VALUE_RTOL)
        mask = ws.labels.rle_to_mask(annotation["segmentation"]["counts"], annotation["segmentation"]["size"])
        if row["mask_rle"]:
            assert annotation["area"] == mask.sum()
        else:
            assert not mask.any() and annotation["area"] == pytest.approx(box[2] * box[3], abs=1e-5)
        assert annotation["iscrowd"] == 0
    assert {annotation["keypoints"][2] for annotation in data["annotations"]} == {1, 2}


@pytest.mark.filterwarnings("ignore:__array__ implementation")  # pycocotools and NumPy 2
def test_coco_loads_with_pycocotools(frames, table, coco_path):
    coco = pytest.importorskip("pycocotools.coco").COCO(str(coco_path))
    assert len(coco.getImgIds()) == 8
    masks = frames.target_mask(FRAME, SENSOR, "A", 8.0)
    rows = table[:N_TARGET]
    union = np.zeros((128, 128), dtype=bool)
    for annotation in coco.loadAnns(coco.getAnnIds(imgIds=[0])):
        mask = coco.annToMask(annotation).astype(bool)
        union |= mask
        row = rows[rows["target"] == annotation["target"]][0]
        if row["keypoint_visibility"] == 2:
            assert mask[round(row["y_px"]), round(row["x_px"])]  # the keypoint's own pixel
    np.testing.assert_array_equal(union, masks > 0)
    cones = coco.getAnnIds(catIds=coco.getCatIds(catNms=["cone"]), imgIds=[0])
    assert len(cones) == np.count_nonzero(rows["visible"] & (rows["class"] == "cone"))


def test_coco_scores_its_own_labels(coco_path):
    """The evaluation of pycocotools finds every box where it is."""
    cocoeval = pytest.importorskip("pycocotools.cocoeval")
    coco = importlib.import_module("pycocotools.coco").COCO(str(coco_path))
    found = [
        {"image_id": one["image_id"], "category_id": one["category_id"], "bbox": one["bbox"], "score": one["snr"]}
        for one in coco.dataset["annotations"]
    ]
    scores = cocoeval.COCOeval(coco, coco.loadRes(found), "bbox")
    scores.evaluate()
    scores.accumulate()
    scores.summarize()
    assert scores.stats[0] == pytest.approx(1.0)


def test_coco_ids_do_not_depend_on_other_images(frames, table, coco_path, tmp_path):
    some = [image for image in images_of(frames, table) if image[0]["id"] in (2, 5)]
    ws.labels.write_coco(tmp_path / "some.json", some, ws.labels.coco_categories(frames.scene))
    whole = {one["id"]: one for one in json.loads(coco_path.read_text())["annotations"]}
    part = json.loads((tmp_path / "some.json").read_text())["annotations"]
    assert len({one["id"] for one in part}) == len(part) > 0
    assert all(whole[one["id"]] == one for one in part)


def test_coco_videos(frames, table, tmp_path):
    """Images of a sequence, a sensor and a band are a video; a target is one instance in all of a sequence."""

    def images():
        for number, (image, rows) in enumerate(images_of(frames, table)):
            frame, view = divmod(number, 4)
            sequence = {"sequence": 7, "band": "AC"[view % 2]} if view else {}
            yield image | {"video_id": view + 1, "frame_id": frame} | sequence, rows

    ws.labels.write_coco(tmp_path / "x.json", images(), ws.labels.coco_categories(frames.scene))
    data = json.loads((tmp_path / "x.json").read_text())
    assert [video["name"] for video in data["videos"]] == [SENSOR, "000007_sat11_C", "000007_sat27_A", "000007_sat27_C"]
    assert data["videos"][1] == {
        "id": 2, "name": "000007_sat11_C", "width": 128, "height": 128, "sequence": 7, "sensor": SENSOR, "band": "C",
    }  # fmt: skip
    video_of = {image["id"]: image["video_id"] for image in data["images"]}
    names = frames.scene.target_names
    for one in data["annotations"]:
        first = 0 if video_of[one["image_id"]] == 1 else 700_000
        assert one["track_id"] == one["instance_id"] == first + names.index(one["target"]) + 1


def test_coco_without_masks(frames, tmp_path):
    table = ws.labels.label_table(frames)
    ws.labels.write_coco(tmp_path / "x.json", images_of(frames, table), ws.labels.coco_categories(frames.scene))
    one = json.loads((tmp_path / "x.json").read_text())["annotations"][0]
    assert "segmentation" not in one and one["area"] == pytest.approx(one["bbox"][2] * one["bbox"][3], abs=1e-5)


def test_coco_without_images(scene, tmp_path):
    ws.labels.write_coco(tmp_path / "x.json", [], ws.labels.coco_categories(scene))
    data = json.loads((tmp_path / "x.json").read_text())
    assert data["images"] == data["annotations"] == []


@pytest.mark.ci
def test_coco_is_written_as_it_comes(frames, table, tmp_path):
    """Memory does not grow with the file: ten times the annotations take no more, but for the images' ids."""
    categories, (image, rows) = ws.labels.coco_categories(frames.scene), next(images_of(frames, table))

    def peak_bytes(n_image):
        images = (({**image, "id": number}, rows) for number in range(n_image))
        tracemalloc.start()
        ws.labels.write_coco(tmp_path / "x.json", images, categories)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    few, many = peak_bytes(30), peak_bytes(300)
    assert (tmp_path / "x.json").stat().st_size > 2e6
    assert many < few + 200 * 300


def test_coco_errors_leave_nothing_behind(frames, table, tmp_path):
    path, categories = tmp_path / "x.json", ws.labels.coco_categories(frames.scene)
    image, rows = next(images_of(frames, table))
    wrong = [
        ([({"id": 1, "width": 3}, rows)], categories, "images: must have file_name, height, got id, width"),
        ([(image, rows), (image, rows)], categories, "ids must be unique, got 0 twice"),
        ([({**image, "id": -1}, rows)], categories, "id must be a whole number >= 0, got -1"),
        ([(image, rows)], categories[:2], "categories: must have 'cylinder', the class of the target 'cylinder"),
    ]
    for images, known, words in wrong:
        with pytest.raises(ws.InputError, match=words):
            ws.labels.write_coco(path, images, known)
    assert not list(tmp_path.iterdir())


def test_categories_of_several_groups(scene):
    """Kinds of one name in several groups are one category."""
    (first,) = scene.to_dict()["groups"]
    targets = [{**first["targets"][0], "name": "other"}, {**first["targets"][1], "name": "cone", "count": 1}]
    group = {"name": "second", "trajectory": first["trajectory"], "targets": targets}
    categories = ws.labels.coco_categories(scene.replace(groups=[first, group]))
    names = [category["name"] for category in categories]
    assert names == ["center", "sphere", "cylinder", "cone", "other"]
    assert categories[3]["supercategory"] == "cone" and [one["id"] for one in categories] == [1, 2, 3, 4, 5]


# --- SatNet ----------------------------------------------------------------------------------------------------------


SATSIM_NAMES = {
    "class_name", "class_id", "y_min", "x_min", "y_max", "x_max", "y_center", "x_center", "bbox_height", "bbox_width",
    "source", "magnitude", "y_start", "x_start", "y_mid", "x_mid", "y_end", "x_end", "seg_id", "object_name",
    "object_id", "pixels", "snr",
}  # fmt: skip
"""Of an object, by satsim/io/satnet.py of SatSim 0.27."""


def rows_of(table, frame, sensor, band):
    return table[(table["frame"] == frame) & (table["sensor"] == sensor) & (table["band"] == band)]


def test_satnet_record(frames, table):
    rows = rows_of(table, 100, "sat27", "C")
    record = ws.labels.satnet_record(frames, 100, "sat27", "C", rows, "sat27/000100.fits")
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    data = record["data"]
    assert data["file"] == {"dirname": "sat27", "filename": "000100.fits", "sequence_id": 100}
    assert data["sensor"]["height"] == data["sensor"]["width"] == 128
    assert data["sensor"]["iFOVx"] == pytest.approx(frames.scene.camera.fov_deg / 128, rel=1e-4)
    visible = rows[rows["visible"]]
    assert len(data["objects"]) == len(visible) > 20
    for one, row in zip(data["objects"], visible, strict=True):
        assert set(one) >= SATSIM_NAMES
        assert (one["class_name"], one["class_id"], one["type"]) == ("Satellite", 1, "point")
        # SatSim: detector coordinates are normalized * size - 0.5
        assert one["x_mid"] * 128 - 0.5 == pytest.approx(row["x_px"], abs=1e-9)
        assert one["y_mid"] * 128 - 0.5 == pytest.approx(row["y_px"], abs=1e-9)
        assert one["x_min"] * 128 == pytest.approx(row["box_x_px"], abs=1e-9)
        assert (one["y_max"] - one["y_min"]) * 128 == pytest.approx(row["box_h_px"], abs=1e-9)
        assert one["x_center"] == pytest.approx((one["x_min"] + one["x_max"]) / 2, abs=1e-12)
        assert one["bbox_width"] == pytest.approx(one["x_max"] - one["x_min"], abs=1e-12)
        assert one["pixels"] == [[round(row["y_px"]), round(row["x_px"])]] and one["snr"] == [row["snr_peak"]]
        assert frames.scene.target_names[one["seg_id"] - 1] == one["object_name"] == row["target"]
        light = ws.PHYSICS["physical"].irradiance_w_cm2(one["magnitude"], "C")
        assert light == pytest.approx(one["irradiance_w_cm2"], rel=1e-9)
    other = ws.labels.satnet_record(frames, 100, "sat27", "C", rows, {"filename": "x", "sequence": ["x", "y"]})
    assert other["data"]["file"] == {"filename": "x", "sequence": ["x", "y"], "sequence_id": 100}


def test_satnet_stars(frames, table):
    rows = rows_of(table, FRAME, SENSOR, "A")
    plain = ws.labels.satnet_record(frames, FRAME, SENSOR, "A", rows, "x.fits")["data"]["objects"]
    both = ws.labels.satnet_record(frames, FRAME, SENSOR, "A", rows, "x.fits", with_stars=True)["data"]["objects"]
    stars = frames.stars[(frames.stars["frame"] == FRAME) & (frames.stars["sensor"] == SENSOR) & frames.stars["in_fov"]]
    assert both[: len(plain)] == plain and len(both) == len(plain) + len(stars) > len(plain)
    half_px = blur_half_px(frames.instrument, "A")[0]
    for one in both[len(plain) :]:
        row = stars[stars["catalog_row"] == one["object_id"]][0]
        assert (one["class_name"], one["class_id"], one["object_name"]) == ("Star", 2, row["id"])
        assert one["x_mid"] * 128 - 0.5 == pytest.approx(row["x_px"], abs=1e-9)
        on_edge = one["x_min"] == 0 or one["x_max"] == 1
        assert on_edge or one["bbox_width"] * 128 == pytest.approx(max(2 * half_px, 3.0), abs=1e-9)
        assert one["irradiance_w_cm2"] == row["irradiance_w_cm2"][0]
    light = [one["irradiance_w_cm2"] for one in both[len(plain) :]]
    assert light == sorted(light, reverse=True)


@pytest.mark.ci
def test_satnet_lines(scene):
    """A camera that stares: targets are lines from their start to their end."""
    z = scene.scenario.view_axes(SENSOR, scene.scenario.instrument.frame_time_s([FRAME]))[0, 2]
    place = [float(np.degrees(np.arctan2(z[1], z[0])) % 360), float(np.degrees(np.arcsin(z[2])))]
    moving = scene.replace(detector__exposure_s=0.5, pointing={"kind": "fixed", "ra_dec_deg": place})
    frames = ws.Renderer(moving, device="cpu").render([FRAME], [SENSOR], ["A"])
    rows = ws.labels.label_table(frames)
    objects = ws.labels.satnet_record(frames, FRAME, SENSOR, "A", rows, "x.fits")["data"]["objects"]
    for one, row in zip(objects, rows[rows["visible"]], strict=True):
        assert one["type"] == "line"
        assert (one["x_end"] - one["x_start"]) * 128 == pytest.approx(row["dx_px"], abs=1e-9)
        assert (one["y_end"] - one["y_start"]) * 128 == pytest.approx(row["dy_px"], abs=1e-9)
        assert min(one["x_start"], one["x_end"]) > one["x_min"] and max(one["x_start"], one["x_end"]) < one["x_max"]


def test_satnet_errors(frames, table):
    with pytest.raises(ws.InputError, match="satnet_record: frame 3 of 'sat11' in band 'A' was not rendered"):
        ws.labels.satnet_record(frames, 3, SENSOR, "A", table[:0], "x.fits")
    without = ws.Renderer(frames.scene, device="cpu").render([FRAME], [SENSOR], ["A"])
    with pytest.raises(ws.InputError, match="keep_stars"):
        ws.labels.satnet_record(without, FRAME, SENSOR, "A", table[:0], "x.fits", with_stars=True)
