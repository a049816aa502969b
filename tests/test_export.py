"""Exports of data sets: read by the trainers' own libraries, and by their rules where a library is too large."""

from __future__ import annotations

import configparser
import csv
import functools
import json
from pathlib import Path

import numpy as np
import pytest

import warpsim as ws
from warpsim.cli import main
from warpsim.dataset import export as export_module
from warpsim.dataset import read_dataset
from warpsim.output.checkpoints import locked

parquet = pytest.importorskip("pyarrow.parquet")
Image = pytest.importorskip("PIL.Image")

SCENE = {
    "camera__n_row": 48, "camera__n_col": 64, "camera__fov_deg": 0.5, "optics__aperture_m": 1.5,
    "targets__1__class": "ball",
}  # fmt: skip
GIVEN = {"n_sequence": 5, "n_frame": 4, "interval_s": 0.5, "n_sensor": 2, "bands": ["A", "C"], "seed": 3}
SAMPLE = {"pointing.offset_px": {"choice": [[0.0, 0.0], [31.0, -20.0], [-31.9, 23.9], [90.0, 0.0]]}}
"""Targets half off the array, and views of nothing."""
FORMATS = ("fits", "fits-frames", "png", "tiff", "zarr", "webdataset")
LAYOUTS = {"yolo": "bands", "mot": None, "huggingface": "frames"}
BOX_PX = 1e-5
"""Texts have six decimals of a pixel, or eight of the image's size."""


class Sets:
    """Data sets and their exports, written when first asked for."""

    def __init__(self, top):
        self.top = top

    def data(self, name="fits"):
        folder = self.top / name
        if not folder.exists():
            scene = ws.Scene.load("stss").replace(**SCENE)
            recipe = ws.Recipe(
                scene=scene, sample=SAMPLE, format=name, masks=True, split={"train": 3, "val": 2}, **GIVEN
            )
            ws.write_dataset(recipe, folder, n_worker=1, device="cpu")
        return folder

    def export(self, layout, name="fits", **options):
        folder = self.top / "-".join(map(str, (name, layout, *options.values())))
        if not folder.exists():
            given = {"channels": LAYOUTS[layout]} | options
            ws.export_dataset(self.data(name), folder, layout, **given)
        return folder

    def coco(self, split, name="fits"):
        return json.loads((self.data(name) / "annotations" / f"{split}.json").read_text())

    def images(self, split):
        """By (sequence, sensor, band, frame): COCO's image, and its annotations by track."""
        coco = self.coco(split)
        found = {image["id"]: (image, {}) for image in coco["images"]}
        for one in coco["annotations"]:
            found[one["image_id"]][1][one["track_id"]] = one
        return {
            tuple(image[name] for name in ("sequence", "sensor", "band", "frame")): (image, labels)
            for image, labels in found.values()
        }

    @functools.cache  # noqa: B019 - there is one
    def blend(self, split):
        """Part of the light in its own pixel that is of others, by image and target."""
        found = {}
        for path in sorted((self.data() / split).glob("*/truth.parquet")):
            rows = ws.labels.read_parquet(path)
            keys = zip(rows["image_id"].tolist(), rows["target"].tolist(), strict=True)
            found |= dict(zip(keys, rows["blend_fraction"].tolist(), strict=True))
        return found

    def level_nei(self, image):
        """Levels of an image above blank [NEI], by its cube and its keywords."""
        from astropy.io import fits

        with fits.open(self.data() / image["file_name"]) as file:
            counts = file[0].data[json.loads(image["item"])[0]].astype(np.float64)
        levels = ws.Scene.load("stss").scenario.instrument.levels[image["band"]]
        return (counts - levels.blank_counts) / levels.counts_per_nei


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    made = Sets(tmp_path_factory.mktemp("exports"))
    made.data()
    return made


