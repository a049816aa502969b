"""Every file says where it is from: scene, epoch and time scale, seeds, version; read without warpsim."""

import io
import json
import tarfile

import numpy as np
import pytest
from astropy.io import fits

import warpsim as ws

zarr = pytest.importorskip("zarr")
parquet = pytest.importorskip("pyarrow.parquet")
Image = pytest.importorskip("PIL.Image")
oiio = pytest.importorskip("OpenImageIO")

HITS = {"rate_cm2_s": 2000.0, "integration_s": 0.1, "nei_per_um": 2.0, "pixel_pitch_um": 30.0}
CHANGES = {"camera__n_row": 48, "camera__n_col": 64, "camera__fov_deg": 0.5, "bands": ["A", "C"], "noise_seed": 11}
SHARED = {"SCENE": "told", "TIMESYS": "UTC", "CREATOR": f"warpsim {ws.__version__}"}
EPOCHS = ["2025-01-01T14:00:00", "2025-02-01T14:00:00"]


@pytest.fixture(scope="module")
def scene():
    detector = {"detector__hits": HITS, "detector__flicker": {"fraction": 0.01, "nei": 20.0}}
    return ws.Scene.load("stss").replace(name="told", **CHANGES, **detector)


def header_words(header):
    return {name: header[name] for name in header if isinstance(name, str)}


def words_of(path):
    """What a file says of itself, one dict for each part that stands alone."""
    if path.suffix == ".fits":
        with fits.open(path) as file:
            # The primary HDU of a table is no place for data, nor are those of maps, which share their primary's words.
            parts = [hdu for hdu in file if hdu.size or (hdu.name == "PRIMARY" and len(file) > 2)]
            return [header_words(hdu.header) for hdu in parts if ".maps." not in path.name or hdu.name == "PRIMARY"]
    if path.suffix in (".png", ".tif", ".exr"):
        return [json.loads(oiio.ImageBuf(str(path)).spec().get_string_attribute("ImageDescription"))]
    if path.suffix == ".parquet":
        return [json.loads(parquet.read_schema(path).metadata[b"warpsim"])]
    if path.suffix == ".tar":
        with tarfile.open(path) as tar:
            names = [name for name in tar.getnames() if name.endswith(".json")]
            return [json.load(io.BytesIO(tar.extractfile(name).read())) for name in names]
    text = json.loads(path.read_text())
    if path.name == "manifest.json":
        return [text["provenance"]]
    if path.parent.name == "annotations":
        return [text["info"]]
    return [text["data"]["file"] if path.parent.name == "Annotations" else text["attributes"]]


def files_of(folder):
    """Files that can say something: no shards of arrays, no plain arrays of NumPy, no animations."""
    found = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return [path for path in found if "c" not in path.relative_to(folder).parts and path.suffix not in (".npy", ".gif")]


@pytest.mark.ci
def test_every_file_of_a_run_says_where_it_is_from(scene, tmp_path):
    formats = ["fits", "fits-frames", "png", "tiff", "exr", "zarr"]
    run = {"sensors": ["sat11", "sat47"], "bands": ["A"], "device": "cpu", "stars": True, "formats": formats}
    ws.render_to_folder(scene, tmp_path / "run", range(60, 62), **run)
    ws.calibrate(scene, tmp_path / "dark", sensors=["sat11"], bands=["A"], n_frame=2)
    expected = SHARED | {"DATEREF": "2025-01-01T14:00:00", "SEED": 2024, "NOISSEED": 11}
    files = [*files_of(tmp_path / "run"), *files_of(tmp_path / "dark")]
    kinds = {path.name for path in files}
    assert {"truth.fits", "stars.fits", "artifacts.fits", "sat11.maps.fits", "manifest.json", "zarr.json"} <= kinds
    for path in files:
        parts = words_of(path)
        assert parts, path
        for words in parts:
            assert words | expected == words, path


