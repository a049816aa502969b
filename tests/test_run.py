"""The main job: what a run leaves in its folder, and what is left when it is killed."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table
from astropy.time import Time

import warpsim as ws
from warpsim.files import sha256_of, whole_file
from warpsim.output.fits_cube import read_cube

COMMAND = [sys.executable, "-m", "warpsim.cli", "render"]


@pytest.fixture(scope="module")
def folder(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "out"
    report = ws.render_to_folder(scene, path, range(60, 66), ["sat11", "sat47"], ["A", "E"], device="cpu")
    assert report.n_image == report.n_image_rendered == 24
    assert str(path) in report.text()
    assert "images per second" in report.text()
    return path


def listing(path):
    return sorted(str(item.relative_to(path)) for item in path.rglob("*"))


@pytest.mark.ci
def test_the_folder_holds_what_was_promised(folder):
    cubes = [f"{sensor}_{band}.fits" for sensor in ("sat11", "sat47") for band in "AE"]
    assert listing(folder) == sorted([*cubes, "contact_sheet.png", "manifest.json", "truth.fits"])


def test_cubes_hold_the_renderers_counts(scene, folder):
    frames = ws.Renderer(scene, device="cpu").render(range(60, 66), ["sat11", "sat47"], ["A", "E"])
    for i, sensor in enumerate(frames.sensors):
        for j, band in enumerate(frames.bands):
            cube = read_cube(folder / f"{sensor}_{band}.fits")
            np.testing.assert_array_equal(cube.counts, frames.counts.numpy()[:, i, j])
            assert list(cube.frames["FRAME"]) == frames.frames
            assert cube.header["SENSOR"] == sensor
            assert cube.header["FILTER"] == band


def test_cubes_are_plain_fits_to_others(folder):
    with fits.open(folder / "sat11_A.fits") as file:
        file.verify("exception")
        assert file[0].data.dtype == np.uint16
        assert file[0].data.shape == (6, 128, 128)
        assert file["FRAMES"].columns.names[:3] == ["FRAME", "TIME_S", "DATE_OBS"]


def test_wcs_of_each_plane_leads_from_sky_to_truth(scene, folder):
    """The main target is in the middle; a second renderer's axes give the same sky."""
    cube = read_cube(folder / "sat11_E.fits")
    frames = ws.Renderer(scene, device="cpu").render(range(60, 66), ["sat11"], ["E"])
    for plane in range(6):
        sky = cube.wcs(plane).pixel_to_world_values(20.0, 100.0)
        x, y = frames.wcs(60 + plane, "sat11").world_to_pixel_values(*sky)
        assert (x, y) == pytest.approx((20.0, 100.0), abs=1e-9)
        seconds = (Time(cube.frames["DATE_OBS"][plane], scale="utc") - scene.epoch).to_value("s")
        assert seconds == pytest.approx(600 + 10 * plane, abs=2e-6)


def test_truth_table(folder):
    truth = Table.read(folder / "truth.fits")
    assert len(truth) == 6 * 2 * 2 * 30
    assert truth["irradiance_w_cm2"].unit == "W / cm2"
    assert set(np.asarray(truth["sensor"]).astype(str)) == {"sat11", "sat47"}
    assert np.asarray(truth["in_fov"]).all()