def files_of(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.ci
def test_all_formats_of_images_give_the_same_bytes(sets, layout):
    pytest.importorskip("zarr", minversion="3")
    expected = files_of(sets.export(layout))
    for name in FORMATS[1:]:
        found = files_of(sets.export(layout, name))
        del found["export.json"]
        assert found == {path: data for path, data in expected.items() if path != "export.json"}


# --- COCO ------------------------------------------------------------------------------------------------------------


@pytest.mark.ci
def test_mmdetection_drops_no_box(sets):
    """Its rule: w >= 1, h >= 1, area > 0, and inside the image in part."""
    n_cut = 0
    for split in ("train", "val"):
        for image, labels in sets.images(split).values():
            for one in labels.values():
                x, y, w, h = one["bbox"]
                assert w >= 1 and h >= 1 and one["area"] > 0 and x >= 0 and y >= 0
                assert x + w <= image["width"] + BOX_PX and y + h <= image["height"] + BOX_PX
                n_cut += min(w, h) < 3 - BOX_PX
    assert n_cut > 0


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of pycocotools
def test_pycocotools_reads_boxes_masks_and_classes(sets, capsys):
    coco = pytest.importorskip("pycocotools.coco").COCO(sets.data() / "annotations" / "train.json")
    assert {category["name"] for category in coco.cats.values()} == {"center", "ball", "cylinder", "cone"}
    balls = coco.loadAnns(coco.getAnnIds(catIds=coco.getCatIds(catNms=["ball"])))
    assert balls and all(one["target"].startswith("sphere") for one in balls)
    for one in balls:
        rows, columns = np.nonzero(coco.annToMask(one))
        if len(rows) and min(one["bbox"][2:]) >= 3 - BOX_PX:  # the mask's middle is in the box
            x, y, w, h = one["bbox"]
            assert x <= np.median(columns) + 0.5 <= x + w and y <= np.median(rows) + 0.5 <= y + h


# --- YOLO ------------------------------------------------------------------------------------------------------------


def yolo_labels(path, n_class):
    """Labels by the rules of Ultralytics 8.3 (verify_image_label)."""
    rows = [line.split() for line in path.read_text().splitlines()]
    assert all(len(row) == 5 for row in rows)
    labels = np.array(rows, dtype=np.float32).reshape(-1, 5)
    if len(labels):
        assert labels[:, 1:].max() <= 1 and labels.min() >= 0
        assert labels[:, 0].max() < n_class and len(np.unique(labels, axis=0)) == len(labels)
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def test_yolo_boxes_are_those_of_coco(sets):
    yaml = pytest.importorskip("yaml")
    folder = sets.export("yolo")
    data = yaml.safe_load((folder / "data.yaml").read_text())
    assert (data["names"], data["nc"], data["channels"]) == (["center", "ball", "cylinder", "cone"], 4, 3)
    n_label = 0
    for split in ("train", "val"):
        assert data[split] == f"images/{split}"
        known = sets.images(split)
        names = {category["id"]: category["name"] for category in sets.coco(split)["categories"]}
        pictures = sorted((folder / "images" / split).iterdir())
        assert len(pictures) == len(known) / 2
        for path in pictures:
            image = Image.open(path)
            assert (image.mode, image.size) == ("RGB", (64, 48))
            sequence, sensor, bands, frame = path.stem.split("_")
            labels = yolo_labels(folder / "labels" / split / f"{path.stem}.txt", data["nc"])
            found = [known[int(sequence), sensor, band, int(frame)][1] for band in bands.split("+")]
            tracks = sorted({track for one in found for track in one})
            assert len(labels) == len(tracks)
            n_label += len(labels)
            for label, track in zip(labels, tracks, strict=True):
                both = np.array([one[track]["bbox"] for one in found if track in one])
                low, high = both[:, :2].min(axis=0), (both[:, :2] + both[:, 2:]).max(axis=0)
                centre, size = label[1:3] * [64, 48], label[3:] * [64, 48]
                np.testing.assert_allclose([centre - size / 2, centre + size / 2], [low, high], atol=BOX_PX)
                one = next(one[track] for one in found if track in one)
                assert data["names"][int(label[0])] == names[one["category_id"]]
    assert n_label > 100
    assert json.loads((folder / "export.json").read_text())["labels"] == n_label


def test_provenance_is_that_of_the_data_set(sets):
    folder = sets.export("yolo")
    words = json.loads((sets.data() / "manifest.json").read_text())["provenance"]
    assert words.keys() == {"SCENE", "TIMESYS", "DATEREF", "CREATOR", "RECSEED"} and words["RECSEED"] == GIVEN["seed"]
    assert json.loads((folder / "export.json").read_text())["provenance"] == words
    path = sorted((folder / "images" / "train").iterdir())[3]
    text = json.loads(Image.open(path).text["Description"])
    assert text.pop("image_id") in {image["id"] for image, _ in sets.images("train").values()} and text == words


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs the list of open files")
@pytest.mark.parametrize("name", ["fits", "webdataset"])
def test_few_files_are_open_and_none_afterwards(sets, name, tmp_path, monkeypatch):
    def opened():
        links = {path.readlink() for path in Path("/proc/self/fd").iterdir() if path.is_symlink()}
        return sum(path.is_relative_to(sets.data(name)) for path in links)

    def counted(self, row, read=export_module.DatasetReader.counts):
        counts = read(self, row)
        most.append(opened())
        return counts

    most = []
    monkeypatch.setattr(read_dataset, "OPEN_FILES", 2)
    monkeypatch.setattr(export_module.DatasetReader, "counts", counted)
    ws.export_dataset(sets.data(name), tmp_path / "out", "yolo")
    assert (max(most), opened()) == (2, 0)


@pytest.mark.parametrize("channels", ["bands", "frames", None])
@pytest.mark.ci
def test_grey_is_the_stated_map_of_nei(sets, channels):
    """Back from grey to NEI by the numbers that are written down: within half a step of grey."""
    folder = sets.export("yolo", channels=channels, knee_nei=3.0, top_nei=50.0, bands=["C"] if channels else None)
    facts = json.loads((folder / "export.json").read_text())["tone_map"]
    low, knee, top = facts["low_nei"], facts["knee_nei"], facts["top_nei"]
    assert (low, knee, top) == (-6.0, 3.0, 50.0)
    known = sets.images("train")
    for path in sorted((folder / "images" / "train").iterdir())[::5]:
        grey = np.asarray(Image.open(path)).astype(np.float64)
        sequence, sensor, band, frame = path.stem.split("_")
        if channels is None:
            assert grey.ndim == 2
        shown = {
            None: [(band, int(frame))],
            "bands": [("C", int(frame)), None, None],
            "frames": [("C", max(0, int(frame) - back)) for back in (2, 1, 0)],
        }[channels]
        for number, what in enumerate(shown):
            plane = grey if channels is None else grey[..., number]
            if what is None:
                assert not plane.any()
                continue
            nei = sets.level_nei(known[int(sequence), sensor, *what][0])
            ends = np.arcsinh(low / knee), np.arcsinh(top / knee)
            edges = knee * np.sinh(ends[0] + (plane[..., None] + [-0.501, 0.501]) / 255 * (ends[1] - ends[0]))
            cut = np.clip(nei, low, top)
            assert ((edges[..., 0] <= cut) & (cut <= edges[..., 1])).all()
            assert plane.std() > 5  # noise is seen


def test_faint_targets_are_left_out_and_counted(sets, tmp_path):
    known = {
        split: [(row, one) for row, labels in sets.images(split).values() for one in labels.values()]
        for split in ("train", "val")
    }
    snr = np.array([one["snr_peak"] for pairs in known.values() for _, one in pairs])
    least = float(np.median(snr))
    for layout in ("huggingface", "mot"):
        report = ws.export_dataset(sets.data(), tmp_path / layout, layout, least_snr=least)
        assert (report.n_image, report.n_label + report.n_faint) == (5 * 4 * 2 * 2, len(snr))
        assert abs(report.n_faint - np.count_nonzero(snr < least)) <= 1  # seven digits
        assert report.n_hidden == report.n_image * 30 - len(snr) > 0
        assert f"{report.n_faint:,} too faint" in report.text()
    lines = [line.split(",") for path in (tmp_path / "mot").rglob("gt.txt") for line in path.read_text().splitlines()]
    assert len(lines) == len(snr) and sum(line[6] == "0" for line in lines) == report.n_faint


def test_classes_that_are_not_asked_for_stay_without_labels(sets, tmp_path):
    """Numbers of classes follow the order that is asked for; in gt.txt the others have confidence 0."""
    asked = ["cone", "ball"]
    labels = [
        (split, one) for split in ("train", "val") for _, own in sets.images(split).values() for one in own.values()
    ]
    classes = {one["id"]: one["name"] for one in sets.coco("train")["categories"]}
    named = np.array([classes[one["category_id"]] for _, one in labels])
    n_label = np.count_nonzero(np.isin(named, asked))
    assert 0 < n_label < len(named)
    for layout in LAYOUTS:
        report = ws.export_dataset(sets.data(), tmp_path / layout, layout, classes=asked)
        assert (report.n_label, report.n_other, report.n_faint) == (n_label, len(named) - n_label, 0)
        assert f"{report.n_other:,} of other classes" in report.text()
        facts = json.loads((tmp_path / layout / "export.json").read_text())
        assert (facts["classes"], facts["labels"], facts["other_classes"]) == (asked, n_label, report.n_other)
    lines = [line.split() for path in (tmp_path / "yolo").rglob("*_*.txt") for line in path.read_text().splitlines()]
    rows = [
        row for path in (tmp_path / "huggingface").rglob("*.parquet") for row in parquet.read_table(path).to_pylist()
    ]
    numbers = [asked.index(name) for name in named if name in asked]
    assert sorted(int(line[0]) for line in lines) == sorted(numbers)
    assert sorted(number for row in rows for number in row["objects"]["category"]) == sorted(numbers)
    for home in sorted((tmp_path / "mot").glob("warpsim-*/*_*")):
        targets = list(csv.DictReader((home / "gt" / "targets.csv").open()))
        kinds = {one["id"]: one["class"] for one in targets}
        lines = [line.split(",") for line in (home / "gt" / "gt.txt").read_text().splitlines()]
        assert len(kinds) == len(targets) and kinds.keys() == {line[1] for line in lines}
        assert all((line[6] == "1") == (kinds[line[1]] in asked) for line in lines)


# --- MOTChallenge ----------------------------------------------------------------------------------------------------


def tracker_files(sets, top, move_px):
    """Ground truth as if a tracker had found it, moved."""
    for path in sorted((sets.export("mot") / "warpsim-train").glob("*/gt/gt.txt")):
        rows = [line.split(",") for line in path.read_text().splitlines()]
        target = top / "warpsim-train" / "t" / "data" / f"{path.parents[1].name}.txt"
        target.parent.mkdir(parents=True, exist_ok=True)
        moved = [f"{row[0]},{row[1]},{float(row[2]) + move_px},{','.join(row[3:6])},1,-1,-1,-1" for row in rows]
        target.write_text("\n".join(moved))
    return top


@pytest.mark.ci
@pytest.mark.parametrize("move_px", [0.0, 1.6])
def test_trackeval_scores_the_truth_perfect_and_a_shifted_copy_worse(sets, tmp_path, move_px):
    trackeval = pytest.importorskip("trackeval")
    quiet = {"PRINT_RESULTS": False, "PRINT_CONFIG": False, "TIME_PROGRESS": False, "PLOT_CURVES": False}
    silent = {"OUTPUT_SUMMARY": False, "OUTPUT_DETAILED": False, "OUTPUT_EMPTY_CLASSES": False}
    dataset = trackeval.datasets.MotChallenge2DBox(
        {
            "GT_FOLDER": str(sets.export("mot")), "TRACKERS_FOLDER": str(tracker_files(sets, tmp_path, move_px)),
            "BENCHMARK": "warpsim", "SPLIT_TO_EVAL": "train", "PRINT_CONFIG": False,
        }
    )  # fmt: skip
    metrics = [trackeval.metrics.HOTA(), trackeval.metrics.CLEAR({"PRINT_CONFIG": False})]
    evaluator = trackeval.Evaluator({**quiet, **silent, "BREAK_ON_ERROR": True})
    results, _ = evaluator.evaluate([dataset], metrics)
    scores = results["MotChallenge2DBox"]["t"]["COMBINED_SEQ"]["pedestrian"]
    assert scores["CLEAR"]["CLR_TP"] + scores["CLEAR"]["CLR_FN"] > 100
    if move_px == 0.0:
        assert scores["CLEAR"]["MOTA"] == pytest.approx(1.0) and np.allclose(scores["HOTA"]["HOTA"], 1.0)
    else:
        assert scores["CLEAR"]["MOTA"] < 0 and scores["HOTA"]["HOTA"].mean() < 0.5


@pytest.mark.filterwarnings("ignore:Operation with tuple")  # motmetrics with pandas 3
def test_motmetrics_reads_the_truth(sets, tmp_path, monkeypatch):
    motmetrics = pytest.importorskip("motmetrics")
    monkeypatch.setattr(np, "asfarray", np.asarray, raising=False)  # motmetrics 1.4 asks for it; NumPy 2 has none
    found = tracker_files(sets, tmp_path, 0.0) / "warpsim-train" / "t" / "data"
    n_object = 0
    for home in sorted((sets.export("mot") / "warpsim-train").iterdir()):
        if not (home / "gt" / "gt.txt").stat().st_size:
            continue
        truth = motmetrics.io.loadtxt(home / "gt" / "gt.txt", fmt="mot16")
        own = motmetrics.io.loadtxt(found / f"{home.name}.txt", fmt="mot15-2D")
        compared = motmetrics.utils.compare_to_groundtruth(truth, own, "iou", distth=0.5)
        scores = motmetrics.metrics.create().compute(compared, metrics=["mota", "idf1", "num_objects"])
        assert scores["mota"].item() == scores["idf1"].item() == 1.0
        n_object += scores["num_objects"].item()
    assert n_object > 100


BLEND = 1e-4
"""Digits in the file."""


def test_mot_folders_are_complete(sets):
    folder = sets.export("mot")
    videos = (folder / "seqmaps" / "warpsim-val.txt").read_text().split()
    assert videos[0] == "name" and sorted(videos[1:]) == sorted(
        path.name for path in (folder / "warpsim-val").iterdir()
    )
    known = sets.images("val")
    assert len(videos[1:]) == len({key[:3] for key in known}) == 8
    for video in videos[1:]:
        home = folder / "warpsim-val" / video
        info = configparser.ConfigParser()
        info.read(home / "seqinfo.ini")
        assert dict(info["Sequence"]) == {
            "name": video, "imdir": "img1", "framerate": "2", "seqlength": "4", "imwidth": "64", "imheight": "48",
            "imext": ".png", "interval_s": "0.5",
        }  # fmt: skip
        assert sorted(path.name for path in (home / "img1").iterdir()) == [f"00000{n}.png" for n in (1, 2, 3, 4)]
        sequence, sensor, band = video.split("_")
        ids = dict(line.split(",")[:2] for line in (home / "gt" / "targets.csv").read_text().splitlines()[1:])
        for line in (home / "gt" / "gt.txt").read_text().splitlines():
            frame, number, *box, confidence, kind, visibility = map(float, line.split(","))
            one = known[int(sequence), sensor, band, int(frame) - 1][1][int(sequence) * 100_000 + int(number)]
            np.testing.assert_allclose(np.array(box) - [1, 1, 0, 0], one["bbox"], atol=BOX_PX)
            assert (confidence, kind) == (1, 1) and ids[str(int(number))] == one["target"]
            assert abs(visibility - 1 + sets.blend("val")[one["image_id"], one["target"]]) < BLEND


# --- Hugging Face ----------------------------------------------------------------------------------------------------


@pytest.mark.ci
def test_datasets_loads_the_folder_and_its_card(sets, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_DATASETS_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    folder, cache = sets.export("huggingface"), str(tmp_path)
    read = datasets.load_dataset("imagefolder", data_dir=str(folder), cache_dir=cache)
    carded = datasets.load_dataset(str(folder), cache_dir=cache)
    assert set(read) == set(carded) == {"train", "validation"}
    for split, rows in carded.items():
        known = sets.images({"validation": "val"}.get(split, split))
        assert len(rows) == len(read[split]) == len(known)
        for row in rows:
            image, labels = known[row["sequence"], row["sensor"], row["band"], row["frame"]]
            assert row["image_id"] == image["id"] and row["image"].size == (64, 48)
            tracks = [row["sequence"] * 100_000 + number for number in row["objects"]["id"]]
            assert tracks == list(labels)
            np.testing.assert_allclose(
                np.reshape(row["objects"]["bbox"], (-1, 4)),
                np.reshape([one["bbox"] for one in labels.values()], (-1, 4)),
                atol=BOX_PX,
            )
            assert [number + 1 for number in row["objects"]["category"]] == [
                one["category_id"] for one in labels.values()
            ]
    assert any(not row["objects"]["id"] for row in carded["train"])  # an image of nothing
    for rows in carded.values():
        assert rows.features["objects"]["category"].feature.names == ["center", "ball", "cylinder", "cone"]
        assert rows.features["image_id"].dtype == "int64" and rows.features["date_obs"].dtype == "string"


@pytest.mark.ci
def test_a_split_without_a_label_has_types_too(sets, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_DATASETS_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    best = {
        split: max(one["snr_peak"] for _, labels in sets.images(given).values() for one in labels.values())
        for split, given in (("train", "train"), ("validation", "val"))
    }
    poor, rich = sorted(best, key=best.__getitem__)
    folder = tmp_path / "hub"
    report = ws.export_dataset(sets.data(), folder, "huggingface", least_snr=1.001 * best[poor])
    read = datasets.load_dataset(str(folder), cache_dir=str(tmp_path / "cache"))
    assert not any(row["id"] for row in read[poor]["objects"])
    assert read[poor].features == read[rich].features
    assert sum(len(row["id"]) for row in read[rich]["objects"]) == report.n_label > 0


# --- older data sets, and what goes wrong ----------------------------------------------------------------------------


@pytest.mark.ci
def test_boxes_of_older_data_sets_are_widened(tmp_path):
    scene = ws.Scene.load("stss").replace(**SCENE)
    recipe = ws.Recipe(scene=scene, sample=SAMPLE, split={"all": 1}, least_box_px=1e-3, **GIVEN)
    ws.write_dataset(recipe, tmp_path / "data", n_worker=1, device="cpu")
    manifest = json.loads((tmp_path / "data" / "manifest.json").read_text())

    def sizes(name):
        ws.export_dataset(tmp_path / "data", tmp_path / name, "mot")
        lines = [line for path in (tmp_path / name).rglob("gt.txt") for line in path.read_text().splitlines()]
        return np.array([line.split(",")[4:6] for line in lines], dtype=float)

    assert sizes("as it is").min() < 1
    del manifest["recipe"]["least_box_px"]
    (tmp_path / "data" / "manifest.json").write_text(json.dumps(manifest))
    wide = sizes("older")
    assert wide.min() >= 1 and np.median(wide) == 3


def test_a_folder_appears_whole_or_not_at_all(sets, tmp_path, monkeypatch):
    out = tmp_path / "out"
    (tmp_path / ".out.partial" / "out").mkdir(parents=True)  # an export that was killed
    (tmp_path / ".out.partial" / "out" / "data.yaml").write_text("half")
    with monkeypatch.context() as patch:
        calls = iter(range(10))
        read = export_module.DatasetReader.counts

        def failing(self, row):
            if next(calls) == 5:
                assert (tmp_path / ".out.partial" / "out" / "images").is_dir()
                raise OSError(28, "No space left on device")
            return read(self, row)

        patch.setattr(export_module.DatasetReader, "counts", failing)
        with pytest.raises(OSError, match="No space left"):
            ws.export_dataset(sets.data(), out, "yolo")
    assert not list(tmp_path.iterdir())
    with locked(out, tmp_path / ".out.partial"), pytest.raises(ws.InputError, match="another run is writing to it"):
        ws.export_dataset(sets.data(), out, "yolo")
    out.mkdir()
    ws.export_dataset(sets.data(), out, "yolo", splits=["val"])
    assert (out / "data.yaml").exists() and not (out / "images" / "train").exists()
    with pytest.raises(ws.InputError, match="out: holds files already; choose another folder, or remove it"):
        ws.export_dataset(sets.data(), out, "yolo")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--format", "voc"], "format: must be one of yolo, mot, huggingface, got 'voc'"),
        (["--format", "yolo", "--channels", "rgb"], "channels: must be one of bands, frames, got 'rgb'"),
        (["--format", "yolo", "--bands", "B"], "bands: must be among A, C, got 'B'"),
        (["--format", "yolo", "--classes", "star"], "classes: must be among center, ball, cylinder, cone, got 'star'"),
        (["--format", "yolo", "--splits", "test"], "splits: must be among train, val, got 'test'"),
        (["--format", "yolo", "--knee", "5", "--top", "4"], "top_nei: must be above knee_nei = 5, got 4.0"),
        (["--format", "yolo", "--least-snr", "much"], "--least-snr: must be a number, got 'much'"),
        (["--format", "yolo", "--least-snr", "nan"], "least_snr: must be finite, got nan"),
    ],
)
def test_bad_options_are_told_in_one_line_and_leave_nothing(sets, options, message, tmp_path, capsys):
    assert main(["export", str(sets.data()), "-o", str(tmp_path / "out"), *options]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_interrupted_export_promises_nothing(sets, tmp_path, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(export_module.DatasetReader, "counts", interrupted)
    assert main(["export", str(sets.data()), "-o", str(tmp_path / "out"), "--format", "yolo", "--quiet"]) == 130
    assert capsys.readouterr().err == "warpsim: interrupted\n" and not list(tmp_path.iterdir())


def test_what_is_no_data_set_is_refused(sets, tmp_path):
    with pytest.raises(
        ws.InputError, match=r"holds no complete data set: manifest.json of `warpsim dataset` is missing"
    ):
        ws.export_dataset(tmp_path, tmp_path / "out", "yolo")


def test_the_command_exports(sets, tmp_path, capsys):
    options = ["--format", "mot", "--channels", "frames", "--bands", "C", "--splits", "train", "--top", "300"]
    assert main(["export", str(sets.data()), "-o", str(tmp_path / "out"), *options]) == 0
    assert "24 images and" in capsys.readouterr().out
    facts = json.loads((tmp_path / "out" / "export.json").read_text())
    assert (facts["channels"], facts["bands"], facts["splits"]) == ("frames", ["C"], {"train": 24})