@pytest.mark.parametrize("name", ["fits", "fits-frames", "png", "tiff", "zarr", "webdataset"])
@pytest.mark.ci
def test_every_file_of_a_data_set_says_where_it_is_from(scene, tmp_path, name):
    """Files of one sequence have its seeds and its epoch, which is drawn; those of several the recipe's seed."""
    sharded = name in ("zarr", "webdataset")
    planes = {"signal": True, "masks": True, "contributions": True, "stars": True, "artifacts": True}
    given = {
        "n_sequence": 3,
        "n_frame": 2,
        "interval_s": 0.2,
        "seed": 5,
        "split": {"train": 1.0},
        "satnet": not sharded,
    }
    recipe = ws.Recipe(
        scene, sample={"epoch_utc": {"choice": EPOCHS}}, format=name, sequences_per_shard=2, **given, **planes
    )
    ws.write_dataset(recipe, tmp_path, n_worker=1, device="cpu")
    rows = {row["sequence"]: row for row in parquet.read_table(tmp_path / "sequences.parquet").to_pylist()}
    assert {row["epoch_utc"] for row in rows.values()} == set(EPOCHS)
    files = files_of(tmp_path)
    assert {path.suffix for path in files} >= {".parquet", ".json"} and len(files) > 5
    for path in files:
        of_one = (
            path.parent.parent.name == "train" or path.parent.parent.parent.name == "train" or path.suffix == ".tar"
        )
        for words in words_of(path):
            assert words | SHARED == words, path
            if of_one and path.name != "zarr.json":
                number = words.get("sequence", int(path.relative_to(tmp_path).parts[1].partition(".")[0]))
                row = rows[number]
                assert (words["SEED"], words["NOISSEED"], words["DATEREF"]) == (*[row["seed"]] * 2, row["epoch_utc"])
            if path.suffix in (".parquet", ".json", ".tar") and path.parent.name != "Annotations":
                assert words["RECSEED"] == 5, path


@pytest.mark.ci
def test_states_of_sensors_are_columns_of_the_table_of_images(scene, tmp_path):
    """They are those that FITS cubes have, which astropy and SciPy check elsewhere."""
    recipe = ws.Recipe(scene, n_sequence=1, n_frame=3, n_sensor=2, interval_s=0.5, split={"all": 1.0})
    ws.write_dataset(recipe, tmp_path, n_worker=1, device="cpu")
    (path,) = tmp_path.rglob("images.parquet")
    table = parquet.read_table(path)
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert (units["sensor_x_m"], units["sensor_vz_m_s"], units["sensor_qw"]) == (b"m", b"m / s", None)
    words = {f"sensor_{axis}_m": f"POS_{axis}" for axis in "xyz"} | {
        f"sensor_q{axis}": f"QUAT_{axis}" for axis in "xyzw"
    }
    words |= {f"sensor_v{axis}_m_s": f"VEL_{axis}" for axis in "xyz"}
    for row in table.to_pylist():
        with fits.open(tmp_path / row["file"]) as file:
            frame = file["FRAMES"].data[json.loads(row["item"])[0]]
        assert row["date_obs"] == frame["DATE_OBS"]
        for name, word in words.items():
            assert row[name] == frame[word.upper()], name
        assert np.linalg.norm([row[f"sensor_q{axis}"] for axis in "xyzw"]) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.ci
def test_tables_of_artifacts_are_those_of_the_frames(scene, tmp_path):
    for name in ("fits", "webdataset"):
        recipe = ws.Recipe(
            scene, n_sequence=2, n_frame=2, interval_s=0.5, format=name, artifacts=True, split={"all": 1}
        )
        ws.write_dataset(recipe, tmp_path / name, n_worker=1, device="cpu")
        found = [parquet.read_table(path).to_pylist() for path in sorted((tmp_path / name).rglob("*artifacts.parquet"))]
        rows = [row for rows in found for row in rows]
        assert {row["kind"] for row in rows} == {"hit", "flicker"}
        images = [parquet.read_table(path).to_pylist() for path in sorted((tmp_path / name).rglob("*images.parquet"))]
        known = {row["image_id"]: row for rows in images for row in rows}
        for row in rows:
            image = known[row["image_id"]]
            assert all(row[key] == image[key] for key in ("sequence", "frame", "sensor", "band"))
        if name == "fits":
            assert all(row["charge_e"] is None for row in rows if "charge_e" in row)
            brightest = max(rows, key=lambda row: row["irradiance_w_cm2"] if row["kind"] == "hit" else 0.0)
            image = known[brightest["image_id"]]
            counts = fits.getdata(tmp_path / name / image["file"])[json.loads(image["item"])[0]]
            nei = min(brightest["irradiance_w_cm2"], image["sei_w_cm2"]) / image["nei_w_cm2"] - 6.0  # less the noise
            mean = image["blank_counts"] + nei * image["counts_per_nei"]
            assert counts[brightest["y_px"], brightest["x_px"]] > mean > image["blank_counts"]


def test_artifacts_that_no_detector_has_are_refused():
    with pytest.raises(ws.InputError, match="artifacts: needs a detector with hits or flicker, got True"):
        ws.Recipe("stss", artifacts=True)