def test_manifest(scene, folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    assert ws.Scene.from_dict(manifest["scene"]) == scene
    assert manifest["seed"] == scene.seed
    assert manifest["device"]["alias"] == "cpu"
    assert manifest["warpsim"] == ws.__version__
    assert set(manifest["files"]) == set(listing(folder)) - {"manifest.json"}
    assert all(sha256_of(folder / name) == checksum for name, checksum in manifest["files"].items())
    assert manifest["orbit_interpolation"]["measured_error_m"] < 1e-3


@pytest.mark.ci
def test_files_tell_the_response_of_a_custom_band(tmp_path):
    band = ws.Band("notch", [8.0, 8.2, 9.3, 9.5], [0.0, 1.0, 1.0, 0.0], per_photon=True, zero_mag_jy=50.0)
    surface = {f"targets__{k}__surface": {"reflectance": 0.5} for k in range(4)}
    scene = ws.Scene.load("stss").replace(bands=[band, "A"], **surface)
    ws.render_to_folder(scene, tmp_path, [60], ["sat11"], device="cpu")
    header = read_cube(tmp_path / "sat11_notch.fits").header
    edges_um = [header[key] for key in ("WAVEMIN", "WAVELNTH", "WAVEMAX")]
    assert edges_um == [band.half_power_um[0], band.isophotal_um, band.half_power_um[1]]
    assert header["RESPONSE"] == "photon"
    msx = read_cube(tmp_path / "sat11_A.fits").header
    assert [msx[key] for key in ("WAVEMIN", "WAVELNTH", "WAVEMAX", "RESPONSE")] == [6.8, 8.28, 10.8, "energy"]
    found = json.loads((tmp_path / "manifest.json").read_text())["responses"]
    assert {name: ws.Band(name, **facts) for name, facts in found.items()} == {"notch": band, "A": ws.BANDS["A"]}


def test_the_same_run_again_does_nothing(scene, folder):
    before = {name: (folder / name).stat().st_mtime_ns for name in listing(folder)}
    report = ws.render_to_folder(scene, folder, range(60, 66), ["sat11", "sat47"], ["A", "E"], device="cpu")
    assert report.n_image_rendered == 0
    assert "already" in report.text()
    assert {name: (folder / name).stat().st_mtime_ns for name in listing(folder)} == before


@pytest.mark.ci
def test_a_damaged_file_is_made_again(scene, tmp_path):
    arguments = ([60, 61], ["sat11"], ["A"])
    ws.render_to_folder(scene, tmp_path, *arguments, device="cpu")
    cube = tmp_path / "sat11_A.fits"
    good = cube.read_bytes()
    cube.write_bytes(good[:-1] + b"x")
    ws.render_to_folder(scene, tmp_path, *arguments, device="cpu")
    assert cube.read_bytes() == good


@pytest.mark.ci
def test_only_the_sensor_of_a_damaged_file_is_made_again(scene, folder, tmp_path):
    arguments = (range(60, 66), ["sat11", "sat47"], ["A", "E"])
    ws.render_to_folder(scene, tmp_path, *arguments, device="cpu")
    (tmp_path / "sat47_E.fits").unlink()
    untouched = (tmp_path / "sat11_A.fits").stat().st_mtime_ns
    report = ws.render_to_folder(scene, tmp_path, *arguments, device="cpu")
    assert report.n_image_rendered == 12
    assert "12 images kept from before" in report.text()
    assert (tmp_path / "sat11_A.fits").stat().st_mtime_ns == untouched
    assert listing(tmp_path) == listing(folder)
    for name in listing(folder):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


@pytest.mark.ci
def test_a_different_run_is_refused_unless_told(scene, tmp_path):
    ws.render_to_folder(scene, tmp_path, [60], ["sat11"], ["A"], device="cpu")
    before = {name: (tmp_path / name).read_bytes() for name in listing(tmp_path)}
    with pytest.raises(ws.InputError, match="holds a different run"):
        ws.render_to_folder(scene, tmp_path, [60], ["sat47"], ["A"], device="cpu")
    assert {name: (tmp_path / name).read_bytes() for name in listing(tmp_path)} == before
    ws.render_to_folder(scene, tmp_path, [60], ["sat47"], ["A"], device="cpu", overwrite=True)
    assert listing(tmp_path) == ["contact_sheet.png", "manifest.json", "sat47_A.fits", "truth.fits"]


SMALL_RUN = ([60], ["sat11"], ["A"])


@pytest.mark.parametrize("name", ["sat11_A.fits", "truth.fits", "contact_sheet.png", "manifest.json"])
@pytest.mark.ci
def test_files_of_others_are_never_touched(scene, tmp_path, name):
    (tmp_path / name).write_text('{"key": "no", "files": {"precious.txt": 1, "../other.fits": 2}}')
    (tmp_path / "precious.txt").write_text("mine")
    (tmp_path / ".download.partial").write_text("mine")
    before = {item: (tmp_path / item).read_bytes() for item in listing(tmp_path)}
    for overwrite in (False, True):
        with pytest.raises(ws.InputError, match=f"{name}: is there already, and warpsim did not write it"):
            ws.render_to_folder(scene, tmp_path, *SMALL_RUN, device="cpu", overwrite=overwrite)
    assert {item: (tmp_path / item).read_bytes() for item in listing(tmp_path)} == before


@pytest.mark.ci
def test_overwrite_removes_only_the_old_runs_files(scene, tmp_path):
    ws.render_to_folder(scene, tmp_path, *SMALL_RUN, device="cpu")
    (tmp_path / "notes.txt").write_text("mine")
    ws.render_to_folder(scene.replace(seed=5), tmp_path, [60], ["sat47"], ["A"], device="cpu", overwrite=True)
    assert listing(tmp_path) == ["contact_sheet.png", "manifest.json", "notes.txt", "sat47_A.fits", "truth.fits"]


def test_a_changed_catalog_is_a_different_run(scene, tmp_path):
    stars = tmp_path / "stars.csv"
    own = scene.replace(sky__catalog=str(stars))
    stars.write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,5.0\n")
    ws.render_to_folder(own, tmp_path / "out", *SMALL_RUN, device="cpu")
    stars.write_text("ra_deg,dec_deg,flux_A_jy\n10.0,20.0,50.0\n")
    with pytest.raises(ws.InputError, match="holds a different run"):
        ws.render_to_folder(own, tmp_path / "out", *SMALL_RUN, device="cpu")


@pytest.mark.ci
def test_names_given_twice_are_written_once(scene, tmp_path):
    ws.render_to_folder(scene, tmp_path, [60, 60], ["sat11", "sat11"], ["A", "A"], device="cpu")
    assert len(read_cube(tmp_path / "sat11_A.fits").frames) == 1


@pytest.mark.ci
def test_two_runs_do_not_share_a_folder(scene, tmp_path):
    import fcntl

    (tmp_path / ".warpsim-parts").mkdir()
    with (tmp_path / ".warpsim-parts" / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(ws.InputError, match="another run is writing to it"):
            ws.render_to_folder(scene, tmp_path, *SMALL_RUN, device="cpu")
    ws.render_to_folder(scene, tmp_path, *SMALL_RUN, device="cpu")
    assert not (tmp_path / ".warpsim-parts").exists()


def test_frames_without_access_are_left_out(scene, tmp_path):
    ws.render_to_folder(scene, tmp_path, [0, 60, 161], ["sat11"], ["A"], device="cpu")
    assert list(read_cube(tmp_path / "sat11_A.fits").frames["FRAME"]) == [60]


def test_files_do_not_depend_on_the_batch(scene, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("warpsim.output.run.COUNTS_BYTES_PER_CALL", 1)  # one frame a call
    ws.render_to_folder(scene, tmp_path, range(60, 66), ["sat11", "sat47"], ["A", "E"], device="cpu")
    assert listing(tmp_path) == listing(folder)
    for name in listing(folder):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


@pytest.mark.ci
def test_killed_halfway_then_completed(tmp_path, checkout_environment, record_accuracy):
    """SIGKILL after the first sensor: no half file under a final name; the same command then gives the same bytes."""
    command = [*COMMAND, "stss", "--bands", "A", "--sensors", "sat11,sat12,sat27,sat47", "--quiet", "-o"]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    subprocess.run([*command, str(whole)], env=checkout_environment, check=True, capture_output=True)
    n_final = 0
    for wanted in (1, 2):  # kill twice, each time later
        process = subprocess.Popen([*command, str(killed)], env=checkout_environment, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 120
        while len(list(killed.glob("*.fits"))) < wanted and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        process.wait()
        finals = [path for path in killed.iterdir() if path.is_file() and not path.name.startswith(".")]
        for path in finals:
            assert path.read_bytes() == (whole / path.name).read_bytes(), f"half a file: {path.name}"
        n_final = len(finals)
    assert n_final >= 2
    subprocess.run([*command, str(killed)], env=checkout_environment, check=True, capture_output=True)
    assert listing(killed) == listing(whole)
    for name in listing(whole):
        assert (killed / name).read_bytes() == (whole / name).read_bytes(), name
    differ = sum((killed / name).read_bytes() != (whole / name).read_bytes() for name in listing(whole))
    record_accuracy("Files of a run killed twice and resumed", differ, 0, "files differ", "an undisturbed run")


def test_whole_file_leaves_nothing_behind_on_an_error(tmp_path):
    path = tmp_path / "a.txt"

    def fail():
        with whole_file(path) as partial:
            partial.write_text("half")
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fail()
    assert listing(tmp_path) == []


def test_contact_sheet_is_a_picture_with_content(folder):
    import OpenImageIO as oiio

    pixels = oiio.ImageBuf(str(folder / "contact_sheet.png")).get_pixels(oiio.UINT8)
    assert pixels.shape[2] == 3
    assert pixels.shape[0] > 2 * 128
    assert pixels.max() == 255
    assert pixels.std() > 5


@pytest.mark.ci
def test_every_frame_renders_without_access(tmp_path):
    """sat13 never has access; a camera that stares at the sky is rendered all the same."""
    scene = ws.Scene.load("stss").replace(pointing={"kind": "fixed", "ra_dec_deg": [83.8, -5.4], "up": "north"})
    options = {"frames": range(2), "sensors": ["sat13"], "bands": ["A"]}
    with pytest.raises(ws.InputError, match="--every-frame renders all the same"):
        ws.render_to_folder(scene, tmp_path / "none", **options)
    report = ws.render_to_folder(scene, tmp_path / "all", every_frame=True, **options)
    assert report.n_image == 2
    assert not Table.read(tmp_path / "all" / "truth.fits")["access"].any()
    with pytest.raises(ws.InputError, match="no sensor has access"):
        ws.render_to_folder(scene, tmp_path / "all", **options)
